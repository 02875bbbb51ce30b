from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from msls_ros.bags import BagError, BagMessage, BagWriter, Qos, read, repair

STATE, EFFECTOR = "msls_msgs/msg/StateSample", "msls_msgs/msg/EffectorSample"
STATES = ["u", "v", "w", "P", "Q", "R", "Phi", "Theta", "Psi"]
EFFECTORS = ["de", "dr", "ddt", "ddf", "dsf", "dte", "dtr"]
SPECIAL = [np.nan, np.inf, -np.inf, -0.0, 5e-324, np.nextafter(1.0, 2.0), -1.7976931348623157e308, 0.1, 1.0]


def header(stamp_ns: int) -> dict[str, Any]:
    seconds, nanoseconds = divmod(stamp_ns, 1_000_000_000)
    return {"stamp": {"sec": seconds, "nanosec": nanoseconds}, "frame_id": "base_link_frd"}


def write_flight(path: Path, samples: int = 200, chunk: int = 20, seed: int = 0) -> list[BagMessage]:
    """Write a bag of two topics with a chunk every so many samples; give its messages."""
    rng = np.random.default_rng(seed)
    messages = []
    with BagWriter(path) as writer:
        for k in range(samples):
            t = 1_000_000_000 + 20_000_000 * k
            x, xdot, delta = rng.normal(size=9), rng.normal(size=9), rng.normal(size=7)
            state = {"header": header(t), "states": STATES, "x": x, "xdot": xdot}
            effector = {"header": header(t), "effectors": EFFECTORS, "delta": delta}
            for topic, msgtype, content in (("state", STATE, state), ("effectors", EFFECTOR, effector)):
                messages.append(BagMessage(topic, msgtype, t, writer.serialize(msgtype, content)))
                writer.write(*messages[-1])
            if k % chunk == chunk - 1:
                writer.flush()
    return messages


def mcap_file(path: Path) -> Path:
    (file,) = path.glob("*.mcap")
    return file


def test_every_double_comes_back_to_the_last_bit(tmp_path: Path) -> None:
    x, xdot = np.array(SPECIAL), np.array(SPECIAL[::-1])
    with BagWriter(tmp_path / "bag") as writer:
        writer.write_message("state", STATE, 7, {"header": header(7), "states": STATES, "x": x, "xdot": xdot})
    bag = read(tmp_path / "bag")
    ((message, state),) = bag.decoded()
    assert bag.warnings == []
    assert (message.topic, message.msgtype, message.stamp_ns) == ("state", STATE, 7)
    assert state.x.tobytes() == x.tobytes()
    assert state.xdot.tobytes() == xdot.tobytes()
    assert (state.states, state.header.frame_id, state.header.stamp.nanosec) == (STATES, "base_link_frd", 7)


def test_rosbags_reads_the_same_messages(tmp_path: Path) -> None:
    messages = write_flight(tmp_path / "bag")
    with AnyReader([tmp_path / "bag"]) as reader:
        seen = [BagMessage(c.topic, c.msgtype, t, bytes(raw)) for c, t, raw in reader.messages()]
        assert reader.topics["state"].msgcount == 200
        (qos,) = reader.topics["state"].connections[0].ext.offered_qos_profiles  # type: ignore[union-attr]
        assert (qos.depth, qos.reliability.name, qos.durability.name) == (10, "RELIABLE", "VOLATILE")
        assert reader.topics["state"].connections[0].digest.startswith("RIHS01_")
    assert seen == messages == list(read(tmp_path / "bag"))


def test_mcap_reads_the_same_messages_and_all_checksums_hold(tmp_path: Path) -> None:
    messages = write_flight(tmp_path / "bag")
    with mcap_file(tmp_path / "bag").open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        found = list(reader.iter_messages(log_time_order=False))
        assert reader.get_header().profile == "ros2"
    assert [(c.topic, s.name, m.log_time, m.data) for s, c, m in found if s] == [tuple(m) for m in messages]
    schema, channel, _ = found[0]
    assert schema is not None
    assert (schema.encoding, channel.message_encoding) == ("ros2msg", "cdr")
    assert b"MSG: std_msgs/Header" in schema.data and b"MSG: builtin_interfaces/Time" in schema.data
    assert b"[m/s, rad/s, rad]" in schema.data, "units travel with the bag"


def test_quality_of_service_is_stored(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as writer:
        writer.add_topic("fault", "msls_msgs/msg/FaultEvent", qos=Qos(depth=3, reliable=False, transient_local=True))
        writer.write_message("fault", "msls_msgs/msg/FaultEvent", 1, {"equations": ["P"], "statistic": [2.0]})
    with AnyReader([tmp_path / "bag"]) as reader:
        (qos,) = reader.connections[0].ext.offered_qos_profiles  # type: ignore[union-attr]
    assert (qos.depth, qos.reliability.name, qos.durability.name) == (3, "BEST_EFFORT", "TRANSIENT_LOCAL")


def test_an_empty_bag_is_a_whole_bag(tmp_path: Path) -> None:
    BagWriter(tmp_path / "bag").close()
    bag = read(tmp_path / "bag")
    assert (list(bag), bag.warnings, bag.topics) == ([], [], {})


def test_closing_twice_is_closing_once_and_writing_after_it_is_refused(tmp_path: Path) -> None:
    writer = BagWriter(tmp_path / "bag")
    writer.write_message("state", STATE, 1, {})
    writer.close()
    before = mcap_file(tmp_path / "bag").read_bytes()
    writer.close()
    assert mcap_file(tmp_path / "bag").read_bytes() == before
    with pytest.raises(BagError, match="after it was closed"):
        writer.write("state", STATE, 2, b"\0\1\0\0")


def test_an_error_in_the_recorder_leaves_a_finished_bag(tmp_path: Path) -> None:
    with pytest.raises(KeyError), BagWriter(tmp_path / "bag") as writer:
        writer.write_message("state", STATE, 1, {})
        raise KeyError
    bag = read(tmp_path / "bag")
    assert (len(list(bag)), bag.warnings) == (1, [])


def test_a_bag_is_replaced_only_when_asked_and_only_a_bag(tmp_path: Path) -> None:
    write_flight(tmp_path / "bag", samples=3)
    with pytest.raises(BagError, match=r"bag: exists already"):
        BagWriter(tmp_path / "bag")
    assert len(list(read(tmp_path / "bag"))) == 6
    with BagWriter(tmp_path / "bag", overwrite=True) as writer:
        writer.write_message("state", STATE, 1, {})
    assert len(list(read(tmp_path / "bag"))) == 1
    (tmp_path / "bag" / "thesis.tex").write_text("ten years")
    with pytest.raises(BagError, match=r"more than a bag \(thesis\.tex\)"):
        BagWriter(tmp_path / "bag", overwrite=True)
    assert len(list(read(tmp_path / "bag"))) == 1


@pytest.mark.parametrize(
    ("msgtype", "message", "sentence"),
    [
        (STATE, {"y": 1}, "no field 'y'; expected header, states, x, xdot"),
        (STATE, {"x": "fast"}, "does not fit its type"),
        (STATE, {"states": [1, 2]}, "does not fit its type"),
        (STATE, {"header": {"stamp": {"sec": 2**40}}}, "does not fit its type"),
        ("state", {}, "expected PACKAGE/msg/NAME"),
        ("stranger_msgs/msg/Secret", {}, r"stranger_msgs/msg/Secret: no message definition .* folder that holds"),
    ],
)
def test_a_message_that_does_not_fit_is_refused_in_a_sentence(
    tmp_path: Path, msgtype: str, message: dict[str, Any], sentence: str
) -> None:
    with BagWriter(tmp_path / "bag") as writer, pytest.raises(BagError, match=sentence):
        writer.write_message("state", msgtype, 1, message)


def test_a_topic_keeps_its_type_and_log_times_are_not_negative(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as writer:
        writer.write_message("state", STATE, 1, {})
        with pytest.raises(BagError, match=rf"topic state has type {STATE}; got a message of type {EFFECTOR}"):
            writer.write_message("state", EFFECTOR, 2, {})
        with pytest.raises(BagError, match="topic state: log time -1 ns"):
            writer.write_message("state", STATE, -1, {})
    assert [message.stamp_ns for message in read(tmp_path / "bag")] == [1]


def test_a_folder_that_cannot_be_written_is_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(BagError, match="cannot be written"):
        BagWriter(tmp_path / "file" / "bag")


_RECORDER = """
import sys, time
from msls_ros.bags import BagWriter
writer = BagWriter(sys.argv[1])
data = writer.serialize("msls_msgs/msg/StateSample", {"x": range(9)})
count, start = 0, time.monotonic_ns()
while True:
    while (stamp := time.monotonic_ns() - start) < count * 500_000:
        pass
    writer.write("state", "msls_msgs/msg/StateSample", stamp, data)
    count += 1
    if count % 100 == 0:
        print(count, stamp, flush=True)
"""


def test_a_killed_recorder_loses_at_most_the_last_second_and_repair_finishes_the_bag(tmp_path: Path) -> None:
    path = tmp_path / "bag"
    with subprocess.Popen([sys.executable, "-c", _RECORDER, path], stdout=subprocess.PIPE, text=True) as recorder:
        assert recorder.stdout is not None
        written = stamp = 0
        while stamp < 1_300_000_000:
            written, stamp = map(int, recorder.stdout.readline().split())
        os.kill(recorder.pid, signal.SIGKILL)
        recorder.wait()
    bag = read(path)
    messages = list(bag)
    assert messages[-1].stamp_ns >= stamp - 1_000_000_000
    assert len(messages) > written // 10
    assert len(bag.warnings) == 1 and "not finished, the file ends" in bag.warnings[0]
    assert f"log time {messages[-1].stamp_ns / 1e9:.9g} s" in bag.warnings[0]

    result = repair(path)
    assert result.changed and result.messages == len(messages)
    again = read(path)
    assert (list(again), again.warnings) == (messages, [])
    with AnyReader([path]) as reader:
        assert reader.message_count == len(messages)
    assert not repair(path).changed
    assert sorted(file.name for file in tmp_path.iterdir()) == ["bag"]
