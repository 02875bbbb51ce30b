"""Messages of rclpy's own serialize_message, which are longer than what they hold, are read from a bag."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from msls_msgs.msg import StateSample
from rclpy.serialization import serialize_message
from rosbags.rosbag2 import StoragePlugin, Writer
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint  # type: ignore[import-untyped]

from msls_ros.bags import BagError, BagReader, SampleDecoder
from msls_ros.bags.definitions import default_definitions
from msls_ros.bags.serde import deserialize

STORE = default_definitions().store
JOINTS, TRAJECTORY = "sensor_msgs/msg/JointState", "trajectory_msgs/msg/JointTrajectory"


def joints(k: int) -> JointState:
    message = JointState(name=["elevator", "aileron", "rudder"], position=[0.1, 0.2, 1e-3 * k])
    message.header.frame_id = "base_link"
    return message


def test_a_bag_written_by_script_is_read(tmp_path: Path) -> None:
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/joint_states", JOINTS, typestore=STORE)
        for k in range(50):
            data = serialize_message(joints(k))
            assert len(data) == 116  # of 108
            writer.write(connection, 10_000_000 * k, data)
    read = [message for _, message in BagReader(tmp_path / "bag").decoded()]
    assert [list(message.position) for message in read] == [[0.1, 0.2, 1e-3 * k] for k in range(50)]
    assert all(len(message.velocity) == len(message.effort) == 0 for message in read)


@pytest.mark.parametrize("points", [0, 1, 5, 50])
def test_a_trajectory_without_numbers_is_as_long_as_its_points_make_it(points: int) -> None:
    data = serialize_message(JointTrajectory(points=[JointTrajectoryPoint() for _ in range(points)]))
    assert len(deserialize(STORE, TRAJECTORY, data).points) == points


def test_bytes_beyond_what_is_made_are_refused() -> None:
    data = serialize_message(joints(0))
    with pytest.raises(BagError, match="132 bytes that are not a message of this type"):
        deserialize(STORE, JOINTS, data + bytes(8 + 8))
    full = joints(0)
    full.velocity = full.effort = [0.0, 0.0, 0.0]
    data = serialize_message(full)
    assert deserialize(STORE, JOINTS, data + bytes(3)).name == full.name
    with pytest.raises(BagError, match="size mismatch"):
        deserialize(STORE, JOINTS, data + bytes(4))


@pytest.mark.parametrize("count", [0, 1, 2, 9])
def test_a_sample_without_derivatives_is_read(count: int) -> None:
    message = StateSample(states=[f"x{i}" for i in range(count)], x=[1.0 * i for i in range(count)])
    sample = SampleDecoder("msls_msgs/msg/StateSample").decode(serialize_message(message))
    assert np.array_equal(sample.values, np.arange(count)) and sample.rates is None
