"""Drag of surfaces: what a deflection does to the axial velocity is no constant, and is never lost.

Drag is even in the deflection (``|delta|`` or its square in tables, the drag polar in theory): its slope, which is what
a linear model has, goes with the trim, changes its sign with it, and jumps where the trim passes through zero. So of
the row of u the effect of a surface may change in flight by as much as it is. The detector allows for that much where
no other row alarms, and what that row says of a surface is no evidence of its loss: what is lost shows in the moments.
Where another row has alarmed, the row of u joins it as any other does.

A surface is an effector of which an angular acceleration is known. What makes none, as a throttle, has its effect on u,
and loses it there.

T-37, `T37_rudder_lost`, low noise, seeds 100 to 119: 5 false alarms of u without it, none with it.

References
----------
Etkin and Reid, *Dynamics of Flight: Stability and Control*, 3rd ed., 1996, section 2.1 (drag polar).
"""

from __future__ import annotations

from msls_ros.estimation.bank.loop_settings import BankSettings
from msls_ros.estimation.bank.state import BankState
from msls_ros.estimation.compiled import compiled

MOMENT = 0.2
"""Relative standard error to which an angular acceleration by an effector is known, as `bank.losses.KNOWN_WELL` [1]."""


@compiled
def is_surface(s: BankSettings, x: BankState, i: int) -> bool:
    """Whether an angular acceleration by the effector of regressor i (constant first) is known."""
    for k in range(s.rates.shape[0]):
        row = s.rates[k] - 1
        if x.square[row, i] < MOMENT * MOMENT * x.mixed[row, i] * x.mixed[row, i]:
            return True
    return False


@compiled
def drag_square(s: BankSettings, x: BankState) -> float:
    """Squared error of the row of u that drag allows the motion of now (`BankState.quick`)."""
    total = 0.0
    for i in range(s.effectors_from + 1, s.effectors_to + 1):
        if is_surface(s, x, i):
            moved = x.mixed[s.axial, i] * x.quick[i]
            total += moved * moved
    return total


@compiled
def is_drag(s: BankSettings, x: BankState, q: int, k: int) -> bool:
    """Whether what row q knows of surface k of `BankSettings.gains` is its drag."""
    if q != s.axial:
        return False
    for j in range(s.gains.shape[1]):
        i = s.effectors_from + 1 + j
        if s.gains[k, j] != 0.0 and is_surface(s, x, i):
            return True
    return False
