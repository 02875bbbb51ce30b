"""What a flight shows: the recorded estimate, MSLS without detection and RLS on the same samples, all against truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msls_ros.commands import offline
from msls_ros.commands.offline import Flight
from msls_ros.commands.scenarios import Scenario
from msls_ros.estimation import Configuration
from msls_ros.plant import ACTUATORS, EFFECTORS, PILOT_STATION, STATES

Array = NDArray[np.float64]
ROW, COLUMN = STATES.index("P"), EFFECTORS.index("ddt")
GRAVITY = 9.80665
SETTLED = 0.1
"""An estimate has settled when its error stays below this share of the true value before the fault."""
START = 1.0
"""Errors before the fault count from here [s]."""
ALARM_WINDOW = 1.0
"""An alarm within this time of the fault is its detection; any other is false [s]."""
PEERS: Mapping[str, Mapping[str, Any]] = {
    "msls_no_detection": {"detector.mode": "off"},
    "rls": {"estimator.method": "rls"},
}


@dataclass(frozen=True)
class Comparison:
    """Time histories of one flight; n samples."""

    time: Array
    truth: Array
    """(n,) b43, dPdot/d ddt [1/s^2]."""
    estimates: Mapping[str, Array]
    """(n,) b43 of msls (as recorded), msls_no_detection, rls."""
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


def compare(bag: str | Path, configuration: Configuration) -> Comparison:
    """Read a recorded flight of the demo and identify it again with the peers."""
    flight = offline.load(bag)
    samples, _ = offline.paired(bag, configuration)
    models = flight.topic("model")
    dither = [m for _, m in flight.topic("dither")]
    truth_b = _hold_truth(flight, samples.time)
    estimates = {"msls": np.array([_at(m.b) for _, m in models])}
    for name, changes in PEERS.items():
        peer = offline.identify(samples, configuration.replace(changes))
        estimates[name] = np.array([e.b[ROW, COLUMN] for e in peer])
    x = np.array([m.x for _, m in flight.topic("truth/state")])
    commands = np.array([m.delta for m in dither])
    return Comparison(
        time=samples.time,
        truth=truth_b[:, ROW, COLUMN],
        estimates=estimates,
        std=np.array([_at(m.b_std) for _, m in models]),
        reliable=np.array([_at(m.b_reliable) for _, m in models], dtype=np.bool_),
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


def _at(matrix: Any) -> Any:
    return matrix[ROW * len(EFFECTORS) + COLUMN]


def _hold_truth(flight: Flight, time: Array) -> Array:
    """Return the true B (n, 9, 7) at each sample: linear between the published ones."""
    published = flight.topic("truth/model")
    at = np.array([t * 1e-9 for t, _ in published])
    b = np.array([m.b for _, m in published])
    columns = [np.interp(time, at, b[:, i]) for i in range(b.shape[1])]
    return np.stack(columns, axis=1).reshape(-1, len(STATES), len(EFFECTORS))


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
    """Return the numbers of a flight: detection, false alarms, errors of b43, dither."""
    fault = scenario.fault_time if scenario.has_fault else None
    alarms = [(t, equations) for t, kind, equations in c.events if kind == "detected"]
    after = [a for a in alarms if fault is not None and fault < a[0] <= fault + ALARM_WINDOW]
    first = after[0] if after else None
    before = c.time <= fault if fault is not None else np.ones(len(c.time), np.bool_)
    truth_before = float(c.truth[before][-1])
    b43: dict[str, Any] = {
        "truth_before": truth_before,
        "truth_after": float(c.truth[~before][0]) if fault is not None else None,
        "reliable_share_before": float(c.reliable[before & (c.time > START)].mean()),
    }
    b43.update({name: _errors(c, name, fault, truth_before) for name in c.estimates})
    return {
        "detection": {
            "time_s": round(first[0], 9) if first else None,
            "delay_s": round(first[0] - fault, 9) if first and fault is not None else None,
            "equations": list(first[1]) if first else [],
        },
        "false_alarms": len(alarms) - len(after),
        "b43": b43,
        "dither": _dither(c),
        "flight": {
            "alpha_error_max_deg": float(np.degrees(np.abs(c.alpha - c.alpha[0]).max())),
            "sideslip_max_deg": float(np.degrees(np.abs(c.beta).max())),
            "finite": bool(all(np.isfinite(v).all() for v in (c.x, c.delta, c.dither, *c.estimates.values()))),
        },
    }


def _errors(c: Comparison, name: str, fault: float | None, truth_before: float) -> dict[str, float | None]:
    """Errors of one estimate relative to the true value before the fault."""
    error = np.abs(c.estimates[name] - c.truth) / abs(truth_before)
    early = c.time > START
    if fault is None:
        return {"settle_s": None, "rms_before": _rms(error[early]), "rms_after": None, "peak_error": None}
    post = c.time > fault
    late = c.time[post & (error > SETTLED)]
    return {
        "settle_s": round(float(late[-1] - fault), 9) if len(late) else 0.0,
        "rms_before": _rms(error[early & ~post]),
        "rms_after": _rms(error[c.time > fault + 1.0]),
        "peak_error": float(error[post].max()),
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
    return float(np.sqrt(np.mean(np.square(values))))
