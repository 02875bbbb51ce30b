"""What the plant's parts exchange: names, one instant of flight, a linear model, the actuators' limits.

SI units and radians; body axes forward-right-down. The state and effector orders are those of eqs 25 and 26 (Ward et
al., 1994); eq 26 prints its fifth effector as a second rudder, which is read here as the symmetric flap.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

STATES: tuple[str, ...] = ("u", "v", "w", "P", "Q", "R", "Phi", "Theta", "Psi")
"""Body velocities [m/s], body rates [rad/s], Euler angles [rad] (eq 25)."""

EFFECTORS: tuple[str, ...] = ("de", "dr", "ddt", "ddf", "dsf", "dte", "dtr")
"""Symmetric tail, rudder, differential tail, differential flap, symmetric flap, thrust-vector pitch, yaw (eq 26)."""

SURFACES: tuple[str, ...] = (
    "left_stabilator",
    "right_stabilator",
    "left_flaperon",
    "right_flaperon",
    "rudder",
    "nozzle_pitch",
    "nozzle_yaw",
)
"""What can be damaged, one actuator each."""

SURFACES_OF: Mapping[str, tuple[str, ...]] = {
    "de": ("left_stabilator", "right_stabilator"),
    "dr": ("rudder",),
    "ddt": ("left_stabilator", "right_stabilator"),
    "ddf": ("left_flaperon", "right_flaperon"),
    "dsf": ("left_flaperon", "right_flaperon"),
    "dte": ("nozzle_pitch",),
    "dtr": ("nozzle_yaw",),
}
"""The surfaces that an effector moves."""

EFFECTORS_FROM_SURFACES: Array = np.array(
    [
        [0.5, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0],
        [0.5, -0.5, 0.0, 0.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 0.5, -0.5, 0.0, 0.0, 0.0],
        [0.0, 0.0, 0.5, 0.5, 0.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0],
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0],
    ]
)
"""Matrix (7, 7): effector deflections = this @ surface positions."""

PILOT_STATION: tuple[float, float] = (12.0 * 0.3048, 2.76 * 0.3048)
"""The pilot's eye point [m]: forward of, and above, the centre of mass (l1, l2 of eq 20)."""


TURBULENCE: Mapping[str, int] = MappingProxyType({"none": 0, "light": 3, "moderate": 4, "severe": 6})
"""Curves of figure 7 of MIL-F-8785C by name: exceeded with a probability of 1e-2, 1e-3, 1e-5; 0 is still air."""


class PlantError(ValueError):
    """The plant was asked for something it cannot do; says what was found and what was expected."""


@dataclass(frozen=True)
class Sample:
    """One instant of flight.

    Attributes
    ----------
    time : float
        Simulated time since the start [s].
    x : ndarray, shape (9,)
        States in the order of `STATES` [m/s, rad/s, rad]; Psi is continuous (not wrapped). In turbulence the
        velocities are those that the `Aircraft` was asked for; body rates are inertial.
    xdot : ndarray, shape (9,)
        Their time derivatives [m/s^2, rad/s^2, rad/s], of the velocities without the gusts' acceleration.
    delta : ndarray, shape (7,)
        Measured deflections in the order of `EFFECTORS` [rad]: where the actuators are, damaged or not.
    """

    time: float
    x: Array
    xdot: Array
    delta: Array


@dataclass(frozen=True)
class LinearTruth:
    """The tangent of the equations of motion at one instant: ``xdot = a @ x + b @ delta + bias``.

    Attributes
    ----------
    time : float
        Instant of the tangent [s].
    a : ndarray, shape (9, 9)
        State matrix.
    b : ndarray, shape (9, 7)
        Effector matrix, per rad of measured deflection, damage included.
    bias : ndarray, shape (9,)
        What is left of `xdot` at this instant.
    """

    time: float
    a: Array
    b: Array
    bias: Array


@dataclass(frozen=True)
class Actuator:
    """First-order actuator with limits.

    Attributes
    ----------
    bandwidth : float
        Corner frequency [rad/s].
    rate_limit : float
        Largest speed of the surface [rad/s].
    low, high : float
        Position limits [rad]. Two effectors on one pair of surfaces (de and ddt, dsf and ddf) share them.
    """

    bandwidth: float
    rate_limit: float
    low: float
    high: float


def actuator_gain(rate_hz: float, bandwidth: float = 20.0) -> float:
    """Rms of an actuator's position over the rms of a white command held between samples.

    Parameters
    ----------
    rate_hz : float
        Rate at which a new independent command value arrives [Hz].
    bandwidth : float
        Corner frequency of the actuator [rad/s].

    Returns
    -------
    float
        ``sqrt((1 - p) / (1 + p))`` with ``p = exp(-bandwidth / rate_hz)``, at the instants of the commands and within
        the rate limit. JSBSim's discrete actuator at 100 Hz realises 5 % less.

    Raises
    ------
    PlantError
        If the rate or the bandwidth is not positive and finite.
    """
    if not (math.isfinite(rate_hz) and rate_hz > 0.0 and math.isfinite(bandwidth) and bandwidth > 0.0):
        message = f"rate {rate_hz} Hz and bandwidth {bandwidth} rad/s: expected positive finite numbers"
        raise PlantError(message)
    return math.sqrt(math.tanh(0.5 * bandwidth / rate_hz))
