from __future__ import annotations

import shutil
import struct
from pathlib import Path

import numpy as np
import pytest
from bags.test_writing import mcap_file, write_flight
from mcap.reader import make_reader
from mcap.records import ChunkIndex
from rosbags.highlevel import AnyReader
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_typestore

from msls_ros.bags import BagError, BagMessage, BagWriter, Qos, read, repair, typestore

CHUNK = 40
CUTS, FLIPS = 20, 50


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[BagMessage], list[ChunkIndex]]:
    """Give a bag with a chunk every 40 messages, its messages and its chunks."""
    path = tmp_path_factory.mktemp("damage") / "bag"
    messages = write_flight(path, samples=300, chunk=CHUNK // 2)
    with mcap_file(path).open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    return path, messages, summary.chunk_indexes


def damaged_copy(path: Path, to: Path, blob: bytes) -> Path:
    shutil.rmtree(to, ignore_errors=True)
    shutil.copytree(path, to)
    mcap_file(to).write_bytes(blob)
    return to


def flip(blob: bytes, place: int, bits: int) -> bytes:
    return blob[:place] + bytes([blob[place] ^ bits]) + blob[place + 1 :]


def test_a_bag_cut_anywhere_gives_all_before_the_cut_and_one_sentence(
    tmp_path: Path, bag: tuple[Path, list[BagMessage], list[ChunkIndex]]
) -> None:
    path, messages, chunks = bag
    blob = mcap_file(path).read_bytes()
    rng = np.random.default_rng(4)
    for cut in [*map(int, rng.integers(8, len(blob), CUTS)), len(blob) - 1, chunks[3].chunk_start_offset]:
        reader = read(damaged_copy(path, tmp_path / "cut", blob[:cut]))
        found = list(reader)
        whole = sum(chunk.chunk_start_offset + chunk.chunk_length <= cut for chunk in chunks)
        assert len(found) >= whole * CHUNK
        assert found == messages[: len(found)]
        assert len(reader.warnings) == 1, f"cut at {cut}"


def test_a_cut_chunk_gives_its_messages_before_the_cut(
    tmp_path: Path, bag: tuple[Path, list[BagMessage], list[ChunkIndex]]
) -> None:
    _, messages, _ = bag
    rosbags = tmp_path / "plain"
    with Ros2Writer(rosbags, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("state", messages[0].msgtype, typestore=typestore())
        states = [message for message in messages if message.topic == "state"]
        for message in states:
            writer.write(connection, message.stamp_ns, message.data)
    blob = mcap_file(rosbags).read_bytes()
    reader = read(damaged_copy(rosbags, tmp_path / "cut", blob[: len(blob) // 2]))
    found = list(reader)
    assert 0.4 * len(states) < len(found) < 0.6 * len(states), "one chunk holds them all"
    assert found == states[: len(found)]


def test_a_flipped_byte_anywhere_costs_at_most_its_chunk(
    tmp_path: Path, bag: tuple[Path, list[BagMessage], list[ChunkIndex]]
) -> None:
    path, messages, chunks = bag
    blob = mcap_file(path).read_bytes()
    rng = np.random.default_rng(5)
    heads = [chunk.chunk_start_offset + int(rng.integers(0, 60)) for chunk in chunks]
    lost = 0
    for place in [*map(int, rng.integers(8, len(blob), FLIPS)), *heads]:
        reader = read(damaged_copy(path, tmp_path / "flip", flip(blob, place, int(rng.integers(1, 256)))))
        found = list(reader)
        hit = next(
            (
                number
                for number, chunk in enumerate(chunks)
                if 0 <= place - chunk.chunk_start_offset < chunk.chunk_length
            ),
            None,
        )
        if found != messages:
            assert hit is not None, f"byte {place} is in no chunk"
            assert found == messages[: hit * CHUNK] + messages[(hit + 1) * CHUNK :]
            assert len(reader.warnings) == 1 and "damaged" in reader.warnings[0]
            lost += 1
    assert lost > FLIPS // 2


def test_many_damaged_chunks_are_one_sentence_and_repair_keeps_the_rest(
    tmp_path: Path, bag: tuple[Path, list[BagMessage], list[ChunkIndex]]
) -> None:
    path, messages, chunks = bag
    blob = mcap_file(path).read_bytes()
    for number in (2, 5, 6):
        blob = flip(blob, chunks[number].chunk_start_offset + 200, 0x10)
    target = damaged_copy(path, tmp_path / "flip", blob)
    kept = [message for k, message in enumerate(messages) if k // CHUNK not in (2, 5, 6)]
    reader = read(target)
    assert list(reader) == kept
    assert len(reader.warnings) == 1 and "3 damaged parts skipped" in reader.warnings[0]
    assert repair(target).messages == len(kept)
    again = read(target)
    assert (list(again), again.warnings) == (kept, [])


def test_repair_of_a_single_file_replaces_that_file_alone(
    tmp_path: Path, bag: tuple[Path, list[BagMessage], list[ChunkIndex]]
) -> None:
    path, messages, _ = bag
    file = tmp_path / "flight.mcap"
    blob = mcap_file(path).read_bytes()
    file.write_bytes(blob[: len(blob) // 2])
    result = repair(file)
    assert result.changed and CHUNK < result.messages < len(messages)
    again = read(file)
    assert (list(again), again.warnings) == (messages[: result.messages], [])
    assert sorted(found.name for found in tmp_path.iterdir()) == ["flight.mcap", "flight.mcap.original"]
    assert (tmp_path / "flight.mcap.original").read_bytes() == blob[: len(blob) // 2]


def test_damaged_metadata_is_a_warning(tmp_path: Path, bag: tuple[Path, list[BagMessage], list[ChunkIndex]]) -> None:
    path, messages, _ = bag
    text = (path / "metadata.yaml").read_bytes()
    rng = np.random.default_rng(6)
    contents = [text[:cut] for cut in rng.integers(0, len(text), CUTS)]
    contents += [flip(text, int(place), int(rng.integers(1, 256))) for place in rng.integers(0, len(text), FLIPS)]
    target = damaged_copy(path, tmp_path / "bag", mcap_file(path).read_bytes())
    for content in contents:
        (target / "metadata.yaml").write_bytes(content)
        assert list(read(target)) == messages


def test_a_damaged_database_gives_what_is_readable(
    tmp_path: Path, bag: tuple[Path, list[BagMessage], list[ChunkIndex]]
) -> None:
    _, messages, _ = bag
    with Ros2Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        store = typestore()
        topics = {m.topic: writer.add_connection(m.topic, m.msgtype, typestore=store) for m in messages[:2]}
        for message in messages:
            writer.write(topics[message.topic], message.stamp_ns, message.data)
    (file,) = (tmp_path / "bag").glob("*.db3")
    blob = file.read_bytes()
    rng = np.random.default_rng(7)
    most = 0
    for cut in rng.integers(0, len(blob), CUTS):
        file.write_bytes(blob[:cut])
        try:
            reader = read(file)
        except BagError:
            continue
        found = list(reader)
        assert found == messages[: len(found)]
        assert len(reader.warnings) == 1
        most = max(most, len(found))
    assert most > 0
    for place in rng.integers(0, len(blob), FLIPS):
        file.write_bytes(flip(blob, int(place), int(rng.integers(1, 256))))
        try:
            reader = read(file)
        except BagError:
            continue
        found = list(reader)
        assert len(found) <= len(messages)
        assert len(found) == len(messages) or reader.warnings


def write_ros1(path: Path, count: int) -> tuple[bytes, list[bytes]]:
    """Write a ROS 1 bag of small chunks; give its bytes and the strings in it."""
    store = get_typestore(Stores.ROS1_NOETIC)
    text = store.types["std_msgs/msg/String"]
    words = [f"message {k:06d}" for k in range(count)]
    with Ros1Writer(path) as writer:
        writer.chunk_threshold = 2000
        connection = writer.add_connection("/words", "std_msgs/msg/String", typestore=store)
        for k, word in enumerate(words):
            data = bytes(store.serialize_ros1(text(word), "std_msgs/msg/String"))
            writer.write(connection, k + 1, data)
    return path.read_bytes(), [word.encode() for word in words]


def test_a_damaged_ros1_bag_gives_what_is_readable(tmp_path: Path) -> None:
    file = tmp_path / "old.bag"
    blob, words = write_ros1(file, 400)
    ends = [blob.index(word) + len(word) for word in words]
    cdr = [struct.pack("<4xI", len(word) + 1).replace(b"\0\0\0\0", b"\0\1\0\0", 1) + word + b"\0" for word in words]
    assert [message.data for message in read(file)] == cdr
    rng = np.random.default_rng(8)
    for cut in map(int, rng.integers(13, len(blob), CUTS)):
        file.write_bytes(blob[:cut])
        reader = read(file)
        found = [message.data for message in reader]
        assert found == cdr[: sum(end <= cut for end in ends)]
        assert len(reader.warnings) == 1
    for place in map(int, rng.integers(13, len(blob), FLIPS)):
        file.write_bytes(flip(blob, place, int(rng.integers(1, 256))))
        found = [message.data for message in read(file)]
        before = sum(end <= place for end in ends)
        # The head of the record of the first message that is hit stands up to 60 bytes before its text.
        assert found[: max(0, before - 2)] == cdr[: max(0, before - 2)]


def test_repair_keeps_the_quality_of_service_and_silent_topics(tmp_path: Path) -> None:
    path = tmp_path / "bag"
    with BagWriter(path) as writer:
        writer.add_topic("fault", "msls_msgs/msg/FaultEvent", qos=Qos(depth=3, reliable=False, transient_local=True))
        writer.write_message("state", "msls_msgs/msg/StateSample", 1, {})
        writer.flush()
        size = writer.file.stat().st_size
    mcap_file(path).write_bytes(mcap_file(path).read_bytes()[:size])
    assert repair(path).messages == 1
    with AnyReader([path]) as reader:
        (fault,) = [connection for connection in reader.connections if connection.topic == "fault"]
        (qos,) = fault.ext.offered_qos_profiles  # type: ignore[union-attr]
    assert (qos.depth, qos.reliability.name, qos.durability.name) == (3, "BEST_EFFORT", "TRANSIENT_LOCAL")
