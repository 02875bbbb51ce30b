"""A simulated aircraft in closed loop with an identifier, in this process and without ROS: for many flights.

What happens in a sample is what the nodes do in lockstep: the aircraft is measured, the identifier takes the sample,
the pilot answers, and pilot plus dither fly the aircraft to the next sample. A fault strikes between two samples.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache

import numpy as np
from numpy.typing import NDArray

from msls_ros.control import PilotCommand, Status
from msls_ros.estimation import Configuration, Dither, Estimate, EventKind, FaultEvent, Identifier
from msls_ros.flights.steering import LawPlan, Steering, Stick
from msls_ros.flights.tracking import departed
from msls_ros.plant import (
    CONDITIONS,
    Aircraft,
    Fault,
    FaultSchedule,
    FlightCondition,
    Instruments,
    LinearTruth,
    Manoeuvre,
    PlantError,
    RollDoublet,
    Sample,
    Trim,
    make_pilot,
    make_sensors,
)
from msls_ros.plant.instruments import RealSensors

Array = NDArray[np.float64]

RIGID_BODY = ("u", "v", "w", "P", "Q", "R")
"""Equations whose alarms count as such."""


@dataclass(frozen=True)
class Rates:
    """How often what happens [Hz].

    Raises
    ------
    PlantError
        At construction, for rates that do not divide; the sentence begins with the field.
    """

    flight_dynamics: int = 100
    """Steps of the flight dynamics model, 50 to 1000."""
    sensors: int = 50
    """Samples; divides `flight_dynamics`."""
    truth: int = 10
    """True models; divides `sensors`."""

    def __post_init__(self) -> None:
        """Refuse what is no rate."""
        for name, low in (("flight_dynamics", 50), ("sensors", 1), ("truth", 1)):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= 1000:
                message = f"{name} {value!r} Hz: expected a whole number from {low} to 1000"
                raise PlantError(message)
        for name, of in (("sensors", "flight_dynamics"), ("truth", "sensors")):
            if getattr(self, of) % getattr(self, name):
                message = f"{name} {getattr(self, name)} Hz: expected a divisor of {of}, {getattr(self, of)} Hz"
                raise PlantError(message)

    @property
    def period(self) -> float:
        """Time from sample to sample [s]."""
        return self.steps / self.flight_dynamics

    @property
    def steps(self) -> int:
        """Steps of the flight dynamics per sample."""
        return self.flight_dynamics // self.sensors

    @property
    def truth_every(self) -> int:
        """Samples per true model."""
        return self.sensors // self.truth


@dataclass(frozen=True)
class Flight:
    """How to fly.

    The sensors are those of the noise level; ``measure`` replaces them. The truth is taken at its rate, and at the two
    samples on either side of a fault and of the end of a ramp.
    """

    noise: str
    seed: int
    """Of sensors and turbulence."""
    duration: float
    """[s]"""
    manoeuvre: Manoeuvre = field(default_factory=RollDoublet)
    faults: tuple[Fault, ...] = ()
    condition: str | FlightCondition = "high_alpha"
    """A name of `CONDITIONS`, or one of another aircraft."""
    turbulence: str = "none"
    rates: Rates = field(default_factory=Rates)
    measure: Callable[[Sample], Sample] | None = None
    instruments: Instruments | None = None
    """Sensors as they are on real aircraft."""
    gusts: float = 0.0
    """Rms of first-order gusts [m/s]."""
    law: LawPlan | None = None
    """A law that redesigns itself; None: the pilot's fixed law alone."""
    latency: int = 0
    """Samples by which commands reach the actuators late."""
    until_departure: bool = False
    """End when the aircraft departs, instead of an error when it diverges."""


@dataclass
class FlightLog:
    """What a flight left behind; one entry per sample, where nothing else is said."""

    time: list[float] = field(default_factory=list)
    x: list[Array] = field(default_factory=list)
    xdot: list[Array] = field(default_factory=list)
    delta: list[Array] = field(default_factory=list)
    """As measured."""
    estimates: list[Estimate] = field(default_factory=list)
    """Of a sparse flight only where something was found or the truth was taken."""
    estimated: list[int] = field(default_factory=list)
    """The samples after which they stood."""
    dithers: list[Dither] = field(default_factory=list)
    followed: list[float] = field(default_factory=list)
    """The estimate that was asked for."""
    truths: dict[int, LinearTruth] = field(default_factory=dict)
    """By sample."""
    flown: list[Array] = field(default_factory=list)
    """True states."""
    asked: list[PilotCommand] = field(default_factory=list)
    """What the pilot wanted; of the fixed law too."""
    statuses: list[Status] = field(default_factory=list)
    """Of the law, where it is not the fixed one."""
    departed: str = ""
    """Why the flight ended early; empty: it did not."""

    @property
    def events(self) -> list[FaultEvent]:
        """Every event, in order."""
        return [event for estimate in self.estimates for event in estimate.events]

    @property
    def asked_roll(self) -> Array:
        """Commanded roll rates (n,) [rad/s]."""
        return np.array([one.roll_rate for one in self.asked])

    @property
    def asked_alpha(self) -> Array:
        """Commanded angles of attack (n,) [rad]."""
        return np.array([one.alpha for one in self.asked])

    def alarms(self, rows: Sequence[str] = RIGID_BODY) -> list[float]:
        """Times of the alarms in any of these equations [s]."""
        found = [e for e in self.events if e.kind == EventKind.DETECTED]
        return [e.time for e in found if set(e.equations) & set(rows)]

    def truth(self, pick: Callable[[LinearTruth], Array]) -> Array:
        """Return a matrix of the truth at every sample, (n, ...): linear between those where the truth was taken."""
        at, now = np.array(list(self.truths)), np.arange(len(self.time))
        taken = np.array([pick(truth) for truth in self.truths.values()])
        columns = [np.interp(now, at, column) for column in taken.reshape(len(at), -1).T]
        return np.stack(columns, axis=1).reshape(-1, *taken.shape[1:])

    def identify(self, configuration: Configuration) -> list[Estimate]:
        """Return what an identifier says that sees the same samples without flying: one estimate per sample."""
        time, x, xdot, delta = (np.array(one) for one in (self.time, self.x, self.xdot, self.delta))
        return Identifier(configuration).run(time, x, xdot, delta).estimates


def fly(
    configuration: Configuration, flight: Flight, *, follow: tuple[str, str] | None = None, sparse: bool = False
) -> FlightLog:
    """Fly, with an identifier in the loop.

    Parameters
    ----------
    configuration
        Of the identifier.
    flight
        How to fly.
    follow
        Row and column of an estimate to keep after each sample; see `Identifier.follow`.
    sparse
        Put the model together only where the truth is taken or an event came, which saves a tenth of the time.

    Raises
    ------
    PlantError
        For a condition, noise level or turbulence that does not exist, or a flight that diverges.
    """
    loop = _Loop(configuration, flight)
    if follow is not None:
        loop.identifier.follow(*follow)
    log = loop.log
    for k in range(round(flight.duration / flight.rates.period)):
        if not loop.sensors.lost():
            loop.sample(k, follow is not None, sparse)
            if flight.until_departure and log.departed:
                break
        try:
            loop.step(k)
        except PlantError as error:
            if not flight.until_departure:
                raise
            log.departed = log.departed or str(error)
            break
    return log


class _Loop:
    """The parts of a flight, and what is in them between samples."""

    def __init__(self, configuration: Configuration, flight: Flight) -> None:
        rates, condition = flight.rates, _condition(flight.condition)
        self.flight = flight
        self.aircraft = Aircraft(
            condition,
            rate=rates.flight_dynamics,
            turbulence=flight.turbulence,
            seed=flight.seed,
            gusts=flight.gusts,
        )
        trim, truth = still_air(condition)
        self.pilot = make_pilot(trim, truth, flight.manoeuvre)
        self.stick = Stick(flight.manoeuvre, trim.alpha)
        self.steering = None if flight.law is None else Steering(flight.law, trim, truth, flight.manoeuvre)
        self.sensors = make_sensors(flight.instruments, flight.noise, flight.seed)
        self.measure = flight.measure or self.sensors.measure
        self.identifier, self.log = Identifier(configuration), FlightLog()
        self.faults = FaultSchedule(flight.faults, rates.period)
        self._commands = [self.aircraft.trim.delta] * (flight.latency + 1)

    def sample(self, k: int, follow: bool, sparse: bool) -> None:
        """Measure, identify, answer."""
        log, identifier, at = self.log, self.identifier, len(self.log.time)
        true = self.aircraft.sample()
        measured = self.measure(true)
        time = round(measured.time * 1e9) * 1e-9  # as messages carry it
        dither = identifier.learn(time, measured.x, measured.xdot, measured.delta)
        log.time.append(time)
        log.x.append(measured.x)
        log.xdot.append(measured.xdot)
        log.delta.append(measured.delta)
        due = at % self.flight.rates.truth_every == 0 or self.faults.turns(k)
        if due:
            log.truths[at] = self.aircraft.truth()
        log.dithers.append(dither)
        wanted = self.steering is not None and self.steering.wants_model(time)
        estimate = None
        if due or not sparse or identifier.news or wanted:
            estimate = identifier.estimate(time, measured.x)
            log.estimates.append(estimate)
            log.estimated.append(at)
        if follow:
            log.followed.append(identifier.followed)
        log.flown.append(true.x)
        log.asked.append(self.stick.command(time, float(measured.x[6])))
        if self.flight.until_departure:
            log.departed = departed(true.x, log.asked[-1].alpha)
        command = self.pilot.command(time, measured.x)
        if self.steering is not None:
            alarm = estimate is not None and any(one.kind == EventKind.DETECTED for one in estimate.events)
            news = estimate if wanted or alarm else None
            truth = self.aircraft.truth() if self.steering.wants_truth(time) else None
            command, status = self.steering.answer(measured, time, command, dither.delta, news, truth)
            log.statuses.append(status)
        self._commands.append(command + dither.delta)
        self._commands.pop(0)

    def step(self, k: int) -> None:
        """Fly to the next sample."""
        _step(self.aircraft, self.sensors, self.faults, k, self._commands[0], self.flight.rates.steps)


def _step(aircraft: Aircraft, sensors: RealSensors, faults: FaultSchedule, k: int, command: Array, steps: int) -> None:
    """Fly from a sample to the next."""
    faults.strike(k, aircraft)
    for _ in range(steps):
        if sensors.follows:
            sensors.follow(aircraft.sample())
        aircraft.step(command)


def _condition(condition: str | FlightCondition) -> FlightCondition:
    if isinstance(condition, FlightCondition):
        return condition
    if condition not in CONDITIONS:
        message = f"unknown condition '{condition}': expected one of {', '.join(CONDITIONS)}"
        raise PlantError(message)
    return CONDITIONS[condition]


@cache
def still_air(condition: FlightCondition) -> tuple[Trim, LinearTruth]:
    """Return what a pilot is designed for, as its node does: still air, whatever the rate of the flight dynamics."""
    aircraft = Aircraft(condition, rate=max(100, condition.airframe.least_rate))
    return aircraft.trim, aircraft.truth()
