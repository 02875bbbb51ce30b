"""Bags that are meant to do harm: a few kilobytes each."""

from __future__ import annotations

import bz2
import sqlite3
import struct
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import lz4.frame  # type: ignore[import-untyped]
import zstandard

from msls_ros.bags.mcap_write import MAGIC as MAGIC

T = TypeVar("T")
MIB = 1 << 20
METADATA = "rosbag2_bagfile_information:\n  version: 9\n  relative_file_paths: [bag_0.mcap]\n"


def record(opcode: int, content: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(content)) + content


def text(value: bytes) -> bytes:
    return struct.pack("<I", len(value)) + value


def schema(number: int, name: bytes, definition: bytes, encoding: bytes = b"ros2msg") -> bytes:
    return record(3, struct.pack("<H", number) + text(name) + text(encoding) + text(definition))


def channel(number: int, schema_number: int, topic: bytes, qos: bytes = b"") -> bytes:
    extra = text(b"offered_qos_profiles") + text(qos)
    return record(4, struct.pack("<HH", number, schema_number) + text(topic) + text(b"cdr") + text(extra))


def message(channel_number: int, stamp: int, data: bytes) -> bytes:
    return record(5, struct.pack("<HIQQ", channel_number, 0, stamp, stamp) + data)


def chunk(content: bytes, size: int | None = None, compression: bytes = b"") -> bytes:
    """Make a chunk that declares `size` bytes; the compressed content is given."""
    head = struct.pack("<QQQI", 0, 0, len(content) if size is None else size, 0)
    return record(6, head + text(compression) + struct.pack("<Q", len(content)) + content)


def mcap(*records: bytes) -> bytes:
    end = record(15, bytes(4)) + record(2, bytes(20))
    return MAGIC + record(1, text(b"ros2") + text(b"")) + b"".join(records) + end + MAGIC


def mcap_of_type(msgtype: str, definition: str, encoding: str = "ros2msg", data: bytes = b"\0\1\0\0\0\0\0\0") -> bytes:
    """Make a file with one message of a type that the file describes."""
    described = schema(1, msgtype.encode(), definition.encode(), encoding.encode())
    return mcap(described, channel(1, 1, b"/t"), message(1, 7, data))


def zeros(size: int) -> bytes:
    """Compress zeros with zstd, the size not declared."""
    packer = zstandard.ZstdCompressor(level=3).compressobj()
    return b"".join([*(packer.compress(bytes(MIB)) for _ in range(size // MIB)), packer.flush()])


def ros1_bomb(compression: str, size: int, declared: int) -> bytes:
    """Make a bag with a chunk of zeros that declares another size."""

    def fields(**values: bytes) -> bytes:
        return b"".join(text(name.encode() + b"=" + value) for name, value in values.items())

    pack = bz2.compress if compression == "bz2" else lz4.frame.compress
    data = pack(bytes(size))
    head = text(fields(op=b"\3", index_pos=bytes(8), conn_count=bytes(4), chunk_count=struct.pack("<I", 1))) + text(b"")
    packed = fields(op=b"\5", compression=compression.encode(), size=struct.pack("<I", declared))
    return b"#ROSBAG V2.0\n" + head + text(packed) + text(data)


def database(path: Path, *statements: str) -> Path:
    """Make a rosbag2 database without messages, then change it."""
    with sqlite3.connect(path) as connection:
        connection.executescript(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT);"
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB);"
            "INSERT INTO topics VALUES(1, '/t', 'std_msgs/msg/String', 'cdr');" + ";".join(statements)
        )
    connection.close()
    return path


def peak(action: Callable[[], T]) -> tuple[T, int]:
    """Run something; give what it returns and the most memory that Python held meanwhile [bytes]."""
    tracemalloc.start()
    try:
        return action(), tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
