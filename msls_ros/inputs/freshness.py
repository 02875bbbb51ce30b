"""How old samples are, and whether they come at the rate that was promised."""

from __future__ import annotations

from collections import deque
from itertools import pairwise

NEAR = 1_000_000_000
"""A sample that comes within this of its stamp shows that clock and stamps are of one epoch [ns]."""
TOLERANCE = 0.1
"""Largest deviation of the rate, as a share."""
WINDOW = 2_000_000_000
"""Time over which the rate is measured [ns]."""
LEAST = 9
"""Samples from which a rate is measured, however slow they come."""
LONG = 3
"""A step longer than this many of the upper quartile of all is a pause; less may be samples that were lost, or stamps
that come in bursts."""


class Freshness:
    """The age of samples by their own stamps.

    Against the clock where that is comparable: where a sample has come within `NEAR` of its stamp since the start.
    Stamps of another epoch (time since boot, a bag played without its clock) are compared with the newest stamp.
    """

    def __init__(self) -> None:
        """Know nothing of the clock yet; see the class."""
        self.comparable = False
        """Whether clock and stamps are of one epoch."""

    def age(self, stamp: int, newest: int, now: int) -> int:
        """Return the age of a sample [ns].

        Parameters
        ----------
        stamp
            Its stamp [ns].
        newest
            The newest stamp that has come on any stream [ns].
        now
            The ROS clock [ns].
        """
        age = now - stamp
        if abs(age) <= NEAR:
            self.comparable = True
        return age if self.comparable and age >= -NEAR else max(newest - stamp, 0)


class RateWatch:
    """Compare the rate of the samples, by their stamps, with what was promised.

    Parameters
    ----------
    nominal
        [Hz]
    """

    def __init__(self, nominal: float) -> None:
        """Begin; see the class."""
        self._nominal = nominal
        self._stamps: deque[int] = deque()
        self._told = False

    def expect(self, nominal: float) -> None:
        """Hold what comes against another rate from now on [Hz]."""
        if abs(nominal / self._nominal - 1.0) > 0.5 * TOLERANCE:
            self._nominal = nominal
            self.clear()

    def clear(self) -> None:
        """Begin anew, after a jump of time."""
        self._stamps.clear()

    @property
    def measured(self) -> float:
        """Rate over the last `WINDOW`, without the pauses in it [Hz]; the nominal one until so much has been seen."""
        count, span = len(self._stamps), self._stamps[-1] - self._stamps[0] if self._stamps else 0
        if count < LEAST or span < WINDOW:
            return self._nominal
        mean = (count - 1) * 1e9 / span
        return mean if self._near(mean) else self._without_pauses()

    def _without_pauses(self) -> float:
        steps = sorted(after - before for before, after in pairwise(self._stamps))
        longest = LONG * steps[3 * (len(steps) - 1) // 4]
        usual = [step for step in steps if step <= longest]
        return len(usual) * 1e9 / max(sum(usual), 1)

    def _near(self, rate: float) -> bool:
        return abs(rate / self._nominal - 1.0) <= TOLERANCE

    @property
    def deviates(self) -> bool:
        """Whether it differs by more than `TOLERANCE`, over `WINDOW`."""
        return not self._near(self.measured)

    @property
    def sentence(self) -> str:
        """Say so."""
        return f"samples come at {self.measured:.4g} Hz, sample_rate is {self._nominal:g} Hz: set it to what comes"

    def take(self, stamp: int) -> bool:
        """Take the stamp of a sample [ns]; return whether a deviation is to be told of now: once until it is over."""
        stamps = self._stamps
        stamps.append(stamp)
        while len(stamps) > LEAST and stamp - stamps[1] >= WINDOW:
            stamps.popleft()
        if not self.deviates:
            self._told = False
            return False
        told, self._told = self._told, True
        return not told
