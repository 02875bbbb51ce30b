"""Whether the outputs answer the effectors of now, or those of a moment ago.

A response that is recorded late, or a deflection that is recorded early, biases estimates where the input moves from
sample to sample, as dither does: of the effectors, whose effect then seems too small, and of the states, which answer
the last input and stand in for it. The prediction errors look white, and no error bar shows it. But a right model
leaves nothing in its errors e that past inputs explain. What all responses have in common is taken out beforehand
(`bank_delay`), what follows is about what is left. With h the regressors above their mean of the last tenth of a
second, of which u_i(k) = h_i(k-l) - h_i(k) is what a delay of effector i by l samples would change (20 ms, at least a
sample), sums over seconds::

    M = sum h h',   d_i = sum h u_i,   w_i = M^-1 d_i
    c_i = sum e h_i(k-l) / (sum u_i^2 - d_i' w_i)         beyond what chance makes of it
    b_j = sum_i c_i w_ij q_j,   q_j = min(1 / (M^-1)_jj / I_j, 1)

c_i is the part of the effect that comes so late, by the regression of e on u_i with the regressors partialled out, and
b what least squares without u is off by. I is the information about the coefficient and q the share of it that is so
quick, for slow motion hardly sees a delay. A mixture of members weighs quick and slow motion in a way of its own: its
error is anything between nothing and b, a variance of ``b^2/3``, but all of b where no motion is slow, as with dither
alone. So ``b^2 (1 + 2q)/3`` is added. So is what c may be without showing: chance, or less where an effect cannot be
so much in error: by what is not known of the common delay, 18 ms at first, and a quarter of that by which delays may be
unlike each other (`UNLIKE`)::

    v_j = q_j^2 sum_i w_ij^2 min( part^2 theta_i^2, 4 s^2 / (sum u_i^2 - d_i' w_i) )

Where the regressors explain u_i themselves, as a state does that follows the last input at once, c_i cannot be known
and shows nowhere: the first of the two holds. In the first seconds of a flight ``s^2`` is corrected for
autocorrelation: the sums hold few stretches that are independent then. Of all that, the share `LATE` counts.

References
----------
Ljung, *System Identification*, 2nd ed., section 16.6 (residuals against past inputs). Greene, *Econometric Analysis*,
section 4.3 (bias by omitted variables).
"""

from __future__ import annotations

import math

from msls_ros.estimation.bank_state import BankSettings, BankState
from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array

BY_CHANCE = 4.0
"""Squared standard errors that a correlation may have by chance."""
APART = 0.05
"""Least share of u that the regressors leave unexplained: below, c cannot be known."""
REDUNDANT = 1e-9
"""Least share of a regressor's square that the others leave unexplained, for it to count."""
KEEP = 4
"""Delays, and the best that is known, are looked for at every so manieth sample."""
LATE = 0.4
"""Share of these variances that counts.

Where they dominate a bar, 95 % of the errors are within .7 to 1.3 of it in full, where 1.96 is due: measured in eleven
of twelve sets (F-16, four aircraft in flight test, eight others; A, B; inputs as measured and through differences).
"""
UNLIKE = 0.5
"""By how much delays may be unlike each other, over what they are plausibly [1]."""
FORGOTTEN = 3.0
"""Squares of a known error that delays, forgotten within seconds, add to it at most: it doubles."""


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
        x.quick[i] = phi[i] - x.quick_mean[i]
        for k in range(1, i + 1):
            x.moment[i, k] = fade * x.moment[i, k] + x.quick[i] * x.quick[k]
    for j in range(x.cross.shape[1]):
        x.quick_late[j] = x.quick_past[slot, j]
        x.quick_past[slot, j] = x.quick[first + j]
        step = x.quick_late[j] - x.quick[first + j]
        x.quick_power[j] = fade * x.quick_power[j] + step * step
        for i in range(1, p):
            x.quick_moment[j, i] = fade * x.quick_moment[j, i] + x.quick[i] * step
        for k in range(j + 1):
            x.steps[j, k] = fade * x.steps[j, k] + (x.quick_late[k] - x.quick[first + k]) * step


@compiled
def observe_lag(s: BankSettings, x: BankState, q: int, error: float) -> None:
    """Update what row q's prediction errors have in common with the last effectors."""
    for j in range(x.cross.shape[1]):
        x.cross[q, j] = s.colour_forgetting * x.cross[q, j] + error * x.quick_late[j]


@compiled
def regress_steps(x: BankState, factor: Array, w: Array) -> None:
    """Regress the steps of the effectors on the regressors: ``x.late`` w_i, ``x.unexplained`` what is left of u_i.

    Parameters
    ----------
    x
        State; ``x.quick_info`` becomes ``1/(M^-1)_ii``.
    factor
        (p, p) scratch: the Cholesky factor of M, lower triangular, with the inverses of its pivots; a regressor that
        the others make up counts nothing.
    w
        (p,) scratch.
    """
    p = factor.shape[0]
    for i in range(p):
        for k in range(i + 1):
            total = x.moment[i, k]
            for n in range(k):
                total -= factor[i, n] * factor[k, n]
            if k < i:
                factor[i, k] = total * factor[k, k]
            else:
                factor[i, i] = 1.0 / math.sqrt(total) if total > REDUNDANT * x.moment[i, i] else 0.0
    for i in range(p):
        for n in range(p):
            w[n] = 0.0
        w[i] = 1.0
        variance = solve_forward(factor, w, i)
        x.quick_info[i] = 1.0 / variance if variance > 0.0 else 0.0
    for j in range(x.late.shape[0]):
        late = x.late[j]
        for i in range(p):
            late[i] = x.quick_moment[j, i]
        left = x.quick_power[j] - solve_forward(factor, late, 0)
        solve_backward(factor, late)
        x.unexplained[j] = left if left > APART * x.quick_power[j] else 0.0


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
def first_seconds(s: BankSettings, x: BankState) -> bool:
    """Whether the sums over seconds are not full yet."""
    return bool(x.samples[0] * (1.0 - s.colour_forgetting) <= 1.0)


@compiled
def find_lag_bias(s: BankSettings, x: BankState, q: int, variance: float, colour: float) -> None:
    """Find what row q's estimates may be off by where responses are late: ``x.lag_bias``, ``x.lag_spread``.

    Parameters
    ----------
    s, x
        Settings, and state after `regress_steps`.
    q
        Row.
    variance
        Of the row's prediction errors.
    colour
        By how much their autocorrelation multiplies the variance of a mean [1].
    """
    chance = BY_CHANCE * variance * (colour if first_seconds(s, x) else 1.0)
    bias = x.lag_bias[q]
    spread = x.lag_spread[q]
    g = x.group[q]
    unlike = min(x.delay[1] + UNLIKE * UNLIKE * s.late_part * s.late_part, s.late_part * s.late_part)
    moved = max((x.delay[0] - x.delay[4]) ** 2 / (s.late * s.late) - x.delay[1], 0.0)
    for i in range(bias.shape[0]):
        bias[i] = 0.0
        spread[i] = 0.0
    for j in range(x.late.shape[0]):
        left = x.unexplained[j]
        effect = x.mixed[q, s.effectors_from + 1 + j]
        prior = unlike * effect * effect
        unknown = moved * effect * effect + (min(prior, chance / left) if left > 0.0 else prior)
        for i in range(bias.shape[0]):
            spread[i] += unknown * x.late[j, i] * x.late[j, i]
        if left <= 0.0:
            continue
        c = x.cross[q, j] / left
        certain = c * c - BY_CHANCE * variance / left
        if certain > 0.0:
            c = math.copysign(math.sqrt(certain), c)
            for i in range(bias.shape[0]):
                bias[i] += c * x.late[j, i]
    samples = max(x.taken[g, s.recent], 1.0) / x.quick_samples[0]
    for i in range(bias.shape[0]):
        quick = min(samples * x.quick_info[i] / x.info[g, i, s.recent], 1.0)
        bias[i] *= quick * math.sqrt(1.0 + 2.0 * quick)
        spread[i] *= quick * quick * (1.0 + 2.0 * quick)
        gain = min(KEEP * (1.0 - s.colour_forgetting), 1.0)
        x.lag_mean[q, i] += gain * (math.sqrt(lag_square_now(x, q, i)) - x.lag_mean[q, i])


@compiled
def lag_square(x: BankState, q: int, i: int) -> float:
    """Variance of what row q's coefficient i may be off by: between 0 and b, which is known to its own variance.

    No less than it was in the mean over the last seconds.
    """
    usual = x.lag_mean[q, i]
    return float(max(usual * usual, lag_square_now(x, q, i)))


@compiled
def lag_square_now(x: BankState, q: int, i: int) -> float:
    """As `lag_square` by the last sums alone: a bias that changes sign is nothing for a moment, and not known then."""
    return float(LATE * (x.lag_bias[q, i] * x.lag_bias[q, i] + x.lag_spread[q, i]) / 3.0)
