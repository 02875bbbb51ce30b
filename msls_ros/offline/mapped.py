"""A log of other topics in memory, read through its map: what a bag of `msls_msgs` would hold of it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any, Protocol

from msls_ros.bags import AnyReader, BagError, Sample
from msls_ros.estimation import Configuration
from msls_ros.inputs import InputAdapter, InputMap, Refused, StateRow
from msls_ros.offline.collection import no_collection
from msls_ros.offline.inspection import why_undecoded
from msls_ros.offline.recording import Input, Recording
from msls_ros.offline.sources import counted_topics, ordered_batches

_OURS = "msls_msgs/msg/"
_LONGEST_RUN = 500


def is_own(reader: AnyReader) -> bool:
    """Whether a log holds `msls_msgs`."""
    return any(kind.startswith(_OURS) for kind in reader.topics.values())


class Observer(Protocol):
    """Sees each message of a log while it is read."""

    def take(self, topic: str, logged: int, message: Any) -> None:
        """Take a message, with its log time [ns]."""
        ...

    def undecoded(self, topic: str, why: str) -> None:
        """Take note of one that cannot be decoded."""
        ...


def mapped_recording(
    reader: AnyReader,
    configuration: Configuration,
    inputs: InputMap,
    progress: Callable[[float], None] = lambda share: None,
    observer: Observer | None = None,
) -> Recording:
    """Read a log through its map.

    Parameters
    ----------
    reader
        Of the log.
    configuration
        Of the identifier.
    inputs
        The map.
    progress
        Called with the share that is read.
    observer
        Sees each message; None: nobody does.

    Raises
    ------
    BagError, EstimationError
        If the map's topics are not there, or have no definitions.
    """
    refused: Counter[str] = Counter()
    examples: dict[str, str] = {}

    def note(one: Refused) -> None:
        examples.setdefault(one.reason, str(one))

    adapter = InputAdapter.of(inputs, configuration, refused, note)
    adapter.check(reader.topics)
    own = reader.only(adapter.topics)
    found: list[Input] = []
    read: Counter[str] = Counter()
    with no_collection():
        for batch in ordered_batches(own, list(adapter.topics), _LONGEST_RUN):
            for message in batch:
                read[message.topic] += 1
                try:
                    decoded = own.decode(message)
                except BagError as error:
                    refused["malformed"] += 1
                    examples.setdefault("malformed", str(error))
                    if observer is not None:
                        observer.undecoded(message.topic, why_undecoded(own, message, error))
                    continue
                if observer is not None:
                    observer.take(message.topic, message.stamp_ns, decoded)
                for row in adapter.push(message.topic, message.stamp_ns, decoded):
                    if isinstance(row, StateRow):
                        found.append(Input("state", row.stamp, Sample(row.stamp, row.names, row.x, row.xdot), ""))
                    else:
                        found.append(Input("effectors", row.stamp, Sample(row.stamp, row.names, row.delta, None), ""))
            progress(own.progress)
    topics = counted_topics(reader, read)
    warnings = [*own.warnings, *adapter.too_slow.values()]
    return Recording(
        prefix="/", inputs=found, messages={"model": []}, stride=1, topics=topics, diagnostics={},
        warnings=warnings, refused=dict(refused), examples=examples, straddle=adapter.straddle,
        servos=adapter.servos,
    )  # fmt: skip
