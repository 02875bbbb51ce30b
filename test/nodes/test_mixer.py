"""The mixer node: the same type in and out, dither where it is valid, else the command as it came, byte for byte."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from rclpy.qos import QoSProfile, QoSReliabilityPolicy
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float32MultiArray, Float64MultiArray
from std_srvs.srv import SetBool

from msls_ros import messages
from msls_ros.estimation import Dither, EstimationError, Level
from msls_ros.inputs.field_paths import FieldPath
from msls_ros.nodes.message_types import message_class
from msls_ros.nodes.mixer import MixerNode
from msls_ros.nodes.parameters import NodeError
from msls_ros.nodes.quality import best_effort, reliable
from msls_ros.testing import Bench

NAMES = ["de", "dr"]
SECOND = 1_000_000_000
INDEXED = ["data[2]", "data[0]"]


def floats(kind: Any = Float64MultiArray, values: Any = (0.1, 0.2, 0.3)) -> Any:
    return kind(data=values)


def joints() -> JointState:
    return JointState(name=["rudder", "gear", "elevator"], position=[0.1, 0.2, 0.3])


KINDS: dict[str, tuple[Any, dict[str, Any]]] = {
    "std_msgs/msg/Float64MultiArray": (floats(), {"fields": INDEXED}),
    "std_msgs/msg/Float32MultiArray": (floats(Float32MultiArray), {"fields": INDEXED}),
    "sensor_msgs/msg/JointState": (joints(), {"fields": ["position[name=elevator]", "position[name=rudder]"]}),
    "msls_msgs/msg/EffectorCommand": (
        messages.command_message(SECOND, ["dr", "other", "de"], np.array([0.1, 0.2, 0.3])),
        {},
    ),
}


class Flow:
    """Sends commands and dithers through a mixer."""

    def __init__(self, bench: Bench, kind: str, **parameters: Any) -> None:
        self.bench = bench
        self.node = bench.add(MixerNode, effectors=NAMES, command_type=kind, **parameters)
        self.now = 0
        self.node._steady = lambda: self.now
        self.out: list[bytes] = []
        self.publisher = bench.probe.create_publisher(message_class(kind), "command_in", 10)
        bench.spin_until(lambda: self.publisher.get_subscription_count() > 0, "the input's connection")
        bench.probe.create_subscription(message_class(kind), "command_out", self.out.append, 10, raw=True)
        bench.spin_until(lambda: self.node._publisher.get_subscription_count() > 0, "the output's connection")

    def dither(self, delta: Any, level: Level = Level.NOMINAL, **changes: Any) -> None:
        message = messages.dither_message(SECOND, NAMES, Dither(np.array(delta), 0.0, 0.0, 0.0, level, "test"))
        for name, value in changes.items():
            setattr(message, name, value)
        before = self.node._mixer._taken, sum(self.node._refusals.counts.values())
        self.now += 1
        self.bench.publish("dither", message)
        after = lambda: (self.node._mixer._taken, sum(self.node._refusals.counts.values()))  # noqa: E731
        self.bench.spin_until(lambda: after() != before, "the dither")

    def through(self, data: bytes) -> bytes:
        """Send a serialised command, whose padding is then known; return what comes out."""
        count = len(self.out)
        self.publisher.publish(data)
        self.bench.expect(self.out, count + 1, "the output")
        return self.out[-1]


@pytest.mark.parametrize("kind", KINDS)
def test_commands_of_any_type_go_through_with_dither_and_without(bench: Bench, kind: str) -> None:
    command, given = KINDS[kind]
    flow = Flow(bench, kind, scale=[1.0, -2.0], **given)
    as_it_came = serialize_message(command)
    assert flow.through(as_it_came) == as_it_came, "no dither yet"
    flow.dither([0.01, 0.02])
    paths = [FieldPath(text) for text in given.get("fields", [f"delta[effectors={n}]" for n in NAMES])]
    mixed = deserialize_message(flow.through(as_it_came), type(command))
    assert [path.read(mixed) for path in paths] == pytest.approx([0.31, 0.06])
    flow.now += 101_000_000
    assert flow.through(as_it_came) == as_it_came, "stale"


def test_dither_of_sums_and_differences_goes_to_the_channels_that_make_them(bench: Bench) -> None:
    """Elevons, left de + da and right de - da; authority, limits and scale are those of the channels."""
    kind, command = "std_msgs/msg/Float64MultiArray", floats()
    flow = Flow(
        bench, kind, fields=["data[0]", "data[2]"], mix=[1.0, 1.0, 1.0, -1.0], scale=[1.0, -2.0], authority=[0.05, 1.0]
    )
    data = serialize_message(command)
    flow.through(data)
    flow.dither([0.01, 0.02])
    mixed = deserialize_message(flow.through(data), type(command))
    assert list(mixed.data) == pytest.approx([0.1 + 0.03, 0.2, 0.3 - 2.0 * -0.01])
    flow.dither([0.03, 0.03])
    assert flow.through(data) == data, "0.06 is beyond the authority of the left one"


@pytest.mark.parametrize("quality", [best_effort(10), reliable(10)], ids=["best effort", "reliable"])
def test_commands_of_publishers_of_either_quality_go_through(bench: Bench, quality: QoSProfile) -> None:
    bench.add(MixerNode, effectors=NAMES, command_type="std_msgs/msg/Float64MultiArray", fields=INDEXED)
    out = bench.listen(Float64MultiArray, "command_out")
    publisher = bench.probe.create_publisher(Float64MultiArray, "command_in", quality)
    bench.spin_until(lambda: publisher.get_subscription_count() > 0, "a subscription of that quality")

    def passed() -> bool:
        publisher.publish(floats())  # again and again: best effort may lose one
        return bool(out)

    bench.spin_until(passed, "the command")
    assert out[0] == floats()


def test_the_quality_of_the_commands_is_overridden_by_parameters(bench: Bench) -> None:
    node = bench.add(MixerNode, effectors=NAMES, **{"qos_overrides./command_in.subscription.reliability": "reliable"})
    (found,) = [s.qos_profile for s in node.subscriptions if s.topic_name == "/command_in"]
    assert found.reliability == QoSReliabilityPolicy.RELIABLE


@pytest.mark.parametrize(("ahead", "mixed"), [(90, True), (110, False), (3_000, False), (1_000_000, True), (-50, True)])
def test_a_dither_that_is_stale_by_the_commands_own_stamp_is_not_added(bench: Bench, ahead: int, mixed: bool) -> None:
    flow = Flow(bench, "msls_msgs/msg/EffectorCommand")  # a mixer that runs late finds both in its queues at once
    stamp = 100 * SECOND + ahead * 1_000_000
    flow.dither([0.01, 0.02], header=messages.command_message(100 * SECOND, NAMES, np.zeros(2)).header)
    command = serialize_message(messages.command_message(stamp, NAMES, np.array([0.1, 0.2])))
    assert (flow.through(command) != command) == mixed


UNSAFE: dict[str, dict[str, Any]] = {
    "inhibited": {"delta": [0.0, 0.0], "level": Level.INHIBITED},
    "not finite": {"delta": [0.01, float("nan")]},
    "beyond its authority": {"delta": [0.01, 0.2]},
    "of other effectors": {"delta": [0.01, 0.01], "effectors": ["de", "nonsense"]},
}


@pytest.mark.parametrize("what", UNSAFE)
def test_an_unsafe_dither_leaves_the_command_as_it_came(bench: Bench, what: str) -> None:
    flow = Flow(bench, "std_msgs/msg/Float64MultiArray", fields=INDEXED, authority=[0.05, 0.05])
    command = serialize_message(floats())
    flow.dither([0.01, 0.01])
    assert flow.through(command) != command
    flow.dither(**UNSAFE[what])
    assert flow.through(command) == command


@pytest.mark.parametrize("values", [[], [0.1], [0.1, float("nan"), float("inf")]])
def test_a_command_that_cannot_be_read_is_passed_on(bench: Bench, values: list[float]) -> None:
    flow = Flow(bench, "std_msgs/msg/Float64MultiArray", fields=INDEXED)
    flow.dither([0.01, 0.01])
    command = serialize_message(floats(values=values))
    assert flow.through(command) == command


def test_the_master_switch_is_a_service_and_diagnostics_say_why_nothing_is_added(bench: Bench) -> None:
    flow = Flow(bench, "std_msgs/msg/Float64MultiArray", fields=INDEXED)
    flow.dither([0.01, 0.01])
    command = serialize_message(floats())
    assert bench.call(SetBool, "mixer/enable", data=False).success
    assert flow.through(command) == command
    newest = bench.diagnostics("mixer")
    bench.spin_until(lambda: "master switch is off" in newest().get("status", ""), "the diagnostics")
    assert bench.call(SetBool, "mixer/enable", data=True).success
    assert flow.through(command) != command


def test_limits_hold_at_the_output(bench: Bench) -> None:
    limits = {"position_low": [-1.0, -1.0], "position_high": [0.305, 1.0], "rate_limit": [100.0, 0.0]}
    flow = Flow(bench, "std_msgs/msg/Float64MultiArray", fields=INDEXED, **limits)
    command = serialize_message(floats())
    flow.through(command)
    flow.now += 20_000_000
    flow.dither([0.01, 0.01])
    out = deserialize_message(flow.through(command), Float64MultiArray)
    assert list(out.data) == [0.1, 0.2, 0.305]


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"fields": ["data[0]"]}, "one per effector"),
        ({"fields": ["data[0]"], "mix": [1.0]}, "it must have 2 for each of 1 fields"),
        ({"command_type": "nowhere/msg/Thing"}, "not installed"),
        ({"command_type": "Thing"}, "expected PACKAGE/msg/NAME"),
        ({"authority": [1.0]}, "one per effector"),
        ({"stale_after": -1.0}, "0.001 to 60"),
        ({"scale": ["a"]}, "a list of numbers"),
    ],
)
def test_wrong_parameters_are_refused_with_a_reason(bench: Bench, given: dict[str, Any], sentence: str) -> None:
    with pytest.raises((NodeError, EstimationError), match=sentence):
        bench.add(MixerNode, effectors=NAMES, **given)
