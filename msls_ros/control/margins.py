"""Stability margins of the loop that is flown, predicted of the believed model.

They say how much wrong the model may be in one loop, not whether it is: they cannot vet the model that they come
from. The return ratio T of the whole loop is computed at many frequencies; loop i, opened with the others closed, is
``l_i = 1 / [(1 + T)^-1]_ii - 1``, and the margins are the smallest over the loops. Between frequencies l_i is taken as
linear.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msls_ros.control.aircraft import ControlledAircraft
from msls_ros.control.believed import Believed
from msls_ros.control.indi import pitch_gains
from msls_ros.control.linear import Array, Flags
from msls_ros.control.lq_servo import MOTION, LqServo, _incidence
from msls_ros.control.motion import Motion
from msls_ros.control.settings import ControlSettings
from msls_ros.control.signals import Margins

Complex = NDArray[np.complexfloating[Any, Any]]
FREQUENCIES: Array = np.geomspace(0.1, 100.0, 60)
"""[rad/s]"""


def smallest_margins(loops: Complex, frequencies: Array) -> Margins:
    """Return the smallest margins of single loops.

    Parameters
    ----------
    loops
        (k, f) return ratios, negative feedback.
    frequencies
        (f,) [rad/s], increasing.
    """
    gain, reduction, phase, delay = math.inf, 0.0, math.inf, math.inf
    for loop in loops:
        imaginary, size = np.imag(loop), np.abs(loop)
        for i in np.flatnonzero(imaginary[:-1] * imaginary[1:] < 0.0):
            share = imaginary[i] / (imaginary[i] - imaginary[i + 1])
            real = float(loop.real[i] + share * (loop.real[i + 1] - loop.real[i]))
            if -1.0 < real < 0.0:
                gain = min(gain, -1.0 / real)
            elif real <= -1.0:
                reduction = max(reduction, -1.0 / real)
        for i in np.flatnonzero((size[:-1] - 1.0) * (size[1:] - 1.0) < 0.0):
            share = (size[i] - 1.0) / (size[i] - size[i + 1])
            at = complex(loop[i] + share * (loop[i + 1] - loop[i]))
            frequency = float(frequencies[i] + share * (frequencies[i + 1] - frequencies[i]))
            angle = math.atan2(at.imag, at.real)
            phase = min(phase, math.pi - abs(angle))
            delay = min(delay, ((angle + math.pi) % (2.0 * math.pi)) / frequency)
    return Margins(gain, reduction, phase, delay)


def opened(ratio: Complex) -> Complex:
    """Return the loops (n, f), each opened with the others closed, of return ratios (f, n, n)."""
    n = ratio.shape[-1]
    closed: Complex = np.linalg.inv(np.eye(n) + ratio)
    found: Complex = (1.0 / np.diagonal(closed, axis1=1, axis2=2) - 1.0).T
    return found


def indi_margins(
    believed: Believed,
    motion: Motion,
    settings: ControlSettings,
    aircraft: ControlledAircraft,
    period: float,
    stuck: Flags,
) -> Margins:
    """Return the margins of the inversion in roll, pitch and yaw: unconstrained, with actuators and sample delay."""
    gains = pitch_gains(settings, believed.pitching_power_left(stuck))
    s = 1j * FREQUENCIES[:, None, None]
    turn = _incidence(motion)
    a5 = turn @ believed.a[:6, :6] @ np.linalg.pinv(turn)
    b = believed.b
    b5 = turn @ np.vstack([believed.b_forces, b])
    x = np.linalg.solve(s * np.eye(MOTION) - a5, np.broadcast_to(b5.astype(complex), (len(s), *b5.shape)))
    weights2 = np.diag(np.array(settings.weights) ** 2)
    unsure = settings.caution * np.diag((np.diag(weights2)[:, None] * believed.variance).sum(axis=0))
    cost = b.T @ weights2 @ b
    price = settings.price * max(float(cost.max()), 1e-9) * np.eye(len(cost))
    inverse = np.linalg.solve(cost + unsure + price, b.T @ weights2)
    kept = np.linalg.solve(cost + unsure + price, cost + unsure)
    actuator = _actuator(s, aircraft, period)
    low_pass = settings.filter_bandwidth / (s + settings.filter_bandwidth)
    rates = x[:, [3, 1, 4], :]
    inner = np.eye(len(cost)) - actuator * low_pass * (kept - inverse @ (s * rates))
    answer = np.linalg.solve(inner, actuator * inverse)
    return smallest_margins(opened(_outer(s, motion, settings, gains) @ x @ answer), FREQUENCIES)


def _actuator(s: Complex, aircraft: ControlledAircraft, period: float) -> Complex:
    """Return the slowest actuator, with the hold of the command and the sample between measuring and commanding."""
    bandwidth = min(aircraft.bandwidth)
    found: Complex = bandwidth / (s + bandwidth) * np.exp(-0.5 * s * period)
    return found


def _outer(s: Complex, motion: Motion, c: ControlSettings, pitch: tuple[float, float]) -> Complex:
    """Return the feedback (f, 3, 5) of alpha Q beta P R to roll, pitch and yaw acceleration."""
    ca, sa = math.cos(motion.alpha), math.sin(motion.alpha)
    s = s[:, 0, 0]
    found: Any = np.zeros((len(s), 3, MOTION), np.complex128)
    found[:, 0, 3], found[:, 0, 4] = c.roll_gain * ca * ca, c.roll_gain * ca * sa
    found[:, 2, 3], found[:, 2, 4] = c.roll_gain * ca * sa, c.roll_gain * sa * sa
    found[:, 1, 0] = pitch[0] * (s + pitch[1])
    yaw = c.yaw_gain * (s + c.beta_gain)
    found[:, 0, 2], found[:, 2, 2] = sa * yaw, -ca * yaw
    return found  # type: ignore[no-any-return]


def lq_margins(servo: LqServo, aircraft: ControlledAircraft, period: float) -> Margins:
    """Return the margins of the servo at each surface, with actuators and sample delay."""
    if servo.gain is None:
        return Margins()
    f, g = servo.loop
    s = 1j * FREQUENCIES[:, None, None]
    states = np.linalg.solve(s * np.eye(len(f)) - f, np.broadcast_to(g.astype(complex), (len(s), *g.shape)))
    return smallest_margins(opened(_actuator(s, aircraft, period) * (servo.gain @ states)), FREQUENCIES)
