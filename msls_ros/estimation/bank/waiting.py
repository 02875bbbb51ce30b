"""Alarms wait while effectors that no output has answered may have begun to move, see `bank.detection`."""

from __future__ import annotations

from msls_ros.estimation.bank.allowances import first_limit
from msls_ros.estimation.bank.loop_settings import BankSettings
from msls_ros.estimation.bank.state import BankState
from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array, Integers

BEGINS = 6.25
"""Squared deviations, over their mean in the last seconds, from which an effector may begin to move: one in 80 is."""
MAY_BEGIN = 2.71
"""The same from which it may begin within the noise of its record: one in ten is (those below had 3.6 to 5.8)."""
WITHIN_NOISE = 2
"""Samples for which the noise of its record may hide that an effector has begun to move: then it is out.

Four aircraft in flight test, .05 deg of noise in their surfaces, 24 flights: 5 alarmed at first inputs without it.
"""


@compiled
def begins_to_move(s: BankSettings, x: BankState) -> bool:
    """Whether an effector that no output has answered yet may have begun to move: an alarm can wait for that."""
    for j in range(x.answered.shape[0]):
        i = s.effectors_from + 1 + j
        if x.answered[j] == 0 and x.quick[i] * x.quick[i] > first_limit(s, x, i, BEGINS):
            return True
    return False


@compiled
def wait_for_motion(s: BankSettings, x: BankState, learning: bool, statistic: Array, alarm: Integers) -> bool:
    """Hold alarms (r,) back while an effector may have begun to move; return whether they are raised now.

    Whether one has shows in the next samples: then it goes on (``learning``), and what alarmed is learnt.
    """
    if x.waits[0] == 0:
        if not may_begin_to_move(s, x):
            return True
        x.waits[0] = WITHIN_NOISE + 1
        x.held_statistic[:] = 0.0
    x.waits[0] = 0 if learning else x.waits[0] - 1
    raised = x.waits[0] == 0 and not learning
    for q in range(alarm.shape[0]):
        if alarm[q] != 0:
            x.held_statistic[q] = max(x.held_statistic[q], statistic[q])
        alarm[q] = 1 if raised and x.held_statistic[q] > 0.0 else 0
        if raised:
            statistic[q] = max(statistic[q], x.held_statistic[q])
    return bool(raised)


@compiled
def may_begin_to_move(s: BankSettings, x: BankState) -> bool:
    """Whether an effector that no output has answered goes further than its noise does in nine of ten samples."""
    for j in range(x.answered.shape[0]):
        i = s.effectors_from + 1 + j
        resting = x.answered[j] == 0 and x.third_noise[j] > 0.0
        if resting and x.quick[i] * x.quick[i] > first_limit(s, x, i, MAY_BEGIN):
            return True
    return False
