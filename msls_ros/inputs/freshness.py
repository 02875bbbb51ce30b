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


FASTER, SPAN, LOST = 1.5, 500_000_000, 0.03
"""Stamps over the clock that are faster than real time; least time of the clock to say so [ns]; least share lost."""


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
        self._nominal = self._configured = nominal
        self._slowest = ""
        self._stamps: deque[int] = deque()
        self._told = False

    def expect(self, nominal: float, slowest: str = "") -> None:
        """Hold what comes against another rate from now on [Hz]: that of ``slowest``, a topic that sets the pace."""
        self._slowest = slowest
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
        found = f"samples come at {self.measured:.4g} Hz, sample_rate is {self._configured:g} Hz"
        if self._slowest:
            pace = f"they follow {self._slowest}, the slowest topic, which came at {self._nominal:.4g} Hz"
            return f"{found}: {pace}; publish it faster, or set sample_rate to what comes"
        return f"{found}: set it to what comes"

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


class LossWatch:
    """Whether samples get lost because they come faster than real time, as from a bag or a simulation.

    A queue holds as much time as a sample is of use in flight; at ten times real time that is a tenth of it. What comes
    faster only to make up for a stall is none of that: the stamps must gain on the clock beyond where they were before.

    Parameters
    ----------
    nominal
        Rate of the samples [Hz].
    queue
        What the queues hold [s of samples].
    """

    def __init__(self, nominal: float, queue: float) -> None:
        """Begin; see the class."""
        self._period, self._queue = 1e9 / nominal, queue
        self._last, self._missing = 0, 0.0
        self._since: tuple[int, int] | None = None
        self._most = 0
        self._before: int | None = None
        self._unsaid = 0.0
        self.lost = 0
        """Samples lost so, by their stamps."""
        self.sentence = ""
        """What to do about it; empty: nothing is lost."""

    def expect(self, nominal: float) -> None:
        """Count by another rate from now on [Hz]."""
        self._period = 1e9 / nominal

    def take(self, stamp: int, now: int) -> bool:
        """Take a sample's stamp and a steady clock [ns]; return whether a loss is to be told of now: once until over.

        Stamps that go back, or on by more than `WINDOW`, begin anew.
        """
        if self._since is None or not 0 < stamp - self._last <= WINDOW:
            self._since, self._last, self._missing = (stamp, now), stamp, 0.0
            self._most, self._before, self._unsaid = stamp - now, None, 0.0
            return False
        self._missing += self._period * max(round((stamp - self._last) / self._period) - 1, 0)
        self._last, self._most = stamp, max(self._most, stamp - now)
        span, passed = stamp - self._since[0], now - self._since[1]
        if span < WINDOW or passed < SPAN:
            return False
        told, missing, unsaid = bool(self.sentence), self._missing, self._unsaid
        self._unsaid = missing if self._before is None else 0.0
        gained = 0 if self._before is None else min(self._most - self._before, span - passed)
        speed = 1.0 + gained / passed
        self._since, self._missing, self._before, self.sentence = (stamp, now), 0.0, self._most, ""
        if speed < FASTER or missing < LOST * span:
            return False
        self.lost += round((unsaid + missing) / self._period)
        share = 100.0 * missing / span
        self.sentence = (
            f"samples come {speed:.3g} times as fast as real time, and {share:.0f} % of them are lost: start with a "
            f"larger 'queue', {speed * self._queue:.2g} or more; it is {self._queue:g} s of samples"
        )
        return not told
