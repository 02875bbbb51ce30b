"""Chosen parameters over time: estimate, 95 % band, truth; which ones to choose, and how good they were."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle

from msls_ros.report.errors import ReportError
from msls_ros.report.recorded import Array, Flags, Models, Recorded, Truth, TruthChange
from msls_ros.report.style import BLACK, BLUE, Drawn, derivative, every, mark, time_axes, write

MOST = 8
"""Parameters shown where none are asked for."""
BAND = 1.96
"""Standard errors of a 95 % band."""
_LARGE = 0.12
"""A large entry of B is at least this share of the largest of its row."""
_CLEAR = 2.0
"""An entry worth showing is at least so many standard errors from zero, in the median."""
_PAPER = ("P", "ddt")
"""What the paper follows in its figures: dPdot/d ddt, which its text calls b43."""


@dataclass(frozen=True)
class Parameter:
    """One entry of A or B over time; k models."""

    row: str
    column: str
    time: Array
    value: Array
    std: Array
    reliable: Flags
    truth: Array | None

    @property
    def label(self) -> str:
        """How it is written."""
        paper = " (b43)" if (self.row, self.column) == _PAPER else ""
        return f"∂({derivative(self.row)}) / ∂{self.column}{paper}"


@dataclass(frozen=True)
class Quality:
    """How good a parameter was."""

    reliable: float
    """Share of the models in which it is published as reliable."""
    rms: float | None
    """Of the error, over the rms of the truth; None without truth."""
    covered: float | None
    """Share of the models whose 95 % band holds the truth."""
    covered_reliable: float | None
    """The same over the reliable ones; None where there are none."""


def choose(models: Models) -> list[str]:
    """Return what is worth showing: large entries of B, reliable ones first, then by estimate over error; and b43.

    Parameters
    ----------
    models
        At least one.

    Returns
    -------
    list of str
        ``row/column``, in the order of the rows.
    """
    known = np.isfinite(models.b_std) & (models.b_std > 0.0)
    t = np.divide(np.abs(models.b), models.b_std, out=np.zeros_like(models.b), where=known)
    strength = np.median(t, axis=0)
    size = np.median(np.abs(models.b), axis=0)
    found = []
    for i in models.identified:
        for j in range(len(models.effectors)):
            if size[i, j] >= _LARGE * size[i].max() and strength[i, j] >= _CLEAR:
                found.append((-float(models.b_reliable[:, i, j].any()), -float(strength[i, j]), i, j))
    best = [(i, j) for *_, i, j in sorted(found)[:MOST]]
    row, column = _PAPER
    if row in models.states and column in models.effectors:
        paper = models.states.index(row), models.effectors.index(column)
        if paper not in best and models.states.index(row) in models.identified:
            best = [*best[: MOST - 1], paper]
    return [f"{models.states[i]}/{models.effectors[j]}" for i, j in sorted(best)]


def pick(models: Models, truth: Truth | None, name: str) -> Parameter:
    """Return one parameter over time.

    Parameters
    ----------
    models, truth
        Of the flight.
    name
        ``row/column``: a state, and a state (of A) or an effector (of B).

    Raises
    ------
    ReportError
        If there is no such parameter.
    """
    row, _, column = name.partition("/")
    columns = (*models.states, *models.effectors)
    if row not in models.states or column not in columns:
        message = (
            f"parameter '{name}' does not exist; expected ROW/COLUMN with a row of {' '.join(models.states)} "
            f"and a column of {' '.join(columns)}"
        )
        raise ReportError(message)
    i = models.states.index(row)
    of_a = column in models.states
    j = models.states.index(column) if of_a else models.effectors.index(column)
    value, std, reliable = (
        (models.a, models.a_std, models.a_reliable) if of_a else (models.b, models.b_std, models.b_reliable)
    )
    true = None
    if truth is not None and len(truth.time):
        true = np.interp(models.time, truth.time, (truth.a if of_a else truth.b)[:, i, j])
    return Parameter(row, column, models.time, value[:, i, j], std[:, i, j], reliable[:, i, j], true)


def quality(parameter: Parameter) -> Quality:
    """Return how good a parameter was over the flight."""
    share = float(parameter.reliable.mean())
    usable = np.isfinite(parameter.std) & np.isfinite(parameter.value)
    if parameter.truth is None or not usable.any():
        return Quality(share, None, None, None)
    error = np.abs(parameter.value - parameter.truth)
    inside = error <= BAND * parameter.std
    level = float(np.sqrt(np.mean(np.square(parameter.truth[usable]))))
    rms = float(np.sqrt(np.mean(np.square(error[usable])))) / level if level > 0.0 else None
    sure = usable & parameter.reliable
    return Quality(share, rms, float(inside[usable].mean()), float(inside[sure].mean()) if sure.any() else None)


def draw_parameters(
    flight: Recorded,
    parameters: Sequence[Parameter],
    changes: Sequence[TruthChange],
    name: str,
    title: str,
    window: tuple[float, float] | None = None,
) -> Drawn:
    """Draw parameters, two in a row.

    Parameters
    ----------
    flight
        For its events.
    parameters
        At least one.
    changes
        Of the truth.
    name, title
        Of the figure.
    window
        The time shown [s]; None: all.
    """
    columns = 2 if len(parameters) > 1 else 1
    rows = -(-len(parameters) // columns)
    figure, axes = time_axes(rows, 2.05 if columns == 2 else 3.4, columns)
    for axis, parameter in zip(axes, parameters, strict=False):
        mark([axis], [e.time for e in flight.alarms], [c.time for c in changes])
        _draw(axis, parameter, window)
    for axis in axes[len(parameters) :]:
        axis.set_axis_off()
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=len(handles))
    against = "against truth (dashed)" if parameters[0].truth is not None else "; the bag holds no truth"
    caption = (
        f"Estimate with its 95 % band {against}. The strip at the foot is blue where the number is published as "
        "reliable, grey where it is not."
    )
    return write(figure, name, title, caption)


def _draw(axis: Axes, p: Parameter, window: tuple[float, float] | None) -> None:
    chosen = slice(None)
    if window is not None:
        inside = np.flatnonzero((p.time >= window[0]) & (p.time <= window[1]))
        chosen = slice(inside[0], inside[-1] + 1) if len(inside) else slice(0, 0)
    few = every(len(p.time[chosen]))
    time, value, std = p.time[chosen][few], p.value[chosen][few], p.std[chosen][few]
    low, high = _frame(value, std, None if p.truth is None else p.truth[chosen])
    band = np.where(np.isfinite(std), BAND * std, 2.0 * (high - low) + np.abs(value))
    axis.fill_between(
        time,
        np.clip(value - band, low - (high - low), high + (high - low)),
        np.clip(value + band, low - (high - low), high + (high - low)),
        color=BLUE, alpha=0.18, linewidth=0, label="95 % band",
    )  # fmt: skip
    axis.plot(time, value, color=BLUE, linewidth=1.4, label="estimate")
    if p.truth is not None:
        axis.plot(time, p.truth[chosen][few], color=BLACK, linestyle="--", linewidth=1.3, label="truth")
    axis.set_title(p.label)
    axis.set_ylim(low, high)
    if len(time):
        _strip(axis, time, p.reliable[chosen][few])


def _strip(axis: Axes, time: Array, reliable: Flags) -> None:
    """Show at the foot when a parameter is reliable."""
    edges = [0, *(np.flatnonzero(np.diff(reliable)) + 1), len(reliable)]
    for start, stop in pairwise(edges):
        begin, end = float(time[start]), float(time[min(stop, len(time) - 1)])
        colour = BLUE if reliable[start] else "#c3cad2"
        foot = axis.get_xaxis_transform()
        axis.add_patch(Rectangle((begin, 0.0), end - begin, 0.025, color=colour, linewidth=0, transform=foot))


def _frame(value: Array, std: Array, truth: Array | None) -> tuple[float, float]:
    """Return the range to show: estimates and truth but the worst hundredth, and the middle of the band."""
    finite = np.isfinite(std) & np.isfinite(value)
    if not finite.any():
        finite = np.isfinite(value)
    parts = [np.quantile(value[finite], [0.02, 0.98])] if finite.any() else []
    if np.isfinite(std[finite]).all() and finite.any():
        half = BAND * np.median(std[finite])
        middle = np.median(value[finite])
        parts.append(np.array([middle - half, middle + half]))
    if truth is not None and len(truth):
        parts.append(np.quantile(truth, [0.0, 1.0]))
    if not parts:
        return -1.0, 1.0
    low, high = float(min(p[0] for p in parts)), float(max(p[1] for p in parts))
    margin = 0.12 * (high - low) or 0.1 * abs(high) or 1.0
    return low - 1.5 * margin, high + margin
