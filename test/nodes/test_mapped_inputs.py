"""The identifier node takes other stacks' messages by the same profile and to the same bits as from a bag."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from inputs import mapped_messages as made
from inputs.mapped_messages import rigid_flight
from msls_msgs.msg import DitherCommand, LinearModel
from nav_msgs.msg import Odometry
from nodes.made_up import Clockwork
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import Imu, JointState

from msls_ros.estimation import EstimationError, Identifier
from msls_ros.inputs import InputAdapter, Synchronizer
from msls_ros.inputs.pacing import slowest_pace
from msls_ros.inputs.profiles import config_folder, read_inputs, read_profile
from msls_ros.nodes.identifier import IdentifierNode
from msls_ros.nodes.inputs import declare_inputs, subscribe
from msls_ros.nodes.parameters import NodeError
from msls_ros.nodes.quality import INPUT
from msls_ros.offline.replay import ReplayOptions, load, replay
from msls_ros.plant import STATES
from msls_ros.testing import Bench

PROFILE = "odometry_jointstate"
FILE = str(config_folder() / "inputs" / f"{PROFILE}.yaml")
TYPES: dict[str, Any] = {made.ODOMETRY: Odometry, made.IMU: Imu, made.JOINTS: JointState}


def fill(message: Any, fields: dict[str, Any]) -> Any:
    for name, value in fields.items():
        if isinstance(value, dict):
            fill(getattr(message, name), value)
        else:
            setattr(message, name, value.tolist() if isinstance(value, np.ndarray) else value)
    return message


def flight_messages(count: int) -> list[tuple[str, Any]]:
    flight = replace(rigid_flight(count / made.RATE), effectors=("elevator", "aileron", "rudder"))
    return [(topic, fill(TYPES[kind](), fields)) for _, topic, kind, fields in made.standard(flight)]


def offline(messages: list[tuple[str, Any]]) -> list[tuple[int, bytes, bytes]]:
    configuration, inputs = read_profile(PROFILE).replace({"time_jump": 0.2}), read_inputs(PROFILE)
    assert inputs is not None
    gate = Synchronizer(configuration.states, configuration.effectors, 0.2)
    names, rate = (configuration.states, configuration.effectors), configuration.sample_rate
    slowest = slowest_pace(configuration)
    adapter = InputAdapter(inputs, *names, time_jump=0.2, sample_rate=rate, slowest=slowest)
    identifier, found = Identifier(configuration, adapter.straddle), []
    for topic, message in messages:
        for row in adapter.push(topic, 0, message):
            s = row.offer(gate)
            if s is not None:
                if s.restarted:
                    identifier.reset()
                e = identifier.update(s.time, s.x, s.xdot, s.delta)
                found.append((s.stamp, e.a.tobytes(), e.b.tobytes()))
    return found


def decoded(models: list[LinearModel]) -> list[tuple[int, bytes, bytes]]:
    return [(m.header.stamp.sec * 10**9 + m.header.stamp.nanosec, m.a.tobytes(), m.b.tobytes()) for m in models]


def make(bench: Bench, *, file: str = FILE, **overrides: Any) -> IdentifierNode:
    given = [Parameter(name.replace("__", "."), value=value) for name, value in overrides.items()]
    arguments = ["--ros-args", "--params-file", file]
    return bench.adopt(IdentifierNode(context=bench.context, cli_args=arguments, parameter_overrides=given))


def count_messages(node: IdentifierNode) -> list[str]:
    """Return the list that the topic of each message that the node takes will be in."""
    adapter, taken = node._adapter, list[str]()
    assert adapter is not None
    push = adapter.push

    def counted(topic: str, stamp_ns: int, message: Any) -> Any:
        taken.append(topic)
        return push(topic, stamp_ns, message)

    adapter.push = counted  # type: ignore[method-assign]
    return taken


def test_who_waits_for_a_sample_is_told_that_a_topic_is_of_another_clock(bench: Bench) -> None:
    """Deflections stamped in simulation time, all else by the wall clock."""
    node = make(bench)
    messages = flight_messages(50)
    for _, message in messages:
        message.header.stamp.sec += 0 if isinstance(message, JointState) else 1_796_000_000
    taken = count_messages(node)
    for number, (topic, message) in enumerate(messages, 1):
        bench.publish(topic, message)
        bench.expect(taken, number)
    assert node.synchronizer.paired == 0
    said = r"25 messages, its stamps are 1[0-9]{9}\.[0-9] s before those of /imu/data: two clocks \(use_sim_time, "
    assert re.search(said, node._waiting())


def test_live_and_offline_by_one_profile_are_equal_to_the_last_bit_also_played_twice(bench: Bench) -> None:
    messages = flight_messages(50) * 2
    node = make(bench, time_jump=0.2)
    models = bench.listen(LinearModel, "model")
    expected = offline(messages)
    assert len(expected) == 2 * 22  # joints at 50 Hz
    taken = count_messages(node)
    for number, (topic, message) in enumerate(messages, 1):
        bench.publish(topic, message)
        bench.expect(taken, number)
    bench.expect(models, len(expected), "models")
    assert decoded(models) == expected
    assert decoded(models)[:22] == decoded(models)[22:]


@pytest.mark.parametrize("profile", ["odometry_jointstate", "mavros_fixed_wing", "px4_odometry"])
def test_ros_reads_the_same_from_a_profile_as_the_offline_tools(bench: Bench, profile: str) -> None:
    arguments = ["--ros-args", "--params-file", str(config_folder() / "inputs" / f"{profile}.yaml")]
    node = bench.adopt(Node("identifier", context=bench.context, cli_args=arguments))
    live, file = declare_inputs(node), read_inputs(profile)
    assert live is not None and file is not None
    assert (
        InputAdapter(live, STATES, ("de", "da", "dr")).topics == InputAdapter(file, STATES, ("de", "da", "dr")).topics
    )
    for one, other in ((live, file), (file, live)):
        for name, stream in one.streams.items():
            twin = other.streams[name]
            assert (stream.path.text, stream.scale, stream.track) == (twin.path.text, twin.scale, twin.track)
    assert (live.clock, live.maximum_age, live.intervals) == (file.clock, file.maximum_age, file.intervals)
    assert live.imu_position == file.imu_position


def test_a_field_that_does_not_exist_is_counted_and_the_node_lives(bench: Bench) -> None:
    node = make(bench, inputs__effectors__de="joints position[names=elevator]")
    for topic, message in flight_messages(4):
        bench.publish(topic, message)
    bench.spin_until(lambda: node.synchronizer.refused["field"] >= 2, "the refusal")


def stamp_of(message: Any) -> int:
    return int(message.header.stamp.sec * 10**9 + message.header.stamp.nanosec)


@pytest.mark.parametrize("coming", [True, False], ids=["rows come", "the link is lost"])
def test_dither_goes_on_while_rows_are_held_and_pauses_when_nothing_comes(
    bench: Bench, capfd: pytest.CaptureFixture[str], coming: bool
) -> None:
    """A deflection steps after 1.4 s and stays; rows are held for .12 s, until it is seen that this is no spike.

    Or from the second of the rows that are held on nothing comes.
    """
    node, clock = make(bench), Clockwork()
    node._steady, node._now = clock, lambda: made.START + clock.nanoseconds  # type: ignore[method-assign]
    taken, dithers = count_messages(node), bench.listen(DitherCommand, "dither")
    assert node._adapter is not None
    most = released = 0
    for number, (topic, message) in enumerate(flight_messages(200), 1):
        if isinstance(message, Imu):
            clock.nanoseconds += 10_000_000
        if isinstance(message, JointState) and clock.nanoseconds > 1_400_000_000:
            message.position = [one + 3.0 for one in message.position]
        before = node._adapter.held
        bench.publish(topic, message)
        bench.expect(taken, number)
        node._watch_inputs()
        most = max(most, node._adapter.held)
        if not coming and node._adapter.held == 2:
            break
        if before and not node._adapter.held:
            released = released or node.synchronizer.paired
    assert node._sample is not None
    if not coming:
        assert not node._answers.stale and node._adapter.held == 2
        clock.nanoseconds += 99_000_000
        node._watch_inputs()
        assert not node._answers.stale
        clock.nanoseconds += 2_000_000
        node._watch_inputs()
        bench.spin_until(lambda: dithers and dithers[-1].level == DitherCommand.LEVEL_INHIBITED, "the zero dither")
        assert dithers[-1].reason.startswith("no sample for 0.1")
        assert node._health().level == DiagnosticStatus.STALE
        return
    assert most >= 6 and released, "rows of 50 Hz are held for .12 s"
    last = node._sample.stamp
    bench.spin_until(lambda: dithers and stamp_of(dithers[-1]) == last, "the last dither")
    late = [one for one in dithers if stamp_of(one) > 2_000_000_000]
    assert {b - a for a, b in pairwise(map(stamp_of, late))} == {20_000_000}
    assert all(one.level == DitherCommand.LEVEL_NOMINAL for one in late)
    assert node._answers.old == 0
    said = capfd.readouterr().err
    assert "samples held" not in said and "s old" not in said
    assert (node._health().level, node._health().message) == (DiagnosticStatus.OK, "identifying")


def test_dithers_are_those_of_a_replay_also_where_rows_are_held(bench: Bench, tmp_path: Path) -> None:
    """A deflection spikes, steps and stays, and steps again at the end; then all once more, back in time."""
    flight = replace(rigid_flight(2.4), effectors=("elevator", "aileron", "rudder"))
    sent = list(made.standard(flight))
    for stamp, _, kind, fields in sent:
        after = 1e-9 * (stamp - made.START)
        if kind == made.JOINTS and (1.4 < after < 1.44 or 1.8 < after < 2.36):
            fields["position"] = fields["position"] + 3.0
    later = [(stamp + 3_000_000_000, topic, kind, fields) for stamp, topic, kind, fields in sent]
    bag = made.write_bag(tmp_path / "bag", iter([*sent, *later]), tmp_path / "definitions")
    configuration, inputs = read_profile(PROFILE), read_inputs(PROFILE)
    replayed = replay(bag, tmp_path / "out", configuration, ReplayOptions(inputs=inputs))
    expected = [decoded for _, decoded in load(tmp_path / "out").topic("dither")]

    node, clock = make(bench), Clockwork()
    node._steady, node._now = clock, lambda: clock.nanoseconds - lead  # type: ignore[method-assign]
    taken, dithers, lead = count_messages(node), bench.listen(DitherCommand, "dither"), 0
    for number, (logged, topic, kind, fields) in enumerate([*sent, *later], 1):
        clock.nanoseconds, lead = logged, 0 if number <= len(sent) else 3_000_000_000
        bench.publish(topic, fill(TYPES[kind](), fields))
        bench.expect(taken, number)
    bench.expect(dithers, len(expected), "all dithers")
    assert node._adapter is not None and node._adapter.held == 2
    assert replayed.refused["spike"] == 4 and replayed.restarts == 1
    assert [answer(one) for one in dithers] == [answer(one) for one in expected]
    assert len({answer(one)[1] for one in dithers}) < len(dithers) - 20, "some go on"


def answer(dither: Any) -> tuple[int, bytes, int, str]:
    """Return stamp, deflections, level and reason of a dither."""
    stamp = dither.header.stamp
    return int(stamp.sec * 10**9 + stamp.nanosec), np.array(dither.delta).tobytes(), dither.level, dither.reason


@pytest.mark.parametrize("dead", ["/odom", "/joint_states", "the link", "nothing"])
def test_a_pause_names_the_topic_that_is_silent(bench: Bench, dead: str) -> None:
    node, clock = make(bench), Clockwork()
    node._steady = clock
    taken, dithers = count_messages(node), bench.listen(DitherCommand, "dither")
    for topic, message in flight_messages(120):
        clock.nanoseconds += 10_000_000 if isinstance(message, Imu) else 0
        late = clock.nanoseconds > 600_000_000
        if late and dead == "the link":
            break
        if late and dead == "nothing":
            message.header.stamp.sec, message.header.stamp.nanosec = 0, 1  # goes back: all are refused
        if not (late and topic == dead):
            count = len(taken)
            bench.publish(topic, message)
            bench.expect(taken, count + 1)
    clock.nanoseconds += 60_000_000 if dead != "the link" else 200_000_000
    assert node._sample is not None and dithers
    node._watch_inputs()
    said = node._health().message
    names = {topic for topic in ("/odom", "/imu/data", "/joint_states") if topic in said}
    expected = {"the link": {"/odom", "/imu/data", "/joint_states"}, "nothing": set[str]()}
    assert said.startswith("no samples for") and names == expected.get(dead, {dead}), said
    assert dead != "nothing" or "make no sample: see what is refused" in said


def test_a_topic_that_is_too_slow_for_the_rate_is_named_once_and_its_samples_are_counted(
    bench: Bench, capfd: pytest.CaptureFixture[str]
) -> None:
    """An odometry of 5 Hz, allowed by its age, in a stack of 100 Hz."""
    node = make(bench, inputs__maximum_age=0.3, lockstep=True)
    taken = count_messages(node)
    odometry = 0
    for topic, message in flight_messages(350):
        odometry += topic == "/odom"
        if topic != "/odom" or odometry % 10 == 1:  # one of ten of 50 Hz
            count = len(taken)
            bench.publish(topic, message)
            bench.expect(taken, count + 1)
    health = node._health()
    said = "/odom comes at 5 Hz, too slow for sample_rate, 100 Hz: samples wait for its next message"
    assert said in health.message and health.level == DiagnosticStatus.WARN
    assert capfd.readouterr().err.count(said) == 1
    assert 0 < int(str(health.values["/odom: too slow [samples]"])) < node.synchronizer.paired


def test_a_mapping_that_is_wrong_ends_the_start_with_its_reason(bench: Bench) -> None:
    with pytest.raises(EstimationError, match=r"inputs.states.s.*'c' is not a topic"):
        make(bench, inputs__states__s="c s")
    with pytest.raises(NodeError, match="could not be configured"):
        make(bench, effectors=["de", "da", "dr", "flap"])


@pytest.mark.parametrize(
    ("overlay", "do"),
    [
        (None, "source the workspace that builds the package px4_msgs"),
        ("", "build .* px4_msgs .* in MSLS_OVERLAY, see"),
    ],
)
def test_a_type_that_is_not_installed_is_named(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, overlay: str | None, do: str
) -> None:
    monkeypatch.delenv("MSLS_OVERLAY", raising=False)
    if overlay is not None:
        monkeypatch.setenv("MSLS_OVERLAY", overlay)
    with pytest.raises(NodeError, match=f"the type px4_msgs/msg/VehicleOdometry is not installed: {do}"):
        subscribe(bench.probe, {"/x": "px4_msgs/msg/VehicleOdometry"}, INPUT, lambda topic, message: None, print)
