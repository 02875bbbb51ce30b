"""Error bars of the bank: what the members know, what their residuals are like, and how far they disagree.

Per coefficient, with the members' shares W and informations I (`bank_mixing`)::

    se_i^2 = s^2 c / sum W_m I_mi  +  sum W_m I_mi (theta_mi - theta_i)^2 / sum W_m I_mi

The first term is covariance intersection times the variance of the residual; the second the spread between members, the
uncertainty about the model itself. ``s^2`` is the mean of the members' squared prediction errors over 1 + d,
weighted like the evidence: bars that were earned in a manoeuvre keep the residual of the manoeuvre through the quiet after it. ``c``
corrects for colour, ``(1 + rho)/(1 - rho)`` of the prediction errors' lag-1 autocorrelation, and for the degrees of
freedom that the parameters have taken, ``n/(n - p)``. Variance and colour are carried over an alarm; the number of
samples is not: nothing is claimed before ``2p`` samples.

References
----------
Bates and Granger, "The combination of forecasts", 1969; Buckland, Burnham and Augustin, "Model selection: an integral
part of inference", Biometrics 53 (1997) (spread between models). Grauer and Morelli, "Parameter uncertainty for
aircraft parameter estimates using recursive least squares", 2016 (coloured residuals).
"""

from __future__ import annotations

import math

from msls_ros.estimation.bank_mixing import sum_members
from msls_ros.estimation.bank_state import BankSettings, BankState
from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array

LARGEST_COLOUR = 0.98
"""The autocorrelation is not taken for more: the memory holds no more independent stretches."""


@compiled
def observe_errors(s: BankSettings, x: BankState, q: int, products: Array) -> None:
    """Update variance and colour of row q's normalised prediction errors; both are carried over an alarm.

    Parameters
    ----------
    s, x
        Settings and state; the members have taken the sample.
    q
        Row.
    products
        (m,) scratch.
    """
    deviation = x.deviation[x.group[q]]
    for m in range(products.shape[0]):
        products[m] = x.weight[q, m] * x.errors[q, m] * deviation[m]
    error = sum_members(products)
    for m in range(products.shape[0]):
        products[m] *= x.errors[q, m] * deviation[m]
    square = sum_members(products)
    if x.age[x.group[q]] > x.mixed.shape[1]:
        weight = max(x.gate[q], s.quiet)
        fade = 1.0 - (1.0 - s.residual_forgetting) * weight
        x.residual[q, 0] = fade * x.residual[q, 0] + weight * square
        x.residual[q, 1] = fade * x.residual[q, 1] + weight
        if not math.isnan(x.e[q]):
            fade = 1.0 - (1.0 - s.colour_forgetting) * weight
            x.colour[q, 0] = fade * x.colour[q, 0] + weight * error * x.e[q]
            x.colour[q, 1] = fade * x.colour[q, 1] + weight * error * error
    x.e[q] = error


@compiled
def long_run_factor(x: BankState, q: int) -> float:
    """Return by how much colour multiplies the variance of a mean of row q's residuals [1]."""
    if x.colour[q, 1] <= 0.0:
        return 1.0
    rho = min(max(x.colour[q, 0] / x.colour[q, 1], 0.0), LARGEST_COLOUR)
    return (1.0 + rho) / (1.0 - rho)


@compiled
def bank_errors(x: BankState, q: int, products: Array, errors: Array) -> float:
    """Fill in the standard errors of row q's estimates.

    Parameters
    ----------
    x
        State.
    q
        Identified row.
    products
        (m,) scratch.
    errors
        (p,) out, constant last; infinite before anything can be known.

    Returns
    -------
    float
        Standard deviation of the residual [output]; NaN before there is any data.
    """
    p = errors.shape[0]
    age = x.age[x.group[q]]
    if x.residual[q, 1] <= 0.0 or age <= 2 * p:
        for i in range(p):
            errors[i] = math.inf
        return math.nan if x.residual[q, 1] <= 0.0 else math.sqrt(x.residual[q, 0] / x.residual[q, 1])
    square = x.residual[q, 0] / x.residual[q, 1]
    factor = square * long_run_factor(x, q) * age / (age - p)
    for i in range(p):
        info = x.info[x.group[q], i]
        theta = x.members[q, i]
        for m in range(products.shape[0]):
            products[m] = x.weight[q, m] * info[m]
        total = sum_members(products)
        for m in range(products.shape[0]):
            difference = theta[m] - x.mixed[q, i]
            products[m] *= difference * difference
        errors[(i + p - 1) % p] = math.sqrt((factor + sum_members(products)) / total)
    return math.sqrt(square)
