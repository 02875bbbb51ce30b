"""Look at a log before it is used: what is in it, and whether its map reads it rightly."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from msls_ros.bags import AnyReader, BagError, BagMessage, SampleDecoder
from msls_ros.estimation import LARGEST, Configuration, EstimationError
from msls_ros.inputs import InputAdapter, InputMap
from msls_ros.inputs.field_paths import listed
from msls_ros.inputs.findings import WRONG, Finding, ordered
from msls_ros.inputs.inspection import check_topics, findings_of
from msls_ros.inputs.series import UNDECODED, Collector, Record, Series, TopicTimes
from msls_ros.offline.sources import EFFECTORS, STATE, InputTopics, counted_topics

MOST = 150_000
"""Messages that are looked at."""


@dataclass(frozen=True)
class Inspection:
    """What was found."""

    topics: list[tuple[str, str, int | None]]
    """Name, type and count; None where the log has no index that gives it."""
    findings: list[Finding]
    looked_at: int
    """Messages."""
    seconds: float
    """Of the clock, that they cover."""

    @property
    def wrong(self) -> list[Finding]:
        """The findings that make numbers wrong."""
        return [f for f in self.findings if f.level == WRONG]


def inspect(
    reader: AnyReader,
    configuration: Configuration,
    inputs: InputMap | InputTopics,
    progress: Callable[[float], None] = lambda share: None,
    seen: tuple[Record, int] | None = None,
) -> Inspection:
    """Look at a log through its map.

    Parameters
    ----------
    reader
        Of the log.
    configuration
        Of the identifier that is to use it.
    inputs
        The map; or the topics of `msls_msgs`.
    progress
        Called with the share that is done.
    seen
        What was read of it already, and of how many messages; None: it is read.

    Raises
    ------
    BagError
        If a type has no definition.
    EstimationError
        If the map does not give what the configuration needs.
    """
    topics = counted_topics(reader, {})
    found: list[Finding] = []
    if isinstance(inputs, InputTopics):
        record, looked_at = _read_own(reader, inputs, configuration, progress)
    else:
        InputAdapter(inputs, configuration.states, configuration.effectors)  # refuses what no log could mend
        found = list(check_topics(inputs, reader.topics))
        record, looked_at = seen or read_record(reader, inputs, progress)
    missing = {f.where for f in found}
    found += [f for f in findings_of(record, configuration) if f.where not in missing]
    stamps = record.topics[record.inputs.clock].stamps
    seconds = float(np.ptp(stamps)) * 1e-9 if len(stamps) else 0.0
    return Inspection(topics, ordered(found), looked_at, seconds)


def read_record(
    reader: AnyReader, inputs: InputMap, progress: Callable[[float], None] = lambda share: None, most: int = MOST
) -> tuple[Record, int]:
    """Read a log's messages through a map, so many at most; return the record and how many they were.

    Raises
    ------
    BagError
        If a type has no definition.
    """
    wanted = [t.topic for t in inputs.topics.values() if reader.topics.get(t.topic) == t.msgtype]
    for name in wanted:
        try:
            reader.definition(name)
        except BagError as error:
            text = f"{error} (--definitions)"
            raise BagError(text) from error
    collector, count = Collector(inputs), 0
    own = reader.only(wanted)
    for batch in own.batches():
        for message in batch[: most - count]:
            try:
                decoded = own.decode(message)
            except BagError as error:
                collector.undecoded(message.topic, why_undecoded(own, message, error))
                continue
            collector.take(message.topic, message.stamp_ns, decoded)
        count += len(batch)
        progress(min(1.0, max(own.progress, count / most)))
        if count >= most:
            break
    return collector.record(), min(count, most)


def why_undecoded(reader: AnyReader, message: BagMessage, error: BagError) -> str:
    """Return why a message cannot be decoded, without the log and the topic, which stand beside it."""
    return str(error).removeprefix(f"{reader.path}: topic {message.topic}: ")


def own_map(configuration: Configuration, topics: InputTopics) -> InputMap:
    """Return the map that reads `msls_msgs`."""
    lines = {
        "topics.state": f"{topics.state} {STATE}",
        "topics.effectors": f"{topics.effectors} {EFFECTORS}",
        "clock": "state",
        **{f"states.{name}": "state x" for name in configuration.states},
        **{f"derivatives.{name}": "state xdot" for name in configuration.states},
        **{f"effectors.{name}": "effectors delta" for name in configuration.effectors},
    }
    return InputMap.from_parameters(lines)


def _read_own(
    reader: AnyReader, topics: InputTopics, configuration: Configuration, progress: Callable[[float], None]
) -> tuple[Record, int]:
    """Read `msls_msgs`, five times as fast as by paths."""
    inputs = own_map(configuration, topics)
    readings = {
        topics.state: _Reading(STATE, configuration.states),
        topics.effectors: _Reading(EFFECTORS, configuration.effectors),
    }
    record, count = Record(inputs), 0
    own = reader.only(list(readings))
    for batch in own.batches():
        part = batch[: MOST - count]
        for name, reading in readings.items():
            reading.take([message for message in part if message.topic == name])
        count += len(batch)
        progress(min(1.0, max(own.progress, count / MOST)))
        if count >= MOST:
            break
    for alias, source in inputs.topics.items():
        reading = readings[source.topic]
        times, logged, table = (np.concatenate(column) for column in reading.columns)
        step = np.diff(times)
        repeated, back = int((step == 0).sum()), int((step < 0).sum())
        record.topics[alias] = TopicTimes(times, logged, repeated, back)
        for reason, sentence in reading.failures:
            record.fail(f"topics.{alias}", reason, sentence)
        _put(record, alias, times, table, reading.names)
    return record, min(count, MOST)


class _Reading:
    """What a topic of samples holds: stamps, times of the log, and values with rates in the order wanted."""

    def __init__(self, msgtype: str, names: tuple[str, ...]) -> None:
        """Hold nothing yet.

        Parameters
        ----------
        msgtype
            Of `SampleDecoder`.
        names
            Wanted.
        """
        self.names, self._decoder = names, SampleDecoder(msgtype)
        self.failures: list[tuple[str, str]] = []
        """Reason and sentence of each message that could not be read."""
        empty = np.zeros(0, dtype=np.int64)
        self.columns: tuple[list[Any], list[Any], list[Any]] = ([empty], [empty], [np.zeros((0, 2 * len(names)))])

    def take(self, messages: list[BagMessage]) -> None:
        """Take messages all at once where they are alike, else those that can be read."""
        block = self._decoder.decode_block([message.data for message in messages]) if messages else None
        if block is not None and set(self.names) <= set(block.names):
            logged = [message.stamp_ns for message in messages]
            self._add(block.stamps_ns, logged, block.names, block.values, block.rates)
            return
        for message in messages:
            try:
                sample = self._decoder.decode(message.data)
            except BagError as error:
                self.failures.append((UNDECODED, str(error)))
                continue
            missing = [name for name in self.names if name not in sample.names]
            if missing:
                self.failures.append(("names", f"no '{missing[0]}' among the names {listed(sample.names)}"))
            elif len(sample.values) != len(sample.names):
                self.failures.append(("length", f"{len(sample.values)} values of {len(sample.names)} names"))
            else:
                rates = sample.rates if sample.rates is None else sample.rates[None, :]
                self._add([sample.stamp_ns], [message.stamp_ns], sample.names, sample.values[None, :], rates)

    def _add(self, stamps: Any, logged: Any, names: tuple[str, ...], values: Any, rates: Any) -> None:
        order = [names.index(name) for name in self.names]
        if rates is not None and rates.shape[1] > max(order):
            rates = rates[:, order]
        else:
            rates = np.full((len(values), len(order)), np.nan)
        rows = np.hstack([values[:, order], rates])
        for column, found in zip(self.columns, (stamps, logged, rows), strict=True):
            column.append(np.asarray(found))


def _put(record: Record, alias: str, times: Any, table: Any, names: tuple[str, ...]) -> None:
    """Put the columns of a topic into a record, those of rising stamps and finite numbers."""
    if not len(times):
        return
    rising = np.concatenate(([True], times[1:] > np.maximum.accumulate(times)[:-1]))
    groups = ("states", "derivatives") if alias == "state" else ("effectors",)
    for i, group in enumerate(groups):
        for j, name in enumerate(names):
            values = table[:, i * len(names) + j]
            good = rising & (np.abs(values) < LARGEST)
            if good.any():
                stream = record.inputs.streams[f"{group}.{name}"]
                record.series[stream.name] = Series(stream, times[good], values[good][:, None])


def check_map(log: Path, inspection: Inspection) -> None:
    """Refuse a log whose map makes numbers wrong.

    Raises
    ------
    EstimationError
        With the first finding, and how many there are.
    """
    refuse_wrong(str(log), inspection.findings, "--anyway")


def refuse_wrong(name: str, findings: Sequence[Finding], anyway: str) -> None:
    """Refuse what was found wrong; ``anyway`` is what its user may say to that.

    Raises
    ------
    EstimationError
        With the first finding, and how many there are.
    """
    wrong = [f for f in findings if f.level == WRONG]
    if wrong:
        more = f" (and {len(wrong) - 1} more, see ./msls inspect)" if len(wrong) > 1 else ""
        message = f"{name}: {wrong[0].sentence()}{more}; {anyway} uses it as it is"
        raise EstimationError(message)
