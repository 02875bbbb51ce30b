"""What `demo` shows of a control law: the flight beside that of the fixed law, as a figure and in numbers."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from msls_ros.estimation import Configuration
from msls_ros.flights.closed_loop import FlightLog, fly, still_air
from msls_ros.flights.comparison import Comparison
from msls_ros.flights.scenarios import Scenario
from msls_ros.flights.steering import controlled
from msls_ros.flights.tracking import reference_of, track

ROWS = slice(3, 6)


def show_law(
    scenario: Scenario, configuration: Configuration, c: Comparison, out: Path, noise: str, seed: int
) -> dict[str, Any]:
    """Fly the same without ROS, by the law and by the fixed law; draw both and return the numbers.

    Parameters
    ----------
    scenario, configuration
        What was flown.
    c
        What the bag of the flight over DDS holds.
    out
        Folder of the figure.
    noise, seed
        Of the sensors.
    """
    flight = scenario.flight(noise, seed)
    logs = {law: fly(configuration, replace(flight, law=plan), sparse=True) for law, plan in _plans(scenario)}
    own = logs[str(scenario.law.law)]
    n = min(len(own.time), len(c.time))
    same = bool(n >= len(own.time) and np.array_equal(np.array(own.delta)[:n], c.delta[:n]))
    path = out / "law.png"
    draw(path, scenario, logs, seed)
    start = scenario.fault_start
    return {
        "name": scenario.law.law,
        "same_over_dds_and_without_ros": same,
        "figure": str(path),
        "reasons": list(dict.fromkeys(f"{one.law}: {one.reason}" for one in own.statuses)),
        **{law: _numbers(log, start, scenario.rates.period) for law, log in logs.items()},
    }


def _plans(scenario: Scenario) -> list[tuple[str, Any]]:
    return [(str(scenario.law.law), scenario.law.plan), ("fixed", None)]


def _numbers(log: FlightLog, start: float | None, period: float) -> dict[str, Any]:
    t = track(log, start, period)
    angles = ("roll_rms", "alpha_rms", "beta_rms", "alpha_max", "beta_max")
    return {
        "kept": t.kept,
        "why": t.why,
        "departed_s": t.departed_s,
        **{f"{name}_deg": math.degrees(getattr(t, name)) for name in angles},
        "recovery_s": None if math.isinf(t.recovery_s) else t.recovery_s,
    }


def draw(path: Path, scenario: Scenario, logs: dict[str, FlightLog], seed: int) -> None:
    """Write the figure of flights side by side."""
    from msls_ros.report.law_figures import LawHistory, plot_laws  # matplotlib takes a second to import

    trim, truth = still_air(scenario.flight_condition)
    aircraft = controlled(trim, truth)
    back = aircraft.effectors_from_surfaces
    b0 = truth.b[ROWS] @ back
    size = np.maximum((b0**2).sum(axis=0), 1e-12)
    histories = []
    for law, log in logs.items():
        x, time = np.array(log.flown), np.array(log.time)
        a = np.arctan2(x[:, 2], x[:, 0])
        speed = np.sqrt((x[:, :3] ** 2).sum(axis=1))
        place = np.array(log.delta) @ aircraft.mixing.T
        limit = np.where(place > 0.0, aircraft.high, -np.array(aircraft.low))
        true_b = log.truth(lambda one: one.b[ROWS])
        histories.append(
            LawHistory(
                title=_title(law, log),
                time=time,
                roll=np.degrees(x[:, 3] * np.cos(a) + x[:, 5] * np.sin(a)),
                roll_wanted=np.degrees(reference_of(log.asked_roll, scenario.rates.period)),
                alpha=np.degrees(a),
                alpha_wanted=np.degrees(log.asked_alpha),
                beta=np.degrees(np.arcsin(x[:, 1] / speed)),
                surfaces=place / limit,
                effect=np.array([one.effectiveness for one in log.statuses]),
                effect_std=np.array([one.effectiveness_std for one in log.statuses]),
                effect_true=((true_b @ back) * b0).sum(axis=1) / size,
                laws=[one.law for one in log.statuses] or ["fixed"] * len(time),
                departed=log.departed,
            )
        )
    damaged = {surface for fault in scenario.faults_of(seed) for surface in fault.surfaces}
    plot_laws(path, histories, aircraft.surfaces, sorted(damaged), scenario.fault_start)


def _title(law: str, log: FlightLog) -> str:
    words = {"fixed": "Fixed law", "lq": "LQ servo designed anew from A and B"}
    text = words.get(law, f"Redesigned from the identified B ({law})")
    return f"{text}: {'departs' if log.departed else 'flies on'}"
