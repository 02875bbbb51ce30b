"""The flying aircraft: step it with effector commands, sample it, damage it, ask for its truth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from msls_ros.plant.conditions import FlightCondition
from msls_ros.plant.faults import check_damage, check_hard_over
from msls_ros.plant.interface import TURBULENCE, LinearTruth, PlantError, Sample
from msls_ros.plant.model import Surroundings
from msls_ros.plant.stock import make_model
from msls_ros.plant.trim import find_trim
from msls_ros.plant.truth import Twin

_PSI = 8
_STREAM = 0x6057
GUST_LENGTH = 150.0
"""Scale of the gusts [m]."""


@dataclass(frozen=True)
class _Ramp:
    """Damage of a surface on its way: effectiveness [1] and bias [rad] at two times [s]."""

    start: float
    end: float
    before: tuple[float, float]
    after: tuple[float, float]

    def at(self, time: float) -> tuple[float, float]:
        if time >= self.end:
            return self.after
        part = (time - self.start) / (self.end - self.start)
        effectiveness, bias = (a + part * (b - a) for a, b in zip(self.before, self.after, strict=True))
        return effectiveness, bias


class Gusts:
    """First-order lateral and vertical gusts.

    Parameters
    ----------
    rms : float
        Of each [m/s].
    way : float
        Flown in one step [m].
    seed : int
        From 0.
    """

    def __init__(self, rms: float, way: float, seed: int) -> None:
        self._rms, self._decay = rms, math.exp(-way / GUST_LENGTH)
        self._random = np.random.default_rng([_STREAM, seed])
        self._now = np.zeros(2)

    def step(self) -> tuple[float, float, float]:
        """Return the gust to the north, to the east and down of the next step [m/s]."""
        fresh = self._random.standard_normal(2) * self._rms
        self._now = self._decay * self._now + math.sqrt(1.0 - self._decay**2) * fresh
        down, east = self._now.tolist()
        return 0.0, east, down


class Aircraft:
    """An aircraft in flight, starting in trim at time 0. The same calls give the same bits.

    Parameters
    ----------
    condition : FlightCondition
        Where it starts.
    rate : int
        Steps per second [Hz], 50 to 1000.
    turbulence : str
        A name of `TURBULENCE`: Dryden gusts of MIL-F-8785C.
    seed : int
        Of the gusts, from 0; the same seed gives the same gusts.
    velocities : str
        What `u`, `v`, `w` of a sample are in turbulence: of the aircraft in the "air", as air data give them, or
        "inertial". In still air they are the same.
    gusts : float
        Rms of vertical and of lateral gusts with a length of 150 m [m/s], first-order, whatever the height.

    Raises
    ------
    PlantError
        If the condition cannot be trimmed or another argument is none of those described.

    Notes
    -----
    States, derivatives and deflections of a sample belong to one instant. There is no reset: build a new aircraft.

    Turbulence blows at the centre of mass and turns the air about it. It starts from still air and reaches its
    strength in some 1750 ft / airspeed: 7 s at high alpha. Body rates are always inertial. Derivatives of `u`, `v`,
    `w` are always those without the gusts' own acceleration: specific force and gravity, less ``rates x velocities``
    with the velocities of the sample. With "air" velocities the turning of the air is all that a model of x and delta
    does not know; with "inertial" ones the gusts themselves are. A pilot who sees only inertial ones cannot hold the
    high angle of attack inside the aerodynamic tables.
    """

    def __init__(
        self,
        condition: FlightCondition,
        *,
        rate: int = 100,
        turbulence: str = "none",
        seed: int = 0,
        velocities: str = "air",
        gusts: float = 0.0,
    ) -> None:
        if isinstance(rate, bool) or not isinstance(rate, int) or not 50 <= rate <= 1000:
            message = f"rate {rate!r}: expected a whole number of steps per second from 50 to 1000"
            raise PlantError(message)
        if turbulence not in TURBULENCE:
            message = f"unknown turbulence {turbulence!r}: expected one of {', '.join(TURBULENCE)}"
            raise PlantError(message)
        if isinstance(seed, bool) or not isinstance(seed, int) or seed < 0:
            message = f"seed {seed!r}: expected a whole number of at least 0"
            raise PlantError(message)
        if velocities not in ("air", "inertial"):
            message = f"velocities {velocities!r}: expected air or inertial"
            raise PlantError(message)
        if not (isinstance(gusts, (int, float)) and 0.0 <= gusts <= 30.0):
            message = f"gusts {gusts!r} m/s: expected a number from 0 to 30"
            raise PlantError(message)
        self.trim = find_trim(condition)
        self.rate = rate
        self._steps = 0
        self._air_data = velocities == "air" and (TURBULENCE[turbulence] > 0 or gusts > 0.0)
        self._gusts = Gusts(gusts, self.trim.airspeed / rate, seed) if gusts else None
        self.airframe = condition.airframe
        self._effectors_from_surfaces = self.airframe.effectors_from_surfaces
        self._model = make_model(condition, rate)
        self._model.begin(self.trim.x, self.trim.delta, self.trim.throttle, self.trim.place)
        if TURBULENCE[turbulence]:
            self._model.stir(TURBULENCE[turbulence], seed)
        self._psi = float(self.trim.x[_PSI])
        self._twin: Twin | None = None
        self._ramps: dict[int, _Ramp] = {}

    @property
    def time(self) -> float:
        """Simulated time since the start [s]."""
        return self._steps / self.rate

    def step(self, command: npt.ArrayLike) -> None:
        """Fly one step with effector commands.

        Parameters
        ----------
        command : array_like, shape (m,)
            Commanded deflections in the order of the airframe's effectors [rad]; the surfaces' limits apply.

        Raises
        ------
        PlantError
            If the command is not a finite number of each effector; the flight is then untouched. If the flight has
            diverged.
        """
        self._model.command(_checked(command, self.airframe.effectors))
        if self._ramps:
            self._advance_ramps((self._steps + 1) / self.rate)
        if self._gusts is not None:
            self._model.blow(self._gusts.step())
        self._model.run()
        self._steps += 1
        psi = self._model.heading()
        turn = 2.0 * math.pi
        self._psi += (psi - self._psi + math.pi) % turn - math.pi
        if not math.isfinite(self._psi):
            cause = f"is {self.rate} steps per second too slow for {self.airframe.name}, or the flight lost?"
            message = f"the flight diverged at {self.time:.3f} s: its states are no longer numbers; {cause}"
            raise PlantError(message)

    def sample(self) -> Sample:
        """Noise-free states, derivatives and measured deflections of the present instant."""
        x = self._model.state()
        x[_PSI] = self._psi
        xdot = self._model.derivative()
        if self._air_data:
            air = self._model.air_relative()[:3]
            p, q, r = x[3:6].tolist()
            u, v, w = (x[:3] - air).tolist()
            xdot[:3] += (q * w - r * v, r * u - p * w, p * v - q * u)
            x[:3] = air
        delta = self._effectors_from_surfaces.dot(self._model.positions())
        return Sample(self.time, x, xdot, delta)

    def air_relative(self) -> npt.NDArray[np.float64]:
        """Body velocities and rates relative to the moving air (6,) [m/s, rad/s]: what the aerodynamics feel."""
        return self._model.air_relative()

    def damage(
        self,
        surface_or_effector: str,
        effectiveness: float,
        bias: float = 0.0,
        *,
        ramp: float = 0.0,
        stuck: bool = False,
        hard_over: float | None = None,
    ) -> str:
        """Damage a surface, or all surfaces of an effector, from the next step on; it replaces earlier damage.

        Parameters
        ----------
        surface_or_effector : str
            A surface or an effector of the airframe.
        effectiveness : float
            What is left of the effect of its deflection: 1 intact, 0 lost.
        bias : float
            Deflection that the damage adds to what the air feels [rad]; for an effector, of the effector.
        ramp : float
            Time over which effectiveness and bias change linearly from what they are now [s]; 0: at once.
        stuck : bool
            The surface's actuator stays where it is, from the next step on; its deflection is measured as ever.
        hard_over : float or None
            The surface's actuator is driven there, and measured there [rad]; for an effector, of the effector.

        Returns
        -------
        str
            One sentence that says what was done.

        Raises
        ------
        PlantError
            If the name is unknown or a number is out of range; nothing is then damaged.
        """
        airframe = self.airframe
        names = check_damage(airframe, surface_or_effector, effectiveness, bias, ramp, stuck)
        check_hard_over(airframe, surface_or_effector, hard_over, stuck)
        for name in names:
            surface = airframe.surface_names.index(name)
            share = 1.0
            if surface_or_effector in airframe.effectors:
                share = airframe.mixing[surface][airframe.effectors.index(surface_or_effector)]
            after = (float(effectiveness), share * float(bias))
            self._model.set_stuck(surface, stuck)
            self._model.drive(surface, None if hard_over is None else share * float(hard_over))
            self._ramps.pop(surface, None)
            if ramp:
                self._ramps[surface] = _Ramp(self.time, self.time + ramp, self._model.damage_of(surface), after)
            else:
                self._model.set_damage(surface, *after)
        left = {1.0: "intact", 0.0: "lost"}.get(float(effectiveness), f"{effectiveness:.0%} effective")
        added = f", with {bias:+.4f} rad added" if bias else ""
        held = ", stuck" if stuck else "" if hard_over is None else f", driven to {hard_over:+.4f} rad"
        until = f" over {ramp:g} s" if ramp else ""
        return f"{' and '.join(names)} {left}{added}{held}, from {self.time:.2f} s{until}"

    def _advance_ramps(self, time: float) -> None:
        for surface, ramp in tuple(self._ramps.items()):
            self._model.set_damage(surface, *ramp.at(time))
            if time >= ramp.end:
                del self._ramps[surface]

    def truth(self) -> LinearTruth:
        """Linearise the equations of motion at the present instant, damage included; the flight is not disturbed."""
        return self._get_twin().tangent(self.sample(), self._surroundings())

    def twin_derivative(self) -> npt.NDArray[np.float64]:
        """Time derivatives (9,) as the twin behind `truth` computes them: the check that the twin is one."""
        return self._get_twin().derivative(self.sample(), self._surroundings())

    def _surroundings(self) -> Surroundings:
        """What the twin needs; it moves with the air where the velocities do."""
        now = self._model.surroundings()
        return replace(now, wind=(0.0, 0.0, 0.0)) if self._air_data else now

    def _get_twin(self) -> Twin:
        if self._twin is None:
            self._twin = Twin(self.trim.condition)
        return self._twin


def _checked(command: npt.ArrayLike, effectors: Sequence[str]) -> Sequence[float]:
    m = len(effectors)
    try:
        values = np.asarray(command, dtype=np.float64)
    except (TypeError, ValueError) as error:
        message = f"a command of {command!r}: expected {m} numbers"
        raise PlantError(message) from error
    if values.shape != (m,):
        message = f"a command of shape {values.shape}: expected ({m},) for {' '.join(effectors)}"
        raise PlantError(message)
    numbers: list[float] = values.tolist()
    if not all(map(math.isfinite, numbers)):
        bad = next(name for name, value in zip(effectors, numbers, strict=True) if not math.isfinite(value))
        message = f"the command for {bad} is not a finite number: expected {m} finite numbers [rad]"
        raise PlantError(message)
    return numbers
