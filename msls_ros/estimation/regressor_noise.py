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

What goes with the change of xdot says how late a velocity is: a vane lags, and an estimate of velocity comes some
filters after the accelerometer. By a delay or lag tau, ``D_k = -tau C_k`` with ``C_k = xdot_k - xdot_(k-L)``. About
their means, with r the mean square of what is left, and n independent windows::

    tau = - mean D C / mean C^2,      V = r / (n - 2) / C^2 + (FASTEST G / C^2)^2

where G is by how much r is larger than over a quarter of the window: noise of a sensor is as large over any, and gusts
grow. A gust moves the velocity and then, as the aircraft answers it with its damping, the derivative: it makes
``cov(D, C)`` of ``damping G`` at most, and looks like a delay.

What goes with the changes of the deflections is partialled out of D and C first: a deflection that steps from sample to
sample makes a step of the derivative, which the trapezoids above take for a ramp, and so a D of half a sample times C.

All velocities have much of their delay in common (one filter, the same vanes), and each is drawn to the mean of all, by
weights of ``1 / (V + APART^2)`` (random effects). What is not beyond a standard error is none, ``tau - V / tau`` is
used, and ``x + tau xdot - CURVED tau^2 xdotdot`` learnt from, so that states and derivatives are of one time. How late
a sensor is does not change in flight, so that it is remembered for minutes. What is no longer than half a sample may as
well be how a simulator integrates. Of angular rates nothing is made: gyros and their derivatives are of one sensor.

Nothing is seen where the derivatives were made from the states.

References
----------
Fuller, *Measurement Error Models*, 1987, section 2.2. Klein and Morelli, *Aircraft System Identification*, 2006,
chapter 10 (data compatibility: time shifts of sensors). DerSimonian and Laird, "Meta-analysis in clinical trials",
Controlled Clinical Trials 7 (1986) (random effects).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from msls_ros.estimation.compiled import compiled, passed_by_reference
from msls_ros.estimation.kernel import Array, Integers

RATES = ("P", "Q", "R")
"""Angular rates."""

VELOCITIES = ("u", "v", "w")
"""What sensors of the air and estimates of the velocity may say late."""

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

SHORT = 4
"""So many times shorter is the window by which gusts are found."""

FASTEST = 10.0
"""Damping with which an aircraft follows a gust at most [1/s]: 1 to 6 of translation from airliners to models."""

CERTAIN = 2.0
"""Standard errors of a mean square that are counted for gusts: in the first windows these may not have shown."""

INTEGRATED = 0.6
"""Delays of no more than so many samples are none [1]: a simulator that integrates by Euler's rule makes half of one.

JSBSim's A-4 and T-37 at 50 Hz, two steps of integration per sample, seem 5 ms late as exactly as if they were; taken
for a delay, A is covered in .80 and .89, and in .96 and .95 as it is.
"""

ALIKE = 1e-9
"""Share of a sum of squares that must be left of it where others are partialled out [1]."""

LEAST = 12.0
"""Windows, independent ones, from which mean squares are known well enough, to .4, to tell gusts from a delay [1]."""

CONSTANT = 300.0
"""Memory of how late velocities are [s]."""

APART = 0.01
"""By how much velocities are late unlike each other [s]: vanes and pitots, where they are not of one estimate."""

LATEST = 0.1
"""A quarter of the window [s]: what seems later is no delay, but a state that is not what its derivative makes."""

CURVED = 0.75
"""Of the square of a delay times the second derivative: 1/2 of what is delayed, 1 of what lags, [1]."""

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
    short: Array
    """(v,) the same over the short window."""
    deflections: Array
    """(L, m) the last deflections."""
    turned: Array
    """(m,) mean change of the deflections over the window."""
    moments: Array
    """(v, m + 2, m + 2) sums of products of the changes of the deflections, of the derivative, C, and of D."""
    timing: Array
    """(4, v) number of these, and sums of D^2, D C and C^2 of the short window."""
    left: Array
    """(m + 2, m + 2) scratch."""
    seen: Array
    """(2, v) by how much states come after their derivatives, and variance of that; infinite: unknown [s, s^2]."""
    late: Array
    """(v,) by how much they are for certain [s]."""
    mean: Array
    variance: Array
    """(v,) of the sum."""
    clock: Array
    """(3,) time of the last sample, length of the last step, and of steps in the mean [s]."""
    filled: Integers
    """(2,) samples of the window that are filled; sums that were seen."""
    size: Integers
    """(v,) L [samples]."""
    velocity: Integers
    """(v,) 1 of what is put in step with its derivative."""


def make_defect(states: Sequence[str], effectors: int, sample_rate: float) -> Defect:
    """Allocate for states of these names, and so many effectors; `clear_defect` makes it valid."""
    seconds = [RATES_WINDOW if name in RATES else WINDOW for name in states]
    sizes = np.array([max(4, round(window * sample_rate)) for window in seconds], np.int64)
    size, count = int(sizes.max()), len(states)
    total, mean, variance = np.zeros(count), np.zeros(count), np.zeros(count)
    steps, rates, skew = np.zeros((size, count)), np.zeros((size, count)), np.zeros((3, count))
    lagged = np.zeros((3, count))
    short, timing, seen, late = np.zeros(count), np.zeros((4, count)), np.zeros((2, count)), np.zeros(count)
    deflections, turned = np.zeros((size, effectors)), np.zeros(effectors)
    moments = np.zeros((count, effectors + 2, effectors + 2))
    last, clock, filled = np.zeros((2, count)), np.zeros(3), np.zeros(2, np.int64)
    velocity = np.array([name in VELOCITIES for name in states], np.int64)
    of_delay = short, deflections, turned, moments, timing, np.zeros_like(moments[0]), seen, late
    return Defect(last, steps, rates, skew, lagged, total, *of_delay, mean, variance, clock, filled, sizes, velocity)


def clear_defect(defect: Defect) -> None:
    """Know nothing."""
    for array in defect[:-2]:
        array[...] = 0
    defect.seen[1] = np.inf
    defect.filled[0] = -1


@compiled
def observe_defect(
    defect: Defect,
    time: Array,
    x: Array,
    xdot: Array,
    delta: Array,
    columns: Integers,
    noise: Array,
    aligned: Array,
) -> None:
    """Take samples; ``defect.variance`` and ``defect.late`` follow.

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
        (n, 2 v) out: variance of their noise after each sample, and that of white noise.
    aligned
        (n, states) in and out: the states, of which those that are late are put in step with their derivatives.
    """
    longest = defect.steps.shape[0]
    for k in range(time.shape[0]):
        step = time[k] - defect.clock[0]
        if defect.filled[0] >= 0 and (step <= 0.0 or (defect.clock[1] > 0.0 and step > GAP * defect.clock[1])):
            defect.filled[0] = -1
        if defect.filled[0] < 0:
            for j in range(columns.shape[0]):
                defect.total[j] = 0.0
                defect.short[j] = 0.0
                defect.lagged[0, j] = 0.0
                for i in range(longest):
                    defect.steps[i, j] = 0.0
        full = defect.filled[0] >= longest
        if full:
            defect.filled[1] += 1
        gain = max(1.0 / max(defect.filled[1], 1), step / MEMORY)
        if full:
            for i in range(delta.shape[1]):
                turn = delta[k, i] - defect.deflections[defect.filled[0] % longest, i]
                defect.turned[i] += gain * (turn - defect.turned[i])
        for j in range(columns.shape[0]):
            v = x[k, columns[j]]
            a = xdot[k, columns[j]]
            if defect.filled[0] >= 0:
                slot = defect.filled[0] % defect.size[j]
                d = v - defect.last[0, j] - 0.5 * step * (a + defect.last[1, j])
                quarter = (defect.filled[0] - defect.size[j] // SHORT) % defect.size[j]
                defect.total[j] += d - defect.steps[slot, j]
                defect.short[j] += d - defect.steps[quarter, j]
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
                if defect.velocity[j] != 0:
                    before = defect.rates[(defect.filled[0] - defect.size[j] // SHORT) % defect.size[j], j]
                    observe_timing(defect, j, deviation, change, a - before, delta[k], step)
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
            late = defect.late[j]
            aligned[k, columns[j]] = v + late * a
            if late != 0.0 and defect.filled[0] >= 0 and step > 0.0:
                aligned[k, columns[j]] -= CURVED * late * late * (a - defect.last[1, j]) / step
            if defect.filled[0] >= 0:
                defect.rates[defect.filled[0] % defect.size[j], j] = a
            defect.last[0, j] = v
            defect.last[1, j] = a
        if full:
            defect.clock[2] += gain * (step - defect.clock[2])
            combine_timing(defect)
        if defect.filled[0] >= 0:
            for i in range(delta.shape[1]):
                defect.deflections[defect.filled[0] % longest, i] = delta[k, i]
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


@compiled
def observe_timing(
    defect: Defect, j: int, deviation: float, change: float, moved: float, delta: Array, step: float
) -> None:
    """Update how late state j is.

    Parameters
    ----------
    defect
        Memory; updated.
    j
        Which.
    deviation, change
        D and C of the whole window, about their means.
    moved
        Change of the derivative over the short window.
    delta
        (m,) deflections of now.
    step
        Since the last sample [s].
    """
    size = defect.size[j]
    part = (size // SHORT) / size
    short = defect.short[j] - part * defect.mean[j]
    moved -= part * defect.skew[0, j]
    fade = 1.0 - step / CONSTANT
    for i, value in enumerate((1.0, short * short, short * moved, moved * moved)):
        defect.timing[i, j] = fade * defect.timing[i, j] + value
    moments = defect.moments[j]
    m = delta.shape[0]
    slot = defect.filled[0] % defect.deflections.shape[0]
    for i in range(m + 2):
        one = change if i == m else deviation
        if i < m:
            one = delta[i] - defect.deflections[slot, i] - defect.turned[i]
        for n in range(i + 1):
            other = change if n == m else deviation
            if n < m:
                other = delta[n] - defect.deflections[slot, n] - defect.turned[n]
            moments[i, n] = fade * moments[i, n] + one * other
    find_delay(defect, j, part)


@compiled
def find_delay(defect: Defect, j: int, part: float) -> None:
    """Find how late state j is, and how certain that is; ``part`` of the window is the short one.

    The changes of the deflections are partialled out of C and D first, with those before (Frisch and Waugh).
    """
    moments, left = defect.moments[j], defect.left
    last = moments.shape[0] - 1
    windows = OVERLAP * defect.timing[0, j] / defect.size[j]
    if windows < LEAST + last or moments[last - 1, last - 1] <= 0.0:
        return
    for i in range(last + 1):
        for n in range(i + 1):
            left[i, n] = moments[i, n]
    for k in range(last - 1):
        if left[k, k] <= ALIKE * moments[k, k]:
            continue
        for i in range(k + 1, last + 1):
            factor = left[i, k] / left[k, k]
            for n in range(k + 1, i + 1):
                left[i, n] -= factor * left[n, k]
    size = left[last - 1, last - 1]
    if size <= ALIKE * moments[last - 1, last - 1]:
        return
    tau = -left[last, last - 1] / size
    residual = max(left[last, last] + tau * left[last, last - 1], 0.0)
    whole = moments[last, last] + tau * (2.0 * moments[last, last - 1] + tau * moments[last - 1, last - 1])
    quick = defect.timing[1, j] + tau * (2.0 * defect.timing[2, j] + tau * defect.timing[3, j])
    grown = max(whole - max(quick, 0.0), 0.0) + CERTAIN * math.sqrt(2.0 / windows) * residual
    gust = FASTEST * grown / (1.0 - part) / size
    defect.seen[0, j] = tau
    defect.seen[1, j] = residual / size / (windows - last - 1.0) + gust * gust


@compiled
def combine_timing(defect: Defect) -> None:
    """Draw how late each velocity is to what all have in common, and keep what is certain of it."""
    total = 0.0
    common = 0.0
    for j in range(defect.late.shape[0]):
        weight = 1.0 / (defect.seen[1, j] + APART * APART)
        total += weight
        common += weight * defect.seen[0, j]
    if total <= 0.0:
        return
    common /= total
    spread = 1.0 / total + APART * APART
    for j in range(defect.late.shape[0]):
        if defect.velocity[j] == 0:
            continue
        own = spread / (spread + defect.seen[1, j])
        tau = common + own * (defect.seen[0, j] - common)
        variance = spread * (1.0 - own)
        likely = INTEGRATED * defect.clock[2] < abs(tau) < LATEST
        defect.late[j] = tau - variance / tau if likely and tau * tau > variance else 0.0
