"""Isolation with the bank: which surface kept which share of its effect, over all rows that alarmed; or silence.

`isolation` asks of each row alone which columns changed. Here a hypothesis is a surface (`surfaces`): its loss changes
the effectors' columns of every row in one known direction a, by the same share. With ``D`` the difference of a row's
estimates, W the inverse of its covariance with the constant taken out (it always changes with the trim), over rows q::

    c = sum a' W D / sum a' W a         left = 1 + c         explained = (sum a' W D)^2 / sum a' W a   of   sum D' W D

A name is given only where it stands: it explains most, and more than any other surface and than a state in each row
would; something practically changed; and it is the same for a while, in which what is left no longer moves. How far it
moved then is part of its error. That is a sequential decision: it speaks when it is sure, not at a set time.

References
----------
Basseville and Nikiforov, *Detection of Abrupt Changes*, 1993, section 7.2.5. Wald, *Sequential Analysis*, 1947.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from msls_ros.estimation.isolation import PLAUSIBLE, Difference, invert
from msls_ros.estimation.sections import IsolationParameters
from msls_ros.estimation.surfaces import Surface

UNCHANGED = 0.1
"""What is left of an effect within this of 1 has practically not changed."""
APART = 9.0
"""By how much the right surface explains more than the next."""
KNOWN = 0.25
"""Largest relative error of the old effect of what is named."""
UNCERTAIN = 0.15
"""Largest standard error of what is said to be left."""
MOVES = 2.0
"""Standard errors by which what is left may move while a name is held."""


class Name(NamedTuple):
    """What is said to have changed."""

    surface: str
    statistic: float
    """Change over its standard error [1]."""
    left: float
    """Share of the effect [1]."""
    error: float


class Evidence(NamedTuple):
    """What one row says of every surface; k surfaces."""

    against: list[float]
    """(k,) ``a' W D``"""
    information: list[float]
    """(k,) ``a' W a``"""
    known: list[float]
    """(k,) relative variance of the old effect."""
    states: float
    """What the best single state explains."""
    total: float
    """``D' W D``"""


def row_evidence(d: Difference, surfaces: Sequence[Surface], first: int) -> Evidence | None:
    """Return what a row's difference says; None where its covariance is none.

    Parameters
    ----------
    d
        Estimates before the alarm and since, constant last.
    surfaces
        The hypotheses.
    first
        Index of the first effector.
    """
    p = len(d.before)
    covariance = d.before_covariance + d.since_covariance
    scale = np.sqrt(np.maximum(np.diagonal(covariance), 0.0))
    W = np.zeros((p, p))
    if not (np.isfinite(covariance).all() and (scale > 0.0).all()):
        return None
    if not invert(covariance / scale[:, None] / scale, W, np.zeros((2, p, p))):
        return None
    W = W - W[:, p - 1 :] * W[p - 1 :, :] / W[p - 1, p - 1]
    rows = W.tolist()
    difference = ((d.since - d.before) / scale).tolist()
    WD = [_sum(row, difference) for row in rows]
    states = max((WD[j] ** 2 / rows[j][j] for j in range(first) if rows[j][j] > 0.0), default=0.0)
    against, information, known = [], [], []
    before, variance = d.before.tolist(), np.diagonal(d.before_covariance).tolist()
    sizes = scale.tolist()
    for surface in surfaces:
        m = len(surface.gains)
        effect = _sum(surface.shares, before[first : first + m])
        noise = _sum([g * g for g in surface.shares], variance[first : first + m])
        a = [0.0] * p
        for j, gain in enumerate(surface.gains):
            a[first + j] = effect * gain / sizes[first + j]
        against.append(_sum(a, WD))
        information.append(_sum(a, [_sum(row, a) for row in rows]))
        known.append(noise / (effect * effect) if effect != 0.0 else math.inf)
    return Evidence(against, information, known, states, _sum(difference, WD))


def find_name(found: Sequence[Evidence], surfaces: Sequence[Surface], limits: IsolationParameters) -> Name | None:
    """Return the surface that explains what changed in all rows; None: nothing does for certain."""
    explained = []
    for k in range(len(surfaces)):
        against, information = sum(e.against[k] for e in found), sum(e.information[k] for e in found)
        explained.append(against * against / information if against < 0.0 < information else 0.0)
    best = max(range(len(surfaces)), key=lambda k: explained[k])
    others = max((explained[k] for k in range(len(surfaces)) if k != best), default=0.0)
    total, states = sum(e.total for e in found), sum(e.states for e in found)
    if explained[best] < max(limits.explained * total, others + APART, states, 1e-12):
        return None
    information = sum(e.information[best] for e in found)
    change = sum(e.against[best] for e in found) / information
    known = sum(e.known[best] * e.information[best] for e in found if e.information[best] > 0.0) / information
    error = math.sqrt(1.0 / information + change * change * known)
    left = 1.0 + change
    certain = known <= KNOWN * KNOWN and abs(change) >= limits.significance * error and error <= UNCERTAIN
    if not certain or not PLAUSIBLE[0] <= left <= PLAUSIBLE[1] or abs(change) <= UNCHANGED:
        return None
    return Name(surfaces[best].name, abs(change) / error, left, error)


class Decision:
    """Holds a name until it has stood for a while.

    Parameters
    ----------
    samples
        How long.
    """

    def __init__(self, samples: int) -> None:
        """Hold nothing; see the class."""
        self._samples = samples
        self.clear()

    def clear(self) -> None:
        """Forget the name that is held."""
        self._held: list[Name] = []

    def take(self, name: Name | None) -> Name | None:
        """Take what a sample says; return the name when it is decided."""
        if name is None or (self._held and self._held[-1].surface != name.surface):
            self._held = []
        if name is None:
            return None
        self._held = [*self._held, name][-self._samples :]
        low, high = (pick(one.left for one in self._held) for pick in (min, max))
        if len(self._held) < self._samples or high - low > MOVES * name.error:
            return None
        error = math.sqrt(name.error**2 + (high - low) ** 2)
        self.clear()
        return name._replace(error=error)


def _sum(a: Sequence[float], b: Sequence[float]) -> float:
    total = 0.0
    for x, y in zip(a, b, strict=True):
        total += x * y
    return total
