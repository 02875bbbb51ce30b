"""One JSBSim flight dynamics model behind SI units: put it anywhere, read it anywhere."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import jsbsim
import numpy as np

from msls_ros.plant import airframe
from msls_ros.plant.conditions import FlightCondition
from msls_ros.plant.interface import Array, PlantError

FOOT = 0.3048
_X = (
    "velocities/u-fps",
    "velocities/v-fps",
    "velocities/w-fps",
    "velocities/p-rad_sec",
    "velocities/q-rad_sec",
    "velocities/r-rad_sec",
    "attitude/phi-rad",
    "attitude/theta-rad",
    "attitude/psi-rad",
)
_XDOT = (
    "accelerations/udot-ft_sec2",
    "accelerations/vdot-ft_sec2",
    "accelerations/wdot-ft_sec2",
    "accelerations/pdot-rad_sec2",
    "accelerations/qdot-rad_sec2",
    "accelerations/rdot-rad_sec2",
    "velocities/phidot-rad_sec",
    "velocities/thetadot-rad_sec",
    "velocities/psidot-rad_sec",
)
_AIR_RELATIVE = (
    "velocities/u-aero-fps",
    "velocities/v-aero-fps",
    "velocities/w-aero-fps",
    "velocities/p-aero-rad_sec",
    "velocities/q-aero-rad_sec",
    "velocities/r-aero-rad_sec",
)
_PLACE = ("position/h-sl-ft", "position/lat-geod-rad")
_TURBULENCE = tuple(f"atmosphere/turb-{axis}-fps" for axis in ("north", "east", "down"))
_MEAN_WIND = tuple(f"atmosphere/wind-{axis}-fps" for axis in ("north", "east", "down"))
_GUST = tuple(f"atmosphere/gust-{axis}-fps" for axis in ("north", "east", "down"))
_TURBULENCE_RATES = tuple(f"atmosphere/{axis}-turb-rad_sec" for axis in ("p", "q", "r"))
_SET_GUST_RATES = tuple(f"wind/{axis}-rad_sec" for axis in ("p", "q", "r"))
_IC_PLACE = ("ic/h-sl-ft", "ic/lat-geod-rad")
_IC_ATTITUDE = ("ic/phi-rad", "ic/theta-rad", "ic/psi-true-rad")
_IC_VELOCITY = ("ic/u-fps", "ic/v-fps", "ic/w-fps")
_IC_RATES = ("ic/p-rad_sec", "ic/q-rad_sec", "ic/r-rad_sec")
# JSBSim's own Dryden filters by the bilinear transformation; its default, 3, has first-order v and w gusts.
_TUSTIN = 4
_STREAM = 0x6057
# JSBSim's generator is the minimal standard one: seeds 1 to this, and 0 is the same as 1.
_GENERATOR_SEEDS = 2**31 - 2
SI = np.array([FOOT, FOOT, FOOT, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0])
"""Units of the model's states in m, s and rad."""


@dataclass(frozen=True)
class Surroundings:
    """What the accelerations depend on besides states and effectors.

    Attributes
    ----------
    place : tuple of float
        Altitude [ft] and geodetic latitude [rad].
    throttle : float
        Throttle command [1]; 0.5 is full dry thrust, above it the afterburner works. The engine has settled at it.
    effectiveness, bias : tuple of float
        Damage by surface: what is left [1], added deflection [rad].
    wind : tuple of float
        Speed of the air to the north, to the east, down [ft/s].
    wind_rates : tuple of float
        Rotation of the air about the body axes [rad/s].
    held : tuple of float
        Of a derived aircraft: what its aerodynamics read of its flight controls besides the surfaces.
    levers, rpm, pressures : tuple of float
        Of a derived aircraft: throttles, mixtures, propeller levers [1], propeller speed [rev/min], manifold pressure
        of piston engines [Pa].
    """

    place: tuple[float, ...]
    throttle: float
    effectiveness: tuple[float, ...]
    bias: tuple[float, ...]
    wind: tuple[float, ...] = (0.0, 0.0, 0.0)
    wind_rates: tuple[float, ...] = (0.0, 0.0, 0.0)
    held: tuple[float, ...] = ()
    levers: tuple[float, ...] = ()
    rpm: tuple[float, ...] = ()
    pressures: tuple[float, ...] = ()


class Model:
    """A flight dynamics model of the F-16/MATV at one loading; `stock.StockModel` is one of any other aircraft.

    Parameters
    ----------
    condition : FlightCondition
        Ballast and leading-edge flap are taken from it.
    rate : int
        Steps per second [Hz].
    ideal : bool
        Actuators without lag, rate limits and position limits.
    """

    def __init__(self, condition: FlightCondition, rate: int, *, ideal: bool = False) -> None:
        self._condition, self._ideal = condition, ideal
        self._fdm = self._load(rate)
        self._manager = self._fdm.get_property_manager()
        self._x = self._nodes(_X)
        self._xdot = self._nodes(_XDOT)
        surfaces, effectors = condition.airframe.surface_names, condition.airframe.effectors
        self._positions = self._nodes([f"surfaces/{name}-pos-rad" for name in surfaces])
        self._commands = self._nodes([f"fcs/{name}-cmd-rad" for name in effectors])
        self._effectiveness = self._nodes([f"damage/{name}-effectiveness" for name in surfaces])
        self._bias = self._nodes([f"damage/{name}-bias-rad" for name in surfaces])
        self._stuck = self._nodes([f"surfaces/{name}-pos-rad/malfunction/fail_stuck" for name in surfaces])
        self._driven = self._nodes([f"damage/{name}-driven" for name in surfaces])
        self._driven_to = self._nodes([f"damage/{name}-position-rad" for name in surfaces])
        self._throttle = self._nodes(["fcs/throttle-cmd-norm"])
        self._place = self._nodes(_PLACE)
        self._wind = self._nodes(_TURBULENCE)
        self._wind_rates = self._nodes(_TURBULENCE_RATES)
        self._air_relative = self._nodes(_AIR_RELATIVE)
        self._set_wind = self._nodes((*_GUST, *_SET_GUST_RATES))
        self._ic_place = self._nodes(_IC_PLACE)
        self._ic_state = self._nodes((*_IC_ATTITUDE, *_IC_VELOCITY, *_IC_RATES))
        self._blown: tuple[float, ...] = (0.0, 0.0, 0.0)
        self.run = self._fdm.run
        self._start(condition)

    def _load(self, rate: int) -> jsbsim.FGFDMExec:
        return airframe.load(self._condition.ballast, rate, ideal=self._ideal)

    def _nodes(self, paths: Sequence[str]) -> tuple[airframe.Node, ...]:
        return tuple(self._node(path) for path in paths)

    def _node(self, path: str) -> airframe.Node:
        node = self._manager.get_node(path)
        if node is None:
            message = f"JSBSim has no property {path}: expected JSBSim 1.3 and the aircraft's own properties"
            raise PlantError(message)
        return node

    def _start(self, condition: FlightCondition) -> None:
        self._fdm.set_property_value("fcs/lef-pos-rad", condition.leading_edge_flap)
        self._fdm.set_property_value("propulsion/fuel_freeze", 1.0)
        self._ic_place[0].set_double_value(condition.altitude / FOOT)
        self._ic_state[3].set_double_value(500.0)
        self._initialise()
        self._fdm.set_property_value("propulsion/set-running", -1)

    def _initialise(self) -> None:
        try:
            started = self._fdm.run_ic()
        except jsbsim.BaseError as error:
            message = f"JSBSim cannot start the model: {' '.join(str(error).split())}"
            raise PlantError(message) from error
        if not started:
            message = "JSBSim cannot start from the initial condition: expected finite states and commands"
            raise PlantError(message)

    def stir(self, severity: int, seed: int) -> None:
        """Switch on the Dryden turbulence of MIL-F-8785C, which starts from still air.

        The gusts of u and v go along and across the mean wind [JSBSim, FGWinds]. In still air its direction would be
        that of rounding errors of the trim (1e-14 m/s, another one with another BLAS), so it is set: from the south.

        Parameters
        ----------
        severity : int
            Curve of figure 7 of MIL-F-8785C, 1 to 7.
        seed : int
            At least 0; flights with different seeds meet different gusts.
        """
        for path in (*_MEAN_WIND, "atmosphere/psiw-rad"):
            self._fdm.set_property_value(path, 0.0)
        start = int(np.random.SeedSequence([_STREAM, seed]).generate_state(1)[0]) % _GENERATOR_SEEDS + 1
        self._fdm.set_property_value("atmosphere/randomseed", start)
        self._fdm.set_property_value("atmosphere/turb-type", _TUSTIN)
        self._fdm.set_property_value("atmosphere/turbulence/milspec/severity", severity)

    def blow(self, wind: Sequence[float]) -> None:
        """Set the speed of the air to the north, to the east, down [m/s], besides the turbulence."""
        self._blown = tuple(value / FOOT for value in wind)
        for node, value in zip(self._set_wind, self._blown, strict=False):
            node.set_double_value(value)

    def speed_of_sound(self) -> float:
        """Speed of sound where the model is [m/s]."""
        return float(self._fdm.get_property_value("atmosphere/a-fps")) * FOOT

    def surroundings(self) -> Surroundings:
        """Return what the accelerations depend on now, besides states and effectors."""
        return Surroundings(
            place=tuple(node.get_double_value() for node in self._place),
            throttle=self._throttle[0].get_double_value(),
            effectiveness=tuple(node.get_double_value() for node in self._effectiveness),
            bias=tuple(node.get_double_value() for node in self._bias),
            wind=tuple(node.get_double_value() + add for node, add in zip(self._wind, self._blown, strict=True)),
            wind_rates=tuple(node.get_double_value() for node in self._wind_rates),
        )

    def surround(self, surroundings: Surroundings) -> None:
        """Take over the surroundings; the next `put` uses them."""
        for nodes, values in (
            (self._ic_place, surroundings.place),
            (self._throttle, (surroundings.throttle,)),
            (self._effectiveness, surroundings.effectiveness),
            (self._bias, surroundings.bias),
            (self._set_wind, (*surroundings.wind, *surroundings.wind_rates)),
        ):
            for node, value in zip(nodes, values, strict=True):
                node.set_double_value(value)

    def put(self, x: Sequence[float], delta: Sequence[float]) -> None:
        """Set states (9,) [m/s, rad/s, rad] and effector commands (m,) [rad], and compute the forces there.

        The actuators are where they are told to be: JSBSim lets them pass their commands while it trims.
        """
        self.command(delta)
        self.place(x)

    def place(self, x: Sequence[float]) -> None:
        """Set states (9,) [m/s, rad/s, rad] under the effector commands as they are, and compute the forces there."""
        u, v, w, p, q, r, phi, theta, psi = x
        values = (phi, theta, math.fmod(psi, 2.0 * math.pi), u / FOOT, v / FOOT, w / FOOT, p, q, r)
        for node, value in zip(self._ic_state, values, strict=True):
            node.set_double_value(value)
        self._fdm.set_trim_status(True)
        self._initialise()
        self._fdm.set_trim_status(False)

    def begin(self, x: Array, delta: Array, throttle: float, place: tuple[float, float]) -> None:
        """Stand in the trim, ready to fly: states, deflections, throttle and place of a `Trim`."""
        m = len(self._positions)
        self.surround(Surroundings(place, throttle, (1.0,) * m, (0.0,) * m))
        self.put(x.tolist(), delta.tolist())

    def respond(self, delta: Sequence[float]) -> None:
        """Compute the forces with other effector commands (m,) [rad] where the last `put` was, at half its price."""
        self.command(delta)
        self._again()

    def _again(self) -> None:
        self._fdm.set_trim_status(True)
        self._fdm.suspend_integration()
        self.run()
        self._fdm.resume_integration()
        self._fdm.set_trim_status(False)

    def command(self, delta: Sequence[float]) -> None:
        """Set the effector commands (m,) [rad]."""
        for node, value in zip(self._commands, delta, strict=True):
            node.set_double_value(value)

    def state(self) -> Array:
        """States (9,) [m/s, rad/s, rad]; Psi in 0..2 pi."""
        values: Array = np.array([node.get_double_value() for node in self._x]) * SI
        return values

    def heading(self) -> float:
        """Psi in 0..2 pi [rad]."""
        return float(self._x[8].get_double_value())

    def derivative(self) -> Array:
        """Time derivatives of the states (9,) [m/s^2, rad/s^2, rad/s]."""
        values: Array = np.array(self.readings()) * SI
        return values

    def readings(self) -> list[float]:
        """Time derivatives of the states (9,) in units of the model; times `SI` they are `derivative`."""
        return [node.get_double_value() for node in self._xdot]

    def velocity(self) -> Array:
        """Velocity against the air (3,) [m/s]."""
        return self.air_relative()[:3]

    def consistent(self, readings: Array, _velocities: Array) -> Array:
        """Return derivatives that agree with the rates of incidence: here nothing reads these."""
        return readings

    def air_relative(self) -> Array:
        """Body velocities and rates relative to the air (6,) [m/s, rad/s]."""
        values: Array = np.array([node.get_double_value() for node in self._air_relative]) * SI[:6]
        return values

    def positions(self) -> Array:
        """Positions of the surfaces (n,) [rad]."""
        return np.array([node.get_double_value() for node in self._positions])

    def damage_of(self, surface: int) -> tuple[float, float]:
        """What is left of the effect of one surface [1], and its added deflection [rad]."""
        return self._effectiveness[surface].get_double_value(), self._bias[surface].get_double_value()

    def set_stuck(self, surface: int, stuck: bool) -> None:
        """Let the actuator of one surface stay where it is, or follow its command again."""
        self._stuck[surface].set_double_value(float(stuck))

    def drive(self, surface: int, position: float | None) -> None:
        """Drive the actuator of one surface to a position [rad], or let it follow its command again (None)."""
        self._driven_to[surface].set_double_value(position or 0.0)
        self._driven[surface].set_double_value(float(position is not None))

    def set_damage(self, surface: int, effectiveness: float, bias: float) -> None:
        """Damage one surface: what is left of its effect [1], added deflection [rad]."""
        self._effectiveness[surface].set_double_value(effectiveness)
        self._bias[surface].set_double_value(bias)
