"""What a bag's inputs give once more: the gate's refusals, and the identifier's statistics, models, events, dithers."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msls_ros.bags import BagReader
from msls_ros.commands.inputs import InputTopics, SampleSource, read_inputs
from msls_ros.commands.recording import Stamped, Thinned
from msls_ros.estimation import Configuration, Dither, Estimate, EstimationError, FaultEvent, Identifier, Synchronizer
from msls_ros.estimation.block_pairing import PairedBlock

Array = NDArray[np.float64]
_BLOCK = 500
"""Samples at a time: estimates are large, and only a few are kept."""


@dataclass
class Recomputed:
    """What came of the inputs; stamps in [ns]."""

    refused: dict[str, int]
    paired: int
    restarts: int
    signals: Stamped[tuple[Array, Array]] = field(default_factory=list)
    """Prediction errors and statistics, (r,) each."""
    models: Thinned[Estimate] = field(default_factory=Thinned)
    events: Stamped[FaultEvent] = field(default_factory=list)
    dithers: Stamped[Dither] = field(default_factory=list)


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
    bag: Path,
    prefix: str,
    configuration: Configuration,
    *,
    identify: bool,
    progress: Callable[[float], None] = lambda share: None,
) -> Recomputed:
    """Put a bag's inputs through the gate, and through the identifier.

    Parameters
    ----------
    bag
        Directory or file.
    prefix
        Of the aircraft's topics.
    configuration
        Of the identifier.
    identify
        False: the gate alone.
    progress
        Called with the share that is done.

    Raises
    ------
    BagError
        If the bag cannot be read.
    """
    topics = InputTopics(prefix)
    reader = BagReader(bag, [topics.state, topics.effectors])
    gate = Synchronizer(configuration.states, configuration.effectors, configuration.time_jump)
    source = SampleSource(topics, gate)
    identifier = Identifier(configuration) if identify else None
    found = Recomputed({}, 0, 0)
    for batch in read_inputs(bag, reader, topics):
        for block in source.segments(batch):
            _identify(identifier, block, found)
        progress(reader.progress)
    for block in source.rest():
        _identify(identifier, block, found)
    found.refused, found.paired, found.restarts = dict(gate.refused), gate.paired, gate.restarts
    return found


def _parts(block: PairedBlock) -> Iterator[PairedBlock]:
    for start in range(0, len(block.stamps), _BLOCK):
        part = slice(start, start + _BLOCK)
        restarted = block.restarted and start == 0
        yield PairedBlock(restarted, block.stamps[part], block.x[part], block.xdot[part], block.delta[part])


def _identify(identifier: Identifier | None, block: PairedBlock, found: Recomputed) -> None:
    if identifier is None:
        return
    if block.restarted:
        identifier.reset()
    for part in _parts(block):
        _take(identifier, part, found)


def _take(identifier: Identifier, part: PairedBlock, found: Recomputed) -> None:
    stamps = [int(stamp) for stamp in part.stamps]
    run = identifier.run(np.multiply(part.stamps, 1e-9, dtype=np.float64), part.x, part.xdot, part.delta)
    for stamp, estimate in zip(stamps, run.estimates, strict=True):
        found.signals.append((stamp, (estimate.prediction_error, estimate.statistic)))
        found.models.add(stamp, estimate)
        found.events += [(stamp, event) for event in estimate.events]
    dithers = [block.at(k) for block in run.dithers for k in range(len(block.delta))]
    found.dithers += list(zip(stamps, dithers, strict=True))
