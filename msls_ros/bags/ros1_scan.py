"""Reads a ROS 1 bag (version 2.0) from the front to the back, indexed or not, cut off or not.

::

    header length (4) | name=value ... | data length (4) | data         little endian; a chunk's data are records

References
----------
ROS wiki, "Bags/Format/2.0".
"""

from __future__ import annotations

import bz2
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO

import lz4.frame  # type: ignore[import-untyped]

from msls_ros.bags.definitions import Definition
from msls_ros.bags.errors import BagError
from msls_ros.bags.limits import HELD, Expansion, TooLargeError, check_held
from msls_ros.bags.storage import BagMessage, Summary, Topic, normalize_type

MAGIC = b"#ROSBAG V2.0\n"
_MESSAGE, _CHUNK, _CONNECTION = 2, 5, 7
_IN_A_CHUNK = (bytes([_MESSAGE]), bytes([_CONNECTION]))
_MAX_HEADER = 1 << 20
_PIECE = 1 << 24


class _Damage(Exception):
    """A record is not as it was written."""

    def __init__(self, what: str, *, cut: bool = False) -> None:
        super().__init__(what)
        self.cut = cut
        """It is whole, but for an end that the file does not hold."""


class Ros1Scanner:
    """Scanner of one ROS 1 bag.

    Parameters
    ----------
    path : Path
        The file, for messages.
    stream : BinaryIO
        Its content.
    size : int
        Its length [bytes].
    held : int
        What may be held at a time [bytes].

    Raises
    ------
    BagError
        It is not a ROS 1 bag of version 2.0.
    """

    def __init__(self, path: Path, stream: BinaryIO, size: int, held: int = HELD) -> None:
        self._stream = stream
        self._size = size
        self._held = held
        self._expansion = Expansion(size, held)
        self._cut = False
        self._end = ""
        self._topics: dict[int, Topic] = {}
        if stream.read(len(MAGIC)) != MAGIC:
            msg = f"{path}: not a ROS 1 bag; expected {MAGIC.decode().strip()!r} at the start"
            raise BagError(msg)
        self._position = len(MAGIC)
        self._damaged = 0
        self._first_damage = ""
        self._unknown = 0
        self._last_ns: int | None = None
        self._indexed = self._read_index()

    @property
    def topics(self) -> list[Topic]:
        """All topics met so far; those of the index from the start."""
        return list(self._topics.values())

    @property
    def summary(self) -> Summary | None:
        """None: the index of ROS 1 is not used for counts."""
        return None

    @property
    def lost(self) -> bool:
        """Whether anything was written, as far as it has been read, that cannot be."""
        return bool(self._damaged or self._unknown or (self._end and not self._cut))

    def progress(self) -> float:
        """Give the share of the file that has been read, 0 to 1."""
        return self._position / self._size

    def close(self) -> None:
        """Close the file."""
        self._stream.close()

    def batches(self, wanted: Callable[[str], bool], warn: Callable[[str], None]) -> Iterator[list[BagMessage]]:
        """Yield the messages of a chunk at a time, in ROS 1 serialisation; see `Scanner.batches`."""
        self._stream.seek(self._position)
        while self._position < self._size and not self._end:
            batch: list[BagMessage] = []
            try:
                self._record(batch, wanted)
            except _Damage as damage:
                self._end, self._cut = str(damage), damage.cut
            if batch:
                self._last_ns = batch[-1].stamp_ns
                yield batch
        end = self._end
        until = "no message" if self._last_ns is None else f"the last message has log time {self._last_ns / 1e9:.9g} s"
        if end:
            warn(f"{end} at byte {self._position}; read up to there, {until}")
        elif not self._indexed:
            warn(f"not finished, it has no index; all messages were read without it, {until}")
        if self._damaged:
            parts = "one damaged chunk" if self._damaged == 1 else f"{self._damaged} damaged chunks"
            warn(f"of {parts} the rest was skipped ({self._first_damage})")
        if self._unknown:
            warn(f"{self._unknown} messages on a connection that is not described were skipped")

    def _record(self, batch: list[BagMessage], wanted: Callable[[str], bool]) -> None:
        """Read one record; `_position` moves behind it."""
        fields, length = self._head()
        left = self._size - self._stream.tell()
        whole = length <= left
        opcode = fields.get(b"op", b"")
        if opcode in (*_IN_A_CHUNK, bytes([_CHUNK])):
            self._check_held("a record", min(length, left))
            data = self._read(min(length, left))
            if opcode[0] == _CHUNK:
                self._chunk(fields, data, whole, batch, wanted)
            elif whole:
                self._take(opcode[0], fields, data, batch, wanted)
        elif len(opcode) != 1 or not 2 <= opcode[0] <= 7:
            what = "what should be a record is none"
            raise _Damage(what)
        elif whole:
            self._stream.seek(length, 1)
        if not whole:
            what = "the file ends in a record"
            raise _Damage(what, cut=True)
        self._position = self._stream.tell()

    def _check_held(self, what: str, size: int) -> None:
        try:
            check_held(what, size, self._held)
        except TooLargeError as error:
            raise _Damage(str(error)) from error

    def _chunk(
        self,
        fields: dict[bytes, bytes],
        content: bytes,
        whole: bool,
        batch: list[BagMessage],
        wanted: Callable[[str], bool],
    ) -> None:
        """Take the records of a chunk; of a damaged one those before the damage."""
        try:
            size = int.from_bytes(fields.get(b"size", b"")[:4], "little")
            check_held("a chunk", len(content) + size, self._held)
            data = _decompress(fields.get(b"compression", b""), content, size)
            self._expansion.add(len(data))
            position = 0
            while position < len(data):
                inner, start = _fields(data, position)
                (length,) = struct.unpack_from("<I", data, start)
                position = start + 4 + length
                if position > len(data) or inner.get(b"op") not in _IN_A_CHUNK:
                    what = "a record does not fit its chunk"
                    raise _Damage(what)
                self._take(inner[b"op"][0], inner, data[start + 4 : position], batch, wanted)
        except (_Damage, TooLargeError, struct.error, ValueError) as error:
            if whole:
                self._damaged += 1
                self._first_damage = self._first_damage or f"in the chunk at byte {self._position}: {error}"

    def _take(
        self,
        opcode: int,
        fields: dict[bytes, bytes],
        data: bytes,
        batch: list[BagMessage],
        wanted: Callable[[str], bool],
    ) -> None:
        try:
            if opcode == _MESSAGE:
                topic = self._topics.get(struct.unpack("<I", fields[b"conn"])[0])
                seconds, nanoseconds = struct.unpack("<II", fields[b"time"])
                if topic is None:
                    self._unknown += 1
                elif wanted(topic.name):
                    batch.append(BagMessage(topic.name, topic.msgtype, seconds * 1_000_000_000 + nanoseconds, data))
            elif opcode == _CONNECTION:
                number = struct.unpack("<I", fields[b"conn"])[0]
                if number not in self._topics:
                    self._topics[number] = _topic(fields, data)
        except (KeyError, struct.error, ValueError) as error:
            what = f"a record is damaged ({error})"
            raise _Damage(what) from error

    def _read_index(self) -> bool:
        """Take the connections from the end of the file; false: there is no (whole) index."""
        try:
            fields, _ = self._head()
            start = struct.unpack("<Q", fields[b"index_pos"])[0]
            count = struct.unpack("<I", fields[b"conn_count"])[0]
            if not len(MAGIC) < start <= self._size:
                return False
            self._stream.seek(start)
            for _ in range(count):
                fields, length = self._head()
                if fields[b"op"] != bytes([_CONNECTION]):
                    return False
                self._take(_CONNECTION, fields, self._read(min(length, self._size)), [], lambda _: False)
        except (_Damage, KeyError, IndexError, struct.error):
            return False
        return True

    def _head(self) -> tuple[dict[bytes, bytes], int]:
        """Read the header of a record and the length of its data."""
        prefix = self._stream.read(4)
        length = int.from_bytes(prefix, "little")
        if length > _MAX_HEADER:
            what = "what should be a record is none"
            raise _Damage(what)
        content = self._stream.read(length + 4)
        if len(prefix) < 4 or len(content) < length + 4:
            what = "the file ends in a record"
            raise _Damage(what, cut=True)
        fields, start = _fields(prefix + content, 0)
        return fields, int.from_bytes(content[start - 4 :], "little")

    def _read(self, count: int) -> bytes:
        pieces = []
        while count > 0 and (piece := self._stream.read(min(count, _PIECE))):
            pieces.append(piece)
            count -= len(piece)
        return b"".join(pieces)


def _fields(data: bytes, position: int) -> tuple[dict[bytes, bytes], int]:
    """Split the `name=value` fields of a header; give them and where it ends."""
    (length,) = struct.unpack_from("<I", data, position)
    position += 4
    end = position + length
    fields: dict[bytes, bytes] = {}
    while position < end:
        (size,) = struct.unpack_from("<I", data, position)
        name, equals, value = data[position + 4 : position + 4 + size].partition(b"=")
        position += 4 + size
        if not equals or position > end:
            what = "the header of a record is damaged"
            raise _Damage(what)
        fields[name] = value
    return fields, end


def _topic(fields: dict[bytes, bytes], data: bytes) -> Topic:
    """Describe a connection; its data are fields like those of a header."""
    described, _ = _fields(struct.pack("<I", len(data)) + data, 0)
    parts = fields[b"topic"].decode("utf-8", "replace").split("/")
    name = ("/" if parts[0] == "" else "") + "/".join(part for part in parts if part)
    msgtype = normalize_type(described[b"type"].decode("utf-8", "replace"))
    definition = Definition(msgtype, "ros1msg", described[b"message_definition"].decode("utf-8", "replace"), "")
    return Topic(name, msgtype, "ros1", definition, "")


def _decompress(compression: bytes, content: bytes, size: int) -> bytes:
    """Decompress a chunk, as far as it goes, but no further than the size it declares."""
    try:
        if compression == b"none":
            return content
        if compression in (b"bz2", b"lz4"):
            unpacker = bz2.BZ2Decompressor() if compression == b"bz2" else lz4.frame.LZ4FrameDecompressor()
            data = bytes(unpacker.decompress(content, max_length=size + 1))
            if len(data) > size:
                what = f"it unpacks to more than the {size} bytes it declares"
                raise _Damage(what)
            return data
    except (OSError, RuntimeError, EOFError, ValueError, MemoryError) as error:
        what = f"it cannot be decompressed ({error})"
        raise _Damage(what) from error
    what = f"unknown compression {compression!r}"
    raise _Damage(what)
