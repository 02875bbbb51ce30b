"""The recorder writes what comes, refuses and counts what is no message, and never ends because of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml
from geometry_msgs.msg import Twist
from msls_msgs.msg import EffectorCommand, LinearModel, StateSample
from nodes.test_mapped_inputs import FILE, decoded, flight_messages
from sensor_msgs.msg import Imu

from msls_ros.bags import BagMessage, BagReader, read
from msls_ros.commands import replay
from msls_ros.inputs.profiles import MODEL_BESIDE, config_folder, read_inputs, read_profile, read_warm_start
from msls_ros.nodes.identifier import IdentifierNode
from msls_ros.nodes.parameters import NodeError
from msls_ros.nodes.recorder import RecorderNode
from msls_ros.testing import Bench

RAW = {
    "nothing": b"",
    "a byte": b"\0",
    "encapsulation alone": b"\0\1\0\0",
    "half a stamp": b"\0\1\0\0\1\0\0\0",
    "another encapsulation": b"\7\7\0\0" + bytes(100),
}


@pytest.mark.parametrize("what", RAW)
def test_a_raw_message_that_is_too_short_is_refused_and_counted(what: str, bench: Bench, tmp_path: Path) -> None:
    recorder = bench.add(RecorderNode, out=str(tmp_path / "bag"), topics=["state"])
    publisher = bench.probe.create_publisher(StateSample, "state", 10)
    bench.spin_until(lambda: publisher.get_subscription_count() > 0, "the recorder")
    if len(RAW[what]) < 4:  # not even DDS takes it
        recorder._write("state", "/state", "msls_msgs/msg/StateSample", RAW[what])
    else:
        publisher.publish(RAW[what])
    good = StateSample()
    good.header.stamp.sec = 5
    publisher.publish(good)
    bench.spin_until(lambda: recorder.counts["state"] == 1, "the good message")
    assert recorder.refused == {"malformed": 1}
    bench.remove(recorder)
    bag = read(tmp_path / "bag")
    assert [m.stamp_ns for m in bag] == [5_000_000_000] and bag.warnings == []


TOPICS = ("/odom", "/imu/data", "/joint_states")


def stack(folder: Path, changes: dict[str, Any], **inputs: Any) -> Path:
    """Write the shipped map of odometry, IMU and joints with some entries changed."""
    content = yaml.safe_load(Path(FILE).read_text())
    section = content["/**"]["ros__parameters"]
    section |= changes
    for name, value in inputs.items():
        section["inputs"][name] = section["inputs"][name] | value if isinstance(value, dict) else value
    path = folder / "my_stack.yaml"
    path.write_text(yaml.safe_dump(content))
    return path


def made(bench: Bench, kind: type[Any], file: Path, *arguments: str) -> Any:
    given = ["--ros-args", "--params-file", str(file), *arguments]
    return bench.adopt(kind(context=bench.context, cli_args=given))


def models_of(bag: BagReader) -> list[tuple[int, bytes, bytes]]:
    found = [bag.decode(m) for m in bag if m.topic.endswith("/model")]
    return [(m.header.stamp.sec * 10**9 + m.header.stamp.nanosec, m.a.tobytes(), m.b.tobytes()) for m in found]


@pytest.mark.parametrize("remapped", [False, True], ids=["", "remapped"])
def test_a_mapped_flight_is_recorded_and_replays_by_itself_to_the_bits_of_the_flight(
    bench: Bench, tmp_path: Path, capfd: pytest.CaptureFixture[str], remapped: bool
) -> None:
    file = stack(tmp_path, {"queue": 5.0, "sample_rate": 100.0})
    moved = {"/imu/data": "/robot/imu"} if remapped else {}
    rules = [word for old, new in moved.items() for word in ("-r", f"{old}:={new}")]
    recorder = made(bench, RecorderNode, file, "-p", f"out:={tmp_path / 'bag'}", *rules)
    made(bench, IdentifierNode, file, *rules)
    models = bench.listen(LinearModel, "model")
    taken: list[str] = []
    keep = recorder._keep

    def counted(topic: str, *rest: Any) -> None:
        keep(topic, *rest)
        taken.extend([topic] if topic in TOPICS else [])

    recorder._keep = counted
    flight = flight_messages(50)
    for number, (topic, message) in enumerate(flight, 1):
        bench.publish(moved.get(topic, topic), message)
        bench.expect(taken, number, "the message in the bag")
    bench.expect(models, 22)
    bench.spin_until(lambda: recorder.counts["model"] >= len(models), "the models in the bag")
    bench.remove(recorder)
    assert not recorder.refused and "does not exist" not in capfd.readouterr().err
    assert read_profile(tmp_path / "bag/identifier.yaml") == read_profile(file)
    assert replay.main([str(tmp_path / "bag"), "--out", str(tmp_path / "out"), "--anyway"]) == 0
    again = models_of(BagReader(tmp_path / "out" / "bag"))
    assert again == decoded(models) == models_of(BagReader(tmp_path / "bag")) and len(again) == 22


def test_stamps_of_a_mapped_topic_are_those_that_the_identifier_takes(bench: Bench, tmp_path: Path) -> None:
    """Of messages without a header it is their arrival; a header need not be where the stamp is read."""
    topics = {"odometry": "/velocity geometry_msgs/msg/Twist stamp=arrival", "imu": "/imu/data sensor_msgs/msg/Imu"}
    topics["imu"] += " stamp=angular_velocity.x unit=ms"
    file = stack(tmp_path, {}, topics=topics)
    recorder = made(bench, RecorderNode, file, "-p", f"out:={tmp_path / 'bag'}")
    before = bench.probe.get_clock().now().nanoseconds
    bench.publish("/velocity", Twist())
    imu = Imu()
    for stamp in (1500.0, -1.0, float("nan")):
        imu.angular_velocity.x = stamp
        bench.publish("/imu/data", imu)
    bench.spin_until(lambda: recorder.counts.total() == 2 and sum(recorder.refused.values()) == 2, "all")
    after = bench.probe.get_clock().now().nanoseconds
    bench.remove(recorder)
    assert recorder.refused == {"stamp_negative": 1, "not_finite": 1}
    stamps: dict[str, int] = {m.topic: m.stamp_ns for m in read(tmp_path / "bag") if isinstance(m, BagMessage)}
    assert stamps["/imu/data"] == 1_500_000_000 and before <= stamps["/velocity"] <= after


def test_a_bag_of_samples_replays_by_the_parameters_that_the_recorder_was_given(bench: Bench, tmp_path: Path) -> None:
    file = config_folder() / "c172x.yaml"
    bench.remove(made(bench, RecorderNode, file, "-p", f"out:={tmp_path / 'bag'}"))
    kept = tmp_path / "bag/identifier.yaml"
    assert read_profile(kept) == read_profile(file) and read_inputs(kept) is None
    bench.remove(bench.add(RecorderNode, out=str(tmp_path / "unknown")))
    assert not (tmp_path / "unknown/identifier.yaml").exists()


def test_the_saved_model_that_a_flight_begins_with_is_kept_beside_the_bag(bench: Bench, tmp_path: Path) -> None:
    file, model = config_folder() / "c172x.yaml", tmp_path / "model.yaml"
    model.write_text("states: []")
    given = ("-p", f"warm_start:={model}", "-p", f"out:={tmp_path / 'bag'}", "-p", "overwrite:=true")
    for _ in range(2):
        bench.remove(made(bench, RecorderNode, file, *given))
    section = yaml.safe_load((tmp_path / "bag/identifier.yaml").read_text())["/**"]["ros__parameters"]
    assert section["warm_start"] == str(model)
    assert read_warm_start(tmp_path / "bag/identifier.yaml") == tmp_path / "bag" / MODEL_BESIDE
    assert (tmp_path / "bag" / MODEL_BESIDE).read_text() == "states: []"


def test_a_map_that_cannot_be_recorded_leaves_the_bag_that_is_there(bench: Bench, tmp_path: Path) -> None:
    bench.remove(bench.add(RecorderNode, out=str(tmp_path / "bag")))
    file = stack(tmp_path, {}, topics={"imu": "/imu/data px4_msgs/msg/Imu"})
    with pytest.raises(NodeError, match="px4_msgs/msg/Imu is not installed"):
        made(bench, RecorderNode, file, "-p", f"out:={tmp_path / 'bag'}", "-p", "overwrite:=true")
    assert list(read(tmp_path / "bag")) == []


def test_a_command_that_is_mapped_is_recorded_once_and_what_is_latched_is_said_to_be(
    bench: Bench, tmp_path: Path
) -> None:
    command = "/command msls_msgs/msg/EffectorCommand"
    file = stack(
        tmp_path, {}, topics={"joints": command}, effectors=dict.fromkeys(("de", "da", "dr"), "joints delta[0]")
    )
    recorder = made(bench, RecorderNode, file, "-p", f"out:={tmp_path / 'bag'}")
    bench.publish("command", EffectorCommand(effectors=["de"], delta=[0.1]))
    last = LinearModel(samples=1)
    bench.publish("model", last)
    bench.spin_until(lambda: recorder.counts["model"] and recorder.counts["/command"], "what was published")
    bench.remove(recorder)
    bag = BagReader(tmp_path / "bag")
    assert [m.topic for m in bag].count("/command") == 1 and not {"/state", "/effectors"} & set(bag.topics)
    offered = {topic: bag.qos(topic) for topic in ("/model", "/fault", "/dither")}
    kept = [topic for topic, profiles in offered.items() if profiles and profiles[0]["durability"] == "transient_local"]
    assert kept == ["/model", "/fault"]


def test_a_bag_that_is_replaced_does_not_keep_the_parameters_of_the_old_one(bench: Bench, tmp_path: Path) -> None:
    bench.remove(made(bench, RecorderNode, config_folder() / "c172x.yaml", "-p", f"out:={tmp_path / 'bag'}"))
    bench.remove(bench.add(RecorderNode, out=str(tmp_path / "bag"), overwrite=True))
    assert not (tmp_path / "bag/identifier.yaml").exists()


def test_a_recorder_says_where_it_writes_how_many_topics_and_at_the_end_how_many_messages(
    bench: Bench, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    recorder = bench.add(RecorderNode, out=str(tmp_path / "bag"), topics=["state", "model"])
    for _ in range(2):
        bench.publish("model", LinearModel())
    bench.spin_until(lambda: recorder.counts["model"] == 2, "the messages in the bag")
    bench.remove(recorder)
    said = "".join(capfd.readouterr())
    assert f"recording 2 topics to '{tmp_path / 'bag'}'" in said
    assert f"2 messages written to '{tmp_path / 'bag'}'" in said
