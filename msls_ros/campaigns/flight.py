"""One flight of a campaign: flown in closed loop without ROS, judged against truth beside its peers, as plain data."""

from __future__ import annotations

import functools
import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

import msls_ros.plant
from msls_ros.campaigns.naming import judge_names
from msls_ros.estimation import Configuration, EstimationError, EventKind, Identifier, Level
from msls_ros.estimation.configuration import as_mapping
from msls_ros.fleet.work import running_code
from msls_ros.flights.closed_loop import RIGID_BODY, FlightLog, fly
from msls_ros.flights.comparison import dither_figures, realised_acceleration
from msls_ros.flights.judging import (
    PEERS,
    START,
    TICK,
    detection,
    errors,
    errors_now,
    exposed,
    false_alarms,
    mean,
)
from msls_ros.flights.scenarios import Scenario
from msls_ros.flights.tracking import track
from msls_ros.flights.watch import Watch
from msls_ros.plant import PlantError, digest_of

Array = NDArray[np.float64]
Stacks = Mapping[str, NDArray[Any]]
"""Fields of `Estimate`, one entry per sample."""
Row = dict[str, Any]
"""What is recorded of a flight: numbers, words, lists and None; JSON that knows no NaN."""
BAND = 1.96
"""Half of the 95 % band, in standard errors."""
FIELDS = ("a", "b", "bias", "a_std", "b_std", "a_reliable", "b_reliable")
DITHER = ("predicted_g_max", "predicted_g_rms", "realised_g_rms", "realised_of_limit", "realised_of_limit_1s_max")
"""What is kept of `dither_figures`; rms over the samples at the nominal level."""
PROGRAMS = ("jsbsim", "numpy", "numba")
"""They decide a flight, beside our own code."""


@dataclass(frozen=True)
class Cell:
    """What is flown with many seeds."""

    scenario: Scenario
    noise: str
    setting: tuple[tuple[str, Any], ...]
    """Parameters of the identifier by full name, other than the scenario has them."""
    configuration: Configuration
    """Of the scenario at this noise with the setting; the seed of the dither is the flight's."""
    as_configured: bool = False
    """Whether the setting is what the scenario has anyway."""

    @property
    def label(self) -> str:
        """The setting in a few words; empty: none."""
        words = [f"{SHORT.get(name, name)}={_word(value)}" for name, value in self.setting]
        return " ".join([*words, "(as configured)"] if self.as_configured else words)

    def flight_key(self, seed: int) -> str:
        """Return a digest of all that decides a flight, our code included; what does not (a comment) is not in it."""
        s = self.scenario
        decides = (s.name, s.flight(self.noise, seed), s.watch, self.setting, as_mapping(self.configuration))
        return hashlib.sha256(repr((decides, versions(), digest_of(s.airframe))).encode()).hexdigest()[:32]


SHORT = {
    "estimator.forgetting_factor": "lambda",
    "estimator.penalty": "penalty",
    "detector.threshold": "T",
}
"""Short names of parameters, for command lines and tables."""


@dataclass(frozen=True)
class Task:
    """One flight to fly, with everything that a worker needs to know."""

    cell: Cell
    seed: int
    key: str


def _word(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


@functools.cache
def versions() -> dict[str, str]:
    """Return the versions of what decides a flight."""
    return {"code": running_code(), "data": _DATA, **{name: version(name) for name in PROGRAMS}}


def _read_data() -> str:
    """Return a digest of the aircraft's own data files."""
    total = hashlib.sha256()
    for path in sorted((Path(msls_ros.plant.__file__).parent / "data").iterdir()):
        if path.is_file():
            total.update(f"{path.name}\n".encode() + path.read_bytes())
    return total.hexdigest()[:12]


_DATA = _read_data()


def fly_task(task: Task) -> Row:
    """Fly and judge; a flight that fails is a row too, with one sentence in ``error``."""
    cell = task.cell
    row = failed(task, "")
    start = perf_counter()
    try:
        configuration, watch = cell.configuration.with_seed(task.seed), cell.scenario.watch
        flight = cell.scenario.flight(cell.noise, task.seed)
        follow = (watch.row, watch.column) if _identified(configuration, watch) else None
        row.update(judge(cell, fly(configuration, flight, follow=follow, sparse=True)), error=None)
    except (PlantError, EstimationError) as error:
        row["error"] = str(error)
    row["wall_time_s"] = round(perf_counter() - start, 4)
    plain: Row = json.loads(json.dumps(row), parse_constant=lambda _: None)
    return plain


def failed(task: Task, error: str) -> Row:
    """Return the row of a flight of which nothing is known but what was wrong."""
    cell = task.cell
    head = {"key": task.key, "scenario": cell.scenario.name, "noise": cell.noise, "setting": dict(cell.setting)}
    return {**head, "seed": task.seed, "error": error}


def judge(cell: Cell, log: FlightLog) -> Row:
    """Return what a flight shows.

    Parameters
    ----------
    cell
        Of the flight.
    log
        What it left behind.
    """
    scenario = cell.scenario
    spans, watch = scenario.fault_spans, scenario.watch
    at = np.array(log.time)
    flown = {field: np.array([getattr(one, field) for one in log.estimates]) for field in FIELDS}
    estimated_at = at[log.estimated]
    truth = log.truth(lambda one: watch.of(one.a, one.b))
    estimates = watched(cell.configuration, log, flown, watch)
    alarms = [
        (event.time, event.equations)
        for event in log.events
        if event.kind == EventKind.DETECTED and set(event.equations) & set(RIGID_BODY)
    ]
    struck, ended = scenario.fault_start, scenario.fault_end
    faults = None if struck is None or ended is None else (struck, ended)
    before = at <= (at[-1] if struck is None else struck) + TICK
    truth_before = float(truth[before][-1])
    reliable = watch.of(flown["a_reliable"], flown["b_reliable"])
    numbers: list[Any] = [log.x, log.xdot, log.delta, *(flown[name] for name in ("a", "b", "bias"))]
    numbers.append([one.delta for one in log.dithers])
    found: Row = {
        "faults": [_fault(span, alarms) for span in spans],
        "alarms": [[round(when, 9), list(equations)] for when, equations in alarms],
        "false_alarms": false_alarms(spans, alarms),
        "exposed_s": round(exposed(spans, scenario.duration), 6),
        "watch": str(watch),
        "truth_before": truth_before,
        "truth_end": float(truth[-1]),
    }
    for name, one in estimates.items():
        found[name] = {
            **errors(at, one, truth, faults, truth_before),
            **errors_now(at, one, truth, faults, truth_before),
            "finite": bool(np.isfinite(one).all()),
        }
    if scenario.law.law is not None:
        found["tracking"] = tracking_row(log, scenario)
    return found | {
        "coverage": coverage(scenario, log, flown),
        "named": judge_names(scenario, log),
        "reliable_share_before": mean(reliable[(estimated_at <= at[before][-1]) & (estimated_at > START)]),
        "finite": all(np.isfinite(one).all() for one in numbers)
        and not any(np.isnan(flown[name]).any() for name in ("a_std", "b_std")),
        "dither": _dither(scenario, log),
        "simulated_s": scenario.duration,
    }


def _dither(scenario: Scenario, log: FlightLog) -> Row:
    """Return what the dither was predicted to be felt as and what was felt, through actuators and the true B."""
    commands = np.array([one.delta for one in log.dithers])
    realised = realised_acceleration(np.array(log.time), commands, log.truth(lambda one: one.b), scenario.airframe)
    figures = dither_figures(
        np.array(log.time),
        realised,
        np.array([one.predicted_acceleration for one in log.dithers]),
        np.array([one.acceleration_limit for one in log.dithers]),
        np.array([one.level == Level.BOOSTED for one in log.dithers]),
    )
    return {name: figures[name] for name in DITHER}


def tracking_row(log: FlightLog, scenario: Scenario) -> Row:
    """Return how a flight followed its commands [deg, deg/s, s]; the recovery of a flight that departed is None."""
    t = track(log, scenario.fault_start, scenario.rates.period)
    reasons = [status.law for status in log.statuses]
    return {
        "kept": t.kept,
        "why": t.why,
        "departed_s": t.departed_s,
        **{name: math.degrees(getattr(t, name)) for name in ANGLES},
        "recovery_s": None if math.isinf(t.recovery_s) else t.recovery_s,
        "fixed_share": mean(np.array([one in ("fixed", "hold") for one in reasons])) if reasons else 1.0,
    }


ANGLES = ("roll_rms", "alpha_rms", "beta_rms", "alpha_max", "beta_max")
"""Of `Tracking`, in degrees in tables."""


def _fault(span: tuple[float, float], alarms: list[tuple[float, tuple[str, ...]]]) -> Row:
    found = detection(span, alarms)
    return {"start_s": round(span[0], 9), "end_s": round(span[1], 9), "detected": found["time_s"] is not None, **found}


def watched(configuration: Configuration, log: FlightLog, flown: Stacks, watch: Watch) -> dict[str, Array]:
    """Return the watched parameter (n,) as each estimator has it: the one that flew, and the peers on its samples."""
    time, x, xdot, delta = (np.array(one) for one in (log.time, log.x, log.xdot, log.delta))
    if not log.followed:  # all have it from physics
        known = np.interp(time, time[log.estimated], watch.of(flown["a"], flown["b"]))
        return {name: known for name in estimators(configuration)}
    found = {configuration.estimator.method: np.array(log.followed)}
    for name, peer in _peers(configuration, watch).items():
        peer.reset()
        found[name] = np.concatenate(peer.run(time, x, xdot, delta, every=len(time)).followed)
    return found


def estimators(configuration: Configuration) -> tuple[str, ...]:
    """Return the method that flies, and its peers."""
    return (configuration.estimator.method, *PEERS[configuration.estimator.method])


def _identified(configuration: Configuration, watch: Watch) -> bool:
    return watch.row in configuration.rows and watch.column in configuration.regressors


@functools.lru_cache(maxsize=8)
def _peers(configuration: Configuration, watch: Watch) -> dict[str, Identifier]:
    """Return the peers of an identifier, whatever its seed: they do not fly."""
    changed = PEERS[configuration.estimator.method]
    peers = {name: Identifier(configuration.replace(changes)) for name, changes in changed.items()}
    for peer in peers.values():
        peer.follow(watch.row, watch.column)
    return peers


def coverage(scenario: Scenario, log: FlightLog, flown: Stacks) -> dict[str, dict[str, float | int]]:
    """Return how many of the numbers called reliable there were, and which share had the truth in their 95 % band.

    Equations and states of the rigid body, and all effectors; at the true models taken at their rate, from 1 s on.
    """
    r, every = len(RIGID_BODY), scenario.rates.truth_every
    used = [k for k in log.truths if k % every == 0 and log.time[k] > START - TICK]
    found: dict[str, dict[str, float | int]] = {}
    stood = np.searchsorted(log.estimated, used)
    for name, columns in (("a", slice(r)), ("b", slice(None))):
        pick = (slice(None), slice(r), columns)
        true = np.array([getattr(log.truths[k], name) for k in used]).reshape(len(used), *flown[name].shape[1:])
        error = np.abs(flown[name][stood] - true)[pick]
        trust = flown[f"{name}_reliable"][stood][pick]
        inside = (error <= BAND * flown[f"{name}_std"][stood][pick])[trust]
        found[name] = {"share": mean(inside), "number": len(inside), "of": trust.size}
    return found
