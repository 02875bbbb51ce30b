"""What biases the estimates unseen: a reference model with a longer memory, and the lag-one covariance of its errors.

Gusts are correlated with the regressors: they move the states and their derivatives together. An estimator of short
memory fits them, with small residuals and wrong numbers. One of longer memory cannot fit them, and because gusts are
autocorrelated, the product of successive prediction errors of such a reference model shows them; white sensor noise
gives products of mean zero::

    K        = gain of least squares with forgetting and the penalty of eq 14, on a factor of its own
    e_k      = y_k - phi_k' theta_r,    theta_r += K e_k
    lag_one   = weighted mean of e_k e_(k-1)
    deviation = weighted mean of (theta - theta_r)^2 / se^2, over rows and states

A large lag-one covariance may be gusts (see `gusts`), nonlinearity of the aircraft, or autocorrelated noise that is
independent of the states; with the last the estimates deviate from the reference by their standard errors only.
`uncertainty` says what follows. Rows that start or recover from an alarm copy their estimates to the reference.
"""

from __future__ import annotations

import math

from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array, Work, rotate_in
from msls_ros.estimation.residuals import noise_errors
from msls_ros.estimation.state import Settings, State

STILL, MOVING = 0.05, 0.15
"""Share of the motion that is the air's: below the first it counts as still, above the second as moving."""

LINEAR, NONLINEAR = 0.5, 1.5
"""Squared parameter deviation, in variances: below the first that of noise, above the second that of nonlinearity."""

NONLINEAR_SHARE = 0.3
"""Nonlinearity correlates with the regressors by this share of the correlation that gusts may have, ..."""

NONLINEAR_SAMPLES = 50.0
"""... over this many samples, in which the tangent changes with the manoeuvre."""

FAR = 25.0
"""A squared deviation counts for no more than this in the mean."""


@compiled
def follow_reference(s: Settings, x: State, phi: Array, y: Array, w0: Array, work: Work) -> None:
    """Update the reference model and the lag-one covariance of its prediction errors.

    Each sample brings one penalty row, for one regressor after the other and as large as p of them: on average the
    penalty of eq 14, at the price of one more rotation.

    Parameters
    ----------
    s, x
        Settings and state.
    phi, y
        (p,) regressor and (r,) outputs.
    w0
        (p,) penalties W0, in units of the regressors.
    work
        Scratch.
    """
    p = phi.shape[0]
    turn = x.samples[0] % p
    for i in range(p):
        work.phi[i] = 0.0
    work.phi[turn] = w0[turn] * math.sqrt(p)
    rotate_in(x.reference, work.phi, work.z, math.sqrt(s.reference_forgetting))
    for i in range(p):
        work.phi[i] = phi[i]
    rotate_in(x.reference, work.phi, work.z, 1.0)
    substitute_back(x.reference, work.z, work.K)
    for q in range(y.shape[0]):
        theta = x.reference_theta[q]
        if x.age[x.group[q]] < 4 * p:
            for i in range(p):
                theta[i] = x.theta[q, i]
            x.reference_last[q] = math.nan
            continue
        e = y[q]
        for i in range(p):
            e -= theta[i] * phi[i]
        for i in range(p):
            theta[i] += work.K[i] * e
        if not math.isnan(x.reference_last[q]):
            x.lag_one[q, 0] = s.reference_forgetting * x.lag_one[q, 0] + e * x.reference_last[q]
            x.lag_one[q, 1] = s.reference_forgetting * x.lag_one[q, 1] + 1.0
        x.reference_last[q] = e
        if turn == 0:
            observe_deviation(s, x, q, work)


@compiled
def observe_deviation(s: Settings, x: State, q: int, work: Work) -> None:
    """Take in row q's deviations from the reference, in units of their standard errors; at every p-th sample."""
    noise_errors(x, q, work.variance, work.lag, work.g)
    total = 0.0
    for i in range(s.effectors_from):
        difference = x.theta[q, i] - x.reference_theta[q, i]
        square = difference * difference
        variance = work.g[i] * work.g[i]
        total += square / variance if square < FAR * variance else FAR
    x.deviation[0] = s.deviation_forgetting * x.deviation[0] + total / s.effectors_from
    x.deviation[1] = s.deviation_forgetting * x.deviation[1] + 1.0


@compiled
def substitute_back(R: Array, z: Array, K: Array) -> None:
    """Solve ``R K = z`` (eq 9) for an upper triangular R, (p, p), by rows; an empty pivot gets zero."""
    p = K.shape[0]
    for j in range(p - 1, -1, -1):
        total = z[j]
        for k in range(j + 1, p):
            total -= R[j, k] * K[k]
        K[j] = total / R[j, j] if R[j, j] > 0.0 else 0.0


@compiled
def moving_air(x: State) -> float:
    """How far the air counts as moving, 0 to 1."""
    return float(min(max((x.air[0] - STILL) / (MOVING - STILL), 0.0), 1.0))


@compiled
def nonlinearity(x: State) -> float:
    """How far the aircraft counts as nonlinear over the memory of the estimator, 0 to 1."""
    if x.deviation[1] <= 0.0:
        return 0.0
    return float(min(max((x.deviation[0] / x.deviation[1] - LINEAR) / (NONLINEAR - LINEAR), 0.0), 1.0))


@compiled
def lag_one_variance(s: Settings, x: State, q: int) -> float:
    """Squared bias that residuals correlated with the regressors may cause in row q, per unit of white covariance.

    The lag-one covariance, as far as gusts or nonlinearity explain it, times the samples in the estimator's memory.

    Returns
    -------
    float
        [output^2]; 0 where the lag-one covariance is not positive.
    """
    if x.lag_one[q, 1] <= 0.0 or x.lag_one[q, 0] <= 0.0:
        return 0.0
    samples = float(x.age[x.group[q]])
    if s.horizon < samples:
        samples = float(s.horizon)
    times = max(
        moving_air(x) * samples, NONLINEAR_SHARE * NONLINEAR_SHARE * nonlinearity(x) * min(samples, NONLINEAR_SAMPLES)
    )
    return float(times * x.lag_one[q, 0] / x.lag_one[q, 1])
