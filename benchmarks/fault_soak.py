"""A long flight in lockstep over DDS: memory and time per sample stay flat, and its bag replays to the same bits."""

from __future__ import annotations

import dataclasses
import os
import subprocess
import time
from collections.abc import Callable, Iterator
from itertools import zip_longest
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from benchmarks.programs import program
from msls_ros.bags import BagReader
from msls_ros.flights.scenarios import find_scenario
from msls_ros.nodes.flight import fly
from msls_ros.testing import claim_domain

TOPICS = ("/model", "/fault", "/dither")
TENTHS = 10
WARM = 20.0
"""Flight time before which caches fill [s]."""


def measure(seconds: float, say: Callable[[str], None]) -> dict[str, Any]:
    """Fly for so long, replay, and give what it cost."""
    scenario = dataclasses.replace(find_scenario("roll_doublet"), duration=seconds, faults=())
    configuration = scenario.configuration("low", 0, True)
    marks: list[tuple[float, float, float, float]] = []

    def note(flown: float) -> None:
        if flown >= WARM and (not marks or flown - marks[-1][0] >= seconds / 100):
            marks.append((flown, time.monotonic(), time.process_time(), _memory()))

    number, lock = claim_domain()  # a message from anybody else would end the comparison
    os.environ["ROS_DOMAIN_ID"] = str(number)
    with TemporaryDirectory(prefix="msls_soak_") as name, lock:
        bag = Path(name) / "bag"
        say(f"{seconds:g} s of flight in lockstep over DDS")
        record = fly(scenario, configuration, bag, noise="low", seed=0, progress=note)
        say("replaying its bag")
        replay = [*program("replay"), str(bag), "--out", str(Path(name) / "replayed")]
        code = subprocess.run(replay, check=False, stdout=subprocess.DEVNULL).returncode
        compared = 0
        same = code == 0
        pairs = zip_longest(_outputs(bag), _outputs(Path(name) / "replayed" / "bag"))
        for one, other in pairs if same else ():
            same = same and one == other
            compared += 1
    flown, wall, cpu, memory = (np.array(column) for column in zip(*marks, strict=True))
    samples = np.diff(flown) * 50.0
    each, busy = 1e3 * np.diff(wall) / samples, 1e3 * np.diff(cpu) / samples
    part = max(1, len(each) // TENTHS)
    return {
        "seconds": seconds,
        "samples": record.samples,
        "time_outs": record.time_outs,
        "refused": sum(record.refused.values()),
        "same_bits": same,
        "compared": compared,
        "memory_mb": [round(float(memory[0]), 1), round(float(memory[-1]), 1)],
        "ms_per_sample": [round(float(np.median(each[:part])), 3), round(float(np.median(each[-part:])), 3)],
        "cpu_ms_per_sample": [round(float(np.median(busy[:part])), 3), round(float(np.median(busy[-part:])), 3)],
    }


def _memory() -> float:
    """Return the resident memory of this process [MB]."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") * 1e-6


def _outputs(bag: Path) -> Iterator[tuple[Any, ...]]:
    """Yield what the identifier said: topic, log time and every field of each message."""
    reader = BagReader(bag, TOPICS)
    for topic in TOPICS:
        for message in reader:
            if message.topic == topic:
                yield topic, message.stamp_ns, plain(reader.decode(message))


def plain(message: Any) -> tuple[Any, ...]:
    """Return a decoded message as what compares equal where every bit of it does."""
    found: list[Any] = []
    for value in vars(message).values():
        if hasattr(value, "__msgtype__"):
            found.append(plain(value))
        elif isinstance(value, np.ndarray):
            found.append(value.tobytes())
        else:
            found.append(np.float64(value).tobytes() if isinstance(value, float) else value)
    return tuple(found)
