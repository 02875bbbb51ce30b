"""Writes rosbag2 MCAP bags that survive a kill.

A bag is a directory with `metadata.yaml` and `NAME_0.mcap`. Messages collect in a chunk, and the chunk goes
to the operating system when it is full or half a second old, whichever comes first::

    magic | header | chunk + index | chunk + index | ...      a process that dies ends here: all chunks are readable
                                   ... | metadata | summary | footer | magic      close() adds these

`rosbags` writes a chunk only when it holds 1 MiB, many seconds of a flight, and `metadata.yaml` only at the end:
therefore a writer of our own, whose `flush` ends a chunk early. What a power cut takes is up to the file
system (nothing is synced to the disk).
"""

from __future__ import annotations

import os
import re
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msls_ros.bags import metadata
from msls_ros.bags.definitions import Definition, Definitions, default_definitions
from msls_ros.bags.errors import BagError
from msls_ros.bags.mcap_write import McapWriter
from msls_ros.bags.metadata import Qos, TopicEntry
from msls_ros.bags.serde import serialize

FLUSH_INTERVAL_S = 0.5
_STAMP_LIMIT = 1 << 63
LAST_STAMP = _STAMP_LIMIT - 1
"""The largest log time that a bag can hold [ns]."""
_OF_A_BAG = re.compile(
    r"^metadata\.yaml(\.tmp)?$|^(identifier|warm_start_model)\.yaml$|\.(mcap|db3)(\.zstd|-wal|-shm)?$"
)


class BagWriter:
    """A bag that is being recorded.

    Parameters
    ----------
    path : path
        The bag directory to make.
    overwrite : bool
        Replace a bag that is there; anything else that is there is never touched.
    definition_paths : iterable of path
        Where to look for message definitions first, see `definitions`.

    Raises
    ------
    BagError
        The path exists, or cannot be written.

    Notes
    -----
    Not for use from several threads at once. `write` starts the flush when it is due; a recorder whose topics
    can fall silent calls `flush` from a timer as well.
    """

    def __init__(
        self, path: str | Path, *, overwrite: bool = False, definition_paths: Iterable[str | Path] = ()
    ) -> None:
        self.path = Path(path)
        extra = list(definition_paths)
        self._definitions = Definitions(extra) if extra else default_definitions()
        self._make_directory(overwrite)
        self.file = self.path / f"{_utf8_name(self.path)}_0.mcap"
        try:
            self._stream = self.file.open("xb")
        except OSError as error:
            raise _unwritable(self.file, error) from error
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, tuple[int, TopicEntry]] = {}
        self._start_ns = _STAMP_LIMIT
        self._end_ns = 0
        self._closed = False
        self._new_topics = True
        self._next_flush = time.monotonic() + FLUSH_INTERVAL_S
        try:
            self._writer = McapWriter(self._stream)
        except OSError as error:
            raise _unwritable(self.file, error) from error
        self.flush()

    @property
    def counts(self) -> dict[str, int]:
        """Messages written so far, by topic."""
        return {topic: entry.count for topic, (_, entry) in self._channels.items()}

    def add_topic(
        self,
        topic: str,
        msgtype: str,
        *,
        qos: Qos | list[dict[str, Any]] | None = None,
        definition: Definition | None = None,
    ) -> None:
        """Announce a topic; the first `write` does it otherwise.

        Parameters
        ----------
        topic : str
            Name.
        msgtype : str
            `PKG/msg/NAME`.
        qos : Qos or list of dict, optional
            What publishers offered; a list is stored as it is (from another bag).
        definition : Definition, optional
            Of the type, where it comes from another bag.

        Raises
        ------
        BagError
            No definition of the type, another type on the same topic, or the bag is closed.
        """
        self._check_open()
        if topic in self._channels:
            self._check_type(topic, msgtype)
            return
        found = definition or self._definitions.require(msgtype)
        profiles = qos if isinstance(qos, list) else [(qos or Qos()).profile()]
        if msgtype not in self._schemas:
            self._schemas[msgtype] = self._writer.add_schema(msgtype, found.encoding, found.text.encode())
        channel = self._writer.add_channel(
            topic,
            self._schemas[msgtype],
            {"offered_qos_profiles": metadata.dump(profiles), "topic_type_hash": found.type_hash},
        )
        self._channels[topic] = (channel, TopicEntry(topic, msgtype, found.type_hash, profiles))
        self._new_topics = True

    def write(self, topic: str, msgtype: str, stamp_ns: int, cdr: bytes | bytearray | memoryview) -> None:
        """Write one serialised message.

        Parameters
        ----------
        topic, msgtype : str
            Name and type of the topic.
        stamp_ns : int
            Log time [ns].
        cdr : bytes
            The message as it came from the wire, with its 4 bytes of encapsulation.

        Raises
        ------
        BagError
            The bag is closed, the stamp is negative, the topic has another type, the type has no
            definition, or the file cannot be written.
        """
        known = self._channels.get(topic)
        if known is None or known[1].msgtype != msgtype:
            self.add_topic(topic, msgtype)
            known = self._channels[topic]
        if self._closed or not 0 <= stamp_ns < _STAMP_LIMIT:
            self._check_open()
            msg = f"{self.path}: topic {topic}: log time {stamp_ns} ns; expected 0 to 2^63 - 1"
            raise BagError(msg)
        channel, entry = known
        try:
            self._writer.add(channel, stamp_ns, cdr)
        except OSError as error:
            raise _unwritable(self.file, error) from error
        self._count(entry, 1, stamp_ns, stamp_ns)

    def write_blocks(self, blocks: Sequence[tuple[str, NDArray[np.int64], NDArray[np.uint8]]]) -> None:
        """Write many messages in the order of their stamps, a tenth of the price of `write`.

        Parameters
        ----------
        blocks : sequence of tuple
            Topic, announced with `add_topic`; log times, ndarray of int64, shape (n,) [ns]; CDR of messages of one
            length, ndarray of uint8, shape (n, size), from a `MessageTemplate`. Of equal stamps the first block's is
            first.

        Raises
        ------
        BagError
            The bag is closed, a stamp is negative, a topic is not announced, or the file cannot be written.
        """
        self._check_open()
        filled = [block for block in blocks if len(block[1])]
        for topic, stamps, rows in filled:
            if topic not in self._channels or len(stamps) != len(rows) or stamps.min() < 0:
                msg = f"{self.path}: topic {topic}: expected an announced topic, and a log time from 0 for each message"
                raise BagError(msg)
        if not filled:
            return
        self._guard(lambda: self._writer.add_blocks([(self._channels[t][0], s, r) for t, s, r in filled]))
        for topic, stamps, _ in filled:
            self._count(self._channels[topic][1], len(stamps), int(stamps.min()), int(stamps.max()))

    def write_message(self, topic: str, msgtype: str, stamp_ns: int, message: Any) -> None:
        """Serialise a message and write it.

        Parameters
        ----------
        topic, msgtype : str
            Name and type of the topic.
        stamp_ns : int
            Log time [ns].
        message : object or mapping
            A `rosbags` message, or a mapping of field names to values; a nested message is a mapping, too,
            and fields that are left out are zero or empty.

        Raises
        ------
        BagError
            As `write`; or a field is unknown or does not fit its type.
        """
        self.write(topic, msgtype, stamp_ns, self.serialize(msgtype, message))

    def serialize(self, msgtype: str, message: Any) -> bytes:
        """Turn a message into CDR (little endian).

        Parameters
        ----------
        msgtype : str
            `PKG/msg/NAME`.
        message : object or mapping
            As `write_message` takes it.

        Returns
        -------
        bytes
            With 4 bytes of encapsulation.

        Raises
        ------
        BagError
            No definition, or a field is unknown or does not fit its type.
        """
        return serialize(self._definitions, msgtype, message)

    def flush(self) -> None:
        """Hand everything written so far to the operating system.

        Raises
        ------
        BagError
            The file cannot be written.
        """
        if self._closed:
            return
        self._guard(self._writer.flush)
        if self._new_topics:
            self._write_metadata()
            self._new_topics = False
        self._next_flush = time.monotonic() + FLUSH_INTERVAL_S

    def close(self) -> None:
        """Finish the bag; a second call does nothing.

        Raises
        ------
        BagError
            The file cannot be written.
        """
        if self._closed:
            return
        try:
            self._guard(self._finish)
            self._write_metadata()
        finally:
            self._closed = True
            self._guard(self._stream.close)

    def __enter__(self) -> BagWriter:
        """Give the writer itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close, also after an error: what was written is a good bag."""
        self.close()

    def _count(self, entry: TopicEntry, count: int, first: int, last: int) -> None:
        entry.count += count
        if first < self._start_ns:
            self._start_ns = first
        if last > self._end_ns:
            self._end_ns = last
        if time.monotonic() >= self._next_flush:
            self.flush()

    def _finish(self) -> None:
        self._writer.finish({"rosbag2": {"serialized_metadata": metadata.dump(self._information())}})

    def _information(self) -> dict[str, Any]:
        start = min(self._start_ns, self._end_ns)
        entries = [entry for _, entry in self._channels.values()]
        return metadata.information(self.file.name, entries, start, self._end_ns)

    def _write_metadata(self) -> None:
        text = metadata.dump({"rosbag2_bagfile_information": self._information()})
        target = self.path / metadata.NAME
        draft = target.with_suffix(".yaml.tmp")
        try:
            draft.write_text(text + "\n", encoding="utf-8")
            os.replace(draft, target)
        except OSError as error:
            raise _unwritable(target, error) from error

    def _make_directory(self, overwrite: bool) -> None:
        if (self.path.exists() or self.path.is_symlink()) and not overwrite:
            msg = f"{self.path}: exists already; give overwrite to replace a bag"
            raise BagError(msg)
        try:
            if self.path.is_dir():
                remove_bag(self.path)
            self.path.mkdir(parents=True)
        except OSError as error:
            raise _unwritable(self.path, error) from error

    def _check_open(self) -> None:
        if self._closed:
            msg = f"{self.path}: written to after it was closed"
            raise BagError(msg)

    def _check_type(self, topic: str, msgtype: str) -> None:
        have = self._channels[topic][1].msgtype
        if have != msgtype:
            msg = f"{self.path}: topic {topic} has type {have}; got a message of type {msgtype}"
            raise BagError(msg)

    def _guard(self, action: Callable[[], object]) -> None:
        try:
            action()
        except OSError as error:
            raise _unwritable(self.file, error) from error


def remove_bag(path: Path) -> None:
    """Delete a bag directory.

    Parameters
    ----------
    path : Path
        The directory.

    Raises
    ------
    BagError
        It holds anything that is not of a bag; nothing is deleted then.
    OSError
        A file cannot be deleted.
    """
    for file in _files(path):
        file.unlink()
    path.rmdir()


def check_replaceable(path: Path) -> None:
    """Refuse to replace what is more than a bag.

    Parameters
    ----------
    path : Path
        A bag directory, or nothing.

    Raises
    ------
    BagError
        It holds anything that is not of a bag, or cannot be read.
    """
    try:
        if path.is_dir():
            _files(path)
    except OSError as error:
        raise _unwritable(path, error) from error


def _files(path: Path) -> list[Path]:
    """Give the files of a bag directory that holds nothing else."""
    files = list(path.iterdir())
    strange = [file.name for file in files if file.is_dir() or not _OF_A_BAG.search(file.name)]
    if strange:
        msg = f"{path}: not replaced, it holds more than a bag ({strange[0]})"
        raise BagError(msg)
    return files


def _utf8_name(path: Path) -> str:
    """Give the name of a folder, as it can stand in the metadata."""
    name = path.resolve().name
    return name.encode("utf-8", "replace").decode("utf-8")


def _unwritable(path: Path, error: OSError) -> BagError:
    return BagError(f"{path}: cannot be written: {error.strerror or error}")
