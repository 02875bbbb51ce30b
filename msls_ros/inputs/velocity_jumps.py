"""Jumps of a velocity that no force makes: corrections by the filter that estimates it, kept out of its derivative.

An EKF that is told where it is corrects its velocity from one sample to the next, by .2 to .5 m/s on a small aircraft.
Divided by the time between them that is 10 m/s^2 and more, for one interval, and what a force makes of an intact
aircraft it is not: in the derivative it is a false alarm. With the increments ``D[k] = (x[k+1] - x[k]) / (t[k+1] -
t[k])``, a jump stands out from both neighbours in the same direction, by::

    m[k] = min(|D[k] - D[k-1]|, |D[k] - D[k+1]|)    0 where the two differ in sign

A step of the acceleration agrees with one neighbour, so it is no jump; nor is a spike of one sample, whose next
increment is the opposite one: the neighbours must agree with each other. An m is a jump where it is large beside what
m usually is (`FURTHER`, `BEYOND`), beside the increments around it (`SHARE`) and beside the speed of flight (`LEAST`),
and seldom (`APART`): velocities that are held between the messages of a slow sensor jump with each of them, and are
left alone. Where one velocity jumps, that interval is taken out of all of them, as a filter corrects them together.

What has jumped stays in the state; its derivative has the mean of the neighbouring increments in that interval. So a
sample whose increment may be a jump waits for the next one, which decides; all others pass at once.

References
----------
Menold, Pearson and Allgoewer, "Online outlier detection and removal", Proc. 7th Mediterranean Conference on Control and
Automation, 1999: filters that look at the neighbours of a sample.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from msls_ros.estimation.kernel import Array

FURTHER = 7.0
"""By how many of its root mean squares of late an m is a jump.

Of Gaussian white noise in samples that is 8.5, of white increments 6.2 standard deviations of the increments. With 6 of
these, 1.5 of `BEYOND` and 1 of `SHARE` gusts of 2 m/s on a small aircraft were taken for jumps, 8 in 54,000 samples and
10 in 53,000 whose stamps are up to 4 ms off; with these 0 in 67,000 of ten of these flights.
"""
BEYOND = 2.0
"""And by how many of the largest of late."""
SHARE = 1.5
"""And by how many of the larger increment beside it: a stamp of 50 Hz that is 4 ms off makes an increment half as much
again."""
ALIKE = 0.5
"""How far the two increments beside a jump differ at most, over m."""
LEAST = 0.003
"""Least jump, over the speed of flight."""
STEPS = 3.0
"""And over the step of a coarse record: the smallest change of late that is not zero."""
APART = 1.5
"""What comes again within this time is how the velocity comes [s]."""
REMEMBERED = 10.0
"""Memory of what is usual [s]."""
FIRST = 5.0
"""Time until what is usual is known [s]."""


class Settled(NamedTuple):
    """A sample to use now; c numbers."""

    stamp: int
    """[ns]"""
    row: Array
    """(c,)."""
    jump: Array | None
    """(c,) by how much each has jumped since the sample before [its unit]; None: nothing has."""


class _Usual:
    """What the m of one number are like [m/s^2]."""

    def __init__(self) -> None:
        """Know nothing; see the class."""
        self.square = self.largest = self.known = self.smallest = 0.0
        self.last = -math.inf
        """When an m was last as large as a jump [s]."""

    def limit(self, step: float, least: float, beside: float) -> float:
        """Return which m is a jump in so long [s], of ``least`` [m/s] at least, beside an increment [m/s^2]."""
        usual = max(FURTHER * math.sqrt(self.square), BEYOND * self.largest)
        return max(usual, max(least, STEPS * self.smallest) / step, SHARE * beside)

    def change(self, size: float, step: float) -> None:
        """Take the size of a change in so long [s] into account."""
        self.smallest *= 1.0 + step / REMEMBERED
        if size > 0.0 and (size < self.smallest or self.smallest == 0.0):
            self.smallest = size

    def remember(self, m: float, step: float, limit: float) -> None:
        """Take an m of an interval of so long [s] into account, up to the limit where what is usual is known."""
        if self.known >= FIRST:
            m = min(m, limit)
        self.known += step
        share = min(step / min(self.known, REMEMBERED), 1.0)
        self.square += share * (m * m - self.square)
        self.largest = max(self.largest * max(1.0 - step / REMEMBERED, 0.0), m)


class JumpFilter:
    """Find the jumps in rows of c numbers that come one by one; see the module.

    Parameters
    ----------
    columns
        Which numbers are velocities whose derivatives are made [m/s]; empty: all rows pass.
    speed
        Of flight [m/s].
    longest_gap
        Samples further apart than this say nothing of each other [ns].
    """

    def __init__(self, columns: Sequence[int], speed: float, longest_gap: int) -> None:
        """Know nothing; see the class."""
        self._columns, self._least, self._longest_gap = tuple(columns), LEAST * speed, longest_gap
        self.count = 0
        """Jumps found."""
        self.largest = 0.0
        """Largest of them [m/s]."""
        self.found: tuple[int, int, float] | None = None
        """Stamp [ns], number and size [m/s] of the jump that the last row has shown; None: it has shown none."""
        self.clear()

    def clear(self) -> None:
        """Forget all rows; the counts stay."""
        self._usual = {j: _Usual() for j in self._columns}
        self.begin(self._longest_gap)

    def begin(self, longest_gap: int) -> None:
        """Begin a stretch of samples no further apart than this [ns], without what is held; what is usual stays."""
        self._longest_gap = longest_gap
        self._held: tuple[int, Array] | None = None
        self._last: tuple[int, Array] | None = None
        self._steps: tuple[float, float] = (0.0, 0.0)
        """Of the last two intervals [s]; 0: there was none."""
        self._before: list[float] = []
        self._newest: list[float] = []
        """Increments over the last two intervals, by column [m/s^2]."""

    def push(self, stamp: int, row: Array) -> list[Settled]:
        """Take a row (c,), later than the one before [ns]; return what is to be used now: what was held, and it.

        The row itself is held where its increment may be a jump, until the next one.
        """
        self.found = None
        if not self._columns:
            return [Settled(stamp, row, None)]
        held, last = self._held, self._last
        self._held, self._last = None, (stamp, row)
        settled = []
        if last is None or stamp - last[0] > self._longest_gap:
            settled = [Settled(*held, None)] if held else []
            self.begin(self._longest_gap)
            self._last = stamp, row
            return [*settled, Settled(stamp, row, None)]
        step = (stamp - last[0]) * 1e-9
        increments = [float(row[j] - last[1][j]) / step for j in self._columns]
        if self._steps[0] > 0.0:
            jump = self._judge(last[0], len(row), increments, held is not None)
            settled = [Settled(*held, jump)] if held else []
        self._steps = self._steps[1], step
        self._before, self._newest = self._newest, increments
        if self._steps[0] > 0.0 and self._may_jump(stamp):
            self._held = stamp, row
            return settled
        return [*settled, Settled(stamp, row, None)]

    def _may_jump(self, stamp: int) -> bool:
        """Whether the newest increment stands out from the one before, so that the next must be seen."""
        for j, before, own in zip(self._columns, self._before, self._newest, strict=True):
            usual = self._usual[j]
            waited = usual.known >= FIRST and stamp * 1e-9 - usual.last >= APART
            if waited and abs(own - before) > usual.limit(self._steps[1], self._least, abs(before)):
                return True
        return False

    def _judge(self, stamp: int, width: int, after: list[float], held: bool) -> Array | None:
        """Return by how much each number has jumped in the newest interval, (width,), now that the next is known."""
        step, time = self._steps[1], stamp * 1e-9
        most, which = 0.0, -1
        for j, a, own, b in zip(self._columns, self._before, self._newest, after, strict=True):
            usual = self._usual[j]
            m = standing_out(a, own, b) if a != 0.0 or b != 0.0 else 0.0
            limit = usual.limit(step, self._least, max(abs(a), abs(b)))
            if m > limit:
                seldom, usual.last = time - usual.last >= APART, time
                if held and seldom and usual.known >= FIRST and abs(b - a) <= ALIKE * m:
                    size = abs(own - 0.5 * (a + b)) * step
                    most, which = max((most, which), (size, j))
                    continue
            usual.remember(m, step, limit)
            usual.change(abs(own) * step, step)
        if which < 0:
            return None
        jump = np.zeros(width)
        for i, j in enumerate(self._columns):
            smooth = 0.5 * (self._before[i] + after[i])
            jump[j] = (self._newest[i] - smooth) * step
            self._newest[i] = smooth
        self.count += 1
        self.largest = max(self.largest, most)
        self.found = stamp, which, most
        return jump


def standing_out(before: float, own: float, after: float) -> float:
    """Return by how much an increment stands out from both neighbours in the same direction; see the module."""
    a, b = own - before, own - after
    return min(abs(a), abs(b)) if a * b > 0.0 else 0.0


def velocities_made(states: Iterable[tuple[str, bool]]) -> list[int]:
    """Return which states are velocities whose derivatives are made; of each its name, and whether its own is."""
    return [i for i, (name, made) in enumerate(states) if made and name in ("u", "v", "w")]
