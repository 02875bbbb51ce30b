"""What a flight shows: the recorded estimate, MSLS without detection and RLS on the same samples, all against truth."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msls_ros.flights.judging import START, TICK, detection, errors, false_alarms, mean, rms
from msls_ros.flights.scenarios import Scenario
from msls_ros.plant import F16_MATV, Airframe

Array = NDArray[np.float64]
GRAVITY = 9.80665


@dataclass(frozen=True)
class Comparison:
    """Time histories of one flight; n samples."""

    time: Array
    truth: Array
    """(n,) the watched parameter."""
    estimates: Mapping[str, Array]
    """(n,) by method: first the one that flew, as recorded, then its `PEERS`."""
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
    """(n, m) measured deflections [rad]."""
    dither: Array
    """(n, m) dither commands [rad]."""
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


def realised_acceleration(time: Array, commands: Array, truth_b: Array, airframe: Airframe = F16_MATV) -> Array:
    """Acceleration (n, 3) at the pilot's station by the dither alone [g], through first-order actuators.

    Eq 20 with the axial term ``-l2 Qdot`` that it leaves out: the station is a point of a rigid body.

    Parameters
    ----------
    time
        (n,) [s].
    commands
        (n, m) dither [rad], held from each sample to the next.
    truth_b
        (n, 9, m) true B.
    airframe
        Of which actuators and the pilot's station are taken.
    """
    forward, above = airframe.station
    pole = np.exp(-np.array([a.bandwidth for a in airframe.actuators]) * float(np.median(np.diff(time))))
    surface = np.zeros_like(commands)
    for k in range(1, len(commands)):
        surface[k] = pole * surface[k - 1] + (1.0 - pole) * commands[k - 1]
    u, v, w, p, q, r = np.einsum("nij,nj->in", truth_b[:, :6], surface)
    return np.stack([u - above * q, v + above * p + forward * r, w - forward * q], axis=1) / GRAVITY


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
        "reliable_share_before": mean(c.reliable[before & (c.time > START)]),
    }
    faults = None if start is None or end is None else (start, end)
    watched.update({name: errors(c.time, one, c.truth, faults, truth_before) for name, one in c.estimates.items()})
    alarms = [(t, equations) for t, kind, equations in c.events if kind == "detected"]
    detections = [detection(span, alarms) for span in scenario.fault_spans]
    return {
        "watch": str(scenario.watch),
        "detection": detections[0] if detections else detection(None, alarms),
        "detections": detections,
        "false_alarms": false_alarms(scenario.fault_spans, alarms),
        scenario.watch.symbol: watched,
        "dither": {
            **dither_figures(c.time, c.realised, c.predicted, c.limit, c.boosted),
            "rms_rad_max": float(c.dither_rms.max()),
        },
        "flight": {
            "alpha_error_max_deg": float(np.degrees(np.abs(c.alpha - c.alpha[0]).max())),
            "sideslip_max_deg": float(np.degrees(np.abs(c.beta).max())),
            "finite": bool(all(np.isfinite(v).all() for v in (c.x, c.delta, c.dither, *c.estimates.values()))),
        },
    }


def dither_figures(
    time: Array, realised: Array, predicted: Array, limit: Array, boosted: NDArray[np.bool_]
) -> dict[str, float]:
    """Return what the dither was predicted to be felt as and what was felt, nominal and boosted samples apart [g].

    ``realised_of_limit_1s_max`` is the largest rms over 1 s of the realised acceleration over its limit [1].

    Parameters
    ----------
    time
        (n,) [s].
    realised
        (n, 3) see `realised_acceleration` [g].
    predicted, limit
        (n,) [g].
    boosted
        (n,) whether the limit is that after an alarm.
    """
    total = np.linalg.norm(realised, axis=1)
    nominal = ~boosted
    shares = np.square(total / np.where(limit > 0.0, limit, math.inf))
    width = min(max(round(1.0 / float(np.median(np.diff(time)))), 1), len(shares))
    windows = np.convolve(shares, np.full(width, 1.0 / width), "valid")
    return {
        "realised_of_limit": math.sqrt(float(shares.mean())),
        "realised_of_limit_1s_max": math.sqrt(float(windows.max())),
        "predicted_g_max": float(predicted.max()),
        "predicted_g_max_nominal": float(predicted[nominal].max()) if nominal.any() else 0.0,
        "predicted_g_rms": rms(predicted[nominal]) if nominal.any() else 0.0,
        "realised_g_rms": rms(total[nominal]) if nominal.any() else 0.0,
        "realised_g_rms_boosted": rms(total[boosted]) if boosted.any() else 0.0,
    }


def _first(values: Array) -> float | None:
    return float(values[0]) if len(values) else None
