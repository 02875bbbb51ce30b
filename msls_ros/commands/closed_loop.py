"""The simulated F-16 in closed loop with an identifier, in this process and without ROS: for many flights.

What happens in a sample is what the nodes do in lockstep: the aircraft is measured, the identifier takes the sample,
the pilot answers, and pilot plus dither fly the aircraft to the next sample. A fault strikes between two samples.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from msls_ros.estimation import Configuration, Estimate, EventKind, FaultEvent, Identifier
from msls_ros.plant import (
    CONDITIONS,
    Aircraft,
    LinearTruth,
    Manoeuvre,
    Pilot,
    PlantError,
    RollDoublet,
    Sample,
    Sensors,
)

Array = NDArray[np.float64]

RATE = 100
"""Steps of the flight dynamics per second."""
RIGID_BODY = ("u", "v", "w", "P", "Q", "R")
"""Equations whose alarms count as such."""


@dataclass(frozen=True)
class Fault:
    """What breaks, and when."""

    time: float
    """[s], of a sample: the next one is the first to feel it."""
    surface: str
    """A surface or an effector of the plant."""
    effectiveness: float = 0.0
    """What is left of it [1]."""


@dataclass(frozen=True)
class Flight:
    """How to fly.

    The sensors are those of the noise level; ``sensors`` replaces them. The truth is taken at every ``truth_every``-th
    sample, and at the two samples on either side of the fault.
    """

    noise: str
    seed: int
    duration: float
    """[s]"""
    manoeuvre: Manoeuvre = field(default_factory=RollDoublet)
    fault: Fault | None = None
    condition: str = "high_alpha"
    turbulence: str = "none"
    steps: int = 2
    """Steps of the flight dynamics per sample; 2 is 50 Hz."""
    truth_every: int = 10
    """Samples."""
    sensors: Callable[[Sample], Sample] | None = None


@dataclass
class FlightLog:
    """What a flight left behind; one entry per sample."""

    time: list[float] = field(default_factory=list)
    x: list[Array] = field(default_factory=list)
    xdot: list[Array] = field(default_factory=list)
    delta: list[Array] = field(default_factory=list)
    """As measured."""
    estimates: list[Estimate] = field(default_factory=list)
    truths: dict[int, LinearTruth] = field(default_factory=dict)
    """By sample."""

    @property
    def events(self) -> list[FaultEvent]:
        """Every event, in order."""
        return [event for estimate in self.estimates for event in estimate.events]

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


def fly(configuration: Configuration, flight: Flight) -> FlightLog:
    """Fly, with an identifier in the loop.

    Parameters
    ----------
    configuration
        Of the identifier.
    flight
        How to fly.

    Raises
    ------
    PlantError
        For a condition, noise level, turbulence or surface that does not exist, or a flight that diverges.
    """
    if flight.condition not in CONDITIONS:
        message = f"unknown condition '{flight.condition}': expected one of {', '.join(CONDITIONS)}"
        raise PlantError(message)
    aircraft = Aircraft(CONDITIONS[flight.condition], rate=RATE, turbulence=flight.turbulence, seed=flight.seed)
    pilot = Pilot(aircraft.trim, aircraft.truth(), flight.manoeuvre)
    measure = flight.sensors or Sensors(flight.noise, flight.seed).measure
    identifier, log = Identifier(configuration), FlightLog()
    period = flight.steps / RATE
    strikes = round(flight.fault.time / period) if flight.fault is not None else -1
    for k in range(round(flight.duration / period)):
        measured = measure(aircraft.sample())
        estimate = identifier.update(measured.time, measured.x, measured.xdot, measured.delta)
        log.time.append(measured.time)
        log.x.append(measured.x)
        log.xdot.append(measured.xdot)
        log.delta.append(measured.delta)
        log.estimates.append(estimate)
        if k % flight.truth_every == 0 or strikes in (k, k - 1):
            log.truths[k] = aircraft.truth()
        command = pilot.command(measured.time, measured.x) + estimate.dither.delta
        if flight.fault is not None and k == strikes:
            aircraft.damage(flight.fault.surface, flight.fault.effectiveness)
        for _ in range(flight.steps):
            aircraft.step(command)
    return log
