"""Statistics of the residuals: their variance under each colour, and what tells the colours apart.

The kernel propagates the error covariance for residuals that are AR(1) with each of a few coefficients, and with it
predicts, in units of the residual variance, the variance ``s_k`` of each prediction error and its covariance ``l_k``
with the one before. With exponential weights f this file sums, per row and colour::

    residual  = sum f^(n-k) e_k^2 / s_k                     over its weight: the variance of the residual
    colour[0] = sum f^(n-k) e_k^2 / s_k                     the same over a longer memory
    colour[1] = sum f^(n-k) e_k e_(k-1) / sqrt(s_k s_(k-1)) measured product of successive prediction errors
    colour[2] = sum f^(n-k) l_k         / sqrt(s_k s_(k-1)) predicted one

`uncertainty` compares the last two to find the colour.
"""

from __future__ import annotations

import math

from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array, Work, propagate_covariance
from msls_ros.estimation.state import Settings, State


@compiled
def propagate_colours(s: Settings, x: State, g: int, phi: Array, work: Work) -> None:
    """Propagate the error covariance of group g under each colour; ``work.variance`` and ``work.lag`` follow.

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
    """Update the residual variance of row q under each colour, and what tells the colours apart.

    ``colour`` compares the measured product of successive prediction errors with the one each colour predicts.
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
