"""Reads an MCAP file from the front to the back, finished or cut off or damaged.

Readers that start at the index at the end of the file cannot open what a killed recorder leaves, and stop
at the first damaged chunk. This one needs no index: every record says how long it is. ::

    opcode (1) | length (8) | content          little endian; a chunk holds records and the CRC of them all

What fails is skipped if its length can be trusted; else the index, if there is one, says where the next
chunk begins. A schema or a channel that fails is skipped alone. Memory: one chunk. Order: as written, which is
by log time up to the jitter of the recorder.

References
----------
MCAP format specification, version 0, https://mcap.dev/spec
"""

from __future__ import annotations

import struct
import zlib
from bisect import bisect_right
from collections.abc import Callable, Iterator
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

import lz4.frame  # type: ignore[import-untyped]
import zstandard

from msls_ros.bags.errors import BagError
from msls_ros.bags.limits import HELD, PIECE, CountedStream, Expansion, TooLargeError, check_held
from msls_ros.bags.mcap_index import Index, read_index
from msls_ros.bags.storage import BagMessage, Summary, Topic

MAGIC = b"\x89MCAP0\r\n"
_CHANNEL, _SCHEMA, _MESSAGE, _CHUNK, _MESSAGE_INDEX, _DATA_END = 0x04, 0x03, 0x05, 0x06, 0x07, 0x0F
_LAST_OPCODE = 0x0F
_RECORD = struct.Struct("<BQ")
_MESSAGE_RECORD = struct.Struct("<BQHIQQ")
_CHUNK_HEAD = struct.Struct("<QQQII")
_PIECE = 1 << 24


class _Damage(Exception):
    """A record, or what is in it, is not as it was written."""

    def __init__(self, what: str, *, cut: bool = False) -> None:
        super().__init__(what)
        self.cut = cut
        """It is whole, but for an end that the file does not hold."""


class McapScanner:
    """Scanner of one MCAP file.

    Parameters
    ----------
    path : Path
        The file, for messages.
    stream : BinaryIO
        Its content from the first byte on, decompressed.
    size : int or None
        Its length; None where `stream` cannot be positioned (a compressed file).
    held : int
        What may be held at a time [bytes].

    Raises
    ------
    BagError
        It is not an MCAP file.
    """

    def __init__(self, path: Path, stream: BinaryIO | CountedStream, size: int | None, held: int = HELD) -> None:
        self._stream = stream
        self._size = size
        self._held = held
        self._expansion = Expansion(size, held) if size is not None else None
        self._index = Index()
        if size is not None and not isinstance(stream, CountedStream):
            self._index = read_index(stream, size)
            stream.seek(0)
        self._chunks = frozenset(self._index.chunks)
        self._registry = self._index.registry
        if self._read(len(MAGIC)) != MAGIC:
            msg = f"{path}: not an MCAP file; expected its magic bytes at the start"
            raise BagError(msg)
        self._position = len(MAGIC)
        self._last_ns: int | None = None
        self._damaged = 0
        self._first_damage = ""
        self._end = ""
        self._complete = self._cut = False
        self._unknown = 0

    @property
    def topics(self) -> list[Topic]:
        """All topics met so far; those of the index from the start."""
        return list(self._registry.topics.values())

    @property
    def summary(self) -> Summary | None:
        """What the index says; None without an index."""
        return self._index.summary

    @property
    def lost(self) -> bool:
        """Whether anything was written, as far as it has been read, that cannot be."""
        return bool(self._damaged or self._unknown or (self._end and not self._cut))

    def progress(self) -> float:
        """Give the share of the file that has been read, 0 to 1; 0 where its length is not known."""
        return self._position / self._size if self._size else 0.0

    def close(self) -> None:
        """Close the file."""
        self._stream.close()

    def batches(self, wanted: Callable[[str], bool], warn: Callable[[str], None]) -> Iterator[list[BagMessage]]:
        """Yield the messages of a chunk at a time; see `Scanner.batches`."""
        while not self._complete:
            start = self._position
            try:
                for batch in self._record(wanted):
                    self._last_ns = batch[-1].stamp_ns
                    yield batch
                follow: int | None = self._position
            except _Damage as damage:
                self._cut = damage.cut
                follow = self._after_damage(start, str(damage))
            if not self._complete and follow is None:
                break
            if follow is not None and follow != self._position:
                self._seek(follow)
                self._position = follow
        self._conclude(self._complete, warn)

    def _after_damage(self, start: int, what: str) -> int | None:
        """Note the damage and give where to go on; None: nowhere."""
        if self._position > start:
            follow: int | None = self._position
        elif self._size is None:
            follow = None
        else:
            place = bisect_right(self._index.chunks, start)
            follow = self._index.chunks[place] if place < len(self._index.chunks) else None
        self._end = what
        if follow is not None or self._index.finished:
            self._note(start, what)
        return follow

    def _note(self, start: int, what: str) -> None:
        self._damaged += 1
        self._first_damage = self._first_damage or f"at byte {start} {what}"

    def _conclude(self, complete: bool, warn: Callable[[str], None]) -> None:
        until = "no message" if self._last_ns is None else f"the last message has log time {self._last_ns / 1e9:.9g} s"
        if self._damaged:
            parts = "one damaged part" if self._damaged == 1 else f"{self._damaged} damaged parts"
            warn(f"{parts} skipped ({self._first_damage}); all the rest was read")
        elif not complete:
            warn(f"not finished, {self._end} at byte {self._position}; read up to there, {until}")
        elif self._size is not None and not self._index.finished:
            warn(f"its index is {self._index.problem or 'missing'}; all messages were read without it")
        if self._unknown:
            warn(f"{self._unknown} messages on a channel that is not described were skipped")

    def _record(self, wanted: Callable[[str], bool]) -> Iterator[list[BagMessage]]:
        """Yield the messages of one record.

        On `_Damage`, `_position` has moved only if the length of the record can be trusted.
        """
        start = self._position
        head = self._read(_RECORD.size)
        self._check_length(head, _RECORD.size)
        opcode, length = _RECORD.unpack(head)
        left = None if self._size is None else self._size - start - _RECORD.size
        if not (0 < opcode <= _LAST_OPCODE or opcode >= 0x80):
            what = f"is no record (opcode {opcode})"
            raise _Damage(what)
        if opcode != _CHUNK and start in self._chunks:
            what = "is no chunk, but the index says so"
            raise _Damage(what)
        if opcode == _CHUNK:
            yield from self._chunk(length, left, wanted)
        elif left is not None and length > left:
            what = "a record is longer than the file"
            raise _Damage(what, cut=True)
        elif opcode in (_SCHEMA, _CHANNEL, _MESSAGE):
            self._check_held("a record", length, start + _RECORD.size + length)
            content = self._read(length)
            self._check_length(content, length)
            self._position = start + _RECORD.size + length
            yield from self._records(head + content, start, wanted)
        else:
            self._skip(opcode, length)
            self._position = start + _RECORD.size + length
        self._complete = bool(opcode == _DATA_END)

    def _check_held(self, what: str, size: int, behind: int) -> None:
        """Refuse what does not fit the budget; where the file can be positioned, go on behind it."""
        try:
            check_held(what, size, self._held)
        except TooLargeError as error:
            if self._size is not None and behind <= self._size:
                self._seek(behind)
                self._position = behind
            raise _Damage(str(error)) from error

    @staticmethod
    def _check_length(content: bytes, length: int) -> None:
        if len(content) < length:
            what = "the file ends"
            raise _Damage(what, cut=True)

    def _chunk(self, length: int, left: int | None, wanted: Callable[[str], bool]) -> Iterator[list[BagMessage]]:
        start = self._position
        head = self._read(_CHUNK_HEAD.size)
        self._check_length(head, _CHUNK_HEAD.size)
        _, _, size, crc, name_length = _CHUNK_HEAD.unpack(head)
        rest = self._read(name_length + 8) if name_length <= 16 else b""
        compressed = int.from_bytes(rest[name_length:], "little")
        if len(rest) != name_length + 8 or length != _CHUNK_HEAD.size + name_length + 8 + compressed:
            what = "the head of a chunk is damaged"
            raise _Damage(what)
        self._check_held("a chunk", compressed + size, start + _RECORD.size + length)
        content = self._read(compressed if left is None else min(compressed, left))
        cut = len(content) < compressed
        if not cut:
            self._position = start + _RECORD.size + length
        data = _decompress(rest[:name_length], content, size, cut)
        self._count(len(data))
        if cut:
            yield from self._salvage(data, start, wanted)
        if crc and zlib.crc32(data) != crc:
            what = "the checksum of a chunk is wrong"
            raise _Damage(what)
        yield from self._records(data, start, wanted)

    def _count(self, size: int) -> None:
        """Count what the file unpacks to."""
        try:
            if self._expansion is not None:
                self._expansion.add(size)
        except TooLargeError as error:
            self._position = self._size or self._position  # the rest would be of the same kind
            self._seek(self._position)
            raise _Damage(str(error)) from error

    def _salvage(self, data: bytes, start: int, wanted: Callable[[str], bool]) -> Iterator[list[BagMessage]]:
        """Take the whole messages of a chunk that the end of the file cuts off."""
        with suppress(_Damage):
            yield from self._records(data, start, wanted)
        what = "the file ends in a chunk"
        raise _Damage(what, cut=True)

    def _records(self, data: bytes, start: int, wanted: Callable[[str], bool]) -> Iterator[list[BagMessage]]:
        """Take schemas, channels and messages, a piece at a time."""
        position = 0
        while position < len(data):
            batch: list[BagMessage] = []
            try:
                position = self._piece(data, position, start, batch, wanted)
            except _Damage:
                if batch:
                    yield batch
                raise
            if batch:
                yield batch

    def _piece(
        self, data: bytes, position: int, start: int, batch: list[BagMessage], wanted: Callable[[str], bool]
    ) -> int:
        """Take the next records into `batch` and give where the others begin; the inner loop of all reading."""
        names = {n: (t.name, t.msgtype) for n, t in self._registry.topics.items() if wanted(t.name)}
        unpack, make, new, append = _MESSAGE_RECORD.unpack_from, BagMessage, tuple.__new__, batch.append
        end, stop = len(data), min(len(data), position + PIECE)
        while position < stop:
            try:
                if data[position] == _MESSAGE:
                    _, length, channel, _, stamp, _ = unpack(data, position)
                    follow = position + 9 + length
                    if length < 22 or follow > end:
                        what = "a message does not fit its chunk"
                        raise _Damage(what)
                    if channel in names:
                        topic, msgtype = names[channel]
                        append(new(make, (topic, msgtype, stamp, data[position + 31 : follow])))
                    elif channel not in self._registry.topics:
                        self._unknown += 1
                else:
                    opcode, length = _RECORD.unpack_from(data, position)
                    follow = position + 9 + length
                    if opcode not in (_SCHEMA, _CHANNEL) or follow > end:
                        what = "a chunk holds what is no record"
                        raise _Damage(what)
                    self._describe(opcode, data[position + 9 : follow], start)
                    names = {n: (t.name, t.msgtype) for n, t in self._registry.topics.items() if wanted(t.name)}
            except struct.error as error:
                what = "a record is damaged"
                raise _Damage(what) from error
            position = follow
        return position

    def _describe(self, opcode: int, content: bytes, start: int) -> None:
        """Take a schema or a channel; one that is damaged is skipped alone."""
        try:
            self._registry.take(opcode, content)
        except (struct.error, ValueError):
            self._note(start, f"a {'schema' if opcode == _SCHEMA else 'channel'} cannot be read")

    def _seek(self, position: int) -> None:
        if not isinstance(self._stream, CountedStream):
            self._stream.seek(position)

    def _read(self, count: int) -> bytes:
        """Read that many bytes, fewer at the end; never reserves more than is there."""
        try:
            if count <= _PIECE:
                return self._stream.read(count)
            pieces: list[bytes] = []
            while count > 0 and (piece := self._stream.read(min(count, _PIECE))):
                pieces.append(piece)
                count -= len(piece)
            return b"".join(pieces)
        except TooLargeError as error:
            raise _Damage(str(error)) from error
        except (zstandard.ZstdError, OSError):
            return b""

    def _skip(self, opcode: int, length: int) -> None:
        if opcode == _MESSAGE_INDEX:
            head = self._read(6)
            if length != 6 + int.from_bytes(head[2:], "little"):
                what = "a message index is damaged"
                raise _Damage(what)
            length -= 6
        if self._size is not None and not isinstance(self._stream, CountedStream):
            self._stream.seek(length, 1)
            return
        while length > 0:
            piece = self._read(min(length, _PIECE))
            self._check_length(piece, 1)
            length -= len(piece)


def _decompress(compression: bytes, content: bytes, size: int, cut: bool) -> bytes:
    """Decompress a chunk; of one that is cut off, what there is."""
    try:
        if compression == b"":
            data = content
        elif compression == b"zstd":
            with zstandard.ZstdDecompressor().stream_reader(BytesIO(content)) as reader:
                data = reader.read(size + 1)
        elif compression == b"lz4":
            data = lz4.frame.LZ4FrameDecompressor().decompress(content, max_length=size + 1)
        else:
            what = f"a chunk has an unknown compression {compression!r}"
            raise _Damage(what)
    except (zstandard.ZstdError, RuntimeError, EOFError, MemoryError) as error:
        what = "a chunk cannot be decompressed"
        raise _Damage(what) from error
    if len(data) != size and not cut:
        what = "a chunk has the wrong size"
        raise _Damage(what)
    return data
