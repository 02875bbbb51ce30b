"""Every transition from every state, twice over; every parameter with a bad value."""

from __future__ import annotations

from typing import Any

import pytest
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.parameter import Parameter

from msls_ros.nodes.identifier import PARAMETERS, IdentifierNode
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


@pytest.fixture(scope="module")
def running(shared_bench: Bench) -> Bench:
    shared_bench.add(IdentifierNode)
    return shared_bench


def bad_values(name: str) -> list[Any]:
    """Return values that a parameter must not take."""
    default, bounds = PARAMETERS[name]
    if isinstance(default, bool):
        return [3, "yes"]
    if isinstance(default, str):
        return [7, *(["nonsense"] if bounds.choices else [])]
    if isinstance(default, (int, float)):
        beyond = [limit for limit in (bounds.low - 1.0, bounds.high * 2.0 + 1.0) if abs(limit) < 1e300]
        return ["word", float("nan"), float("inf"), *beyond]
    return [["a", "a"], [float("nan")] * 7, 5.0]


@pytest.mark.parametrize("name", PARAMETERS)
def test_every_parameter_refuses_bad_values_with_a_reason_and_stays_as_it_is(running: Bench, name: str) -> None:
    def value() -> Any:
        return running.call(GetParameters, "identifier/get_parameters", names=[name]).values[0]

    before = value()
    for bad in bad_values(name):
        request = [Parameter(name, value=bad).to_parameter_msg()]
        result = running.call(SetParameters, "identifier/set_parameters", parameters=request).results[0]
        assert not result.successful, (name, bad)
        assert len(result.reason) > 10, (name, bad)
    assert value() == before
