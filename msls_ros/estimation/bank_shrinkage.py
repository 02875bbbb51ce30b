"""Estimates that have lost what was known of them are drawn back to it.

Where an input moves several regressors along one line, as a Dutch roll does sideslip, roll and yaw rate, least squares
predicts well and knows none of their effects: what little is not linear decides, and the best prediction has them far
from where an earlier input left them (an F-15's roll damping -3.5 +- .1 before its rudder inputs, -1.3 +- 1.9 in them).
The error bars say so; so do those of the best that was known (`bank_uncertainty`). Both are put together as least
squares does with what is known beforehand (Theil and Goldberger)::

    theta* = theta + C H' (H C H' + K)^-1 (theta_best - H theta)

C is the covariance of the leading member, each standard error as wide as `direct_squares` says; H picks the
coefficients of which more was known, K (diagonal) by how much: what `bank_uncertainty` says of an estimate from then.
Two things must not be: that two estimates as good as each other are mixed (the present one follows faults), and that
an old one is held against evidence of a change. So with ``c_i = C_ii``::

    K_i = k_i^2 (1 + (k_i^2 / (r^2 c_i))^4) + max((theta_best_i - theta_i)^2 - 4 c_i, 0)

The constant is such that the prediction for the regressor of now stays the same. This is what is published alone:
members, detector and what is kept go on without it. Its error is the smaller one of now and then, as before.

References
----------
Theil and Goldberger, "On pure and mixed statistical estimation in economics", Int. Economic Review 2 (1961).
"""

from __future__ import annotations

import math

from msls_ros.estimation.bank_attenuation import solve_column
from msls_ros.estimation.bank_state import BankSettings, BankState
from msls_ros.estimation.bank_uncertainty import CHANCE, carried_square, leading_member
from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array

CLEARLY = 0.35
"""r: standard error of then over that of now from which on estimates are drawn back [1]."""
NEGLIGIBLE = 100.0
"""K over C from which on a coefficient is left out: it would move by a hundredth of the way [1]."""


@compiled
def shrink(s: BankSettings, x: BankState, q: int, columns: Array, known: Array, squares: Array) -> None:
    """Fill in ``x.shift[q]``, by how much row q's estimates are drawn back.

    Parameters
    ----------
    s, x
        Settings and state.
    q
        Row.
    columns, known
        (p, p) and (p,) scratch.
    squares
        (p,) squared standard errors by what is known now (`direct_squares`), constant first.
    """
    p = squares.shape[0]
    any_known = False
    for i in range(p):
        x.shift[q, i] = 0.0
        known[i] = square_of_then(s, x, q, i, squares[i]) if i > 0 else math.inf
        any_known = any_known or known[i] < math.inf
    x.drawn[q] = 1 if any_known else 0
    if not any_known:
        return
    m = leading_member(x, q)
    g = x.group[q]
    for i in range(1, p):
        if known[i] == math.inf:
            continue
        solve_column(x.R[g], m, i, columns[i])
        unit = math.sqrt(squares[i] / columns[i, i])
        for j in range(1, p):
            if squares[j] < math.inf:
                columns[i, j] *= unit * math.sqrt(squares[j] * x.info[g, j, m])
            else:
                columns[i, j] = 0.0
    for i in range(1, p):
        if known[i] == math.inf:
            continue
        column = columns[i]
        total = column[i] + known[i]
        step = (x.best[q, i] - x.mixed[q, i] - x.shift[q, i]) / total
        for j in range(1, p):
            x.shift[q, j] += column[j] * step
        for k in range(i + 1, p):
            if known[k] < math.inf:
                part = columns[k, i] / total
                for j in range(1, p):
                    columns[k, j] -= part * column[j]


@compiled
def square_of_then(s: BankSettings, x: BankState, q: int, i: int, square: float) -> float:
    """Return K_i; infinite where no more was known of coefficient i than ``square`` says of now."""
    effector = s.effectors_from < i <= s.effectors_to
    if square == math.inf or (effector and x.answered[i - s.effectors_from - 1] == 0):
        return math.inf
    then = carried_square(s, x, q, i, x.best[q, i])
    ratio = then / (CLEARLY * CLEARLY * square)
    if ratio * ratio * ratio * ratio * then > NEGLIGIBLE * square:
        return math.inf
    moved = x.best[q, i] - x.mixed[q, i]
    return float(then * (1.0 + ratio * ratio * ratio * ratio) + max(moved * moved - CHANCE * square, 0.0))


@compiled
def hold_prediction(x: BankState, q: int, phi: Array) -> None:
    """Let the constant's part of row q's shift meet the others at the regressor of now, (p,)."""
    if x.drawn[q] == 0:
        return
    total = 0.0
    for i in range(1, x.shift.shape[1]):
        total += x.shift[q, i] * phi[i]
    x.shift[q, 0] = -total
