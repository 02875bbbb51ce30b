"""What follows a name: the effects of all other surfaces are what they were before the alarm.

An alarm begins its rows anew, and for as many samples as there are coefficients their estimates hang on few data. Once
it is settled which surface was lost (`bank.isolation`), what was known of the others holds again. For each group of
rows that alarmed, with ``v_j`` the variance of effector j's effect before, over that of the row's errors
(`bank.residual.kept_variance`; the largest of the rows; with what late responses do to it, and `TOLERANCE` of its size,
for effects are not wholly linear), and a the direction of the named surface, of which nothing is taken back::

    information added = P' D P,    D = diag(1 / v_j),    P = I - a a'D / (a'D a)

as rows ``sqrt(D_j) e_j' P`` whose outputs are what they were by the estimates before. States keep what `keep_states`
has left them: a fault may change their effects, and no test has been made of that.
"""

from __future__ import annotations

import math

from msls_ros.estimation.bank.forgetting import count_rows
from msls_ros.estimation.bank.loop_settings import BankSettings
from msls_ros.estimation.bank.losses import TOLERANCE
from msls_ros.estimation.bank.members import correct, find_information, rotate, solve_gains
from msls_ros.estimation.bank.residual import kept_variance
from msls_ros.estimation.bank.state import BankState
from msls_ros.estimation.bank.uncertainty import common_square
from msls_ros.estimation.bank.work import BankWork
from msls_ros.estimation.compiled import compiled


@compiled
def restore_effectors(s: BankSettings, x: BankState, k: int, work: BankWork) -> None:
    """Take back what the rows marked in ``work.concerned`` knew of all effectors but in the direction of surface k."""
    for g in range(x.age.shape[0]):
        inside, others = count_rows(x, g, work)
        if inside > 0 and others == 0 and not has_restored(s, x, g):
            restore_group(s, x, g, k, work)


@compiled
def has_restored(s: BankSettings, x: BankState, g: int) -> bool:
    """Whether group g has taken back what it knew already."""
    total = 0.0
    for i in range(s.effectors_from + 1, s.effectors_to + 1):
        total += x.kept_info[g, i]
    return total > 0.0


@compiled
def restore_group(s: BankSettings, x: BankState, g: int, k: int, work: BankWork) -> None:
    """As `restore_effectors` for one group; ``work.w`` holds D, at the places of the effectors."""
    first = s.effectors_from + 1
    size = 0.0
    for j in range(s.gains.shape[1]):
        work.w[first + j] = information_before(s, x, g, first + j)
        size += s.gains[k, j] * s.gains[k, j] * work.w[first + j]
    for m in range(work.root.shape[0]):
        work.root[m] = 1.0
        work.first[m] = 1.0
    for j in range(s.gains.shape[1]):
        known = work.w[first + j]
        if known <= 0.0:
            continue
        for i in range(work.phi.shape[0]):
            work.phi[i] = 0.0
        for i in range(s.gains.shape[1]):
            along = s.gains[k, j] * s.gains[k, i] * work.w[first + i] / size if size > 0.0 else 0.0
            work.phi[first + i] = math.sqrt(known) * ((1.0 if i == j else 0.0) - along)
            x.kept_info[g, first + i] += work.phi[first + i] * work.phi[first + i]
        for i in range(work.phi.shape[0]):
            for m in range(work.root.shape[0]):
                work.row[i, m] = work.phi[i]
        for m in range(work.left.shape[0]):
            work.left[m] = 1.0
        rotate(x.R[g], work, 0)
        solve_gains(x.R[g], work.z, work.K)
        for q in range(x.group.shape[0]):
            if x.group[q] == g:
                before = 0.0
                for i in range(work.phi.shape[0]):
                    before += work.phi[i] * x.theta_before[q, i]
                correct(x.members[q], work.phi, before, work.K, work.e)
    find_information(x.R[g], work.V, x.info[g])


@compiled
def information_before(s: BankSettings, x: BankState, g: int, i: int) -> float:
    """Information about coefficient i, in residual variances, that all rows of group g had before their alarm."""
    least = math.inf
    for q in range(x.group.shape[0]):
        if x.group[q] != g:
            continue
        slack = TOLERANCE * x.theta_before[q, i]
        variance = x.square_before[q, i] + common_square(x, q, i) + slack * slack
        if x.pending[q] == 0 or x.base[q, 1] <= 0.0 or not 0.0 < variance < math.inf:
            return 0.0
        least = min(least, kept_variance(s, x, q) / variance)
    return least if least < math.inf else 0.0
