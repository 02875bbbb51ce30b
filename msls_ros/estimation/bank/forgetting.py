"""What follows a loss of a surface: what is known of that one direction is forgotten, and nothing else.

`bank.losses` says which surface keeps the share ``1 + c`` of its effect. The effectors' columns move by c along its
direction a in all estimates of the rows concerned, and the factors lose their information along a, so that it is learnt
anew with all else known.

All about the present deflection: by when a loss is seen, the constants, which walk, have followed the moment that it
took from the mean deflection. If the effect then changed about zero, the moment would come back in every prediction,
and be evidence that nothing was lost, from the first samples on. So the constant of each estimate becomes what meets
the last samples in the mean, and what is forgotten goes along ``d``: a, and a constant of ``-a' mean(phi)``.

A surface that is named after an alarm has lost its effect on all rows, though some show it too little to alarm. They
take over what is left of it by `spread_loss`, and its error, from what they knew before the alarm.
"""

from __future__ import annotations

import math

from msls_ros.estimation.bank.batches import shift_batches
from msls_ros.estimation.bank.changes import begin_window
from msls_ros.estimation.bank.effects import effect_of, square_of_effect
from msls_ros.estimation.bank.feedback import forget_feedback
from msls_ros.estimation.bank.loop_settings import BankSettings
from msls_ros.estimation.bank.losses import KNOWN, noise_of
from msls_ros.estimation.bank.members import find_information
from msls_ros.estimation.bank.ramps import begin_ramps
from msls_ros.estimation.bank.residual import residual_variance
from msls_ros.estimation.bank.state import BankState
from msls_ros.estimation.bank.work import BankWork
from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array, copy_rows

CHANGE = 1.0
"""By how much a fault may change a state's effect, over what states have in the mean: see `keep_states`.

Least squares from the sample of the fault errs alike with .1 to 1 (three faults of the F-16, low and medium noise) and
more from 3 on.
"""


@compiled
def apply_loss(s: BankSettings, x: BankState, k: int, change: float, error: float, work: BankWork) -> None:
    """Let the rows concerned know that surface k has changed: shift their estimates, forget that direction alone.

    Parameters
    ----------
    s, x
        Settings and state; ``x.theta_before`` says what the rows knew.
    k
        Which surface.
    change, error
        Of its effect, and standard error of that, as shares of the effect [1].
    work
        ``concerned`` says which rows.
    """
    made = 0  # bit g: group g has been made here
    for g in range(x.age.shape[0]):
        inside, others = count_rows(x, g, work)
        if inside == 0 or made >> g & 1:
            continue
        target = g if others == 0 else empty_group(x)
        if target < 0:
            target = g
        if target != g:
            made |= 1 << target
            copy_group(x, g, target)
        precision = 0.0
        for q in range(x.group.shape[0]):
            if x.group[q] == g and work.concerned[q] != 0:
                x.group[q] = target
                effect = effect_of(s, x.theta_before[q], k)
                square = error * error * effect * effect
                noise = residual_variance(x, q)
                precision = max(precision, square / noise if noise > 0.0 else 0.0)
                shift_row(s, x, q, k, effect * (1.0 + change))
        mean = mean_deflection(s, x, k)
        for m in range(s.forgetting.shape[0]):
            forget_direction(s, x.R[target], m, k, mean, precision, work)
        find_information(x.R[target], work.V, x.info[target])
        begin_window(s, x, target)
        begin_ramps(x, target)
    x.kept[1] = x.kept[0]
    for a in range(x.run.shape[0]):
        x.run[a] = 0


@compiled
def spread_loss(s: BankSettings, x: BankState, k: int, change: float, error: float, back: int, work: BankWork) -> None:
    """Let the rows that have not alarmed know that surface k has changed, if any of them knew its effect.

    All of them: those that did not know it hardly forget anything, and they keep their history together.

    Parameters
    ----------
    s, x, k, change, error
        As `apply_loss`.
    back
        Strides since before the alarm.
    work
        ``concerned`` says which rows have alarmed.
    """
    if back >= x.kept_theta.shape[0] or back >= x.kept[0]:
        return
    slot = (x.kept[0] - 1 - back) % x.kept_theta.shape[0]
    before = x.kept_theta[slot]
    knowing = 0
    for q in range(x.group.shape[0]):
        alarmed = work.concerned[q] != 0 or x.pending[q] != 0 or x.waiting[x.group[q]] != 0
        work.concerned[q] = 0 if alarmed or noise_of(s, x, q, s.loss_members.shape[0] - 1) <= 0.0 else 1
        if work.concerned[q] != 0:
            effect = effect_of(s, before[q], k)
            known = square_of_effect(s, x.kept_square[slot, q], k) < KNOWN * KNOWN * effect * effect
            knowing += 1 if known else 0
            for i in range(before.shape[1]):
                x.theta_before[q, i] = before[q, i]
    if knowing > 0:
        apply_loss(s, x, k, change, error, work)


@compiled
def count_rows(x: BankState, g: int, work: BankWork) -> tuple[int, int]:
    """Count the rows of group g that are marked in ``work.concerned``, and those that are not."""
    inside = 0
    others = 0
    for q in range(x.group.shape[0]):
        if x.group[q] == g:
            inside += work.concerned[q]
            others += 1 - work.concerned[q]
    return inside, others


@compiled
def keep_states(s: BankSettings, x: BankState, g: int) -> None:
    """Let group g, which begins anew, know the states' effects as far as a fault leaves them.

    A fault may change the effect of any state by as much as the states have in the mean: the prior of coefficient i of
    row q has the variance ``CHANGE^2 size^2 / scale_i^2 + square_i``, ``size^2`` the mean of ``(a_qi scale_i)^2`` over
    the states, ``square_i`` the squared standard error before. Rows that share the factor get the widest. Effectors
    get the members' own priors: a fault may do anything to them.
    """
    for i in range(1, s.effectors_from + 1):
        keep = math.inf
        for q in range(x.group.shape[0]):
            if x.group[q] == g:
                keep = min(keep, kept_information(s, x, q, i))
        if not 0.0 < keep < math.inf:
            continue
        x.kept_info[g, i] = keep
        for m in range(s.forgetting.shape[0]):
            x.info[g, i, m] = s.prior[i, m] * s.prior[i, m] + keep
            x.R[g, i, i, m] = math.sqrt(x.info[g, i, m])


@compiled
def kept_information(s: BankSettings, x: BankState, q: int, i: int) -> float:
    """Information about the effect of state i that row q keeps through a fault, in its residual's variance; 0: none.

    None of a row that begins anew only because its group does: what was known before is kept of alarmed rows alone.
    """
    if x.pending[q] == 0 or x.base[q, 1] < s.rest or x.square_before[q, i] == math.inf:
        return 0.0
    total = 0.0
    for k in range(1, s.effectors_from + 1):
        effect = x.theta_before[q, k] * s.sigma[k]
        total += effect * effect / s.effectors_from
    variance = CHANGE * CHANGE * total / (s.sigma[i] * s.sigma[i]) + x.square_before[q, i]
    return float(x.base[q, 0] / x.base[q, 1] / variance) if variance > 0.0 else 0.0


@compiled
def empty_group(x: BankState) -> int:
    """Return a group without rows; negative: there is none."""
    for g in range(x.age.shape[0]):
        rows = 0
        for q in range(x.group.shape[0]):
            if x.group[q] == g:
                rows += 1
        if rows == 0:
            return g
    return -1


@compiled
def copy_group(x: BankState, g: int, target: int) -> None:
    """Give another group the history of group g."""
    for i in range(x.R.shape[1]):
        copy_rows(x.R[g, i], x.R[target, i])
    copy_rows(x.noisy[g], x.noisy[target])
    copy_rows(x.noisy_white[g], x.noisy_white[target])
    copy_rows(x.centre[g], x.centre[target])
    copy_rows(x.info[g], x.info[target])
    for j in range(x.sensitivity.shape[1]):
        copy_rows(x.sensitivity[g, j], x.sensitivity[target, j])
    for m in range(x.taken.shape[1]):
        x.deviation[target, m] = x.deviation[g, m]
        x.log[target, m] = x.log[g, m]
        x.taken[target, m] = x.taken[g, m]
    for i in range(x.kept_info.shape[1]):
        x.kept_info[target, i] = x.kept_info[g, i]
    for a in range(x.motion.shape[1]):
        copy_rows(x.motion[g, a], x.motion[target, a])
        copy_rows(x.whitened[g, a], x.whitened[target, a])
    x.age[target] = x.age[g]
    for a in range(x.axis_gate.shape[1]):
        x.axis_gate[target, a] = x.axis_gate[g, a]
    x.waiting[target] = x.waiting[g]


@compiled
def shift_row(s: BankSettings, x: BankState, q: int, k: int, effect: float) -> None:
    """Give surface k the effect in all estimates of row q, and forget that its effectors were known.

    The constant of each becomes what the last samples say: see above.
    """
    first = s.effectors_from + 1
    for m in range(x.members.shape[2]):
        theta = x.members[q, :, m]
        step = effect - effect_of(s, theta, k)
        for j in range(s.gains.shape[1]):
            theta[first + j] += step * s.gains[k, j]
        constant = mean_error(x, q, theta)
        theta[0] += constant
        for n in range(x.past.shape[0]):
            x.past[n, q, 0, m] += constant
            for j in range(s.gains.shape[1]):
                x.past[n, q, first + j, m] += step * s.gains[k, j]
    step = effect - effect_of(s, x.mixed[q], k)
    for j in range(s.gains.shape[1]):
        if s.gains[k, j] != 0.0:
            x.mixed[q, first + j] += step * s.gains[k, j]
            x.theta[q, first + j - 1] = x.mixed[q, first + j]
            x.best_square[q, first + j] = math.inf
            x.square[q, first + j] = math.inf
            shift_batches(x, q, first + j, step * s.gains[k, j])
    x.mixed[q, 0] += mean_error(x, q, x.mixed[q])
    forget_feedback(x, q)
    x.drawn[q] = 0
    for i in range(x.shift.shape[1]):
        x.shift[q, i] = 0.0
        x.correction[q, i] = 0.0
    x.theta[q, x.theta.shape[1] - 1] = x.mixed[q, 0]


@compiled
def mean_error(x: BankState, q: int, theta: Array) -> float:
    """Return by how much row q's last outputs exceed what estimates (p,), constant first, predict, in the mean."""
    count = min(x.samples[0], x.last_phi.shape[0])
    total = 0.0
    for n in range(count):
        total += x.last_y[n, q]
        for i in range(theta.shape[0]):
            total -= theta[i] * x.last_phi[n, i]
    return total / count if count > 0 else 0.0


@compiled
def mean_deflection(s: BankSettings, x: BankState, k: int) -> float:
    """Return how far the effectors were deflected along surface k's direction in the last samples, in the mean."""
    count = min(x.samples[0], x.last_phi.shape[0])
    total = 0.0
    for n in range(count):
        for j in range(s.gains.shape[1]):
            total += s.gains[k, j] * x.last_phi[n, s.effectors_from + 1 + j]
    return total / count if count > 0 else 0.0


@compiled
def forget_direction(s: BankSettings, R: Array, m: int, k: int, mean: float, precision: float, work: BankWork) -> None:
    """Add ``precision d d'`` to the covariance ``(R'R)^-1`` of member m, d the direction of surface k.

    With ``u = R d`` the new factor is ``(I - b u u') R`` with ``b = (1 - 1/sqrt(1 + precision u'u)) / u'u``, made
    triangular again by Givens rotations. The constant goes with the effect: the prediction for the mean deflection,
    `mean_deflection`, is not forgotten.
    """
    p = R.shape[0]
    first = s.effectors_from + 1
    u = work.w
    size = 0.0
    for i in range(p):
        u[i] = -R[0, 0, m] * mean if i == 0 else 0.0
        for j in range(s.gains.shape[1]):
            if first + j >= i:
                u[i] += R[i, first + j, m] * s.gains[k, j]
        size += u[i] * u[i]
    if size <= 0.0:
        return
    share = (1.0 - 1.0 / math.sqrt(1.0 + precision * size)) / size
    for j in range(p):
        along = 0.0
        for i in range(j + 1):
            along += u[i] * R[i, j, m]
        for i in range(p):
            R[i, j, m] -= share * u[i] * along
    triangulate(R, m)


@compiled
def triangulate(R: Array, m: int) -> None:
    """Make the factor of member m, (p, p, m), upper triangular with a positive diagonal again."""
    p = R.shape[0]
    for j in range(p):
        for i in range(j + 1, p):
            a = R[j, j, m]
            b = R[i, j, m]
            r = math.sqrt(a * a + b * b)
            if r > 0.0:
                for n in range(j, p):
                    top = R[j, n, m]
                    low = R[i, n, m]
                    R[j, n, m] = (a * top + b * low) / r
                    R[i, n, m] = (a * low - b * top) / r
            R[i, j, m] = 0.0
        if R[j, j, m] < 0.0:
            for n in range(j, p):
                R[j, n, m] = -R[j, n, m]
