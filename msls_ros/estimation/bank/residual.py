"""Variance and autocorrelation of the members' one-step prediction errors: what all error bars are in units of.

Each member's errors are in units of its own prediction's deviation, ``e / sqrt(1 + d)``: to one whose constant walks
quickly nearly all of white noise is that walk, and a twelfth of it is left for noise. So what is averaged over time is
each member's own square, and then over the members by their shares of now, whose information the variance is divided
by. With the mean over time of the shares' mean, a V-tail of 14 kg (50 Hz, not one of ours, dither, .2 m/s of noise in
velocities) had a residual of .019 m/s^2 after 2.1 s, of .1: members without a walk had just been believed. Of what was
called reliable of A one to four seconds after the start .88 were covered, median |z| .74 (57 flights); .95 and .55 with
this. False alarms of six other aircraft (216 flights, seeds 1 and 2) 8 -> 6, b43 of the F-16 before its loss, medium
noise, seeds 100 to 119, 10.6 -> 7.4 %, half stabilators that are named 13 -> 15.
"""

from __future__ import annotations

import math

from msls_ros.estimation.bank.lags import observe_lag
from msls_ros.estimation.bank.loop_settings import BankSettings
from msls_ros.estimation.bank.mixing import sum_members
from msls_ros.estimation.bank.state import BankState
from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array

LARGEST_COLOUR = 0.98
"""The autocorrelation is not taken for more: the memory holds no more independent stretches."""


@compiled
def observe_errors(s: BankSettings, x: BankState, q: int, e: Array) -> None:
    """Update variance and colour of row q's normalised prediction errors; both are carried over an alarm.

    Parameters
    ----------
    s, x
        Settings and state; the members have taken the sample.
    q
        Row.
    e
        (m,) scratch.
    """
    deviation = x.deviation[x.group[q]]
    for m in range(e.shape[0]):
        e[m] = x.weight[q, m] * x.errors[q, m] * deviation[m]
    error = sum_members(e)
    age, p = x.age[x.group[q]], x.mixed.shape[1]
    begun = age - (2 * p if x.samples[0] < age + 1 else p)
    if begun > 0:
        weight = max(x.gate[q], s.quiet)
        fade = 1.0 - (1.0 - s.residual_forgetting) * weight
        squares = x.squares[q]
        for m in range(e.shape[0]):
            own = x.errors[q, m] * deviation[m]
            squares[m] = fade * squares[m] + weight * own * own
            e[m] = x.weight[q, m] * squares[m]
        x.residual[q, 0] = sum_members(e)
        x.residual[q, 1] = fade * x.residual[q, 1] + weight
        if not math.isnan(x.e[q]):
            fade = 1.0 - (1.0 - s.colour_forgetting) * weight
            x.colour[q, 0] = fade * x.colour[q, 0] + weight * error * x.e[q]
            x.colour[q, 1] = fade * x.colour[q, 1] + weight * 0.5 * (error * error + x.e[q] * x.e[q])
    x.e[q] = error
    if begun > 0:
        observe_lag(s, x, q, error)


@compiled
def autocorrelation(x: BankState, q: int) -> float:
    """Return the lag-1 autocorrelation of row q's prediction errors, 0 to `LARGEST_COLOUR` [1]."""
    if x.colour[q, 1] <= 0.0:
        return 0.0
    return float(min(max(x.colour[q, 0] / x.colour[q, 1], 0.0), LARGEST_COLOUR))


@compiled
def long_run_factor(x: BankState, q: int) -> float:
    """Return by how much colour multiplies the variance of a mean of row q's residuals [1]."""
    rho = autocorrelation(x, q)
    return (1.0 + rho) / (1.0 - rho)


@compiled
def kept_variance(s: BankSettings, x: BankState, q: int) -> float:
    """Return in units of what variance row q takes back after a name what it knew: that of the detector's errors.

    Error bars are in units of the residual's. Through windows that is smaller where members follow smoothed noise, by
    tens and hundreds: what was known to a variance would be known to a hundredth of it for having been taken back. The
    smaller of the two counts there; where derivatives are measured, noise makes both.
    """
    base = x.base[q, 0] / x.base[q, 1]
    return float(min(base, residual_variance(x, q)) if s.straddle > 0 else base)


@compiled
def residual_variance(x: BankState, q: int) -> float:
    """Return ``s^2 c`` of row q without the degrees of freedom [output^2]; infinite before there is any data."""
    if x.residual[q, 1] <= 0.0:
        return math.inf
    return float(x.residual[q, 0] / x.residual[q, 1] * long_run_factor(x, q))
