"""The acceleration that the dither may add to every window of a second: what is felt, and what a held command adds."""

from __future__ import annotations

import math

from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.dither.allocation import felt, felt_square, uncertain_square
from msls_ros.estimation.dither.inputs import Law
from msls_ros.estimation.dither.limits import (
    ACHIEVED,
    CORNER,
    GROWN,
    LONGEST,
    MOST,
    PROMISED,
    Effectors,
    left_of_window,
    move,
    note_together,
    settle,
    spend,
)
from msls_ros.estimation.elementary import exponential
from msls_ros.estimation.kernel import Array

MOST_GROWN = 100.0
"""Largest factor by which the window is held to have been fuller than it was entered [1]; it leaves nothing to send."""


@compiled
def modelled_square(
    law: Law, x: Effectors, b: Array, unsure: Array, ahead: float, part: float, scratch: Array
) -> float:
    """Square of the acceleration at the station by the dither's share of the surfaces, by B-hat [m^2/s^4].

    Now, or ``ahead`` [s] of now when ``part`` of the last commands has been held so long; and what errors of B-hat may
    add, ``unsure`` (m,) [m^2/s^4/rad^2] of each effector.
    """
    axial = lateral = normal = besides = 0.0
    last = pole = 0.0
    for j in range(x.surface.shape[0]):
        felt(b, law.rows, law.station, j, scratch)
        surface = x.surface[j]
        if ahead > 0.0:
            corner = x.limits[j, CORNER]
            if corner != last:
                pole = exponential(-corner * ahead) if corner > 0.0 else 0.0
                last = corner
            surface += (1.0 - pole) * (part * x.command[j] - surface)
        axial += scratch[0] * surface
        lateral += scratch[1] * surface
        normal += scratch[2] * surface
        besides += unsure[j] * surface * surface
    return besides + axial * axial + lateral * lateral + normal * normal


@compiled
def apart_square(law: Law, x: Effectors, b: Array, scratch: Array) -> float:
    """Sum of the squares that each surface's share is felt as by itself, by B-hat [m^2/s^4]."""
    total = 0.0
    for j in range(x.surface.shape[0]):
        total += felt_square(b, law.rows, law.station, j, scratch) * x.surface[j] * x.surface[j]
    return total


@compiled
def grown(law: Law, x: Effectors, b: Array, variance: Array, scratch: Array) -> float:
    """What the window holds, by B-hat as it is now, over what was entered by B-hat as it was; 1 at least.

    Without what the errors of B-hat add to its square, and over `ACHIEVED`, longer than the window: B-hat that has
    grown is going to grow. After one second it is .6 to .85 of B on aircraft that give 25 samples in it. Twenty-three
    aircraft at 25, 50 and 100 Hz, first 6 s, 414 flights (860 to 862, 864 to 866), some second felt as more than 1.1 of
    the limit: 62 without, 43 with this, 47 over half a second. F-16 (100 to 119): nothing changes.
    """
    total = 0.0
    for j in range(x.surface.shape[0]):
        known = felt_square(b, law.rows, law.station, j, scratch) - uncertain_square(variance, law.rows, law.station, j)
        if known > 0.0:  # not where its variance is no number
            total += known * x.squares[j]
    return float(min(max(total / x.together[1], 1.0), MOST_GROWN)) if x.together[1] > 0.0 else 1.0


@compiled
def enter_window(
    law: Law,
    x: Effectors,
    b: Array,
    variance: Array,
    unsure: Array,
    unit: float,
    time: float,
    dt: float,
    scratch: Array,
) -> float:
    """Enter the acceleration of the last interval of ``dt`` s, until ``time``.

    Returns
    -------
    float
        What holding back leaves of the sum of the squares, 0 to 1.
    """
    x.clock[GROWN] = grown(law, x, b, variance, scratch)
    resultant = modelled_square(law, x, b, unsure, 0.0, 0.0, scratch)
    besides = 0.0
    for j in range(unsure.shape[0]):
        besides += unsure[j] * x.surface[j] * x.surface[j]
    fade = exponential(-dt / ACHIEVED)
    together = note_together(x, max(resultant - besides, 0.0), apart_square(law, x, b, scratch), fade)
    for j in range(x.squares.shape[0]):
        x.squares[j] = fade * x.squares[j] + (1.0 - fade) * x.surface[j] * x.surface[j]
    spend(x, time, dt, unit * resultant)
    return together


@compiled
def held_square(law: Law, x: Effectors, b: Array, unsure: Array, hold: float, part: float, scratch: Array) -> float:
    """Integral of the square over ``hold`` s of ``part`` of the commands, and until the surfaces rest [m^2/s^3].

    Simpson's rule over the hold; what follows decays with the slowest actuator.
    """
    now = modelled_square(law, x, b, unsure, 0.0, part, scratch)
    middle = modelled_square(law, x, b, unsure, 0.5 * hold, part, scratch)
    then = modelled_square(law, x, b, unsure, hold, part, scratch)
    return hold * (now + 4.0 * middle + then) / 6.0 + law.rest * then


@compiled
def hold_back(
    law: Law,
    x: Effectors,
    b: Array,
    unsure: Array,
    unit: float,
    delta: Array,
    dt: float,
    scratch: Array,
    out: Array,
) -> None:
    """Lower the commands ``out`` (m,) where, held, they would overdraw the window.

    Held for the longest interval of late they may fill it to `MOST`, and for `stale_after`, if no sample comes, to
    `PROMISED`. The integral is a quadratic in the part of the commands that is sent.
    """
    for unforeseen in range(2):
        hold, most = (law.stale_after, PROMISED) if unforeseen else (x.clock[LONGEST], MOST)
        allowed = left_of_window(x, hold + 2.0 * law.rest, most) / unit
        whole = held_square(law, x, b, unsure, hold, 1.0, scratch)
        if whole <= allowed:
            continue
        nothing = held_square(law, x, b, unsure, hold, 0.0, scratch)
        half = held_square(law, x, b, unsure, hold, 0.5, scratch)
        square = 2.0 * (whole + nothing) - 4.0 * half
        linear = whole - nothing - square
        part = 0.0
        if square > 0.0:
            root = linear * linear - 4.0 * square * (nothing - allowed)
            part = (-linear + math.sqrt(max(root, 0.0))) / (2.0 * square)
        part = min(max(part, 0.0), 1.0)
        for j in range(out.shape[0]):
            out[j] = move(x, j, part * out[j], delta[j], dt)


@compiled
def rest(law: Law, x: Effectors, time: float, dt: float) -> None:
    """Nothing is commanded from ``time`` on; what the surfaces are felt as for ``dt`` s counts against the window."""
    if dt > 0.0 and law.rest > 0.0:
        spend(x, time, 2.0 * law.rest, 0.0)
    settle(x, dt)
