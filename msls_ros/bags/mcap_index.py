"""The index at the end of an MCAP file, and the topics that its records describe."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass, field
from typing import BinaryIO

from msls_ros.bags.definitions import Definition
from msls_ros.bags.storage import Summary, Topic, normalize_type

_MAGIC = b"\x89MCAP0\r\n"
_SCHEMA, _CHANNEL, _CHUNK_INDEX, _STATISTICS = 0x03, 0x04, 0x08, 0x0B
_RECORD = struct.Struct("<BQ")
_FOOTER = struct.Struct("<BQQQI8s")
_STATISTICS_HEAD = struct.Struct("<QHIIIIQQI")
_MAX_SUMMARY = 1 << 28
_MAX_DESCRIPTIONS = 1 << 26
"""Of all schemas and channels [bytes]."""
_ENCODINGS = ("ros2msg", "ros2idl", "omgidl", "ros1msg")


class Registry:
    """Schemas and channels met so far.

    Attributes
    ----------
    topics : dict of int to Topic
        By channel number.
    """

    def __init__(self) -> None:
        self._schemas: dict[int, Definition] = {}
        self.topics: dict[int, Topic] = {}
        self._size = 0

    def take(self, opcode: int, content: bytes) -> None:
        """Take a schema or a channel record; the first one of a number counts.

        Parameters
        ----------
        opcode : int
            Of a schema or a channel.
        content : bytes
            The record after its length.

        Raises
        ------
        ValueError, struct.error
            It is damaged, or one too many.
        """
        self._size += len(content)
        if self._size > _MAX_DESCRIPTIONS:
            msg = "more descriptions of topics and types than any bag has"
            raise ValueError(msg)
        (number,) = struct.unpack_from("<H", content)
        if opcode == _SCHEMA:
            name, position = _string(content, 2)
            encoding, position = _string(content, position)
            text, _ = _string(content, position)
            self._schemas.setdefault(number, Definition(normalize_type(name), encoding, text, ""))
        elif number not in self.topics:
            self.topics[number] = self._topic(content)

    def _topic(self, content: bytes) -> Topic:
        (schema_number,) = struct.unpack_from("<H", content, 2)
        name, position = _string(content, 4)
        serialization, position = _string(content, position)
        (length,) = struct.unpack_from("<I", content, position)
        position += 4
        end = position + length
        extra: dict[str, str] = {}
        while position < end:
            key, position = _string(content, position)
            extra[key], position = _string(content, position)
        schema = self._schemas.get(schema_number)
        if schema is None:
            return Topic(name, "", serialization, None, "")
        definition = Definition(schema.msgtype, schema.encoding, schema.text, extra.get("topic_type_hash", ""))
        known = definition if definition.text.strip() and definition.encoding in _ENCODINGS else None
        return Topic(name, schema.msgtype, serialization, known, extra.get("offered_qos_profiles", ""))


@dataclass
class Index:
    """What stands at the end of an MCAP file.

    Attributes
    ----------
    finished : bool
        There is a footer, and the index before it is whole.
    problem : str
        What is wrong with it; empty: nothing, or the file has no index.
    chunks : list of int
        Where chunks begin, in order [bytes].
    summary : Summary, optional
        Counts and times, where the index has them.
    registry : Registry
        Schemas and channels.
    """

    finished: bool = False
    problem: str = ""
    chunks: list[int] = field(default_factory=list)
    summary: Summary | None = None
    registry: Registry = field(default_factory=Registry)


def read_index(stream: BinaryIO, size: int) -> Index:
    """Read the index of a file that may have none.

    Parameters
    ----------
    stream : BinaryIO
        The file; it is positioned somewhere else afterwards.
    size : int
        Its length [bytes].

    Returns
    -------
    Index
        Not `finished` where the file is cut off or its index damaged.
    """
    stream.seek(max(0, size - _FOOTER.size))
    footer = stream.read(_FOOTER.size)
    if len(footer) < _FOOTER.size or not footer.endswith(_MAGIC) or footer[:9] != _RECORD.pack(0x02, 20):
        return Index()
    _, _, start, _, crc, _ = _FOOTER.unpack(footer)
    if start == 0:
        return Index(finished=True)
    length = size - _FOOTER.size - start
    if not 0 <= length <= min(size, _MAX_SUMMARY):
        return Index(problem="damaged")
    stream.seek(start)
    summary = stream.read(length)
    if crc and zlib.crc32(footer[: 9 + 16], zlib.crc32(summary)) != crc:
        return Index(problem="damaged")
    index = Index(finished=True)
    try:
        _take_all(summary, index)
    except (struct.error, ValueError):
        return Index(problem="damaged")
    index.chunks = sorted(place for place in index.chunks if place < start)
    return index


def _take_all(summary: bytes, index: Index) -> None:
    position, registry = 0, index.registry
    counts: dict[int, int] = {}
    span = None
    while position < len(summary):
        opcode, length = _RECORD.unpack_from(summary, position)
        position += _RECORD.size
        content = summary[position : position + length]
        position += length
        if opcode in (_SCHEMA, _CHANNEL):
            registry.take(opcode, content)
        elif opcode == _CHUNK_INDEX:
            index.chunks.append(struct.unpack_from("<Q", content, 16)[0])
        elif opcode == _STATISTICS:
            *_, first, last, size = _STATISTICS_HEAD.unpack_from(content)
            counts = dict(struct.iter_unpack("<HQ", content[_STATISTICS_HEAD.size : _STATISTICS_HEAD.size + size]))
            span = (first, last)
    if span is not None:
        by_topic: dict[str, int] = {}
        for number, count in counts.items():
            name = registry.topics[number].name if number in registry.topics else ""
            by_topic[name] = by_topic.get(name, 0) + count
        index.summary = Summary(by_topic, *span) if any(counts.values()) else Summary(by_topic, 0, 0)


def _string(content: bytes, position: int) -> tuple[str, int]:
    (length,) = struct.unpack_from("<I", content, position)
    end = position + 4 + length
    if end > len(content):
        msg = "a text is longer than its record"
        raise ValueError(msg)
    return content[position + 4 : end].decode("utf-8", "replace"), end
