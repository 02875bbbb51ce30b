"""Velocities as regressors, without the noise that their measured derivatives show to be none of their motion.

A velocity is the integral of its derivative. As a random walk about that integral, measured in white noise (a local
level), it is filtered, each by itself::

    foreseen_k = xhat_(k-1) + dt ((1/2 + c) xdot_k + (1/2 - c) xdot_(k-1))
    xhat_k     = foreseen_k + K (x_k - foreseen_k)

The steps ``d_k = x_k - x_(k-1) - integral`` hold the noise twice, with either sign: ``r = - mean d_k d_(k-1)``. Over a
window of L samples D = sum d (`regressor_noise`) holds ``var D = 2 r + L q``, with what the walk makes: gusts, noise of
the derivative. K is Kalman's steady gain for q/r, the error of xhat has the variance ``K r``, of which the sensor's own
noise makes ``K r/(2 - K)``, and nothing is averaged over more than L samples. ``c`` is found by regression of d on the
change of the derivative: where an input steps at a sample xdot is a step, and no ramp. What the derivative may do
between two samples beyond that, a quarter of its change, is in q: without noise K is 1.

That x is the integral of xdot must have shown: the regression of D on the integral over the window, or over one that is
`LONGER`, says 0, for certain (`TRUSTED`). By what it may be off, x walks away from the integral: in doubt K is nearer
to 1. States and derivatives that do not belong together are left as they are, and so is all whose derivatives are made
of the states. Of angular rates nothing is made, as in `state_delay`: gyros and their derivatives are of one sensor; the
error of xhat has half a step of xdot's noise, which is in the output as well.

What physics takes off an output (`kinematics`) is by the states as measured: an accelerometer's derivative was made
with them, and what is common to both cancels.

References
----------
Harvey, *Forecasting, Structural Time Series Models and the Kalman Filter*, 1989, sections 2.2 and 4.1 (local level: its
moments, its steady gain). Klein and Morelli, *Aircraft System Identification*, 2006, chapter 10 (data compatibility).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from msls_ros.estimation.compiled import compiled, passed_by_reference
from msls_ros.estimation.kernel import Array, Integers
from msls_ros.estimation.regressor_noise import GAP, MEMORY, OVERLAP, RegressorNoise

TRUSTED = 0.5
"""By how much the state may seem another multiple of its integrated derivative, with two standard errors, at most [1].

At 1 a multiple of 0 is as likely as one of 1. With .8 noise is taken off sooner (half a stabilator, medium noise: 16
named, not 15), and one of 20 names is wrong.
"""
LONGER = 5
"""So many times as long is a second window: an integral grows with the time, white noise does not [1].

Canard fighter with dither, vane .6 m/s, six flights: K after 10 s is .3 in five of them, not .6; A is called reliable
in .23, not .20, as well covered (.99). The longer one alone: half a stabilator, medium noise, seen in 9 of 20, not 11.
"""
BETWEEN = 0.25
"""Part of the change of a derivative from sample to sample by which it may be another one between them [1].

Half of it would be all that trapezoids can be off by.
"""
CONSTANT = 300.0
"""Memory of what states and derivatives are to each other [s]."""
SMALL = 0.01
"""Noise over motion of which no more than a half is taken off [1, rms]: it takes a ten thousandth of a derivative.

What is left of regressors that move along one line is then of a filter's making. With noise of .001 m/s beside motion
of .5 m/s, w by an elevator that only a slow stick had moved was -208 with a standard error of 2 in the least squares of
a flight (true -5; nothing of it was said to be known), and its dither an eighth of what it may be, in another of ten
flights a twentieth; in none with this.
"""
BY_CHANCE = 4.0
"""Squared standard errors that c may have by chance."""
WINDOWS = 3
"""From so many windows on the noise is known, to .8 of itself."""


@passed_by_reference
class Filter(NamedTuple):
    """What `filter_states` remembers; v states."""

    filtered: Array
    """(v,) the states, filtered."""
    last: Array
    """(2, v) the last states as measured, and their derivatives."""
    steps: Array
    """(L, v) the last steps beyond the integral, a ring."""
    states: Array
    """(2, LONGER L, v) the last states, and their derivatives' integrals since a gap, a ring."""
    total: Array
    """(v,) D."""
    lagged: Array
    """(3, v) the last step less what goes with c, mean product of it with the one before, number of these."""
    stepped: Array
    """(2, v) mean product of steps, per time, and changes of the derivative, and mean square of those."""
    motion: Array
    """(2, v) mean of the states, and their mean squares about it."""
    explained: Array
    """(2, 4, v) by window: sums of products of the integral over it with D, of squares of both, and their number."""
    clock: Array
    """(2,) time of the last sample, length of the last step [s]."""
    filled: Integers
    """(1,) samples since a gap; negative: none."""
    number: Integers
    """(1,) sums over whole windows that were seen."""
    size: Integers
    """(v,) L [samples]."""
    velocity: Integers
    """(v,) 1 of what is filtered."""


def make_filter(size: Integers, velocity: Integers) -> Filter:
    """Allocate for states with windows of so many samples, (v,), of which some are velocities; see `clear_filter`."""
    count, longest = len(size), int(size.max())
    return Filter(
        filtered=np.zeros(count),
        last=np.zeros((2, count)),
        steps=np.zeros((longest, count)),
        states=np.zeros((2, LONGER * longest, count)),
        total=np.zeros(count),
        lagged=np.zeros((3, count)),
        stepped=np.zeros((2, count)),
        motion=np.zeros((2, count)),
        explained=np.zeros((2, 4, count)),
        clock=np.zeros(2),
        filled=np.zeros(1, np.int64),
        number=np.zeros(1, np.int64),
        size=size,
        velocity=velocity,
    )


def clear_filter(f: Filter) -> None:
    """Know nothing."""
    for array in f[:-2]:
        array[...] = 0
    f.filled[0] = -1


@compiled
def filter_states(
    f: Filter, time: Array, x: Array, xdot: Array, columns: Integers, noise: RegressorNoise, found: Array
) -> None:
    """Filter the velocities of samples, and say what noise is left; see the module.

    Parameters
    ----------
    f
        Memory; updated.
    time
        (n,) [s].
    x, xdot
        (n, states) in step with each other [m/s, rad/s; per second].
    columns
        (v,) where the states stand.
    noise
        As `observe_defect` fills it in: variances become those of what the filter leaves; ``believed`` is filled in.
    found
        (n, p) out: the states, filtered, in the first v columns.
    """
    count = columns.shape[0]
    for k in range(time.shape[0]):
        step = time[k] - f.clock[0]
        if f.filled[0] >= 0 and (step <= 0.0 or (f.clock[1] > 0.0 and step > GAP * f.clock[1])):
            f.filled[0] = -1
        for j in range(count):
            v, a = x[k, columns[j]], xdot[k, columns[j]]
            white, share = 0.0, 1.0
            if f.velocity[j] == 0:
                f.filtered[j] = v
            elif f.filled[0] >= 0:
                part = part_of_step(f, j, step)
                integral = step * ((0.5 + part) * a + (0.5 - part) * f.last[1, j])
                observe_step(f, j, v, a, step, part)
                white = max(-f.lagged[1, j], 0.0)
                share = share_of_measured(f, j, white, noise.variance[k, j], step)
                f.filtered[j] = share * v + (1.0 - share) * (f.filtered[j] + integral)
            else:
                f.total[j] = 0.0
                f.lagged[0, j] = 0.0
                f.filtered[j] = v
            f.last[0, j] = v
            f.last[1, j] = a
            white = min(white, noise.variance[k, j])
            noise.variance[k, j] -= (1.0 - share) * white
            noise.shown[k, j] = max(noise.shown[k, j] - white, 0.0) + share * white
            noise.white[k, j] *= share / (2.0 - share)
            noise.believed[k, j] = share
            found[k, j] = f.filtered[j]
        if f.filled[0] >= f.steps.shape[0]:
            f.number[0] += 1
        f.clock[1] = step if f.filled[0] >= 0 else 0.0
        f.clock[0] = time[k]
        f.filled[0] += 1


@compiled
def observe_step(f: Filter, j: int, v: float, a: float, step: float, part: float) -> None:
    """Learn from a step to state j, ``v``, with derivative ``a``; ``part`` is c."""
    change = a - f.last[1, j]
    d = v - f.last[0, j] - 0.5 * step * (a + f.last[1, j])
    size, filled = f.size[j], f.filled[0]
    slot = filled % size
    if filled >= size:
        f.total[j] += d - f.steps[slot, j]
    else:
        f.total[j] += d
    f.steps[slot, j] = d
    observe_integral(f, j, v, v - f.last[0, j] - d, step)
    slow = max(1.0 / (f.lagged[2, j] + 1.0), step / CONSTANT)
    f.stepped[0, j] += slow * (d * change / step - f.stepped[0, j])
    f.stepped[1, j] += slow * (change * change - f.stepped[1, j])
    deviation = v - f.motion[0, j]
    f.motion[0, j] += slow * deviation
    f.motion[1, j] += slow * (deviation * deviation - f.motion[1, j])
    last = f.lagged[0, j]
    d -= part * step * change
    f.lagged[0, j] = d
    if last != 0.0:
        f.lagged[2, j] += 1.0
        f.lagged[1, j] += max(1.0 / f.lagged[2, j], step / MEMORY) * (last * d - f.lagged[1, j])


@compiled
def observe_integral(f: Filter, j: int, v: float, integral: float, step: float) -> None:
    """Learn from ``integral``, that of the derivative over the step to ``v``, what it and state j are to each other."""
    longest, filled = f.states.shape[1], f.filled[0]
    slot = filled % longest
    whole = f.states[1, (filled - 1) % longest, j] + integral if filled > 0 else 0.0
    fade = 1.0 - step / CONSTANT
    for n in range(2):
        size = longest if n > 0 else f.size[j]
        if filled < size:
            continue
        own, then = f.explained[n], (filled - size) % longest
        along = whole - f.states[1, then, j]
        rest = v - f.states[0, then, j] - along
        own[0, j] = fade * own[0, j] + along * rest
        own[1, j] = fade * own[1, j] + along * along
        own[2, j] = fade * own[2, j] + rest * rest
        own[3, j] = fade * own[3, j] + 1.0
    f.states[0, slot, j] = v
    f.states[1, slot, j] = whole


@compiled
def part_of_step(f: Filter, j: int, step: float) -> float:
    """Return c: by how much more the derivative at the end of a step counts for its integral than that at its start."""
    square = f.stepped[1, j]
    if square <= 0.0 or f.lagged[2, j] < f.size[j]:
        return 0.0
    c = f.stepped[0, j] / square
    number = min(f.lagged[2, j], CONSTANT / step)
    variance = BY_CHANCE * 2.0 * max(-f.lagged[1, j], 0.0) / (number * step * step * square)
    return float(min(max(c - variance / c, -0.5), 0.5)) if c * c > variance else 0.0


@compiled
def walk_of_doubt(f: Filter, j: int) -> float:
    """Return the variance by which state j may walk away in a sample from its integral, for not being that."""
    least = math.inf
    for n in range(2):
        own, size = f.explained[n], f.states.shape[1] if n > 0 else f.size[j]
        if own[1, j] <= 0.0:
            continue
        off = own[0, j] / own[1, j]
        doubt = off * off + 4.0 * own[2, j] / own[3, j] * size / OVERLAP / own[1, j]
        left = TRUSTED * TRUSTED - doubt
        if left > 0.0:
            least = min(least, doubt / left * own[1, j] / (own[3, j] * size))
    return least


@compiled
def share_of_measured(f: Filter, j: int, white: float, noise: float, step: float) -> float:
    """Return K of state j, by the variances of white noise and of all that `regressor_noise` has found."""
    if f.number[0] < WINDOWS * f.size[j] or white <= 0.0:
        return 1.0
    between = BETWEEN * step
    walk = 2.0 * max(noise - white, 0.0) / f.size[j] + between * between * f.stepped[1, j] + walk_of_doubt(f, j)
    if walk == math.inf:
        return 1.0
    ratio = walk / white
    share = max(0.5 * (math.sqrt(ratio * ratio + 4.0 * ratio) - ratio), 1.0 / f.size[j])
    worth = white / (white + SMALL * SMALL * f.motion[1, j])
    return float(1.0 - worth * (1.0 - min(share, 1.0)))
