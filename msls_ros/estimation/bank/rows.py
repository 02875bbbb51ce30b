"""The compiled loop of the bank over samples: energies, alarms, members, evidence, mixture, residual statistics.

An alarm takes the alarmed rows out of their group into a free one, whose factors begin at their priors and whose
estimates begin at the mixture's. Where no group is free, the rows join the youngest one, which begins anew.
"""

from __future__ import annotations

import math

from msls_ros.estimation.bank.attenuation import doubt
from msls_ros.estimation.bank.batches import clear_batches
from msls_ros.estimation.bank.changes import observe_window
from msls_ros.estimation.bank.delay import find_delay, forget_delays, observe_output, put_in_step, take_back
from msls_ros.estimation.bank.detection import forget_predictors, sense_bank
from msls_ros.estimation.bank.effector_noise import (
    find_noise,
    observe_deflections,
    observe_quanta,
    observe_states,
    observe_whites,
)
from msls_ros.estimation.bank.energy import observe_energy
from msls_ros.estimation.bank.feedback import forget_feedback, observe_feedback
from msls_ros.estimation.bank.forgetting import apply_loss, keep_states
from msls_ros.estimation.bank.gusts import forget_gusts, observe_gusts
from msls_ros.estimation.bank.isolability import is_alike
from msls_ros.estimation.bank.lags import KEEP, observe_inputs
from msls_ros.estimation.bank.loop_settings import BankSettings
from msls_ros.estimation.bank.loss_noise import observe_regressors
from msls_ros.estimation.bank.losses import (
    EVERY,
    keep_reference,
    keep_sample,
    mark_alarm,
    observe_innovations,
    sense_losses,
    square_of_move,
)
from msls_ros.estimation.bank.members import update_members
from msls_ros.estimation.bank.mixing import find_sharpest, judge, mix, weigh
from msls_ros.estimation.bank.residual import observe_errors, residual_variance
from msls_ros.estimation.bank.responses import held_back, respond
from msls_ros.estimation.bank.rest import observe_rest
from msls_ros.estimation.bank.shrinkage import hold_prediction, shrink
from msls_ros.estimation.bank.speed import last_value, power_of, ratio_of, scale_regressors, speed_of
from msls_ros.estimation.bank.start import clear_factors
from msls_ros.estimation.bank.state import BankState
from msls_ros.estimation.bank.suspects import find_suspects, suspect_surfaces
from msls_ros.estimation.bank.uncertainty import keep_best, square_of_change
from msls_ros.estimation.bank.work import BankWork
from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array, Integers
from msls_ros.estimation.regressor_noise import RegressorNoise
from msls_ros.estimation.soundness import (
    LARGEST_ESTIMATE,
    LARGEST_VARIANCE,
    NOT_FINITE,
    RESPONSE,
    SOUND,
    all_within,
    count_misfits,
)
from msls_ros.estimation.state import Output

LAGS = 2.0
"""Time constants after which what a gap does to a lag is forgotten: to an eighth of it."""

SHARPEN = 4
"""The sharpest member of a row is looked for at every so manieth sample, and at every one after a restart."""

GAP = 1.5
"""Usual steps between samples from which on some are missing."""
TINY = 1e-9
"""Speeds are no less than that [m/s]."""
STEADY = 0.02
"""Share of the newest in the usual step."""

WEIGH = 2
"""The shares of a row's members are computed anew at every so manieth sample, and at every one after a restart."""


@compiled
def advance_bank(
    s: BankSettings,
    x: BankState,
    phi: Array,
    y: Array,
    start: int,
    stop: int,
    work: BankWork,
    out: Output,
    time: Array,
    noise: RegressorNoise,
) -> int:
    """Take samples until one alarms or all are taken; return the index after the last one taken.

    Parameters
    ----------
    s, x
        Settings and state.
    phi, y
        (n, p) regressors, constant last, and (n, r) outputs, finite.
    start, stop
        Which samples to take.
    work
        Scratch.
    out
        What happened, per sample.
    time
        (n,) [s].
    noise
        In the states.
    """
    p = phi.shape[1]
    for n in range(start, stop):
        work.phi[0] = phi[n, p - 1]
        for i in range(p - 1):
            work.phi[i + 1] = phi[n, i]
        observe_quanta(s, x, phi[n])
        scale_regressors(s, x, work.phi)
        take_noise(s, x, noise, n, work)
        responds = respond(s, x, work.phi, y[n], work.factor, work.w, work.squares, work.outputs)
        if responds:
            begin_anew(s, x, work.phi)
        observe_inputs(s, x, work.phi)
        observe_deflections(s, x, work.phi)
        observe_states(s, x, work.phi)
        take_back(s, x, work.phi)
        observe_whites(s, x, work.phi)
        put_in_step(s, x, work.outputs, work.phi, work.y)
        if follows_gap(s, x, time[n]):
            x.apart[0] = reach_of(s, x)
        if x.apart[0] > 0:
            x.apart[0] -= 1
            pass_over(s, x, time[n], out, n)
            if responds:
                out.restart[n] = RESPONSE
                return n + 1
            continue
        any_alarm = sense_bank(s, x, work.phi, work.y, out.e[n], out.statistic[n], out.alarm[n], work.w)
        observe_energy(s, x, work.phi, work.y)
        observe_place(s, x, work.phi, time[n])
        if any_alarm:
            find_suspects(s, x, work.phi, out.e[n], out.alarm[n])
            split_bank(s, x, out.alarm[n])
        for g in range(x.age.shape[0]):
            if in_use(x, g) and not waits(x, g):
                update_members(s, x, g, work.y, work)
                if s.straddle > 0:
                    observe_regressors(s, x, g, work.phi, work.w)
        observe_delay(s, x, work.outputs, work)
        update_rows(s, x, work.y, work)
        keep_reference(s, x)
        keep_sample(x, work.phi, work.y)
        for i in range(p):
            work.extended[i] = work.phi[i]
        observe_window(s, x, work.extended, work.y)
        observe_gusts(s, x)
        x.samples[0] += 1
        if s.detect and s.gains.shape[0] > 0 and x.samples[0] % EVERY == 0 and not any_alarm:
            lost = sense_losses(s, x, work)
            if lost >= 0:
                suspect_surfaces(s, x, lost, work)
                apply_loss(s, x, lost, work.change[lost], 1.0, work)
                for k in range(s.gains.shape[0]):
                    if is_alike(work, lost, k):
                        apply_loss(s, x, k, 0.0, 1.0, work)
                for q in range(x.group.shape[0]):
                    forget_predictors(x, q)
                mark_alarm(s, x, lost, work, out.statistic[n], out.alarm[n])
                any_alarm = True
        report_effectors(s, x, out.b[n], out.b_variance[n], out.excitation[n])
        if s.followed_row >= 0:
            out.followed[n] = followed_of(s, x)
        out.restart[n] = judge_soundness(x, work.phi, work.y, out.e[n])
        if responds and out.restart[n] == SOUND:
            out.restart[n] = RESPONSE
        if any_alarm or out.restart[n] != SOUND:
            return n + 1
    return stop


@compiled
def take_noise(s: BankSettings, x: BankState, noise: RegressorNoise, n: int, work: BankWork) -> None:
    """Take what is known of the noise in the states at sample n, scaled as regressors, and the regressors with D."""
    for q in range(work.noise.shape[0]):
        unit = power_of(s, q + 1, ratio_of(x))
        square = unit * unit
        work.noise[q] = noise.variance[n, q] * square
        work.shown[q] = noise.shown[n, q] * square
        x.white_noise[q] = min(noise.white[n, q] * (2.0 - noise.believed[n, q]) * square, work.shown[q])
        x.white_states[q] = noise.white[n, q] * square
        x.measured[q] = noise.believed[n, q]
        x.left_late[q] = noise.late[n, q]
    p = work.phi.shape[0]
    for j in range(s.velocities.shape[0]):
        i = s.velocities[j]
        work.extended[p + j] = noise.defect[n, i - 1] * power_of(s, i, ratio_of(x))


@compiled
def followed_of(s: BankSettings, x: BankState) -> float:
    """Return the estimate that is followed, at the last sample."""
    return float(last_value(s, x, s.followed_row, (s.followed_column + 1) % x.mixed.shape[1]))


@compiled
def follows_gap(s: BankSettings, x: BankState, time: float) -> bool:
    """Whether samples are missing before this one, of a time [s]; they may come slower than was said."""
    if x.samples[0] == 0:
        x.clock[1] = s.period
        return False
    step = time - x.clock[0]
    gap: bool = step > GAP * max(x.clock[1], s.period)
    x.clock[1] += STEADY * (min(max(step, 0.0), GAP * x.clock[1]) - x.clock[1])
    return gap


@compiled
def reach_of(s: BankSettings, x: BankState) -> int:
    """Return for how many samples after a gap it is not known what acts: those of the delay, and of a lag."""
    late = max(x.delay[0, 0], x.delay[1, 0]) + float(max(s.responses[x.response[0], 1], 0) * s.late)
    late = max(late, float(held_back(s, x)))
    lag = LAGS * s.lag_times[s.responses[x.response[0], 0]] / s.period
    return int(math.ceil(late) + math.ceil(lag))


@compiled
def pass_over(s: BankSettings, x: BankState, time: float, out: Output, n: int) -> None:
    """Let a sample pass that nothing is learnt from: the estimates stay."""
    for q in range(out.e.shape[1]):
        out.e[n, q] = 0.0
        out.statistic[n, q] = 0.0
        out.alarm[n, q] = 0
    x.clock[0] = time
    x.samples[0] += 1
    report_effectors(s, x, out.b[n], out.b_variance[n], out.excitation[n])
    if s.followed_row >= 0:
        out.followed[n] = followed_of(s, x)
    out.restart[n] = SOUND


@compiled
def observe_delay(s: BankSettings, x: BankState, y: Array, work: BankWork) -> None:
    """Learn of delays and of noise in deflections from the outputs y (r,) as they came."""
    for q in range(y.shape[0]):
        observe_output(s, x, q, y[q])
    if x.samples[0] % KEEP == 0:
        find_delay(s, x, work.factor, work.w, work.squares, work.difference)
        observe_rest(s, x)
        find_noise(s, x)


@compiled
def update_rows(s: BankSettings, x: BankState, y: Array, work: BankWork) -> None:
    """Judge and mix the members that have taken the sample y (r,), row by row."""
    settled = 2 * work.phi.shape[0]
    for q in range(y.shape[0]):
        if x.waiting[x.group[q]] > 0:
            continue
        judge(s, x, q, y[q], work)
        observe_errors(s, x, q, work.e)
        observe_innovations(s, x, q)
        observe_feedback(s, x, q, work.phi)
        turn, young = x.samples[0] + q, x.age[x.group[q]] <= settled
        if turn % WEIGH == 0 or young:
            weigh(s, x, q, work.e)
        if turn % SHARPEN == 0 or young:
            find_sharpest(s, x, q, work.e)
        mix(x, q, y[q], work.phi, work.e)
        if turn % KEEP == 0:
            keep_best(s, x, q, work.noise, work.e, work.w, work.squares)
            shrink(s, x, q, work.squares)
        hold_prediction(x, q, work.phi)


@compiled
def judge_soundness(x: BankState, phi: Array, y: Array, e: Array) -> int:
    """Say whether, and why, everything is to be forgotten after a sample; see `soundness`."""
    verdict = count_misfits(x.misfits, phi, y, e)
    if verdict != SOUND:
        return verdict
    if not all_within(x.theta, LARGEST_ESTIMATE) or not all_within(x.known, LARGEST_VARIANCE):
        return NOT_FINITE
    return SOUND


@compiled
def observe_place(s: BankSettings, x: BankState, phi: Array, time: float) -> None:
    """Update where in the envelope the aircraft flies, and the clock."""
    gain = max(s.place, 1.0 / (x.samples[0] + 1.0))
    velocities, last = s.velocities.shape[0], x.place.shape[0] - 1
    ratio = ratio_of(x)
    speed = speed_of(s, phi)
    for j in range(velocities):
        unit = speed if s.scaled else s.speed[j]
        x.place[j] += gain * (phi[s.velocities[j]] / max(unit, TINY) - x.place[j])
    for j in range(s.rates.shape[0]):
        x.place[velocities + j] = phi[s.rates[j]] / ratio
    x.place[last] += gain * (ratio - x.place[last])
    x.clock[0] = time


@compiled
def waits(x: BankState, g: int) -> bool:
    """Count down the samples that straddle the change of group g; whether this is one of them."""
    if x.waiting[g] == 0:
        return False
    x.waiting[g] -= 1
    return bool(x.waiting[g] > 0)


@compiled
def in_use(x: BankState, g: int) -> bool:
    """Whether any row belongs to group g."""
    used = 0
    for q in range(x.group.shape[0]):
        if x.group[q] == g:
            used += 1
    return used > 0


@compiled
def begin_anew(s: BankSettings, x: BankState, phi: Array) -> None:
    """Begin all rows anew: the effectors among the regressors (p,), constant first, are others from now on.

    A name that is awaited is not spoken: what was known before the alarm was of those of before.
    """
    forget_delays(s, x, phi)
    forget_gusts(x)
    clear_factors(s, x, 0)
    x.waiting[0] = 0
    x.kept[1] = x.kept[0]
    for a in range(x.run.shape[0]):
        x.run[a, 0] = 0
        x.run[a, 1] = 0
    for q in range(x.group.shape[0]):
        x.group[q] = 0
        x.pending[q] = 0
        for i in range(phi.shape[0]):
            x.square_before[q, i] = math.inf
        restart_row(x, q)


@compiled
def split_bank(s: BankSettings, x: BankState, alarm: Integers) -> None:
    """Take the alarmed rows out of their groups into one that begins anew."""
    target = free_group(x, alarm)
    joins = x.alert[0] < x.ring.shape[1]
    for q in range(alarm.shape[0]):
        if alarm[q] != 0:
            keep_before(s, x, q, joins)
    clear_factors(s, x, target)
    x.waiting[target] = s.straddle
    if s.straddle == 0 or x.response[0] > 0:  # of before, that is not known to a sample either
        x.waiting[target] += reach_of(s, x)
    x.waiting[target] += 1 if x.waiting[target] > 0 else 0
    x.kept[1] = x.kept[0]
    for a in range(x.run.shape[0]):
        x.run[a] = 0
    for q in range(alarm.shape[0]):
        if alarm[q] != 0 or x.group[q] == target:
            x.group[q] = target
            restart_row(x, q)
    keep_states(s, x, target)


@compiled
def free_group(x: BankState, alarm: Integers) -> int:
    """Return a group that holds no row but alarmed ones; if there is none, the youngest."""
    youngest = 0
    for g in range(x.age.shape[0]):
        others = 0
        for q in range(alarm.shape[0]):
            if x.group[q] == g and alarm[q] == 0:
                others += 1
        if others == 0:
            return g
        if x.age[g] < x.age[youngest]:
            youngest = g
    return youngest


@compiled
def restart_row(x: BankState, q: int) -> None:
    """Begin row q anew from its mixture."""
    p, members = x.members.shape[1:]
    x.judged[q] = 0.0
    x.counted[q] = -2 * p
    x.drawn[q] = 0
    clear_batches(x, q)
    forget_feedback(x, q)
    for i in range(p):
        x.best_square[q, i] = math.inf
        x.shift[q, i] = 0.0
        x.correction[q, i] = 0.0
        x.square[q, i] = math.inf
        x.square_lately[0, q, i] = 0.0
        x.square_lately[1, q, i] = 0.0
        x.square_moved[q, i] = math.inf
        x.square_hidden[q, i] = 0.0
        x.square_past[0, q, i] = math.inf
        x.square_past[1, q, i] = math.inf
        x.origin[q, i] = x.mixed[q, i]
    for m in range(members):
        for k in range(3):
            x.evidence[q, k, m] = 0.0
        for i in range(p):
            x.members[q, i, m] = x.mixed[q, i]
            for k in range(x.past.shape[0]):
                x.past[k, q, i, m] = x.mixed[q, i]
    forget_predictors(x, q)


@compiled
def keep_before(s: BankSettings, x: BankState, q: int, joins: bool) -> None:
    """Keep what was known of row q before its first alarm, for isolation.

    Through a window a change has come in, and has been learnt from, for samples before it alarms, by one error or by
    the mean of many: there it is what was known before all of these. And where a row joins an alarm of others
    (``joins``), it has learnt from the samples since; it begins anew from what it was before the first of these.
    """
    if x.pending[q] != 0:
        return
    x.pending[q] = 1
    p, slots = x.mixed.shape[1], x.kept_theta.shape[0]
    slot = -1
    if s.straddle > 0:
        back = 1 + (s.straddle + s.windows[s.windows.shape[0] - 1]) // s.stride
        if x.kept[0] - x.kept[1] > back:
            slot = (x.kept[0] - 1 - back) % slots
    elif joins and x.kept[1] > 0 and x.kept[0] - x.kept[1] < slots:
        slot = (x.kept[1] - 1) % slots
    for i in range(p):
        if slot >= 0:
            x.theta_before[q, i] = x.kept_theta[slot, q, i]
            x.square_before[q, i] = x.kept_square[slot, q, i]
            if joins:
                x.mixed[q, i] = x.theta_before[q, i]
        else:
            x.theta_before[q, i] = x.mixed[q, i]
            square = x.square_moved[q, i] * doubt(s, x, i)
            x.square_before[q, i] = square_of_change(x, q, i, square) + square_of_move(s, x, q, i)


@compiled
def report_effectors(s: BankSettings, x: BankState, b: Array, variance: Array, excitation: Array) -> None:
    """Fill in the effectors' columns for the dither: estimates and variances (r, m), least excitation (m,).

    A row that recovers from an alarm keeps the estimate from before; what a fault may have done to it counts as one
    standard error of its own size at most, for a fault takes effect away and hardly ever adds any.
    """
    ratio = ratio_of(x)
    for j in range(excitation.shape[0]):
        excitation[j] = 1.0
    for q in range(x.theta.shape[0]):
        g = x.group[q]
        residual = residual_variance(x, q)
        for j in range(excitation.shape[0]):
            i = s.effectors_from + j
            power = power_of(s, i + 1, ratio)
            b[q, j] = power * x.theta[q, i]
            square = power * power * residual / x.known[q, i + 1] if x.known[q, i + 1] > 0.0 else math.inf
            if g > 0 and square > b[q, j] * b[q, j]:
                square = b[q, j] * b[q, j]
            variance[q, j] = square
            share = excitation_of(s, x.info[g, i + 1, s.recent], i + 1)
            if share < excitation[j]:
                excitation[j] = share


@compiled
def excitation_of(s: BankSettings, info: float, i: int) -> float:
    """Return how far the last seconds excite coefficient i (constant first): information over itself plus sigma^2."""
    unit = s.sigma[i] * s.sigma[i]
    return info / (info + unit) if unit > 0.0 else 1.0
