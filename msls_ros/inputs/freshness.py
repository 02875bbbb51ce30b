"""How old samples are, and whether they come at the rate that was promised."""

from __future__ import annotations

from collections import deque

NEAR = 1_000_000_000
"""A sample that comes within this of its stamp shows that clock and stamps are of one epoch [ns]."""
TOLERANCE = 0.1
"""Largest deviation of the rate, as a share."""
WINDOW = 2_000_000_000
"""Time over which the rate is measured [ns]."""


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
        """Rate over the last `WINDOW` [Hz]; the nominal one until so much time has been seen."""
        if len(self._stamps) < 2 or self._stamps[-1] - self._stamps[0] < WINDOW:
            return self._nominal
        return (len(self._stamps) - 1) * 1e9 / (self._stamps[-1] - self._stamps[0])

    @property
    def deviates(self) -> bool:
        """Whether it differs by more than `TOLERANCE`, over `WINDOW`."""
        return abs(self.measured / self._nominal - 1.0) > TOLERANCE

    @property
    def sentence(self) -> str:
        """Say so."""
        return f"samples come at {self.measured:.4g} Hz, sample_rate is {self._nominal:g} Hz: set it to what comes"

    def take(self, stamp: int) -> bool:
        """Take the stamp of a sample [ns]; return whether a deviation is to be told of now: once until it is over."""
        stamps = self._stamps
        stamps.append(stamp)
        while len(stamps) > 2 and stamp - stamps[1] >= WINDOW:
            stamps.popleft()
        if not self.deviates:
            self._told = False
            return False
        told, self._told = self._told, True
        return not told
