"""Statistics of the residuals: their variance under each autocorrelation, and which autocorrelation they have.

The kernel propagates the error covariance for residuals that are AR(1) with each of a few coefficients, and with it
predicts, in units of the residual variance, the variance ``s_k`` of each prediction error and its covariance ``l_k``
with the one before. With exponential weights f this file sums, per row and colour::

    residual  = sum f^(n-k) e_k^2 / s_k                     over its weight: the variance of the residual
    colour[0] = sum f^(n-k) e_k^2 / s_k                     the same over a longer memory
    colour[1] = sum f^(n-k) e_k e_(k-1) / sqrt(s_k s_(k-1)) measured product of successive prediction errors
    colour[2] = sum f^(n-k) l_k         / sqrt(s_k s_(k-1)) predicted one

The autocorrelation is the coefficient for which the last two agree.

**Bursts.** Where the estimates remember longer than the variance of the residual, a burst of wrong samples stays in the
estimates when it is gone from the variance. With what the gains K have made of it since, by Cauchy and Schwarz::

    |bias_i| = |sum_burst (Psi K_k)_i v_k|  <=  sqrt(sum_burst lambda^(2(n-k)) v_k^2) sqrt(P_ii),    v^2 = e^2/s

so the squared residuals of bursts, forgotten as the estimates forget them, are added to the variance.
"""

from __future__ import annotations

import math

from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array, Work, propagate_covariance
from msls_ros.estimation.soundness import FAR
from msls_ros.estimation.state import Settings, State

LASTING = 0.999
"""Forgetting factor from which a burst is remembered much longer than the variance of the residual [1]."""
UNLIKELY = 25.0
"""Squared residual over its variance that is one of a burst, there [1]."""
SETTLED = 10.0
"""Samples of the residual's variance before that."""


@compiled
def propagate_autocorrelated(s: Settings, x: State, g: int, phi: Array, work: Work) -> None:
    """Propagate the error covariance of group g under each autocorrelation; ``work.variance`` and ``work.lag`` follow.

    Parameters
    ----------
    s, x
        Settings and state.
    g
        Group.
    phi
        (p,) regressor.
    work
        Scratch, holding the gain; its predicted variances and lags, (m,), are written.
    """
    for m in range(s.colours.shape[0]):
        work.variance[m], work.lag[m], x.b[g, m] = propagate_covariance(
            x.P[g, m], x.c[g, m], x.u[g, m], x.b[g, m], s.colours[m], phi, work.K, work.g
        )


@compiled
def observe_residual(s: Settings, x: State, q: int, g: int, e: float, variance: Array, lag: Array) -> None:
    """Update the residual variance of row q under each autocorrelation, and the statistics that select one.

    ``colour`` compares the measured product of successive prediction errors with the one each autocorrelation predicts.
    """
    if x.age[g] <= x.theta.shape[1]:
        return
    f = s.residual_forgetting
    x.weight[q, 0] = f * x.weight[q, 0] + 1.0
    for m in range(variance.shape[0]):
        x.residual[q, m] = f * x.residual[q, m] + (e * e / variance[m] if variance[m] > 0.0 else 0.0)
    if variance.shape[0] == 1 or math.isnan(x.e[q]):
        return
    f = s.colour_forgetting
    x.weight[q, 1] = f * x.weight[q, 1] + 1.0
    for m in range(variance.shape[0]):
        norm = math.sqrt(variance[m]) * x.last[g, m]
        if norm > 0.0:
            x.colour[q, m, 0] = f * x.colour[q, m, 0] + e * e / variance[m]
            x.colour[q, m, 1] = f * x.colour[q, m, 1] + e * x.e[q] / norm
            x.colour[q, m, 2] = f * x.colour[q, m, 2] + lag[m] / norm


@compiled
def remember_burst(s: Settings, x: State, q: int, g: int, e: float, variance: float) -> None:
    """Add a residual of row q to those of bursts, where it is one; forget them as the estimates do.

    It is one beyond what aircraft do, and, where the estimates hardly forget, beyond its own variance.
    """
    kept = s.forgetting * s.forgetting * x.burst[q]
    if x.age[g] > x.theta.shape[1]:
        square = e * e / variance if variance > 0.0 else 0.0
        far = square > FAR * FAR
        if s.forgetting >= LASTING and x.weight[q, 0] >= SETTLED:
            far = far or square > UNLIKELY * x.residual[q, 0] / x.weight[q, 0]
        if far:
            kept += square
    x.burst[q] = kept if kept > 1e-30 else 0.0


@compiled
def autocorrelation_weights(x: State, q: int, weights: Array) -> None:
    """Say how much each residual autocorrelation counts for row q: (m,) out, sum 1, at most two neighbours nonzero."""
    m = weights.shape[0]
    for i in range(m):
        weights[i] = 0.0
    total = x.weight[q, 1]
    before = 0.0
    for i in range(m if total > 0.0 else 0):
        square = x.colour[q, i, 0]
        difference = (x.colour[q, i, 1] / square if square > 0.0 else 0.0) - x.colour[q, i, 2] / total
        if difference <= 0.0:
            share = before / (before - difference) if i > 0 else 1.0
            weights[i] = share
            if i > 0:
                weights[i - 1] = 1.0 - share
            return
        before = difference
    weights[m - 1 if total > 0.0 else 0] = 1.0


@compiled
def residual_variances(x: State, q: int, variances: Array) -> None:
    """Variance of row q's residual under each autocorrelation: (m,) out [output^2]; NaN before there is any data.

    Autocorrelated residuals hold fewer independent values: their variance is taken over the longer memory.
    """
    short = x.weight[q, 0]
    long = x.weight[q, 1]
    for m in range(variances.shape[0]):
        if m > 0 and long > 0.0:
            variances[m] = x.colour[q, m, 0] / long
        else:
            variances[m] = x.residual[q, m] / short if short > 0.0 else math.nan


@compiled
def noise_errors(x: State, q: int, weights: Array, variances: Array, errors: Array) -> float:
    """Fill in the standard errors of row q's estimates by residuals that know nothing of the regressors.

    Parameters
    ----------
    x
        The loop's state.
    q
        Identified row.
    weights, variances
        (m,) out: see `autocorrelation_weights` and `residual_variances`.
    errors
        (p,) out; infinite before there is any data.

    Returns
    -------
    float
        Standard deviation of the residual [output]; NaN before there is any data.
    """
    autocorrelation_weights(x, q, weights)
    residual_variances(x, q, variances)
    mean = 0.0
    for m in range(weights.shape[0]):
        if weights[m] > 0.0:
            mean += weights[m] * variances[m]
    g = x.group[q]
    for i in range(errors.shape[0]):
        square = 0.0
        for m in range(weights.shape[0]):
            if weights[m] > 0.0:
                square += weights[m] * (variances[m] + x.burst[q]) * x.P[g, m, i, i]
        errors[i] = 0.0 if square < 0.0 else math.sqrt(square)
        if x.weight[q, 0] <= 0.0:
            errors[i] = math.inf
    return math.sqrt(mean)
