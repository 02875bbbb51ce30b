"""Trim by least squares: the attitude, throttle and deflections at which nothing accelerates."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np

from msls_ros.plant.airframe import ACTUATORS
from msls_ros.plant.conditions import FlightCondition
from msls_ros.plant.definition import OWN_MODEL
from msls_ros.plant.interface import Array, PlantError
from msls_ros.plant.model import FOOT, Model, Surroundings
from msls_ros.plant.stock import StockModel

NOZZLE_SHARE = 0.5
"""Thrust-vector pitch per symmetric-tail deflection in trim [1]."""

_UNKNOWN_SCALE = 0.1
_STEP = 1e-5
_TOLERANCE = 1e-9
_ACCEPTED = 1e-6


@dataclass(frozen=True)
class Trim:
    """A steady flight.

    Attributes
    ----------
    condition : FlightCondition
        What was asked for.
    x : ndarray, shape (9,)
        States [m/s, rad/s, rad].
    delta : ndarray, shape (7,)
        Effector deflections [rad].
    throttle : float
        Throttle command [1]; 0.5 is full dry thrust.
    place : tuple of float
        Altitude [ft] and geodetic latitude [rad].
    flight_path_angle : float
        Climb angle [rad].
    residual : float
        Largest magnitude left in the six accelerations [m/s^2, rad/s^2].
    """

    condition: FlightCondition
    x: Array
    delta: Array
    throttle: float
    place: tuple[float, float]
    flight_path_angle: float
    residual: float

    @property
    def alpha(self) -> float:
        """Angle of attack [rad]."""
        return math.atan2(self.x[2], self.x[0])

    @property
    def airspeed(self) -> float:
        """True airspeed [m/s]."""
        return math.sqrt(float(np.sum(self.x[:3] ** 2)))


def gauss_newton(function: Callable[[Array], Array], start: Array, *, tolerance: float, iterations: int = 60) -> Array:
    """Minimise ``|function(z)|`` by Gauss-Newton steps, halved until they reduce it.

    Parameters
    ----------
    function : callable
        Residual vector of the unknowns.
    start : ndarray
        First guess of the unknowns, of order one each.
    tolerance : float
        Stop when the largest residual is below this.
    iterations : int
        Give up after this many steps.

    Returns
    -------
    ndarray
        The unknowns.
    """
    z = start.copy()
    residual = function(z)
    for _ in range(iterations):
        if np.max(np.abs(residual)) < tolerance:
            break
        jacobian = np.empty((residual.size, z.size))
        for i in range(z.size):
            offset = np.zeros(z.size)
            offset[i] = _STEP
            jacobian[:, i] = (function(z + offset) - function(z - offset)) / (2.0 * _STEP)
        step = np.linalg.lstsq(jacobian, -residual, rcond=None)[0]
        damping = 1.0
        while damping > 1e-4:
            candidate = function(z + damping * step)
            if np.sum(candidate**2) < np.sum(residual**2):
                break
            damping *= 0.5
        else:
            break
        z, residual = z + damping * step, candidate
    return z


@cache
def find_trim(condition: FlightCondition) -> Trim:
    """Find the steady straight flight of a condition.

    The unknowns are pitch attitude and flight path (or alpha, in level flight), throttle, symmetric tail (the nozzle
    follows with half of it), and the small bank, differential flap and rudder that the turning earth asks for.

    Parameters
    ----------
    condition : FlightCondition
        Altitude, Mach number and angle of attack, or level flight.

    Returns
    -------
    Trim
        Computed once per process and condition.

    Raises
    ------
    PlantError
        If the aircraft cannot fly steadily there.
    """
    _check(condition)
    if condition.airframe.model != OWN_MODEL:
        return _found_by_jsbsim(condition)
    model = Model(condition, 100, ideal=True)
    speed = (condition.mach or math.nan) * model.speed_of_sound()
    place = (condition.altitude / FOOT, 0.0)

    def unpack(z: Array) -> tuple[Array, Array, float]:
        angle, throttle, tail, bank, flap, rudder = (float(value) for value in z * _UNKNOWN_SCALE)
        alpha = angle if condition.alpha is None else condition.alpha
        x = np.array([speed * math.cos(alpha), 0.0, speed * math.sin(alpha), 0.0, 0.0, 0.0, bank, angle, 0.0])
        return x, np.array([tail, rudder, 0.0, flap, 0.0, NOZZLE_SHARE * tail, 0.0]), throttle

    def accelerations(z: Array) -> Array:
        x, delta, throttle = unpack(z)
        model.surround(Surroundings(place, throttle, (1.0,) * 7, (0.0,) * 7))
        model.put(x.tolist(), delta.tolist())
        return model.derivative()[:6]

    pitch = 0.05 if condition.alpha is None else 0.75 * condition.alpha
    z = gauss_newton(accelerations, np.array([pitch, 0.4, 0.0, 0.0, 0.0, 0.0]) / _UNKNOWN_SCALE, tolerance=_TOLERANCE)
    residual = float(np.max(np.abs(accelerations(z))))
    x, delta, throttle = unpack(z)
    within = all(a.low <= d <= a.high for a, d in zip(ACTUATORS, delta.tolist(), strict=True))
    if not (residual < _ACCEPTED and within and 0.0 <= throttle <= 1.0):
        message = (
            f"no trim for {condition.name}: {residual:.3g} m/s^2 or rad/s^2 remain at throttle {throttle:.2f} and "
            f"{math.degrees(delta[0]):.1f} deg of tail, expected less than {_ACCEPTED:g} within the limits"
        )
        raise PlantError(message)
    x.setflags(write=False)
    delta.setflags(write=False)
    gamma = float(x[7]) - math.atan2(x[2], x[0])
    return Trim(condition, x, delta, throttle, place, gamma, residual)


def _found_by_jsbsim(condition: FlightCondition) -> Trim:
    """Return the trim of a derived aircraft."""
    airframe = condition.airframe
    model = StockModel(condition, max(100, airframe.least_rate))
    x, delta = model.state(), airframe.effectors_from_surfaces @ model.positions()
    x.setflags(write=False)
    delta.setflags(write=False)
    now = model.surroundings()
    gamma = float(x[7]) - math.atan2(x[2], x[0])
    residual = float(np.abs(model.derivative()[:6]).max())
    return Trim(condition, x, delta, now.throttle, (now.place[0], now.place[1]), gamma, residual)


def _check(condition: FlightCondition) -> None:
    alpha = 0.0 if condition.alpha is None else condition.alpha
    speed = condition.mach if condition.airspeed is None else condition.airspeed
    speed = math.nan if speed is None else speed
    numbers = (condition.altitude, speed, alpha, condition.ballast, condition.leading_edge_flap, condition.gamma)
    if not all(math.isfinite(value) for value in numbers) or speed <= 0.0 or condition.ballast < 0.0:
        message = f"condition {condition.name}: {numbers}, expected finite numbers, Mach above 0, ballast not below 0"
        raise PlantError(message)
