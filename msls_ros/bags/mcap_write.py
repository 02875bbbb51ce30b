"""Writes an MCAP file; many messages of one layout at the price of one.

The `mcap` package packs every number of every message on its own: 8 microseconds a message. Here the records of a
block of equal messages are the rows of one array.

References
----------
MCAP format specification, version 0, https://mcap.dev/spec
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable, Mapping
from typing import BinaryIO

import numpy as np
import zstandard
from numpy.typing import NDArray

MAGIC = b"\x89MCAP0\r\n"
_CHUNK_BYTES = 1 << 20
_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _MESSAGE_INDEX = range(1, 8)
_CHUNK_INDEX, _STATISTICS, _METADATA, _METADATA_INDEX, _SUMMARY_OFFSET, _DATA_END = 8, 11, 12, 13, 14, 15
_RECORD = struct.Struct("<BQ")
_MESSAGE_HEAD = struct.Struct("<BQHIQQ")
_HEAD_FIELDS = [("opcode", "u1"), ("length", "<u8"), ("channel", "<u2"), ("sequence", "<u4"), ("log", "<u8")]
_MESSAGE_DTYPE = [*_HEAD_FIELDS, ("publish", "<u8")]
_INDEX_ENTRY = struct.Struct("<QQ")
Bytes = NDArray[np.uint8]
Stamps = NDArray[np.int64]


class McapWriter:
    """An MCAP file that is being written, in chunks compressed with zstd.

    Parameters
    ----------
    stream : BinaryIO
        An empty file.
    """

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream
        self._compressor = zstandard.ZstdCompressor(level=1)
        self._schemas: list[bytes] = []
        self._channels: list[bytes] = []
        self._counts: dict[int, int] = {}
        self._chunk_indexes: list[bytes] = []
        self._span: tuple[int, int] | None = None
        self._begin_chunk()
        self._position = 0
        self._write(MAGIC + _record(_HEADER, _text("ros2") + _text("msls_ros")))

    def add_schema(self, name: str, encoding: str, text: bytes) -> int:
        """Write the definition of a message type; return its number."""
        number = len(self._schemas) + 1
        content = struct.pack("<H", number) + _text(name) + _text(encoding) + _sized(text)
        self._schemas.append(_record(_SCHEMA, content))
        self._chunk += self._schemas[-1]
        return number

    def add_channel(self, topic: str, schema: int, metadata: Mapping[str, str]) -> int:
        """Write the description of a topic; return its number."""
        number = len(self._channels) + 1
        content = struct.pack("<HH", number, schema) + _text(topic) + _text("cdr") + _map(metadata)
        self._channels.append(_record(_CHANNEL, content))
        self._chunk += self._channels[-1]
        self._counts[number] = 0
        return number

    def add(self, channel: int, stamp_ns: int, cdr: bytes | bytearray | memoryview) -> None:
        """Write one message.

        Parameters
        ----------
        channel : int
            From `add_channel`.
        stamp_ns : int
            Log time, 0 to 2^63 - 1 [ns].
        cdr : bytes
            With 4 bytes of encapsulation.

        Raises
        ------
        OSError
            The stream cannot be written.
        """
        chunk, count = self._chunk, self._counts[channel]
        self._index.setdefault(channel, bytearray()).extend(_INDEX_ENTRY.pack(stamp_ns, len(chunk)))
        length = _MESSAGE_HEAD.size - _RECORD.size + len(cdr)
        chunk += _MESSAGE_HEAD.pack(_MESSAGE, length, channel, count & 0xFFFFFFFF, stamp_ns, stamp_ns)
        chunk += cdr
        self._count(channel, 1, stamp_ns, stamp_ns)

    def add_block(self, channel: int, stamps_ns: Stamps, rows: Bytes) -> None:
        """Write messages of one length.

        Parameters
        ----------
        channel : int
            From `add_channel`.
        stamps_ns : ndarray of int64, shape (n,)
            Log times, not negative [ns].
        rows : ndarray of uint8, shape (n, size)
            Their CDR.

        Raises
        ------
        OSError
            The stream cannot be written.
        """
        n, size = rows.shape
        if n == 0:
            return
        records = np.empty((n, _MESSAGE_HEAD.size + size), np.uint8)
        head = np.empty(n, _MESSAGE_DTYPE)
        head["opcode"], head["length"], head["channel"] = _MESSAGE, records.shape[1] - _RECORD.size, channel
        head["sequence"] = (self._counts[channel] + np.arange(n)) & 0xFFFFFFFF
        head["log"] = head["publish"] = stamps_ns
        records[:, : _MESSAGE_HEAD.size] = head.view(np.uint8).reshape(n, -1)
        records[:, _MESSAGE_HEAD.size :] = rows
        entries = np.empty((n, 2), "<u8")
        entries[:, 0] = stamps_ns
        entries[:, 1] = len(self._chunk) + records.shape[1] * np.arange(n)
        self._index.setdefault(channel, bytearray()).extend(entries.tobytes())
        self._chunk += records.tobytes()
        self._count(channel, n, int(stamps_ns.min()), int(stamps_ns.max()))

    def flush(self) -> None:
        """Finish the chunk and hand everything to the operating system.

        Raises
        ------
        OSError
            The stream cannot be written.
        """
        self._finish_chunk()
        self._stream.flush()

    def finish(self, metadata: Mapping[str, Mapping[str, str]]) -> None:
        """Write the index; the stream stays open.

        Parameters
        ----------
        metadata : mapping
            Named mappings to store.

        Raises
        ------
        OSError
            The stream cannot be written.
        """
        self._finish_chunk()
        indexes = []
        for name, values in metadata.items():
            record = _record(_METADATA, _text(name) + _map(values))
            indexes.append(_record(_METADATA_INDEX, struct.pack("<QQ", self._position, len(record)) + _text(name)))
            self._write(record)
        self._write(_record(_DATA_END, bytes(4)))
        self._write_summary(indexes)

    def _write_summary(self, metadata_indexes: list[bytes]) -> None:
        start = self._position
        summary = bytearray()
        offsets = bytearray()
        statistics = [_record(_STATISTICS, self._statistics(len(metadata_indexes)))]
        for records in (self._schemas, self._channels, statistics, self._chunk_indexes, metadata_indexes):
            if records:
                group = b"".join(records)
                offsets += _record(
                    _SUMMARY_OFFSET, struct.pack("<BQQ", records[0][0], start + len(summary), len(group))
                )
                summary += group
        offset_start = start + len(summary)
        summary += offsets
        footer = _RECORD.pack(_FOOTER, 20) + struct.pack("<QQ", start, offset_start)
        checksum = zlib.crc32(footer, zlib.crc32(summary))
        self._write(bytes(summary) + footer + struct.pack("<I", checksum) + MAGIC)

    def _statistics(self, metadata: int) -> bytes:
        start, end = self._span or (0, 0)
        total = sum(self._counts.values())
        counts = b"".join(struct.pack("<HQ", channel, count) for channel, count in self._counts.items() if count)
        sizes = (len(self._schemas), len(self._channels), 0, metadata, len(self._chunk_indexes))
        return struct.pack("<QHIIIIQQ", total, *sizes, start, end) + _sized(counts)

    def _begin_chunk(self) -> None:
        self._chunk = bytearray()
        self._index: dict[int, bytearray] = {}
        self._chunk_span: tuple[int, int] | None = None

    def _count(self, channel: int, count: int, first: int, last: int) -> None:
        self._counts[channel] += count
        span = self._chunk_span
        self._chunk_span = (first, last) if span is None else (min(span[0], first), max(span[1], last))
        if len(self._chunk) > _CHUNK_BYTES:
            self._finish_chunk()

    def _finish_chunk(self) -> None:
        """Write the chunk and the index of its messages; nothing where it holds no message."""
        if self._chunk_span is None:
            return
        start, end = self._chunk_span
        self._span = (start, end) if self._span is None else (min(self._span[0], start), max(self._span[1], end))
        content = self._compressor.compress(self._chunk)
        sizes = struct.pack("<QQQI", start, end, len(self._chunk), zlib.crc32(self._chunk))
        chunk = _record(_CHUNK, sizes + _text("zstd") + struct.pack("<Q", len(content)) + content)
        place = self._position
        offsets, position, indexes = b"", place + len(chunk), []
        for channel, entries in self._index.items():
            indexes.append(_record(_MESSAGE_INDEX, struct.pack("<H", channel) + _sized(entries)))
            offsets += struct.pack("<HQ", channel, position)
            position += len(indexes[-1])
        self._chunk_indexes.append(
            _record(
                _CHUNK_INDEX,
                struct.pack("<QQQQ", start, end, place, len(chunk))
                + _sized(offsets)
                + struct.pack("<Q", position - place - len(chunk))
                + _text("zstd")
                + struct.pack("<QQ", len(content), len(self._chunk)),
            )
        )
        self._begin_chunk()
        self._write(b"".join([chunk, *indexes]))

    def _write(self, data: bytes) -> None:
        self._stream.write(data)
        self._position += len(data)


def _record(opcode: int, content: bytes) -> bytes:
    return _RECORD.pack(opcode, len(content)) + content


def _sized(data: bytes | bytearray) -> bytes:
    return struct.pack("<I", len(data)) + data


def _text(value: str) -> bytes:
    return _sized(value.encode())


def _map(values: Mapping[str, str]) -> bytes:
    pairs: Iterable[bytes] = (_text(key) + _text(value) for key, value in values.items())
    return _sized(b"".join(pairs))
