"""Samples that are late: when that is worth a line in the log, and whether their stamps fall behind the clock."""

from __future__ import annotations

from collections import deque

import numpy as np

SECOND = 1_000_000_000
LONGEST = 60.0
"""Longest interval between two lines of one kind; so long without a cause, and the next is told of at once [s]."""
KEPT = 30
"""Seconds over which ages are compared."""
LEAST = 10
"""Seconds from which on it is said that they rise."""
QUEUED = 0.1
"""By how much they rise at least [s]: what a queue holds by default, so that a backlog is none."""
EVEN = 0.125
"""Most that ages may be off a straight line (rms), over their rise: a uniform rise has 0, a step in the middle 1/6."""


class Seldom:
    """Whether a warning that may hold on for long is to be given now: at once, then at intervals that double."""

    def __init__(self) -> None:
        """Nothing has been said yet; see the class."""
        self._said = self._last = 0
        self._every = 0.0

    def due(self, now: int) -> bool:
        """Take note of a cause, at an instant of a steady clock [ns]; return whether to warn."""
        last, self._last = self._last, now
        if self._every == 0.0 or now - last > LONGEST * SECOND:
            self._every = 0.5
        elif now - self._said < self._every * SECOND:
            return False
        self._said, self._every = now, min(2.0 * self._every, LONGEST)
        return True


class DriftWatch:
    """Whether the ages of samples rise steadily: the least of each second, so that jitter is none of it."""

    def __init__(self) -> None:
        """Know no age yet; see the class."""
        self._seconds: deque[tuple[int, float]] = deque(maxlen=KEPT)
        self.rate = 0.0
        """By how much they rise, where they do [s/s]."""

    def take(self, age: float, now: int) -> bool:
        """Take the age of a sample [s] at an instant of a steady clock [ns]; return whether it is seen now to rise."""
        second = now // SECOND
        if self._seconds and self._seconds[-1][0] == second:
            self._seconds[-1] = second, min(age, self._seconds[-1][1])
            return False
        before, self.rate = self.rate, self._rise()
        self._seconds.append((second, age))
        return self.rate > 0.0 and before == 0.0

    @property
    def sentence(self) -> str:
        """Say so; empty where they do not."""
        if not self.rate:
            return ""
        slow = 100.0 * self.rate
        return f"stamps fall behind the clock by {slow:.2g} %: a simulation slower than real time (use_sim_time)?"

    def _rise(self) -> float:
        """Return the slope of the ages of all seconds that are over [s/s]; 0: they do not rise, or not steadily."""
        if len(self._seconds) < LEAST:
            return 0.0
        seconds, ages = np.array(self._seconds, dtype=np.float64).T
        slope, start = np.polyfit(seconds - seconds[0], ages, 1)
        rise = float(slope * (seconds[-1] - seconds[0]))
        off = float(np.std(ages - start - slope * (seconds - seconds[0])))
        return float(slope) if rise > QUEUED and off < EVEN * rise else 0.0
