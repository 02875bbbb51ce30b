"""The flight dynamics model of a derived JSBSim aircraft: trimmed by JSBSim, and its ideal form for the truth."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import jsbsim
import numpy as np

from msls_ros.plant import derive
from msls_ros.plant.airframe import Node
from msls_ros.plant.conditions import FlightCondition
from msls_ros.plant.definition import OWN_MODEL
from msls_ros.plant.interface import Array, PlantError
from msls_ros.plant.model import FOOT, SI, Model, Surroundings

_KNOT_FPS = 1852.0 / 0.3048 / 3600.0
_FULL_TRIM = 1
_ACCEPTED = 0.01
_TOLERANCE = 1e-6
_TRIES = 60
_FAST, _SLOW = 2.5, 0.3
_LEVERS = ("throttle", "mixture", "advance")


class StockModel(Model):
    """A model of a derived aircraft at one loading.

    Parameters
    ----------
    condition : FlightCondition
        Where it starts, and what flies.
    rate : int
        Steps per second [Hz].
    ideal : bool
        Surfaces are where they are told to be, engines as they are told to run.

    Raises
    ------
    PlantError
        If the aircraft is wrong, or does not trim.
    """

    def __init__(self, condition: FlightCondition, rate: int, *, ideal: bool = False) -> None:
        airframe = condition.airframe
        if rate < airframe.least_rate:
            message = f"rate {rate} Hz: {airframe.name} needs at least {airframe.least_rate} steps per second"
            raise PlantError(message)
        super().__init__(condition, rate, ideal=ideal)

    def _load(self, rate: int) -> jsbsim.FGFDMExec:
        fdm, self._derived = derive.load(self._condition.airframe, self._condition.ballast, rate, ideal=self._ideal)
        return fdm

    def _start(self, condition: FlightCondition) -> None:
        fdm = self._fdm
        engines = range(fdm.get_propulsion().get_num_engines())
        self._throttle_commands = self._nodes([f"fcs/throttle-cmd-norm[{i}]" for i in engines])
        levers = [f"{lever}-{{}}-norm[{i}]" for lever in _LEVERS for i in engines]
        self._lever_commands = self._nodes([f"fcs/{lever.format('cmd')}" for lever in levers])
        self._lever_positions = self._nodes([f"fcs/{lever.format('pos')}" for lever in levers])
        self._rpm = self._those_there([f"propulsion/engine[{i}]/propeller-rpm" for i in engines])
        self._pressures = self._those_there([f"propulsion/engine[{i}]/map-pa" for i in engines])
        self._airspeed = 1.0
        self._trims = self._nodes([f"surfaces/{name}-trim-rad" for name in condition.airframe.surface_names])
        self._held = self._nodes([names[self._ideal] for names in self._derived.held])
        self._implicit = self._nodes([name for _, name in self._derived.implicit]) if self._ideal else ()
        self._slopes: list[Array] = []
        self._speeds: dict[tuple[int, bool], float] = {}
        for name, value in (("propulsion/fuel_freeze", 1.0), *_level(condition), *condition.properties):
            self._node(name).set_double_value(value)
        self._initialise()
        self._airspeed = float(np.linalg.norm(self.state()[:3]))
        fdm.set_property_value("propulsion/set-running", -1)
        if not self._ideal:
            self._trim()

    def _those_there(self, paths: Sequence[str]) -> tuple[Node, ...]:
        return tuple(node for node in map(self._manager.get_node, paths) if node is not None)

    def _trim(self) -> None:
        what = f"no trim for {self._condition.name} of {self._condition.airframe.name}"
        try:
            self._fdm.set_property_value("simulation/do_simple_trim", _FULL_TRIM)
        except jsbsim.BaseError as error:
            advice = "expected an altitude, speed and climb angle that it can hold; a retractable gear must be up"
            message = f"{what}: JSBSim finds no steady flight; {advice}"
            raise PlantError(message) from error
        left = float(np.abs(self.derivative()[:6]).max())
        if not left < _ACCEPTED:
            message = f"{what}: {left:.3g} m/s^2 or rad/s^2 remain, expected less than {_ACCEPTED:g}"
            raise PlantError(message)

    def begin(self, x: Array, delta: Array, throttle: float, place: tuple[float, float]) -> None:
        """Fly on from the trim, where it stands: what is commanded there leaves the flight controls as they are."""
        airframe = self._condition.airframe
        for node, value in zip(self._trims, np.dot(airframe.mixing, delta).tolist(), strict=True):
            node.set_double_value(value)
        self.command(delta.tolist())

    def surroundings(self) -> Surroundings:
        """Return what the accelerations depend on now, besides states and effectors."""
        now = super().surroundings()
        return Surroundings(
            now.place,
            now.throttle,
            now.effectiveness,
            now.bias,
            now.wind,
            now.wind_rates,
            held=tuple(node.get_double_value() for node in self._held),
            levers=tuple(node.get_double_value() for node in self._lever_positions),
            rpm=tuple(node.get_double_value() for node in self._rpm),
            pressures=tuple(node.get_double_value() for node in self._pressures),
        )

    def surround(self, surroundings: Surroundings) -> None:
        """Take over the surroundings; the next `put` uses them."""
        super().surround(surroundings)
        for node, value in zip(self._held, surroundings.held, strict=True):
            node.set_double_value(value)
        for node, value in zip(self._lever_commands, surroundings.levers, strict=True):
            node.set_double_value(value)
        if self._rpm:
            self._run_engines(surroundings)
        self._slopes = []

    def _run_engines(self, surroundings: Surroundings) -> None:
        """Bring manifold pressure [Pa] and propeller speed [rev/min], which JSBSim lets nobody set, to what they are.

        The pressure follows the throttle, the propeller the airspeed, both in proportion to the time step. All engines
        run alike.
        """
        step = self._fdm.get_delta_t()
        throttles = self._throttle_commands
        speed = self._airspeed
        if self._pressures:

            def open_throttle(up: bool) -> None:
                for node in throttles:
                    node.set_double_value(float(up))

            self._lead(0, self._pressures[0], surroundings.pressures[0], open_throttle)
            for node, value in zip(self._lever_commands, surroundings.levers, strict=True):
                node.set_double_value(value)

        def blow(up: bool) -> None:
            x = [speed * (_FAST if up else _SLOW), *[0.0] * 8]
            self.place(x)

        self._lead(1, self._rpm[0], surroundings.rpm[0], blow)
        self._fdm.set_dt(step)

    def _lead(self, which: int, node: Node, wanted: float, push: Callable[[bool], None]) -> None:
        """Bring a state of the engine to a value, by time steps of the size that this takes while it is pushed.

        The speed that a push of this kind gave the last time is where the next begins.
        """
        for _ in range(_TRIES):
            before = node.get_double_value()
            rest, up = wanted - before, wanted > before
            if abs(rest) <= _TOLERANCE * wanted:
                return
            speed = self._speeds.get((which, up), 0.0)
            step = min(max(abs(rest) / speed, 1e-8), 0.2) if speed else 1e-3
            push(up)
            self._fdm.set_dt(step)
            self.run()
            self._speeds[which, up] = abs(node.get_double_value() - before) / step

    def derivative(self) -> Array:
        """Time derivatives of the states (9,) [m/s^2, rad/s^2, rad/s]."""
        found = np.array([self.readings()])
        if self._implicit:
            self._slopes = self._find_slopes(found[0])
            found = self.consistent(found, np.array([self._velocity()]))
        values: Array = found[0] * SI
        return values

    def velocity(self) -> Array:
        """Velocity against the air (3,) [m/s]."""
        return np.array(self._velocity()) * FOOT

    def _velocity(self) -> list[float]:
        return [node.get_double_value() for node in self._air_relative[:3]]

    def consistent(self, readings: Array, velocities: Array) -> Array:
        """Return derivatives with which the rates of incidence that the aerodynamics read agree.

        Parameters
        ----------
        readings : ndarray, shape (n, 9)
            Time derivatives in units of the model, made with rates of incidence of zero.
        velocities : ndarray, shape (n, 3)
            Velocities against the air [ft/s].

        Returns
        -------
        ndarray, shape (n, 9)
            With the slopes found by the last `derivative`; four steps of a contraction that gains a factor of twenty.
        """
        if not self._slopes:
            return readings
        found = readings
        for _ in range(4):
            rates = _incidence_rates(velocities, found)
            found = readings.copy()
            for (source, _name), slope in zip(self._derived.implicit, self._slopes, strict=True):
                found += np.outer(rates[derive.IMPLICIT.index(source)], slope)
        return found

    def _find_slopes(self, base: Array) -> list[Array]:
        """Return what the readings gain per rate of each incidence angle; they are linear in these."""
        slopes = []
        for node in self._implicit:
            node.set_double_value(1.0)
            self._again()
            slopes.append(np.array(self.readings()) - base)
            node.set_double_value(0.0)
        self._again()
        return slopes


def _level(condition: FlightCondition) -> tuple[tuple[str, float], ...]:
    """Return the initial condition as JSBSim's properties."""
    if condition.airspeed is None:
        speed = ("ic/mach", condition.mach or math.nan)
    else:
        speed = ("ic/vc-kts", condition.airspeed / FOOT / _KNOT_FPS)
    return ("ic/h-sl-ft", condition.altitude / FOOT), speed, ("ic/gamma-deg", math.degrees(condition.gamma))


def _incidence_rates(velocities: Array, derivatives: Array) -> tuple[Array, Array]:
    """Return the rates of angle of attack and sideslip (n,) [rad/s] from velocities and their rates."""
    u, v, w = velocities.T
    u_dot, v_dot, w_dot = derivatives[:, :3].T
    plane = u * u + w * w
    alpha_dot = (u * w_dot - w * u_dot) / plane
    beta_dot = (plane * v_dot - v * (u * u_dot + w * w_dot)) / ((plane + v * v) * np.sqrt(plane))
    return alpha_dot, beta_dot


def make_model(condition: FlightCondition, rate: int, *, ideal: bool = False) -> Model:
    """Return a model of what flies in a condition."""
    own = condition.airframe.model == OWN_MODEL
    return (Model if own else StockModel)(condition, rate, ideal=ideal)
