"""The best that was known of every number of A and B, and when: kept while a flight is identified."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msls_ros.estimation import Estimate, FaultEvent
from msls_ros.estimation.estimate import EventKind

Array = NDArray[np.float64]
EPOCH = 100_000_000_000_000
"""Stamps beyond this count from somewhere else than the flight's beginning [ns]."""
LEAST_TIME = 1.0
"""A number is known that has been reliable for so long, or is so at the end; among many, some seem sure briefly [s]."""


def origin_of(first: int) -> int:
    """Return the stamp [ns] of flight time 0: 0 where stamps count from there themselves, otherwise the first stamp."""
    return first if first > EPOCH else 0


class Known(NamedTuple):
    """A number of A or B at its best."""

    row: str
    column: str
    value: float
    std: float
    time: float
    """Of the model [s], as stamped."""
    now: bool
    """Whether it is reliable at the end too."""


class BestModel:
    """Take models in the order of time; an alarm makes what was known of its equations old."""

    def __init__(self) -> None:
        """Know nothing; see the class."""
        self._names: tuple[tuple[str, ...], tuple[str, ...]] = ((), ())
        self._score = self._value = self._std = self._time = np.zeros((0, 0))
        self._last: NDArray[np.bool_] = np.zeros((0, 0), np.bool_)
        self._end = (self._score, self._score)
        self._reliable_time, self._newest = self._score, 0.0

    def take(self, models: Sequence[Estimate], events: Sequence[FaultEvent]) -> None:
        """Take a block of models, and the events of its time."""
        if not models:
            return
        if not self._names[0]:
            states, effectors = models[0].states, models[0].effectors
            shape = (len(states), len(states) + len(effectors))
            self._names = states, (*states, *effectors)
            self._score = np.full(shape, np.inf)
            self._value, self._std, self._time, self._reliable_time = (np.zeros(shape) for _ in range(4))
            self._newest = models[0].time
        begin = 0
        for event in [e for e in events if e.kind == EventKind.DETECTED]:
            cut = sum(m.time < event.time for m in models)
            self._take(models[begin:cut])
            begin = cut
            for name in event.equations:
                if name in self._names[0]:
                    row = self._names[0].index(name)
                    self._score[row], self._reliable_time[row] = np.inf, 0.0
        self._take(models[begin:])

    def _take(self, models: Sequence[Estimate]) -> None:
        if not models:
            return
        value = np.concatenate([[m.a for m in models], [m.b for m in models]], axis=2)
        std = np.concatenate([[m.a_std for m in models], [m.b_std for m in models]], axis=2)
        known = models[0].a_known
        reliable = np.concatenate(
            [np.array([m.a_reliable for m in models]) & ~known, [m.b_reliable for m in models]], axis=2
        )
        reliable &= np.isfinite(std) & (std > 0.0) & (value != 0.0)
        score = np.divide(std, np.abs(value), out=np.full(std.shape, np.inf), where=reliable)
        times = np.array([m.time for m in models])
        at = score.argmin(axis=0)[None]
        best = np.take_along_axis(score, at, 0)[0]
        better = best < self._score
        for own, new in (
            (self._score, best), (self._value, np.take_along_axis(value, at, 0)[0]),
            (self._std, np.take_along_axis(std, at, 0)[0]), (self._time, times[at[0]]),
        ):  # fmt: skip
            own[better] = new[better]
        self._reliable_time += np.tensordot(np.diff(times, prepend=self._newest), reliable, axes=1)
        self._last, self._end, self._newest = reliable[-1], (value[-1], std[-1]), float(times[-1])

    @property
    def known(self) -> list[Known]:
        """All numbers that were reliable, since the last alarm of their equation, row by row; see `LEAST_TIME`.

        A number that the last model contradicts, beyond three standard errors of both, is not among them.
        """
        rows, columns = self._names
        long_enough = self._last | (self._reliable_time > LEAST_TIME - 1e-6)
        with np.errstate(invalid="ignore"):
            apart = np.abs(self._value - self._end[0]) > 3.0 * np.hypot(self._std, self._end[1])
        return [
            Known(
                rows[i], columns[j], float(self._value[i, j]), float(self._std[i, j]), float(self._time[i, j]),
                bool(self._last[i, j]),
            )
            for i, j in np.argwhere(np.isfinite(self._score) & long_enough & ~apart).tolist()
        ]  # fmt: skip

    @property
    def size(self) -> int:
        """How many numbers there are."""
        return int(self._score.size)
