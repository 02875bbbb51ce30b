"""Reads a rosbag2 sqlite3 file (`.db3`) in the order in which it was written, whole or damaged.

Rows come by row number: no sorting, no index, and of a damaged file everything before the damage. Only tables are read:
a view, or a column that is computed, could give rows without end.
"""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Callable, Iterator
from pathlib import Path
from urllib.parse import quote

from msls_ros.bags.definitions import Definition
from msls_ros.bags.errors import BagError
from msls_ros.bags.limits import HELD, PIECE, size_text
from msls_ros.bags.storage import BagMessage, Summary, Topic, normalize_type

MAGIC = b"SQLite format 3\0"
_BATCH = 1000
_MAX_TOPICS = 10_000
_MAX_DESCRIPTION = 1 << 20
"""Characters of a name, a definition, or profiles."""
_STEPS = 1_000_000
_MAX_TURNS = 1000
"""Times so many steps of its machine that sqlite may take for one row."""
_TOPIC_COLUMNS = ("id", "name", "type", "serialization_format")
_DEFINITION_COLUMNS = ("topic_type", "encoding", "encoded_message_definition", "type_description_hash")


class SqliteScanner:
    """Scanner of one sqlite3 file.

    Parameters
    ----------
    path : Path
        The file.
    name : Path, optional
        What messages call it, where `path` is a temporary copy.
    held : int
        What may be held at a time [bytes].

    Raises
    ------
    BagError
        It is not a rosbag2 database, or the table of its topics is damaged.
    """

    def __init__(self, path: Path, name: Path | None = None, held: int = HELD) -> None:
        self._name = name or path
        self._held = held
        self._turns = 0
        self.lost = False
        """Whether anything was written, as far as it has been read, that cannot be."""
        beside = [path.with_name(path.name + end) for end in ("-wal", "-shm", "-journal")]
        usable = beside[0].is_file() and all(file.is_file() or not file.exists() for file in beside)
        mode = "mode=ro" if usable else "mode=ro&immutable=1"
        try:
            self._connection = sqlite3.connect(f"file:{quote(os.fsencode(path.resolve()))}?{mode}", uri=True)
            self._connection.set_progress_handler(self._too_long, _STEPS)
            # Without it sqlite refuses a file that is shorter than its first page says.
            self._connection.execute("PRAGMA writable_schema = ON")
            self._connection.text_factory = lambda text: text.decode("utf-8", "replace")
        except sqlite3.Error as error:
            raise self._unusable(error) from error
        try:
            self._topics = self._read_topics()
            self._require("messages", ("id", "topic_id", "timestamp", "data"))
        except (sqlite3.Error, ValueError, TypeError, OverflowError) as error:
            self._connection.close()
            raise self._unusable(error) from error
        try:
            self._last_row = self._one("SELECT max(id) FROM messages") or 0
        except sqlite3.Error:
            self._last_row = 0
        self._row = 0

    @property
    def topics(self) -> list[Topic]:
        """All topics of the file."""
        return list(self._topics.values())

    @property
    def summary(self) -> Summary | None:
        """None: counting would read the whole file."""
        return None

    def progress(self) -> float:
        """Give the share of the rows that have been read, 0 to 1."""
        return self._row / self._last_row if self._last_row else 0.0

    def close(self) -> None:
        """Close the file."""
        self._connection.close()

    def batches(self, wanted: Callable[[str], bool], warn: Callable[[str], None]) -> Iterator[list[BagMessage]]:
        """Yield the messages of some rows at a time; see `Scanner.batches`."""
        names = {number: (topic.name, topic.msgtype) for number, topic in self._topics.items() if wanted(topic.name)}
        batch: list[BagMessage] = []
        malformed = size = 0
        damage = ""
        try:
            for row, number, stamp, length, data in self._connection.execute(
                "SELECT id, topic_id, timestamp, length(data), CASE WHEN length(data) <= ? THEN data END "
                "FROM messages ORDER BY id",
                (self._held,),
            ):
                if not isinstance(row, int) or row <= self._row:
                    damage = "a row stands in it twice"
                    break
                self._row, self._turns = row, 0
                if not (isinstance(stamp, int) and isinstance(data, bytes) and number in self._topics):
                    malformed += 1
                elif number in names:
                    batch.append(BagMessage(*names[number], stamp, data))
                    size += length
                if len(batch) >= _BATCH or size > PIECE:
                    yield batch
                    batch, size = [], 0
        except (sqlite3.Error, OverflowError, MemoryError) as error:
            damage = str(error)
        self.lost = bool(damage or malformed)
        if batch:
            yield batch
        if damage:
            warn(f"damaged after row {self._row} ({damage}); read up to there")
        if malformed:
            warn(f"{malformed} damaged rows, or rows of more than {size_text(self._held)}, skipped; the rest was read")

    def _too_long(self) -> int:
        """Stop what gives no row for long."""
        self._turns += 1
        return int(self._turns > _MAX_TURNS)

    def _require(self, table: str, names: tuple[str, ...]) -> set[str]:
        """Refuse what is no plain table with these columns; give all its columns."""
        found = self._connection.execute(
            "SELECT count(*), min(type), min(sql LIKE 'CREATE TABLE%') FROM sqlite_master WHERE name = ?", (table,)
        ).fetchone()
        if found != (1, "table", 1):
            what = f"expected a table {table}"
            raise ValueError(what)
        columns = {row[1]: row[6] for row in self._connection.execute(f"PRAGMA table_xinfo({table})")}
        if not set(names) <= columns.keys() or any(columns.values()):
            what = f"expected the table {table} with the plain columns {', '.join(names)}"
            raise ValueError(what)
        return set(columns)

    def _read_topics(self) -> dict[int, Topic]:
        columns = self._require("topics", _TOPIC_COLUMNS)
        qos = "offered_qos_profiles" if "offered_qos_profiles" in columns else "''"
        definitions = self._read_definitions()
        topics = {}
        for number, name, kind, serialization, profiles in self._connection.execute(
            f"SELECT id, name, type, serialization_format, {qos} FROM topics "
            f"WHERE length(name) + length(type) + length({qos}) <= {_MAX_DESCRIPTION} ORDER BY id LIMIT {_MAX_TOPICS}"
        ):
            if not (isinstance(name, str) and isinstance(kind, str) and isinstance(serialization, str)):
                continue
            msgtype = normalize_type(kind)
            topics[number] = Topic(name, msgtype, serialization, definitions.get(msgtype), str(profiles or ""))
        return topics

    def _read_definitions(self) -> dict[str, Definition]:
        if not self._one("SELECT count(*) FROM sqlite_master WHERE name = 'message_definitions'"):
            return {}
        self._require("message_definitions", _DEFINITION_COLUMNS)
        rows = self._connection.execute(
            f"SELECT {', '.join(_DEFINITION_COLUMNS)} FROM message_definitions "
            f"WHERE length(encoded_message_definition) <= {_MAX_DESCRIPTION} LIMIT {_MAX_TOPICS}"
        )
        whole = [row for row in rows if row[2] and all(isinstance(column, str) for column in row)]
        return {normalize_type(row[0]): Definition(normalize_type(row[0]), *row[1:]) for row in whole}

    def _one(self, query: str) -> int | None:
        row = self._connection.execute(query).fetchone()
        return None if row is None or row[0] is None else int(row[0])

    def _unusable(self, error: Exception) -> BagError:
        return BagError(f"{self._name}: not a readable rosbag2 database: {error}")
