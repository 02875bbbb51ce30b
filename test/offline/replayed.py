"""What the tests of replay share: flights as messages, bags in every format, and equality to the last bit."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.interfaces import Connection
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_typestore

from msls_ros.bags import BagMessage, BagWriter, MessageTemplate, read, typestore
from msls_ros.commands import replay as command

BAGS = Path(__file__).resolve().parents[2] / "bags"
FLIGHTS = ("intact_doublet", "tail_fault", "cruise_fault")
STATE, EFFECTORS = "msls_msgs/msg/StateSample", "msls_msgs/msg/EffectorSample"
INPUTS, OUTPUTS = ("/state", "/effectors"), ("/model", "/fault", "/dither")
Decoded = dict[str, list[tuple[int, dict[str, Any]]]]


def plain(message: Any, prefix: str = "") -> dict[str, Any]:
    """Return every field of a decoded message by its path; numbers as bytes, so that NaN equals NaN and -0 not 0."""
    fields: dict[str, Any] = {}
    for name, value in vars(message).items():
        if name == "__msgtype__":
            continue
        if hasattr(value, "__msgtype__"):
            fields |= plain(value, f"{prefix}{name}.")
        elif isinstance(value, np.ndarray):
            fields[prefix + name] = (str(value.dtype), value.tobytes())
        else:
            fields[prefix + name] = np.float64(value).tobytes() if isinstance(value, float) else value
    return fields


def outputs(bag: Path) -> Decoded:
    """Return what the identifier's topics hold, decoded: log time and fields of every message."""
    reader = read(bag)
    found: Decoded = {topic: [] for topic in OUTPUTS}
    for message in reader:
        if message.topic in found:
            found[message.topic].append((message.stamp_ns, plain(reader.decode(message))))
    return found


def assert_same(first: Decoded, second: Decoded) -> None:
    """Every field of every message is the same to the last bit."""
    assert first.keys() == second.keys()
    for topic, messages in first.items():
        assert len(messages) == len(second[topic]), topic
        for number, (one, other) in enumerate(zip(messages, second[topic], strict=True)):
            assert one == other, f"{topic} {number}"


def inputs(bag: Path) -> list[BagMessage]:
    return [message for message in read(bag, INPUTS)]


def write(bag: Path, messages: Iterable[BagMessage]) -> Path:
    """Write a bag as the recorder does."""
    with BagWriter(bag) as writer:
        for message in messages:
            writer.write(*message)
    return bag


def write_ros2(bag: Path, messages: Iterable[BagMessage], storage: StoragePlugin, mode: CompressionMode) -> Path:
    """Write a bag with `rosbags`."""
    store = typestore()
    writer = Ros2Writer(bag, version=9, storage_plugin=storage)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        topics: dict[str, Connection] = {}
        for topic, msgtype, stamp, data in messages:
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, msgtype, typestore=store)
            writer.write(topics[topic], stamp, data)
    return bag


def write_ros1(bag: Path, messages: Iterable[BagMessage]) -> Path:
    """Write a ROS 1 bag of the same types."""
    ros2, store = typestore(), get_typestore(Stores.ROS1_NOETIC)
    store.register({msgtype: ros2.fielddefs[msgtype] for msgtype in (STATE, EFFECTORS)})
    header, time = store.types["std_msgs/msg/Header"], store.types["builtin_interfaces/msg/Time"]
    with Ros1Writer(bag) as writer:
        topics: dict[str, Connection] = {}
        for number, (topic, msgtype, stamp, data) in enumerate(messages):
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, msgtype, typestore=store)
            decoded: Any = ros2.deserialize_cdr(data, msgtype)
            at = decoded.header.stamp
            fields = {k: v for k, v in vars(decoded).items() if k not in ("header", "__msgtype__")}
            old = store.types[msgtype](header=header(number, time(at.sec, at.nanosec), "base_link_frd"), **fields)
            writer.write(topics[topic], stamp, store.serialize_ros1(old, msgtype))
    return bag


def shifted(message: BagMessage, by: int) -> BagMessage:
    stamp = message.stamp_ns + by
    seconds, nanoseconds = divmod(stamp, 1_000_000_000)
    data = bytearray(message.data)
    data[4:12] = seconds.to_bytes(4, "little") + nanoseconds.to_bytes(4, "little")
    return message._replace(stamp_ns=stamp, data=bytes(data))


def renamed(messages: list[BagMessage], **topics: str) -> list[BagMessage]:
    return [message._replace(topic=topics.get(message.topic[1:], message.topic)) for message in messages]


def run(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, list[str]]:
    """Run replay; return its exit code, stdout, and the lines on stderr but those of progress."""
    code = command.main([str(a) for a in arguments])
    out, err = capsys.readouterr()
    return code, out, [line for line in err.splitlines() if not line.startswith("replaying ")]


class Maker:
    """Makes messages of samples."""

    def __init__(self, states: Sequence[str], effectors: Sequence[str]) -> None:
        head = {"header": {"frame_id": "base_link_frd"}}
        zeros = np.zeros(len(states))
        self._state = MessageTemplate(STATE, {**head, "states": list(states), "x": zeros, "xdot": zeros})
        self._effector = MessageTemplate(EFFECTORS, {**head, "effectors": list(effectors), "delta": zeros[:7]})

    def state(self, stamp: int, x: Any, xdot: Any) -> BagMessage:
        return self._message(self._state, "/state", STATE, stamp, x=x, xdot=xdot)

    def effectors(self, stamp: int, delta: Any) -> BagMessage:
        return self._message(self._effector, "/effectors", EFFECTORS, stamp, delta=delta)

    @staticmethod
    def _message(template: MessageTemplate, topic: str, msgtype: str, stamp: int, **fields: Any) -> BagMessage:
        row = template.rows(1)
        row["header.stamp.sec"], row["header.stamp.nanosec"] = divmod(stamp, 1_000_000_000)
        for name, value in fields.items():
            row[name] = value
        return BagMessage(topic, msgtype, stamp, template.cdr(row).tobytes())
