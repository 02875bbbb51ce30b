"""What a flight shows: the recorded estimate, MSLS without detection and RLS on the same samples, all against truth."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msls_ros.commands import offline
from msls_ros.commands.offline import Flight
from msls_ros.commands.scenarios import Scenario
from msls_ros.commands.watch import Watch
from msls_ros.estimation import Configuration
from msls_ros.plant import ACTUATORS, EFFECTORS, PILOT_STATION, STATES

Array = NDArray[np.float64]
Alarms = Sequence[tuple[float, tuple[str, ...]]]
"""Time [s] and equations."""
GRAVITY = 9.80665
SETTLED = 0.1
"""An estimate has settled when its error stays below this share of the true value before the fault."""
START = 1.0
"""Errors before the fault count from here [s]."""
ALARM_WINDOW = 1.0
"""An alarm after a fault, at most this after the end of its ramp, is its detection; any other is false [s]."""
AFTER = 1.0
"""Errors after the fault count from here, after the end of its ramp [s]."""
TICK = 1e-6
"""Stamps of one sample may differ by less [s]."""
PEERS: Mapping[str, Mapping[str, Any]] = {
    "msls_no_detection": {"detector.mode": "off"},
    "rls": {"estimator.method": "rls"},
}


@dataclass(frozen=True)
class Comparison:
    """Time histories of one flight; n samples."""

    time: Array
    truth: Array
    """(n,) the watched parameter."""
    estimates: Mapping[str, Array]
    """(n,) of msls (as recorded), msls_no_detection, rls."""
    std: Array
    """(n,) standard error of the recorded estimate."""
    reliable: NDArray[np.bool_]
    """(n,) published as reliable."""
    alpha: Array
    beta: Array
    """(n,) true angle of attack and sideslip [rad]."""
    x: Array
    """(n, 9) true states."""
    delta: Array
    """(n, 7) measured deflections [rad]."""
    dither: Array
    """(n, 7) dither commands [rad]."""
    dither_rms: Array
    """(n,) rms wanted at the surfaces [rad]."""
    predicted: Array
    limit: Array
    """(n,) predicted rms acceleration at the pilot and its limit [g]."""
    realised: Array
    """(n, 3) acceleration at the pilot's station by the dither alone, through actuators and the true B [g]."""
    boosted: NDArray[np.bool_]
    events: Sequence[tuple[float, str, tuple[str, ...]]]
    """Time [s], kind and equations."""


def compare(bag: str | Path, configuration: Configuration, watch: Watch) -> Comparison:
    """Read a recorded flight of the demo and identify it again with the peers.

    Parameters
    ----------
    bag
        Of the flight.
    configuration
        Of the identifier that flew.
    watch
        The parameter to compare.
    """
    flight = offline.load(bag)
    samples, _ = offline.paired(bag, configuration)
    models = flight.topic("model")
    dither = [m for _, m in flight.topic("dither")]
    truth_a, truth_b = _hold_truth(flight, samples.time)
    estimates = {"msls": _published(models, watch)}
    for name, changes in PEERS.items():
        peer = offline.identify(samples, configuration.replace(changes))
        estimates[name] = np.array([watch.of(e.a, e.b) for e in peer])
    x = np.array([m.x for _, m in flight.topic("truth/state")])
    commands = np.array([m.delta for m in dither])
    return Comparison(
        time=samples.time,
        truth=watch.of(truth_a, truth_b),
        estimates=estimates,
        std=_published(models, watch, "_std"),
        reliable=_published(models, watch, "_reliable").astype(np.bool_),
        alpha=np.arctan2(x[:, 2], x[:, 0]),
        beta=np.arcsin(x[:, 1] / np.linalg.norm(x[:, :3], axis=1)),
        x=x,
        delta=samples.delta,
        dither=commands,
        dither_rms=np.array([m.rms for m in dither]),
        predicted=np.array([m.predicted_acceleration for m in dither]),
        limit=np.array([m.acceleration_limit for m in dither]),
        realised=realised_acceleration(samples.time, commands, truth_b),
        boosted=np.array([m.level == m.LEVEL_BOOSTED for m in dither]),
        events=[
            (t * 1e-9, ("", "detected", "isolated", "recovered")[m.kind], tuple(m.equations))
            for t, m in flight.topic("fault")
        ],
    )


def _published(models: Sequence[tuple[int, Any]], watch: Watch, of: str = "") -> Array:
    """Return a parameter, or what is said ``of`` it, as the models have it (n,)."""
    row, column = watch.place
    matrix, width = ("b", len(EFFECTORS)) if watch.in_b else ("a", len(STATES))
    return np.array([getattr(m, matrix + of)[row * width + column] for _, m in models], dtype=np.float64)


def _hold_truth(flight: Flight, time: Array) -> tuple[Array, Array]:
    """Return the true A (n, 9, 9) and B (n, 9, 7) at each sample: linear between the published ones."""
    published = flight.topic("truth/model")
    at = np.array([t * 1e-9 for t, _ in published])
    flat = np.array([np.concatenate((m.a, m.b)) for _, m in published])
    columns = np.stack([np.interp(time, at, column) for column in flat.T], axis=1)
    a, b = np.split(columns, [len(STATES) ** 2], axis=1)
    return a.reshape(-1, len(STATES), len(STATES)), b.reshape(-1, len(STATES), len(EFFECTORS))


def realised_acceleration(time: Array, commands: Array, truth_b: Array) -> Array:
    """Acceleration (n, 3) at the pilot's station by the dither alone [g] (eq 20), through first-order actuators.

    Parameters
    ----------
    time
        (n,) [s].
    commands
        (n, 7) dither [rad], held from each sample to the next.
    truth_b
        (n, 9, 7) true B.
    """
    forward, above = PILOT_STATION
    pole = np.exp(-np.array([a.bandwidth for a in ACTUATORS]) * float(np.median(np.diff(time))))
    surface = np.zeros_like(commands)
    for k in range(1, len(commands)):
        surface[k] = pole * surface[k - 1] + (1.0 - pole) * commands[k - 1]
    u, v, w, p, q, r = np.einsum("nij,nj->in", truth_b[:, :6], surface)
    return np.stack([u, v + above * p + forward * r, w - forward * q], axis=1) / GRAVITY


def summarise(scenario: Scenario, c: Comparison) -> dict[str, Any]:
    """Return the numbers of a flight: detection, false alarms, errors of the watched parameter, dither.

    Before the fault is before the first one strikes; afterwards is after the end of the last ramp.
    """
    start, end = scenario.fault_start, scenario.fault_end
    before = c.time <= (c.time[-1] if start is None else start) + TICK
    truth_before = float(c.truth[before][-1])
    watched: dict[str, Any] = {
        "truth_before": truth_before,
        "truth_after": None if end is None else _first(c.truth[c.time > end + TICK]),
        "reliable_share_before": _mean(c.reliable[before & (c.time > START)]),
    }
    watched.update({name: _errors(c, name, start, end, truth_before) for name in c.estimates})
    alarms = [(t, equations) for t, kind, equations in c.events if kind == "detected"]
    detections = [_detection(span, alarms) for span in scenario.fault_spans]
    true = [a for a in alarms if any(_belongs(a[0], span) for span in scenario.fault_spans)]
    return {
        "watch": "/".join(scenario.watch),
        "detection": detections[0] if detections else _detection(None, alarms),
        "detections": detections,
        "false_alarms": len(alarms) - len(true),
        scenario.watch.symbol: watched,
        "dither": _dither(c),
        "flight": {
            "alpha_error_max_deg": float(np.degrees(np.abs(c.alpha - c.alpha[0]).max())),
            "sideslip_max_deg": float(np.degrees(np.abs(c.beta).max())),
            "finite": bool(all(np.isfinite(v).all() for v in (c.x, c.delta, c.dither, *c.estimates.values()))),
        },
    }


def _belongs(time: float, span: tuple[float, float]) -> bool:
    """Whether an alarm may be the detection of a fault that begins and has ended its ramp at these times."""
    return span[0] + TICK < time <= span[1] + ALARM_WINDOW + TICK


def _detection(span: tuple[float, float] | None, alarms: Alarms) -> dict[str, Any]:
    """Return when and in which equations a fault was seen first."""
    first = next((a for a in alarms if span is not None and _belongs(a[0], span)), None)
    return {
        "time_s": round(first[0], 9) if first else None,
        "delay_s": round(first[0] - span[0], 9) if first and span is not None else None,
        "equations": list(first[1]) if first else [],
    }


def _errors(
    c: Comparison, name: str, start: float | None, end: float | None, truth_before: float
) -> dict[str, float | None]:
    """Errors of one estimate relative to the true value before the fault; settled counts from the end of its ramp."""
    error = np.abs(c.estimates[name] - c.truth) / (abs(truth_before) or np.nan)
    early = c.time > START
    if start is None or end is None:
        return {"settle_s": None, "rms_before": _rms(error[early]), "rms_after": None, "peak_error": None}
    struck, over = c.time > start + TICK, c.time > end + TICK
    late = c.time[over & (error > SETTLED)]
    return {
        "settle_s": (round(float(late[-1] - end), 9) if len(late) else 0.0) if over.any() else None,
        "rms_before": _rms(error[early & ~struck]),
        "rms_after": _rms(error[c.time > end + AFTER]),
        "peak_error": float(error[struck].max()) if struck.any() else None,
    }


def _dither(c: Comparison) -> dict[str, float]:
    """Return the dither's numbers; the realised rms over the nominal and over the boosted samples."""
    total = np.linalg.norm(c.realised, axis=1)
    nominal, boosted = ~c.boosted, c.boosted
    return {
        "predicted_g_max": float(c.predicted.max()),
        "predicted_g_max_nominal": float(c.predicted[nominal].max()),
        "realised_g_rms": _rms(total[nominal]),
        "realised_g_rms_boosted": _rms(total[boosted]) if boosted.any() else 0.0,
        "rms_rad_max": float(c.dither_rms.max()),
    }


def _rms(values: Array) -> float:
    return math.sqrt(_mean(np.square(values)))


def _mean(values: NDArray[Any]) -> float:
    return float(np.mean(values)) if len(values) else math.nan


def _first(values: Array) -> float | None:
    return float(values[0]) if len(values) else None
