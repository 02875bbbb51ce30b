"""Whether the identifier means what it says: error bars, alarms and names held against the truth, on all beds.

A flight is flown once (`calibration_beds`) and identified twice: from the samples as they are, and through the
window of mapped inputs. Every number of A and B that is identified is held against the truth of its moment, by phase:

``first second``, ``1-4 s`` after the start; ``1 s after`` and ``1-4 s after`` an alarm of its equation; ``manoeuvre``,
and ``quiet``, where for a second no angular rate has moved by a quarter of what it does over the flight.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.calibration_beds import (
    PATHS,
    Bed,
    Recorded,
    f16_beds,
    flight_test_beds,
    intact_beds,
    mapped,
    other_beds,
    record,
    resting_beds,
)
from benchmarks.flight_rows import Flight, Row, judge_flights
from benchmarks.servo_beds import servo_beds
from benchmarks.whole_beds import whole_beds
from msls_ros.estimation import Configuration, Estimate, EventKind, FaultEvent, Identifier
from msls_ros.estimation.kernel import Array
from msls_ros.flights.judging import Span, belongs, exposed
from msls_ros.flights.scenarios import Scenario
from msls_ros.inputs.derivatives import usual_intervals

PHASES = ("first second", "1-4 s", "1 s after", "1-4 s after", "manoeuvre", "quiet")
BAND = 1.96
BINS = np.concatenate([np.arange(0.0, 4.0, 0.02), [np.inf]])
"""Of |z|."""
QUIET = 0.25
DISTINCT = (0.9, 1.1)
"""What is left between these has not changed."""
QUICK = ("roll_doublet_tail_fault low", "half_loss none", "intact none air low", "A4 25 Hz smooth", "c172x 25 Hz loss")
MADE: dict[str, Callable[[], Iterable[Bed]]] = {"others": other_beds, "servos": servo_beds, "whole": whole_beds}
KINDS = ("quick", *MADE)
"""A few beds that take a minute, other aircraft, commands to servos, whole flights."""
DIFFERENTIATED = ("servos", "whole")
"""All derivatives of rates are made by the window there."""
ESTIMATES = 10.0
"""How many are judged [Hz]."""


def beds(kind: str = "") -> list[Bed]:
    """Return the beds: all that a constant may be looked at on, or of one of `KINDS`."""
    if kind in MADE:
        return list(MADE[kind]())
    found = [*f16_beds(), *intact_beds(), *flight_test_beds(), *resting_beds()]
    return [bed for bed in found if bed.name in QUICK] if kind == "quick" else found


def judge(bed: Bed, seed: int, flight: Recorded, path: str, configuration: Configuration) -> Row:
    """Identify a flight and hold what is said against the truth.

    Parameters
    ----------
    bed, seed, flight
        What was flown.
    path
        One of `PATHS`.
    configuration
        Of the identifier.
    """
    rate = configuration.sample_rate
    samples = (flight.time, flight.x, flight.xdot, flight.delta) if path == "direct" else mapped(flight, rate)
    straddle = usual_intervals(rate) if path == "mapped" else 0
    every = max(1, round(rate / ESTIMATES))
    estimates = Identifier(configuration, straddle).run(*samples, every=every).estimates
    events = [event for estimate in estimates for event in estimate.events]
    alarms = [(event.time, event.equations) for event in events if event.kind == EventKind.DETECTED]
    spans = bed.scenario.fault_spans
    aloft = float(np.isfinite(flight.truth_b).all(axis=(1, 2)).mean())
    late = 0.5 * straddle / rate  # a window's stamp is its middle: it has seen what comes after
    seen = [time + late for time, _ in alarms]
    false = [t for t in seen if not any(belongs(t, span) for span in spans) and flies(flight, t)]
    return {
        "bed": bed.name,
        "group": bed.group,
        "seed": seed,
        "path": path,
        "phases": count(configuration, flight, estimates, alarms),
        "faults": len(spans),
        "detected": sum(any(belongs(time, span) for time in seen) for span in spans),
        "seen_within_half": sum(any(0.0 < time - span[0] <= 0.5 for time in seen) for span in spans),
        "false_alarms": len(false),
        "late_alarms": sum(is_late(time, spans, seen) for time in false),
        "exposed_s": aloft * exposed(spans, float(flight.time[-1])),
        "isolations": [judge_name(bed.scenario, flight, e) for e in events if e.kind == EventKind.ISOLATED],
    }


def is_late(time: float, spans: Sequence[Span], alarms: Sequence[float]) -> bool:
    """Whether an alarm that belongs to no fault [s] comes after one that no alarm before it belongs to."""
    earlier = [alarm for alarm in alarms if alarm < time]
    return any(span[0] < time and not any(belongs(alarm, span) for alarm in earlier) for span in spans)


def count(
    configuration: Configuration,
    flight: Recorded,
    estimates: Sequence[Estimate],
    alarms: Sequence[tuple[float, tuple[str, ...]]],
) -> Row:
    """Return by matrix and phase: numbers, how many are called reliable, how far those are off as counts of |z|."""
    c = configuration
    kept = [c.states.index(s) for s in c.rows]
    still = find_quiet(flight)
    totals: dict[str, dict[str, list[Any]]] = {
        m: {phase: [0, 0, np.zeros(len(BINS) - 1, np.int64)] for phase in PHASES} for m in "AB"
    }
    times = [[time for time, equations in alarms if row in equations] for row in c.rows]
    for estimate in estimates:
        t = estimate.time
        k = min(int(np.searchsorted(flight.time, t)), len(flight.time) - 1)
        true_a, true_b = truth_at(flight, t)
        if not np.isfinite(true_b).all():
            continue
        known = ~np.asarray(estimate.a_known)
        for q, state in enumerate(kept):
            phase = phase_of(t - float(flight.time[0]), t, times[q], bool(still[k]))
            columns = [j for j in kept if known[state, j]]
            for name, given, std, sure, truth in (
                (
                    "A",
                    estimate.a[state, kept],
                    estimate.a_std[state, kept],
                    estimate.a_reliable[state, kept],
                    true_a[state, kept],
                ),
                ("B", estimate.b[state], estimate.b_std[state], estimate.b_reliable[state], true_b[state]),
            ):
                cell = totals[name][phase]
                cell[0] += len(columns) if name == "A" else len(given)
                cell[1] += int(sure.sum())
                z = np.abs(given - truth)[sure] / np.maximum(std[sure], 1e-300)
                cell[2] += np.histogram(z, BINS)[0]
    return {m: {p: [v[0], v[1], v[2].tolist()] for p, v in phases.items()} for m, phases in totals.items()}


def phase_of(since_start: float, time: float, alarms: Sequence[float], still: bool) -> str:
    """Return the phase of an equation at a time [s]."""
    last = max((a for a in alarms if a <= time), default=-np.inf)
    if time - last < 4.0:
        return "1 s after" if time - last < 1.0 else "1-4 s after"
    if since_start < 4.0:
        return "first second" if since_start < 1.0 else "1-4 s"
    return "quiet" if still else "manoeuvre"


def find_quiet(flight: Recorded) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """Return (n,) whether no angular rate has moved for a second."""
    rates = flight.x[:, 3:6] - np.median(flight.x[:, 3:6], axis=0)
    size = np.maximum(np.sqrt(np.mean(rates**2, axis=0)), 1e-9)
    width = max(1, round(1.0 / float(np.median(np.diff(flight.time)))))
    total = np.cumsum(np.concatenate([np.zeros((1, 3)), (rates / size) ** 2]), axis=0)
    begin = np.maximum(np.arange(len(rates)) + 1 - width, 0)
    mean = (total[1:] - total[begin]) / (np.arange(len(rates)) + 1 - begin)[:, None]
    found: np.ndarray[Any, np.dtype[np.bool_]] = (mean < QUIET**2).all(axis=1)
    return found


def truth_at(flight: Recorded, time: float) -> tuple[Array, Array]:
    """Return the true A and B at a time [s], linear between those that were taken."""
    j = min(max(int(np.searchsorted(flight.truth_time, time, side="right")) - 1, 0), len(flight.truth_time) - 2)
    before, after = flight.truth_time[j : j + 2]
    share = min(max((time - before) / (after - before), 0.0), 1.0)
    a, b = flight.truth_a, flight.truth_b
    return (1.0 - share) * a[j] + share * a[j + 1], (1.0 - share) * b[j] + share * b[j + 1]


def flies(flight: Recorded, time: float) -> bool:
    """Whether there is a truth at a time [s]: none on the ground."""
    return bool(np.isfinite(truth_at(flight, time)[1]).all())


def judge_name(scenario: Scenario, flight: Recorded, event: FaultEvent) -> Row:
    """Return whether a name is right, and how far what is said to be left is off.

    Right is the surface that broke, or an effector that it is part of and whose effect on the equations has changed.
    """
    name, struck = event.suspected_effector, [f for f in scenario.faults if f.time <= event.time]
    airframe = scenario.airframe
    if not struck:
        return {"name": name, "right": False, "left": None, "z": None, "changed": False}
    own = set(airframe.surfaces_of.get(name, (name,)))
    fault = next((f for f in reversed(struck) if own & set(f.surfaces)), struck[-1])  # several may have broken at once
    if name in airframe.surface_names:
        left = fault.left(event.time) if name in fault.surfaces else 1.0
    elif name in airframe.effectors:
        left = true_share(scenario, flight, name, event.equations, event.time)
    else:
        left = 1.0
    broken = bool(own & set(fault.surfaces))
    changed = not DISTINCT[0] <= left <= DISTINCT[1]
    return {
        "name": name,
        "right": broken and changed,
        "changed": changed,
        "left": event.effectiveness,
        "z": (event.effectiveness - left) / max(event.effectiveness_std, 1e-9),
    }


def true_share(scenario: Scenario, flight: Recorded, name: str, rows: Iterable[str], time: float) -> float:
    """Return what is left of an effector's effect on some equations, the one of the largest effect."""
    column = scenario.airframe.effectors.index(name)
    start = scenario.fault_start
    assert start is not None
    states = ("u", "v", "w", "P", "Q", "R")
    before, after = truth_at(flight, start - 1e-3)[1][:, column], truth_at(flight, time)[1][:, column]
    row = max((states.index(r) for r in rows), key=lambda i: abs(before[i]))
    return float(after[row] / before[row]) if before[row] != 0.0 else 1.0


def summarise(rows: Sequence[Row]) -> Row:
    """Return the table: by group and path, phases, names, alarms."""
    table: Row = {}
    for group in dict.fromkeys(row["group"] for row in rows):
        for path in PATHS:
            chosen = [row for row in rows if (row["group"], row["path"]) == (group, path)]
            if chosen:
                table[f"{group}, {path}"] = summarise_cell(chosen)
    return table


def summarise_cell(rows: Sequence[Row]) -> Row:
    """Return shares, coverage and median |z| by matrix and phase, and the counts of names and alarms."""
    names = [one for row in rows for one in row["isolations"]]
    broken = [row for row in rows if row["faults"]]
    known = [abs(one["z"]) for one in names if one["right"]]
    hours = sum(row["exposed_s"] for row in rows) / 3600.0
    return {
        "flights": len(rows),
        "phases": {
            m: {phase: phase_numbers([row["phases"][m][phase] for row in rows]) for phase in PHASES} for m in "AB"
        },
        "named_right": sum(any(one["right"] for one in row["isolations"]) for row in broken),
        "named_wrong": sum(any(not one["right"] for one in row["isolations"]) for row in rows),
        "silent": sum(not row["isolations"] for row in broken),
        "broken": len(broken),
        "share_within": float(np.mean([z <= BAND for z in known])) if known else None,
        "detected": sum(row["detected"] for row in rows),
        "seen_within_half": sum(row["seen_within_half"] for row in rows),
        "faults": sum(row["faults"] for row in rows),
        "false_alarms": sum(row["false_alarms"] for row in rows),
        "late_alarms": sum(row["late_alarms"] for row in rows),
        "false_alarms_per_hour": sum(row["false_alarms"] for row in rows) / hours if hours else None,
    }


def phase_numbers(cells: Sequence[Sequence[Any]]) -> Row:
    """Return what share is called reliable, coverage of the 95 % band, and median |z|."""
    numbers, sure = sum(cell[0] for cell in cells), sum(cell[1] for cell in cells)
    counts = np.sum([cell[2] for cell in cells], axis=0)
    share = sure / numbers if numbers else None
    if not sure:
        return {"numbers": numbers, "share": share, "coverage": None, "median_z": None}
    middle = int(np.searchsorted(np.cumsum(counts), 0.5 * counts.sum()))
    covered = int(counts[: round(BAND / 0.02)].sum())
    return {
        "numbers": numbers,
        "share": share,
        "coverage": covered / int(counts.sum()),
        "median_z": float(BINS[middle]) + 0.01,
    }


def fly_and_judge(flight: Flight, folder: Path | None, method: str) -> list[Row]:
    """Return a row for each path of a flight; see `measure`."""
    bed, seed = flight.bed, flight.seed
    recorded = record(bed, seed, folder)
    configuration = bed.configuration(seed)
    if method:
        configuration = configuration.replace({"estimator.method": method})
    return [judge(bed, seed, recorded, path, configuration) for path in flight.paths]


def measure(
    seeds: Sequence[int],
    folder: Path | None,
    say: Callable[[str], None],
    kind: str = "",
    method: str = "",
    *,
    jobs: int = 1,
    stopped: Callable[[], bool] = lambda: False,
) -> Row:
    """Fly and judge all beds; what stands in the folder from an earlier call with the same code is not done again.

    Parameters
    ----------
    seeds
        Of each bed.
    folder
        Where flights and results are kept; None: nowhere.
    say
        Told about every flight.
    kind
        Which beds instead, of `KINDS`.
    method
        Of the estimator instead of the profile's.
    jobs, stopped
        See `judge_flights`, which raises `FleetError` and `KeyboardInterrupt`.
    """
    paths = PATHS[1:] if kind in DIFFERENTIATED else PATHS
    flights = [Flight(bed, seed, paths) for bed in beds(kind) for seed in seeds]
    fly = partial(fly_and_judge, folder=folder, method=method)
    name = f"rows{'-' + method if method else ''}"
    rows = judge_flights(fly, flights, folder, name, say, jobs=jobs, stopped=stopped)
    return {"seeds": list(seeds), "table": summarise(rows)}


def render(result: Row) -> str:
    """Return the table as text."""
    lines = []
    for name, cell in result["table"].items():
        lines.append(f"\n{name}: {cell['flights']} flights; share called reliable / coverage / median |z|")
        lines.append(f"{'':4}" + "".join(f"{phase:>20}" for phase in PHASES))
        for matrix in "AB":
            lines.append(f"{matrix:4}" + "".join(f"{_cell(cell['phases'][matrix][p]):>20}" for p in PHASES))
        within = cell["share_within"]
        lines.append(
            f"names: right {cell['named_right']}, silent {cell['silent']} of {cell['broken']} broken, wrong "
            f"{cell['named_wrong']} of {cell['flights']}; share left within 1.96: "
            f"{'-' if within is None else f'{within:.2f}'}. Alarms: {cell['detected']} of {cell['faults']} faults "
            f"({cell['seen_within_half']} within 0.5 s), false {cell['false_alarms']}, of which late "
            f"{cell['late_alarms']}, {cell['false_alarms_per_hour']:.1f} an hour"
        )
    return "\n".join(lines)


def _cell(numbers: Row) -> str:
    if numbers["coverage"] is None:
        return "none"
    return f"{numbers['share']:.2f} {numbers['coverage']:.2f} {numbers['median_z']:.2f}"
