"""What is known of A and B, when it was known best, and what changed slowly: from the published models."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from msls_ros.report.recorded import Array, Event, Flags, Models

WELL = 0.1
"""Relative standard error up to which a number is well known."""
_SURE = 5.0
"""Standard errors of a slow change."""
_LARGE = 0.3
"""A slow change is at least this share of the number."""
_SLOW = 0.5
"""A slow change takes at least so long [s]."""
_SETTLED = 3.0
"""Time after a start or an alarm in which an estimate still settles, and its changes are none of the aircraft [s]."""
_LOOKS = 160
"""Models at which slow changes are looked for."""
_CONTRADICTED = 3.0
_TURNING = {"u": "vwQR", "v": "uwPR", "w": "uvPQ"}
"""Columns of the equations of force that change with every motion, for the body's axes turn: omega x velocity."""
_LASTING = 1.0
"""A number is known that has been reliable for so long, or is so in the last model, as in `offline.best` [s]."""


@dataclass(frozen=True)
class Knowledge:
    """The best of every number of A and B together; n states, m effectors: shapes (n, n + m)."""

    rows: tuple[str, ...]
    columns: tuple[str, ...]
    free: Flags
    """Which numbers are identified."""
    value: Array
    std: Array
    """NaN where never known."""
    time: Array
    """When each was known best [s]."""
    now: Flags
    """Whether it is reliable in the last model."""
    last: Array
    last_std: Array
    """In the last model."""
    fixed: Array
    """What physics gives; NaN where nothing."""

    @property
    def known(self) -> Flags:
        """Which numbers were ever reliable since the last alarm of their equation."""
        return np.isfinite(self.std)

    @property
    def well(self) -> int:
        """How many are known to better than `WELL`."""
        with np.errstate(invalid="ignore"):
            return int((self.std <= WELL * np.abs(self.value)).sum())


@dataclass(frozen=True)
class SlowChange:
    """A number that changed without an alarm."""

    name: str
    """``row/column``."""
    before: float
    after: float
    begin: float
    end: float
    """[s]"""


def gather_knowledge(models: Models, alarms: Sequence[Event]) -> Knowledge:
    """Return the best of every number, since the last alarm of its equation.

    Parameters
    ----------
    models
        At least one.
    alarms
        Events of detection.
    """
    value = np.concatenate([models.a, models.b], axis=2)
    std = np.concatenate([models.a_std, models.b_std], axis=2)
    reliable = np.concatenate([models.a_reliable & ~models.a_known, models.b_reliable], axis=2)
    free = np.concatenate([~models.a_known, np.ones(models.b.shape[1:], np.bool_)], axis=1)
    free[[i for i in range(len(models.states)) if i not in models.identified]] = False
    usable = reliable & np.isfinite(std) & (std > 0.0) & (value != 0.0) & free
    for i, name in enumerate(models.states):
        since = max((e.time for e in alarms if name in e.equations), default=-np.inf)
        usable[models.time < since, i] = False
    score = np.divide(std, np.abs(value), out=np.full(std.shape, np.inf), where=usable)
    at = score.argmin(axis=0)[None]
    best, error = (np.take_along_axis(field, at, 0)[0] for field in (value, std))
    with np.errstate(invalid="ignore"):
        against = np.abs(best - value[-1]) > _CONTRADICTED * np.hypot(error, std[-1])
    lasted = np.tensordot(np.diff(models.time, prepend=models.time[0]), usable, axes=1)
    lasting = usable[-1] | (lasted > _LASTING - 1e-6)
    known = np.isfinite(np.take_along_axis(score, at, 0)[0]) & lasting & ~against
    fixed = np.concatenate([models.a_known, np.zeros(models.b.shape[1:], np.bool_)], axis=1)
    return Knowledge(
        models.states, (*models.states, *models.effectors), free, np.where(known, best, np.nan),
        np.where(known, error, np.nan), models.time[at[0]], usable[-1], value[-1], std[-1],
        np.where(fixed, value[-1], np.nan),
    )  # fmt: skip


def slow_changes(models: Models, alarms: Sequence[Event], most: int = 3) -> list[SlowChange]:
    """Return numbers that changed surely and slowly between two alarms, the surest first.

    Parameters
    ----------
    models
        The published ones.
    alarms
        Events of detection.
    most
        How many.
    """
    found: list[tuple[float, SlowChange]] = []
    columns = (*models.states, *models.effectors)
    for i in models.identified:
        cuts = [e.time for e in alarms if models.states[i] in e.equations]
        edges = [-np.inf, *cuts, np.inf]
        for j, column in enumerate(columns):
            matrix, k = ("a", j) if j < len(models.states) else ("b", j - len(models.states))
            if matrix == "a" and (models.a_known[i, k] or column in _TURNING.get(models.states[i], "")):
                continue
            value, std, flags = (getattr(models, matrix + part)[:, i, k] for part in ("", "_std", "_reliable"))
            for begin, end in pairwise(edges):
                settled = max(begin, float(models.time[0])) + _SETTLED
                inside = (models.time > settled) & (models.time < end) & flags & np.isfinite(std)
                change = _slow_change(f"{models.states[i]}/{column}", models.time[inside], value[inside], std[inside])
                if change is not None:
                    found.append(change)
    found.sort(key=lambda one: -one[0])
    return [change for _, change in found[:most]]


def _slow_change(name: str, time: Array, value: Array, std: Array) -> tuple[float, SlowChange] | None:
    """Return how sure it is, and the change, of a number while it was reliable."""
    if len(time) < 40:
        return None
    places = np.unique(np.linspace(0, len(time) - 1, min(_LOOKS, len(time))).astype(int))
    value, std, time = _smooth(value[places]), std[places], time[places]
    far = np.abs(value[None, :] - value[:, None]) / np.hypot(std[None, :], std[:, None])
    share = np.abs(value[None, :] - value[:, None]) / np.maximum(np.abs(value[None, :]), np.abs(value[:, None]))
    sure = np.where(np.triu(share > _LARGE, 1), far, 0.0)
    a, b = np.unravel_index(int(sure.argmax()), sure.shape)
    if sure[a, b] < _SURE:
        return None
    done = (value[a : b + 1] - value[a]) / (value[b] - value[a])
    begin, end = time[a + int(np.flatnonzero(done < 0.1)[-1])], time[a + int(np.argmax(done > 0.9))]
    if end - begin < _SLOW:
        return None
    return float(sure[a, b]), SlowChange(name, float(value[a]), float(value[b]), float(begin), float(end))


def _smooth(values: Array) -> Array:
    """Return running medians of five."""
    padded = np.pad(values, 2, mode="edge")
    return np.asarray(np.median(np.lib.stride_tricks.sliding_window_view(padded, 5), axis=1))
