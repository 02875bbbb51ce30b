"""Estimates that have lost what was known of them are drawn back to it.

Where an input moves several regressors along one line, as a Dutch roll does sideslip, roll and yaw rate, least squares
predicts well and knows none of their effects: what little is not linear or is noise decides, and the best prediction
has them far from where an earlier input left them (an F-15's roll damping -3.8 +- .2 before its rudder inputs, -1.5
after them, and nothing known). The error bars say so; so do those of the best that was known (`bank.uncertainty`). What
is published is the mean of both, coefficient by coefficient (Theil and Goldberger)::

    theta* = theta + c / (c + k) (theta_best - theta)

with what `bank.uncertainty` says of an estimate from then, ``b``, and of the present error the part c that is of noise
taken for motion, ``s^2/I (w - 1)`` (`bank.attenuation`), and of the prior, no more than it allows: by how far estimates
move, or contradict each other, is no sign that nothing is known now, but that something changes. Two things must not
be: that two estimates as good as each other are mixed (the present one follows faults), and that an old one is held
against evidence of a change. So::

    k = b (1 + (b / (r^2 c))^4) + max((theta_best - theta)^2 - 4 c, 0)

Effects of states alone, each by itself. A fault takes effectors away, and what was known of those is not what is left;
and with covariances, where an effect changes slowly others would move with those that are drawn back (F-16, a
stabilator lost over 5 s, noise-free: error after it .0012, with either .006 to .013 of the value before).

Both without the bias that noise in the regressors makes, as far as it is known (`bank.correction`). The constant is
such that the prediction for the regressor of now stays the same. This is what is published alone: members, detector and
what is kept go on without it. Its error is the smaller one of now and then, as before, and that of then holds how far
the present estimate is from it, as if it were not drawn back: noise may have drawn that there, or a change.

References
----------
Theil and Goldberger, "On pure and mixed statistical estimation in economics", Int. Economic Review 2 (1961).
"""

from __future__ import annotations

import math

from msls_ros.estimation.bank.contradiction import CHANCE
from msls_ros.estimation.bank.loop_settings import BankSettings
from msls_ros.estimation.bank.residual import residual_variance
from msls_ros.estimation.bank.state import BankState
from msls_ros.estimation.bank.uncertainty import known_square
from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array

CLEARLY = 0.35
"""r: standard error of then over that of now from which on estimates are drawn back [1].

Of 117 flights of thirteen aircraft 22 lose .1 and more of R2 on a repeat; with effectors and covariances, r of .5, .35
and .2: 17, 14 and 16.
"""
NEGLIGIBLE = 100.0
"""Share from which on a coefficient is left alone: it would move by a hundredth of the way [1]."""
FEW = 4
"""What was known of fewer samples than so many for each coefficient is no reference yet, as in `bank.losses` [1]."""


@compiled
def shrink(s: BankSettings, x: BankState, q: int, squares: Array) -> None:
    """Fill in ``x.shift[q]``: the correction of row q's estimates, and by how much what states do is drawn back.

    Parameters
    ----------
    s, x
        Settings and state.
    q
        Row.
    squares
        (p,) squared standard errors by what is known now (`direct_squares`), constant first.
    """
    x.drawn[q] = 0
    x.shift[q, 0] = 0.0
    for i in range(1, x.shift.shape[1]):
        x.shift[q, i] = x.correction[q, i]
        share = share_of_now(s, x, q, i, squares[i]) if i <= s.effectors_from else math.inf
        if share < math.inf:
            x.shift[q, i] += moved_since(x, q, i) / (1.0 + share)
        if x.shift[q, i] != 0.0:
            x.drawn[q] = 1


@compiled
def moved_since(x: BankState, q: int, i: int) -> float:
    """Return by how much the best that was known of coefficient i of row q differs from what is now, both corrected."""
    return float(x.best[q, i] + x.best_correction[q, i] - x.mixed[q, i] - x.correction[q, i])


@compiled
def share_of_now(s: BankSettings, x: BankState, q: int, i: int, square: float) -> float:
    """Return ``k/c`` of coefficient i (constant first) of row q; infinite where no more was known of it.

    ``square`` is its squared standard error now.
    """
    if square == math.inf:
        return math.inf
    begun = x.clock[0] - x.age[x.group[q]] * s.period
    if x.best_square[q, i] == math.inf or x.best_time[q, i] < begun + FEW * x.mixed.shape[1] * s.period:
        return math.inf
    if not x.known[q, i] > 0.0:
        return math.inf
    now = residual_variance(x, q) / x.known[q, i] * x.unlearnt[q, i]
    then = max(known_square(s, x, q, i, x.best[q, i]), x.late_square[1, q, i])
    moved = moved_since(x, q, i)
    if not now > 0.0:
        return math.inf
    ratio = then / (CLEARLY * CLEARLY * now)
    share = (then * (1.0 + ratio * ratio * ratio * ratio) + max(moved * moved - CHANCE * now, 0.0)) / now
    return float(share) if share < NEGLIGIBLE else math.inf


@compiled
def hold_prediction(x: BankState, q: int, phi: Array) -> None:
    """Let the constant's part of row q's shift meet the others at the regressor of now, (p,)."""
    if x.drawn[q] == 0:
        return
    total = 0.0
    for i in range(1, x.shift.shape[1]):
        total += x.shift[q, i] * phi[i]
    x.shift[q, 0] = -total
