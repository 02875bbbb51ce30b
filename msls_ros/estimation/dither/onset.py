"""How the dither begins while nothing is known of B: by what each effector is seen to do at the station.

What an effector does is known half a second to two seconds after the first dither, and until then B-hat is too small:
few samples say little against the prior, and a surface that moves by no more than the noise of its sensor seems to do
little. An amplitude that an F-16 hardly feels is twice the limit for a c310. But how much is felt shows sooner than
what each coefficient is. For the first seconds the square of an effect is no less than what the acceleration of the
station has in common with the measured deflection, over the last tenths of a second and without their means of late::

    seen_j = (|C_j|^2/S_j - (T - |C_j|^2/S_j)/n) / (AIM^2 S_j)

with the sums of products C (three axes), of squares S of the deflection and T of the acceleration. Sequences are
independent, so each effector is regressed by itself; what n samples explain by chance is taken off. In that time all
grow from a part of what is wanted.
"""

from __future__ import annotations

import math

from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.dither.allocation import felt
from msls_ros.estimation.dither.inputs import Law
from msls_ros.estimation.dither.limits import Effectors
from msls_ros.estimation.elementary import exponential
from msls_ros.estimation.kernel import Array

BEGIN, GROW = 0.4, 0.15
"""Part of what is wanted that is sent at first [1]; time in which it grows by a factor e [s]."""
AIM = 0.75
"""What an effector that is seen may be felt as, over its share of the limit [1].

By B-hat nothing holds back yet what sequences add by chance. Twenty-three aircraft with the sensors of flight test at
25, 50 and 100 Hz, the first 6 s, 207 flights (860 to 862): in 74 some second was felt as more than 1.1 of the limit,
2.3 at worst; with this, 32 and 1.8 (17 since `dither.window.grown`); with .9 (and .4 s less to chance, 1.2 s long) 53
and 2.0. F-16, error before the loss at low and medium noise (100 to 109): none of this .91 and 6.5 %, with it .90 and
11; with one factor for all effectors in place of a square for each 1.1 and 11, in as many flights over the limit.
"""
SLOW, MEMORY = 0.1, 0.3
"""Memory of the means that are taken off, and of the sums [s]."""
DURATION, SAMPLES = 2.5, 75
"""How long what is seen counts at least [s], and of how many samples."""

GAIN, FLOWN, WEIGHT, SQUARES, TOTAL = range(5)
"""Of `Effectors.onset`: part that is sent [1]; since when [s]; sums of weights, their squares, and of T [m^2/s^4]."""
MEAN, AXIAL, LATERAL, NORMAL, OWN = range(5)
"""Columns of `Effectors.moments`, of each effector: mean [rad]; products with the acceleration [rad m/s^2]; squares
[rad^2]. In the last row, means of the acceleration [m/s^2]."""


@compiled
def begin(law: Law, x: Effectors, known: bool, output: Array, delta: Array, dt: float, scratch: Array) -> float:
    """Fill in ``x.seen``, what is seen of each effect; return the part of what is wanted that is sent now, 0 to 1.

    Parameters
    ----------
    law, x
        The law and its effectors.
    known
        Whether all effects are known; where they are from the first, there is nothing to begin with.
    output
        (r, 1) outputs of the rows as measured: what is not known of the derivatives of velocities and rates. NaN where
        there are none.
    delta
        (m,) measured deflections [rad].
    dt
        Since the last sample [s].
    scratch
        (3,).
    """
    state = x.onset
    if state[GAIN] <= 0.0:
        state[GAIN] = 1.0 if known else BEGIN
        state[FLOWN] = math.inf if known else 0.0
    if state[FLOWN] >= max(DURATION, SAMPLES * law.period):
        for j in range(x.seen.shape[0]):
            x.seen[j] = 0.0
        return 1.0
    state[FLOWN] += dt
    felt(output, law.rows, law.station, 0, scratch)
    if math.isfinite(scratch[0] + scratch[1] + scratch[2]):
        enter_moments(x, delta, dt, scratch)
        see(x)
        state[GAIN] = min(state[GAIN] * exponential(dt / GROW), 1.0)
    return float(state[GAIN])


@compiled
def enter_moments(x: Effectors, delta: Array, dt: float, acceleration: Array) -> None:
    """Enter a sample, of deflections (m,) and acceleration (3,), which becomes what it differs from its mean."""
    state, moments = x.onset, x.moments
    m = delta.shape[0]
    first = state[WEIGHT] <= 0.0
    slow = 1.0 if first else 1.0 - exponential(-dt / SLOW)
    fade = exponential(-dt / MEMORY)
    state[WEIGHT] = fade * state[WEIGHT] + 1.0
    state[SQUARES] = fade * fade * state[SQUARES] + 1.0
    state[TOTAL] *= fade
    for axis in range(3):
        rest = acceleration[axis] - moments[m, AXIAL + axis]
        moments[m, AXIAL + axis] += slow * rest
        acceleration[axis] = 0.0 if first else rest
        state[TOTAL] += acceleration[axis] * acceleration[axis]
    for j in range(m):
        rest = delta[j] - moments[j, MEAN]
        moments[j, MEAN] += slow * rest
        for axis in range(3):
            moments[j, AXIAL + axis] = fade * moments[j, AXIAL + axis] + acceleration[axis] * rest
        moments[j, OWN] = fade * moments[j, OWN] + (0.0 if first else rest * rest)


@compiled
def see(x: Effectors) -> None:
    """Fill in the squared effect of each effector at the station, as far as it shows, over `AIM`'s [m^2/s^4/rad^2]."""
    state, moments = x.onset, x.moments
    samples = state[WEIGHT] * state[WEIGHT] / state[SQUARES]
    for j in range(x.seen.shape[0]):
        own, explained = moments[j, OWN], 0.0
        for axis in range(3):
            explained += moments[j, AXIAL + axis] * moments[j, AXIAL + axis]
        explained = explained / own if own > 0.0 else 0.0
        chance = max(state[TOTAL] - explained, 0.0) / samples
        x.seen[j] = max(explained - chance, 0.0) / (AIM * AIM * own) if own > 0.0 else 0.0
