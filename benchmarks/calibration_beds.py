"""The beds of `calibration`: flights of the F-16 and of flight test, flown once and kept, as the inputs of identifiers.

Every bed flies with the shipped profile of its aircraft; nothing is set for a bed, a noise or a rate. What is kept of a
flight (samples, truth, what breaks) serves any number of identifiers after it.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from msls_ros.estimation import Configuration
from msls_ros.estimation.kernel import Array
from msls_ros.estimation.spikes import SpikeFilter, spike_settings
from msls_ros.fleet.work import running_code
from msls_ros.flights.aircraft_files import find_aircraft
from msls_ros.flights.closed_loop import Rates, fly
from msls_ros.flights.scenarios import Scenario, find_scenario
from msls_ros.inputs.derivatives import DerivativeFilter, usual_intervals
from msls_ros.inputs.frames import euler_rates

F16 = (
    *("roll_doublet_tail_fault", "half_loss", "ramp_loss", "nozzle_failure", "strong", "turbulence"),
    *("cruise_tail_fault", "roll_doublet"),
)
AIRCRAFT = ("A4", "c172x", "T37", "J3Cub")
VANES = {"A4": 7.6, "c172x": 2.2, "T37": 3.0, "J3Cub": 1.2}
"""Ahead of the centre of mass [m]."""
OTHERS = {
    "737": (15.0, 197.34),
    "c310": (2.0, 87.04),
    "DHC6": (5.0, 73.15),
    "F80C": (5.0, 168.62),
    "OV10": (4.0, 98.64),
    "f15": (8.0, 246.67),
    "pa28": (1.5, 57.32),
    "t6texan2": (3.0, 104.45),
    "F4N": (6.0, 207.53),
    "global5000": (12.0, 197.34),
    "c182": (2.0, 60.05),
    "Concorde": (20.0, 268.97),
    "B747": (20.0, 211.43),
    "T38": (5.0, 178.47),
    "MD11": (25.0, 205.46),
    "A320": (15.0, 192.67),
    "787-8": (25.0, 192.58),
    "Boeing314": (12.0, 73.06),
    "c172p": (2.2, 54.53),
}
"""Aircraft that no constant is chosen on, but that .04 for the detector's floor was looked at on the first eight; the
next five were flown when all was done, the last six long after that. Vane ahead of the centre of mass [m], true
airspeed [m/s]."""
OTHER_FILES = Path(__file__).parent / "aircraft"
RATES = (25, 50, 100)
VARIANTS = ("smooth", "dither", "gusts", "loss")
DITHER = {
    "dither.cap": 0.004363,
    "dither.cap_unreliable": 0.004363,
    "dither.limit_nominal": 0.05,
    "dither.limit_boosted": 0.05,
}
QUIET_DITHER = {"dither.limit_nominal": 0.0, "dither.limit_boosted": 0.0}
GUSTS = 0.3
"""[m/s]"""
RESTING = ("resting", "resting loss")
"""Variants with the sensors of surfaces that most have; half of the rudder is lost at rest, at `LOST_AT`."""
SURFACE_NOISE = math.radians(0.05)
"""[rad]"""
LOST_AT = 147.0
"""[s], between two of its doublets."""
PATHS = ("direct", "mapped")


@dataclass(frozen=True)
class Bed:
    """A cell of the table: what is flown with many seeds."""

    name: str
    group: str
    """``F-16``, ``intact``, ``flight test`` or ``other aircraft``."""
    scenario: Scenario
    noise: str
    changes: tuple[tuple[str, Any], ...] = ()
    """Of the dither and the reference speed, by full name."""

    def configuration(self, seed: int) -> Configuration:
        """Return the identifier's: the profile as it ships."""
        return self.scenario.configuration(self.noise, seed, dither=True).replace(dict(self.changes))

    def fly(self, seed: int) -> Recorded:
        """Fly it; the seed is that of sensors, air and dither."""
        log = fly(self.configuration(seed), self.scenario.flight(self.noise, seed), sparse=True)
        at = list(log.truths)
        return Recorded(
            np.array(log.time),
            np.array(log.x),
            np.array(log.xdot),
            np.array(log.delta),
            np.array(log.time)[at],
            np.array([log.truths[k].a for k in at]),
            np.array([log.truths[k].b for k in at]),
        )


@dataclass(frozen=True)
class Recorded:
    """One flight; n samples, k truths."""

    time: Array
    """(n,) [s]."""
    x: Array
    xdot: Array
    delta: Array
    truth_time: Array
    """(k,) [s]."""
    truth_a: Array
    """(k, 9, 9)."""
    truth_b: Array
    """(k, 9, m)."""


def f16_beds(names: tuple[str, ...] = F16, noises: tuple[str, ...] = ("none", "low", "med")) -> Iterator[Bed]:
    """Yield the scenarios that ship, at each noise."""
    for name in names:
        for noise in noises:
            yield Bed(f"{name} {noise}", "F-16", find_scenario(name), noise)


def intact_beds(airs: tuple[str, ...] = ("none", "moderate", "severe"), duration: float = 60.0) -> Iterator[Bed]:
    """Yield flights in which nothing breaks, in still and moving air: every alarm is false."""
    for air in airs:
        for noise in ("none", "low", "med"):
            scenario = replace(find_scenario("roll_doublet"), turbulence=air, duration=duration, name=f"intact_{air}")
            yield Bed(f"intact {air} air {noise}", "intact", scenario, noise)


def flight_test_beds(
    aircraft: tuple[str, ...] = AIRCRAFT,
    rates: tuple[int, ...] = RATES,
    variants: tuple[str, ...] = VARIANTS,
) -> Iterator[Bed]:
    """Yield flights of flight test without noise but that of real sensors."""
    for name in aircraft:
        for rate in rates:
            for variant in variants:
                yield Bed(
                    f"{name} {rate} Hz {variant}",
                    "flight test",
                    flight_test(name, rate, variant),
                    "none",
                    tuple((DITHER if variant == "dither" else QUIET_DITHER).items()),
                )


def resting_beds(aircraft: tuple[str, ...] = AIRCRAFT, rates: tuple[int, ...] = RATES) -> Iterator[Bed]:
    """Yield flights of flight test in which surfaces that rest have noise that no motion answers."""
    for bed in flight_test_beds(aircraft, rates, RESTING):
        yield replace(bed, group="noisy surfaces")


def other_beds(rates: tuple[int, ...] = RATES, variants: tuple[str, ...] = VARIANTS) -> Iterator[Bed]:
    """Yield flights of flight test of `OTHERS`; their profile has names, rate and speed."""
    for bed in flight_test_beds(tuple(OTHERS), rates, variants):
        _, speed = OTHERS[bed.name.split()[0]]
        yield replace(bed, group="other aircraft", changes=(*bed.changes, ("reference_speed", speed)))


def flight_test(name: str, rate: int, variant: str) -> Scenario:
    """Return the scenario of a flight test: an aircraft of `AIRCRAFT` or `OTHERS`, a rate [Hz], a variant."""
    suffix = "_aileron_half" if "loss" in variant else ""
    base = find_scenario(f"flight_test_A4{suffix}")
    data = find_aircraft(OTHER_FILES / f"{name}.yaml" if name in OTHERS else name)
    vane = OTHERS[name][0] if name in OTHERS else VANES[name]
    dynamics = max(100, math.ceil(data.airframe.least_rate / rate) * rate)
    sensors, faults = base.instruments, [replace(fault, airframe=data.airframe) for fault in base.faults]
    if sensors is not None and variant in RESTING:
        sensors = sensors.changed({"white": (("deflection", SURFACE_NOISE),)})
        faults = [replace(fault, effector="dr", time=LOST_AT) for fault in faults]
    return replace(
        base,
        name=f"flight_test_{name}_{rate}_{variant}",
        aircraft=data,
        condition=data.condition_names[0],
        profile=base.profile if name in OTHERS else name,
        gusts=GUSTS if variant == "gusts" else 0.0,
        rates=Rates(dynamics, rate, 5),
        faults=tuple(faults),
        instruments=None if sensors is None else replace(sensors, vane_position=vane),
        parameters={},
    )


def record(bed: Bed, seed: int, folder: Path | None) -> Recorded:
    """Fly, or read what an earlier call has flown with the same code.

    Parameters
    ----------
    bed, seed
        What to fly; the seed is that of sensors, air and dither.
    folder
        Where flights are kept; None: nowhere.
    """
    decides = (bed, bed.scenario.flight(bed.noise, seed), bed.configuration(seed), running_code())
    key = hashlib.sha256(repr(decides).encode()).hexdigest()[:16]
    file = None if folder is None else folder / f"{bed.name.replace(' ', '_')}-{seed}-{key}.npz"
    if file is not None and file.is_file():
        with np.load(file) as kept:
            return Recorded(**{name: kept[name] for name in kept.files})
    found = bed.fly(seed)
    if file is not None:
        part = file.with_suffix(f".{os.getpid()}.part.npz")  # another process may fly the same
        try:
            np.savez_compressed(part, **vars(found))
            part.replace(file)
        finally:
            part.unlink(missing_ok=True)
    return found


def kept_rows(folder: Path | None, name: str) -> tuple[Path | None, list[dict[str, Any]]]:
    """Return the file of JSON lines of a folder that belongs to the running code, and the rows that stand in it."""
    if folder is None:
        return None, []
    folder.mkdir(parents=True, exist_ok=True)
    code = hashlib.sha256(running_code().encode()).hexdigest()[:16]
    file = folder / f"{name}-{code}.jsonl"
    text = file.read_text(encoding="utf-8") if file.is_file() else ""
    if text and not text.endswith("\n"):  # torn by the end of an earlier call: what is appended begins a line
        with file.open("a", encoding="utf-8") as opened:
            opened.write("\n")
    return file, [row for line in text.splitlines() if (row := _whole(line)) is not None]


def _whole(line: str) -> dict[str, Any] | None:
    try:
        row: dict[str, Any] = json.loads(line)
    except json.JSONDecodeError:
        return None
    return row


def keep_row(file: Path | None, row: dict[str, Any]) -> None:
    """Append a row to such a file; None: nowhere."""
    if file is not None:
        with file.open("a", encoding="utf-8") as opened:
            opened.write(json.dumps(row) + "\n")


def mapped(flight: Recorded, sample_rate: float) -> tuple[Array, Array, Array, Array]:
    """Return the samples as mapped inputs give them at a rate [Hz]: rates differentiated, all in the same window.

    Returns
    -------
    tuple
        Time, states, derivatives and deflections.
    """
    n, m = flight.x.shape[1], flight.delta.shape[1]
    window = DerivativeFilter(usual_intervals(sample_rate), 2 * n + m, round(1e9))
    velocity = [k < 3 for k in range(n)]
    moved = [*[False] * n, *[True] * m, *[False] * n]
    kinds = [*velocity, *[False] * m, *velocity], [*[False] * (n + m), *[True] * n]
    spikes = SpikeFilter(spike_settings(*kinds, float(np.median(flight.x[:, 0])), 1.0, effector=moved))
    rows = []
    for k in range(len(flight.time)):
        x, known = flight.x[k], flight.xdot[k].copy()
        known[6:9] = euler_rates((x[3], x[4], x[5]), (x[6], x[7]))
        for stamp, row in spikes.push(round(flight.time[k] * 1e9), np.concatenate([x, flight.delta[k], known])):
            filtered = window.push(stamp, row)
            if filtered is not None:
                derivative = filtered.smooth[n + m :].copy()
                derivative[3:6] = filtered.slope[3:6]
                rows.append((filtered.stamp * 1e-9, filtered.smooth[:n], derivative, filtered.smooth[n : n + m]))
    time, states, derivatives, deflections = (np.array(column) for column in zip(*rows, strict=True))
    return time, states, derivatives, deflections
