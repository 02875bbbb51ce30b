"""What a bag's inputs give once more: the gate's refusals, and the identifier's statistics, models, events, dithers."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msls_ros.estimation import Configuration, Estimate, EstimationError, FaultEvent, Identifier
from msls_ros.inputs import PairedSample, Refused, Synchronizer
from msls_ros.inputs.block_pairing import PairedBlock, Stream, pair_block
from msls_ros.inputs.model_file import start_if_there
from msls_ros.offline.recording import Input, Stamped, Thinned

Array = NDArray[np.float64]
_BLOCK = 500
"""Samples at a time."""
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
    warnings: list[str] = field(default_factory=list)
    """What is not as in flight."""
    signals: Stamped[tuple[Array, Array]] = field(default_factory=list)
    """Prediction errors and statistics, (r,) each."""
    models: Thinned[Estimate] = field(default_factory=Thinned)
    events: Stamped[FaultEvent] = field(default_factory=list)
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
    servos: bool = False,
    warm_start: Path | None = None,
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
    straddle, servos
        Samples over which the inputs were smoothed, and whether they have passed declared servos; as `Identifier`.
    warm_start
        The saved model that the identifier starts from; None: nothing.
    progress
        Called with the share that is done.

    Raises
    ------
    EstimationError
        For a saved model that is wrong or of other names.
    """
    gate = Synchronizer.of(configuration)
    identifier = Identifier(configuration, straddle, servos=servos, gated=True) if identify else None
    found = Recomputed({}, 0, 0)
    if identifier is not None:
        found.warnings = start_if_there(identifier, warm_start)
    every = max(1, -(-len(inputs) // (2 * _MODELS)))
    for block in _blocks(_in_order(inputs), gate, found.examples):
        if identifier is not None:
            _identify(identifier, block, found, every)
        progress(min(1.0, 2.0 * gate.paired / len(inputs)))
    found.refused, found.paired, found.restarts = dict(gate.refused), gate.paired, gate.restarts
    return found


def _in_order(inputs: list[Input]) -> list[Input]:
    """Return the inputs as a player would give them: by log time, where one stream follows the other."""
    first = inputs[0].leaf
    if any(message.leaf != first for message in inputs[: _LOOK + 1]) or len(inputs) <= _LOOK:
        return inputs
    streams = [[m for m in inputs if m.leaf == leaf] for leaf in ("state", "effectors")]
    return list(heapq.merge(*streams, key=lambda message: message.logged))


def _blocks(inputs: list[Input], gate: Synchronizer, examples: dict[str, str]) -> Iterator[PairedBlock]:
    """Yield paired samples some at a time: many messages at once where all pass, else one by one."""
    for start in range(0, len(inputs), 2 * _BLOCK):
        part = inputs[start : start + 2 * _BLOCK]
        block = _at_once(part, gate)
        if block is not None:
            yield block
        else:
            yield from _grouped(_paired(part, gate, examples))


def _at_once(part: list[Input], gate: Synchronizer) -> PairedBlock | None:
    """Put messages through the gate all at once; None, and nothing has changed: they are not all alike and good."""
    samples = {leaf: [m.sample for m in part if m.leaf == leaf] for leaf in ("state", "effectors")}
    streams = []
    for leaf, found in samples.items():
        good = [s for s in found if s is not None and s.names == found[0].names]  # type: ignore[union-attr]
        if not good or len(good) < len(found):
            return None
        fields = ("values", "rates") if leaf == "state" else ("values",)
        rows = [[getattr(s, name) for s in good] for name in fields]
        if any(row is None or len(row) != len(good[0].names) for column in rows for row in column):
            return None
        stamps = np.array([s.stamp_ns for s in good], dtype=np.int64)
        streams.append(Stream(stamps, good[0].names, tuple(np.array(column) for column in rows)))
    return pair_block(gate, streams[0], streams[1], np.array([m.leaf == "state" for m in part]))


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


def _grouped(samples: Iterable[PairedSample]) -> Iterator[PairedBlock]:
    """Yield samples in a row as blocks; one that starts anew begins a block."""
    group: list[PairedSample] = []
    for sample in samples:
        if group and sample.restarted:
            yield _joined(group)
            group = []
        group.append(sample)
    if group:
        yield _joined(group)


def _joined(group: list[PairedSample]) -> PairedBlock:
    x, xdot, delta = (np.array([getattr(s, name) for s in group]) for name in ("x", "xdot", "delta"))
    return PairedBlock(group[0].restarted, np.array([s.stamp for s in group], dtype=np.int64), x, xdot, delta)


def _identify(identifier: Identifier, block: PairedBlock, found: Recomputed, every: int) -> None:
    if block.restarted:
        identifier.reset()
    found.samples.append((block.x, block.xdot, block.delta))
    time: Array = block.stamps.astype(np.float64) * 1e-9
    run = identifier.run(time, block.x, block.xdot, block.delta, every)
    stamps = block.stamps.tolist()
    errors, statistics = (np.concatenate(part) for part in zip(*run.signals, strict=True))
    found.signals += list(zip(stamps, zip(errors, statistics, strict=True), strict=True))
    for estimate in run.estimates:
        stamp = stamps[int(np.searchsorted(time, estimate.time))]
        found.models.add(stamp, estimate)
        found.events += [(stamps[int(np.searchsorted(time, e.time))], e) for e in estimate.events]
