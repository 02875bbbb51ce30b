"""Effectors whose losses may have made an alarm: what rows that did not alarm may have lost of them, too."""

from __future__ import annotations

from msls_ros.estimation.bank.isolability import is_alike
from msls_ros.estimation.bank.loop_settings import BankSettings
from msls_ros.estimation.bank.state import BankState
from msls_ros.estimation.bank.work import BankWork
from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array, Integers

LOST = 0.25
"""Squared share of its effect that a suspect may have lost while nothing is known of it [1]: its half."""
REFERENCE = 0.25
"""Largest squared relative error of what was known of it before [1]."""


@compiled
def find_suspects(s: BankSettings, x: BankState, phi: Array, e: Array, alarm: Integers) -> None:
    """Note which effectors' losses may have made the alarm: by prediction errors e (r,) and phi (p,), constant first.

    The loss of an effector makes at most what it does: all of its deflection, at trim too, for that moment is lost as
    well. With it all effectors are suspected that have a surface in common with it.
    """
    fresh = True
    for q in range(alarm.shape[0]):
        fresh = fresh and x.pending[q] == 0
    for j in range(x.suspected.shape[0]):
        x.suspected[j] = 0 if fresh else x.suspected[j]
    for j in range(x.suspected.shape[0]):
        i = s.effectors_from + 1 + j
        deflected = max(abs(phi[i]), abs(phi[i] - x.phi_mean[i]))
        made = False
        for q in range(alarm.shape[0]):
            made = made or (alarm[q] != 0 and 2.0 * abs(x.mixed[q, i]) * deflected > abs(e[q]))
        if made:
            suspect(s, x, j)


@compiled
def suspect(s: BankSettings, x: BankState, j: int) -> None:
    """Note effector j, and all that have a surface in common with it."""
    x.suspected[j] = 1
    for k in range(s.gains.shape[0]):
        if s.gains[k, j] != 0.0:
            for other in range(x.suspected.shape[0]):
                if s.gains[k, other] != 0.0:
                    x.suspected[other] = 1


@compiled
def suspect_surfaces(s: BankSettings, x: BankState, lost: int, work: BankWork) -> None:
    """Note the effectors of the surface whose loss alarms, and of those that it cannot be told from."""
    for j in range(x.suspected.shape[0]):
        x.suspected[j] = 0
        for k in range(s.gains.shape[0]):
            if s.gains[k, j] != 0.0 and (k == lost or is_alike(work, lost, k)):
                x.suspected[j] = 1


@compiled
def suspect_square(s: BankSettings, x: BankState, q: int, i: int) -> float:
    """Square by which coefficient i (constant first) may have changed in a row q that goes on after an alarm.

    What a suspect has lost in rows that alarmed it may have lost in all, until these say that it has not, or a name is
    spoken, or the alarm is over.
    """
    if not s.effectors_from < i <= s.effectors_to or x.pending[q] != 0 or x.suspected[i - s.effectors_from - 1] == 0:
        return 0.0
    share = 0.0
    for r in range(x.pending.shape[0]):
        effect = x.theta_before[r, i] * x.theta_before[r, i]
        if x.pending[r] == 0 or x.square_before[r, i] >= REFERENCE * effect:
            continue
        moved = x.mixed[r, i] - x.theta_before[r, i]
        lost = LOST
        if x.square[r, i] < LOST * effect:
            lost = (moved * moved + x.square[r, i]) / effect
        share = min(share, lost) if share > 0.0 else lost
    return float(min(share, 1.0) * x.mixed[q, i] * x.mixed[q, i])
