"""Noise in the regressors: what the measured states do beyond what their measured derivatives make of them.

Least squares takes regressors for exact. Where they are not, estimates shrink (attenuation), no matter how many samples
there are, and residuals do not show it. But a state and its derivative are measured apart, and the change of the one
should be the integral of the other. What is left over a window of L samples is noise of the state's sensor, white or
coloured, or a gust that moves the air data and not the aircraft::

    D_k = x_k - x_(k-L) - sum (xdot_j + xdot_(j-1)) dt/2,      sigma_x^2 = 1/2 var D

About its mean: an accelerometer's bias is no gust; and about what goes with the change of xdot over the window: a state
that is measured a moment after its derivative is not noisy. `bank.attenuation` says what follows for estimates.

Until a first window is full, all that the state has done may be noise: its variance counts.

A gust changes over seconds, and in the first of them hardly shows: with n independent windows so far, by Student's t
the variance counts ``n / (n - 2)`` times. D holds the noise of the derivative as well, which grows as L^2 while that is
correlated. Gyros have no gusts, and their noise is white for the most part, so for rates a short window will do.

How much of it is white noise says the covariance of one step's difference with the last one: white noise is in both,
once with either sign, and a gust, whose steps are new ones each time, is not::

    d_k = x_k - x_(k-1) - (xdot_k + xdot_(k-1)) dt/2,      sigma_white^2 = - mean d_k d_(k-1)

Nothing is seen where the derivatives were made from the states.

References
----------
Fuller, *Measurement Error Models*, 1987, section 2.2.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from msls_ros.estimation.compiled import compiled, passed_by_reference
from msls_ros.estimation.kernel import Array, Integers

RATES = ("P", "Q", "R")
"""Angular rates."""

WINDOW, RATES_WINDOW = 0.4, 0.1
"""L [s]: longer than the noise of vanes is correlated; of angular rates.

Noise of Q in flight test, 1.5 mrad/s in truth: .4 s say 3.5, .1 s say 1.5 to 1.6, of P and R within 10 and 8 %.
"""

OVERLAP = 1.5
"""Independent squares per window of what changes slowly: the squares of its autocorrelation, 1 - |k|/L, sum to 2L/3."""

MEMORY = 3.0
"""Of mean and variance [s]."""

FEW = 0.02
"""Least number of windows beyond two that is reckoned with: before that next to nothing is known of the noise."""

GAP = 2.0
"""A step of time longer than this many of the last one interrupts the window."""


@passed_by_reference
class Defect(NamedTuple):
    """What `observe_defect` remembers; v states."""

    last: Array
    """(2, v) the last states and their derivatives."""
    steps: Array
    """(L, v) the last differences between change and integral."""
    rates: Array
    """(L, v) the last derivatives."""
    skew: Array
    """(3, v) mean change of the derivative over the window; about it, mean products with the sum, and squares."""
    lagged: Array
    """(3, v) the last step's difference, mean product of it with the one before, number of these."""
    total: Array
    """(v,) their sum."""
    mean: Array
    variance: Array
    """(v,) of the sum."""
    clock: Array
    """(2,) time of the last sample, length of the last step [s]."""
    filled: Integers
    """(2,) samples of the window that are filled; sums that were seen."""
    size: Integers
    """(v,) L [samples]."""


def make_defect(states: Sequence[str], sample_rate: float) -> Defect:
    """Allocate for states of these names; `clear_defect` makes it valid."""
    seconds = [RATES_WINDOW if name in RATES else WINDOW for name in states]
    sizes = np.array([max(4, round(window * sample_rate)) for window in seconds], np.int64)
    size, count = int(sizes.max()), len(states)
    total, mean, variance = np.zeros(count), np.zeros(count), np.zeros(count)
    steps, rates, skew = np.zeros((size, count)), np.zeros((size, count)), np.zeros((3, count))
    lagged = np.zeros((3, count))
    last, clock, filled = np.zeros((2, count)), np.zeros(2), np.zeros(2, np.int64)
    return Defect(last, steps, rates, skew, lagged, total, mean, variance, clock, filled, sizes)


def clear_defect(defect: Defect) -> None:
    """Know nothing."""
    for array in defect[:-1]:
        array[...] = 0
    defect.filled[0] = -1


@compiled
def observe_defect(defect: Defect, time: Array, x: Array, xdot: Array, columns: Integers, noise: Array) -> None:
    """Take samples; ``defect.variance`` follows.

    Parameters
    ----------
    defect
        Memory; updated.
    time
        (n,) [s].
    x, xdot
        (n, states) [m/s, rad/s; per second].
    columns
        (v,) where the states stand.
    noise
        (n, 2 v) out: variance of their noise after each sample, and that of white noise.
    """
    longest = defect.steps.shape[0]
    for k in range(time.shape[0]):
        step = time[k] - defect.clock[0]
        if defect.filled[0] >= 0 and (step <= 0.0 or (defect.clock[1] > 0.0 and step > GAP * defect.clock[1])):
            defect.filled[0] = -1
        if defect.filled[0] < 0:
            for j in range(columns.shape[0]):
                defect.total[j] = 0.0
                defect.lagged[0, j] = 0.0
                for i in range(longest):
                    defect.steps[i, j] = 0.0
        full = defect.filled[0] >= longest
        if full:
            defect.filled[1] += 1
        gain = max(1.0 / max(defect.filled[1], 1), step / MEMORY)
        for j in range(columns.shape[0]):
            v = x[k, columns[j]]
            a = xdot[k, columns[j]]
            if defect.filled[0] >= 0:
                slot = defect.filled[0] % defect.size[j]
                d = v - defect.last[0, j] - 0.5 * step * (a + defect.last[1, j])
                defect.total[j] += d - defect.steps[slot, j]
                defect.steps[slot, j] = d
                observe_step(defect, j, d, step)
            if full:
                change = a - defect.rates[defect.filled[0] % defect.size[j], j]
                defect.mean[j] += gain * (defect.total[j] - defect.mean[j])
                deviation = defect.total[j] - defect.mean[j]
                defect.skew[0, j] += gain * (change - defect.skew[0, j])
                change -= defect.skew[0, j]
                defect.skew[1, j] += gain * (deviation * change - defect.skew[1, j])
                defect.skew[2, j] += gain * (change * change - defect.skew[2, j])
                if defect.skew[2, j] > 0.0:
                    deviation -= defect.skew[1, j] / defect.skew[2, j] * change
                defect.variance[j] += gain * (deviation * deviation - defect.variance[j])
            number = OVERLAP / (gain * defect.size[j])
            found = 0.5 * defect.variance[j]
            noise[k, j] = max(found * number / max(number - 2.0, FEW), found)
            if defect.filled[1] == 0:
                own = 1.0 / (defect.filled[0] + 2)
                deviation = v - defect.mean[j] if own < 1.0 else 0.0
                defect.mean[j] = v - (1.0 - own) * deviation
                defect.variance[j] = (1.0 - own) * (defect.variance[j] + own * deviation * deviation)
                noise[k, j] = defect.variance[j]
            noise[k, columns.shape[0] + j] = max(-defect.lagged[1, j], 0.0)
            if defect.filled[0] >= 0:
                defect.rates[defect.filled[0] % defect.size[j], j] = a
            defect.last[0, j] = v
            defect.last[1, j] = a
        defect.clock[1] = step if defect.filled[0] >= 0 else 0.0
        defect.clock[0] = time[k]
        defect.filled[0] += 1


@compiled
def observe_step(defect: Defect, j: int, d: float, step: float) -> None:
    """Update the mean product of state j's last two differences with ``d``, of a step of that length [s]."""
    last = defect.lagged[0, j]
    defect.lagged[0, j] = d
    if last == 0.0:
        return
    defect.lagged[2, j] += 1.0
    gain = max(1.0 / defect.lagged[2, j], step / MEMORY)
    defect.lagged[1, j] += gain * (last * d - defect.lagged[1, j])
