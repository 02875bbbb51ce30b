"""What a lost surface may take with it, or bring: an effect through the incidence of the air.

A surface acts by its angle to the air: deflecting it by one radian and turning the air by one radian do alike, B on a
row. One that is gone no longer acts through incidence either; one that floats, free of its actuator, acts through
incidence alone. So the coefficients of the velocities across the airflow, w and v, may change with the loss, each by
about ``B / V``. A manoeuvre of a second moves a surface and the incidence together, and what the surface has lost and
what incidence has gained are then hard to tell apart: half a second after an elevator begins to float by -.5 of the
angle of attack it seems to act the wrong way, by a quarter.

So changes of these coefficients count as noise of that size, along their columns r_j of the factor: of a direction a
and a change w, in a row with noise n::

    a' N^-1 w   and   a' N^-1 a,      N = 1 + sum_j (2 / n) (B / V)^2 r_j r_j'

take the place of ``a'w`` and ``a'a`` in `bank.losses` where it is said what is left. Which surface it is, and that one
is lost at all, the test says without.

References
----------
Etkin and Reid, *Dynamics of Flight*, 1996, section 2.3 (a tail's lift by incidence and by deflection).
"""

from __future__ import annotations

import math

from msls_ros.estimation.bank.loop_settings import BankSettings
from msls_ros.estimation.bank.loss_reference import LEAST_LEFT, take_off
from msls_ros.estimation.bank.state import BankState
from msls_ros.estimation.bank.work import BankWork
from msls_ros.estimation.compiled import compiled


@compiled
def discount_incidence(s: BankSettings, x: BankState, n: float, effect: float, q: int, k: int, work: BankWork) -> None:
    """Find ``work.lone_against`` and ``work.lone_information`` of row q and surface k, after `losses.compare_row`.

    Parameters
    ----------
    s, x
        Settings and state.
    n, effect
        Variance in the row, and what was the surface's effect [per rad].
    q, k
        Row and surface.
    work
        ``w``, ``white_steps`` and ``white_columns`` are read.
    """
    work.lone_against[q, k] = work.against[q, k]
    work.lone_information[q, k] = work.information[q, k]
    if work.information[q, k] <= 0.0 or x.speed[0] <= 0.0:
        return
    p = work.w.shape[0]
    direction, w, column, earlier = work.whitened[0], work.whitened[1], work.whitened[2], work.whitened[3]
    for i in range(p):
        direction[i] = work.white_steps[k, i]
        w[i] = work.w[i]
    scale = effect / x.speed[0]
    forward = forward_velocity(s, x)
    part = 0.0
    for j in range(s.velocities.shape[0]):
        if j == forward:
            continue
        for i in range(1, p):
            earlier[i] = column[i]
            column[i] = work.white_columns[s.velocities[j], i]
        if part > 0.0:
            take_off(column, earlier, part)
        own = 0.0
        for i in range(1, p):
            own += column[i] * column[i]
        part = 0.0
        if own > LEAST_LEFT * work.white_columns[s.velocities[j], 0]:
            part = (1.0 - 1.0 / math.sqrt(1.0 + 2.0 * scale * scale * own / n)) / own
        take_off(direction, column, part)
        take_off(w, column, part)
    along = 0.0
    size = 0.0
    for i in range(1, p):
        along += direction[i] * w[i]
        size += direction[i] * direction[i]
    work.lone_against[q, k] += effect * (along - work.along[k]) / n
    left = size / work.size[k] if work.size[k] > 0.0 else 0.0
    work.lone_information[q, k] *= max(left, LEAST_LEFT)


@compiled
def forward_velocity(s: BankSettings, x: BankState) -> int:
    """Return the place among the velocities of the one along the airflow: the largest in the mean."""
    best = 0
    for j in range(1, s.velocities.shape[0]):
        if abs(x.phi_mean[s.velocities[j]]) > abs(x.phi_mean[s.velocities[best]]):
            best = j
    return best
