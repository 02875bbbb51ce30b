"""Chosen parameters over time: estimate, 95 % band, truth; which ones to choose, and how good they were."""

from __future__ import annotations

from dataclasses import dataclass
from difflib import get_close_matches

import numpy as np

from msls_ros.report.chart import Line, Panel
from msls_ros.report.errors import ReportError
from msls_ros.report.recorded import Array, Flags, Models, Truth
from msls_ros.report.style import derivative, derivative_unit

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
    unit: str
    """The radian is 1; empty: not known."""

    @property
    def label(self) -> str:
        """How it is written."""
        paper = " (b43)" if (self.row, self.column) == _PAPER else ""
        unit = f" [{self.unit}]" if self.unit else ""
        return f"∂({derivative(self.row)}) / ∂{self.column}{paper}{unit}"


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
        near = get_close_matches(name, [f"{r}/{c}" for r in models.states for c in columns], 1)
        message = (
            f"parameter '{name}' does not exist; expected ROW/COLUMN with a row of {' '.join(models.states)} "
            f"and a column of {' '.join(columns)}" + (f"; did you mean '{near[0]}'?" if near else "")
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
    unit = derivative_unit(row, column, models.effectors)
    return Parameter(row, column, models.time, value[:, i, j], std[:, i, j], reliable[:, i, j], true, unit)


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


def panel_of(p: Parameter) -> Panel:
    """Return the drawing of a parameter: estimate, band, truth, and the strip of reliability."""
    low, high = _frame(p)
    lines = [Line("estimate, 95 % band", p.time, p.value, 0, BAND * p.std)]
    if p.truth is not None:
        lines.append(Line("truth", p.time, p.truth, 8))
    return Panel(p.label, lines, (p.time, p.reliable), low, high)


def _frame(p: Parameter) -> tuple[float, float]:
    """Return the range to show: estimates and truth but the worst hundredths, and the middle of the band."""
    finite = np.isfinite(p.std) & np.isfinite(p.value)
    if not finite.any():
        finite = np.isfinite(p.value)
    known = finite & p.reliable
    chosen = known if known.sum() > 0.05 * len(p.value) else finite
    parts = [np.quantile(p.value[chosen], [0.02, 0.98])] if chosen.any() else []
    if chosen.any() and np.isfinite(p.std[chosen]).all():
        half, middle = BAND * np.median(p.std[chosen]), np.median(p.value[chosen])
        parts.append(np.array([middle - half, middle + half]))
    if p.truth is not None and len(p.truth):
        parts.append(np.quantile(p.truth, [0.0, 1.0]))
    if not parts:
        return -1.0, 1.0
    low, high = float(min(q[0] for q in parts)), float(max(q[1] for q in parts))
    margin = 0.15 * (high - low) or 0.1 * abs(high) or 1.0
    return low - margin, high + margin
