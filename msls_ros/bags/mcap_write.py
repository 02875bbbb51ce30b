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
from collections.abc import Iterable, Mapping, Sequence
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
        self._counts[channel] = count + 1
        self._extend(stamp_ns, stamp_ns)

    def add_blocks(self, blocks: Sequence[tuple[int, Stamps, Bytes]]) -> None:
        """Write messages of several topics in the order of their stamps.

        Parameters
        ----------
        blocks : sequence of tuple
            Channel; log times, not negative, ndarray of int64, shape (n,) [ns]; messages of one length,
            ndarray of uint8, shape (n, size).

        Raises
        ------
        OSError
            The stream cannot be written.
        """
        stamps = np.concatenate([stamps for _, stamps, _ in blocks])
        lengths = np.concatenate([np.full(len(rows), _MESSAGE_HEAD.size + rows.shape[1]) for _, _, rows in blocks])
        order = np.argsort(stamps, kind="stable")
        places = np.empty(len(order), np.int64)
        places[order] = len(self._chunk) + np.cumsum(lengths[order]) - lengths[order]
        pieces: list[bytes] = []
        done = 0
        for channel, log, rows in blocks:
            records = self._records(channel, log, rows)
            size = _MESSAGE_HEAD.size + rows.shape[1]
            pieces += [records[i : i + size] for i in range(0, len(records), size)]
            entries = np.stack([log, places[done : done + len(log)]], axis=1).astype("<u8", copy=False)
            done += len(log)
            if len(log):
                self._index.setdefault(channel, bytearray()).extend(entries.tobytes())
                self._counts[channel] += len(log)
        self._chunk += b"".join([pieces[i] for i in order])
        if len(stamps):
            self._extend(int(stamps.min()), int(stamps.max()))

    def _records(self, channel: int, log: Stamps, rows: Bytes) -> bytes:
        """Return the records of messages, one after the other."""
        n, size = rows.shape
        records = np.empty((n, _MESSAGE_HEAD.size + size), np.uint8)
        head = np.empty(n, _MESSAGE_DTYPE)
        head["opcode"], head["length"], head["channel"] = _MESSAGE, records.shape[1] - _RECORD.size, channel
        head["sequence"] = (self._counts[channel] + np.arange(n)) & 0xFFFFFFFF
        head["log"] = head["publish"] = log
        records[:, : _MESSAGE_HEAD.size] = head.view(np.uint8).reshape(n, -1)
        records[:, _MESSAGE_HEAD.size :] = rows
        return records.tobytes()

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

    def _extend(self, first: int, last: int) -> None:
        """Note the log times that the chunk has got, and finish it when it is full."""
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
