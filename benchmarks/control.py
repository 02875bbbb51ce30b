"""Control laws side by side: the same failures, noises and seeds flown by each, in closed loop without ROS.

Suites: ``failures`` (the ten shipped ones), ``random`` (random failures; those count that a law designed from truth
survives), ``latency``, ``gusts``, ``no_dither``, ``intact``, ``learn`` (no prior), ``beds`` (other
aircraft, no prior). All with the dither of eq 23, as the shipped scenarios that the laws fly.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from msls_ros.control import ControlSettings
from msls_ros.estimation import Configuration
from msls_ros.flights.closed_loop import Flight, FlightLog, fly
from msls_ros.flights.random_failures import RandomFailures, describe
from msls_ros.flights.scenarios import Scenario, find_scenario
from msls_ros.flights.steering import LawPlan
from msls_ros.flights.tracking import track
from msls_ros.paper.flight_experiments import LITERAL_DITHER
from msls_ros.plant import PlantError

TEN = (
    *("tail_hard_over", "tail_and_nozzle_lost", "nozzle_hard_over", "nozzles_hard_over", "nozzle_stuck"),
    *("cruise_tail_hard_over", "cruise_flaperon_hard_over", "cruise_three_lost", "cruise_tail_lost"),
    "cruise_tail_and_rudder_stuck",
)
FOUR = ("tail_hard_over", "nozzle_hard_over", "cruise_tail_hard_over", "cruise_tail_lost")
BEDS = ("A4_aileron_half", "T37_rudder_lost", "c172x_elevator_half", "J3Cub_elevator_half")
INTACT = ("nozzle_hard_over", "cruise_tail_lost")
"""Scenarios flown without their fault."""


@dataclass(frozen=True)
class Law:
    """A law as it is compared."""

    plan: LawPlan | None
    """None: the pilot's fixed law."""
    method: str = "msls"
    """Of the identifier."""


def _plan(**changes: Any) -> LawPlan:
    return LawPlan(ControlSettings().changed(changes))


LAWS: Mapping[str, Law] = {
    "fixed": Law(None),
    "frozen": Law(_plan(law="indi", model="frozen", caution=0.0)),
    "rls": Law(_plan(law="indi", model="raw", caution=0.0), "rls"),
    "lq": Law(_plan(law="lq", model="entry")),
    "entry": Law(_plan(model="entry")),
    "auto": Law(_plan()),
    "bank": Law(_plan(), "bank"),
    "truth": Law(LawPlan(ControlSettings(law="indi"), told_truth=True)),
}


MSLS: Mapping[str, Mapping[str, Any]] = {
    "none": {"estimator.penalty": 3e-4},
    "low": {"estimator.forgetting_factor": 0.96, "estimator.penalty": 9e-4, "recovery.penalty_factor": 0.3},
    "med": {
        "estimator.penalty": 1e-2,
        "detector.mode": "ratio",
        "detector.window": 50,
        "detector.threshold": 3.5,
    },
}
"""What MSLS and RLS fly with, by noise; the bank flies the profile as it is."""


@dataclass(frozen=True)
class Case:
    """One flight."""

    scenario: Scenario
    law: str
    noise: str
    seed: int
    flight: Flight
    configuration: Configuration


def cases(suite: str, laws: list[str], noises: list[str], seeds: range) -> Iterator[Case]:
    """Yield the flights of a suite."""
    for scenario in _scenarios(suite):
        for noise in noises:
            for seed in seeds:
                for law in laws:
                    yield _case(suite, scenario, law, noise, seed)


def _scenarios(suite: str) -> list[Scenario]:
    if suite == "random":
        high = find_scenario("nozzle_hard_over")
        cruise = find_scenario("random_failures")
        failures = RandomFailures(seed=7)
        return [
            replace(high, name="random_high_alpha", faults=(), random_failures=failures),
            replace(cruise, name="random_cruise", random_failures=failures),
        ]
    if suite == "learn":
        return [find_scenario("learn_to_fly")]
    if suite == "beds":
        learn = find_scenario("learn_to_fly").law
        beds = [find_scenario(name) for name in BEDS]
        return [
            replace(
                one, name=f"learn_{one.aircraft.name}", faults=(), manoeuvre="roll_doublet", duration=20.0, law=learn
            )
            for one in beds
        ]
    names = {"gusts": FOUR, "intact": INTACT, "latency": TEN, "no_dither": TEN, "failures": TEN}[suite]
    found = [find_scenario(name) for name in names]
    if suite == "intact":
        found = [replace(one, name=f"intact_{one.condition}", faults=()) for one in found]
    return [replace(one, turbulence="moderate", duration=20.0) if suite == "gusts" else one for one in found]


def _case(suite: str, scenario: Scenario, law: str, noise: str, seed: int) -> Case:
    one = LAWS[law]
    plan = one.plan
    if plan is not None and not scenario.law.prior and law != "truth":
        plan = replace(plan, prior=False, settings=plan.settings.changed({"stack": False}))
    flight = replace(scenario.flight(noise, seed), law=plan, until_departure=True)
    if suite == "latency":
        flight = replace(flight, latency=2)
    configuration = scenario.configuration(noise, seed, dither=suite != "no_dither")
    changes = {} if one.method == "bank" else MSLS[noise]
    changes = {**changes, "estimator.method": one.method}
    return Case(scenario, law, noise, seed, flight, configuration.replace({**changes, **LITERAL_DITHER}))


def flown(case: Case) -> dict[str, Any]:
    """Fly a case; return what it shows [deg, s]."""
    log = fly(case.configuration, case.flight, sparse=True)
    start = case.scenario.fault_start
    t = track(log, start, case.scenario.rates.period)
    row = {
        "scenario": case.scenario.name,
        "law": case.law,
        "noise": case.noise,
        "seed": case.seed,
        "kept": t.kept,
        "why": t.why,
        **{name: math.degrees(getattr(t, name)) for name in ("roll_rms", "alpha_rms", "beta_rms")},
        **{name: math.degrees(getattr(t, name)) for name in ("alpha_max", "beta_max")},
        "recovery_s": None if math.isinf(t.recovery_s) else t.recovery_s,
        "dropped": sum("disproved" in one.reason for one in log.statuses),
        "faults": describe(case.flight.faults),
    }
    return row | _learnt(log, case)


def _learnt(log: FlightLog, case: Case) -> dict[str, Any]:
    """Return when a flight without a prior began to fly by its law, and how it tracked from 8 s on."""
    if case.scenario.law.prior:
        return {}
    laws = [one.law for one in log.statuses]
    first = next((one.time for one in log.statuses if one.law not in ("hold", "fixed")), None)
    late = track(log, 8.0, case.scenario.rates.period)
    return {
        "law_from_s": first,
        "held": sum(one == "hold" for one in laws),
        **{f"late_{name}": math.degrees(getattr(late, name)) for name in ("roll_rms", "alpha_rms", "beta_rms")},
    }


def measure(
    suite: str, laws: list[str], noises: list[str], seeds: range, out: Path | None, say: Callable[[str], None]
) -> list[dict[str, Any]]:
    """Fly a suite; with ``out`` each flight is appended there as it ends, and those that are there are not flown again.

    Returns
    -------
    list
        The flights.
    """
    rows: dict[tuple[Any, ...], dict[str, Any]] = {}
    if out is not None and out.is_file():
        for line in out.read_text(encoding="utf-8").splitlines():
            row = json.loads(line)
            rows[_key(row)] = row
    file: TextIO | None = out.open("a", encoding="utf-8") if out is not None else None
    found = []
    for number, case in enumerate(cases(suite, laws, noises, seeds), 1):
        key = (case.scenario.name, case.law, case.noise, case.seed)
        if key not in rows:
            try:
                rows[key] = flown(case)
            except PlantError as error:
                say(f"{key}: {error}")
                continue
            if file is not None:
                file.write(json.dumps(rows[key]) + "\n")
                file.flush()
        found.append(rows[key])
        if number % 100 == 0:
            say(f"{suite}: {number} flights")
    if file is not None:
        file.close()
    return found


def _key(row: Mapping[str, Any]) -> tuple[Any, ...]:
    return row["scenario"], row["law"], row["noise"], row["seed"]


def summarise(rows: list[dict[str, Any]], by: tuple[str, ...] = ("noise", "law")) -> list[dict[str, Any]]:
    """Return a line per noise and law: kept, medians of the errors, and how many are flown well."""
    groups: dict[tuple[Any, ...], list[dict[str, Any]]] = {}
    for row in rows:
        groups.setdefault(tuple(row[name] for name in by), []).append(row)
    return [{**dict(zip(by, key, strict=True)), **_numbers(own)} for key, own in groups.items()]


def _numbers(own: list[dict[str, Any]]) -> dict[str, Any]:
    middle = {name: _median(own, name) for name in ("roll_rms", "alpha_max", "beta_max", "recovery_s")}
    return {"flights": len(own), "kept": sum(row["kept"] for row in own), "well": sum(map(well, own)), **middle}


def _median(own: list[dict[str, Any]], name: str) -> float | None:
    values = [math.inf if row[name] is None else row[name] for row in own]
    middle = float(np.median(values))
    return None if math.isinf(middle) else middle


def well(row: Mapping[str, Any]) -> bool:
    """Whether a flight is flown well: alpha within 2 deg, sideslip within 3, roll rate within 1.5 deg/s rms."""
    return bool(row["kept"] and row["alpha_max"] < 2.0 and row["beta_max"] < 3.0 and row["roll_rms"] < 1.5)


def survivable(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the flights whose failure a law that knows the truth survives; all, where none has flown."""
    if all(row["law"] != "truth" for row in rows):
        return rows
    kept = {(row["scenario"], row["noise"], row["seed"]) for row in rows if row["law"] == "truth" and row["kept"]}
    return [row for row in rows if (row["scenario"], row["noise"], row["seed"]) in kept]
