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

import numpy as np

from msls_ros.estimation.kernel import Array
from msls_ros.estimation.state import State


def colour_weights(state: State, row: int) -> Array:
    """Return how much each residual colour counts for a row: (m,), sum 1, at most two neighbours nonzero.

    Parameters
    ----------
    state
        The loop's state.
    row
        Identified row.
    """
    m = state.residual.shape[1]
    weights = np.zeros(m)
    total = state.weight[row, 1]
    weights[0] = 1.0
    if m == 1 or total <= 0.0:
        return weights
    before = 0.0
    for i in range(m):
        square, product, predicted = state.colour[row, i]
        difference = (product / square if square > 0.0 else 0.0) - predicted / total
        if difference <= 0.0:
            if i > 0:
                share = before / (before - difference)
                weights[0] = 0.0
                weights[i] = share
                weights[i - 1] = 1.0 - share
            return weights
        before = difference
    weights[0] = 0.0
    weights[m - 1] = 1.0
    return weights


def residual_variances(state: State, row: int) -> Array:
    """Variance of a row's residual under each colour: (m,) [output^2]; NaN before there is any data.

    Coloured residuals repeat themselves: their variance is taken over the longer memory of the colour.
    """
    short, long = state.weight[row]
    variances = state.residual[row] / short if short > 0.0 else np.full(state.residual.shape[1], math.nan)
    if long > 0.0:
        variances[1:] = state.colour[row, 1:, 0] / long
    result: Array = variances
    return result


def residual_deviation(state: State, row: int) -> float:
    """Standard deviation of a row's residual [output]; NaN before there is any data."""
    return math.sqrt(_mean(colour_weights(state, row), residual_variances(state, row)))


def standard_errors(state: State, row: int) -> Array:
    """Standard errors of a row's estimates: (p,), infinite before there is any data.

    Parameters
    ----------
    state
        The loop's state.
    row
        Identified row.
    """
    p = state.theta.shape[1]
    if state.weight[row, 0] <= 0.0:
        return np.full(p, math.inf)
    group = state.group[row]
    variance = np.zeros(p)
    variances = residual_variances(state, row)
    for i, share in enumerate(colour_weights(state, row)):
        if share > 0.0:
            variance += share * variances[i] * np.diagonal(state.P[group, i])
    errors: Array = np.sqrt(np.maximum(variance, 0.0))
    return errors


def _mean(weights: Array, values: Array) -> float:
    """Weighted mean with plain sums; a value without weight does not count."""
    total = 0.0
    for weight, value in zip(weights.tolist(), values.tolist(), strict=True):
        if weight > 0.0:
            total += weight * value
    return total
