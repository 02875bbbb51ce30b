"""What a control law knows of an aircraft before it flies: surfaces and their limits, a trim, and a prior model."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from msls_ros.control.errors import ControlError
from msls_ros.control.linear import Array

STATES = ("u", "v", "w", "P", "Q", "R", "Phi", "Theta", "Psi")
AXES = ("P", "Q", "R")
"""Equations that the allocation serves: roll, pitch and yaw acceleration."""


@dataclass(frozen=True)
class Prior:
    """A linear model that is believed at the start: `xdot = a x + b delta + bias`.

    Attributes
    ----------
    a, b : ndarray, shapes (9, 9), (9, m)
        In the order of `STATES` and of the effectors.
    """

    a: Array
    b: Array


@dataclass(frozen=True)
class ControlledAircraft:
    """An aircraft as the laws see it; s surfaces, m effectors.

    Attributes
    ----------
    effectors, surfaces : tuple of str
        Names; the two are the same where effectors are not mixed from surfaces.
    mixing : ndarray, shape (s, m)
        Surface positions = this @ effector deflections [rad/rad]; square and invertible.
    low, high, rate_limit, bandwidth : tuple of float
        Of each surface: position limits [rad], largest speed [rad/s], corner frequency of the actuator [rad/s].
    trim_delta : ndarray, shape (m,)
        Effector deflections of the trim [rad]: what the laws prefer where they have a choice.
    trim_alpha : float
        Angle of attack there [rad].
    prior : Prior or None
        None: nothing is known of the effectors.

    Raises
    ------
    ControlError
        At construction, for shapes that do not fit or a mixing that cannot be inverted.
    """

    effectors: tuple[str, ...]
    surfaces: tuple[str, ...]
    mixing: Array
    low: tuple[float, ...]
    high: tuple[float, ...]
    rate_limit: tuple[float, ...]
    bandwidth: tuple[float, ...]
    trim_delta: Array
    trim_alpha: float
    prior: Prior | None = None

    def __post_init__(self) -> None:
        """Refuse what does not fit."""
        s, m = len(self.surfaces), len(self.effectors)
        mixing = np.asarray(self.mixing, dtype=np.float64)
        if s != m or mixing.shape != (s, m) or np.linalg.matrix_rank(mixing) < m:
            message = f"mixing of shape {mixing.shape} for {s} surfaces and {m} effectors"
            raise ControlError(f"{message}; expected as many of each, and an invertible matrix")
        for name in ("low", "high", "rate_limit", "bandwidth"):
            values = getattr(self, name)
            if len(values) != s or not np.isfinite(values).all():
                message = f"{name} is {list(values)}; expected {s} finite numbers, one per surface"
                raise ControlError(message)
        if any(low > high for low, high in zip(self.low, self.high, strict=True)):
            message = f"low {list(self.low)} and high {list(self.high)}; expected low <= high"
            raise ControlError(message)
        if np.shape(self.trim_delta) != (m,) or not np.isfinite(self.trim_delta).all():
            message = f"trim_delta is {self.trim_delta}; expected {m} finite numbers"
            raise ControlError(message)
        if self.prior is not None:
            shapes = np.shape(self.prior.a), np.shape(self.prior.b)
            if shapes != ((len(STATES), len(STATES)), (len(STATES), m)):
                message = f"a prior of shapes {shapes}; expected (9, 9) and (9, {m})"
                raise ControlError(message)

    @cached_property
    def effectors_from_surfaces(self) -> Array:
        """Matrix (m, s): effector deflections = this @ surface positions."""
        found: Array = np.asarray(np.linalg.inv(self.mixing).round(12) + 0.0, dtype=np.float64)
        return found

    @cached_property
    def preferred(self) -> Array:
        """Surface positions (s,) of the trim, within the limits [rad]."""
        trim: Array = np.asarray(self.mixing @ self.trim_delta, dtype=np.float64)
        found: Array = np.minimum(np.maximum(trim, np.array(self.low)), np.array(self.high))
        return found
