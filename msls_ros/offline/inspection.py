"""Look at a log before it is used: what is in it, and whether its map reads it rightly."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from msls_ros.bags import AnyReader, BagError, SampleDecoder
from msls_ros.estimation import LARGEST, Configuration, EstimationError
from msls_ros.inputs import InputAdapter, InputMap
from msls_ros.inputs.findings import WRONG, Finding, ordered
from msls_ros.inputs.inspection import check_topics, findings_of
from msls_ros.inputs.series import Collector, Record, Series, TopicTimes
from msls_ros.offline.sources import EFFECTORS, STATE, InputTopics

MOST = 150_000
"""Messages that are looked at."""


@dataclass(frozen=True)
class Inspection:
    """What was found."""

    topics: list[tuple[str, str, int]]
    """Name, type and count, as far as the log's index gives it."""
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

    Raises
    ------
    BagError
        If a type has no definition.
    EstimationError
        If the map does not give what the configuration needs.
    """
    counts = reader.summary.counts if reader.summary is not None else {}
    topics = [(name, kind, counts.get(name, 0)) for name, kind in sorted(reader.topics.items())]
    found: list[Finding] = []
    if isinstance(inputs, InputTopics):
        record, looked_at = _read_own(reader, inputs, configuration, progress)
    else:
        InputAdapter(inputs, configuration.states, configuration.effectors)  # refuses what no log could mend
        found = list(check_topics(inputs, reader.topics))
        record, looked_at = read_record(reader, inputs, progress)
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
            except BagError:
                continue
            collector.take(message.topic, message.stamp_ns, decoded)
        count += len(batch)
        progress(min(1.0, max(own.progress, count / most)))
        if count >= most:
            break
    return collector.record(), min(count, most)


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
    decoders = {topics.state: SampleDecoder(STATE), topics.effectors: SampleDecoder(EFFECTORS)}
    stamps: dict[str, list[int]] = {name: [] for name in decoders}
    logged: dict[str, list[int]] = {name: [] for name in decoders}
    rows: dict[str, list[Any]] = {name: [] for name in decoders}
    wanted = {topics.state: configuration.states, topics.effectors: configuration.effectors}
    count = 0
    own = reader.only(list(decoders))
    for batch in own.batches():
        for message in batch[: MOST - count]:
            try:
                sample = decoders[message.topic].decode(message.data)
                order = [sample.names.index(name) for name in wanted[message.topic]]
            except (BagError, ValueError, IndexError):
                continue
            rates = sample.rates
            rates = rates[order] if rates is not None and len(rates) > max(order) else np.full(len(order), np.nan)
            stamps[message.topic].append(sample.stamp_ns)
            logged[message.topic].append(message.stamp_ns)
            rows[message.topic].append(np.concatenate([sample.values[order], rates]))
        count += len(batch)
        progress(min(1.0, max(own.progress, count / MOST)))
        if count >= MOST:
            break
    record = Record(inputs)
    for alias, source in inputs.topics.items():
        times = np.array(stamps[source.topic], dtype=np.int64)
        step = np.diff(times)
        repeated, back = int((step == 0).sum()), int((step < 0).sum())
        record.topics[alias] = TopicTimes(times, np.array(logged[source.topic], dtype=np.int64), repeated, back)
        table = np.array(rows[source.topic])
        _put(record, alias, times, table, wanted[source.topic])
    return record, min(count, MOST)


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
    wrong = inspection.wrong
    if wrong:
        more = f" (and {len(wrong) - 1} more, see ./msls inspect)" if len(wrong) > 1 else ""
        message = f"{log}: {wrong[0].sentence()}{more}; --anyway uses it as it is"
        raise EstimationError(message)
