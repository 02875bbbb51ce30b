"""DDS that stays on this machine: nothing in shared memory, seen by who uses it all the same."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from std_msgs.msg import String

from msls_ros.nodes.loopback import BY_PROFILE, PROFILE, RANGE, loopback, stay_on_this_machine
from msls_ros.testing import Bench

USUAL = """
import rclpy
from std_msgs.msg import String
rclpy.init()
node = rclpy.create_node("usual")
heard = []
node.create_subscription(String, "word", heard.append, 10)
while not heard:
    rclpy.spin_once(node)
print(heard[0].data)
node.destroy_node()
rclpy.shutdown()
"""
"""A subscriber in a process of its own, which ends with the first message."""


def threads() -> set[str]:
    return {task.joinpath("comm").read_text().strip() for task in Path("/proc/self/task").iterdir()}


def test_a_bench_listens_by_udp_and_opens_no_shared_memory(bench: Bench) -> None:
    names = threads()
    assert any(name.startswith("dds.udp") for name in names)
    assert not any(name.startswith("dds.shm") for name in names)


def test_a_process_that_uses_shared_memory_hears_the_bench(bench: Bench) -> None:
    environment = {key: value for key, value in os.environ.items() if key != PROFILE}
    environment |= {RANGE: "LOCALHOST", "ROS_DOMAIN_ID": str(bench.domain)}
    publisher = bench.probe.create_publisher(String, "word", 10)
    with subprocess.Popen([sys.executable, "-c", USUAL], env=environment, stdout=subprocess.PIPE, text=True) as other:

        def sent() -> bool:
            publisher.publish(String(data="heard"))
            return other.poll() is not None

        try:
            bench.spin_until(sent, "the other process")
        finally:
            other.kill()
        assert other.stdout is not None and other.stdout.read() == "heard\n"


def test_what_the_environment_says_of_dds_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    def decided(**given: str) -> dict[str, str | None]:
        for key in (PROFILE, RANGE, "RMW_IMPLEMENTATION"):
            monkeypatch.delenv(key, raising=False)
        for key, value in given.items():
            monkeypatch.setenv(key, value)
        stay_on_this_machine()
        return {key: os.environ.get(key) for key in (PROFILE, RANGE)}

    assert decided() == loopback()
    assert loopback()[RANGE] == BY_PROFILE and Path(loopback()[PROFILE]).is_file()
    assert decided(**{RANGE: "SUBNET"}) == {PROFILE: None, RANGE: "SUBNET"}
    assert decided(**{PROFILE: "own.xml"}) == {PROFILE: "own.xml", RANGE: "LOCALHOST"}
    assert decided(RMW_IMPLEMENTATION="rmw_cyclonedds_cpp") == {PROFILE: None, RANGE: "LOCALHOST"}
