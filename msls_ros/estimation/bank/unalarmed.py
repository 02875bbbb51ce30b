"""What the rows that did not alarm say of a name: a surface that is lost is lost in all rows.

A row may alarm because something else has changed. The drag of an elevator goes with the size of its deflection, so
that what is linear in it jumps when the trim passes through zero; in that row the elevator then seems lost, and no
other surface explains it as well. But what is left of a surface's effect is the same in every row (`bank.losses`), and
the rows that know the effect and did not alarm go on and still hold what was known before. The member with the short
memory tau says of all of these that the effect has changed by c, with standard error s. Of the information I about the
loss that it holds, the part ::

    f = 1 - exp(-t/tau) I_then / I

has come in the time t since the last alarm. Of a change d it shows f d, so d is denied where ``c - 2 s > f d / 2``.
What makes effects of one surface unlike in s (`bank.losses.TOLERANCE`) is a part of what has come since, too.

They are asked only where they held more of the effect than the rows that alarmed, by its square over their noise:
a roll moment that is lost is not denied by a little yaw that remains.

References
----------
Basseville and Nikiforov, *Detection of Abrupt Changes*, 1993, chapter 7.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from msls_ros.estimation.bank.effects import effect_of
from msls_ros.estimation.bank.loop_settings import BankSettings
from msls_ros.estimation.bank.losses import (
    KNOWN_WELL,
    TOLERANCE,
    compare_surfaces,
    find_directions,
    noise_of,
)
from msls_ros.estimation.bank.state import BankState
from msls_ros.estimation.bank.work import BankWork
from msls_ros.estimation.kernel import Array

DENIED = 0.5
"""Part of a change that the other rows must leave possible [1]: their effects and those that alarmed are not alike."""
CERTAIN = 2.0
"""Standard errors by which they must exclude it."""
LEAST_SINCE = 0.2
"""Of less that has come since the alarm they say nothing [1]."""
QUICK = 0
"""Which of `BankSettings.loss_members` is asked."""


class Alarm(NamedTuple):
    """What was known at an alarm; r rows, p regressors, k surfaces."""

    samples: int
    """Taken by then."""
    information: Array
    """(r, k) about the loss of each surface, in the quick member."""
    before: Array
    """(r, p) estimates before the first alarm that is watched, constant first."""
    square: Array
    """(r, p) squared standard errors of these."""


def keep_alarm(s: BankSettings, x: BankState, work: BankWork, first: Alarm | None) -> Alarm:
    """Return what is known at an alarm; after a ``first`` one that is still watched, with what was known before it."""
    information = loss_information(s, x, work)
    if first is not None:
        return first._replace(samples=int(x.samples[0]), information=information)
    kept = len(x.kept_theta)
    back = min(int(s.loss_delays[QUICK]), int(x.kept[0]) - 1, kept - 1)
    slot = (int(x.kept[0]) - 1 - back) % kept
    square = x.kept_square[slot].copy() if back >= 0 else np.full_like(x.kept_square[slot], math.inf)
    return Alarm(int(x.samples[0]), information, x.kept_theta[slot].copy(), square)


def loss_information(s: BankSettings, x: BankState, work: BankWork) -> Array:
    """(r, k) information about the loss of each surface that the quick member of each row holds."""
    found = np.zeros((len(x.group), len(s.gains)))
    for g in sorted(set(x.group.tolist())):
        find_directions(s, x.R[g], int(s.loss_members[QUICK]), work)
        found[x.group == g] = work.steps[:, 0]
    return found


def effect_size(s: BankSettings, x: BankState, alarm: Alarm, q: int, surface: int) -> float:
    """Square of what a surface did in row q before the alarm, over the row's noise [1/rad^2]."""
    noise = noise_of(s, x, q, QUICK)
    effect = effect_of(s, alarm.before[q], surface)
    return effect * effect / noise if noise > 0.0 else 0.0


def is_denied(
    s: BankSettings, x: BankState, work: BankWork, alarm: Alarm, rows: Sequence[int], surface: int, change: float
) -> bool:
    """Whether the rows that did not alarm exclude that a surface has changed so.

    Parameters
    ----------
    s, x, work
        Settings, state and scratch of the bank.
    alarm
        The last one.
    rows
        Those that alarmed.
    surface, change
        Which, and the change of its effect as a share of it, negative for a loss [1].
    """
    work.concerned[:] = 0
    alarmed = others = 0.0
    for q in range(len(x.group)):
        size = effect_size(s, x, alarm, q, surface)
        if q in rows:
            alarmed += size
        elif x.pending[q] == 0 and x.waiting[x.group[q]] == 0:
            work.concerned[q] = 1
            others += size
    if others <= alarmed:
        return False
    compare_surfaces(s, x, QUICK, alarm.before, alarm.square, KNOWN_WELL, False, False, work)
    found, variance = float(work.change[surface]), float(work.variance[surface])
    weight = work.information[:, surface].copy()
    if not weight.any():
        return False
    fade = math.prod([float(s.forgetting[s.loss_members[QUICK]])] * (int(x.samples[0]) - alarm.samples))
    now = loss_information(s, x, work)[:, surface]
    older = np.minimum(fade * alarm.information[:, surface] / np.where(now > 0.0, now, math.inf), 1.0)
    since = 1.0 - math.fsum((weight * older).tolist()) / math.fsum(weight.tolist())
    error = math.sqrt(max(variance - TOLERANCE * TOLERANCE, 0.0) + (TOLERANCE * since) ** 2)
    return bool(since >= LEAST_SINCE and found - CERTAIN * error > DENIED * since * change)
