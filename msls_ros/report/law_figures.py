"""Figure of a failure flown by one control law beside another: what was commanded, what came, with which surfaces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from msls_ros.report.figure_style import BLUE, CYCLE, DPI, INK, MUTED, ORANGE, house_style, write_png
from msls_ros.report.recorded import Array

LAW_COLOURS = {"fixed": ORANGE, "indi": BLUE, "lq": "#009E73", "hold": "#9aa5b1"}
ROWS = ("roll rate\n[deg/s]", "angle of attack\n[deg]", "sideslip\n[deg]", "surfaces\n[% of the travel]")
HEIGHTS = (1.0, 1.0, 0.8, 1.2, 1.3, 0.16)


@dataclass(frozen=True)
class LawHistory:
    """A flight by a law; n samples, s surfaces. Angles in degrees."""

    title: str
    time: Array
    """(n,) [s]"""
    roll: Array
    roll_wanted: Array
    alpha: Array
    alpha_wanted: Array
    beta: Array
    """(n,)"""
    surfaces: Array
    """(n, s) share of the travel to the limit, -1 to 1."""
    effect: Array
    effect_std: Array
    """(n, s) believed effectiveness and its standard error; empty: nothing is believed."""
    effect_true: Array
    """(n, s)"""
    laws: Sequence[str]
    """(n,) what flew."""
    departed: str
    """Why the flight ended early; empty: it did not."""


def plot_laws(
    path: Path, flights: Sequence[LawHistory], surfaces: Sequence[str], damaged: Sequence[str], fault: float | None
) -> None:
    """Write the figure.

    Parameters
    ----------
    path
        PNG to write.
    flights
        One column each.
    surfaces, damaged
        Names; the damaged ones are drawn with truth and band, the others thin.
    fault
        When the first fault strikes [s].
    """
    with house_style():
        figure = Figure(figsize=(11.5, 10.0), layout="constrained", dpi=DPI)
        grid = figure.subplots(
            len(HEIGHTS), len(flights), sharex=True, sharey="row", squeeze=False, height_ratios=HEIGHTS
        )
        colours = {name: CYCLE[k % len(CYCLE)] for k, name in enumerate(surfaces)}
        for k, (column, one) in enumerate(zip(grid.T, flights, strict=True)):
            _draw(list(column), one, surfaces, damaged, colours)
            for axis in column:
                axis.grid(True)
                if fault is not None:
                    axis.axvline(fault, color=INK, linestyle=":", linewidth=1.2, label="fault")
            column[0].set_title(one.title, fontsize=10, fontweight="bold")
            if k == 0:
                for axis, label in zip(column, (*ROWS, "effectiveness\nover the intact one", "law"), strict=True):
                    axis.set_ylabel(label)
        _limit(grid, flights)
        for axis in grid[-1]:
            axis.set_xlabel("time [s]")
        for row in (0, 3, 4):
            axis = max(grid[row], key=lambda one: len(one.get_legend_handles_labels()[0]))
            handles, labels = axis.get_legend_handles_labels()
            if row:  # the fault stands in the first key
                handles, labels = (
                    [one for one, label in zip(part, labels, strict=True) if label != "fault"]
                    for part in (handles, labels)
                )
            grid[row][-1].legend(handles, labels, loc="upper left", bbox_to_anchor=(1.0, 1.03), fontsize=8)
        write_png(figure, path)


def _draw(
    column: Sequence[Axes],
    one: LawHistory,
    surfaces: Sequence[str],
    damaged: Sequence[str],
    colours: dict[str, str],
) -> None:
    roll, alpha, beta, travel, effect, strip = column
    for axis, now, wanted in ((roll, one.roll, one.roll_wanted), (alpha, one.alpha, one.alpha_wanted)):
        axis.plot(one.time, wanted, color=INK, linestyle="--", linewidth=1.1, label="commanded")
        axis.plot(one.time, now, color=BLUE, label="flown")
    beta.plot(one.time, 0.0 * one.time, color=INK, linestyle="--", linewidth=1.1)
    beta.plot(one.time, one.beta, color=BLUE)
    for limit in (-100.0, 100.0):
        travel.axhline(limit, color=MUTED, linewidth=1.0)
    for k, name in enumerate(surfaces):
        hurt = name in damaged
        width = 1.8 if hurt else 0.9
        travel.plot(one.time, 100.0 * one.surfaces[:, k], color=colours[name], linewidth=width, label=_words(name))
        if one.effect.size:
            now, std = one.effect[:, k], one.effect_std[:, k]
            if hurt:
                effect.fill_between(
                    one.time,
                    now - 2.0 * std,
                    now + 2.0 * std,
                    color=colours[name],
                    alpha=0.2,
                    linewidth=0,
                    label=f"{_words(name)}, ± 2 standard errors",
                )
            effect.plot(one.time, now, color=colours[name], linewidth=width, label=_words(name))
        if hurt:
            label = f"{_words(name)}, true"
            effect.plot(one.time, one.effect_true[:, k], color=INK, linestyle="--", linewidth=1.2, label=label)
    if not one.effect.size:
        effect.text(0.72, 0.5, "believes its design only", transform=effect.transAxes, ha="center", color=MUTED)
    _strip(strip, one)
    if one.departed:
        roll.text(0.98, 0.06, f"departed at {one.time[-1]:.1f} s", transform=roll.transAxes, ha="right", color=ORANGE)
        for axis in column:
            axis.axvline(one.time[-1], color=ORANGE, linewidth=1.4)


def _strip(axis: Axes, one: LawHistory) -> None:
    """Draw which law flew."""
    starts = [0, *(k for k in range(1, len(one.laws)) if one.laws[k] != one.laws[k - 1])]
    for start, end in zip(starts, [*starts[1:], len(one.laws) - 1], strict=True):
        law = one.laws[start]
        axis.axvspan(one.time[start], one.time[end], color=LAW_COLOURS.get(law, MUTED), alpha=0.85, linewidth=0)
        middle = 0.5 * (one.time[start] + one.time[end])
        if one.time[end] - one.time[start] > 0.05 * one.time[-1]:
            axis.text(middle, 0.45, law, ha="center", va="center", color="white", fontsize=8.5)
    axis.set_yticks([])
    axis.set_ylim(0.0, 1.0)


def _words(name: str) -> str:
    return name.replace("_", " ")


def _limit(grid: np.ndarray[tuple[int, ...], np.dtype[np.object_]], flights: Sequence[LawHistory]) -> None:
    """Give each row a range that a departure does not blow up."""
    wanted = np.concatenate([one.roll_wanted for one in flights])
    size = max(float(np.abs(wanted).max()), 1.0)
    grid[0][0].set_ylim(-2.5 * size, 2.5 * size)
    middle = float(np.median(np.concatenate([one.alpha_wanted for one in flights])))
    spread = max(max(float(np.abs(one.alpha - one.alpha_wanted).max()) for one in flights), 1.0)
    grid[1][0].set_ylim(middle - 1.1 * min(spread, 9.0), middle + 1.1 * min(spread, 9.0))
    sideslip = max(max(float(np.abs(one.beta).max()) for one in flights), 1.0)
    grid[2][0].set_ylim(-1.1 * min(sideslip, 9.0), 1.1 * min(sideslip, 9.0))
    grid[3][0].set_ylim(-115.0, 115.0)
    grid[4][0].set_ylim(-0.35, 1.45)
    grid[0][0].set_xlim(0.0, max(float(one.time[-1]) for one in flights))
