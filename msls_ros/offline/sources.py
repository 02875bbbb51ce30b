"""From a bag's messages to samples: finds the topics, decodes them, puts them through the gate.

The gate is the node's own `Synchronizer`, and takes every message in the order of the bag. A bag whose streams were
written one after the other is read once for each and merged by log time, as a player would give it.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Protocol

import numpy as np

from msls_ros.bags import AnyReader, BagError, BagMessage, SampleDecoder
from msls_ros.inputs import InputAdapter, PairedSample, Refused, Synchronizer
from msls_ros.inputs.block_pairing import Held, PairedBlock, Stream, pair_block
from msls_ros.inputs.synchronizer import PENDING

Batches = Iterator[list[BagMessage]]
Offer = Callable[[], PairedSample | Held | None]
STATE, EFFECTORS = "msls_msgs/msg/StateSample", "msls_msgs/msg/EffectorSample"
_LEAVES = {"state": STATE, "effectors": EFFECTORS}
_LOOK = 1000
"""Messages of both inputs that show whether they were written side by side."""
_SMALLEST, _LARGEST = 64, 1 << 16
"""Messages that are tried as one block."""


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


def ordered_batches(reader: AnyReader, wanted: Sequence[str], longest_run: int) -> Batches:
    """Yield a bag's messages in the order in which the gate is to see them, some at a time.

    Parameters
    ----------
    reader
        Of all topics that are to be seen.
    wanted
        The inputs among them.
    longest_run
        More messages of one input in a row are the sign of a bag whose streams were written one after the other.
    """
    batches = reader.batches()
    first: list[list[BagMessage]] = []
    seen = run = most = 0
    last = ""
    for batch in batches:
        first.append(batch)
        for message in batch:
            if message.topic in wanted:
                seen += 1
                run = run + 1 if message.topic == last else 1
                most, last = max(most, run), message.topic
        if seen > _LOOK:
            break
    summary = reader.summary
    if most <= longest_run or (summary is not None and not all(summary.counts.get(topic, 0) for topic in wanted)):
        yield from chain(first, batches)
        return
    readers = [reader.only([topic]) for topic in wanted]
    yield from _grouped(heapq.merge(*readers, key=lambda message: message.stamp_ns))
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


class Source(Protocol):
    """Puts the messages of a bag through the gate and collects what comes out."""

    @property
    def topics(self) -> Sequence[str]:
        """The inputs."""
        ...

    @property
    def longest_run(self) -> int:
        """Messages of one input in a row that are still to be expected."""
        ...

    @property
    def straddle(self) -> int:
        """Samples over which one of its samples was smoothed."""
        ...

    @property
    def servos(self) -> bool:
        """Whether its deflections are commands behind servos that are declared."""
        ...

    @property
    def warnings(self) -> Sequence[str]:
        """What is wrong with the inputs, as far as it has been seen."""
        ...

    def segments(self, batch: Sequence[BagMessage]) -> Iterator[PairedBlock]:
        """Yield the samples that a batch completes, but for some that may wait for the next batch."""
        ...

    def rest(self) -> Iterator[PairedBlock]:
        """Yield the samples of the messages that still wait, at the end of the bag."""
        ...


class SampleSource:
    """The source of a bag with our own messages.

    Where the streams are regular, blocks of them pass at once; `pair_block` sees to it that this is all the same.

    Parameters
    ----------
    topics
        The inputs.
    gate
        Where they are paired and refused.
    """

    longest_run = PENDING
    straddle = 0
    servos = False
    warnings: Sequence[str] = ()

    def __init__(self, topics: InputTopics, gate: Synchronizer) -> None:
        """Begin; see the class."""
        self.topics = (topics.state, topics.effectors)
        self._state_topic = topics.state
        self._gate = gate
        self._state, self._effectors = SampleDecoder(STATE), SampleDecoder(EFFECTORS)
        self._waiting: list[BagMessage] = []
        self._size = _LARGEST

    def segments(self, batch: Sequence[BagMessage]) -> Iterator[PairedBlock]:
        """Yield the samples that a batch completes, but for some that wait for the next batch."""
        wanted = self.topics
        messages = self._waiting + [message for message in batch if message.topic in wanted]
        alone = _SMALLEST
        while len(messages) >= _SMALLEST:
            part = messages[: self._size]
            block, rest = self._block(part)
            if block is not None:
                yield block
                messages = rest + messages[len(part) :]
                self._size, alone = min(2 * self._size, _LARGEST), _SMALLEST
                if len(rest) >= _SMALLEST // 2:
                    break
            elif self._size > _SMALLEST:
                self._size //= 4
            else:
                yield from self._one_by_one(messages[:alone])
                messages = messages[alone:]
                alone *= 2
        self._waiting = messages

    def rest(self) -> Iterator[PairedBlock]:
        """Yield the samples of the messages that still wait, at the end of the bag."""
        yield from self._one_by_one(self._waiting)
        self._waiting = []

    def _block(self, messages: list[BagMessage]) -> tuple[PairedBlock | None, list[BagMessage]]:
        """Return as many samples as the messages hold of both streams, and the messages left over."""
        state = self._state_topic
        is_state = np.array([message.topic == state for message in messages])
        count = min(int(is_state.sum()), len(messages) - int(is_state.sum()))
        if count == 0:
            return None, []
        parts = [[m for m in messages if m.topic == state], [m for m in messages if m.topic != state]]
        states = self._state.decode_block([m.data for m in parts[0][:count]])
        effectors = self._effectors.decode_block([m.data for m in parts[1][:count]])
        if states is None or effectors is None or states.rates is None:
            return None, []
        block = pair_block(
            self._gate,
            Stream(states.stamps_ns, states.names, (states.values, states.rates)),
            Stream(effectors.stamps_ns, effectors.names, (effectors.values,)),
            is_state,
        )
        return block, parts[0][count:] + parts[1][count:]

    def _one_by_one(self, messages: Sequence[BagMessage]) -> Iterator[PairedBlock]:
        return collected(partial(self._offer, message) for message in messages)

    def _offer(self, message: BagMessage) -> PairedSample | None:
        is_state = message.topic == self._state_topic
        try:
            sample = (self._state if is_state else self._effectors).decode(message.data)
        except BagError as error:
            raise self._gate.refuse("malformed", str(error)) from error
        values = sample.values.tolist()
        if not is_state:
            return self._gate.add_effectors(sample.stamp_ns, sample.names, values)
        rates = [] if sample.rates is None else sample.rates.tolist()
        return self._gate.add_state(sample.stamp_ns, sample.names, values, rates)


class MappedSource:
    """The source of a bag with messages of any type.

    Parameters
    ----------
    reader
        Decodes them.
    adapter
        Makes samples of them.
    gate
        Where they are paired and refused.

    Raises
    ------
    BagError
        If a type has no definition.
    EstimationError
        If a topic is missing or of another type.
    """

    longest_run = _LOOK // 2

    def __init__(self, reader: AnyReader, adapter: InputAdapter, gate: Synchronizer) -> None:
        """Check topics and types; see the class."""
        self._reader, self._adapter, self._gate = reader, adapter, gate
        self.topics = tuple(adapter.topics)
        self.straddle, self.servos = adapter.straddle, adapter.servos
        adapter.check(reader.topics)
        for topic in self.topics:
            try:
                reader.definition(topic)
            except BagError as error:
                message = f"{error} (--definitions)"
                raise BagError(message) from error

    @property
    def warnings(self) -> list[str]:
        """A sentence for each topic that is too slow for the rate of the samples."""
        return list(self._adapter.too_slow.values())

    def segments(self, batch: Sequence[BagMessage]) -> Iterator[PairedBlock]:
        """Yield the samples that a batch completes."""
        return collected(self._offers(batch))

    def rest(self) -> Iterator[PairedBlock]:
        """Yield nothing: no message waits here."""
        return iter(())

    def _offers(self, batch: Sequence[BagMessage]) -> Iterator[Offer]:
        for message in batch:
            if message.topic not in self.topics:
                continue
            try:
                decoded = self._reader.decode(message)
            except BagError as error:
                self._gate.refuse("malformed", str(error))
                continue
            rows = self._adapter.push(message.topic, message.stamp_ns, decoded)
            held_for = self._adapter.newly_held()
            if held_for:
                yield partial(Held, held_for)
            for row in rows:
                yield partial(row.offer, self._gate)


def collected(offers: Iterable[Offer]) -> Iterator[PairedBlock]:
    """Yield what the gate lets pass; one block between two jumps of time."""
    samples: list[PairedSample] = []
    held: list[Held] = []
    for offer in offers:
        try:
            sample = offer()
        except Refused:
            continue
        if sample is None:
            continue
        if isinstance(sample, Held):
            held.append(sample._replace(after=len(samples)))
            continue
        if sample.restarted and (samples or held):
            yield _block_of(samples, held)
            samples, held = [], []
        samples.append(sample)
    if samples or held:
        yield _block_of(samples, held)


def _block_of(samples: list[PairedSample], held: list[Held]) -> PairedBlock:
    return PairedBlock(
        bool(samples) and samples[0].restarted,
        np.array([s.stamp for s in samples], dtype=np.int64),
        np.array([s.x for s in samples]),
        np.array([s.xdot for s in samples]),
        np.array([s.delta for s in samples]),
        held,
    )


def counted_topics(reader: AnyReader, read: Mapping[str, int]) -> list[tuple[str, str, int | None]]:
    """Return name, type and count of all topics of a log: by its index, or of those of which all was read, ``read``."""
    known = reader.summary.counts if reader.summary is not None else None
    counts = {name: read.get(name) if known is None else known.get(name, 0) for name in reader.topics}
    return [(name, kind, counts[name]) for name, kind in sorted(reader.topics.items())]
