"""Is the air moving? What the velocities through the air do beyond what the accelerations make of them.

Air data give ``u v w`` relative to the air, accelerometers give specific forces, whatever the air does. In still air
the change of the one is the integral of the other; in gusts it is not. The difference grows like the gust with the
samples L over which it is taken; noise of the velocities, smoothed or not, adds the same to L and to L/2::

    d_k   = x_k - x_(k-1) - (xdot_k + xdot_(k-1)) dt / 2
    S_k   = d_k + ... + d_(k-L+1),    H_k = d_k + ... + d_(k-L/2+1)
    gust  = 2/(2-c) (mean S^2 - c mean H^2)
    share = gust / mean (x_k - x_(k-L))^2                how much of the motion through the air is the air's

Nothing is seen where the derivatives were made from the velocities, or the velocities are inertial.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msls_ros.estimation.compiled import compiled, passed_by_reference
from msls_ros.estimation.kernel import Array, Integers

WINDOW = 20
"""L [samples]."""

CLEAR = 1.5
"""c: S^2 must be so many times H^2 before anything counts as gust; noise gives 1, a random walk 2."""

GAP = 2.0
"""A step of time longer than this many of the last one interrupts the window."""


@passed_by_reference
class Air(NamedTuple):
    """What `observe_air` remembers; v velocities."""

    last: Array
    """(2, v) the last velocities and their derivatives."""
    differences: Array
    """(L, v) the last ``d``."""
    past: Array
    """(L, v) the last velocities."""
    sums: Array
    """(3, v) weighted sums of S^2, H^2 and the squared change over L samples."""
    clock: Array
    """(2,) time of the last sample, length of the last step [s]."""
    filled: Integers
    """(1,) samples of the window that are filled."""


def make_air(velocities: int) -> Air:
    """Allocate for that many velocities; `clear_air` makes it valid."""
    shape = (WINDOW, velocities)
    return Air(
        np.zeros((2, velocities)),
        np.zeros(shape),
        np.zeros(shape),
        np.zeros((3, velocities)),
        np.zeros(2),
        np.zeros(1, np.int64),
    )


def clear_air(air: Air) -> None:
    """Know nothing."""
    for array in (air.last, air.differences, air.past, air.sums, air.clock):
        array.fill(0.0)
    air.filled[0] = -1


@compiled
def observe_air(air: Air, time: Array, x: Array, xdot: Array, columns: Integers, forgetting: float) -> float:
    """Take samples; return the largest share of the motion of a velocity that is the air's.

    Parameters
    ----------
    air
        Memory; updated.
    time
        (n,) [s].
    x, xdot
        (n, states) [m/s; m/s^2].
    columns
        (v,) where the velocities stand.
    forgetting
        Of the mean squares, per sample [1].

    Returns
    -------
    float
        0 to 1; 0 before a window is full.
    """
    size = air.differences.shape[0]
    for k in range(time.shape[0]):
        step = time[k] - air.clock[0]
        if air.filled[0] >= 0 and (step <= 0.0 or (air.clock[1] > 0.0 and step > GAP * air.clock[1])):
            air.filled[0] = -1
        slot = air.filled[0] % size
        for j in range(columns.shape[0]):
            v = x[k, columns[j]]
            a = xdot[k, columns[j]]
            if air.filled[0] >= 0:
                d = v - air.last[0, j] - 0.5 * step * (a + air.last[1, j])
                air.differences[slot, j] = d
                change = v - air.past[slot, j]
                air.past[slot, j] = v
                if air.filled[0] >= size:
                    total = 0.0
                    half = 0.0
                    for i in range(size):
                        total += air.differences[i, j]
                        if (slot - i) % size < size // 2:
                            half += air.differences[i, j]
                    air.sums[0, j] = forgetting * air.sums[0, j] + total * total
                    air.sums[1, j] = forgetting * air.sums[1, j] + half * half
                    air.sums[2, j] = forgetting * air.sums[2, j] + change * change
            air.last[0, j] = v
            air.last[1, j] = a
        air.clock[1] = step if air.filled[0] >= 0 else 0.0
        air.clock[0] = time[k]
        air.filled[0] += 1
    largest = 0.0
    for j in range(columns.shape[0]):
        gust = 2.0 / (2.0 - CLEAR) * (air.sums[0, j] - CLEAR * air.sums[1, j])
        if gust > largest * air.sums[2, j]:
            largest = gust / air.sums[2, j] if air.sums[2, j] > 0.0 else 0.0
    return min(largest, 1.0)
