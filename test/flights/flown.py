"""Flights of the simulated F-16 in closed loop with an identifier, without ROS: for tests that need many of them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from msls_ros.estimation import Configuration
from msls_ros.flights import closed_loop
from msls_ros.flights.closed_loop import Flight, FlightLog, Rates
from msls_ros.plant import Fault, Manoeuvre, RollDoublet, Sample, Sensors

__all__ = ["FlightLog", "fly"]


def coloured_sensors(noise: str, seed: int, colour: float) -> Callable[[Sample], Sample]:
    """Return sensors whose noise of xdot is AR(1) with this autocorrelation."""
    white = Sensors(noise, seed)
    disturbance: np.ndarray | None = None

    def measure(sample: Sample) -> Sample:
        nonlocal disturbance
        measured = white.measure(sample)
        fresh = measured.xdot - sample.xdot
        disturbance = fresh if disturbance is None else colour * disturbance + np.sqrt(1 - colour**2) * fresh
        return Sample(measured.time, measured.x, sample.xdot + disturbance, measured.delta)

    return measure


def fly(
    configuration: Configuration,
    *,
    noise: str,
    seed: int,
    duration: float,
    manoeuvre: Manoeuvre | None = None,
    fault: tuple[str, float, float] | None = None,
    turbulence: str = "none",
    colour: float = 0.0,
) -> FlightLog:
    """Fly; ``fault`` is surface, time, what is left of it; ``colour`` makes the noise of xdot AR(1)."""
    flight = Flight(
        noise,
        seed,
        duration,
        manoeuvre=manoeuvre or RollDoublet(),
        faults=(Fault(*fault),) if fault else (),
        turbulence=turbulence,
        rates=Rates(truth=5),
        measure=coloured_sensors(noise, seed, colour) if colour > 0.0 else None,
    )
    return closed_loop.fly(configuration, flight)
