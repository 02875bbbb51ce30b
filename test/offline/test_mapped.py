"""Replay of bags with other message types: the shipped input profiles, from the command line."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from inputs import mapped_messages as made
from inputs.mapped_messages import Flight, rigid_flight, write_bag
from offline.replayed import outputs, run

from msls_ros import bags
from msls_ros.bags import BagWriter, read
from msls_ros.estimation import Identifier
from msls_ros.inputs import InputAdapter, Synchronizer, adapt
from msls_ros.inputs.pacing import slowest_pace
from msls_ros.inputs.profiles import read_inputs, read_profile
from msls_ros.offline.replay import ReplayOptions, replay

ENCODERS = {"odometry_jointstate": made.standard, "mavros_fixed_wing": made.mavros, "px4_odometry": made.px4}
NAMES = ("elevator", "aileron", "rudder")


@pytest.fixture(scope="module")
def flight() -> Flight:
    return rigid_flight(10.0)


def bag_of(profile: str, flight: Flight, folder: Path) -> Path:
    sent = replace(flight, effectors=NAMES) if profile == "odometry_jointstate" else flight
    return write_bag(folder / "bag", ENCODERS[profile](sent), folder / "definitions")


@pytest.mark.parametrize("profile", ENCODERS)
def test_a_bag_of_other_types_replays_by_its_profile(
    profile: str, flight: Flight, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = bag_of(profile, flight, tmp_path)
    code, out, err = run(capsys, bag, "--params", profile, "--out", tmp_path / "out", "--json", "--every", 100)
    assert (code, err) == (0, [])
    (summary,) = json.loads(out)
    assert summary["refused"] == {} and summary["samples"] > 400

    configuration, inputs = read_profile(profile), read_inputs(profile)
    assert inputs is not None
    gate = Synchronizer(configuration.states, configuration.effectors, configuration.time_jump)
    rate = configuration.sample_rate
    adapter = InputAdapter(
        inputs,
        configuration.states,
        configuration.effectors,
        sample_rate=rate,
        slowest=slowest_pace(configuration),
        refused=gate.refused,
    )
    decoded = ((m.topic, m.stamp_ns, d) for m, d in bags.read(bag).decoded())
    samples = [s for row in adapt(decoded, adapter) if (s := row.offer(gate)) is not None]
    identifier = Identifier(configuration, adapter.straddle)
    for s in samples:
        last = identifier.update(s.time, s.x, s.xdot, s.delta)
        if last.samples % 100 == 0:
            model = last
    given = outputs(tmp_path / "out" / "bag")
    assert len(given["/dither"]) == len(samples)
    assert given["/model"][-1][1]["a"] == ("float64", model.a.tobytes())
    assert given["/model"][-1][1]["b_std"] == ("float64", model.b_std.tobytes())


def test_a_topic_that_is_too_slow_for_the_rate_is_a_warning_as_in_flight_and_in_the_report(
    flight: Flight, tmp_path: Path
) -> None:
    """Joints of 50 Hz, of which one message in five has come."""
    configuration, inputs = read_profile("odometry_jointstate"), read_inputs("odometry_jointstate")
    assert inputs is not None
    sent = made.standard(replace(flight, effectors=NAMES))
    come = (one for one in sent if one[1] != "/joint_states" or one[0] // 20_000_000 % 5 == 0)
    bag = write_bag(tmp_path / "bag", come, tmp_path / "definitions")
    (said,) = replay(bag, tmp_path / "out", configuration, ReplayOptions(inputs=inputs)).warnings
    assert said.startswith("/joint_states comes at 10 Hz, too slow for sample_rate, 100 Hz: samples wait for its next")


def test_the_new_bag_keeps_the_inputs_so_that_merged_it_replays_by_itself(
    flight: Flight, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = bag_of("odometry_jointstate", flight, tmp_path)
    assert run(capsys, bag, "--params", "odometry_jointstate", "--merge", "--out", tmp_path / "out")[0] == 0
    code, _, err = run(capsys, tmp_path / "out" / "bag", "--out", tmp_path / "again")
    assert (code, err) == (0, [])
    assert outputs(tmp_path / "again" / "bag") == outputs(tmp_path / "out" / "bag")


def test_what_is_missing_is_one_line(flight: Flight, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = bag_of("px4_odometry", flight, tmp_path)
    arguments = ("--out", tmp_path / "out", "--overwrite", "--params")
    code, _, err = run(capsys, bag, *arguments, "odometry_jointstate")
    assert code == 2 and len(err) == 1 and "no topic /odom (nav_msgs/msg/Odometry)" in err[0] and str(bag) in err[0]
    code, _, err = run(capsys, bag, *arguments, "f16")
    assert code == 2 and len(err) == 1 and "no topic state" in err[0]


def test_a_type_without_a_definition_is_named_and_can_be_given(
    flight: Flight, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = bag_of("px4_odometry", flight, tmp_path)
    bare = tmp_path / "bare"
    with BagWriter(bare) as writer:
        for message in read(whole):
            empty = bags.Definition(message.msgtype, "", "", "")
            writer.add_topic(message.topic, message.msgtype, definition=empty)
            writer.write(*message)
    arguments = (bare, "--params", "px4_odometry", "--out", tmp_path / "out", "--overwrite")
    code, _, err = run(capsys, *arguments)
    assert code == 2 and len(err) == 1
    assert "px4_msgs/msg/" in err[0] and "no message definition found" in err[0] and "--definitions" in err[0]
    assert run(capsys, *arguments, "--definitions", tmp_path / "definitions")[::2] == (0, [])


def test_damaged_messages_of_other_types_are_counted(
    flight: Flight, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rng = np.random.default_rng(0)
    with BagWriter(tmp_path / "bad") as writer:
        for k, message in enumerate(read(bag_of("odometry_jointstate", flight, tmp_path))):
            cut = message.data[: int(rng.integers(0, len(message.data)))] if k % 50 == 3 else message.data
            writer.write(*message._replace(data=cut))
    code, out, err = run(capsys, tmp_path / "bad", "--params", "odometry_jointstate", "--out", tmp_path / "o", "--json")
    (summary,) = json.loads(out)
    assert (code, err) == (0, []) and summary["samples"] > 400  # joints at 50 Hz
    assert summary["refused"]["malformed"] > 10
