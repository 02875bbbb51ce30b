"""Losses of surfaces: a generalised likelihood ratio test over seconds, in the one direction that each loss has.

The test of `bank.detection` sees a change within a few samples where it jumps out of the noise. Where noise hides the
jump, or smoothed inputs spread it, evidence has to be gathered; and one knows what to look for: if a surface keeps a
share 1 + c of its effect, the effectors' columns of every row q change by ``c a_q``, with ``a_q`` known (`surfaces`).
Let ``R`` be the factor of a member with a short memory, ``D_q = theta_member - theta_reference`` the difference from
the estimates of some time ago, all without the constant, and ``n_q`` the variance of its innovations in row q,
corrected for autocorrelation, and of model error, `FLOOR`. Then::

    c_q = a_q' R'R D_q / a_q' R'R a_q,      v_q = n_q / (2 a_q' R'R a_q) + ((1 + c) relative standard error)^2
    c = sum(c_q / v_q) / sum(1 / v_q),      z = -c / sqrt(1 / sum(1 / v_q) + tolerance^2)

``R'R D`` is what the member's residuals by the old estimates have in common with the regressors: the matched filter of
the loss, all else being what it was. A loss is seen when, for a while, z exceeds its limit (for half as long, where z
is larger still) and c is the loss of a good part, explains most of all that has changed (``sum D' R'R D / n``), and
more than any other surface, than any single state, and than the error of another effector's older effect would. Only
what has a direction of its own alarms: model errors that no surface explains do not. What noise in the states makes of
D, `bank.noise_moves` takes off first; errors of the older estimates `bank.loss_reference`.

Surfaces that are too alike to be told from one another are no rivals (`bank.isolability`).

Several memories are looked at, each with its own limits (`bank.settings.LOSSES`): after a loss that only dither shows c
grows as ``1 - exp(-t / memory)`` of it, so a short one says most of it soon, where there is little noise, and a long
one averages more.

An error e of the reference, as a share of the effect, makes a share s into ``s / (1 + e)``: to take a whole effect for
half of one it must be 1, and not a half. So the relative standard error counts ``1 + c`` times.

What of a row's change no surface explains, the least ``D'R'R D - (a_q'R'R D)^2 / a_q'R'R a_q`` over its ``p - 2``
degrees of freedom (less those that noise in the states has taken), is another estimate of its noise, and holds what
innovations do not: gusts that last as long as the member remembers move all estimates of a row. An alarm takes the
larger of the two; a test of F in place of one of chi-square. What of the output is model error goes with the energy
that it has in what the member remembers: where dither is all that moves, that is little, and so is the error.

Where derivatives are made in a window, each coordinate of ``R D`` has a noise of its own, and is divided by its
deviation first (`bank.loss_noise`); for alarms so is what the older estimates did not know (`bank.loss_reference`).

The innovations are the member's own: what its walking constant follows is no noise in its estimates. An estimate that
has moved within a second before is no reference: the square of that is in its error.

What follows from it is in `bank.forgetting`.

References
----------
Willsky and Jones, "A generalized likelihood ratio approach to the detection and estimation of jumps in linear systems",
IEEE Trans. Automatic Control 21 (1976). Basseville and Nikiforov, *Detection of Abrupt Changes*, 1993, chapter 7.
"""

from __future__ import annotations

import math

from msls_ros.estimation.bank.drag import is_drag
from msls_ros.estimation.bank.effector_noise import most_noise, resting_noise, slow_noise
from msls_ros.estimation.bank.effects import effect_of, square_of_effect
from msls_ros.estimation.bank.incidence import discount_incidence
from msls_ros.estimation.bank.isolability import RIVAL, find_overlaps, is_alike
from msls_ros.estimation.bank.loop_settings import BankSettings
from msls_ros.estimation.bank.loss_noise import OUTLIER, find_whitening, observe_sums
from msls_ros.estimation.bank.loss_reference import LEAST_LEFT, discount_reference, whiten, whiten_directions
from msls_ros.estimation.bank.noise_moves import find_noise_moves, take_off_noise
from msls_ros.estimation.bank.ramps import explain_by_ramps, find_ramps
from msls_ros.estimation.bank.residual import LARGEST_COLOUR
from msls_ros.estimation.bank.rest import was_answered
from msls_ros.estimation.bank.state import BankState
from msls_ros.estimation.bank.uncertainty import square_of_change
from msls_ros.estimation.bank.work import BankWork
from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array, Integers, copy_rows

LIMIT = 4.0
"""Standard errors at which what is published of a loss reaches the detector's threshold."""
EVERY = 2
"""It is tested at every so manieth sample."""
CALM = 0.5
"""Share of its limit below which a member's next test is left out [1]: in 480 flights of `campaign` losses are seen as
soon as with every test."""
LEAST, MOST = 0.25, 1.3
"""What a loss takes away at least to be seen, and can at most, of the effect [1]."""
TOLERANCE = 0.05
"""Standard error of c that no data remove: effects are not wholly linear [1]."""
FLOOR = 0.03
"""Share of the remembered energy of an output that is model error [1, rms]."""
EXPLAINED = 0.4
"""Least share of the change that the loss explains."""
APART = 9.0
"""By how much it explains more than the next surface, at least."""
KNOWN = 0.5
"""Largest relative standard error of an effect of which it is asked, after an alarm, what is left [1]."""
KNOWN_WELL = 0.2
"""Largest one of an effect whose loss alarms: of what is called reliable [1].

Seeds 811 and 812, 324 runs: 12 false alarms, late ones among them, and a wrong name; with .5 30 and 10.
"""
MOTION = 0.5
"""Least share of the information about an effect that is motion, of what a row may say of its loss [1]."""


@compiled
def keep_reference(s: BankSettings, x: BankState) -> None:
    """Keep the estimates of now and their errors in a comparison, every `BankSettings.stride` samples."""
    if x.samples[0] % s.stride != 0:
        return
    slot = x.kept[0] % x.kept_theta.shape[0]
    copy_rows(x.mixed, x.kept_theta[slot])
    for q in range(x.mixed.shape[0]):
        begun = x.age[x.group[q]] >= 4 * x.mixed.shape[1]  # few samples: what is known then is no reference yet
        for i in range(x.mixed.shape[1]):
            square = square_of_change(x, q, i, x.square[q, i]) + square_of_move(s, x, q, i)
            x.kept_square[slot, q, i] = square if begun else math.inf
    x.kept[0] += 1


@compiled
def keep_sample(x: BankState, phi: Array, y: Array) -> None:
    """Keep the regressors and outputs of now."""
    slot = x.samples[0] % x.last_phi.shape[0]
    for i in range(phi.shape[0]):
        x.last_phi[slot, i] = phi[i]
    for q in range(y.shape[0]):
        x.last_y[slot, q] = y[q]


@compiled
def square_of_move(s: BankSettings, x: BankState, q: int, i: int) -> float:
    """Square by which row q's coefficient i has moved in the last second: what moves is no reference yet."""
    back = s.loss_delays[0]
    if x.kept[0] - x.kept[1] < back:
        return 0.0
    step = x.mixed[q, i] - x.kept_theta[(x.kept[0] - back) % x.kept_theta.shape[0], q, i]
    return float(step * step)


@compiled
def sense_losses(s: BankSettings, x: BankState, work: BankWork) -> int:
    """Test all surfaces; return the one whose loss is seen, negative for none; `BankWork.change` says how much.

    Where one is seen, the reference is kept as what was known before (`BankState.theta_before`) of the rows concerned,
    which are marked in ``work.concerned``.
    """
    for q in range(x.group.shape[0]):
        work.concerned[q] = 1 if x.waiting[x.group[q]] == 0 else 0
    for a in range(s.loss_members.shape[0]):
        back = s.loss_delays[a]
        if x.kept[0] - x.kept[1] <= back or x.calm[a] != 0:
            x.calm[a] = 0
            continue
        slot = (x.kept[0] - 1 - back) % x.kept_theta.shape[0]
        before, square = x.kept_theta[slot], x.kept_square[slot]
        k = seen_loss(s, x, a, before, square, work)
        if k < 0 or k != x.suspect[a]:
            x.run[a] = 0
        x.suspect[a] = k
        x.calm[a] = 1 if k < 0 and not stirs(work, CALM * s.loss_limits[a, 0]) else 0
        x.run[a, 0] += 1 if k >= 0 else 0
        x.run[a, 1] = x.run[a, 1] + 1 if k >= 0 and work.deviation[k] > s.loss_limits[a, 1] else 0
        if x.run[a, 0] >= s.loss_tests[a] or 2 * x.run[a, 1] >= s.loss_tests[a]:
            for q in range(x.group.shape[0]):
                gain = work.change[k] * work.change[k] * work.information[q, k]
                work.concerned[q] = 1 if gain > 1.0 else 0
                if gain > 1.0 and x.pending[q] == 0:
                    x.pending[q] = 1
                    for i in range(before.shape[1]):
                        x.theta_before[q, i] = before[q, i]
                        x.square_before[q, i] = square[q, i]
            return k
    return -1


@compiled
def stirs(work: BankWork, limit: float) -> bool:
    """Whether any surface's effect has become less by more than so many standard errors."""
    most = 0.0
    for k in range(work.deviation.shape[0]):
        most = max(most, work.deviation[k])
    return most > limit


@compiled
def seen_loss(s: BankSettings, x: BankState, a: int, before: Array, square: Array, work: BankWork) -> int:
    """Return the surface whose loss is seen in member a now, by older estimates (r, p) with their squared errors.

    Which others it cannot be told from, `BankWork.overlap` says then (`is_alike`).
    """
    k = compare_and_find(s, x, a, before, square, s.straddle > 0, work)
    if k >= 0 and s.straddle == 0:
        k = compare_and_find(s, x, a, before, square, True, work)
    return k


@compiled
def compare_and_find(
    s: BankSettings, x: BankState, a: int, before: Array, square: Array, discounted: bool, work: BankWork
) -> int:
    """Return the surface whose loss explains what changed of member a; negative: none does.

    Where nothing but other surfaces speaks against the one that explains most, those which it cannot be told from do
    not count.
    """
    limit = s.loss_limits[a, 0]
    excess = compare_surfaces(s, x, a, before, square, KNOWN_WELL, True, discounted, work)
    k = find_loss(s, work, excess, limit)
    if k >= 0:
        return k
    best = most_explained(work)
    if not is_loss(s, work, best, 0.0, excess, limit):
        return -1
    work.asked[0] = best
    excess = compare_surfaces(s, x, a, before, square, KNOWN_WELL, True, discounted, work)
    work.asked[0] = -1
    return find_loss(s, work, excess, limit)


@compiled
def find_loss(s: BankSettings, work: BankWork, excess: float, limit: float) -> int:
    """Return the surface whose loss explains what changed, after `compare_surfaces`; negative: none does.

    Its effect must have changed by more than ``limit`` standard errors.
    """
    best = most_explained(work)
    second = 0.0
    for k in range(work.change.shape[0]):
        if k != best and work.explained[k] > second and not is_alike(work, best, k):
            second = work.explained[k]
    return best if is_loss(s, work, best, second, excess, limit) else -1


@compiled
def most_explained(work: BankWork) -> int:
    """Return the surface whose loss explains most, after `compare_surfaces`."""
    best = 0
    for k in range(1, work.change.shape[0]):
        if work.explained[k] > work.explained[best]:
            best = k
    return best


@compiled
def is_loss(s: BankSettings, work: BankWork, best: int, second: float, excess: float, limit: float) -> bool:
    """Whether what the best surface explains is its loss: ``second`` is the most that another explains."""
    for j in range(work.by_error.shape[0]):
        if s.gains[best, j] == 0.0 and work.by_error[j] > second:
            second = work.by_error[j]
    least = max(max(EXPLAINED * excess, second + APART), max(second / RIVAL, work.by_state[0]))
    if work.explained[best] <= least or work.deviation[best] <= limit:
        return False
    return bool(-MOST <= work.change[best] <= -LEAST)


@compiled
def observe_innovations(s: BankSettings, x: BankState, q: int) -> None:
    """Update variance and autocorrelation of the innovations of the members that are compared, of row q."""
    p = x.mixed.shape[1]
    g = x.group[q]
    if x.age[g] <= 2 * p:
        return
    weight = max(x.gate[q], s.quiet)
    fade = 1.0 - (1.0 - s.colour_forgetting) * weight
    if s.straddle > 0 and s.differenced[q] != 0:
        observe_sums(s, x, q, x.errors[q, s.noise_member] * x.deviation[g, s.noise_member], weight)
    for a in range(s.loss_members.shape[0]):
        m = s.loss_members[a]
        own = x.innovation[a, q]
        e = x.errors[q, m] * x.deviation[g, m]
        square = e * e
        if own[0] > 0.0:
            square = min(square, OUTLIER * own[0] / own[2])
        own[0] = fade * own[0] + weight * square
        own[1] = fade * own[1] + weight * math.copysign(min(abs(e * own[3]), square), e * own[3])
        own[2] = fade * own[2] + weight
        own[3] = e
        own[4] += (1.0 - s.forgetting[m]) * (x.now[q] - own[4])


@compiled
def noise_of(s: BankSettings, x: BankState, q: int, a: int) -> float:
    """Variance of the innovations, corrected for autocorrelation, and what of the output is model error; 0: unknown."""
    own = x.innovation[a, q]
    if x.base[q, 1] < s.rest or own[0] <= 0.0:
        return 0.0
    rho = min(max(own[1] / own[0], 0.0), LARGEST_COLOUR)
    return float(own[0] / own[2] * (1.0 + rho) / (1.0 - rho) + model_error_of(x, q, a))


@compiled
def model_error_of(x: BankState, q: int, a: int) -> float:
    """Variance of what of row q's output is model error, by the energy that it has in what member a remembers."""
    return float(FLOOR * FLOOR * max(x.now[q], x.innovation[a, q, 4]))


@compiled
def compare_surfaces(
    s: BankSettings,
    x: BankState,
    a: int,
    before: Array,
    square: Array,
    known: float,
    scattered: bool,
    discounted: bool,
    work: BankWork,
) -> float:
    """Compare the estimates of a member with older ones, in the direction of every surface's loss.

    Parameters
    ----------
    s, x
        Settings and state.
    a
        Which of the members that are compared.
    before, square
        (r, p) older estimates and their squared standard errors, constant first.
    known
        Largest relative standard error of an effect that counts [1].
    scattered
        Whether what no loss explains of a row's change counts as noise, where it is more; and drag says nothing
        (`bank.drag`).
    discounted
        Whether what may be errors of effects that were not known is discounted (`bank.loss_reference`).
    work
        ``concerned`` says which rows to take, ``asked`` of which surface to find ``overlap`` (k,), the information
        about its loss and each other's at once; ``change``, ``variance``, ``deviation``, ``explained`` (k,),
        ``by_state`` and ``information`` (r, k) are filled in.

    Returns
    -------
    float
        All that has changed, beyond what noise makes.
    """
    p = before.shape[1]
    m = s.loss_members[a]
    excess = 0.0
    begin_comparison(s, x, not scattered, work)
    prepared = -1
    for q in range(before.shape[0]):
        n = noise_of(s, x, q, a) if work.concerned[q] != 0 else 0.0
        for k in range(s.gains.shape[0]):
            work.against[q, k] = 0.0
            work.information[q, k] = 0.0
            work.lone_information[q, k] = 0.0
        if n <= 0.0:
            continue
        if x.group[q] != prepared:
            prepared = x.group[q]
            find_directions(s, x.R[prepared], m, work)
            find_noise_moves(s, x, prepared, m, work)
            if not scattered:
                find_ramps(x, prepared, m, work)
            if s.straddle == 0 and not discounted:
                whiten_directions(work)
        for i in range(1, p):
            work.w[i] = 0.0
        for j in range(1, p):
            add_times(work.w, work.columns[j], x.members[q, j, m] - before[q, j], j + 1)
        fitted = take_off_noise(s, x, before, q, m, work)
        taken = 0.0
        if s.straddle > 0:
            find_whitening(s, x, a, q, n, model_error_of(x, q, a), work)
            whiten(work)
        if s.straddle > 0 or discounted:
            whiten_directions(work)
        if discounted:
            taken = discount_reference(s, before, square, q, n, known, work)
        project(work)
        changed = 0.0
        for i in range(1, p):
            changed += work.w[i] * work.w[i]
        if scattered:
            n = max(n, (changed - most_by_surface(work)) / (0.5 * max(p - 2 - fitted - taken, 1.0)))
        excess += changed / n - 0.5 * (p - 1 - taken)
        explain_by_states(s, n, work)
        if not scattered:
            explain_by_ramps(n, work)
        if discounted and s.straddle == 0:
            explain_by_errors(s, n, square[q], work)
        for k in range(s.gains.shape[0]):
            if not (scattered and is_drag(s, x, q, k)):
                compare_row(s, x, a, n, before, square, q, k, known, work)
            if not scattered:
                discount_incidence(s, x, n, effect_of(s, before[q], k), q, k, work)
        if work.asked[0] >= 0:
            find_overlaps(s, n, before[q], q, work)
    for k in range(s.gains.shape[0]):
        combine_rows(work, work.against, work.information, k)
        finish(work, k)
    for i in range(1, p):
        work.by_state[0] = max(work.by_state[0], work.by_state[i])
    for h in range(work.by_ramp.shape[0]):
        work.by_state[0] = max(work.by_state[0], work.by_ramp[h])
    return excess


@compiled
def begin_comparison(s: BankSettings, x: BankState, named: bool, work: BankWork) -> None:
    """Clear what is filled in, and find how noisy the deflections are, ``work.resting`` and ``work.slow``.

    Where a name is wanted, white motion that was never answered when it was as large may all be noise: what rests after
    an alarm, for the aircraft flies straight, has lost nothing by that.
    """
    for k in range(s.gains.shape[0]):
        work.change[k] = 0.0
        work.variance[k] = 0.0
        work.explained[k] = 0.0
        work.overlap[k] = 0.0
    for i in range(work.by_state.shape[0]):
        work.by_state[i] = 0.0
    for j in range(work.by_error.shape[0]):
        work.by_error[j] = 0.0
    for h in range(work.by_ramp.shape[0]):
        work.by_ramp[h] = 0.0
    for j in range(s.gains.shape[1]):
        work.resting[j] = resting_noise(s, x, j)
        work.slow[j] = slow_noise(s, x, j)
        if named and not was_answered(s, x, j):
            work.slow[j] = max(work.slow[j], most_noise(s, x, j))


@compiled
def find_directions(s: BankSettings, R: Array, m: int, work: BankWork) -> None:
    """Take the factor of member m out of (p, p, m), and find the direction ``R a`` of every surface's loss in it."""
    p = R.shape[0]
    first = s.effectors_from + 1
    for j in range(p):
        for i in range(j + 1):
            work.columns[j, i] = R[i, j, m]
    for k in range(s.gains.shape[0]):
        for i in range(p):
            work.steps[k, i] = 0.0
        for j in range(s.gains.shape[1]):
            if s.gains[k, j] != 0.0:
                for i in range(1, first + j + 1):
                    work.steps[k, i] += work.columns[first + j, i] * s.gains[k, j]
        for i in range(1, p):
            work.steps[k, 0] += work.steps[k, i] * work.steps[k, i]


@compiled
def add_times(w: Array, column: Array, factor: float, number: int) -> None:
    """``w += factor column``, so many of them but the constant."""
    for i in range(1, number):
        w[i] += factor * column[i]


@compiled
def project(work: BankWork) -> None:
    """Find what ``work.w`` has in common with every surface's direction, and the squared length of that."""
    for k in range(work.steps.shape[0]):
        direction = work.white_steps[k]
        along = 0.0
        size = 0.0
        for i in range(1, work.w.shape[0]):
            along += direction[i] * work.w[i]
            size += direction[i] * direction[i]
        work.along[k] = along
        work.size[k] = size


@compiled
def explain_by_states(s: BankSettings, n: float, work: BankWork) -> None:
    """Add up what a change of a single state's column in each row explains, of ``work.w``."""
    w = work.w
    for j in range(1, s.effectors_from + 1):
        column = work.white_columns[j]
        size = 0.0
        along = 0.0
        for i in range(1, w.shape[0]):
            size += column[i] * column[i]
            along += column[i] * w[i]
        if size > LEAST_LEFT * work.white_columns[j, 0]:
            work.by_state[j] = max(work.by_state[j], along * along / size / n)


@compiled
def explain_by_errors(s: BankSettings, n: float, square: Array, work: BankWork) -> None:
    """Find what the error of one effector's older effect explains of ``work.w``, by its squared standard error (p,)."""
    for j in range(work.by_error.shape[0]):
        column = work.white_columns[s.effectors_from + 1 + j]
        size = 0.0
        along = 0.0
        for i in range(1, work.w.shape[0]):
            size += column[i] * column[i]
            along += column[i] * work.w[i]
        error = square[s.effectors_from + 1 + j]
        if error > 0.0 and size > 0.0:
            explained = along * along / (size + 0.5 * n / error) / n
            work.by_error[j] = max(work.by_error[j], explained)


@compiled
def most_by_surface(work: BankWork) -> float:
    """Return the most that one surface explains of a row's change, ``work.w``."""
    most = 0.0
    for k in range(work.steps.shape[0]):
        if work.size[k] > LEAST_LEFT * work.white_steps[k, 0]:
            most = max(most, work.along[k] * work.along[k] / work.size[k])
    return most


@compiled
def compare_row(
    s: BankSettings,
    x: BankState,
    a: int,
    n: float,
    before: Array,
    square: Array,
    q: int,
    k: int,
    known: float,
    work: BankWork,
) -> None:
    """Find what row q says of surface k: information, what speaks for or against a loss, error of the reference.

    Of the information that which is noise of the deflections is none, and what that makes of the effect is no loss.
    """
    effect = effect_of(s, before[q], k)
    error = square_of_effect(s, square[q], k)
    if not error < known * known * effect * effect:
        return
    first = s.effectors_from + 1
    count = x.taken[x.group[q], s.loss_members[a]]
    size, along = work.size[k], work.along[k]
    part = work.white_steps[k, 0] / work.steps[k, 0] if work.steps[k, 0] > 0.0 else 1.0
    noise = 0.0
    most = 0.0
    for j in range(s.gains.shape[1]):
        if s.gains[k, j] == 0.0:
            continue
        weighed = s.gains[k, j] * count * work.resting[j]
        noise += weighed * s.gains[k, j]
        most += s.gains[k, j] * count * work.slow[j] * s.gains[k, j]
        along += weighed * before[q, first + j] * part
    if size <= part * most / (1.0 - MOTION) or size <= LEAST_LEFT * work.white_steps[k, 0]:
        return
    size -= noise * part
    work.against[q, k] = effect * along / n
    work.information[q, k] = effect * effect * size / n
    work.reference[q, k] = error / (effect * effect)


def is_known(s: BankSettings, x: BankState, q: int, k: int) -> bool:
    """Whether the effect of surface k in row q was known before its alarm, so that what is left of it may be named."""
    effect = effect_of(s, x.theta_before[q], k)
    return bool(square_of_effect(s, x.square_before[q], k) < KNOWN * KNOWN * effect * effect)


@compiled
def combine_rows(work: BankWork, against: Array, information: Array, k: int) -> None:
    """Combine what the rows say of surface k, (r, k) each, into its change and the variance of that; infinite: nothing.

    An error of the reference is one of the share that is left times that share: first of all of it, then of that.
    """
    left = 1.0
    for _ in range(2):
        total = 0.0
        change = 0.0
        for q in range(against.shape[0]):
            if information[q, k] > 0.0:
                weight = 1.0 / (0.5 / information[q, k] + left * left * work.reference[q, k])
                total += weight
                change += weight * against[q, k] / information[q, k]
        work.change[k] = change / total if total > 0.0 else 0.0
        work.variance[k] = 1.0 / total + TOLERANCE * TOLERANCE if total > 0.0 else math.inf
        left = max(1.0 + work.change[k], 0.0)


@compiled
def finish(work: BankWork, k: int) -> None:
    """Find how many standard errors surface k has lost, and what that explains."""
    work.deviation[k] = 0.0
    if work.variance[k] == math.inf:
        return
    change = work.change[k]
    work.deviation[k] = -change / math.sqrt(work.variance[k])
    for q in range(work.against.shape[0]):
        work.explained[k] += 2.0 * change * work.against[q, k] - change * change * work.information[q, k]


@compiled
def mark_alarm(s: BankSettings, x: BankState, k: int, work: BankWork, statistic: Array, alarm: Integers) -> None:
    """Raise the alarm of the rows concerned, their statistic in units of its own limit."""
    for q in range(alarm.shape[0]):
        if work.concerned[q] != 0:
            alarm[q] = 1
            statistic[q] = max(statistic[q], s.threshold * work.deviation[k] / LIMIT)
