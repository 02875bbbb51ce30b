"""What a bag's inputs give once more: the gate's refusals, and the identifier's statistics, models, events, dithers."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msls_ros.estimation import Configuration, Dither, Estimate, EstimationError, FaultEvent, Identifier
from msls_ros.inputs import PairedSample, Refused, Synchronizer
from msls_ros.offline.recording import Input, Stamped, Thinned

Array = NDArray[np.float64]
_BLOCK = 500
"""Samples at a time: estimates are large, and only a few are kept."""
_MODELS = 3000
"""Models that are computed at most, for error bars cost more than the estimate."""
_LOOK = 1000
"""Messages of one input, with none of the other between them, that show a bag of streams one after the other."""


@dataclass
class Recomputed:
    """What came of the inputs; stamps in [ns]."""

    refused: dict[str, int]
    paired: int
    restarts: int
    examples: dict[str, str] = field(default_factory=dict)
    """The first refusal of each reason, in words."""
    signals: Stamped[tuple[Array, Array]] = field(default_factory=list)
    """Prediction errors and statistics, (r,) each."""
    models: Thinned[Estimate] = field(default_factory=Thinned)
    events: Stamped[FaultEvent] = field(default_factory=list)
    dithers: Stamped[Dither] = field(default_factory=list)
    samples: list[tuple[Array, Array, Array]] = field(default_factory=list)
    """x (k, n), xdot (k, n), delta (k, m) of each block that was identified from."""


def fitting(states: tuple[str, ...], effectors: tuple[str, ...]) -> Configuration:
    """Return the default configuration for a bag's states and effectors.

    Parameters
    ----------
    states, effectors
        Names in the order of the messages.

    Raises
    ------
    EstimationError
        If no identifier can have such names.
    """
    changes: dict[str, Any] = {"states": states, "effectors": effectors}
    try:
        return Configuration().replace(changes)
    except EstimationError:
        return Configuration().replace({**changes, "known_gravity": False})


def recompute(
    inputs: list[Input],
    configuration: Configuration,
    *,
    identify: bool,
    straddle: int = 0,
    progress: Callable[[float], None] = lambda share: None,
) -> Recomputed:
    """Put a bag's inputs through the gate, and through the identifier.

    Parameters
    ----------
    inputs
        In the order of the bag.
    configuration
        Of the identifier.
    identify
        False: the gate alone.
    straddle
        Samples over which the inputs were smoothed; as `Identifier`.
    progress
        Called with the share that is done.
    """
    gate = Synchronizer.of(configuration)
    identifier = Identifier(configuration, straddle) if identify else None
    found = Recomputed({}, 0, 0)
    every = max(1, -(-len(inputs) // (2 * _MODELS)))
    for samples in _blocks(_paired(_in_order(inputs), gate, found.examples)):
        if identifier is not None:
            _identify(identifier, samples, found, every)
        progress(min(1.0, 2.0 * gate.paired / len(inputs)))
    found.refused, found.paired, found.restarts = dict(gate.refused), gate.paired, gate.restarts
    return found


def _in_order(inputs: list[Input]) -> Iterable[Input]:
    """Return the inputs as a player would give them: by log time, where one stream follows the other."""
    first = inputs[0].leaf
    if any(message.leaf != first for message in inputs[: _LOOK + 1]) or len(inputs) <= _LOOK:
        return inputs
    streams = [[m for m in inputs if m.leaf == leaf] for leaf in ("state", "effectors")]
    return heapq.merge(*streams, key=lambda message: message.logged)


def _paired(inputs: Iterable[Input], gate: Synchronizer, examples: dict[str, str]) -> Iterator[PairedSample]:
    for message in inputs:
        sample, paired = message.sample, None
        try:
            if sample is None:
                raise gate.refuse("malformed", message.error)
            values = sample.values.tolist()
            if message.leaf == "state":
                rates = [] if sample.rates is None else sample.rates.tolist()
                paired = gate.add_state(sample.stamp_ns, sample.names, values, rates)
            else:
                paired = gate.add_effectors(sample.stamp_ns, sample.names, values)
        except Refused as refused:
            examples.setdefault(refused.reason, str(refused))
            continue
        if paired is not None:
            yield paired


def _blocks(samples: Iterable[PairedSample]) -> Iterator[list[PairedSample]]:
    """Yield samples some at a time; one that starts anew begins a block."""
    block: list[PairedSample] = []
    for sample in samples:
        if block and (sample.restarted or len(block) == _BLOCK):
            yield block
            block = []
        block.append(sample)
    if block:
        yield block


def _identify(identifier: Identifier, block: list[PairedSample], found: Recomputed, every: int) -> None:
    if block[0].restarted:
        identifier.reset()
    x, xdot, delta = (np.array([getattr(s, name) for s in block]) for name in ("x", "xdot", "delta"))
    found.samples.append((x, xdot, delta))
    time = np.array([s.time for s in block])
    run = identifier.run(time, x, xdot, delta, every)
    stamps = [s.stamp for s in block]
    errors, statistics = (np.concatenate(part) for part in zip(*run.signals, strict=True))
    found.signals += list(zip(stamps, zip(errors, statistics, strict=True), strict=True))
    for estimate in run.estimates:
        stamp = stamps[int(np.searchsorted(time, estimate.time))]
        found.models.add(stamp, estimate)
        found.events += [(stamps[int(np.searchsorted(time, e.time))], e) for e in estimate.events]
    dithers = [blocks.at(k) for blocks in run.dithers for k in range(len(blocks.delta))]
    found.dithers += list(zip(stamps, dithers, strict=True))
