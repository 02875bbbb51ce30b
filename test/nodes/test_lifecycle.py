"""Every transition from every state, twice over; one that fails is logged with its reason and leaves nothing behind."""

from __future__ import annotations

from typing import Any

import pytest
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rclpy.lifecycle import LifecycleNode
from rclpy.parameter import Parameter

from msls_ros.nodes.bonding import Bond
from msls_ros.nodes.controller import ControllerNode
from msls_ros.nodes.identifier import IdentifierNode
from msls_ros.nodes.parameters import NodeError
from msls_ros.testing import Bench

UNCONFIGURED, INACTIVE, ACTIVE, FINALIZED = (
    State.PRIMARY_STATE_UNCONFIGURED,
    State.PRIMARY_STATE_INACTIVE,
    State.PRIMARY_STATE_ACTIVE,
    State.PRIMARY_STATE_FINALIZED,
)
CONFIGURE, CLEANUP = Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_CLEANUP
ACTIVATE, DEACTIVATE = Transition.TRANSITION_ACTIVATE, Transition.TRANSITION_DEACTIVATE
VALID = {
    (UNCONFIGURED, CONFIGURE): INACTIVE,
    (INACTIVE, ACTIVATE): ACTIVE,
    (INACTIVE, CLEANUP): UNCONFIGURED,
    (ACTIVE, DEACTIVATE): INACTIVE,
}
SHUTDOWN = {
    UNCONFIGURED: Transition.TRANSITION_UNCONFIGURED_SHUTDOWN,
    INACTIVE: Transition.TRANSITION_INACTIVE_SHUTDOWN,
    ACTIVE: Transition.TRANSITION_ACTIVE_SHUTDOWN,
}
WAY = {UNCONFIGURED: [], INACTIVE: [CONFIGURE], ACTIVE: [CONFIGURE, ACTIVATE]}
BACK = {UNCONFIGURED: [], INACTIVE: [CLEANUP], ACTIVE: [DEACTIVATE, CLEANUP]}


def change(bench: Bench, transition: int) -> bool:
    return bool(bench.call(ChangeState, "identifier/change_state", transition=Transition(id=transition)).success)


def state_of(bench: Bench) -> int:
    return int(bench.call(GetState, "identifier/get_state").current_state.id)


@pytest.mark.parametrize("state", WAY, ids=["unconfigured", "inactive", "active"])
def test_every_transition_is_made_or_refused_twice_over_and_then_it_shuts_down(bench: Bench, state: int) -> None:
    bench.add(IdentifierNode, autostart=False)
    for _ in range(2):
        for transition in (CONFIGURE, CLEANUP, ACTIVATE, DEACTIVATE):
            assert all(change(bench, t) for t in WAY[state])
            expected = VALID.get((state, transition), state)
            assert change(bench, transition) == ((state, transition) in VALID)
            assert state_of(bench) == expected
            assert all(change(bench, t) for t in BACK[expected])
    assert all(change(bench, t) for t in WAY[state])
    assert change(bench, SHUTDOWN[state])
    assert state_of(bench) == FINALIZED
    assert not any(change(bench, t) for t in (CONFIGURE, CLEANUP, ACTIVATE, DEACTIVATE))


LIFECYCLE: list[tuple[type[LifecycleNode], dict[str, Any], str]] = [
    (IdentifierNode, {}, "/state"),
    (ControllerNode, {"condition": "high_alpha"}, "/state"),
]


@pytest.mark.parametrize(("kind", "given", "topic"), LIFECYCLE, ids=["identifier", "controller"])
def test_what_rclpy_says_of_a_configuration_is_logged_and_nothing_is_left(
    bench: Bench, capfd: pytest.CaptureFixture[str], kind: type[LifecycleNode], given: dict[str, Any], topic: str
) -> None:
    wrong = {f"qos_overrides.{topic}.subscription.reliability": "bestest", **given}
    node = bench.add(kind, autostart=False, **wrong)

    def ends() -> list[str]:
        return sorted([p.topic_name for p in node.publishers] + [s.topic_name for s in node.subscriptions])

    before, timers = ends(), len(list(node.timers))
    assert node.trigger_configure().name == "FAILURE"
    (line,) = [each for each in capfd.readouterr().err.splitlines() if "[ERROR]" in each]
    assert "on_configure failed: RuntimeError: Unexpected QoS override for policy `reliability`: `bestest`" in line
    assert (ends(), len(list(node.timers))) == (before, timers)
    with pytest.raises(NodeError, match="could not be configured"):
        bench.add(kind, **wrong)


@pytest.mark.parametrize(("kind", "given", "topic"), LIFECYCLE, ids=["identifier", "controller"])
def test_an_activation_that_fails_is_logged_and_may_be_tried_again(
    bench: Bench,
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    kind: type[LifecycleNode],
    given: dict[str, Any],
    topic: str,
) -> None:
    def broken(bond: Bond) -> None:
        message = "no heartbeat\n  at all"
        raise OSError(message)

    node = bench.add(kind, autostart=False, **given)
    assert node.trigger_configure().name == "SUCCESS"
    with monkeypatch.context() as patch:
        patch.setattr(Bond, "form", broken)
        assert node.trigger_activate().name == "FAILURE"
    assert "on_activate failed: OSError: no heartbeat at all\n" in capfd.readouterr().err
    assert not vars(node)["_active"]
    assert node.trigger_activate().name == "SUCCESS"


def test_after_a_configuration_that_failed_parameters_may_be_mended(bench: Bench) -> None:
    node = bench.add(IdentifierNode, autostart=False, warm_start="missing.yaml")
    assert node.trigger_configure().name == "FAILURE"
    assert node.set_parameters([Parameter("estimator.method", value="rls")])[0].successful
