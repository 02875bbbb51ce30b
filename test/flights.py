"""Flights of the simulated F-16 in closed loop with an identifier, without ROS: for tests that need many of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from msls_ros.estimation import Configuration, Estimate, EventKind, FaultEvent, Identifier
from msls_ros.plant import CONDITIONS, Aircraft, LinearTruth, Manoeuvre, Pilot, RollDoublet, Sensors

STEPS = 2
"""Steps of the flight dynamics per sample: 100 Hz and 50 Hz."""


@dataclass
class FlightLog:
    """What a flight left behind; one entry per sample, truth every tenth."""

    time: list[float] = field(default_factory=list)
    x: list[np.ndarray] = field(default_factory=list)
    xdot: list[np.ndarray] = field(default_factory=list)
    delta: list[np.ndarray] = field(default_factory=list)
    estimates: list[Estimate] = field(default_factory=list)
    truths: dict[int, LinearTruth] = field(default_factory=dict)

    @property
    def events(self) -> list[FaultEvent]:
        return [event for estimate in self.estimates for event in estimate.events]

    def alarms(self, rows: Sequence[str] = ("u", "v", "w", "P", "Q", "R")) -> list[float]:
        found = [e for e in self.events if e.kind == EventKind.DETECTED]
        return [e.time for e in found if set(e.equations) & set(rows)]


def fly(
    configuration: Configuration,
    *,
    noise: str,
    seed: int,
    duration: float,
    manoeuvre: Manoeuvre | None = None,
    fault: tuple[float, str, float] | None = None,
    turbulence: str = "none",
    colour: float = 0.0,
) -> FlightLog:
    """Fly; ``fault`` is time, surface, what is left of it; ``colour`` makes the noise of xdot AR(1)."""
    aircraft = Aircraft(CONDITIONS["high_alpha"], turbulence=turbulence, seed=seed)
    pilot = Pilot(aircraft.trim, aircraft.truth(), manoeuvre or RollDoublet())
    sensors, identifier, log = Sensors(noise, seed), Identifier(configuration), FlightLog()
    disturbance: np.ndarray | None = None
    for k in range(round(duration * 50)):
        sample = aircraft.sample()
        measured = sensors.measure(sample)
        xdot = measured.xdot
        if colour > 0.0:
            fresh = xdot - sample.xdot
            disturbance = fresh if disturbance is None else colour * disturbance + np.sqrt(1 - colour**2) * fresh
            xdot = sample.xdot + disturbance
        estimate = identifier.update(measured.time, measured.x, xdot, measured.delta)
        log.time.append(measured.time)
        log.x.append(measured.x)
        log.xdot.append(xdot)
        log.delta.append(measured.delta)
        log.estimates.append(estimate)
        if k % 10 == 0:
            log.truths[k] = aircraft.truth()
        command = pilot.command(measured.time, measured.x) + estimate.dither.delta
        if fault is not None and abs(aircraft.time - fault[0]) < 1e-6:
            aircraft.damage(fault[1], fault[2])
        for _ in range(STEPS):
            aircraft.step(command)
    return log
