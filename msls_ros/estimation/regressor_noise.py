"""Noise in the regressors: what the measured states do beyond what their measured derivatives make of them.

Least squares takes regressors for exact. Where they are not, estimates shrink (attenuation), no matter how many samples
there are, and residuals do not show it. But a state and its derivative are measured apart, and the change of the one
should be the integral of the other. What is left over a window of L samples is noise of the state's sensor, white or
coloured, or a gust that moves the air data and not the aircraft::

    D_k = x_k - x_(k-L) - sum (xdot_j + xdot_(j-1)) dt/2,      sigma_x^2 = 1/2 var D

About its mean: an accelerometer's bias is no gust; and about what goes with the change of xdot over the window: a state
that is measured a moment after its derivative is not noisy, but late, see `state_delay`. `bank.attenuation` says what
follows for estimates.

Until a first window is full, all that the state has done may be noise: its variance counts.

A gust changes over seconds, and in the first of them hardly shows: with n independent windows so far, by Student's t
the variance counts ``n / (n - 2)`` times. D holds the noise of the derivative as well, which grows as L^2 while that is
correlated. Gyros have no gusts, and their noise is white for the most part, so for rates a short window will do.

What of a gust acts on the aircraft, and is no noise, says `bank.gusts`. How much of D is white noise says the
covariance of one step's difference with the last one: white noise is in both, once with either sign, and a gust, whose
steps are new ones each time, is not::

    d_k = x_k - x_(k-1) - (xdot_k + xdot_(k-1)) dt/2,      sigma_white^2 = - mean d_k d_(k-1)

Nothing is seen where the derivatives were made from the states.

References
----------
Fuller, *Measurement Error Models*, 1987, section 2.2. Klein and Morelli, *Aircraft System Identification*, 2006,
chapter 10 (data compatibility).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from msls_ros.estimation.compiled import compiled, passed_by_reference
from msls_ros.estimation.kernel import Array, Integers
from msls_ros.estimation.state_delay import OVERLAP as OVERLAP
from msls_ros.estimation.state_delay import (
    Delay,
    align,
    clear_delay,
    combine_delays,
    keep_deflections,
    left_late,
    make_delay,
    observe_delay,
    observe_motion,
    observe_short,
    observe_turns,
    short_window,
)

RATES = ("P", "Q", "R")
"""Angular rates."""

WINDOW, RATES_WINDOW = 0.4, 0.1
"""L [s]: longer than the noise of vanes is correlated; of angular rates.

Noise of Q in flight test, 1.5 mrad/s in truth: .4 s say 3.5, .1 s say 1.5 to 1.6, of P and R within 10 and 8 %.
"""

MEMORY = 3.0
"""Of mean and variance [s]."""

FEW = 0.02
"""Least number of windows beyond two that is reckoned with: before that next to nothing is known of the noise."""

GAP = 2.0
"""A step of time longer than this many of the last one interrupts the window."""


@passed_by_reference
class RegressorNoise(NamedTuple):
    """What is known of the noise in the states at each of n samples; v states."""

    variance: Array
    """(n, v) of all that is left in the regressors [state^2]."""
    white: Array
    """(n, v) of that which is white noise of the sensor's own."""
    believed: Array
    """(n, v) K, the share of a measurement beyond the integral that `state_filter` has believed; 1: all of it."""
    shown: Array
    """(n, v) as much of ``variance`` as has shown: without what is added for few windows."""
    defect: Array
    """(n, v) D, about its mean and about what goes with C; 0 while no window is full [state]."""
    late: Array
    """(n, v) by how much velocities seem later than was put right, see `state_delay` [s]."""


def make_noise(samples: int, states: int) -> RegressorNoise:
    """Allocate for so many samples: no noise."""
    none = np.zeros((5, samples, states))
    return RegressorNoise(none[0], none[1], np.ones((samples, states)), none[2], none[3], none[4])


@passed_by_reference
class Defect(NamedTuple):
    """What `observe_defect` remembers; v states."""

    last: Array
    """(2, v) the last states and their derivatives."""
    steps: Array
    """(L, v) the last differences between change and integral."""
    rates: Array
    """(L, v) the last derivatives."""
    total: Array
    """(v,) D: the sum of the differences over the window."""
    mean: Array
    variance: Array
    """(v,) of D, about what goes with C."""
    change: Array
    """(v,) mean of C, the change of the derivative over the window."""
    product: Array
    square: Array
    """(v,) means of D C and C^2, about their means."""
    lagged: Array
    """(3, v) the last step's difference, mean product of it with the one before, number of these."""
    clock: Array
    """(2,) time of the last sample, length of the last step [s]."""
    filled: Integers
    """(1,) samples of the window that are filled; negative: none."""
    number: Integers
    """(1,) sums over whole windows that were seen."""
    delay: Delay
    """How late velocities are."""
    size: Integers
    """(v,) L [samples]."""


def make_defect(states: Sequence[str], effectors: int, sample_rate: float) -> Defect:
    """Allocate for states of these names, and so many effectors; `clear_defect` makes it valid."""
    seconds = [RATES_WINDOW if name in RATES else WINDOW for name in states]
    size = np.array([max(4, round(window * sample_rate)) for window in seconds], np.int64)
    longest, count = int(size.max()), len(states)
    total, mean, variance, change, product, square = np.zeros((6, count))
    return Defect(
        last=np.zeros((2, count)),
        steps=np.zeros((longest, count)),
        rates=np.zeros((longest, count)),
        total=total,
        mean=mean,
        variance=variance,
        change=change,
        product=product,
        square=square,
        lagged=np.zeros((3, count)),
        clock=np.zeros(2),
        filled=np.zeros(1, np.int64),
        number=np.zeros(1, np.int64),
        delay=make_delay(states, effectors, size),
        size=size,
    )


def clear_defect(defect: Defect) -> None:
    """Know nothing."""
    for array in defect[:-2]:
        array[...] = 0
    defect.filled[0] = -1
    clear_delay(defect.delay)


@compiled
def observe_defect(
    defect: Defect,
    time: Array,
    x: Array,
    xdot: Array,
    delta: Array,
    columns: Integers,
    noise: RegressorNoise,
    aligned: Array,
) -> None:
    """Take samples; ``defect.variance`` and how late states are, ``defect.delay.late``, follow.

    Parameters
    ----------
    defect
        Memory; updated.
    time
        (n,) [s].
    x, xdot
        (n, states) [m/s, rad/s; per second].
    delta
        (n, m) deflections [rad].
    columns
        (v,) where the states stand.
    noise
        Out, but for ``believed``.
    aligned
        (n, states) in and out: the states, of which those that are late are put in step with their derivatives.
    """
    count = columns.shape[0]
    for k in range(time.shape[0]):
        step = begin_sample(defect, time[k])
        full = defect.filled[0] >= defect.steps.shape[0]
        if full:
            defect.number[0] += 1
        gain = max(1.0 / max(defect.number[0], 1), step / MEMORY)
        if full:
            observe_turns(defect.delay, defect.filled[0], delta[k], step, gain)
        for j in range(count):
            v, a = x[k, columns[j]], xdot[k, columns[j]]
            since = step if defect.filled[0] >= 0 else 0.0
            aligned[k, columns[j]] = align(defect.delay, j, v, a, a - defect.last[1, j], since)
            if defect.filled[0] >= 0:
                integrate(defect, j, v, a, step)
            noise.defect[k, j] = compare(defect, j, v, a, step, gain) if full else 0.0
            noise.variance[k, j] = noise_of(defect, j, v, gain)
            noise.white[k, j] = max(-defect.lagged[1, j], 0.0)
            noise.shown[k, j] = 0.5 * defect.variance[j] if defect.number[0] > 0 else 0.0
            if defect.filled[0] >= 0:
                defect.rates[defect.filled[0] % defect.size[j], j] = a
                defect.delay.past[defect.filled[0] % defect.size[j], j] = v
            defect.last[0, j] = v
            defect.last[1, j] = a
        if full:
            combine_delays(defect.delay)
        for j in range(count):
            noise.late[k, j] = left_late(defect.delay, j)
        if defect.filled[0] >= 0:
            keep_deflections(defect.delay, defect.filled[0], delta[k])
        defect.clock[1] = step if defect.filled[0] >= 0 else 0.0
        defect.clock[0] = time[k]
        defect.filled[0] += 1


@compiled
def begin_sample(defect: Defect, time: float) -> float:
    """Return the step of time to this sample [s]; where it interrupts the window, that one is emptied."""
    step = time - defect.clock[0]
    if defect.filled[0] >= 0 and (step <= 0.0 or (defect.clock[1] > 0.0 and step > GAP * defect.clock[1])):
        defect.filled[0] = -1
    if defect.filled[0] < 0:
        for j in range(defect.total.shape[0]):
            defect.total[j] = 0.0
            defect.delay.short[j] = 0.0
            defect.lagged[0, j] = 0.0
            for i in range(defect.steps.shape[0]):
                defect.steps[i, j] = 0.0
    return float(step)


@compiled
def integrate(defect: Defect, j: int, v: float, a: float, step: float) -> None:
    """Enter state j, ``v``, and its derivative ``a`` into the sums over its windows, ``step`` after the last [s]."""
    size = defect.size[j]
    slot = defect.filled[0] % size
    d = v - defect.last[0, j] - 0.5 * step * (a + defect.last[1, j])
    observe_short(defect.delay, j, d, defect.steps[(defect.filled[0] - short_window(size)) % size, j])
    defect.total[j] += d - defect.steps[slot, j]
    defect.steps[slot, j] = d
    observe_step(defect, j, d, step)


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


@compiled
def compare(defect: Defect, j: int, v: float, a: float, step: float, gain: float) -> float:
    """Update what D and C of state j are in the mean, and how late it is, with a whole window.

    Parameters
    ----------
    defect
        Memory; updated.
    j
        Which.
    v, a
        State j and its derivative now.
    step
        Since the last sample [s].
    gain
        Weight of this window in the means [1].

    Returns
    -------
    float
        D without its mean and what goes with C.
    """
    size, filled = defect.size[j], defect.filled[0]
    c = a - defect.rates[filled % size, j]
    defect.mean[j] += gain * (defect.total[j] - defect.mean[j])
    d = defect.total[j] - defect.mean[j]
    defect.change[j] += gain * (c - defect.change[j])
    c -= defect.change[j]
    defect.product[j] += gain * (d * c - defect.product[j])
    defect.square[j] += gain * (c * c - defect.square[j])
    if defect.delay.velocity[j] != 0:
        observe_motion(defect.delay, j, filled, v, -defect.lagged[1, j], step, gain)
        lately = a - defect.rates[(filled - short_window(size)) % size, j]
        observe_delay(defect.delay, j, (c, d), lately, (defect.change[j], defect.mean[j]), step)
    if defect.square[j] > 0.0:
        d -= defect.product[j] / defect.square[j] * c
    defect.variance[j] += gain * (d * d - defect.variance[j])
    return float(d)


@compiled
def noise_of(defect: Defect, j: int, v: float, gain: float) -> float:
    """Return the variance of the noise of state j, ``v`` now; ``gain``: weight of the last window in the means.

    Before the first window is full it is that of the state, which is updated.
    """
    if defect.number[0] > 0:
        number = OVERLAP / (gain * defect.size[j])
        found = 0.5 * defect.variance[j]
        return float(max(found * number / max(number - 2.0, FEW), found))
    own = 1.0 / (defect.filled[0] + 2)
    deviation = v - defect.mean[j] if own < 1.0 else 0.0
    defect.mean[j] = v - (1.0 - own) * deviation
    defect.variance[j] = (1.0 - own) * (defect.variance[j] + own * deviation * deviation)
    return float(defect.variance[j])
