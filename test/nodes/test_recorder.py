"""The recorder writes what comes, refuses and counts what is no message, and never ends because of it."""

from __future__ import annotations

from pathlib import Path

import pytest
from msls_msgs.msg import StateSample

from msls_ros.bags import read
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
