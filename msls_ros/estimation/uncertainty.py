"""Error bars from the propagated covariance: white and autocorrelated residuals, and residuals that follow regressors.

The kernel propagates the parameter covariance of the gains actually used for residuals that are AR(1) with each of a
few coefficients (`COLOURS`). Prediction errors of a fast-forgetting estimator are whiter than the residuals behind
them, so their own autocorrelation says little; instead the measured product of successive prediction errors is compared
with the one that each coefficient predicts, and the error bars are interpolated between the two coefficients that
bracket it (`residuals`).

That holds for residuals independent of the regressors. Gusts are not: they move states and accelerations together, and
bias the estimates. A residual ``v`` correlated with the regressors adds up over the N samples in the estimator's
memory instead of averaging out. By Cauchy and Schwarz, ``P`` being the covariance for white residuals::

    |bias_i| = |sum_k (Psi_nk K_k)_i v_k|  <=  rho sqrt(N) sigma_v sqrt(P_ii),    N = (1 + lambda)/(1 - lambda)

``sigma_v`` is from the lag-one covariance of the residuals of a reference model (`reference`): the estimator's own
residuals are orthogonal to the regressors by construction. ``rho``, for states and for effectors, is a parameter; 1 is
the worst that can be. In gusts (see `gusts`) the error bar is the larger of the two; where the aircraft is nonlinear
over the memory (a strong manoeuvre) rho counts for a part.

References
----------
Grauer and Morelli, "Parameter Uncertainty for Aircraft Parameter Estimates using Recursive Least Squares", AIAA
Atmospheric Flight Mechanics Conference, 2016 (the correction for coloured residuals of a growing-memory estimate).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array
from msls_ros.estimation.reference import lag_one_variance
from msls_ros.estimation.residuals import noise_errors
from msls_ros.estimation.state import Settings, State


@compiled
def error_bars(s: Settings, x: State, q: int, weights: Array, variances: Array, errors: Array) -> float:
    """Fill in the standard errors of row q's estimates; return the standard deviation of its residual.

    Parameters
    ----------
    s, x
        The loop's settings and state.
    q
        Identified row.
    weights, variances
        (m,) out: how much each colour counts, and the residual variance under it [output^2].
    errors
        (p,) out; infinite before there is any data.

    Returns
    -------
    float
        [output]; NaN before there is any data.
    """
    residual = noise_errors(x, q, weights, variances, errors)
    if s.confounded:
        variance = lag_one_variance(s, x, q)
        g = x.group[q]
        for i in range(errors.shape[0]):
            bias = s.confounding[i] * variance * x.P[g, 0, i, i]
            if bias > errors[i] * errors[i]:
                errors[i] = math.sqrt(bias)
    return residual


class RowUncertainty(NamedTuple):
    """What `error_bars` finds for one row; p regressors, m colours."""

    weights: Array
    """(m,) how much each colour counts."""
    variances: Array
    """(m,) residual variance under each colour [output^2]."""
    errors: Array
    """(p,) standard errors of the estimates."""
    residual: float
    """Standard deviation of the residual [output]."""


def row_uncertainty(settings: Settings, state: State, row: int) -> RowUncertainty:
    """Return the uncertainty of one row's estimates and of its residual, as `error_bars`."""
    p, m = state.theta.shape[1], state.residual.shape[1]
    weights, variances, errors = np.empty(m), np.empty(m), np.empty(p)
    residual = error_bars(settings, state, row, weights, variances, errors)
    return RowUncertainty(weights, variances, errors, residual)
