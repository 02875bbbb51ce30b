"""Whether the outputs answer the regressors of now, or those of a sample ago.

A response that is recorded late, or a deflection that is recorded early, makes estimates too small where the input
moves from sample to sample, as dither does: the prediction errors look white, and no error bar shows it. But a right
model leaves nothing in its errors e that past inputs explain. With h the regressor above its mean of the last tenth of
a second, and means with a memory of seconds::

    lag_qi = mean e_q(k) h_i(k-1) / mean h_i^2        beyond what chance makes of it
    b_qi   = lag_qi / (1 + rho_i) * min(mean h_i^2 / I_i, 1)

``rho`` is the autocorrelation of h, and I the information about the coefficient per sample: the last factor is the
share of it that is so quick, for slow inputs hardly see a delay. b is what the estimate would change by if the errors
were regressed on the present and the last input, and so what it may be off by.

References
----------
Ljung, *System Identification*, 2nd ed., section 16.6 (residuals against past inputs).
"""

from __future__ import annotations

from msls_ros.estimation.bank_state import BankSettings, BankState
from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array

BY_CHANCE = 4.0
"""Squared standard errors that a correlation may have by chance."""
OPPOSITE = -0.5
"""Least autocorrelation of the inputs that counts."""


@compiled
def observe_inputs(s: BankSettings, x: BankState, phi: Array) -> None:
    """Update how quickly the regressors move: (p,), constant first."""
    start = 1.0 / (x.samples[0] + 1.0)
    for i in range(1, phi.shape[0]):
        x.quick_mean[i] += max(start, s.quick) * (phi[i] - x.quick_mean[i])
        last = x.quick[i, 0]
        now = phi[i] - x.quick_mean[i]
        x.quick[i, 1] = last
        x.quick[i, 0] = now
        x.quick_power[i, 0] = s.colour_forgetting * x.quick_power[i, 0] + now * now
        x.quick_power[i, 1] = s.colour_forgetting * x.quick_power[i, 1] + now * last
        x.quick_power[i, 2] = s.colour_forgetting * x.quick_power[i, 2] + 1.0


@compiled
def observe_lag(s: BankSettings, x: BankState, q: int, error: float) -> None:
    """Update what row q's prediction errors have in common with the last regressors."""
    for i in range(1, x.quick.shape[0]):
        x.cross[q, i] = s.colour_forgetting * x.cross[q, i] + error * x.quick[i, 1]


@compiled
def lag_square(s: BankSettings, x: BankState, q: int, i: int, variance: float) -> float:
    """Square of what coefficient i (constant first) of row q may be off by because outputs and inputs are not in step.

    Parameters
    ----------
    s, x
        Settings and state.
    q, i
        Row and regressor.
    variance
        Of the row's prediction errors.
    """
    power = x.quick_power[i, 0]
    if power <= 0.0:
        return 0.0
    lag = x.cross[q, i] / power
    square = lag * lag - BY_CHANCE * variance / power
    if square <= 0.0:
        return 0.0
    g = x.group[q]
    information = x.info[g, i, s.recent] / max(x.taken[g, s.recent], 1.0)
    share = min(power / x.quick_power[i, 2] / information, 1.0) / (1.0 + max(x.quick_power[i, 1] / power, OPPOSITE))
    return float(square * share * share)
