"""Surfaces of which none can be told lost: each would explain nearly as much of the loss of another.

A loss alarms where it explains more of what has changed than that of any other surface does. Of two surfaces of which
either explains more than `RIVAL` of what the other's loss makes (two elevators that a law moves together), none would
ever alarm. They are no rivals of one another, and an alarm of one forgets what was known of both, until what they do
apart says which it was. With the information I about each loss as metric, and ``I_ab`` what is said of both at once,
surfaces a and b are such where the square of their correlation is ::

    I_ab^2 / (I_a I_b) > RIVAL

The same of estimates: of effectors that move together in the last seconds, what one has moved by, since it was known
best, may be what another has. With S the sums of products of the last seconds, a change d_k of effector k is ::

    d_k S_ik / S_ii

of effector i, and as much of it as they have in common, ``S_ik^2 / S_ii S_kk``, is in the error that is published of i
(`instead_square`). Two ailerons that a pilot moves together, of which one has lost half (`test_bank_isolability`): the
other is what moves in one flight of six, and "8.0 +- .2" was published of the lost one, of which 4 was left.

References
----------
Basseville and Nikiforov, *Detection of Abrupt Changes*, 1993, chapter 7.
"""

from __future__ import annotations

import math

from msls_ros.estimation.bank.effects import effect_of
from msls_ros.estimation.bank.loop_settings import BankSettings
from msls_ros.estimation.bank.state import BankState
from msls_ros.estimation.bank.work import BankWork
from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array

RIVAL = 0.75
"""Largest share of what it explains that another surface may: model errors grow with what has changed."""
CHANCE = 4.0
"""Squared standard errors by which an estimate may move by chance."""


@compiled
def instead_square(s: BankSettings, x: BankState, q: int, i: int) -> float:
    """Square by which row q's effector i (constant first) may have changed in place of another that moves with it."""
    g, m = x.group[q], s.recent
    R, own, most = x.R[g], 0.0, 0.0
    for n in range(1, i + 1):
        own += R[n, i, m] * R[n, i, m]
    if own <= 0.0 or x.best_square[q, i] == math.inf:
        return 0.0
    for k in range(s.effectors_from + 1, s.effectors_to + 1):
        step = x.mixed[q, k] - x.best[q, k]
        moved = step * step - CHANCE * x.best_square[q, k]
        if k == i or not moved > 0.0:
            continue
        both = 0.0
        theirs = 0.0
        for n in range(1, k + 1):
            both += R[n, i, m] * R[n, k, m]
            theirs += R[n, k, m] * R[n, k, m]
        if theirs > 0.0:
            share = both / own
            most = max(most, both * both / (own * theirs) * moved * share * share)
    return most


@compiled
def is_alike(work: BankWork, best: int, other: int) -> bool:
    """Whether another surface explains so much of what a loss of the best one makes that it would always rival it.

    That is the squared correlation of the two directions, with the information about each loss as metric.
    """
    both = work.overlap[other]
    if both == 0.0 or other == best:
        return False
    mine = theirs = 0.0
    for q in range(work.information.shape[0]):
        mine += work.information[q, best]
        theirs += work.information[q, other]
    return bool(both * both > RIVAL * mine * theirs)


@compiled
def find_overlaps(s: BankSettings, n: float, before: Array, q: int, work: BankWork) -> None:
    """Add what row q, of older estimates (p,), says of the loss of the surface asked of and of each other at once."""
    asked = work.asked[0]
    if work.information[q, asked] <= 0.0:
        return
    effect = effect_of(s, before, asked)
    for k in range(s.gains.shape[0]):
        if work.information[q, k] <= 0.0:
            continue
        both = 0.0
        for i in range(1, work.w.shape[0]):
            both += work.white_steps[asked, i] * work.white_steps[k, i]
        work.overlap[k] += effect * effect_of(s, before, k) * both / n
