"""Every transition from every state, twice over."""

from __future__ import annotations

import pytest
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState

from msls_ros.nodes.identifier import IdentifierNode
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
