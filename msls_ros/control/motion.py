"""The motion that the laws feed back: incidence angles with their rates, and filtered accelerations and positions."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from msls_ros.control.linear import Array
from msls_ros.estimation.kinematics import GRAVITY

LEAST_SPEED = 1.0
"""[m/s]"""


class Motion(NamedTuple):
    """Of the aircraft against the air."""

    speed: float
    """[m/s]"""
    alpha: float
    beta: float
    """[rad]"""
    alpha_rate: float
    beta_rate: float
    """[rad/s]"""
    roll_rate: float
    """About the velocity vector [rad/s]."""
    pitch_rate: float
    """[rad/s]"""
    alpha_turn: float
    beta_turn: float
    """What the turn of gravity in the body axes adds to the second derivatives of alpha and beta [rad/s^2]."""


def motion_of(x: Array, velocity_rates: Array) -> Motion:
    """Return the motion.

    Parameters
    ----------
    x
        (9,) measured states.
    velocity_rates
        (3,) derivatives of u, v, w [m/s^2].
    """
    u, v, w, p, q, r = x[:6].tolist()
    du, dv, dw = velocity_rates.tolist()
    plane2 = max(u * u + w * w, LEAST_SPEED**2)
    speed = math.sqrt(plane2 + v * v)
    alpha, beta = math.atan2(w, u), math.asin(max(-1.0, min(1.0, v / speed)))
    speed_rate = (u * du + v * dv + w * dw) / speed
    alpha_rate = (u * dw - w * du) / plane2
    beta_rate = (dv * speed - v * speed_rate) / (speed * math.sqrt(plane2))
    ca, sa = math.cos(alpha), math.sin(alpha)
    roll, phi, theta = p * ca + r * sa, float(x[6]), float(x[7])
    across = GRAVITY * math.cos(theta)
    gx, gy, gz = -GRAVITY * math.sin(theta), across * math.sin(phi), across * math.cos(phi)
    alpha_turn = ((q - alpha_rate) * (gx * ca + gz * sa) - roll * gy) / speed
    beta_turn = (p * gz - r * gx) / speed
    return Motion(speed, alpha, beta, alpha_rate, beta_rate, roll, q, alpha_turn, beta_turn)


class Filters:
    """Accelerations and positions behind the same first-order filter, so that they belong together.

    Where no accelerations are measured they are the derivative of the filtered states, which is the same filter's
    output half a sample later; positions are then taken half a sample later too.

    Parameters
    ----------
    bandwidth
        Corner [rad/s].
    surfaces
        How many.
    """

    def __init__(self, bandwidth: float, surfaces: int) -> None:
        """Begin with nothing; see the class."""
        self._bandwidth = bandwidth
        self.positions, self.acceleration, self.velocity_rates = np.zeros(surfaces), np.zeros(3), np.zeros(3)
        """(s,) filtered positions [rad], (3,) filtered angular accelerations, (3,) rates of u, v, w."""
        self.unfiltered = np.zeros(3)
        """(3,) angular accelerations as measured, where they are."""
        self.moved, self.response = np.zeros(surfaces), np.zeros(3)
        """Their changes since the last sample."""
        self.restart()

    def restart(self) -> None:
        """Begin with the next sample."""
        self._begun = False

    def update(self, x: Array, xdot: Array | None, positions: Array, period: float) -> None:
        """Take a sample.

        Parameters
        ----------
        x, xdot
            (9,) states and their measured derivatives; None: not measured.
        positions
            (s,) measured [rad].
        period
            Since the last sample [s].
        """
        if not self._begun:
            self._begun = True
            self._states, self._low_passed = x[:6].copy(), positions.copy()
            self.positions = positions.copy()
            self.acceleration = np.zeros(3) if xdot is None else xdot[3:6].copy()
            self.velocity_rates = np.zeros(3) if xdot is None else xdot[:3].copy()
            self.unfiltered = self.acceleration
            self.moved, self.response = np.zeros_like(positions), np.zeros(3)
            return
        share = -math.expm1(-self._bandwidth * period)
        before, was = self.positions, self.acceleration
        change = share * (positions - self._low_passed)
        states = share * (x[:6] - self._states)
        self._low_passed = self._low_passed + change
        self._states = self._states + states
        if xdot is None:
            derivative = states / period
            self.acceleration, self.velocity_rates = derivative[3:6], derivative[:3]
            self.unfiltered = self.acceleration
            self.positions = self._low_passed - 0.5 * change
        else:
            self.acceleration = was + share * (xdot[3:6] - was)
            self.velocity_rates, self.unfiltered = xdot[:3].copy(), xdot[3:6].copy()
            self.positions = self._low_passed
        self.moved, self.response = self.positions - before, self.acceleration - was
