"""Sensors: Gaussian noise on states, accelerations and deflections, at three published levels.

One standard deviation, per sample and independent. Euler rates carry the noise of the body rates, from which an
inertial unit computes them; the attitudes' levels are those of a tactical (low) and an industrial (med) grade unit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from msls_ros.plant.interface import EFFECTORS, STATES, Array, PlantError, Sample

_FOOT = 0.3048
_STREAM = 0x5E50


@dataclass(frozen=True)
class NoiseLevel:
    """Standard deviations of one sensor suite.

    Attributes
    ----------
    velocity : float
        On u, v, w [m/s].
    rate : float
        On P, Q, R and on the Euler rates [rad/s].
    attitude : float
        On Phi, Theta, Psi [rad].
    acceleration : float
        On the derivatives of u, v, w [m/s^2].
    angular_acceleration : float
        On the derivatives of P, Q, R [rad/s^2].
    deflection : float
        On the effector deflections [rad].
    """

    velocity: float
    rate: float
    attitude: float
    acceleration: float
    angular_acceleration: float
    deflection: float

    def sigma(self, effectors: int = len(EFFECTORS)) -> Array:
        """Return the standard deviations of x, xdot and of so many deflections, one after the other (18 + m,)."""
        x = [self.velocity] * 3 + [self.rate] * 3 + [self.attitude] * 3
        xdot = [self.acceleration] * 3 + [self.angular_acceleration] * 3 + [self.rate] * 3
        return np.array(x + xdot + [self.deflection] * effectors)


NOISE_LEVELS: Mapping[str, NoiseLevel] = MappingProxyType(
    {
        "none": NoiseLevel(0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        "low": NoiseLevel(
            velocity=0.05 * _FOOT,
            rate=math.radians(0.005),
            attitude=math.radians(0.01),
            acceleration=0.02 * _FOOT,
            angular_acceleration=math.radians(0.05),
            deflection=math.radians(0.005),
        ),
        "med": NoiseLevel(
            velocity=0.2 * _FOOT,
            rate=math.radians(0.02),
            attitude=math.radians(0.05),
            acceleration=0.1 * _FOOT,
            angular_acceleration=math.radians(0.25),
            deflection=math.radians(0.02),
        ),
    }
)
"""The sensor suites, by name."""


class Sensors:
    """A sensor suite with its own random numbers.

    Parameters
    ----------
    level : str
        A name of `NOISE_LEVELS`.
    seed : int
        Not negative; the same seed gives the same noise.

    Raises
    ------
    PlantError
        If the level is unknown or the seed is not a whole number of at least 0.
    """

    def __init__(self, level: str, seed: int) -> None:
        if level not in NOISE_LEVELS:
            message = f"unknown noise level {level!r}: expected one of {', '.join(NOISE_LEVELS)}"
            raise PlantError(message)
        if isinstance(seed, bool) or not isinstance(seed, int) or seed < 0:
            message = f"seed {seed!r}: expected a whole number of at least 0"
            raise PlantError(message)
        self._level = NOISE_LEVELS[level]
        self._sigma = self._level.sigma()
        self._silent = not self._sigma.any()
        self._random = np.random.default_rng([_STREAM, seed])

    def measure(self, sample: Sample) -> Sample:
        """Return the sample as measured: each value with fresh noise."""
        if self._silent:
            return sample
        if sample.x.size * 2 + sample.delta.size != self._sigma.size:
            self._sigma = self._level.sigma(sample.delta.size)
        noise = self._random.standard_normal(self._sigma.size) * self._sigma
        n = len(STATES)
        return Sample(sample.time, sample.x + noise[:n], sample.xdot + noise[n : 2 * n], sample.delta + noise[2 * n :])
