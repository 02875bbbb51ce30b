"""How far estimates err: on the F-16 beside MSLS and RLS, in flight test beside the best of six in hindsight.

F-16 (`judge_f16`): errors before and after the fault of the watched parameter, and of the large numbers of A and of B;
per scenario and noise the medians over the seeds, divided by the smaller one of MSLS, tuned by scenario and noise as it
was shipped before the bank, and of RLS.

Flight test (`judge_flight_test`): each manoeuvre's own derivatives at its end against batch least squares on the same
span and against the truth, at the end of the flight against the truth of then, how they move in 60 s of quiet, and how
the last A and B predict the same manoeuvre of a repeat, reversed and at three quarters, and how the true ones of the
end do: batch fits what is not linear, and noise in the regressors, and they do not. Beside it RLS with memories
of 1, 2, 4 and 8 s and MSLS with two settings, of which by each measure the best counts, which nobody knows beforehand.
Batch takes deflections as they are recorded, 14 ms before the responses, and is that much in error; where the bank has
found the delay its prediction takes the deflections of so long ago.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.calibration import truth_at
from benchmarks.calibration_beds import (
    Bed,
    Recorded,
    f16_beds,
    flight_test_beds,
    other_beds,
    record,
)
from benchmarks.flight_rows import Flight, Row, judge_flights
from msls_ros.estimation import Configuration, Estimate, EventKind, Identifier
from msls_ros.estimation.kernel import Array
from msls_ros.flights.closed_loop import RIGID_BODY
from msls_ros.flights.judging import AFTER, START, TICK
from msls_ros.flights.watch import Watch

SCENARIOS = (
    *("roll_doublet_tail_fault", "half_loss", "ramp_loss", "nozzle_failure", "strong", "turbulence"),
    "cruise_tail_fault",
)
RATIO = {"detector.mode": "ratio", "detector.window": 50, "detector.threshold": 3.5}
LOW = {"estimator.forgetting_factor": 0.96, "estimator.penalty": 9e-4, "recovery.penalty_factor": 0.3}
LOW_RAMP = {**LOW, "estimator.penalty": 6e-4, "recovery.penalty_factor": 0.4}
CRUISE = {"estimator.penalty_factors": [0.3] * 6 + [0.1] * 7 + [1.0]}
TUNED: Mapping[str, Mapping[str, Any]] = {
    "none": {"estimator.penalty": 3e-4},
    "low": LOW,
    "med": {"estimator.penalty": 1e-2, **RATIO},
}
"""MSLS by noise, as scenarios set it before the bank."""
OWN: Mapping[tuple[str, str], Mapping[str, Any]] = {
    ("ramp_loss", "low"): LOW_RAMP,
    ("strong", "low"): {},
    ("turbulence", "none"): {},
    ("turbulence", "low"): {},
}
"""Where a scenario had its own, instead."""
WINDOW = 2.0
"""Isolation of MSLS [s]."""
LARGE = 0.1
"""Of the largest number of a row, by the scale of its regressor."""
RATE = 10.0
"""Estimates that are judged [Hz]."""

HINDSIGHT: Mapping[str, Mapping[str, Any]] = {
    **{f"RLS {tau} s": {"estimator.method": "rls", "estimator.time_constant": float(tau)} for tau in (1, 2, 4, 8)},
    "MSLS .98": {"estimator.method": "msls", "estimator.time_constant": 1.98, "estimator.penalty": 0.01},
    "MSLS .99": {"estimator.method": "msls", "estimator.time_constant": 3.98, "estimator.penalty": 0.003},
}
"""Without detection, which helps them; lambda is that of 25 Hz, given in seconds."""
BATCH = {"estimator.method": "rls", "estimator.time_constant": 1e6, "detector.mode": "off"}
Span = tuple[float, float, tuple[tuple[str, str], ...]]
KEYS: tuple[Span, ...] = (
    (18.0, 45.0, (("Q", "de"), ("Q", "w"), ("Q", "Q"))),
    (45.0, 77.0, (("P", "da"), ("P", "P"))),
    (137.0, 173.5, (("R", "dr"), ("R", "v"))),
)
"""Begin and end of a manoeuvre with the free response after it [s], and its own derivatives."""
QUIET = (77.0, 137.0)
DRIFTING = (("Q", "de"), ("Q", "w"), ("P", "da"), ("P", "P"))
REPEAT = -0.75
REPEAT_SEED = 5000
"""Added to the seed."""
MEASURES = ("batch", "truth", "end", "drift", "r2_lost")


def f16_cells() -> list[Bed]:
    """Return the F-16's beds."""
    return list(f16_beds(SCENARIOS))


def smooth_beds(others: bool) -> list[Bed]:
    """Return flights of flight test in which nothing breaks."""
    variants = ("smooth", "dither", "gusts")
    return list(other_beds(variants=variants) if others else flight_test_beds(variants=variants))


def peers_f16(bed: Bed, seed: int) -> dict[str, Configuration]:
    """Return the identifiers by name."""
    ours = bed.configuration(seed)
    own = OWN.get((bed.scenario.name, bed.noise), TUNED[bed.noise])
    cruise = CRUISE if bed.scenario.condition == "cruise" else {}
    return {
        "bank": ours,
        "MSLS": ours.replace({"estimator.method": "msls", "isolation.window": WINDOW, **cruise, **own}),
        "RLS": ours.replace({"estimator.method": "rls"}),
    }


def estimates_of(configuration: Configuration, flight: Recorded) -> Sequence[Estimate]:
    """Return the estimates at `RATE`."""
    every = max(1, round(configuration.sample_rate / RATE))
    return Identifier(configuration).run(flight.time, flight.x, flight.xdot, flight.delta, every=every).estimates


def judge_f16(bed: Bed, seed: int, flight: Recorded) -> Row:
    """Return the errors of the three: by name, what and when, relative."""
    errors = {}
    scenario, watch = bed.scenario, bed.scenario.watch
    start, end = scenario.fault_start, scenario.fault_end
    for name, configuration in peers_f16(bed, seed).items():
        estimates = estimates_of(configuration, flight)
        time = np.array([one.time for one in estimates])
        before = (time > START) & (time <= (np.inf if start is None else start + TICK))
        after = np.zeros(len(time), bool) if end is None else time > end + AFTER
        truths = [truth_at(flight, t) for t in time]
        reference = truths[int(np.flatnonzero(before)[-1])]
        size = abs(watch.of(*reference))
        given = np.array([watch.of(one.a, one.b) for one in estimates])
        true = np.array([watch.of(a, b) for a, b in truths])
        found = {
            "watched": np.abs(given - true) / size,
        }
        for k, matrix in enumerate("AB"):
            pairs = zip(estimates, truths, strict=True)
            found[matrix] = np.array([row_errors(configuration, one, truth, k) for one, truth in pairs])
        errors[name] = {
            f"{what} {when}": float(np.sqrt(np.mean(np.square(values[at]))))
            for what, values in found.items()
            for when, at in (("before", before), ("after", after))
            if at.any()
        }
    return {"bed": bed.name, "seed": seed, "errors": errors}


def row_errors(configuration: Configuration, estimate: Estimate, truth: tuple[Array, Array], matrix: int) -> float:
    """Return the median over the rows of the relative error of the large numbers of A (0) or B (1)."""
    c = configuration
    body = [c.states.index(s) for s in RIGID_BODY if s in c.rows]
    columns = body if matrix == 0 else list(range(len(c.effectors)))
    scale = np.array([c.reference_speed if c.states[j] in "uvw" else 1.0 for j in body]) if matrix == 0 else 1.0
    found = []
    for i in body:
        known = np.asarray(estimate.a_known)[i, columns] if matrix == 0 else np.zeros(len(columns), bool)
        true = truth[matrix][i, columns] * scale
        large = ~known & (np.abs(true) >= LARGE * np.abs(true).max()) & (true != 0.0)
        if large.any():
            error = ((estimate.a, estimate.b)[matrix][i, columns] * scale - true)[large]
            found.append(np.linalg.norm(error) / np.linalg.norm(true[large]))
    return float(np.median(found))


def summarise_f16(rows: Sequence[Row]) -> Row:
    """Return the ratios by bed and quantity, their geometric mean, and how many are above 1 and 1.5."""
    cells = {}
    for bed in dict.fromkeys(row["bed"] for row in rows):
        chosen = [row["errors"] for row in rows if row["bed"] == bed]
        for what in chosen[0]["bank"]:
            median = {name: float(np.median([one[name][what] for one in chosen])) for name in chosen[0]}
            cells[f"{bed}: {what}"] = {**median, "ratio": median["bank"] / min(median["MSLS"], median["RLS"])}
    ratios = np.array([cell["ratio"] for cell in cells.values()])
    return {
        "cells": cells,
        "geometric_mean": float(np.exp(np.mean(np.log(ratios)))),
        "above_1": int((ratios > 1.0).sum()),
        "above_1.5": int((ratios > 1.5).sum()),
    }


def judge_flight_test(bed: Bed, seed: int, flight: Recorded, repeat: Recorded) -> Row:
    """Return by method: errors against batch and truth, drift, R2 lost on the repeat; and the bank's alarms."""
    ours = bed.configuration(seed)
    batches = [estimates_of(ours.replace(BATCH), clip(flight, begin, end))[-1] for begin, end, _ in KEYS]
    truths = [truth_at(flight, end) for _, end, _ in KEYS]
    expected = [r_squared(ours, one, clip(repeat, *span[:2]), span) for one, span in zip(batches, KEYS, strict=True)]
    methods: Row = {}
    row = {"bed": bed.name, "seed": seed, "methods": methods}
    for name, changes in {"bank": {}, **HINDSIGHT}.items():
        configuration = ours.replace({**changes, **({} if name == "bank" else {"detector.mode": "off"})})
        estimates = estimates_of(configuration, flight)
        time, last = np.array([one.time for one in estimates]), estimates[-1]
        at_end = truth_at(flight, last.time)
        if name == "bank":
            row["alarms"] = sum(e.kind == EventKind.DETECTED for one in estimates for e in one.events)
            row["delay"] = last.delay
            exact = replace(last, a=at_end[0], b=at_end[1])
            row["r2_lost_by_truth"] = {
                span[2][0][0]: best - r_squared(ours, exact, clip(repeat, *span[:2]), span)
                for span, best in zip(KEYS, expected, strict=True)
            }
        found: Row = {measure: {} for measure in MEASURES}
        for span, batch, truth, best in zip(KEYS, batches, truths, expected, strict=True):
            then = estimates[int(np.searchsorted(time, span[1])) - 1]
            for key in span[2]:
                right = pick(ours, truth, key)
                found["batch"]["/".join(key)] = relative(pick(ours, then, key), pick(ours, batch, key))
                found["truth"]["/".join(key)] = relative(pick(ours, then, key), right)
                found["end"]["/".join(key)] = relative(pick(ours, last, key), pick(ours, at_end, key))
            found["r2_lost"][span[2][0][0]] = best - r_squared(ours, last, clip(repeat, *span[:2]), span)
        first, later = (estimates[int(np.searchsorted(time, t)) - 1] for t in QUIET)
        for key in DRIFTING:
            found["drift"]["/".join(key)] = relative(pick(ours, later, key), pick(ours, first, key))
        methods[name] = found
    row["batch_to_truth"] = {
        "/".join(key): relative(pick(ours, batch, key), pick(ours, truth, key))
        for (_, _, keys), batch, truth in zip(KEYS, batches, truths, strict=True)
        for key in keys
    }
    return row


def clip(flight: Recorded, begin: float, end: float) -> Recorded:
    """Return the samples of a span [s]."""
    at = (flight.time >= begin) & (flight.time <= end)
    return replace(flight, time=flight.time[at], x=flight.x[at], xdot=flight.xdot[at], delta=flight.delta[at])


def pick(configuration: Configuration, model: Estimate | tuple[Array, Array], key: tuple[str, str]) -> float:
    """Return one number of A or B."""
    a, b = model if isinstance(model, tuple) else (model.a, model.b)
    return float(Watch(*key, configuration.effectors).of(a, b))


def relative(value: float, reference: float) -> float:
    """Return the relative error [1]."""
    return abs(value - reference) / max(abs(reference), 1e-12)


def r_squared(configuration: Configuration, estimate: Estimate, flight: Recorded, span: Span) -> float:
    """Return which share of the variance of the span's own output A and B predict, bias free, deflections delayed."""
    i = configuration.states.index(span[2][0][0])
    lagged = [np.interp(flight.time - estimate.delay, flight.time, column) for column in flight.delta.T]
    predicted = flight.x @ estimate.a[i] + np.array(lagged).T @ estimate.b[i]
    return 1.0 - float(np.var(flight.xdot[:, i] - predicted) / np.var(flight.xdot[:, i]))


def over_derivatives(values: Mapping[str, float], measure: str) -> float:
    """Return the worst R2 that is lost, or the median of another measure."""
    several = list(values.values())
    return float(np.max(several)) if measure == "r2_lost" else float(np.median(several))


def summarise_flight_test(rows: Sequence[Row]) -> Row:
    """Return by bed the medians of the bank, and of the best of the others by each measure."""
    beds = {}
    for name in dict.fromkeys(row["bed"] for row in rows):
        chosen = [row for row in rows if row["bed"] == name]
        cell: Row = {"alarms": sum(row["alarms"] for row in chosen) / len(chosen)}
        for measure in MEASURES:
            by_method = {
                method: float(np.median([over_derivatives(row["methods"][method][measure], measure) for row in chosen]))
                for method in chosen[0]["methods"]
            }
            best = min((v, k) for k, v in by_method.items() if k != "bank")
            cell[measure] = {"bank": by_method["bank"], "best": best[0], "which": best[1]}
        cell["r2_lost_by_truth"] = float(np.median([max(row["r2_lost_by_truth"].values()) for row in chosen]))
        cell["truth_max"] = max(max(row["methods"]["bank"]["truth"].values()) for row in chosen)
        cell["batch_to_truth"] = float(np.median([np.median(list(r["batch_to_truth"].values())) for r in chosen]))
        beds[name] = cell
    return beds


def fly_and_judge(flight: Flight, folder: Path | None, part: str) -> list[Row]:
    """Return the row of a flight, in a list; see `measure`."""
    bed, seed = flight.bed, flight.seed
    recorded = record(bed, seed, folder)
    if part == "f16":
        return [judge_f16(bed, seed, recorded)]
    scale = REPEAT * bed.scenario.manoeuvre_scale
    again = replace(bed, name=f"{bed.name} repeat", scenario=replace(bed.scenario, manoeuvre_scale=scale))
    return [judge_flight_test(bed, seed, recorded, record(again, seed + REPEAT_SEED, folder))]


def measure(
    seeds: Sequence[int],
    folder: Path | None,
    say: Callable[[str], None],
    parts: Sequence[str],
    others: bool = False,
    *,
    jobs: int = 1,
    stopped: Callable[[], bool] = lambda: False,
) -> Row:
    """Fly and judge; what stands in the folder from an earlier call with the same code is not done again.

    Parameters
    ----------
    seeds
        Of each bed.
    folder
        Where flights and results are kept; None: nowhere.
    say
        Called with a line about every flight.
    parts
        Some of ``f16`` and ``flight_test``.
    others
        Nineteen other aircraft in flight test, instead of four.
    jobs, stopped
        See `judge_flights`, which raises `FleetError` and `KeyboardInterrupt`.
    """
    result: Row = {"seeds": list(seeds)}
    for part in parts:
        beds = f16_cells() if part == "f16" else smooth_beds(others)
        flights = [Flight(bed, seed) for bed in beds for seed in seeds]
        fly = partial(fly_and_judge, folder=folder, part=part)
        rows = judge_flights(fly, flights, folder, f"accuracy-{part}", say, jobs=jobs, stopped=stopped)
        result[part] = summarise_f16(rows) if part == "f16" else summarise_flight_test(rows)
    return result


def render(result: Row) -> str:
    """Return the tables as text."""
    lines = []
    if "f16" in result:
        f16 = result["f16"]
        lines.append(
            "\nF-16, relative error, median over seeds: bank, MSLS tuned by noise, RLS; ratio to the better one"
        )
        lines += [
            f"{name:50}{c['bank']:9.4f}{c['MSLS']:9.4f}{c['RLS']:9.4f}{c['ratio']:7.2f}"
            for name, c in f16["cells"].items()
        ]
        lines.append(
            f"geometric mean {f16['geometric_mean']:.2f}; {f16['above_1']} of {len(f16['cells'])} cells above 1, "
            f"{f16['above_1.5']} above 1.5"
        )
    if "flight_test" in result:
        lines.append(
            "\nflight test, bank / best in hindsight: against batch on the same span, against the truth, so at the end;"
            "\ndrift in 60 s of quiet; R2 lost against batch on the repeat, worst of three, and by the true A and B"
        )
        for name, c in result["flight_test"].items():
            cells = "".join(f"{_pair(c[measure]):>14}" for measure in MEASURES)
            rest = f"batch to truth {c['batch_to_truth']:.3f}, {c['alarms']:.1f} alarms"
            lines.append(f"{name:28}{cells}{c['r2_lost_by_truth']:9.3f}  {rest}")
        lines.append(f"{'median':28}" + "".join(f"{_median(result['flight_test'], m):>14}" for m in MEASURES))
    return "\n".join(lines)


def _pair(cell: Row) -> str:
    return f"{cell['bank']:.3f}/{cell['best']:.3f}"


def _median(beds: Row, measure: str) -> str:
    return _pair({who: float(np.median([cell[measure][who] for cell in beds.values()])) for who in ("bank", "best")})
