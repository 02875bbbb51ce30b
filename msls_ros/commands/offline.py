"""Identify from a bag: the same gate and the same identifier as in flight, fed from a file."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msls_ros import bags
from msls_ros.estimation import Configuration, Estimate, Identifier, PairedSample, Refused, Synchronizer

Array = NDArray[np.float64]
CHUNK = 2000


@dataclass
class Samples:
    """Paired samples as arrays; n samples."""

    time: Array
    x: Array
    xdot: Array
    delta: Array


@dataclass
class Flight:
    """A recorded flight, decoded: messages by topic, each with its stamp [ns]."""

    messages: dict[str, list[tuple[int, Any]]] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)

    def topic(self, name: str) -> list[tuple[int, Any]]:
        """Return the messages of a topic, also under a namespace; none: an empty list."""
        for topic, found in self.messages.items():
            if topic == f"/{name}" or (topic.endswith(f"/{name}") and f"/truth/{name}" not in topic):
                return found
        return []


def load(bag: str | Path) -> Flight:
    """Read a bag into memory.

    Raises
    ------
    BagError
        If it cannot be read.
    """
    flight = Flight()
    reader = bags.read(bag)
    for message, decoded in reader.decoded():
        flight.messages.setdefault(message.topic, []).append((message.stamp_ns, decoded))
    flight.warnings = list(reader.warnings)
    return flight


def paired(flight: Flight, configuration: Configuration) -> tuple[Samples, Synchronizer]:
    """Put a flight's states and deflections through the gate; return the samples, and the gate with its counts."""
    gate = Synchronizer(configuration.states, configuration.effectors, configuration.time_jump)
    made = list(_pair(flight, gate))
    n, m = len(configuration.states), len(configuration.effectors)
    samples = Samples(
        time=np.array([s.time for s in made]),
        x=np.array([s.x for s in made]).reshape(-1, n),
        xdot=np.array([s.xdot for s in made]).reshape(-1, n),
        delta=np.array([s.delta for s in made]).reshape(-1, m),
    )
    return samples, gate


def _pair(flight: Flight, gate: Synchronizer) -> Iterator[PairedSample]:
    inputs = [(stamp, 0, m) for stamp, m in flight.topic("state")] + [(t, 1, m) for t, m in flight.topic("effectors")]
    for stamp, kind, m in sorted(inputs, key=lambda item: item[:2]):
        try:
            sample = (
                gate.add_state(stamp, m.states, m.x, m.xdot)
                if kind == 0
                else gate.add_effectors(stamp, m.effectors, m.delta)
            )
        except Refused:
            continue
        if sample is not None:
            yield sample


def identify(samples: Samples, configuration: Configuration) -> list[Estimate]:
    """Return the estimate after every sample."""
    return Identifier(configuration).run(samples.time, samples.x, samples.xdot, samples.delta).estimates
