"""The gate for many samples at once: what `Synchronizer` would do one by one, where nothing is to be refused.

Streams of files are regular almost everywhere. There a block of both streams passes with a few array operations; where
anything is unusual, `pair_block` changes nothing and the messages go through `Synchronizer.add_state` and
`Synchronizer.add_effectors`, which decide.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msls_ros.estimation import LARGEST
from msls_ros.inputs.synchronizer import PENDING, RECENT, Array, NamedVector, Refused, Synchronizer


class Stream(NamedTuple):
    """Messages in a row of one stream, all with the same names; k messages, n values."""

    stamps: NDArray[np.int64]
    """(k,) [ns]."""
    names: Sequence[str]
    values: tuple[Array, ...]
    """(k, n) each: x and xdot, or delta."""


class Held(NamedTuple):
    """More rows are held, as a number may be a spike: the last dither goes on, see `Answered`."""

    held_for: int
    """See `InputAdapter.newly_held`."""
    after: int = 0
    """Samples of the block before it."""


class PairedBlock(NamedTuple):
    """Paired samples in a row, in the order of the gate's names."""

    restarted: bool
    """Time jumped back before them: start anew."""
    stamps: NDArray[np.int64]
    """(k,) [ns]."""
    x: Array
    xdot: Array
    delta: Array
    held: Sequence[Held] = ()
    """Where rows were held meanwhile; then there may be not one sample."""


def pair_block(
    gate: Synchronizer, states: Stream, effectors: Stream, order: NDArray[np.bool_] | None = None
) -> PairedBlock | None:
    """Put both streams through the gate, if all of it passes.

    Parameters
    ----------
    gate
        With its state and its counts.
    states, effectors
        As many messages of each.
    order
        Which messages are states, in the order of arrival; None: in turn.

    Returns
    -------
    PairedBlock or None
        None: something is to be refused, or waits in the gate; nothing has changed.
    """
    stamps = states.stamps
    streams = (gate._states, gate._effectors)
    if not len(stamps) or not np.array_equal(stamps, effectors.stamps) or not (stamps[1:] > stamps[:-1]).all():
        return None
    last = gate._timeline.last
    if gate._timeline.waiting or any(s.pending or (s.name in last and stamps[0] <= last[s.name]) for s in streams):
        return None
    if order is not None and np.abs(np.cumsum(np.where(order, 1, -1))).max() > PENDING:
        return None
    arranged = [_arranged(gate._states.vector, states), _arranged(gate._effectors.vector, effectors)]
    if arranged[0] is None or arranged[1] is None:
        return None
    for stream in streams:
        last[stream.name] = int(stamps[-1])
        stream.recent.extend(stamps[-RECENT:].tolist())
    gate.paired += len(stamps)
    restarted, gate._restarted = gate._restarted, False
    return PairedBlock(restarted, stamps, arranged[0][0], arranged[0][1], arranged[1][0])


def _arranged(vector: NamedVector, stream: Stream) -> list[Array] | None:
    """Return the values in the order wanted; None if a message of them is to be refused."""
    try:
        (places,) = vector.arrange(stream.names, places=range(len(stream.names)))
    except Refused:
        return None
    arrays = []
    for values in stream.values:
        if values.shape != (len(stream.stamps), len(stream.names)):
            return None
        found = values[:, places.astype(np.intp)]
        if not (np.abs(found) < LARGEST).all():
            return None
        arrays.append(found)
    return arrays
