"""What delays do to estimates: their derivative by the delay, which is least squares as well.

A response that is recorded late biases estimates where the input moves from sample to sample, as dither does: of the
effectors, whose effect then seems too small, and of the states, which answer the last input and stand in for it. The
prediction errors look white, and no error bar shows it. If the deflections are those of d samples ago and responses
come l samples later still, the output holds ``theta_j u_j`` besides, with ``u_j = delta_j(k-d-l) - delta_j(k-d)``.
Least squares without it is off by what it makes of that (omitted variables)::

    S_j = (sum phi phi')^-1 sum phi u_j,     d theta / d (d/l) = - sum_j theta_j S_j

with the weights of the member; S_j costs one more right-hand side. When `bank.delay` finds another delay, what the
members remember is corrected by that. And what is not known of delays is in the bars: with the variance V of what all
have in common, and U_j of what effect j may have so late of its own::

    V (sum_j theta_j S_ji)^2 + sum_j U_j S_ji^2,     U_j = min(prior, 4 s^2 / left_j) + max(c_j^2 - 4 s^2 / left_j, 0)

with ``c_j = sum e u_j / left_j``, the regression of the prediction errors e on u_j, of which the regressors leave the
sum of squares left_j; where they leave nothing, as a state does that follows the last input at once, c_j cannot be
known and the prior holds: that delays may be unlike each other by half of what they are plausibly (`UNLIKE`).

References
----------
Greene, *Econometric Analysis*, section 4.3 (bias by omitted variables). Ljung, *System Identification*, 2nd ed.,
section 10.3 (gradients by filtered regressors).
"""

from __future__ import annotations

import math

from msls_ros.estimation.bank.loop_settings import BankSettings
from msls_ros.estimation.bank.mixing import sum_members
from msls_ros.estimation.bank.state import BankState
from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array

REDUNDANT = 1e-9
"""Least share of a regressor's square that the others leave unexplained, for it to count."""
APART = 0.05
"""Least share of the motion that delays make that the regressors leave unexplained: below, none can be known."""
BY_CHANCE = 4.0
"""Squared standard errors that a correlation may have by chance."""
MOMENTS = 0
"""Kind of the rows of angular rates; that of all others is 1."""
KEEP = 4
"""Delays, and the best that is known, are looked for at every so manieth sample."""
SLOWER = 5.0
"""How many times as long the slow means of the regressors are as the quick ones, .5 s."""
UNLIKE = 0.5
"""By how much delays may be unlike each other, over what they are plausibly [1]: 9 ms.

Before anything is seen of them; half of it changes no coverage by more than .01 on the seen beds (seed 811).
"""

REALISED, REALISED_THROUGH = 0.45, 0.65
"""Share of the variance by what is not known of delays that counts; through windows.

With .65, 95 % of the errors were within 1.0 to 1.7 of a bar that this dominates (now .8 to 1.8), through windows .7 to
2.3 (seeds 845 and 205, all beds).
"""


@compiled
def observe_inputs(s: BankSettings, x: BankState, phi: Array) -> None:
    """Update how quickly the regressors move, and what late effectors would change: (p,), constant first."""
    start = max(1.0 / (x.samples[0] + 1.0), s.quick)
    first = s.effectors_from + 1
    fade = s.colour_forgetting
    p = phi.shape[0]
    x.quick_samples[0] = fade * x.quick_samples[0] + 1.0
    slot = x.samples[0] % x.quick_past.shape[0]
    for i in range(1, p):
        x.quick_mean[i] += start * (phi[i] - x.quick_mean[i])
        x.slow_mean[i] += max(1.0 / (x.samples[0] + 1.0), s.quick / SLOWER) * (x.quick_mean[i] - x.slow_mean[i])
        x.quick[i] = phi[i] - x.quick_mean[i]
        for k in range(1, i + 1):
            x.moment[i, k] = fade * x.moment[i, k] + x.quick[i] * x.quick[k]
    for j in range(x.answer.shape[1]):
        x.quick_late[j] = x.quick_past[slot, j]
        x.quick_past[slot, j] = x.quick[first + j]
        step = x.quick_late[j] - x.quick[first + j]
        for i in range(1, p):
            x.quick_moment[j, i] = fade * x.quick_moment[j, i] + x.quick[i] * step
        for k in range(j + 1):
            x.steps[j, k] = fade * x.steps[j, k] + (x.quick_late[k] - x.quick[first + k]) * step


@compiled
def factorise(factor: Array, p: int) -> None:
    """Put the Cholesky factor of the lower triangle in its place, from row 1 to p, with the inverses of its pivots.

    A regressor that the others make up counts nothing.
    """
    for i in range(1, p):
        for k in range(1, i + 1):
            total = factor[i, k]
            size = total
            for n in range(1, k):
                total -= factor[i, n] * factor[k, n]
            if k < i:
                factor[i, k] = total * factor[k, k]
            else:
                factor[i, i] = 1.0 / math.sqrt(total) if total > REDUNDANT * size else 0.0


@compiled
def solve_forward(factor: Array, w: Array, start: int) -> float:
    """Solve ``L y = w`` in place, pivots inverted, w zero before ``start``; return ``y'y``."""
    size = 0.0
    for i in range(start, w.shape[0]):
        total = w[i]
        for k in range(start, i):
            total -= factor[i, k] * w[k]
        w[i] = total * factor[i, i]
        size += w[i] * w[i]
    return size


@compiled
def solve_backward(factor: Array, w: Array) -> None:
    """Solve ``L' y = w`` in place, pivots inverted."""
    for i in range(w.shape[0] - 1, -1, -1):
        total = w[i]
        for k in range(i + 1, w.shape[0]):
            total -= factor[k, i] * w[k]
        w[i] = total * factor[i, i]


@compiled
def observe_lag(s: BankSettings, x: BankState, q: int, error: float) -> None:
    """Update what row q's prediction errors have in common with what longer delays would change."""
    for j in range(x.cross.shape[1]):
        x.cross[q, j] = s.colour_forgetting * x.cross[q, j] + error * x.step_back[j]


@compiled
def find_late_square(s: BankSettings, x: BankState, q: int, products: Array) -> None:
    """Find the variance of row q's estimates by what is not known of delays, ``x.late_square``; (m,) scratch."""
    g = x.group[q]
    unlike = UNLIKE * UNLIKE * s.late_part * s.late_part
    variance = x.residual[q, 0] / x.residual[q, 1] if x.residual[q, 1] > 0.0 else 0.0
    for j in range(x.sensitivity.shape[1]):
        effect = x.mixed[q, s.effectors_from + 1 + j]
        left = x.unexplained[j]
        x.unlike[0, q, j] = unlike * effect * effect
        x.unlike[1, q, j] = 0.0
        if left > 0.0:
            c = x.cross[q, j] / left
            chance = BY_CHANCE * variance / left
            x.unlike[0, q, j] = min(x.unlike[0, q, j], chance)
            x.unlike[1, q, j] = max(c * c - chance, 0.0)
    for i in range(x.mixed.shape[1]):
        info = x.info[g, i]
        common = 0.0
        hidden = 0.0
        shown = 0.0
        for j in range(x.sensitivity.shape[1]):
            for m in range(products.shape[0]):
                products[m] = x.weight[q, m] * info[m] * x.sensitivity[g, j, i, m]
            mean = sum_members(products) / x.known[q, i]
            common += x.mixed[q, s.effectors_from + 1 + j] * mean
            hidden += x.unlike[0, q, j] * mean * mean
            shown += x.unlike[1, q, j] * mean * mean
        square = x.delay[s.kind[q], 1] * common * common + hidden + shown
        x.late_square[0, q, i] = (REALISED if s.straddle == 0 else REALISED_THROUGH) * square
        x.late_square[1, q, i] = shown
    if s.straddle > 0:
        for j in range(x.sensitivity.shape[1]):
            i = s.effectors_from + 1 + j
            bent = interpolated(s, x, q, j) * x.mixed[q, i]
            x.late_square[0, q, i] += bent * bent


@compiled
def interpolated(s: BankSettings, x: BankState, q: int, j: int) -> float:
    """Return by which share effector j is made smaller where it is interpolated, and its effect on row q larger.

    Of a motion of frequency w, of which a part p of a sample T is taken off, a straight line leaves
    ``1 - p (1-p) (w T)^2 / 2``; the mean of (w T)^2 is the mean square of the steps over that of what moves. Through a
    window what acted between the samples is in the derivatives, and is not known.
    """
    i = s.effectors_from + 1 + j
    moves = x.moment[i, i]
    if moves <= 0.0:
        return 0.0
    part = x.delay[s.kind[q], 0] - math.floor(x.delay[s.kind[q], 0])
    return float(0.5 * part * (1.0 - part) * x.steps[j, j] / (moves * s.late * s.late))


@compiled
def shift_estimates(s: BankSettings, x: BankState, kind: int, change: float) -> None:
    """Correct what the members of a kind of rows remember for a delay that is longer by ``change`` of its unit, l."""
    first = s.effectors_from + 1
    for q in range(x.mixed.shape[0]):
        if s.kind[q] != kind:
            continue
        for j in range(x.sensitivity.shape[1]):
            amount = change * x.mixed[q, first + j]
            for i in range(x.mixed.shape[1]):
                theta = x.members[q, i]
                part = x.sensitivity[x.group[q], j, i]
                for m in range(theta.shape[0]):
                    theta[m] -= amount * part[m]


@compiled
def known_effect(x: BankState, q: int, i: int) -> float:
    """Return as much of coefficient i's effect on row q as is known of it: ``theta^3 / (theta^2 + se^2)``.

    Corrections by what is not known feed on themselves: of an effector that hardly moves, they are all that it does.
    After an alarm it is known as before.
    """
    effect = x.mixed[q, i]
    square = effect * effect
    error = min(x.square[q, i], x.square_before[q, i]) if x.pending[q] != 0 else x.square[q, i]
    return float(effect * (square / (square + error))) if square > 0.0 else 0.0


@compiled
def lag_square(x: BankState, q: int, i: int) -> float:
    """Variance of row q's coefficient i by what is not known of delays."""
    return float(x.late_square[0, q, i])
