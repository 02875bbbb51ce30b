"""Offline replay beside what reading alone costs: a made-up flight of an F-16's size, two messages a sample."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import Reader

from msls_ros.bags import BagWriter, MessageTemplate
from msls_ros.estimation import Configuration
from msls_ros.inputs.profiles import read_profile
from msls_ros.offline.replay import ReplayOptions, replay
from msls_ros.offline.sources import EFFECTORS, STATE
from msls_ros.records import header_fields

PROFILE = "f16"
PERIOD = 20_000_000
"""Between samples [ns]."""
BLOCK = 5000
MEMORY = 0.98
"""Pole of the made-up states and deflections."""


def write_flight(bag: Path, samples: int, configuration: Configuration, seed: int = 0) -> None:
    """Write a bag of states that obey a linear model about level flight, with coloured inputs and a little noise.

    An aircraft that does not fly is not learnt from: that takes a third of the time.

    Parameters
    ----------
    bag
        Folder.
    samples
        Its length; each is a `StateSample` and an `EffectorSample`.
    configuration
        Names.
    seed
        Of the model and the noise.
    """
    random = np.random.default_rng(seed)
    n, m = len(configuration.states), len(configuration.effectors)
    a, b = random.normal(size=(n, n)) * 0.3, random.normal(size=(n, m)) * 3.0
    size = np.array([configuration.reference_speed if s in "uvw" else 1.0 for s in configuration.states])
    level = np.array([configuration.reference_speed if s == "u" else 0.0 for s in configuration.states])
    x, delta = np.zeros(n), np.zeros(m)
    header = {"header": header_fields(0)}
    state = MessageTemplate(
        STATE, {**header, "states": list(configuration.states), "x": np.zeros(n), "xdot": np.zeros(n)}
    )
    effector = MessageTemplate(EFFECTORS, {**header, "effectors": list(configuration.effectors), "delta": np.zeros(m)})
    with BagWriter(bag) as writer:
        writer.add_topic("/state", STATE)
        writer.add_topic("/effectors", EFFECTORS)
        for start in range(0, samples, BLOCK):
            count = min(BLOCK, samples - start)
            stamps = PERIOD * np.arange(start + 1, start + count + 1, dtype=np.int64)
            states, effectors = state.rows(count), effector.rows(count)
            for rows in (states, effectors):
                rows["header.stamp.sec"], rows["header.stamp.nanosec"] = np.divmod(stamps, 1_000_000_000)
            x_noise, delta_noise = random.normal(size=(count, n)) * 0.01, random.normal(size=(count, m)) * 0.01
            xs, deltas = np.empty((count, n)), np.empty((count, m))
            for k in range(count):
                x, delta = MEMORY * x + x_noise[k], MEMORY * delta + delta_noise[k]
                xs[k], deltas[k] = x, delta
            states["x"], effectors["delta"] = level + xs * size, deltas
            states["xdot"] = (xs @ a.T + deltas @ b.T + random.normal(size=(count, n)) * 1e-3) * size
            writer.write_blocks(
                [("/state", stamps, state.cdr(states)), ("/effectors", stamps, effector.cdr(effectors))]
            )


def measure(samples: int, every: int, say: Callable[[str], None], rounds: int = 3) -> dict[str, Any]:
    """Time the replay of a bag, and the raw reading of it with `rosbags`; one process, one thread.

    Parameters
    ----------
    samples, every
        Length of the bag, and samples per model.
    say
        Called with a line of progress.
    rounds
        Each is timed so often, in turn; the fastest counts.

    Returns
    -------
    dict
        Samples per second of processor time and of wall time, and their ratios.
    """
    configuration = read_profile(PROFILE)
    with tempfile.TemporaryDirectory(prefix="msls_benchmark_") as folder:
        bag, out = Path(folder) / "flight", Path(folder) / "replayed"
        say(f"writing a bag of {samples} samples")
        write_flight(bag, samples, configuration)
        raw, ours = [], []
        options = ReplayOptions(every=every, overwrite=True)
        for k in range(rounds):
            say(f"round {k + 1} of {rounds}")
            raw.append(_timed(lambda: _read_raw(bag)))
            ours.append(_timed(lambda: replay(bag, out, configuration, options)))
            done = ours[-1][0]
        size = sum(file.stat().st_size for file in bag.iterdir())
    assert done.samples == samples, done
    result: dict[str, Any] = {"samples": samples, "every": every, "bag_bytes": size}
    for name, times in (("raw", raw), ("replay", ours)):
        result[f"{name}_samples_per_s"] = round(samples / min(cpu for _, cpu, _ in times))
        result[f"{name}_samples_per_s_wall"] = round(samples / min(wall for _, _, wall in times))
    result["replay_to_raw"] = round(result["replay_samples_per_s"] / result["raw_samples_per_s"], 3)
    return result


def _read_raw(bag: Path) -> int:
    with Reader(bag) as reader:
        return sum(1 for _ in reader.messages())


def _timed(action: Callable[[], Any]) -> tuple[Any, float, float]:
    """Return what an action gives, its processor time and its wall time [s]."""
    wall, cpu = time.perf_counter(), time.process_time()
    result = action()
    return result, time.process_time() - cpu, time.perf_counter() - wall
