"""From a bag's messages to samples: finds the two topics, decodes them by the block, puts them through the gate.

The gate is the node's own `Synchronizer`, and takes every message in the order of the bag. A bag whose streams were
written one after the other is read twice at the same time and merged by log time, as a player would give it.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msls_ros.bags import BagError, BagMessage, BagReader, SampleDecoder
from msls_ros.estimation import PairedSample, Refused, Synchronizer

Array = NDArray[np.float64]
Batches = Iterator[list[BagMessage]]
STATE, EFFECTORS = "msls_msgs/msg/StateSample", "msls_msgs/msg/EffectorSample"
_LEAVES = {"state": STATE, "effectors": EFFECTORS}
_LOOK = 1000
"""Messages of one input, with none of the other between them, that show a bag of streams one after the other."""


@dataclass(frozen=True)
class InputTopics:
    """Where a bag has its states and deflections."""

    prefix: str
    """What stands before ``state`` in the topic's name."""

    def name(self, leaf: str) -> str:
        """Return the full name of a topic beside them."""
        return f"{self.prefix}{leaf}"

    @property
    def state(self) -> str:
        """Topic of the states."""
        return self.name("state")

    @property
    def effectors(self) -> str:
        """Topic of the deflections."""
        return self.name("effectors")


class Segment(NamedTuple):
    """Samples in a row, k of them."""

    restarted: bool
    """Time jumped back before them: start anew."""
    stamps: NDArray[np.int64]
    """(k,) [ns]."""
    x: Array
    xdot: Array
    delta: Array


def find_topics(bag: Path, topics: dict[str, str], namespace: str | None) -> InputTopics:
    """Find the topics ``state`` and ``effectors``, under any namespace.

    Parameters
    ----------
    bag
        For sentences.
    topics
        Types by topic.
    namespace
        The aircraft, where the bag has several; None: the only one.

    Raises
    ------
    BagError
        If there is none, or more than one, or a topic has another type.
    """
    found: dict[str, set[str]] = {}
    for topic, msgtype in topics.items():
        prefix, leaf = topic[: topic.rfind("/") + 1], topic[topic.rfind("/") + 1 :]
        own = prefix.strip("/")
        if leaf not in _LEAVES or own.split("/")[-1] == "truth" or namespace not in (None, own, f"/{own}"):
            continue
        if msgtype != _LEAVES[leaf]:
            message = f"{bag}: topic {topic} has type {msgtype}; expected {_LEAVES[leaf]}"
            raise BagError(message)
        found.setdefault(prefix, set()).add(leaf)
    whole = [prefix for prefix, leaves in found.items() if len(leaves) == len(_LEAVES)]
    if len(whole) == 1:
        return InputTopics(whole[0])
    if whole:
        names = ", ".join(repr(prefix.strip("/")) for prefix in whole)
        message = f"{bag}: several aircraft ({names}); choose one with --namespace"
        raise BagError(message)
    missing = [leaf for leaf in _LEAVES if leaf not in chain(*found.values())] or ["state beside effectors"]
    wanted = " and ".join(f"{leaf} ({_LEAVES[leaf]})" if leaf in _LEAVES else leaf for leaf in missing)
    where = f" under '{namespace}'" if namespace is not None else ""
    message = f"{bag}: no topic {wanted}{where}; it has {', '.join(sorted(topics)) or 'none'}"
    raise BagError(message)


def read_inputs(bag: Path, reader: BagReader, topics: InputTopics) -> Batches:
    """Yield the bag's messages in the order in which the gate is to see them, some at a time.

    Parameters
    ----------
    bag
        The same as the reader's.
    reader
        Of all topics that are to be seen.
    topics
        The inputs.
    """
    batches = reader.batches()
    wanted = (topics.state, topics.effectors)
    first: list[list[BagMessage]] = []
    seen: dict[str, int] = dict.fromkeys(wanted, 0)
    for batch in batches:
        first.append(batch)
        for message in batch:
            if message.topic in seen:
                seen[message.topic] += 1
        if all(seen.values()) or max(seen.values()) > _LOOK:
            break
    summary = reader.summary
    both = summary is None or all(summary.counts.get(topic, 0) for topic in wanted)
    if all(seen.values()) or not both:
        yield from chain(first, batches)
        return
    readers = [BagReader(bag, [topic]) for topic in wanted]
    merged = heapq.merge(*readers, key=lambda message: message.stamp_ns)
    yield from _grouped(merged)
    for batch in chain(first, batches):
        others = [message for message in batch if message.topic not in wanted]
        if others:
            yield others


def _grouped(messages: Iterable[BagMessage]) -> Batches:
    batch: list[BagMessage] = []
    for message in messages:
        batch.append(message)
        if len(batch) == _LOOK:
            yield batch
            batch = []
    if batch:
        yield batch


class SampleSource:
    """Puts messages through the gate and collects what comes out.

    Parameters
    ----------
    topics
        The inputs.
    gate
        Where they are paired and refused.
    """

    def __init__(self, topics: InputTopics, gate: Synchronizer) -> None:
        """Begin; see the class."""
        self._gate = gate
        self._state, self._effectors = SampleDecoder(STATE), SampleDecoder(EFFECTORS)
        self._take: dict[str, Callable[[bytes], PairedSample | None]] = {
            topics.state: self._add_state,
            topics.effectors: self._add_effectors,
        }

    def segments(self, batch: Sequence[BagMessage]) -> Iterator[Segment]:
        """Yield the samples that a batch completes; one segment between two jumps of time."""
        samples: list[PairedSample] = []
        for message in batch:
            take = self._take.get(message.topic)
            if take is None:
                continue
            try:
                sample = take(message.data)
            except Refused:
                continue
            if sample is None:
                continue
            if sample.restarted and samples:
                yield _segment(samples)
                samples = []
            samples.append(sample)
        if samples:
            yield _segment(samples)

    def _add_state(self, cdr: bytes) -> PairedSample | None:
        try:
            sample = self._state.decode(cdr)
        except BagError as error:
            raise self._gate.refuse("malformed", str(error)) from error
        return self._gate.add_state(sample.stamp_ns, sample.names, sample.values.tolist(), _rates(sample.rates))

    def _add_effectors(self, cdr: bytes) -> PairedSample | None:
        try:
            sample = self._effectors.decode(cdr)
        except BagError as error:
            raise self._gate.refuse("malformed", str(error)) from error
        return self._gate.add_effectors(sample.stamp_ns, sample.names, sample.values.tolist())


def _rates(rates: Array | None) -> list[float]:
    return [] if rates is None else rates.tolist()


def _segment(samples: list[PairedSample]) -> Segment:
    return Segment(
        samples[0].restarted,
        np.array([s.stamp for s in samples], dtype=np.int64),
        np.array([s.x for s in samples]),
        np.array([s.xdot for s in samples]),
        np.array([s.delta for s in samples]),
    )
