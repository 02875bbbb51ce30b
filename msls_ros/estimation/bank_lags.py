"""Whether the outputs answer the effectors of now, or those of a sample ago.

A response that is recorded late, or a deflection that is recorded early, biases estimates where the input moves from
sample to sample, as dither does: of the effectors, whose effect then seems too small, and of the states, which answer
the last input and stand in for it. The prediction errors look white, and no error bar shows it. But a right model
leaves nothing in its errors e that past inputs explain. With h an effector above its mean of the last tenth of a
second, and u(k) = h(k-1) - h(k) what a delay by a sample would change, sums over seconds::

    M = sum phi phi',   d_i = sum phi u_i,   w_i = M^-1 d_i
    c_i = sum e h_i(k-1) / (sum u_i^2 - d_i' w_i)         beyond what chance makes of it
    b = sum_i c_i w_i

c_i is the part of the effect that comes a sample late, by the regression of e on u_i with the regressors partialled
out, and b what least squares without u is off by.

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


@compiled
def observe_inputs(s: BankSettings, x: BankState, phi: Array) -> None:
    """Update how quickly the effectors move, and what that has in common with the regressors: (p,), constant first."""
    start = max(1.0 / (x.samples[0] + 1.0), s.quick)
    first = s.effectors_from + 1
    fade = s.colour_forgetting
    for i in range(phi.shape[0]):
        for k in range(i + 1):
            x.moment[i, k] = fade * x.moment[i, k] + phi[i] * phi[k]
    for j in range(x.quick.shape[0]):
        x.quick_mean[j] += start * (phi[first + j] - x.quick_mean[j])
        x.quick[j, 1] = x.quick[j, 0]
        x.quick[j, 0] = phi[first + j] - x.quick_mean[j]
        step = x.quick[j, 1] - x.quick[j, 0]
        x.quick_power[j] = fade * x.quick_power[j] + step * step
        for i in range(phi.shape[0]):
            x.quick_moment[j, i] = fade * x.quick_moment[j, i] + phi[i] * step


@compiled
def observe_lag(s: BankSettings, x: BankState, q: int, error: float) -> None:
    """Update what row q's prediction errors have in common with the last effectors."""
    for j in range(x.quick.shape[0]):
        x.cross[q, j] = s.colour_forgetting * x.cross[q, j] + error * x.quick[j, 1]


@compiled
def regress_steps(x: BankState, factor: Array) -> None:
    """Regress the steps of the effectors on the regressors: ``x.late`` w_i, ``x.unexplained`` what is left of u_i.

    Parameters
    ----------
    x
        State.
    factor
        (p, p) scratch: the Cholesky factor of M, lower triangular; a regressor that the others make up counts nothing.
    """
    p = factor.shape[0]
    for i in range(p):
        for k in range(i + 1):
            total = x.moment[i, k]
            for n in range(k):
                total -= factor[i, n] * factor[k, n]
            if k < i:
                factor[i, k] = total * factor[k, k]
            else:  # the inverse of the pivot
                factor[i, i] = 1.0 / math.sqrt(total) if total > REDUNDANT * x.moment[i, i] else 0.0
    for j in range(x.quick.shape[0]):
        w = x.late[j]
        left = x.quick_power[j]
        for i in range(p):
            total = x.quick_moment[j, i]
            for k in range(i):
                total -= factor[i, k] * w[k]
            w[i] = total * factor[i, i]
            left -= w[i] * w[i]
        for i in range(p - 1, -1, -1):
            total = w[i]
            for k in range(i + 1, p):
                total -= factor[k, i] * w[k]
            w[i] = total * factor[i, i]
        x.unexplained[j] = left if left > APART * x.quick_power[j] else 0.0


@compiled
def find_lag_bias(x: BankState, q: int, variance: float) -> None:
    """Find what row q's estimates may be off by because outputs and effectors are not in step: ``x.lag_bias``.

    Parameters
    ----------
    x
        State, after `regress_steps`.
    q
        Row.
    variance
        Of the row's prediction errors.
    """
    bias = x.lag_bias[q]
    for i in range(bias.shape[0]):
        bias[i] = 0.0
    for j in range(x.quick.shape[0]):
        left = x.unexplained[j]
        if left <= 0.0:
            continue
        c = x.cross[q, j] / left
        certain = c * c - BY_CHANCE * variance / left
        if certain <= 0.0:
            continue
        c = math.copysign(math.sqrt(certain), c)
        for i in range(bias.shape[0]):
            bias[i] += c * x.late[j, i]
