"""The identifier node refuses what it cannot use, watches its inputs, and obeys its lifecycle and parameters."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticStatus
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from msls_msgs.msg import DitherCommand, EffectorSample, FaultEvent, LinearModel, StateSample
from nodes.made_up import Clockwork, linear_samples
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import DescribeParameters, GetParameters, SetParameters
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_srvs.srv import SetBool, Trigger

from msls_ros import messages
from msls_ros.nodes import refusals
from msls_ros.nodes.identifier import IdentifierNode
from msls_ros.nodes.quality import INPUT, best_effort
from msls_ros.plant import EFFECTORS, STATES
from msls_ros.testing import Bench

STEP = 20_000_000
X, XDOT, DELTA = linear_samples(400)


class Feeder:
    """Feeds an identifier with samples and keeps what it answers; the age of the samples is set by hand."""

    def __init__(self, bench: Bench, **parameters: Any) -> None:
        self.bench = bench
        self.node = bench.add(IdentifierNode, **parameters)
        self.clock = Clockwork()
        self.node._steady = self.clock
        self.dither: list[DitherCommand] = bench.listen(DitherCommand, "dither")
        self.model: list[LinearModel] = bench.listen(LinearModel, "model")
        self.k = 0

    def state(self, k: int, **changes: Any) -> StateSample:
        message = messages.state_message(k * STEP, STATES, X[k % 400], XDOT[k % 400])
        for name, value in changes.items():
            setattr(message, name, value)
        return message

    def effectors(self, k: int, **changes: Any) -> EffectorSample:
        message = messages.effector_message(k * STEP, EFFECTORS, DELTA[k % 400])
        for name, value in changes.items():
            setattr(message, name, value)
        return message

    def feed(self, count: int) -> None:
        """Publish the next samples and wait for all answers."""
        for _ in range(count):
            wanted, models = len(self.dither) + 1, len(self.model) + 1
            self.k += 1
            self.bench.publish("state", self.state(self.k))
            self.bench.publish("effectors", self.effectors(self.k))
            self.bench.expect(self.dither, wanted)
            self.bench.expect(self.model, models)

    def refused(self, reason: str) -> int:
        return self.node.synchronizer.refused[reason]


def with_value(values: Any, index: int, value: float) -> list[float]:
    changed = [float(v) for v in values]
    changed[index] = value
    return changed


def stamped(message: Any, stamp: int) -> Any:
    message.header.stamp = messages.time_message(stamp)
    return message


NAN, INF = float("nan"), float("inf")
Spoil = Callable[[Feeder], tuple[str, Any]]
BAD: dict[str, tuple[str, Spoil]] = {
    "a NaN state": ("not_finite", lambda f: ("state", f.state(f.k + 1, x=with_value(X[0], 3, NAN)))),
    "an infinite state": ("not_finite", lambda f: ("state", f.state(f.k + 1, x=with_value(X[0], 0, INF)))),
    "a NaN derivative": ("not_finite", lambda f: ("state", f.state(f.k + 1, xdot=with_value(X[0], 8, NAN)))),
    "a short state": ("length", lambda f: ("state", f.state(f.k + 1, x=[1.0] * 8))),
    "a long derivative": ("length", lambda f: ("state", f.state(f.k + 1, xdot=[1.0] * 10))),
    "no state at all": ("names", lambda f: ("state", StateSample())),
    "no derivative": ("xdot_missing", lambda f: ("state", f.state(f.k + 1, xdot=[]))),
    "an unknown state": ("names", lambda f: ("state", f.state(f.k + 1, states=[*STATES[:8], "nonsense"]))),
    "a state named twice": ("names", lambda f: ("state", f.state(f.k + 1, states=[*STATES[:8], "u"]))),
    "a repeated state": ("stamp_repeated", lambda f: ("state", f.state(f.k))),
    "a state from before": ("stamp_back", lambda f: ("state", f.state(f.k - 1))),
    "a NaN deflection": (
        "not_finite",
        lambda f: ("effectors", f.effectors(f.k + 1, delta=with_value(DELTA[0], 6, NAN))),
    ),
    "an infinite deflection": (
        "not_finite",
        lambda f: ("effectors", f.effectors(f.k + 1, delta=with_value(DELTA[0], 0, -INF))),
    ),
    "short deflections": ("length", lambda f: ("effectors", f.effectors(f.k + 1, delta=[0.0] * 6))),
    "no deflections": ("length", lambda f: ("effectors", f.effectors(f.k + 1, delta=[]))),
    "an unknown effector": (
        "names",
        lambda f: ("effectors", f.effectors(f.k + 1, effectors=["elevon", *EFFECTORS[1:]])),
    ),
    "repeated deflections": ("stamp_repeated", lambda f: ("effectors", f.effectors(f.k))),
    "deflections from before": ("stamp_back", lambda f: ("effectors", f.effectors(f.k - 2))),
}


@pytest.fixture(scope="module")
def fed(shared_bench: Bench) -> Feeder:
    feeder = Feeder(shared_bench)
    feeder.feed(30)
    return feeder


@pytest.mark.parametrize("what", BAD)
def test_is_refused_and_counted_and_the_estimate_stays_finite(fed: Feeder, what: str) -> None:
    reason, spoil = BAD[what]
    before, total = fed.refused(reason), sum(fed.node.synchronizer.refused.values())
    topic, message = spoil(fed)
    fed.bench.publish(topic, message)
    fed.bench.spin_until(lambda: fed.refused(reason) == before + 1, f"a refusal ({reason})")
    fed.feed(2)
    assert sum(fed.node.synchronizer.refused.values()) == total + 1
    newest = fed.model[-1]
    assert all(np.isfinite(v).all() for v in (newest.a, newest.b, newest.bias, fed.dither[-1].delta))
    assert messages.stamp_of(newest) == fed.k * STEP


@pytest.mark.parametrize("size", [1e3, 1e6, 1e11, 1e12, 1e30, 1e150, 1e300])
def test_enormous_numbers_leave_estimate_and_dither_finite(bench: Bench, size: float) -> None:
    feeder = Feeder(bench)
    feeder.feed(30)
    gate = feeder.node.synchronizer
    bench.publish("state", feeder.state(31, x=[size] * 9, xdot=[-size] * 9))
    bench.publish("effectors", feeder.effectors(31, delta=[size] * 7))
    bench.spin_until(lambda: gate.paired == 31 or sum(gate.refused.values()) > 0, "the sample or its refusal")
    feeder.k = 31
    feeder.feed(5)
    newest = feeder.model[-1]
    assert all(np.isfinite(v).all() for v in (newest.a, newest.b, newest.bias, feeder.dither[-1].delta))


def test_diagnostics_tell_the_count_of_refusals_by_reason(bench: Bench) -> None:
    feeder = Feeder(bench)
    feeder.feed(3)
    newest = bench.diagnostics("identifier")
    for _ in range(4):
        bench.publish("state", feeder.state(feeder.k + 1, x=with_value(X[0], 0, NAN)))
    bench.publish("effectors", feeder.effectors(feeder.k + 1, delta=[]))
    bench.spin_until(lambda: newest().get("refused: length") == "1" and newest().get("refused: not_finite") == "4")
    assert newest()["samples"] == "3"
    assert "5 messages refused" in newest()["status"] or "no samples" in newest()["status"]


def test_diagnostics_are_ok_again_once_the_last_refusal_is_long_ago_and_still_tell_the_total(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    recent, second = refusals.Recent(), 1_000_000_000
    course = [(0, 0), (1, 5), (1, 14), (1, 15), (1, 16), (3, 20), (3, 29), (3, 30), (4, 40), (4, 2), (5, 3)]
    found = [recent.grew(count, at * second) for count, at in course]
    assert found == [False, True, True, False, False, True, True, False, True, False, True]
    monkeypatch.setattr(refusals, "RECENT", 0)
    newest = bench.diagnostics(bench.probe.get_name())
    fine = refusals.Health(DiagnosticStatus.OK, "fine", {})
    told = refusals.Diagnostics(bench.probe, lambda: fine, {"not_finite": 1})
    bench.spin_until(newest, "diagnostics")
    told.destroy()
    assert newest() == {"status": "fine", "messages refused": "1", "refused: not_finite": "1"}


def test_diagnostics_tell_what_is_not_learnt_from_on_the_ground_and_spikes(bench: Bench) -> None:
    """At rest the node answers with no dither and says why; flying, it drops a deflection that jumps and is back."""
    feeder = Feeder(bench, **{"reference_speed": 100.0})
    newest = bench.diagnostics("identifier")
    for k in range(1, 4):
        bench.publish("state", feeder.state(k, x=np.zeros(len(STATES))))
        bench.publish("effectors", feeder.effectors(k))
        bench.expect(feeder.dither, k)
    assert all(one.reason == "not flying" and not np.any(one.delta) for one in feeder.dither)
    bench.spin_until(lambda: newest().get("not of flight [samples]") == "3")
    bench.spin_until(lambda: "not flying (slower than 25 m/s" in newest()["status"])
    assert feeder.node._identifier is not None
    feeder.node._identifier.reset()
    feeder.k = 3
    feeder.feed(80)
    bench.publish("state", feeder.state(84))
    bench.publish("effectors", feeder.effectors(84, delta=with_value(DELTA[84], 1, 3.0)))
    bench.expect(feeder.dither, 84)
    feeder.k = 84
    feeder.feed(1)
    bench.spin_until(lambda: (newest().get("spikes [samples]"), newest().get("last spike")) == ("1", EFFECTORS[1]))


def test_each_reason_is_logged_once_a_second(bench: Bench, capfd: pytest.CaptureFixture[str]) -> None:
    feeder = Feeder(bench)
    clock = Clockwork()
    feeder.node._refusals._clock = clock  # type: ignore[assignment]

    def spoil(count: int) -> None:
        before = feeder.refused("not_finite")
        for k in range(count):
            bench.publish("state", feeder.state(1 + k, x=with_value(X[0], 0, NAN)))
        bench.publish("effectors", feeder.effectors(1, delta=[]))
        bench.spin_until(lambda: feeder.refused("not_finite") == before + count, "refusals")

    spoil(10)
    bench.spin_until(lambda: feeder.refused("length") == 1, "refusal")
    clock.nanoseconds += 999_999_999
    spoil(10)
    lines = capfd.readouterr().err
    assert lines.count("refused (not_finite") == 1
    assert lines.count("refused (length") == 1
    clock.nanoseconds += 1
    spoil(1)
    assert "refused (not_finite, 21 so far): state sample: x of u is nan" in capfd.readouterr().err


def test_the_same_samples_again_give_the_same_bits_after_a_time_jump(bench: Bench) -> None:
    feeder = Feeder(bench)
    faults: list[FaultEvent] = bench.listen(FaultEvent, "fault")
    feeder.feed(80)
    feeder.k = 0
    feeder.feed(80)
    assert feeder.node.synchronizer.restarts == 1
    for first, second in zip(feeder.model[:80], feeder.model[80:], strict=True):
        assert second == first or _same_bits(first, second)
    assert [d.delta for d in feeder.dither[:80]] == [d.delta for d in feeder.dither[80:]]
    assert len(faults) % 2 == 0


def _same_bits(first: LinearModel, second: LinearModel) -> bool:
    """Compare models that hold NaN."""
    fields = first.get_fields_and_field_types()
    return all(
        bytes(getattr(first, f)) == bytes(getattr(second, f))
        if hasattr(getattr(first, f), "typecode")
        else getattr(first, f) == getattr(second, f)
        for f in fields
    )


def test_stale_input_inhibits_the_dither_once(bench: Bench) -> None:
    feeder = Feeder(bench)
    clock = feeder.clock
    feeder.feed(40)
    assert feeder.dither[-1].level == DitherCommand.LEVEL_NOMINAL
    clock.nanoseconds += 101_000_000
    bench.spin_until(lambda: len(feeder.dither) == 41, "the zero dither")
    stop = feeder.dither[-1]
    assert stop.level == DitherCommand.LEVEL_INHIBITED
    assert list(stop.effectors) == list(EFFECTORS)
    assert list(stop.delta) == [0.0] * 7
    assert stop.reason == "no sample for 0.10 s, more than 0.1 s"
    for _ in range(5):
        clock.nanoseconds += 1_000_000_000
        feeder.node._watch_inputs()
    feeder.feed(1)
    assert [d.level for d in feeder.dither[40:]].count(DitherCommand.LEVEL_INHIBITED) == 1


def test_stale_input_is_noticed_by_the_wall_clock(bench: Bench) -> None:
    feeder = Feeder(bench, dither__stale_after=0.03)
    feeder.node._steady = time.monotonic_ns
    feeder.feed(3)
    bench.spin_until(lambda: feeder.dither[-1].level == DitherCommand.LEVEL_INHIBITED, "the zero dither")


def change(bench: Bench, transition: int) -> bool:
    request = Transition(id=transition)
    return bool(bench.call(ChangeState, "identifier/change_state", transition=request).success)


def state_of(bench: Bench) -> int:
    return int(bench.call(GetState, "identifier/get_state").current_state.id)


def test_lifecycle_is_driven_by_services(bench: Bench) -> None:
    node = bench.add(IdentifierNode, autostart=False, dither__stale_after=60.0)
    assert state_of(bench) == State.PRIMARY_STATE_UNCONFIGURED
    assert bench.probe.count_publishers("dither") == 0
    for _ in range(2):
        assert change(bench, Transition.TRANSITION_CONFIGURE)
        assert state_of(bench) == State.PRIMARY_STATE_INACTIVE
        feeder = object.__new__(Feeder)
        feeder.bench, feeder.node, feeder.k = bench, node, 0
        feeder.dither, feeder.model = bench.listen(DitherCommand, "dither"), bench.listen(LinearModel, "model")
        start = len(feeder.dither)
        assert change(bench, Transition.TRANSITION_ACTIVATE)
        feeder.feed(5)
        assert change(bench, Transition.TRANSITION_DEACTIVATE)
        bench.expect(feeder.dither, start + 6, "the last dither")
        assert feeder.dither[-1].level == DitherCommand.LEVEL_INHIBITED
        assert not any(feeder.dither[-1].delta)
        assert "deactivated" in feeder.dither[-1].reason
        assert node.synchronizer.paired == 5
        assert change(bench, Transition.TRANSITION_CLEANUP)
        assert state_of(bench) == State.PRIMARY_STATE_UNCONFIGURED
    assert not change(bench, Transition.TRANSITION_ACTIVATE)  # none from here: refused, and the node lives on
    assert state_of(bench) == State.PRIMARY_STATE_UNCONFIGURED
    assert change(bench, Transition.TRANSITION_UNCONFIGURED_SHUTDOWN)


def test_autostart_is_active_at_once(bench: Bench) -> None:
    bench.add(IdentifierNode)
    assert state_of(bench) == State.PRIMARY_STATE_ACTIVE


def test_inactive_it_uses_nothing(bench: Bench) -> None:
    feeder = Feeder(bench)
    feeder.feed(5)
    feeder.node.trigger_deactivate()
    bench.publish("state", feeder.state(feeder.k + 1))
    bench.publish("effectors", feeder.effectors(feeder.k + 1))
    assert state_of(bench) == State.PRIMARY_STATE_INACTIVE
    assert feeder.node.synchronizer.paired == 5
    feeder.k += 1
    feeder.node.trigger_activate()
    feeder.feed(3)
    assert feeder.node.synchronizer.paired == 8


def test_reset_starts_anew_without_a_time_jump(bench: Bench) -> None:
    feeder = Feeder(bench)
    feeder.feed(30)
    assert feeder.model[-1].samples == 30
    assert bench.call(Trigger, "identifier/reset").success
    feeder.feed(1)
    assert feeder.model[-1].samples == 1


def test_dither_is_switched_by_its_service(bench: Bench) -> None:
    feeder = Feeder(bench, dither__stale_after=60.0)
    feeder.feed(2)
    assert bench.call(SetBool, "identifier/enable_dither", data=False).success
    feeder.feed(1)
    assert feeder.dither[-1].level == DitherCommand.LEVEL_OFF
    assert not any(feeder.dither[-1].delta)
    assert bench.call(SetBool, "identifier/enable_dither", data=True).success
    feeder.feed(1)
    assert feeder.dither[-1].level == DitherCommand.LEVEL_NOMINAL
    assert any(feeder.dither[-1].delta)


def test_every_parameter_has_description_unit_and_range(bench: Bench) -> None:
    node = bench.add(IdentifierNode)
    standard = ("use_sim_time", "start_type_description_service")
    names = [n for n in node._parameters if n not in standard and not n.startswith("qos_overrides.")]
    found = bench.call(DescribeParameters, "identifier/describe_parameters", names=names).descriptors
    assert len(found) == len(names) > 40
    for d in found:
        assert d.description, d.name
        if d.type in (ParameterType.PARAMETER_DOUBLE, ParameterType.PARAMETER_INTEGER):
            assert d.description.endswith("]"), d.name
            assert d.floating_point_range or d.integer_range or "inf" in d.additional_constraints, d.name
    penalty = next(d for d in found if d.name == "estimator.penalty")
    assert (penalty.floating_point_range[0].from_value, penalty.floating_point_range[0].to_value) == (0.0, 1000.0)


def set_parameter(bench: Bench, name: str, value: Any) -> Any:
    request = [Parameter(name, value=value).to_parameter_msg()]
    return bench.call(SetParameters, "identifier/set_parameters", parameters=request).results[0]


REFUSED_IN_FLIGHT = {
    "estimator.forgetting_factor": (2.0, "out of range"),
    "estimator.penalty": (NAN, "out of range"),
    "estimator.method": ("rls", "cannot change"),
    "estimator.scale": ("furlongs", "must be one of"),
    "estimator.penalty_factors": ([1.0, 2.0], "one per regressor"),
    "dither.enabled": (3, "true or false"),
    "states": (list(STATES[::-1]), "cannot change"),
    "autostart": (False, "read-only"),
    "publish_every": (7, "read-only"),
}


@pytest.mark.parametrize("name", REFUSED_IN_FLIGHT)
def test_a_wrong_value_in_flight_is_refused_with_a_reason(fed: Feeder, name: str) -> None:
    value, reason = REFUSED_IN_FLIGHT[name]
    before = fed.bench.call(GetParameters, "identifier/get_parameters", names=[name]).values
    result = set_parameter(fed.bench, name, value)
    assert not result.successful
    assert reason in result.reason
    assert fed.bench.call(GetParameters, "identifier/get_parameters", names=[name]).values == before


def test_a_parameter_that_may_change_in_flight_does(bench: Bench) -> None:
    feeder = Feeder(bench, estimator__method="msls")
    feeder.feed(5)
    assert feeder.model[-1].forgetting_factor[0] == 0.9
    assert set_parameter(bench, "estimator.forgetting_factor", 0.95).successful
    assert set_parameter(bench, "dither.limit_nominal", 0).successful
    feeder.feed(5)
    assert feeder.model[-1].forgetting_factor[0] == 0.95
    assert feeder.model[-1].samples == 10
    assert not any(feeder.dither[-1].delta)


def test_names_may_come_in_another_order_and_with_more_of_them(bench: Bench) -> None:
    feeder = Feeder(bench)
    feeder.feed(20)
    expected = [list(m.b) for m in feeder.model]
    feeder.k = 0
    node = feeder.node
    node.trigger_deactivate()
    bench.call(Trigger, "identifier/reset")
    node.trigger_activate()
    start = len(feeder.model)
    for k in range(1, 21):
        state = messages.state_message(
            k * STEP, ["extra", *STATES[::-1]], np.append(0.0, X[k][::-1]), np.append(0.0, XDOT[k][::-1])
        )
        bench.publish("state", state)
        bench.publish("effectors", feeder.effectors(k))
        bench.expect(feeder.model, start + k)
    assert [list(m.b) for m in feeder.model[start:]] == expected


def test_of_an_input_that_does_not_come_it_is_said_why(bench: Bench, capfd: pytest.CaptureFixture[str]) -> None:
    node = bench.add(IdentifierNode)
    newest = bench.diagnostics("identifier")
    context = Context()  # one participant cannot have two types of one topic
    rclpy.init(context=context, domain_id=bench.domain)
    stack = Node("autopilot", namespace="stack", context=context)

    def says(text: str) -> None:
        bench.spin_until(lambda: newest().get("status") == f"waiting for a sample: {text}", text)
        node._say_what_is_missing()
        assert [n for n in capfd.readouterr().err.splitlines() if text in n and n.startswith("[WARN]")]

    says("/state: no publisher; /effectors: no publisher")
    stack.create_publisher(LinearModel, "/state", INPUT)
    wrong = stack.create_publisher(EffectorSample, "/effectors", best_effort(1))
    type_ = "/state: /stack/autopilot publishes msls_msgs/msg/LinearModel, expected msls_msgs/msg/StateSample"
    quality = "quality of service of /stack/autopilot does not match: best effort publisher and reliable subscription"
    says(f"{type_}; /effectors: {quality}")
    stack.destroy_publisher(wrong)
    stack.create_publisher(EffectorSample, "/effectors", INPUT)
    says(f"{type_}; /effectors: 1 publisher, no message yet")
    bench.publish("effectors", messages.effector_message(STEP, EFFECTORS, DELTA[0]))
    says(f"{type_}; /effectors: 1 messages")
    stack.destroy_node()
    context.shutdown()
