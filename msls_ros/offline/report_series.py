"""From streams of messages to the arrays of the report: states, models, truth, dither, events."""

from __future__ import annotations

import json
import platform
from collections import Counter
from dataclasses import replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msls_ros.inputs.dither_echo import find_missing, sentence_of
from msls_ros.offline.recording import Stamped
from msls_ros.report.recorded import Dither, Event, Models, Signals, Truth
from msls_ros.report.style import causal_rms

Array = NDArray[np.float64]
_KINDS = {1: "detected", 2: "isolated", 3: "recovered", 4: "reset"}
STALE = 0.1
"""A dither is held no longer [s], as by the mixer."""
_PROGRAMS = ("numpy", "numba", "rosbags")


def times(stream: Stamped[Any], origin: int) -> Array:
    """Return flight times (k,) [s] of a stream; the origin in [ns]."""
    return np.array([(stamp - origin) * 1e-9 for stamp, _ in stream], dtype=np.float64)


def signals_of(stream: Stamped[Any], origin: int) -> Signals | None:
    """Return samples as arrays; those with other names than the first are left out."""
    if not stream:
        return None
    names = stream[0][1].names
    same = [(stamp, one) for stamp, one in stream if one.names == names and len(one.values) == len(names)]
    if not same:
        return None
    return Signals(times(same, origin), tuple(names), np.array([one.values for _, one in same]))


def models_of(stream: Stamped[Any], origin: int, stride: int, warnings: list[str]) -> Models | None:
    """Return models as arrays; those with other names or lengths than the first are left out, with a warning."""
    if not stream:
        return None
    first = stream[0][1]
    states, effectors, p = tuple(first.states), tuple(first.effectors), len(first.regressors)
    n, m = len(states), len(effectors)
    sizes = {"a": n * n, "b": n * m, "a_std": n * n, "b_std": n * m, "a_known": n * n, "a_reliable": n * n,
             "b_reliable": n * m, "excitation": p, "residual_std": n}  # fmt: skip
    good = [
        (stamp, model)
        for stamp, model in stream
        if tuple(model.states) == states and all(np.size(getattr(model, k)) == s for k, s in sizes.items())
    ]
    if len(good) < len(stream):
        warnings.append(f"{len(stream) - len(good)} models with other names or wrong lengths are left out")
    if not good or not n:
        return None
    columns = {k: np.array([np.ravel(getattr(model, k)) for _, model in good]) for k in sizes}
    square, wide = (-1, n, n), (-1, n, m)
    return Models(
        time=times(good, origin),
        states=states,
        effectors=effectors,
        regressors=tuple(first.regressors),
        a=columns["a"].reshape(square),
        b=columns["b"].reshape(wide),
        a_std=columns["a_std"].reshape(square),
        b_std=columns["b_std"].reshape(wide),
        a_known=columns["a_known"][-1].reshape(n, n).astype(np.bool_),
        a_reliable=columns["a_reliable"].reshape(square).astype(np.bool_),
        b_reliable=columns["b_reliable"].reshape(wide).astype(np.bool_),
        excitation=columns["excitation"],
        residual_std=columns["residual_std"],
        delay=float(getattr(good[-1][1], "delay", 0.0)),
        lag=float(getattr(good[-1][1], "lag", 0.0)),
        state_delay=np.ravel(getattr(good[-1][1], "state_delay", ())),
        stride=stride,
    )


def truth_of(stream: Stamped[Any], origin: int, models: Models | None, warnings: list[str]) -> Truth | None:
    """Return the truth in the order of the models' names; None where it lacks one of them, with a warning."""
    if not stream or models is None:
        return None
    first = stream[0][1]
    states, effectors = list(first.states), list(first.effectors)
    lacking = [n for n in models.states if n not in states] + [e for e in models.effectors if e not in effectors]
    if lacking:
        warnings.append(f"truth/model has no '{lacking[0]}': it cannot be compared with the estimate")
        return None
    n, m = len(states), len(effectors)
    good = [(s, t) for s, t in stream if list(t.states) == states and len(t.a) == n * n and len(t.b) == n * m]
    if not good:
        return None
    rows = [states.index(name) for name in models.states]
    columns = [effectors.index(name) for name in models.effectors]
    a = np.array([t.a for _, t in good]).reshape(-1, n, n)[:, rows][:, :, rows]
    b = np.array([t.b for _, t in good]).reshape(-1, n, m)[:, rows][:, :, columns]
    return Truth(times(good, origin), a, b)


def dither_of(
    stream: Stamped[Any], origin: int, truth: Truth | None, models: Models | None, log: Path
) -> Dither | None:
    """Return the dither commands as arrays."""
    if not stream:
        return None
    names = tuple(getattr(stream[0][1], "effectors", models.effectors if models is not None else ()))
    same = [(stamp, d) for stamp, d in stream if len(d.delta) == len(names)]
    if not same:
        return None
    dither = Dither(
        time=times(same, origin),
        effectors=names,
        delta=np.array([d.delta for _, d in same], dtype=np.float64),
        predicted=np.array([d.predicted_acceleration for _, d in same]),
        limit=np.array([d.acceleration_limit for _, d in same]),
        level=np.clip(np.array([int(d.level) for _, d in same], dtype=np.int64), 0, 3),
        reasons=dict(Counter(str(d.reason) for _, d in same).most_common()),
    )
    return replace(dither, realised=_realised(dither, truth, models, log))


def missing_dither(deflections: Signals | None, dither: Dither | None, straddle: int = 0) -> str:
    """Say of which effectors the recorded dither does not come back in the recorded deflections; empty: of none.

    Parameters
    ----------
    deflections, dither
        As recorded; None: they were not.
    straddle
        Intervals of the derivatives' window that the deflections have passed; 0: none.
    """
    if deflections is None or dither is None or not set(dither.effectors) <= set(deflections.names):
        return ""
    places = [deflections.names.index(name) for name in dither.effectors]
    delta = deflections.values[:, places]
    sent = np.searchsorted(dither.time, deflections.time + 1e-6, "right") - 1
    age = deflections.time - dither.time[np.maximum(sent, 0)]
    valid = (sent >= 0) & (age <= STALE)
    command = np.where(valid[:, None], dither.delta[np.maximum(sent, 0)], 0.0)
    good = np.isfinite(delta).all(axis=1) & np.isfinite(command).all(axis=1)
    found = find_missing(dither.effectors, deflections.time[good], delta[good], command[good], straddle)
    return sentence_of(found)


def event_of(stamp: int, origin: int, e: Any) -> Event:
    """Return an event."""
    return Event(
        time=(stamp - origin) * 1e-9,
        kind=_KINDS.get(int(e.kind), "detected"),
        equations=tuple(e.equations),
        statistic=tuple(float(v) for v in e.statistic),
        threshold=tuple(float(v) for v in e.threshold),
        effector=str(e.suspected_effector),
        effectiveness=float(e.effectiveness),
        effectiveness_std=float(e.effectiveness_std),
        description=str(e.description),
    )


def _realised(dither: Dither, truth: Truth | None, models: Models | None, bag: Path) -> Array | None:
    """Return the rms over 1 s of the acceleration by the dither alone, where the aircraft is our plant."""
    if truth is None or models is None or len(dither.time) < 3:
        return None
    from msls_ros.flights.comparison import realised_acceleration
    from msls_ros.offline.comparison import airframe_of
    from msls_ros.plant import STATES

    airframe = airframe_of(bag)
    effectors = airframe.effectors
    if models.states != tuple(STATES) or models.effectors != effectors or dither.effectors != effectors:
        return None
    flat = truth.b.reshape(len(truth.b), -1)
    held = np.stack([np.interp(dither.time, truth.time, column) for column in flat.T], axis=1)
    acceleration = realised_acceleration(dither.time, dither.delta, held.reshape(-1, *truth.b.shape[1:]), airframe)
    step = float(np.median(np.diff(dither.time)))
    width = int(np.clip(round(1.0 / step) if step > 0.0 else 1, 1, len(dither.time)))
    return causal_rms(acceleration, width)


def flown(bag: Path) -> str:
    """Return what the demo flew, from the summary that it leaves beside the bag; empty: not known."""
    try:
        summary = json.loads((bag.resolve().parent / "summary.json").read_text(encoding="utf-8"))
        if Path(summary["bag"]).name != bag.resolve().name:
            return ""
        text = str(summary.get("description", summary["scenario"]))
    except (OSError, ValueError, KeyError, TypeError):
        return ""
    noise = f", sensor noise {summary['noise']}, seed {summary['seed']}" if {"noise", "seed"} <= set(summary) else ""
    return f"{text}{noise}"


def versions() -> dict[str, str]:
    """Return the versions of what the report was made with."""
    found = {"msls_ros": _version("msls_ros"), "Python": platform.python_version()}
    return {**found, **{name: _version(name) for name in _PROGRAMS}}


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"
