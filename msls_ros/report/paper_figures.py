"""The paper's figures of one parameter over samples: truth dashed, estimate solid, the spread over seeds as a band."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

Array = NDArray[np.float64]

INK, BLUE, BAND, RED = "#1a1a1a", "#1f5fa8", "#a9c6e8", "#b5342b"
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
    """(n,) the true parameter."""
    estimate: Array
    """(s, n) its estimates; the first seed is drawn as a line."""
    frame: tuple[float, float]
    """Range of the parameter that is shown; what goes beyond is cut off."""
    change: int | None = None
    """Sample of an abrupt change, marked."""
    alarms: tuple[int, ...] = ()
    """Samples at which the first seed's detector alarmed, marked."""
    parameter: str = r"$\theta_1$"


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
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(
        2, 1, height_ratios=[2.6, 1.0], left=0.09, right=0.975, top=0.905, bottom=0.225, hspace=0.1
    )
    upper = figure.add_subplot(grid[0])
    lower = figure.add_subplot(grid[1], sharex=upper)
    _draw_parameter(upper, content)
    _draw_error(lower, content)
    upper.tick_params(labelbottom=False)
    upper.set_xlim(0, len(content.truth))
    figure.suptitle(f"Fig. {content.number}: {content.title}", fontsize=13, x=0.09, ha="left", y=0.985)
    columns = (
        (0.09, "The paper", f"Fig. {content.number}: {content.paper_caption}"),
        (0.54, "Here", content.own_caption),
    )
    for x, head, text in columns:
        figure.text(x, 0.14, head, fontsize=10, fontweight="bold", va="top")
        figure.text(x, 0.108, textwrap.fill(text, CAPTION_WIDTH), fontsize=9.5, va="top", parse_math=False)
    figure.savefig(path, format="png", metadata={"Software": None})


def _draw_parameter(axes: Axes, content: ParameterFigure) -> None:
    """Draw truth, estimate, band and marks."""
    k = np.arange(len(content.truth))
    low, high = np.percentile(content.estimate, BAND_PERCENTILES, axis=0)
    seeds = len(content.estimate)
    if seeds > 1:
        axes.fill_between(k, low, high, color=BAND, linewidth=0, label=f"estimate, 5 to 95 % of {seeds} seeds")
    axes.plot(k, content.estimate[0], color=BLUE, linewidth=1.0, label="estimate, one seed")
    axes.plot(k, content.truth, color=INK, linewidth=1.3, linestyle=(0, (5, 3)), label="truth")
    if content.change is not None:
        axes.axvline(content.change, color=INK, linewidth=0.8, linestyle=":")
        axes.text(
            content.change + 0.006 * len(k), 0.96, rf"$\theta_2$ jumps at {content.change}",
            transform=axes.get_xaxis_transform(), va="top", fontsize=9,
        )  # fmt: skip
    marks = list(content.alarms)
    if marks:
        y = np.full(len(marks), content.frame[0] + 0.06 * (content.frame[1] - content.frame[0]))
        axes.plot(marks, y, marker="^", color=RED, linestyle="none", markersize=7, label="abrupt change declared")
    axes.set_ylim(*content.frame)
    axes.set_ylabel(f"{content.parameter} [1]", fontsize=11)
    axes.grid(True, color="#e4e4e4", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4, frameon=False, fontsize=9, borderaxespad=0.2)


def _draw_error(axes: Axes, content: ParameterFigure) -> None:
    """Draw the error of the estimate and its band."""
    k = np.arange(len(content.truth))
    error = content.estimate - content.truth
    low, high = np.percentile(error, BAND_PERCENTILES, axis=0)
    if len(error) > 1:
        axes.fill_between(k, low, high, color=BAND, linewidth=0)
    axes.plot(k, error[0], color=BLUE, linewidth=0.9)
    axes.axhline(0.0, color=INK, linewidth=1.0, linestyle=(0, (5, 3)))
    limit = 1.15 * float(np.percentile(np.abs(error), 99.0))
    if limit > 0.0:
        axes.set_ylim(-limit, limit)
    axes.set_ylabel(f"error of {content.parameter} [1]", fontsize=10)
    axes.set_xlabel("sample", fontsize=10, labelpad=2)
    axes.grid(True, color="#e4e4e4", linewidth=0.6)
    axes.set_axisbelow(True)
