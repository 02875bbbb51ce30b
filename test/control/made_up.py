"""A made-up aircraft of three axes and four surfaces, linear, with first-order actuators."""

from __future__ import annotations

import math

import numpy as np

from msls_ros.control import ControlledAircraft, Prior
from msls_ros.control.linear import Array

PERIOD = 0.02
SPEED = 60.0
EFFECTORS = ("da", "de", "dr", "df")
B = np.zeros((9, 4))
B[3:6] = [[3.0, 0.0, 0.4, -2.0], [0.0, -2.5, 0.0, -0.6], [-0.1, 0.0, -1.5, 0.0]]
A = np.zeros((9, 9))
A[2, 4], A[1, 5], A[2, 2], A[1, 1] = SPEED, -SPEED, -0.6, -0.2
A[1, 6] = 9.80665  # gravity, in a bank
A[3, 1], A[4, 2], A[5, 1] = -0.02, -0.03, 0.03
A[3, 3], A[4, 4], A[5, 5], A[6, 3], A[7, 4], A[8, 5] = -1.0, -1.0, -0.5, 1.0, 1.0, 1.0


def aircraft(prior: bool = True) -> ControlledAircraft:
    """As the laws see it: effectors are surfaces."""
    limit = (math.radians(20.0),) * 4
    return ControlledAircraft(
        effectors=EFFECTORS,
        surfaces=EFFECTORS,
        mixing=np.eye(4),
        low=tuple(-one for one in limit),
        high=limit,
        rate_limit=(1.0,) * 4,
        bandwidth=(20.0,) * 4,
        trim_delta=np.zeros(4),
        trim_alpha=0.0,
        prior=Prior(A, B) if prior else None,
    )


class Plant:
    """The aircraft in flight about its trim; ``effect`` (4,) multiplies its surfaces' effects."""

    def __init__(self) -> None:
        self.x, self.delta, self.effect, self.offset = np.zeros(9), np.zeros(4), np.ones(4), np.zeros(4)
        self.x[0] = SPEED

    @property
    def xdot(self) -> Array:
        """Of the present instant."""
        deviation = self.x.copy()
        deviation[0] = 0.0
        return A @ deviation + B @ (self.effect * self.delta + self.offset)

    def step(self, command: Array) -> None:
        """Fly a sample."""
        for _ in range(4):
            step = 1.0 - math.exp(-20.0 * PERIOD / 4)
            self.delta = self.delta + np.clip(step * (command - self.delta), -PERIOD / 4, PERIOD / 4)
            self.x = self.x + PERIOD / 4 * self.xdot
