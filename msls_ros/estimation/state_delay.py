"""How late velocities are measured: a change that comes after its derivative goes with the change of that one.

A vane lags, and an estimate of velocity comes some filters after the accelerometer. Over a window of L samples, what a
velocity changes beyond the integral of its derivative is D (see `regressor_noise`). By a delay or lag tau it is
``D_k = -tau C_k`` with ``C_k = xdot_k - xdot_(k-L)``. About their means, with r the mean square of what is left, and n
independent windows::

    tau = - mean D C / mean C^2,      V = r / (n - 2) / C^2 + (f G / C^2)^2,      f = PACE sqrt(C^2 / M^2)

where G is by how much r is larger than over a quarter of the window: noise of a sensor is as large over any, and gusts
grow. A gust moves the velocity and then, as the aircraft answers it, the derivative: it makes ``cov(D, C)`` of ``f G``
at most, and looks like a delay. f is how quickly the aircraft moves at all, with M the change of the velocity itself
over the window, less white noise. By how much r seems to have grown by chance is counted too: white noise shows in as
many samples as there are, what is slower in as many windows.

What goes with the changes of the deflections is partialled out of D and C first: a deflection that steps from sample to
sample makes a step of the derivative, which the trapezoids of D take for a ramp, and so a D of half a sample times C.

All velocities have much of their delay in common (one filter, the same vanes), and each is drawn to the mean of all, by
weights of ``1 / (V + APART^2)`` (random effects). What is not beyond a standard error is none, ``tau - V / tau`` is
used, and ``x + tau xdot - CURVED tau^2 xdotdot`` learnt from, so that states and derivatives are of one time. How late
a sensor is does not change in flight, so that it is remembered for minutes. What is no longer than half a sample may as
well be how a simulator integrates. Of angular rates nothing is made: gyros and their derivatives are of one sensor.
What of tau is not put right, for gusts may have made it, is in the errors of A (`bank.uncertainty.delay_square`), be it
as much as `LATEST`.

References
----------
Klein and Morelli, *Aircraft System Identification*, 2006, chapter 10 (data compatibility: time shifts of sensors).
DerSimonian and Laird, "Meta-analysis in clinical trials", Controlled Clinical Trials 7 (1986) (random effects).
Frisch and Waugh, "Partial time regressions as compared with individual trends", Econometrica 1 (1933).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from msls_ros.estimation.compiled import compiled, passed_by_reference
from msls_ros.estimation.kernel import Array, Integers

VELOCITIES = ("u", "v", "w")
"""What sensors of the air and estimates of the velocity may say late."""

OVERLAP = 1.5
"""Independent squares per window of what changes slowly: the squares of its autocorrelation, 1 - |k|/L, sum to 2L/3."""

SHORT = 4
"""So many times shorter is the window by which gusts are found."""

FASTEST = 10.0
"""Damping with which an aircraft follows a gust at most [1/s]: 1 to 6 of translation from airliners to models."""

PACE = 2.0
"""So many times more quickly than it moves at all an aircraft may answer gusts [1].

By what makes tau of gusts, none being late, it answers them .03 to 1.1 times as quickly: u, v and w of the F-16 in
severe air, low noise, and of nineteen other aircraft of JSBSim at 25 Hz (`calibration`, gusts, seed 851); .01 to 1.2
times: six nonlinear aircraft of another simulation. With `FASTEST` alone a vane of .1 deg that lags by 40 ms was not
seen on an aircraft of 18 t even in still air, and A called reliable was covered in .68; with this .93.
"""

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


@passed_by_reference
class Delay(NamedTuple):
    """What is remembered of how late states are; v states, m effectors."""

    short: Array
    """(v,) D over the short window."""
    short_sums: Array
    """(4, v) number of short windows, and sums of D^2, D C and C^2 over them."""
    past: Array
    """(L, v) the last states, a ring."""
    moved: Array
    """(v,) mean M, change of the state over the window."""
    motion: Array
    """(2, v) sums of M^2, about that, and of the variance of white noise."""
    deflections: Array
    """(L, m) the last deflections, a ring."""
    turned: Array
    """(m,) mean change of the deflections over the window."""
    changes: Array
    """(m + 2,) over the last window, about their means: changes of the deflections, C, and D."""
    moments: Array
    """(v, m + 2, m + 2) sums of products of these, lower triangles."""
    left: Array
    """(m + 2, m + 2) scratch."""
    seen: Array
    """(v,) by how much states come after their derivatives [s]."""
    variance: Array
    """(v,) of that; infinite: unknown [s^2]."""
    late: Array
    """(v,) by how much they do for certain [s]."""
    period: Array
    """(1,) mean step of time [s]."""
    size: Integers
    """(v,) L [samples]."""
    velocity: Integers
    """(v,) 1 of what is put in step with its derivative."""


def make_delay(states: Sequence[str], effectors: int, size: Integers) -> Delay:
    """Allocate for states of these names, so many effectors, and windows of so many samples; see `clear_delay`."""
    count, wide = len(states), effectors + 2
    return Delay(
        short=np.zeros(count),
        short_sums=np.zeros((4, count)),
        past=np.zeros((int(size.max()), count)),
        moved=np.zeros(count),
        motion=np.zeros((2, count)),
        deflections=np.zeros((int(size.max()), effectors)),
        turned=np.zeros(effectors),
        changes=np.zeros(wide),
        moments=np.zeros((count, wide, wide)),
        left=np.zeros((wide, wide)),
        seen=np.zeros(count),
        variance=np.zeros(count),
        late=np.zeros(count),
        period=np.zeros(1),
        size=size,
        velocity=np.array([name in VELOCITIES for name in states], np.int64),
    )


def clear_delay(x: Delay) -> None:
    """Know nothing."""
    for array in x[:-2]:
        array[...] = 0
    x.variance[:] = np.inf


@compiled
def align(x: Delay, j: int, v: float, a: float, change: float, step: float) -> float:
    """Return state j, ``v``, as it is at the time of its derivative ``a``.

    That has changed by ``change`` in the last ``step`` [s]; 0: it is not known by how much.
    """
    late = x.late[j]
    aligned = v + late * a
    if late != 0.0 and step > 0.0:
        aligned -= CURVED * late * late * change / step
    return float(aligned)


@compiled
def short_window(size: int) -> int:
    """Return the length of the short window, of a whole one of that size [samples]."""
    return size // SHORT


@compiled
def observe_short(x: Delay, j: int, d: float, before: float) -> None:
    """Take the last difference of state j into D of the short window, and the one that leaves it out."""
    x.short[j] += d - before


@compiled
def observe_turns(x: Delay, filled: int, delta: Array, step: float, gain: float) -> None:
    """Update the mean changes of the deflections, and mean step of time; there are whole windows.

    Parameters
    ----------
    x
        Memory; updated.
    filled
        Samples before this one.
    delta
        (m,) deflections now [rad].
    step
        Since the last sample [s].
    gain
        Weight in the means [1].
    """
    oldest = x.deflections[filled % x.deflections.shape[0]]
    for i in range(delta.shape[0]):
        turn = delta[i] - oldest[i]
        x.turned[i] += gain * (turn - x.turned[i])
        x.changes[i] = turn - x.turned[i]
    x.period[0] += gain * (step - x.period[0])


@compiled
def keep_deflections(x: Delay, filled: int, delta: Array) -> None:
    """Keep deflections (m,) in the ring, after so many."""
    slot = filled % x.deflections.shape[0]
    for i in range(delta.shape[0]):
        x.deflections[slot, i] = delta[i]


@compiled
def observe_motion(x: Delay, j: int, filled: int, v: float, white: float, step: float, gain: float) -> None:
    """Update what state j, ``v`` now, does in a window; there are whole ones.

    Parameters
    ----------
    x
        Memory; updated.
    j
        Which.
    filled
        Samples before this one.
    v
        The state.
    white
        Variance of white noise in it, by its last steps.
    step
        Since the last sample [s].
    gain
        Weight in the mean [1].
    """
    moved = v - x.past[filled % x.size[j], j]
    x.moved[j] += gain * (moved - x.moved[j])
    moved -= x.moved[j]
    fade = 1.0 - step / CONSTANT
    x.motion[0, j] = fade * x.motion[0, j] + moved * moved
    x.motion[1, j] = fade * x.motion[1, j] + white


@compiled
def observe_delay(
    x: Delay, j: int, whole: tuple[float, float], lately: float, mean: tuple[float, float], step: float
) -> None:
    """Update how late state j is.

    Parameters
    ----------
    x
        Memory; updated, `observe_motion` before.
    j
        Which.
    whole
        C and D of the whole window, about their means.
    lately
        C of the short window.
    mean
        Those means, of the whole window.
    step
        Since the last sample [s].
    """
    part = short_window(x.size[j]) / x.size[j]
    c, d = lately - part * mean[0], x.short[j] - part * mean[1]
    fade = 1.0 - step / CONSTANT
    for i, value in enumerate((1.0, d * d, d * c, c * c)):
        x.short_sums[i, j] = fade * x.short_sums[i, j] + value
    moments, changes = x.moments[j], x.changes
    last = changes.shape[0] - 1
    changes[last - 1], changes[last] = whole
    for i in range(last + 1):
        for n in range(i + 1):
            moments[i, n] = fade * moments[i, n] + changes[i] * changes[n]
    find_delay(x, j)


@compiled
def find_delay(x: Delay, j: int) -> None:
    """Find how late state j is, and how certain that is, once there are enough windows."""
    moments, left, sums = x.moments[j], x.left, x.short_sums
    last = moments.shape[0] - 1
    windows = OVERLAP * sums[0, j] / x.size[j]
    if windows < LEAST + last or moments[last - 1, last - 1] <= 0.0:
        return
    partial_out(moments, left)
    square = left[last - 1, last - 1]
    if square <= ALIKE * moments[last - 1, last - 1]:
        return
    tau = -left[last, last - 1] / square
    residual = max(left[last, last] + tau * left[last, last - 1], 0.0)
    whole = moments[last, last] + tau * (2.0 * moments[last, last - 1] + tau * moments[last - 1, last - 1])
    quick = sums[1, j] + tau * (2.0 * sums[2, j] + tau * sums[3, j])
    white = 2.0 * max(x.motion[1, j], 0.0)
    moved = x.motion[0, j] - white
    white = min(white, residual)
    chance = math.sqrt(2.0 / windows) * (residual - white) + math.sqrt(3.0 / sums[0, j]) * white
    grown = max(whole - max(quick, 0.0), 0.0) + CERTAIN * chance
    rate = min(FASTEST, PACE * math.sqrt(square / moved)) if moved > 0.0 else FASTEST
    gust = rate * grown / (1.0 - short_window(x.size[j]) / x.size[j]) / square
    x.seen[j] = tau
    x.variance[j] = residual / square / (windows - last - 1.0) + gust * gust


@compiled
def partial_out(moments: Array, left: Array) -> None:
    """Fill in ``left``: the moments of C and D of what the changes of the deflections leave (Frisch and Waugh).

    Both are lower triangles, (m + 2, m + 2), C and D the last. A deflection that moves as those before it do is not
    taken.
    """
    last = moments.shape[0] - 1
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


@compiled
def combine_delays(x: Delay) -> None:
    """Draw how late each velocity is to what all have in common, and keep what is certain of it."""
    total = 0.0
    common = 0.0
    for j in range(x.late.shape[0]):
        weight = 1.0 / (x.variance[j] + APART * APART)
        total += weight
        common += weight * x.seen[j]
    if total <= 0.0:
        return
    common /= total
    spread = 1.0 / total + APART * APART
    for j in range(x.late.shape[0]):
        if x.velocity[j] == 0:
            continue
        own = spread / (spread + x.variance[j])
        tau = common + own * (x.seen[j] - common)
        variance = spread * (1.0 - own)
        likely = INTEGRATED * x.period[0] < abs(tau) < LATEST
        x.late[j] = tau - variance / tau if likely and tau * tau > variance else 0.0


@compiled
def left_late(x: Delay, j: int) -> float:
    """Return by how much state j seems later than was put right [s]: it may be gusts, it may be a delay."""
    seen = min(max(x.seen[j], -LATEST), LATEST)
    if x.velocity[j] == 0 or abs(seen) <= INTEGRATED * x.period[0]:
        return 0.0
    return float(seen - x.late[j])
