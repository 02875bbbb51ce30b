"""Error bars and reliability from the propagated covariance, for white and for coloured residuals.

The kernel propagates the parameter covariance of the gains actually used for residuals that are AR(1) with each of a
few coefficients (`COLOURS`). Prediction errors of a fast-forgetting estimator are whiter than the residuals behind
them, so their own autocorrelation says little; instead the measured product of successive prediction errors is compared
with the one that each coefficient predicts, and the error bars are interpolated between the two coefficients that
bracket it.

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
from msls_ros.estimation.state import State


@compiled
def colour_weights(x: State, q: int, weights: Array) -> None:
    """Say how much each residual colour counts for row q: (m,) out, sum 1, at most two neighbours nonzero."""
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
    """Variance of row q's residual under each colour: (m,) out [output^2]; NaN before there is any data.

    Coloured residuals repeat themselves: their variance is taken over the longer memory of the colour.
    """
    short = x.weight[q, 0]
    long = x.weight[q, 1]
    for m in range(variances.shape[0]):
        if m > 0 and long > 0.0:
            variances[m] = x.colour[q, m, 0] / long
        else:
            variances[m] = x.residual[q, m] / short if short > 0.0 else math.nan


@compiled
def error_bars(x: State, q: int, weights: Array, variances: Array, errors: Array) -> float:
    """Fill in the standard errors of row q's estimates; return the standard deviation of its residual.

    Parameters
    ----------
    x
        The loop's state.
    q
        Identified row.
    weights, variances
        (m,) out: see `colour_weights` and `residual_variances`.
    errors
        (p,) out; infinite before there is any data.

    Returns
    -------
    float
        [output]; NaN before there is any data.
    """
    colour_weights(x, q, weights)
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
                square += weights[m] * variances[m] * x.P[g, m, i, i]
        errors[i] = 0.0 if square < 0.0 else math.sqrt(square)
        if x.weight[q, 0] <= 0.0:
            errors[i] = math.inf
    return math.sqrt(mean)


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


def row_uncertainty(state: State, row: int) -> RowUncertainty:
    """Return the uncertainty of one row's estimates and of its residual, as `error_bars`."""
    p, m = state.theta.shape[1], state.residual.shape[1]
    weights, variances, errors = np.empty(m), np.empty(m), np.empty(p)
    residual = error_bars(state, row, weights, variances, errors)
    return RowUncertainty(weights, variances, errors, residual)
