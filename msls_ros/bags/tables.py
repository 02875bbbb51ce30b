"""Logs of autopilots as tables, and a reader of them with the face of `BagReader`.

A table is one message type (and instance) of a log: stamps and a column for each field. `LogReader` gives its rows as
messages in the order of their stamps, so that whatever reads a bag reads a PX4 or ArduPilot log too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msls_ros.bags.definitions import Definition
from msls_ros.bags.errors import BagError, one_line
from msls_ros.bags.storage import BagMessage, Summary

Columns = Mapping[str, NDArray[Any]]
_BATCH = 2000
_INDEX = 8
"""Bytes of a message's data: the row of its table."""


@dataclass(frozen=True)
class Table:
    """One message type of a log; k rows.

    Attributes
    ----------
    msgtype : str
        `px4_msgs/msg/VehicleAttitude`, `ardupilot/msg/ATT`.
    stamps : ndarray of int64, shape (k,)
        Since boot [ns], rising or not as logged.
    columns : mapping of str to ndarray
        By field: (k,), or (k, n) of an array of n.
    """

    msgtype: str
    stamps: NDArray[np.int64]
    columns: Columns


@dataclass(frozen=True)
class FlightLog:
    """A log of an autopilot.

    Attributes
    ----------
    path : Path
        The file.
    tables : mapping of str to Table
        By topic: `/vehicle_attitude`, `/IMU`; `/IMU/1` is the second instance.
    parameters : mapping of str to float
        Of the autopilot, as at the start of the log.
    warnings : list of str
        Damage, and what the logger could not write.
    """

    path: Path
    tables: Mapping[str, Table]
    parameters: Mapping[str, float]
    warnings: list[str] = field(default_factory=list)


class LogReader:
    """Read a log's rows as messages; the face is that of `BagReader`.

    Parameters
    ----------
    log : FlightLog
        The log.
    topics : iterable of str, optional
        Only these; all by default.
    """

    def __init__(self, log: FlightLog, topics: Iterable[str] | None = None) -> None:
        self.log = log
        self.path = log.path
        self.warnings = [one_line(warning) for warning in log.warnings]
        self.lost = bool(log.warnings)
        self.progress = 0.0
        wanted = set(log.tables if topics is None else topics)
        self._tables = {topic: table for topic, table in log.tables.items() if topic in wanted}
        self._makers = {topic: _maker(table.msgtype) for topic, table in self._tables.items()}

    @property
    def topics(self) -> dict[str, str]:
        """Types by topic, of the whole log."""
        return {topic: table.msgtype for topic, table in self.log.tables.items()}

    @property
    def summary(self) -> Summary:
        """Counts and times."""
        counts = {topic: len(table.stamps) for topic, table in self._tables.items()}
        ends = [(t.stamps.min(), t.stamps.max()) for t in self._tables.values() if len(t.stamps)]
        return Summary(counts, int(min((e[0] for e in ends), default=0)), int(max((e[1] for e in ends), default=0)))

    def __iter__(self) -> Iterator[BagMessage]:
        """Yield the rows from the start."""
        for batch in self.batches():
            yield from batch

    def batches(self) -> Iterator[list[BagMessage]]:
        """Yield the rows of all topics in the order of their stamps, some at a time."""
        names = list(self._tables)
        if not names:
            return
        tables = [self._tables[name] for name in names]
        stamps = np.concatenate([t.stamps for t in tables])
        owner = np.concatenate([np.full(len(t.stamps), i) for i, t in enumerate(tables)])
        rows = np.concatenate([np.arange(len(t.stamps)) for t in tables])
        order = np.argsort(stamps, kind="stable")
        for start in range(0, len(order), _BATCH):
            chosen = order[start : start + _BATCH]
            self.progress = min(1.0, (start + _BATCH) / len(order))
            yield [
                BagMessage(names[i], tables[i].msgtype, stamp, row.to_bytes(_INDEX, "little"))
                for i, stamp, row in zip(
                    owner[chosen].tolist(), stamps[chosen].tolist(), rows[chosen].tolist(), strict=True
                )
            ]

    def only(self, topics: Iterable[str]) -> LogReader:
        """Give a reader of the same log for some topics."""
        return LogReader(self.log, topics)

    def decode(self, message: BagMessage) -> Any:
        """Give a row as an object with an attribute for each field.

        Parameters
        ----------
        message : BagMessage
            Of this log.
        """
        table, row = self.log.tables[message.topic], int.from_bytes(message.data, "little")
        return self._makers[message.topic](**{name: column[row] for name, column in table.columns.items()})

    def decoded(self) -> Iterator[tuple[BagMessage, Any]]:
        """Yield every row with its object."""
        for message in self:
            yield message, self.decode(message)

    def definition(self, topic: str) -> Definition:
        """Give a definition without text: rows of a log need none.

        Raises
        ------
        BagError
            There is no such topic.
        """
        if topic not in self.log.tables:
            msg = f"{self.path}: no topic {topic}; it has {', '.join(sorted(self.log.tables)) or 'none'}"
            raise BagError(msg)
        return Definition(self.log.tables[topic].msgtype, "", "", "")


def _maker(msgtype: str) -> Callable[..., Any]:
    """Return the class of a topic's objects, with the name of its type for sentences."""
    return type(msgtype.rpartition("/")[2], (SimpleNamespace,), {})
