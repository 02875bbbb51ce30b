"""What may hide behind the estimates: a reference model with a longer memory, and the lasting part of its errors.

Gusts and the turning of the air are no noise: they move the states and their derivatives together. A fast-forgetting
estimator takes them up, with small errors and wrong numbers, and its residuals look innocent. Over a longer memory they
cannot be taken up, and because they last, successive prediction errors of a reference model show them; white noise of
sensors gives products of mean zero::

    K        = gain of least squares with forgetting and the penalty of eq 14, on a factor of its own
    e_k      = y_k - phi_k' theta_r,    theta_r += K e_k
    lasting  = weighted mean of e_k e_(k-1)
    straying = weighted mean of (theta - theta_r)^2 / se^2, over rows and states

What lasts may be the air (`gusts` tells), a model that bends, or noise that knows nothing of the states; with the last
the estimates stray from the reference by their standard errors only. `uncertainty` says what follows. Rows that start
or recover from an alarm lend the reference their estimates.
"""

from __future__ import annotations

import math

from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array, Work, rotate_in
from msls_ros.estimation.residuals import noise_errors
from msls_ros.estimation.state import Settings, State

STILL, MOVING = 0.05, 0.15
"""Share of the motion that is the air's: below the first it counts as still, above the second as moving."""

STRAIGHT, BENT = 0.5, 1.5
"""Straying below the first is that of noise, above the second that of a model that bends."""

BENDING = 0.3
"""What a bent model hides moves with the regressors by this share of the correlation that gusts may have, ..."""

WANDERING = 50.0
"""... for this many samples: the manoeuvre goes on, and the tangent with it."""

FAR = 25.0
"""A squared deviation counts for no more than this in straying."""


@compiled
def follow_reference(s: Settings, x: State, phi: Array, y: Array, w0: Array, work: Work) -> None:
    """Update the reference model and the lasting part of its prediction errors.

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
            x.lasting[q, 0] = s.reference_forgetting * x.lasting[q, 0] + e * x.reference_last[q]
            x.lasting[q, 1] = s.reference_forgetting * x.lasting[q, 1] + 1.0
        x.reference_last[q] = e
        if turn == 0:
            observe_straying(s, x, q, work)


@compiled
def observe_straying(s: Settings, x: State, q: int, work: Work) -> None:
    """Take in row q's deviations from the reference, in units of their standard errors; at every p-th sample."""
    noise_errors(x, q, work.variance, work.lag, work.g)
    total = 0.0
    for i in range(s.effectors_from):
        difference = x.theta[q, i] - x.reference_theta[q, i]
        square = difference * difference
        variance = work.g[i] * work.g[i]
        total += square / variance if square < FAR * variance else FAR
    x.straying[0] = s.straying_forgetting * x.straying[0] + total / s.effectors_from
    x.straying[1] = s.straying_forgetting * x.straying[1] + 1.0


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
def bent_model(x: State) -> float:
    """How far the model counts as bent, 0 to 1."""
    if x.straying[1] <= 0.0:
        return 0.0
    return float(min(max((x.straying[0] / x.straying[1] - STRAIGHT) / (BENT - STRAIGHT), 0.0), 1.0))


@compiled
def lasting_variance(s: Settings, x: State, q: int) -> float:
    """Squared bias that what moves with the regressors may cause in row q, per unit of white covariance.

    The lasting part of the residual, as far as air or bending make it, times the samples that the estimate looks back.

    Returns
    -------
    float
        [output^2]; 0 where nothing lasts.
    """
    if x.lasting[q, 1] <= 0.0 or x.lasting[q, 0] <= 0.0:
        return 0.0
    samples = float(x.age[x.group[q]])
    if s.horizon < samples:
        samples = float(s.horizon)
    times = max(moving_air(x) * samples, BENDING * BENDING * bent_model(x) * min(samples, WANDERING))
    return float(times * x.lasting[q, 0] / x.lasting[q, 1])
