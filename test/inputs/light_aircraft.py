"""A light aircraft of 53 m/s whose pilot flies doublets of any size: gentle flights show less of a map."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from inputs import mapped_messages as made
from inputs.mapped_messages import Flight

SPEED = 53.0
_TRIM = np.array([SPEED, 0.0, 1.06, 0.0, 0.0, 0.0, 0.0, 0.02, 0.4])
_FORCES = np.array([[-0.045, 0.0, 0.036], [0.0, -0.254, 0.0], [-0.37, 0.0, -2.02]])
_PUSHES = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 3.8], [-8.0, 0.0, 0.0]])
_MOMENTS = np.array([[0, -0.3, 0, -8.4, 0, 2.2], [0, 0, -0.166, 0, -3.0, 0], [0, 0.085, 0, -0.35, 0, -0.76]])
_POWERS = np.array([[0.0, -28.9, 2.5], [-11.9, 0.0, 0.0], [0.0, 0.8, -4.6]])
_DOUBLETS = ((2.0, 0.5, 0, 3.0), (3.2, 0.3, 0, 2.0), (7.0, 0.8, 1, 4.0), (9.0, 0.4, 1, 3.0), (13.0, 0.8, 2, 4.0))
"""Begin and half of the length [s], effector, degrees; again after 17 s."""


@cache
def light_aircraft(size: float, seconds: float = 40.0) -> Flight:
    """Return a flight whose doublets are so many times those of `_DOUBLETS`, with a law that feeds angles back.

    Derivatives are those of a Navion, about.
    """
    n, step, parts = round(seconds * made.RATE), 1.0 / made.RATE, 4
    x, states, rates, delta = _TRIM.copy(), np.empty((n, 9)), np.empty((n, 9)), np.empty((n, 3))
    rest = -made.rotation(_TRIM[6:]).T @ np.array([0.0, 0.0, made.GRAVITY])
    servo = np.zeros(3)
    for k in range(n):
        off = x - _TRIM
        wanted = np.array([0.4 * off[7] + 0.15 * x[4], 0.3 * x[6] + 0.05 * x[3], 0.2 * x[5]])
        for begin, half, which, degrees in _DOUBLETS:
            at = (k * step % 17.0) - begin
            wanted[which] += math.radians(size * degrees) * ((0.0 <= at < half) - (half <= at < 2.0 * half))
        for part in range(parts):
            off = x - _TRIM
            turn = x[4] * math.sin(x[6]) + x[5] * math.cos(x[6])
            euler = [x[3] + math.tan(x[7]) * turn, x[4] * math.cos(x[6]) - x[5] * math.sin(x[6]), turn / math.cos(x[7])]
            down = made.rotation(x[6:]).T @ np.array([0.0, 0.0, made.GRAVITY])
            force = rest + _FORCES @ off[:3] + _PUSHES @ servo
            slope = np.concatenate(
                [force + down - np.cross(x[3:6], x[:3]), _MOMENTS @ off[:6] + _POWERS @ servo, euler]
            )
            if part == 0:
                states[k], rates[k], delta[k] = x, slope, servo
            x = x + step / parts * slope
            servo = servo + step / parts * 25.0 * (wanted - servo)
    return Flight(effectors=("de", "da", "dr"), x=states, xdot=rates, delta=delta)
