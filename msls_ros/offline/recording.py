"""A bag's messages of one aircraft in memory, for the report: by topic, in order, as many as can be drawn."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, NamedTuple, TypeVar

from msls_ros.bags import AnyReader, BagError, BagMessage, Sample, SampleDecoder, open_any

T = TypeVar("T")
Stamped = list[tuple[int, T]]
"""Stamps of headers [ns] and what was stamped."""
MODELS_KEPT = 6000
MODELS_DECODED = 3000
"""About so many of more models are decoded."""
JUMP = 1_000_000_000
"""A step back in time larger than this begins a new stretch [ns]."""
_TYPES = {
    "state": "msls_msgs/msg/StateSample",
    "effectors": "msls_msgs/msg/EffectorSample",
    "model": "msls_msgs/msg/LinearModel",
    "fault": "msls_msgs/msg/FaultEvent",
    "dither": "msls_msgs/msg/DitherCommand",
    "truth/model": "msls_msgs/msg/LinearModel",
}
_SAMPLES = ("state", "effectors")
_DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"


class Input(NamedTuple):
    """A message of states or deflections."""

    leaf: str
    """state or effectors."""
    logged: int
    """When the recorder got it [ns]."""
    sample: Sample | None
    """None: it cannot be decoded."""
    error: str


class Thinned(Generic[T]):
    """Every so many of what comes, at most `MODELS_KEPT`, and always the last."""

    def __init__(self, stride: int = 1) -> None:
        """Hold nothing of what is every ``stride``-th already; see the class."""
        self.stride = stride
        self._every = 1
        self._count = 0
        self._kept: Stamped[T] = []
        self._last: tuple[int, T] | None = None

    def add(self, stamp: int, item: T) -> None:
        """Take the next one."""
        if self._count % self._every == 0:
            self._kept.append((stamp, item))
            if len(self._kept) > MODELS_KEPT:
                self._kept = self._kept[::2]
                self._every *= 2
                self.stride *= 2
        self._count += 1
        self._last = stamp, item

    @property
    def items(self) -> Stamped[T]:
        """What is held."""
        if self._last is None or self._kept[-1] is self._last or (self._count - 1) % self._every == 0:
            return self._kept
        return [*self._kept, self._last]


@dataclass
class Recording:
    """The messages of one aircraft."""

    prefix: str
    """What stands before ``state`` in the names of its topics."""
    inputs: list[Input]
    """Of ``state`` and ``effectors``, in the order of the bag."""
    messages: dict[str, Stamped[Any]]
    """Of the other topics."""
    stride: int
    """Every which of the models is held."""
    topics: list[tuple[str, str, int | None]]
    """Name, type and count of all topics of the bag; None where it has no index and what is there is not read."""
    diagnostics: dict[str, dict[str, str]]
    """The last values of each status in /diagnostics, by its name."""
    warnings: list[str] = field(default_factory=list)
    refused: dict[str, int] = field(default_factory=dict)
    examples: dict[str, str] = field(default_factory=dict)
    """Of a log that is read through a map: what the map's reader refused, by reason, and the first of each."""
    straddle: int = 0
    """Samples over which a state of such a log was smoothed; as `Identifier` takes it."""
    servos: bool = False
    """Whether its deflections have passed declared servos; as `Identifier` takes it."""

    def samples(self, leaf: str) -> Stamped[Sample]:
        """Return the samples of a topic that can be decoded."""
        return [(m.sample.stamp_ns, m.sample) for m in self.inputs if m.leaf == leaf and m.sample is not None]


def record_of(bag: Path, namespace: str | None, progress: Callable[[float], None] = lambda share: None) -> Recording:
    """Read a bag.

    Parameters
    ----------
    bag
        Directory or file.
    namespace
        The aircraft, where the bag has several.
    progress
        Called with the share that is read.

    Raises
    ------
    BagError
        If it is not a bag, or holds nothing of an identifier or of its inputs.
    """
    reader = open_any(bag)
    streams = _Streams(reader)
    for batch in reader.batches():
        streams.take(batch)
        progress(reader.progress)
    streams.finish()
    prefix = _aircraft(bag, streams, namespace, sorted(reader.topics))
    models = streams.models.get(prefix, Thinned())
    messages = {leaf: found for (own, leaf), found in streams.messages.items() if own == prefix}
    return Recording(
        prefix=prefix,
        inputs=streams.inputs.get(prefix, []),
        messages={**messages, "model": models.items},
        stride=models.stride,
        topics=[(name, reader.topics[name], streams.counts[name]) for name in sorted(reader.topics)],
        diagnostics=streams.diagnostics,
        warnings=[*reader.warnings, *streams.warnings()],
    )


class _Streams:
    """Sorts messages by aircraft and topic."""

    def __init__(self, reader: AnyReader) -> None:
        self._reader = reader
        self._decoders: dict[str, SampleDecoder] = {}
        self._samples: dict[str, Iterator[Sample] | None] = {}
        self._places: dict[str, tuple[str, str] | None] = {}
        self._bad: dict[str, list[str]] = {}
        self._expected = reader.summary.counts if reader.summary is not None else {}
        self._skipped: dict[str, BagMessage | None] = {}
        self.counts: Counter[str] = Counter()
        self.inputs: dict[str, list[Input]] = {}
        self.messages: dict[tuple[str, str], Stamped[Any]] = {}
        self.models: dict[str, Thinned[Any]] = {}
        self.diagnostics: dict[str, dict[str, str]] = {}

    def take(self, batch: list[BagMessage]) -> None:
        """Decode the messages that matter and put them where they belong; samples all at once where they are alike."""
        topics = {message.topic: message.msgtype for message in batch}
        for topic in [topic for topic, kind in topics.items() if (_place(topic, kind) or ("", ""))[1] in _SAMPLES]:
            decoder = self._decoders.setdefault(topic, SampleDecoder(topics[topic]))
            block = decoder.decode_block([message.data for message in batch if message.topic == topic])
            self._samples[topic] = iter(block.samples()) if block is not None else None
        for message in batch:
            self._take(message)

    def _take(self, message: BagMessage) -> None:
        self.counts[message.topic] += 1
        if message.topic not in self._places:
            self._places[message.topic] = _place(message.topic, message.msgtype)
        place = self._places[message.topic]
        try:
            if place is not None:
                self._put(place, message)
            elif message.msgtype == _DIAGNOSTICS:
                for status in self._reader.decode(message).status:
                    self.diagnostics[str(status.name)] = {str(v.key): str(v.value) for v in status.values}
        except BagError as error:
            self._bad.setdefault(message.topic, []).append(str(error))

    def _put(self, place: tuple[str, str], message: BagMessage) -> None:
        prefix, leaf = place
        if leaf in _SAMPLES:
            inputs, ready = self.inputs.setdefault(prefix, []), self._samples[message.topic]
            try:
                sample = next(ready) if ready is not None else self._decoders[message.topic].decode(message.data)
                inputs.append(Input(leaf, message.stamp_ns, sample, ""))
            except BagError as error:
                inputs.append(Input(leaf, message.stamp_ns, None, str(error)))
                raise
            return
        if leaf == "model" and not self._is_kept(message):
            return
        self._decode(place, message)

    def _is_kept(self, message: BagMessage) -> bool:
        """Whether a model is one of those that can be drawn; of the others only the last is decoded."""
        every = max(1, self._expected.get(message.topic, 0) // MODELS_DECODED)
        kept = (self.counts[message.topic] - 1) % every == 0
        self._skipped[message.topic] = None if kept else message
        return kept

    def finish(self) -> None:
        """Decode the last model, if it was passed over."""
        for topic, message in self._skipped.items():
            place = self._places.get(topic)
            if message is not None and place is not None:
                try:
                    self._decode(place, message)
                except BagError as error:
                    self._bad.setdefault(topic, []).append(str(error))

    def _decode(self, place: tuple[str, str], message: BagMessage) -> None:
        prefix, leaf = place
        decoded = self._reader.decode(message)
        stamp = int(decoded.header.stamp.sec) * 1_000_000_000 + int(decoded.header.stamp.nanosec)
        if leaf == "model":
            every = max(1, self._expected.get(message.topic, 0) // MODELS_DECODED)
            self.models.setdefault(prefix, Thinned(every)).add(stamp, decoded)
        else:
            self.messages.setdefault(place, []).append((stamp, decoded))

    def warnings(self) -> list[str]:
        """Return a sentence for each topic with messages that cannot be decoded."""
        return [
            f"topic {topic}: {len(errors)} of {self.counts[topic]} messages cannot be decoded, the first: {errors[0]}"
            for topic, errors in sorted(self._bad.items())
        ]


def _place(topic: str, msgtype: str) -> tuple[str, str] | None:
    """Return whose topic it is and which; None: none of those that matter."""
    for leaf in sorted(_TYPES, key=len, reverse=True):
        if topic == leaf or topic.endswith(f"/{leaf}"):
            prefix = topic[: len(topic) - len(leaf)]
            truth = prefix.rstrip("/").endswith("truth") and leaf != "truth/model"
            return None if truth or msgtype != _TYPES[leaf] else (prefix, leaf)
    return None


def _aircraft(bag: Path, streams: _Streams, namespace: str | None, topics: list[str]) -> str:
    """Return the prefix of the only aircraft, or of the one asked for."""
    pairs = {prefix for prefix, inputs in streams.inputs.items() if {m.leaf for m in inputs} == set(_SAMPLES)}
    found = sorted(pairs | streams.models.keys())
    if namespace is not None:
        found = [prefix for prefix in found if prefix.strip("/") == namespace.strip("/")]
    if len(found) > 1:
        names = ", ".join(repr(prefix.strip("/")) for prefix in found)
        message = f"{bag}: several aircraft ({names}); choose one with --namespace"
        raise BagError(message)
    if not found:
        where = f" under '{namespace}'" if namespace is not None else ""
        message = (
            f"{bag}: nothing to report{where}: expected a topic model ({_TYPES['model']}), or state "
            f"({_TYPES['state']}) and effectors ({_TYPES['effectors']}); it has {', '.join(topics) or 'no topic'}"
        )
        raise BagError(message)
    return found[0]


def longest_stretch(streams: dict[str, Stamped[Any]], main: str) -> tuple[dict[str, Stamped[Any]], int]:
    """Cut streams whose time jumps back into stretches, and return the longest stretch of all of them.

    Parameters
    ----------
    streams
        By topic, in the order of the bag.
    main
        The topic that decides.

    Returns
    -------
    dict
        The streams within the longest stretch.
    int
        How many stretches there are.
    """
    cuts = {name: _cut(stream) for name, stream in streams.items()}
    stretches = cuts[main]
    if len(stretches) < 2:
        return {name: max(parts, key=len) if parts else [] for name, parts in cuts.items()}, 1
    best = max(range(len(stretches)), key=lambda i: len(stretches[i]))
    begin, end = stretches[best][0][0], stretches[best][-1][0]
    chosen = {}
    for name, parts in cuts.items():
        part = parts[best] if len(parts) == len(stretches) else (parts[-1] if parts else [])
        chosen[name] = [(stamp, item) for stamp, item in part if begin <= stamp <= end]
    return chosen, len(stretches)


def spans_of(stream: Stamped[Any]) -> list[tuple[int, int]]:
    """Return the first and last stamp of each stretch between jumps back in time [ns]."""
    return [(part[0][0], part[-1][0]) for part in _cut(stream)]


def _cut(stream: Stamped[Any]) -> list[Stamped[Any]]:
    parts: list[Stamped[Any]] = []
    for stamp, item in stream:
        if not parts or stamp < parts[-1][-1][0] - JUMP:
            parts.append([])
        elif stamp <= parts[-1][-1][0] and isinstance(item, Sample):
            continue
        parts[-1].append((stamp, item))
    return parts
