"""Bags to report on: a made-up linear aircraft whose tail loses half of its effect, recorded in many ways."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np

from msls_ros import records
from msls_ros.bags import BagWriter
from msls_ros.estimation import Configuration, Identifier
from msls_ros.offline.replay import keep_parameters

ALL = frozenset({"state", "effectors", "model", "fault", "dither", "truth/model"})
INPUTS = frozenset({"state", "effectors"})
STEP = 20_000_000
"""Between two samples [ns]."""
FAULT = 4.0
"""When ddt and de lose half of their effect [s]."""
SECONDS = 6.4
SENSITIVE = Configuration().replace({"detector.floor_relative": 0.05})
"""Alarms at the first sample after the loss."""
GRAVITY = 9.80665


def simulate(seed: int = 1) -> tuple[Any, Any, Any, Any, Any]:
    """Return time, x, xdot, delta (k each) and the true B of each sample (k, 9, 7)."""
    random = np.random.default_rng(seed)
    count = round(SECONDS * 50) + 1
    time = STEP * 1e-9 * np.arange(count)
    x = np.array([57.0, 0.0, 45.0, 0, 0, 0, 0, 0.4, 0]) + random.normal(size=(count, 9)) * ([1.0] * 3 + [0.05] * 6)
    delta = random.normal(size=(count, 7)) * 0.05
    a = random.normal(size=(9, 9)) * 0.02
    a[:, 6:] = 0.0
    b = np.zeros((9, 7))
    b[:6] = random.normal(size=(6, 7)) * 0.1
    b[3, 2], b[4, 0] = 1.6, -3.0
    delta[np.searchsorted(time, FAULT + 0.5 * STEP * 1e-9), [0, 2]] = 0.2
    truth = np.repeat(b[None], count, axis=0)
    truth[time > FAULT, 3, 2] *= 0.5
    truth[time > FAULT, 4, 0] *= 0.5
    xdot = x @ a.T + np.einsum("kij,kj->ki", truth, delta) + random.normal(size=(count, 9)) * 1e-4
    phi, theta = x[:, 6], x[:, 7]
    xdot[:, 0] -= GRAVITY * np.sin(theta)
    xdot[:, 1] += GRAVITY * np.cos(theta) * np.sin(phi)
    xdot[:, 2] += GRAVITY * np.cos(theta) * np.cos(phi)
    return time, x, xdot, delta, truth


def record(
    bag: Path,
    topics: Collection[str] = ALL,
    *,
    configuration: Configuration | None = None,
    kept: bool = True,
    namespace: str = "/",
    start: int = 0,
    passes: int = 1,
) -> Path:
    """Fly and record.

    Parameters
    ----------
    bag
        Folder to make.
    topics
        Which to record.
    configuration
        Of the identifier.
    kept
        Whether its parameters are kept beside the bag.
    namespace
        Before every topic.
    start
        Stamp of the first sample [ns].
    passes
        How often the flight is recorded, time jumping back.
    """
    c = configuration or SENSITIVE
    time, x, xdot, delta, truth = simulate()
    states = [list(c.states).index(s) if s in c.states else -1 for s in Configuration().states]
    columns = [i for i, k in enumerate(states) if k >= 0]
    effectors = [i for i, e in enumerate(Configuration().effectors) if e in c.effectors]
    x, xdot, delta, truth = x[:, columns], xdot[:, columns], delta[:, effectors], truth[:, columns][:, :, effectors]
    with BagWriter(bag) as writer:

        def put(leaf: str, kind: str, stamp: int, fields: dict[str, Any]) -> None:
            if leaf in topics:
                flat = {k: np.ravel(v) if isinstance(v, np.ndarray) else v for k, v in fields.items()}
                message = {"header": records.header_fields(stamp), **flat}
                writer.write_message(f"{namespace}{leaf}", f"msls_msgs/msg/{kind}", stamp, message)

        for _ in range(passes):
            identifier = Identifier(c)
            for k in range(len(time)):
                stamp = start + k * STEP
                put("state", "StateSample", stamp, {"states": list(c.states), "x": x[k], "xdot": xdot[k]})
                put("effectors", "EffectorSample", stamp, {"effectors": list(c.effectors), "delta": delta[k]})
                estimate = identifier.update(stamp * 1e-9, x[k], xdot[k], delta[k])
                put("model", "LinearModel", stamp, dict(records.model_fields(estimate)))
                put("dither", "DitherCommand", stamp, dict(records.dither_fields(c.effectors, estimate.dither)))
                for event in estimate.events:
                    put("fault", "FaultEvent", stamp, dict(records.fault_fields(event)))
                if k % 5 == 0 or truth[k - 1].tolist() != truth[k].tolist():
                    known = {"states": list(c.states), "effectors": list(c.effectors), "b": truth[k]}
                    put("truth/model", "LinearModel", stamp, {**known, "a": np.zeros(len(c.states) ** 2)})
    if kept:
        keep_parameters(bag, c)
    return bag
