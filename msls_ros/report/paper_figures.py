"""The paper's figures of one parameter: truth dashed, estimates solid, the spread over seeds as bands."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from msls_ros.report.figure_style import write_png

Array = NDArray[np.float64]

INK, BLUE, BAND, RED = "#1a1a1a", "#1f5fa8", "#a9c6e8", "#b5342b"
ORANGE, RIVAL_BAND = "#c8560a", "#f6d3b8"
BAND_PERCENTILES = (5.0, 95.0)
CAPTION_WIDTH = 62
DPI = 120


@dataclass(frozen=True)
class ParameterFigure:
    """What one figure shows; n samples, s seeds."""

    number: int
    """Of the paper's figure."""
    title: str
    paper_caption: str
    own_caption: str
    truth: Array
    """(n,) the true parameter, or (s, n) where it differs between the seeds; the first is drawn."""
    estimate: Array
    """(s, n) its estimates; the first seed is drawn as a line."""
    frame: tuple[float, float]
    """Range of the parameter that is shown; what goes beyond is cut off."""
    change: float | None = None
    """Sample, or time [s], of an abrupt change, marked."""
    alarms: tuple[float, ...] = ()
    """Samples, or times [s], at which the first seed's detector alarmed, marked."""
    parameter: str = r"$\theta_1$"
    unit: str = "1"
    change_label: str = r"$\theta_2$ jumps at 300"
    time: Array | None = None
    """(n,) [s]; without it the samples are counted."""
    name: str = "estimate"
    rival: Array | None = None
    """(s, n) estimates of another estimator, drawn behind."""
    rival_name: str = ""

    @property
    def across(self) -> Array:
        """(n,) what goes along the horizontal axis."""
        samples = np.arange(self.estimate.shape[1], dtype=np.float64)
        return samples if self.time is None else self.time


def draw_figure(content: ParameterFigure, path: Path) -> None:
    """Draw a figure into a PNG file.

    Parameters
    ----------
    content
        What it shows.
    path
        Of the file; its folder must exist.

    Raises
    ------
    OSError
        Where the file cannot be written.
    """
    figure = Figure(figsize=(10.0, 6.8), dpi=DPI)
    grid = figure.add_gridspec(
        2,
        1,
        height_ratios=[2.6, 1.0],
        left=0.09,
        right=0.975,
        top=0.905 if content.rival is None else 0.875,
        bottom=0.225 if content.time is None else 0.26,
        hspace=0.1,
    )
    upper = figure.add_subplot(grid[0])
    lower = figure.add_subplot(grid[1], sharex=upper)
    _draw_parameter(upper, content)
    _draw_error(lower, content)
    upper.tick_params(labelbottom=False)
    x = content.across
    upper.set_xlim(0.0, 2.0 * x[-1] - x[-2])
    figure.suptitle(f"Fig. {content.number}: {content.title}", fontsize=13, x=0.09, ha="left", y=0.985)
    columns = (
        (0.09, "The paper", f"Fig. {content.number}: {content.paper_caption}"),
        (0.54, "Here", content.own_caption),
    )
    top = 0.14 if content.time is None else 0.175
    for x0, head, text in columns:
        figure.text(x0, top, head, fontsize=10, fontweight="bold", va="top")
        figure.text(x0, top - 0.032, textwrap.fill(text, CAPTION_WIDTH), fontsize=9.5, va="top", parse_math=False)
    write_png(figure, path)


def _series(content: ParameterFigure) -> list[tuple[Array, str, str, str]]:
    """Return estimates, name, colour of line and band; what is drawn first comes first."""
    ours = (content.estimate, content.name, BLUE, BAND)
    return [ours] if content.rival is None else [(content.rival, content.rival_name, ORANGE, RIVAL_BAND), ours]


def _draw_parameter(axes: Axes, content: ParameterFigure) -> None:
    """Draw truth, estimates, bands and marks."""
    x = content.across
    for estimate, name, colour, shade in _series(content):
        low, high = np.percentile(estimate, BAND_PERCENTILES, axis=0)
        if len(estimate) > 1:
            label = f"{name}, 5 to 95 % of {len(estimate)} seeds"
            axes.fill_between(x, low, high, color=shade, linewidth=0, label=label)
        axes.plot(x, estimate[0], color=colour, linewidth=1.0, label=f"{name}, one seed")
    truth = np.atleast_2d(content.truth)[0]
    axes.plot(x, truth, color=INK, linewidth=1.3, linestyle=(0, (5, 3)), label="truth")
    if content.change is not None:
        axes.axvline(content.change, color=INK, linewidth=0.8, linestyle=":")
        axes.text(
            content.change + 0.006 * (x[-1] - x[0]), 0.96, content.change_label,
            transform=axes.get_xaxis_transform(), va="top", fontsize=9,
        )  # fmt: skip
    marks = list(content.alarms)
    if marks:
        y = np.full(len(marks), content.frame[0] + 0.06 * (content.frame[1] - content.frame[0]))
        axes.plot(marks, y, marker="^", color=RED, linestyle="none", markersize=7, label="abrupt change declared")
    axes.set_ylim(*content.frame)
    axes.set_ylabel(f"{content.parameter} [{content.unit}]", fontsize=11)
    axes.grid(True, color="#e4e4e4", linewidth=0.6)
    axes.set_axisbelow(True)
    columns = 4 if content.rival is None else 3
    axes.legend(
        loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=columns, frameon=False, fontsize=9, borderaxespad=0.2
    )


def _draw_error(axes: Axes, content: ParameterFigure) -> None:
    """Draw the errors of the estimates and their bands."""
    x = content.across
    limit = 0.0
    for estimate, _, colour, shade in _series(content):
        error = estimate - content.truth
        low, high = np.percentile(error, BAND_PERCENTILES, axis=0)
        if len(error) > 1:
            axes.fill_between(x, low, high, color=shade, linewidth=0)
        axes.plot(x, error[0], color=colour, linewidth=0.9)
        limit = max(limit, 1.15 * float(np.percentile(np.abs(error), 99.0)))
    axes.axhline(0.0, color=INK, linewidth=1.0, linestyle=(0, (5, 3)))
    if limit > 0.0:
        axes.set_ylim(-limit, limit)
    axes.set_ylabel("error" if content.time is not None else f"error of {content.parameter} [1]", fontsize=10)
    axes.set_xlabel("sample" if content.time is None else "time [s]", fontsize=10, labelpad=2)
    axes.grid(True, color="#e4e4e4", linewidth=0.6)
    axes.set_axisbelow(True)
