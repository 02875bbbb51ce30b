from __future__ import annotations

import shutil
import sqlite3
from pathlib import Path

import pytest
from bags.test_writing import EFFECTOR, STATE, mcap_file, write_flight
from rosbags.interfaces import Connection
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from msls_ros.bags import BagError, BagMessage, BagReader, BagWriter, read, typestore


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> list[BagMessage]:
    return write_flight(tmp_path_factory.mktemp("flight") / "bag", samples=60)


def write_with_rosbags(
    path: Path, messages: list[BagMessage], storage: StoragePlugin, mode: CompressionMode = CompressionMode.NONE
) -> None:
    store = typestore()
    writer = Ros2Writer(path, version=9, storage_plugin=storage)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        topics: dict[str, Connection] = {}
        for topic, msgtype, stamp, data in messages:
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, msgtype, typestore=store)
            writer.write(topics[topic], stamp, data)


@pytest.mark.parametrize(
    ("storage", "mode"),
    [
        (StoragePlugin.MCAP, CompressionMode.NONE),
        (StoragePlugin.MCAP, CompressionMode.STORAGE),
        (StoragePlugin.MCAP, CompressionMode.FILE),
        (StoragePlugin.MCAP, CompressionMode.MESSAGE),
        (StoragePlugin.SQLITE3, CompressionMode.NONE),
        (StoragePlugin.SQLITE3, CompressionMode.FILE),
        (StoragePlugin.SQLITE3, CompressionMode.MESSAGE),
    ],
)
def test_every_kind_of_rosbag2_gives_the_same_messages(
    tmp_path: Path, flight: list[BagMessage], storage: StoragePlugin, mode: CompressionMode
) -> None:
    write_with_rosbags(tmp_path / "bag", flight, storage, mode)
    (file,) = [file for file in (tmp_path / "bag").iterdir() if file.name != "metadata.yaml"]
    for path in (tmp_path / "bag", file):
        bag = read(path)
        assert bag.topics == {"state": STATE, "effectors": EFFECTOR}
        assert list(bag) == flight
        assert (bag.warnings, bag.progress) == ([], 1.0)
        _, state = next(iter(bag.decoded()))
        assert state.x.size == 9


@pytest.mark.parametrize("compression", [None, "BZ2", "LZ4"])
def test_a_ros1_bag_gives_messages_of_ros2(tmp_path: Path, compression: str | None) -> None:
    store = get_typestore(Stores.ROS1_NOETIC)
    odometry = "geometry_msgs/msg/TwistStamped"
    types, header, time = store.types, store.types["std_msgs/msg/Header"], store.types["builtin_interfaces/msg/Time"]
    vector, twist = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Twist"]
    writer = Ros1Writer(tmp_path / "old.bag")
    if compression is not None:
        writer.set_compression(Ros1Writer.CompressionFormat[compression])
    with writer:
        writer.chunk_threshold = 2048
        connection = writer.add_connection("/twist", odometry, typestore=store)
        for k in range(100):
            content = twist(vector(1.0 * k, 2.0, 3.0), vector(4.0, 5.0, 6.0))
            stamped = types[odometry](header(k, time(k, 7), "base_link"), content)
            writer.write(connection, 10**9 * k + 7, bytes(store.serialize_ros1(stamped, odometry)))
    bag = read(tmp_path / "old.bag")
    assert bag.topics == {"/twist": odometry}
    pairs = list(bag.decoded())
    assert bag.warnings == []
    assert [message.stamp_ns for message, _ in pairs] == [10**9 * k + 7 for k in range(100)]
    assert [twist.twist.linear.x for _, twist in pairs] == [1.0 * k for k in range(100)]
    assert (pairs[5][1].header.frame_id, pairs[5][1].header.stamp.sec) == ("base_link", 5)
    jazzy = typestore().deserialize_cdr(pairs[9][0].data, odometry)
    assert jazzy.twist.linear.x == 9.0  # type: ignore[attr-defined]
    with BagWriter(tmp_path / "new") as copy:
        copy.add_topic("/twist", odometry, definition=bag.definition("/twist"))
        for message, _ in pairs:
            copy.write(*message)
    assert [twist.twist.linear.x for _, twist in read(tmp_path / "new").decoded()] == [1.0 * k for k in range(100)]


def test_only_the_topics_asked_for_and_a_sentence_for_one_that_is_not_there(
    tmp_path: Path, flight: list[BagMessage]
) -> None:
    write_flight(tmp_path / "bag", samples=60)
    bag = read(tmp_path / "bag", ["effectors", "wind"])
    assert list(bag) == [message for message in flight if message.topic == "effectors"]
    assert bag.warnings == [f"{tmp_path / 'bag'}: no topic wind; it has effectors, state"]


def test_a_bag_is_read_as_often_as_wanted_and_says_what_it_holds(tmp_path: Path) -> None:
    messages = write_flight(tmp_path / "bag", samples=60)
    bag = read(tmp_path / "bag")
    assert list(bag) == list(bag) == messages
    assert bag.summary is not None
    assert bag.summary.counts == {"state": 60, "effectors": 60}
    assert (bag.summary.start_ns, bag.summary.end_ns) == (messages[0].stamp_ns, messages[-1].stamp_ns)


def test_split_bags_are_read_in_the_order_of_their_numbers(tmp_path: Path, flight: list[BagMessage]) -> None:
    bag = tmp_path / "bag"
    bag.mkdir()
    for part in range(12):
        with BagWriter(tmp_path / "part") as writer:
            for message in flight[10 * part : 10 * part + 10]:
                writer.write(*message)
        shutil.move(mcap_file(tmp_path / "part"), bag / f"bag_{part}.mcap")
        shutil.rmtree(tmp_path / "part")
    reader = read(bag)
    assert list(reader) == flight
    (warning,) = reader.warnings
    assert warning == f"{bag / 'metadata.yaml'}: missing; the storage files of the directory are read without it"


def write_old_database(path: Path, rows: int, msgtype: str, data: bytes) -> None:
    """Write what rosbag2 of ROS 2 Foxy wrote: no definitions, no QoS."""
    with sqlite3.connect(path) as database:
        database.executescript(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT);"
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB);"
        )
        database.execute("INSERT INTO topics VALUES(1, '/secret', ?, 'cdr')", (msgtype,))
        database.executemany("INSERT INTO messages VALUES(NULL, 1, ?, ?)", [(k, data) for k in range(rows)])
    database.close()


def test_a_definition_missing_from_the_bag_is_named_and_can_be_given(tmp_path: Path) -> None:
    definition = "float64 x\nstranger_msgs/Inner[] inner\n"
    msgtype = "stranger_msgs/msg/Outer"
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg("uint8 a", "stranger_msgs/msg/Inner"))
    store.register(get_types_from_msg(definition, msgtype))
    inner = store.types["stranger_msgs/msg/Inner"]
    data = bytes(store.serialize_cdr(store.types[msgtype](2.5, [inner(7)]), msgtype))
    write_old_database(tmp_path / "old.db3", 3, msgtype, data)

    bag = read(tmp_path / "old.db3")
    assert [message.data for message in bag] == [data] * 3, "raw messages need no definition"
    with pytest.raises(BagError, match=rf"old.db3: topic /secret: {msgtype}: no message definition found; .*give"):
        next(bag.decoded())

    messages = tmp_path / "stranger_msgs" / "msg"
    messages.mkdir(parents=True)
    (messages / "Outer.msg").write_text(definition)
    with pytest.raises(BagError, match=r"stranger_msgs/msg/Inner \(used by stranger_msgs/msg/Outer\)"):
        next(BagReader(tmp_path / "old.db3", definition_paths=[tmp_path]).decoded())
    (messages / "Inner.msg").write_text("uint8 a")
    for folder in (tmp_path, tmp_path / "stranger_msgs"):
        _, outer = next(BagReader(tmp_path / "old.db3", definition_paths=[folder]).decoded())
        assert (outer.x, outer.inner[0].a) == (2.5, 7)
    assert msgtype in typestore([tmp_path]).types


def test_a_sourced_workspace_gives_definitions(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "install" / "share" / "stranger_msgs" / "msg"
    folder.mkdir(parents=True)
    (folder / "Wind.msg").write_text("float64 north  # [m/s]\n")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "install"))
    with BagWriter(tmp_path / "bag") as writer:
        writer.write_message("wind", "stranger_msgs/msg/Wind", 1, {"north": 3.0})
    monkeypatch.delenv("AMENT_PREFIX_PATH")
    ((_, wind),) = read(tmp_path / "bag").decoded()
    assert wind.north == 3.0, "the bag explains itself where the workspace is not"


def test_a_message_that_does_not_fit_its_type_is_a_sentence_with_file_and_topic(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as writer:
        writer.write("state", STATE, 1, b"\0\1\0\0nonsense")
    bag = read(tmp_path / "bag")
    (message,) = bag
    with pytest.raises(BagError, match=rf"bag: topic state: {STATE}: 12 bytes that are not a message of this type"):
        bag.decode(message)


def test_what_is_not_a_bag_is_refused_in_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "note.mcap").write_text("not at all")
    (tmp_path / "empty.db3").write_bytes(b"")
    (tmp_path / "folder").mkdir()
    with sqlite3.connect(tmp_path / "accounts.db3") as database:
        database.execute("CREATE TABLE money(amount INTEGER)")
    database.close()
    for name, sentence in {
        "nowhere": "no such file or directory; expected a bag directory",
        "note.mcap": "not a bag; expected an MCAP, sqlite3 or ROS 1 bag file, it starts with b'not at a'",
        "empty.db3": "not a bag; expected .* it is empty",
        "folder": "no bag in this directory; expected metadata.yaml",
        "accounts.db3": "not a readable rosbag2 database",
    }.items():
        with pytest.raises(BagError, match=f"{name}: {sentence}"):
            read(tmp_path / name)
