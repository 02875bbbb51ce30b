"""A recorded flight of the closed loop beside its truth, with the peers run on the same samples."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msls_ros.estimation import Configuration
from msls_ros.flights.aircraft_files import DEFAULT, find_aircraft
from msls_ros.flights.comparison import Comparison, realised_acceleration
from msls_ros.flights.judging import PEERS
from msls_ros.flights.watch import Watch
from msls_ros.offline.replay import Flight, identify, load, paired
from msls_ros.plant import F16_MATV, STATES, Airframe

Array = NDArray[np.float64]


def compare(bag: str | Path, configuration: Configuration, watch: Watch, airframe: Airframe = F16_MATV) -> Comparison:
    """Read a recorded flight of the demo and identify it again with the peers.

    Parameters
    ----------
    bag
        Of the flight.
    configuration
        Of the identifier that flew.
    watch
        The parameter to compare.
    airframe
        What flew.
    """
    flight = load(bag)
    samples, _ = paired(bag, configuration)
    models = flight.topic("model")
    dither = [m for _, m in flight.topic("dither")]
    truth_a, truth_b = _hold_truth(flight, samples.time)
    method = configuration.estimator.method
    estimates = {method: _published(models, watch)}
    for name, changes in PEERS[method].items():
        peer = identify(samples, configuration.replace(changes))
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
        realised=realised_acceleration(samples.time, commands, truth_b, airframe),
        boosted=np.array([m.level == m.LEVEL_BOOSTED for m in dither]),
        events=[
            (t * 1e-9, ("", "detected", "isolated", "recovered", "reset")[m.kind], tuple(m.equations))
            for t, m in flight.topic("fault")
        ],
    )


def airframe_of(bag: str | Path) -> Airframe:
    """Return what flew, from the summary that the demo leaves beside the bag; where there is none, the F-16/MATV."""
    try:
        summary = json.loads((Path(bag).resolve().parent / "summary.json").read_text(encoding="utf-8"))
        return find_aircraft(str(summary.get("aircraft", DEFAULT))).airframe
    except (OSError, ValueError, AttributeError):
        return F16_MATV


def _published(models: Sequence[tuple[int, Any]], watch: Watch, of: str = "") -> Array:
    """Return a parameter, or what is said ``of`` it, as the models have it (n,)."""
    row, column = watch.place
    matrix, width = ("b", len(watch.effectors)) if watch.in_b else ("a", len(STATES))
    return np.array([getattr(m, matrix + of)[row * width + column] for _, m in models], dtype=np.float64)


def _hold_truth(flight: Flight, time: Array) -> tuple[Array, Array]:
    """Return the true A (n, 9, 9) and B (n, 9, m) at each sample: linear between the published ones."""
    published = flight.topic("truth/model")
    at = np.array([t * 1e-9 for t, _ in published])
    flat = np.array([np.concatenate((m.a, m.b)) for _, m in published])
    columns = np.stack([np.interp(time, at, column) for column in flat.T], axis=1)
    a, b = np.split(columns, [len(STATES) ** 2], axis=1)
    return a.reshape(-1, len(STATES), len(STATES)), b.reshape(len(b), len(STATES), -1)
