"""Least squares whose regressors have white noise and whose residuals are correlated, with standard errors.

What noise of known variance adds to the squares of the regressors is taken off (errors in variables), half of a square
at most. Residuals of overlapping windows, and of what filters leave, are correlated; the covariance holds for any
correlation up to a lag, with Bartlett's weights::

    theta = (X'X - N)^-1 X'y,      C = (X'X - N)^-1  sum_l w_l sum_k s_k s_(k-l)'  (X'X - N)^-1,      s_k = x_k e_k

References
----------
Newey and West, "A simple, positive semi-definite, heteroskedasticity and autocorrelation consistent covariance matrix",
Econometrica 55 (1987). Söderström, "Errors-in-variables methods in system identification", Automatica 43 (2007).
"""

from __future__ import annotations

import numpy as np

from msls_ros.estimation.kernel import Array

_PART = 0.5
"""Share of the square of a regressor that is taken for noise, at most."""
_LEAST = 1e-12
"""Variance of a coefficient, at least."""


def regress(x: Array, y: Array, noise: Array, lags: int) -> tuple[Array, Array]:
    """Return coefficients (c,) and their variances (c,); both sides are taken from their means.

    Parameters
    ----------
    x
        (k, c) regressors.
    y
        (k,)
    noise
        (c,) variance of the noise of each regressor.
    lags
        Rows up to which residuals are correlated.
    """
    x, y = x - x.mean(axis=0), y - y.mean()
    gram = x.T @ x
    gram -= np.diag(np.minimum(len(x) * noise, _PART * np.diag(gram)))
    inverse = np.linalg.pinv(gram, rcond=1e-10, hermitian=True)
    weights = inverse @ x.T @ y
    scores = x * (y - x @ weights)[:, None]
    total = scores.T @ scores
    for lag in range(1, lags + 1):
        product = scores[lag:].T @ scores[:-lag]
        total += (1.0 - lag / (lags + 1)) * (product + product.T)
    return weights, np.maximum(np.diag(inverse @ total @ inverse), _LEAST)
