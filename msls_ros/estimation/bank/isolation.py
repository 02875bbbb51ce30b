"""Isolation with the bank: which surface kept which share of its effect, over all rows that alarmed; or silence.

`isolation` asks of each row alone which columns changed. Here a hypothesis is a surface (`surfaces`), and what the rows
say of its loss since the alarm is what `bank.losses.compare_surfaces` finds in the member that remembers the last
second and a half, against what was known before the alarm.

A name is given only where it stands: it explains most, and more than any other surface and than a state in each row
would; the rows that did not alarm do not deny it (`bank.unalarmed`); something practically changed; and it is the same
for a while, in which what is left no longer moves. How far it moved then is part of its error. That is a sequential
decision: it speaks when it is sure, not at a set time.

Rows that an alarm has begun anew know nothing of before. Rows that go on, for noise hid the change or it came slowly,
lag behind what still moves by as much as the member remembers. There a name must stand for longer, `SLOW`, and its
error is how far what is left moved then, times that memory over that time.

References
----------
Basseville and Nikiforov, *Detection of Abrupt Changes*, 1993, section 7.2.5. Wald, *Sequential Analysis*, 1947.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from msls_ros.estimation.bank.isolability import RIVAL
from msls_ros.estimation.bank.losses import APART, EXPLAINED
from msls_ros.estimation.isolation import PLAUSIBLE
from msls_ros.estimation.sections import IsolationParameters
from msls_ros.estimation.surfaces import Surface

UNCHANGED = 0.1
"""What is left of an effect within this of 1 has practically not changed."""
UNCERTAIN = 0.25
"""Largest standard error of what is said to be left."""
MOVES = 2.0
"""Standard errors by which what is left may move while a name is held."""
SLOW = 0.6
"""For so long a name of rows that have not begun anew must stand [s].

Of 15 names in a loss that comes over 5 s (F-16, three noises, seeds 811 and 812, as measured and through windows) 4
said what is left within 1.96 standard errors by the rule of abrupt changes, 13 of 13 by this one, 8 of 12 with .4 s.
The 113 names of abrupt losses remain, and a wrong one is gone.
"""


class Name(NamedTuple):
    """What is said to have changed."""

    surface: str
    statistic: float
    """Change over its standard error [1]."""
    left: float
    """Share of the effect [1]."""
    error: float


class Losses(NamedTuple):
    """What some rows say of every surface; k surfaces."""

    change: list[float]
    """(k,) of its effect, as a share of it."""
    error: list[float]
    """(k,) standard errors of that."""
    explained: list[float]
    """(k,) what it explains of all that changed."""
    by_state: float
    """What the best single state in each row explains."""
    excess: float
    """All that changed, beyond what noise makes."""


def find_name(found: Losses, surfaces: Sequence[Surface], limits: IsolationParameters) -> Name | None:
    """Return the surface that explains what changed; None: nothing does for certain."""
    best = max(range(len(surfaces)), key=lambda k: found.explained[k])
    others = max((found.explained[k] for k in range(len(surfaces)) if k != best), default=0.0)
    change, error = found.change[best], found.error[best]
    if found.explained[best] < max(EXPLAINED * found.excess, others + APART, others / RIVAL, found.by_state, 1e-12):
        return None
    certain = -change >= limits.significance * error and error <= UNCERTAIN
    if not certain or not PLAUSIBLE[0] <= 1.0 + change <= PLAUSIBLE[1] or abs(change) <= UNCHANGED:
        return None
    return Name(surfaces[best].name, abs(change) / error, 1.0 + change, error)


class Decision:
    """Holds a name until it has stood for a while.

    Parameters
    ----------
    samples
        How long.
    slow
        How long in rows that have not begun anew, in samples.
    lag
        By how much these lag behind, over that time [1].
    """

    def __init__(self, samples: int, slow: int = 0, lag: float = 1.0) -> None:
        """Hold nothing; see the class."""
        self._samples = samples
        self._slow = max(slow, samples)
        self._lag = max(lag, 1.0)
        self.clear()

    def clear(self) -> None:
        """Forget the name that is held."""
        self._held: list[Name] = []

    def take(self, name: Name | None, anew: bool = True) -> Name | None:
        """Take what a sample says, of rows that have begun anew or go on; return the name when it is decided."""
        if name is None or (self._held and self._held[-1].surface != name.surface):
            self._held = []
        if name is None:
            return None
        samples, lag = (self._samples, 1.0) if anew else (self._slow, self._lag)
        self._held = [*self._held, name][-samples:]
        low, high = (pick(one.left for one in self._held) for pick in (min, max))
        error = math.sqrt(name.error**2 + (lag * (high - low)) ** 2)
        if len(self._held) < samples or high - low > MOVES * name.error or error > UNCERTAIN:
            return None
        self.clear()
        return name._replace(error=error)
