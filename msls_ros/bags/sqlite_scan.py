"""Reads a rosbag2 sqlite3 file (`.db3`) in the order in which it was written, whole or damaged.

Rows come by row number: no sorting, no index, and of a damaged file everything before the damage.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Iterator
from pathlib import Path
from urllib.parse import quote

from msls_ros.bags.definitions import Definition
from msls_ros.bags.errors import BagError
from msls_ros.bags.storage import BagMessage, Summary, Topic, normalize_type

MAGIC = b"SQLite format 3\0"
_BATCH = 1000


class SqliteScanner:
    """Scanner of one sqlite3 file.

    Parameters
    ----------
    path : Path
        The file.
    name : Path, optional
        What messages call it, where `path` is a temporary copy.

    Raises
    ------
    BagError
        It is not a rosbag2 database, or the table of its topics is damaged.
    """

    def __init__(self, path: Path, name: Path | None = None) -> None:
        self._name = name or path
        journal = path.with_name(path.name + "-wal")
        mode = "mode=ro" if journal.exists() else "mode=ro&immutable=1"
        try:
            self._connection = sqlite3.connect(f"file:{quote(str(path.resolve()))}?{mode}", uri=True)
            # Without it sqlite refuses a file that is shorter than its first page says.
            self._connection.execute("PRAGMA writable_schema = ON")
            self._connection.text_factory = lambda text: text.decode("utf-8", "replace")
        except sqlite3.Error as error:
            raise self._unusable(error) from error
        try:
            self._topics = self._read_topics()
        except (sqlite3.Error, ValueError, TypeError) as error:
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
        malformed = 0
        damage: sqlite3.Error | None = None
        try:
            for row, number, stamp, data in self._connection.execute(
                "SELECT id, topic_id, timestamp, data FROM messages ORDER BY id"
            ):
                self._row = row
                if not (isinstance(stamp, int) and isinstance(data, bytes) and number in self._topics):
                    malformed += 1
                elif number in names:
                    batch.append(BagMessage(*names[number], stamp, data))
                if len(batch) >= _BATCH:
                    yield batch
                    batch = []
        except sqlite3.Error as error:
            damage = error
        if batch:
            yield batch
        if damage is not None:
            warn(f"damaged after row {self._row} ({damage}); read up to there")
        if malformed:
            warn(f"{malformed} damaged rows skipped; all the rest was read")

    def _read_topics(self) -> dict[int, Topic]:
        columns = {row[1] for row in self._connection.execute("PRAGMA table_info(topics)")}
        if not {"id", "name", "type", "serialization_format"} <= columns:
            what = "no table of topics"
            raise ValueError(what)
        qos = "offered_qos_profiles" if "offered_qos_profiles" in columns else "''"
        definitions = self._read_definitions()
        topics = {}
        for number, name, kind, serialization, profiles in self._connection.execute(
            f"SELECT id, name, type, serialization_format, {qos} FROM topics ORDER BY id"
        ):
            if not (isinstance(name, str) and isinstance(kind, str) and isinstance(serialization, str)):
                continue
            msgtype = normalize_type(kind)
            topics[number] = Topic(name, msgtype, serialization, definitions.get(msgtype), str(profiles or ""))
        return topics

    def _read_definitions(self) -> dict[str, Definition]:
        if not self._one("SELECT count(*) FROM sqlite_master WHERE name = 'message_definitions'"):
            return {}
        rows = self._connection.execute(
            "SELECT topic_type, encoding, encoded_message_definition, type_description_hash FROM message_definitions"
        )
        whole = [row for row in rows if row[2] and all(isinstance(column, str) for column in row)]
        return {normalize_type(row[0]): Definition(normalize_type(row[0]), *row[1:]) for row in whole}

    def _one(self, query: str) -> int | None:
        row = self._connection.execute(query).fetchone()
        return None if row is None or row[0] is None else int(row[0])

    def _unusable(self, error: Exception) -> BagError:
        return BagError(f"{self._name}: not a readable rosbag2 database: {error}")
