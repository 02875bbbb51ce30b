"""The pilot of derived aircraft: light rate damping and attitude hold about the trim, and the inputs of flight test.

Pitch, roll and yaw effector each carry one loop; with all gains zero it is the aircraft alone, open loop::

    pitch: input + k_theta (Theta - Theta0) + k_q Q
    roll:  input - k_phi Phi - k_p P                            (k_phi is released while a roll input is made)
    yaw:   input + k_r (R - (g / V) sin(Phi))

with gains for effectors that pitch down, roll right and yaw left when positive; a gain of the other sign serves others.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from msls_ros.plant.definition import AttitudeHold
from msls_ros.plant.flight_test import PITCH, ROLL, YAW, FlightTest
from msls_ros.plant.interface import STATES, Array, LinearTruth, PlantError
from msls_ros.plant.manoeuvres import Manoeuvre
from msls_ros.plant.pilot import Pilot
from msls_ros.plant.trim import Trim

_GRAVITY = 9.80665


class AttitudePilot:
    """Flies a manoeuvre about a trim.

    Parameters
    ----------
    trim : Trim
        The steady flight to hold.
    gains : AttitudeHold
        Of the airframe.
    manoeuvre : Manoeuvre
        What to do: a `FlightTest`, or one that says how fast to roll.
    """

    def __init__(self, trim: Trim, gains: AttitudeHold, manoeuvre: Manoeuvre) -> None:
        self._trim, self._gains, self._manoeuvre = trim, gains, manoeuvre
        airframe = trim.condition.airframe
        self._axes = [airframe.effectors.index(name) for name in airframe.axes]
        self._theta, self._phi = float(trim.x[7]), float(trim.x[6])
        self._input = np.zeros(3)
        self._time: float | None = None

    def command(self, time: float, x: npt.ArrayLike) -> Array:
        """Effector commands for the present instant.

        Parameters
        ----------
        time : float
            Simulated time [s]; the lag of the pilot's inputs runs on it. Going back starts anew.
        x : array_like, shape (9,)
            Measured states in the order of `STATES` [m/s, rad/s, rad].

        Returns
        -------
        ndarray, shape (m,)
            Commanded deflections in the order of the effectors [rad].

        Raises
        ------
        PlantError
            If the time or the states are not finite or the states are not nine.
        """
        state = checked_state(time, x)
        u, v, w, p, q, r, phi, theta, _ = state.tolist()
        k = self._gains
        test = self._manoeuvre if isinstance(self._manoeuvre, FlightTest) else None
        stick = (0.0, 0.0, 0.0) if test is None else test.stick(time)
        self._follow_stick(time, np.array(stick))
        rolling = self._manoeuvre.active(time) if test is None else stick[ROLL] != 0.0
        turn = _GRAVITY / max(math.sqrt(u * u + v * v + w * w), 1.0) * math.sin(phi)
        hold = k.phi * (k.roll_release if rolling else 1.0)
        rate = p - self._manoeuvre.roll_rate(time)
        delta: Array = self._trim.delta.copy()
        delta[self._axes[PITCH]] += self._input[PITCH] + k.theta * (theta - self._theta) + k.q * q
        delta[self._axes[ROLL]] += self._input[ROLL] - hold * (phi - self._phi) - k.p * rate
        delta[self._axes[YAW]] += self._input[YAW] + k.r * (r - turn)
        if test is not None and test.injects:
            delta += test.injected(time)
        return delta

    def _follow_stick(self, time: float, wanted: Array) -> None:
        if self._time is None or time < self._time or self._gains.lag <= 0.0:
            self._input = wanted if self._gains.lag <= 0.0 else np.zeros(3)
        else:
            self._input += -math.expm1(-(time - self._time) / self._gains.lag) * (wanted - self._input)
        self._time = time


class InputPilot:
    """The F-16's pilot who makes the inputs of flight test on top of the stability augmentation."""

    def __init__(self, pilot: Pilot, manoeuvre: FlightTest) -> None:
        self._pilot, self._manoeuvre = pilot, manoeuvre
        airframe = manoeuvre.airframe
        self._axes = [airframe.effectors.index(name) for name in airframe.axes]

    def command(self, time: float, x: npt.ArrayLike) -> Array:
        """Effector commands for the present instant; as `Pilot.command`."""
        delta = self._pilot.command(time, x) + self._manoeuvre.injected(time)
        delta[self._axes] += self._manoeuvre.stick(time)
        return delta


def checked_state(time: float, x: npt.ArrayLike) -> Array:
    """Return measured states as an array.

    Raises
    ------
    PlantError
        If they are not nine finite numbers, or the time is not finite.
    """
    state = np.asarray(x, dtype=np.float64)
    if state.shape != (len(STATES),) or not (np.isfinite(state).all() and math.isfinite(time)):
        message = f"measured states {state} at {time} s: expected {len(STATES)} finite numbers"
        raise PlantError(message)
    return state


AnyPilot = Pilot | AttitudePilot | InputPilot


def make_pilot(trim: Trim, truth_at_trim: LinearTruth, manoeuvre: Manoeuvre) -> AnyPilot:
    """Return the pilot of an aircraft.

    Parameters
    ----------
    trim : Trim
        The steady flight to hold.
    truth_at_trim : LinearTruth
        The linear model there.
    manoeuvre : Manoeuvre
        What to fly.
    """
    gains = trim.condition.airframe.pilot
    if gains is not None:
        return AttitudePilot(trim, gains, manoeuvre)
    pilot = Pilot(trim, truth_at_trim, manoeuvre)
    return InputPilot(pilot, manoeuvre) if isinstance(manoeuvre, FlightTest) else pilot
