"""What the compiled loop of the bank is told (`BankSettings`), what it keeps (`BankState`), and starting anew.

As in `state`, groups are slots of the first axis: rows that share a history share the factors of one group. Inside the
bank the constant stands first among the regressors; `BankState.theta` and all that is handed out has it last.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from msls_ros.estimation.compiled import compiled, passed_by_reference
from msls_ros.estimation.kernel import Array, Integers


@passed_by_reference
class BankSettings(NamedTuple):
    """What the loop needs to know; p regressors, m members, w windows."""

    period: float
    """Of the samples [s]."""
    members: int
    """How many there are; arrays of m hold the last one again, with no share, to the end of a vector."""
    forgetting: Array
    """(m,) lambda of each member, per sample [1]."""
    held: Integers
    """(m,) 1 where forgetting goes with what is learnt."""
    axis: Integers
    """(m,) of which axis' outputs, where it does."""
    row_axis: Integers
    """(r,) axis of each row: 0 longitudinal, 1 lateral."""
    kind: Integers
    """(r,) of each row's sensors: 0 of moments, 1 of forces, see `bank_delay`."""
    counts: Integers
    """(r,) 1 where the energy of a row's output says that its axis is excited."""
    mixes: Array
    """(r, m) 1 where a member has a share in a row: the free ones, and those held by the row's axis."""
    drift: Array
    """(m,) kappa: walk of the constant per sample over the residual's standard deviation [1]."""
    prior: Array
    """(p, m) diagonal of a new factor, constant first [1/parameter, residual variance 1]."""
    sigma: Array
    """(p,) the bank's unit of each regressor, constant first; the constant's is 0."""
    wind_up: float
    """Share of the prior that comes back, row by row [1]."""
    judging: float
    """Forgetting factor of the evidence [1]."""
    delay: int
    """Samples between an estimate and the delayed prediction that it is judged by."""
    power: float
    """Power of the evidence of one-step and of delayed predictions [1]."""
    quiet: float
    """Least weight of a sample in the evidence [1]."""
    energy: Array
    """(4,) gains per sample: of the outputs' slow mean, their present energy, the energy remembered, its rise."""
    detect: bool
    windows: Integers
    """(w,) samples over which squared prediction errors are averaged, rising."""
    differenced: Integers
    """(r,) 1 of rows of angular rates: means of their prediction errors are looked at, see `bank_detection`."""
    mean_forgetting: float
    """Forgetting factor of what means of their prediction errors are usually [1]."""
    quantiles: Array
    """(p, w) by row: what such a mean of unit variance reaches once in 1e8 samples of Gaussian noise."""
    threshold: float
    floor: float
    """Share of the remembered energy that an alarm needs at least [1, rms]."""
    base: float
    """Forgetting factor of the nominal squared error [1]."""
    rest: int
    """Samples without detection at a start."""
    residual_forgetting: float
    colour_forgetting: float
    effectors_from: int
    """Index of the first effector among the regressors, the constant last."""
    effectors_to: int
    reference: Integers
    """(2,) member whose information counts as knowledge, by axis: the longest memory, the widest prior."""
    recent: int
    """Member whose information counts as excitation."""
    learning: int
    """Samples for which no alarm is raised after a first excitation."""
    straddle: int
    """Samples after an alarm whose windows straddle the change: they do not enter the restarted rows."""
    velocities: Integers
    """(v,) which regressors are velocities, constant first."""
    speed: Array
    """(v,) their scales."""
    scaled: bool
    """Whether effects go with airspeed, see `bank_speed`."""
    exponent: Integers
    """(p,) with which power of it, constant first."""
    place: float
    """Gain per sample of their means."""
    rates: Integers
    """(w,) which regressors are the angular rates about the body's axes, constant first; all three or none."""
    coupled: Integers
    """(p, p) which of them, times a regressor, the equation of another one holds: see `inertial_square`; or -1."""
    turning: Integers
    """(p, p) by row's own regressor: which regressor, times ``turned``, is the part of the derivative by a regressor
    that is known and not in the estimates, for the body's axes turn; 0: none. See `kinematics.remove_rotation`."""
    turned: Array
    quick: float
    """Gain per sample of the mean above which regressors are quick, see `bank_lags`."""
    third: float
    """Of third differences, to be of the size of the noise in what they are of, see `bank_effector_noise`."""
    second: float
    """The same of second differences."""
    rest_block: int
    """Samples of which it is asked whether an output has answered an effector, see `bank_effector_noise`."""
    white_spread: float
    """By what the variance of a sum of products of these and outputs is larger than that of independent ones [1]."""
    entry: float
    """Share that a sample forgets of how outputs go with the noise in the states, see `bank_effector_noise`."""
    slope_noise: float
    """Variance of white noise in a state that has passed the window over what it leaves of the derivative [s^2]."""
    late: int
    """Samples by which responses may be late, see `bank_lags`."""
    lags: Array
    """(l, 3) lags of actuators, none first: weights of last output, last input and input; see `bank_responses`."""
    lag_times: Array
    """(l,) time constants of these [s]."""
    responses: Integers
    """(a, 2) which lag, and blocks back, of the responses that are held against each other, that of a start first; the
    last ones, one for each lag but none, are its filter without its delay."""
    ahead: int
    """Blocks that those look into the future at most."""
    block_forgetting: float
    """Forgetting factor of their sums, and gain (``block_quick``) of the mean above which they are quick, by block."""
    block_quick: float
    latest: int
    """Samples by which deflections are taken back at most."""
    late_noise: float
    """1 - r of the autocorrelation r of white noise that has passed the window, ``late`` samples on [1]."""
    late_part: float
    """Part of an effect that may come that late before anything is known of it, standard deviation [1]."""
    late_apart: float
    """By how much the delays of forces and of moments differ, over l, standard deviation [1]."""
    gains: Array
    """(k, m) position of each surface by each effector, as shares its effect by theirs; see `surfaces`."""
    shares: Array
    loss_members: Integers
    """(a,) members whose estimates are compared with older ones, see `bank_losses`."""
    loss_delays: Integers
    """(a,) by how much older, in strides."""
    loss_tests: Integers
    """(a,) how many times in a row each must see a loss."""
    loss_sums: int
    """How many lengths of sums of innovations are looked at, see `bank_loss_noise`, and of which member."""
    noise_member: int
    loss_limits: Array
    """(a, 2) by how many standard errors, so many times, and half as many [1]."""
    stride: int
    """Samples between estimates that are kept for that."""
    persistence: int
    """Samples of which regressors and outputs are kept, for the mean that an effect is changed about."""
    batches: Integers
    """(k,) samples of the batches of which the estimates' moves are taken, see `bank_batches`."""
    batch_factor: Array
    """(k,) by what the variance of so few of them is larger [1]."""
    followed_row: int
    followed_column: int
    """Of the estimate that `Output.followed` holds; negative: none."""


@passed_by_reference
class BankState(NamedTuple):
    """Everything that changes; g groups, m members, p regressors (constant first), c effectors, r rows."""

    R: Array
    """(g, p, p, m) factors."""
    info: Array
    """(g, p, m) information of each coefficient alone, see `bank.find_information`."""
    deviation: Array
    """(g, m) ``1/sqrt(1 + d)`` of the last sample."""
    log: Array
    """(g, m) ``ln(1 + d)`` of the last sample."""
    taken: Array
    """(g, m) sum of the weights of the samples in the factor."""
    centre: Array
    """(g, p, m) weighted means of the states over what each member remembers, constant first."""
    kept_info: Array
    """(g, p) information in the priors of a group's factors that states have kept through a fault."""
    age: Integers
    """(g,) samples since the group began."""
    group: Integers
    """(r,) group of each row."""
    members: Array
    """(r, p, m) estimates of the members."""
    errors: Array
    """(r, m) their last prediction errors."""
    past: Array
    """(d+1, r, p, m) their estimates over the last samples, a ring."""
    mixed: Array
    """(r, p) the estimates, constant first."""
    known: Array
    """(r, p) information of the mixture, sum of shares times information, constant first."""
    theta: Array
    """(r, p) the estimates, constant last."""
    sharpest: Integers
    """(r,) the member that predicts best one step ahead."""
    weight: Array
    """(r, m) share of each member [1]."""
    evidence: Array
    """(r, 3, m) weighted sums: squared errors one step ahead, delayed, and ln(1 + d)."""
    judged: Array
    """(r,) sum of the weights of the evidence."""
    mean: Array
    """(r,) slow mean of the outputs."""
    now: Array
    """(r,) present energy of the outputs about it."""
    foreseen: Array
    """(r,) the same of what the estimates make of them."""
    remembered: Array
    """(r,) energy that is remembered; it does not fade in the quiet."""
    phi_mean: Array
    """(p,) slow mean of the regressors."""
    phi_remembered: Array
    """(p,) energy of the regressors about it that is remembered."""
    phi_last: Array
    """(p,) the last effectors, at their places among the regressors."""
    step_remembered: Array
    """(p,) energy of their steps that is remembered."""
    gate: Array
    """(r,) present over remembered energy, at most 1."""
    output_error: Array
    """(r,) mean square of the mixture's prediction errors with estimates of half a second ago, over as long."""
    energy_share: Array
    """(r, m) the mean of that over what a free member remembers; 1 of held ones, which remember nothing else."""
    axis_gate: Array
    """(g, 2) the mean over the rows of the group that count, by axis; 1 where it has none."""
    ring: Array
    """(r, w) last squared prediction errors of the sharpest member."""
    surprise: Array
    """(r, w) the same, or the mixture's if smaller, over 1 + d of the reference member and what is new."""
    allowed: Array
    """(r, w) what its standard errors allowed the motion to be mispredicted by, squared."""
    signed: Array
    """(r, w) the prediction errors whose squares these are, of differenced rows."""
    mean_square: Array
    """(r, l, w) squares of their means over the l windows that ended at each of the last samples."""
    mean_base: Array
    """(r, 2 + l) sums of the weights of older ones, of the weights' squares, and weighted sums of them."""
    smaller: Array
    """(r, w) that smaller one itself."""
    square_moved: Array
    """(r, p) squared standard errors without the bias by noise in the states, which mispredicts nothing."""
    square_past: Array
    """(2, r, p) the same of one to two windows ago; infinite: none."""
    counted: Integers
    """(r,) errors in the ring since the last restart; negative: samples of rest left."""
    base: Array
    """(r, 3) weighted sums of older squared errors, of the weights, and of the smaller squared errors."""
    e: Array
    """(r,) last normalised prediction errors of the mixture; NaN: none."""
    residual: Array
    """(r, 2) weighted sums: the members' normalised squared errors one step ahead, their weights."""
    colour: Array
    """(r, 2) weighted sums: products of successive prediction errors, and their squares."""
    quick: Array
    """(p,) the regressors above their mean of the last moment, and so since the estimates that predict them."""
    quick_past: Array
    """(l, c) the effectors of these over the last samples, a ring."""
    quick_late: Array
    """(c,) the oldest of them."""
    quick_mean: Array
    """(p,) that mean."""
    quick_samples: Array
    """(1,) weighted number of samples in the sums that follow."""
    moment: Array
    """(p, p) weighted sums of products of the first, lower triangle."""
    quick_moment: Array
    """(c, p) sums of products of these steps with the regressors."""
    predictors: Array
    """(s + 1, 2, r, p) the estimates, and those of the sharpest member, over the last samples, a ring."""
    lagged: Array
    """(l, c) the deflections through each lag, see `bank_responses`."""
    sent: Array
    """(l, k, c) the last of them, a ring."""
    block_sent: Array
    """(l, c) their mean over the block of `BankSettings.late` samples, so far."""
    block: Array
    """(t + r,) that of states and outputs."""
    sent_mean: Array
    """(l, c) mean of the blocks of the last moment."""
    sent_quick: Array
    """(l, b, c) the last blocks above it, a ring."""
    output_past: Array
    """(3, r) the last outputs, a ring, and the median squares of their third differences (r,)."""
    output_median: Array
    held: Array
    """(k, t + r) the last states and outputs, a ring."""
    response_mean: Array
    """(t + r,) the same of states and outputs."""
    response_past: Array
    """(b, t + r)"""
    response_quick: Array
    """(t + 2 c + r,) quick states, deflections of a response and those of l samples before, outputs."""
    response_sums: Array
    """(a, n, n) weighted sums of products of these, lower triangles."""
    response_samples: Array
    """(1,) weighted number of samples in them."""
    response_part: Array
    """(a,) part of l by which each response is late besides."""
    response_evidence: Array
    """(a,) for each response instead of that of now."""
    response_doubt: Array
    """(1,) share of an effect that it may be off by where another response has evidence [1]."""
    response_steps: Array
    """(c, p) scratch, as the next two."""
    response_squares: Array
    """(c, c)"""
    response_row: Array
    """(r, 4)"""
    response_fit: Array
    """(a, r, 3) likelihood of each response by each row, the share that effectors explain [1], and the most that noise
    in the deflections takes from the former."""
    response_effect: Array
    """(a, r, c) the effects that each has."""
    response: Integers
    """(1,) which response is taken."""
    recent: Array
    """(k, c) the last deflections, a ring, see `bank_delay`."""
    delay: Array
    """(2, 5) by kind of rows, of responses after deflections: as it is used [samples], its variance [l^2], two sums
    that it comes from, and what it is before it is shrunk [l]."""
    output_mean: Array
    """(r,) mean of the outputs over the last moment, see `bank_delay`."""
    answer: Array
    """(r, c) sums of the quick outputs times the effectors' steps."""
    steps: Array
    """(c, c) sums of products of these steps, lower triangle."""
    early: Array
    """(r, p) sums of quick outputs times the quick regressors; their squares at the constant's place."""
    step_back: Array
    """(c,) by what the deflections would differ if they were taken back `BankSettings.late` samples more."""
    sensitivity: Array
    """(g, c, p, m) what the members make of that: derivative of estimates by the delay, constant first, `bank_lags`."""
    cross: Array
    """(r, c) sums of prediction errors times these differences."""
    unexplained: Array
    """(c,) what the regressors leave of the sum of their squares, all of them quick; 0: too little."""
    unlike: Array
    """(2, r, c) squares of what of each effect may come so late in this row alone: what hides, what shows."""
    late_square: Array
    """(2, r, p) variance of the estimates by what is not known of delays, and by what shows of them alone."""
    deflections: Array
    """(3, c) the last deflections, a ring, see `bank_effector_noise`."""
    quantum: Array
    """(5, c) least step of the recorded deflections, how often it has shown, least and largest, where one rested."""
    recorded: Array
    """(2, c) the last ones, a ring."""
    third_median: Array
    """(c,) median square of their third differences, of the size of their noise."""
    third_floor: Array
    """(c,) variance of the noise when no output had answered for a while; 0: never."""
    white_past: Array
    """(3, c) the last deflections taken back, a ring."""
    white: Array
    """(c,) their second differences, through a window third ones, of the size of their noise; 0 at edges."""
    white_median: Array
    """(c,) median square of these, edges and all."""
    white_answer: Array
    """(r, c) what outputs did last by each effector and beyond the model."""
    white_cross: Array
    """(r, c) weighted sums of that times these."""
    white_power: Array
    """(r, c) of their squares."""
    white_answered: Array
    """(r, c) median square of what outputs did, over what is expected of their errors."""
    rest_cross: Array
    """(r, c) sums of what outputs did times `white` in the present block of samples."""
    rest_power: Array
    """(r, c) of the squares of the latter."""
    rest_energy: Array
    """(c,) of the squares of what is quick of the deflections."""
    rest_evidence: Array
    """(2, c) that outputs do not answer them, and that they do, negative (cumulative sums)."""
    dithered: Array
    """(c,) `third_median` when all that moved was white and was answered; 0: never."""
    rest: Integers
    """(1,) number of that block."""
    suspected: Integers
    """(c,) whether the effector's loss may have made the last alarm."""
    unanswered: Array
    """(c,) for how long no output has answered [s]."""
    past_outputs: Array
    """(w, r) the outputs over the window that the inputs have passed, a ring; see `bank_fed_noise`."""
    common: Array
    """(3, r, c) weighted sums of that of now, of half a window and of a window ago, times the deflections."""
    states: Array
    """(3, r) the last states, a ring."""
    state_third: Array
    """(r,) their third differences, of the size of their noise."""
    entry: Array
    """(r, r) sums of the prediction errors times these."""
    entry_samples: Array
    """(r,) how many samples these hold."""
    state_median: Array
    """(r,) median square of their third differences, of the size of their noise."""
    white_states: Array
    """(r,) variance of white noise in the states, as regressors, where derivatives are measured."""
    third_noise: Array
    """(c,) variance of the noise in the deflections."""
    answered: Integers
    """(c,) 1 once an output has answered the effector for certain, see `bank_attenuation`."""
    effect: Array
    """(r, c) size of each effect when it was last known so well."""
    widened: Array
    """(r, p) factor by which noise in the regressors widens the squared errors, constant first [1]."""
    correction: Array
    """(r, p) what noise in the regressors has taken from the estimates, see `bank_correction`, constant first."""
    best_correction: Array
    """(r, p) that of the best estimates."""
    columns: Array
    """Scratch of `bank_correction`: (p, p) columns of the inverse information, of what has noise."""
    removed: Array
    """(p,) what each has been made of it by; what is published then; what is left of its square."""
    corrected: Array
    uncorrected: Array
    carried: Array
    """(r, p) squared errors of the estimates by the best that was known, when they were last looked at."""
    pending: Integers
    """(r,) 1 from an alarm of the row until it is settled what changed."""
    theta_before: Array
    """(r, p) the estimates before that alarm, constant first."""
    square_before: Array
    """(r, p) their squared standard errors."""
    kept: Integers
    """(2,) how many estimates have been kept in all, and before the last alarm."""
    last_phi: Array
    """(n, p) regressors and outputs (n, r) of the last `BankSettings.persistence` samples, in a ring."""
    last_y: Array
    kept_theta: Array
    """(w, r, p) estimates of the last seconds, constant first, a ring."""
    kept_square: Array
    """(w, r, p) their squared standard errors."""
    innovation: Array
    """(a, r, 5) of the members that are compared: weighted sums of squares, of products of successive ones, of the
    weights, the last one, and the energy that the output had in what they remember, see `bank_losses`."""
    innovation_sums: Array
    """(r, l) running sums of those of one member, a ring, and how many (r,) they are; see `bank_loss_noise`."""
    sums_taken: Integers
    sum_squares: Array
    """(r, k, 2) weighted sums of the squares of sums of 1, 2, 4, ... of them, over that number, and of weights."""
    whitened: Array
    """(g, a, w, p) the regressors of the last samples by the factors of these members, orthogonal, a ring."""
    motion: Array
    """(g, a, 2, p) sums of squares of how far they go in a window, and of what they are."""
    run: Integers
    """(a, 2) how many times in a row a loss was seen, and surely, see `bank_losses`."""
    suspect: Integers
    """(a,) of which surface."""
    misfits: Integers
    """(r,) samples with an absurd prediction error, less those without; see `soundness`."""
    samples: Integers
    """(1,) samples since the last reset."""
    learning: Integers
    """(1,) samples left in which what is excited for the first time is learnt, not alarmed."""
    alert: Integers
    """(1,) samples left in which an alarm of another row is likely."""
    waiting: Integers
    """(g,) samples left that straddle a change."""
    square: Array
    """(r, p) squared standard errors, constant first."""
    square_lately: Array
    """(2, r, p) the largest of these, by what is known now, of this quarter of a second and the last; 0: none."""
    batch: Array
    """(k, r, p, 3) variance by what estimates move; estimate and information at the end of the last batch; constant
    first, see `bank_batches`."""
    batch_kept: Array
    """(k, r) share of the older information that is not forgotten since then."""
    batch_number: Integers
    """(k, r) which batch that was."""
    lately: Integers
    """(r,) which quarter of a second that is."""
    best: Array
    """(r, p) the best known estimates, constant first."""
    best_square: Array
    """(r, p) their squared standard errors; infinite: none."""
    best_time: Array
    """(r, p) when they were known [s]."""
    best_place: Array
    """(r, p, v + w + 1) where they were known."""
    shift: Array
    """(r, p) what is added to what is published, constant first, see `bank_shrinkage`."""
    drawn: Integers
    """(r,) 1 where it is."""
    place: Array
    """(v + w + 1,) where that is: mean velocities of now, in units of their scale, or where effects go with airspeed
    their direction; rates [rad/s]; and mean ratio of speeds then."""
    speed: Array
    """(2,) that of the first sample, at which the estimates hold [m/s], and that of the last one over it."""
    seen: Array
    """(p,) regressor of the last sample, constant first."""
    apart: Integers
    """(1,) samples to come whose late deflections lie in a gap of the samples."""
    clock: Array
    """(2,) time of the last sample, and mean step of time [s]."""


@passed_by_reference
class BankWork(NamedTuple):
    """Scratch of one sample; no state."""

    phi: Array
    """(p,) regressor, constant first."""
    outputs: Array
    """(r,) outputs that go with it, see `bank_responses`."""
    y: Array
    """(r,) outputs, put in step."""
    noise: Array
    """(r,) variance of the noise in the states, as regressors."""
    w: Array
    """(p,)"""
    squares: Array
    """(p,) squared standard errors."""
    row: Array
    """(p, m) rows that are rotated in."""
    z: Array
    """(p, m) right-hand sides."""
    K: Array
    """(p, m) gains."""
    V: Array
    """(p, p, m) inverses of the factors."""
    c: Array
    """(m,) cosines, as t the sines."""
    t: Array
    left: Array
    """(m,) what is left of the right-hand side."""
    root: Array
    """(m,) what the factors shrink by, as first their row 0."""
    first: Array
    weight: Array
    """(m,) weight of the sample in each member, and its root [1]."""
    root_weight: Array
    loss: Array
    """(m,) share of the information that is forgotten [1]."""
    e: Array
    """(m,) delayed prediction errors; exponents of the weights."""
    concerned: Integers
    """(r,) 1 for rows that count."""
    change: Array
    """(k,) by which share the effect of each surface has changed, with its variance, see `bank_losses`."""
    variance: Array
    deviation: Array
    """(k,) how many standard errors that is, positive for a loss."""
    explained: Array
    """(k,) what it explains of what has changed."""
    by_state: Array
    """(p,) what a change of one state explains; the largest first."""
    against: Array
    """(r, k)"""
    information: Array
    """(r, k) about the change, by row."""
    reference: Array
    """(r, k) squared relative errors of what it is compared with [1]."""
    difference: Array
    """(p,) of its estimates from older ones."""
    factor: Array
    """(p, p) of one member."""
    whitening: Array
    """(p,) by what its coordinates of a change are multiplied, for all to have the same noise [1]."""
    steps: Array
    """(k, p) the direction of each surface's loss in it, its squared length first."""
    white_steps: Array
    """(k, p) the same, and (p, p) the factor's columns as rows, where coordinates have the same noise."""
    white_columns: Array
    noise_moves: Array
    """(p, p) by state, which way noise in it moves the estimates there, see `bank_noise_moves`."""


def make_bank_state(s: BankSettings, rows: int, groups: int) -> BankState:
    """Allocate a state; `clear_bank` makes it valid."""
    p, m = s.prior.shape
    w, effectors = int(s.windows[-1]), s.effectors_to - s.effectors_from
    kept = int(max(s.loss_delays, default=0)) + 1
    others = len(s.responses) - len(s.lags) + 1
    early = int(-s.responses[:others, 1].min())
    back, quick = int(s.responses[:, 1].max()) + s.ahead + 2, s.effectors_from + 2 * effectors + rows
    return BankState(
        R=np.zeros((groups, p, p, m)),
        info=np.zeros((groups, p, m)),
        deviation=np.zeros((groups, m)),
        log=np.zeros((groups, m)),
        taken=np.zeros((groups, m)),
        centre=np.zeros((groups, p, m)),
        kept_info=np.zeros((groups, p)),
        age=np.zeros(groups, np.int64),
        group=np.zeros(rows, np.int64),
        members=np.zeros((rows, p, m)),
        errors=np.zeros((rows, m)),
        past=np.zeros((s.delay + 1, rows, p, m)),
        mixed=np.zeros((rows, p)),
        known=np.ones((rows, p)),
        theta=np.zeros((rows, p)),
        sharpest=np.zeros(rows, np.int64),
        weight=np.zeros((rows, m)),
        evidence=np.zeros((rows, 3, m)),
        judged=np.zeros(rows),
        mean=np.zeros(rows),
        now=np.zeros(rows),
        foreseen=np.zeros(rows),
        remembered=np.zeros(rows),
        phi_mean=np.zeros(p),
        phi_remembered=np.zeros(p),
        phi_last=np.zeros(p),
        step_remembered=np.zeros(p),
        gate=np.zeros(rows),
        output_error=np.zeros(rows),
        energy_share=np.ones((rows, s.forgetting.shape[0])),
        axis_gate=np.ones((groups, 2)),
        ring=np.zeros((rows, w)),
        surprise=np.zeros((rows, w)),
        allowed=np.zeros((rows, w)),
        signed=np.zeros((rows, w)),
        mean_square=np.zeros((rows, len(s.windows), w)),
        mean_base=np.zeros((rows, 2 + len(s.windows))),
        smaller=np.zeros((rows, w)),
        square_moved=np.zeros((rows, p)),
        square_past=np.zeros((2, rows, p)),
        counted=np.zeros(rows, np.int64),
        base=np.zeros((rows, 3)),
        e=np.zeros(rows),
        residual=np.zeros((rows, 2)),
        colour=np.zeros((rows, 2)),
        quick=np.zeros(p),
        quick_past=np.zeros((s.late, effectors)),
        quick_late=np.zeros(effectors),
        quick_mean=np.zeros(p),
        quick_samples=np.zeros(1),
        moment=np.zeros((p, p)),
        quick_moment=np.zeros((effectors, p)),
        predictors=np.zeros((s.straddle + 1, 2, rows, p)),
        lagged=np.zeros((len(s.lags), effectors)),
        sent=np.zeros((len(s.lags), (back + 1) * s.late, effectors)),
        block_sent=np.zeros((len(s.lags), effectors)),
        block=np.zeros(s.effectors_from + rows),
        sent_mean=np.zeros((len(s.lags), effectors)),
        sent_quick=np.zeros((len(s.lags), back, effectors)),
        output_past=np.zeros((3, rows)),
        output_median=np.zeros(rows),
        held=np.zeros((early * s.late + 1, s.effectors_from + rows)),
        response_mean=np.zeros(s.effectors_from + rows),
        response_past=np.zeros((back, s.effectors_from + rows)),
        response_quick=np.zeros(quick),
        response_sums=np.zeros((len(s.responses), quick, quick)),
        response_samples=np.zeros(1),
        response_part=np.zeros(len(s.responses)),
        response_evidence=np.zeros(len(s.responses)),
        response_doubt=np.zeros(1),
        response_steps=np.zeros((effectors, p)),
        response_squares=np.zeros((effectors, effectors)),
        response_row=np.zeros((rows, 4)),
        response_fit=np.zeros((len(s.responses), rows, 3)),
        response_effect=np.zeros((len(s.responses), rows, effectors)),
        response=np.zeros(1, np.int64),
        recent=np.zeros((s.latest + s.late + 3, effectors)),
        delay=np.zeros((2, 5)),
        output_mean=np.zeros(rows),
        early=np.zeros((rows, p)),
        answer=np.zeros((rows, effectors)),
        steps=np.zeros((effectors, effectors)),
        step_back=np.zeros(effectors),
        sensitivity=np.zeros((groups, effectors, p, m)),
        cross=np.zeros((rows, effectors)),
        unexplained=np.zeros(effectors),
        unlike=np.zeros((2, rows, effectors)),
        late_square=np.zeros((2, rows, p)),
        deflections=np.zeros((3, effectors)),
        quantum=np.zeros((5, effectors)),
        recorded=np.zeros((2, effectors)),
        third_median=np.zeros(effectors),
        third_floor=np.zeros(effectors),
        white_past=np.zeros((3, effectors)),
        white=np.zeros(effectors),
        white_median=np.zeros(effectors),
        white_answer=np.zeros((rows, effectors)),
        white_cross=np.zeros((rows, effectors)),
        white_power=np.zeros((rows, effectors)),
        white_answered=np.zeros((rows, effectors)),
        past_outputs=np.zeros((max(s.straddle, 1), rows)),
        common=np.zeros((3, rows, effectors)),
        rest_cross=np.zeros((rows, effectors)),
        rest_power=np.zeros((rows, effectors)),
        rest_energy=np.zeros(effectors),
        rest_evidence=np.zeros((2, effectors)),
        dithered=np.zeros(effectors),
        rest=np.zeros(1, np.int64),
        suspected=np.zeros(effectors, np.int64),
        unanswered=np.zeros(effectors),
        states=np.zeros((3, rows)),
        state_third=np.zeros(rows),
        entry=np.zeros((rows, rows)),
        entry_samples=np.zeros(rows),
        state_median=np.zeros(rows),
        white_states=np.zeros(rows),
        third_noise=np.zeros(effectors),
        answered=np.zeros(effectors, np.int64),
        effect=np.zeros((rows, effectors)),
        widened=np.ones((rows, p)),
        correction=np.zeros((rows, p)),
        best_correction=np.zeros((rows, p)),
        columns=np.zeros((p, p)),
        removed=np.zeros(p),
        corrected=np.zeros(p),
        uncorrected=np.zeros(p),
        carried=np.full((rows, p), np.inf),
        pending=np.zeros(rows, np.int64),
        theta_before=np.zeros((rows, p)),
        square_before=np.zeros((rows, p)),
        kept=np.zeros(2, np.int64),
        last_phi=np.zeros((s.persistence, p)),
        last_y=np.zeros((s.persistence, rows)),
        kept_theta=np.zeros((kept, rows, p)),
        kept_square=np.zeros((kept, rows, p)),
        innovation=np.zeros((len(s.loss_members), rows, 5)),
        innovation_sums=np.zeros((rows, 2 ** (s.loss_sums - 1) + 1)),
        sums_taken=np.zeros(rows, np.int64),
        sum_squares=np.zeros((rows, s.loss_sums, 2)),
        whitened=np.zeros((groups, len(s.loss_members), max(s.straddle, 1), p)),
        motion=np.zeros((groups, len(s.loss_members), 2, p)),
        run=np.zeros((len(s.loss_members), 2), np.int64),
        suspect=np.zeros(len(s.loss_members), np.int64),
        misfits=np.zeros(rows, np.int64),
        samples=np.zeros(1, np.int64),
        learning=np.zeros(1, np.int64),
        alert=np.zeros(1, np.int64),
        waiting=np.zeros(groups, np.int64),
        square=np.zeros((rows, p)),
        square_lately=np.zeros((2, rows, p)),
        batch=np.zeros((len(s.batches), rows, p, 3)),
        batch_kept=np.zeros((len(s.batches), rows)),
        batch_number=np.zeros((len(s.batches), rows), np.int64),
        lately=np.zeros(rows, np.int64),
        best=np.zeros((rows, p)),
        best_square=np.zeros((rows, p)),
        best_time=np.zeros((rows, p)),
        best_place=np.zeros((rows, p, len(s.velocities) + len(s.rates) + 1)),
        shift=np.zeros((rows, p)),
        drawn=np.zeros(rows, np.int64),
        place=np.zeros(len(s.velocities) + len(s.rates) + 1),
        speed=np.zeros(2),
        seen=np.zeros(p),
        apart=np.zeros(1, np.int64),
        clock=np.zeros(2),
    )


def make_bank_work(s: BankSettings, rows: int) -> BankWork:
    """Allocate the scratch."""
    p, m = s.prior.shape
    row, z, K = np.zeros((p, m)), np.zeros((p, m)), np.zeros((p, m))
    c, t, left, root, first, weight, root_weight, loss, e = (np.zeros(m) for _ in range(9))
    k = len(s.gains)
    change, variance, deviation, explained = (np.zeros(k) for _ in range(4))
    return BankWork(
        *(np.zeros(p), np.zeros(rows), np.zeros(rows), np.zeros(rows), np.zeros(p), np.zeros(p)),
        *(row, z, K, np.zeros((p, p, m)), c, t, left),
        *(root, first, weight, root_weight, loss, e),
        np.zeros(rows, np.int64),
        *(change, variance, deviation, explained, np.zeros(p)),
        *(
            np.zeros((rows, k)),
            np.zeros((rows, k)),
            np.zeros((rows, k)),
            np.zeros(p),
            np.zeros((p, p)),
            np.ones(p),
            np.zeros((k, p)),
            np.zeros((k, p)),
            np.zeros((p, p)),
            np.zeros((p, p)),
        ),
    )


def clear_bank(s: BankSettings, x: BankState) -> None:
    """Start anew: nothing known, estimates zero, all rows in group 0."""
    for array in x:
        array[...] = 0
    mixes = s.mixes[: len(x.weight)]
    x.weight[:] = mixes / mixes.sum(axis=1, keepdims=True)
    x.known[:] = 1.0
    x.widened[:] = 1.0
    x.carried[:] = math.inf
    x.energy_share[:] = 1.0
    x.e[:] = math.nan
    x.best_square[:] = math.inf
    x.square[:] = math.inf
    x.square_moved[:] = math.inf
    x.square_past[:] = math.inf
    x.counted[:] = -s.rest
    clear_factors(s, x, 0)


@compiled
def clear_factors(s: BankSettings, x: BankState, g: int) -> None:
    """Put the priors in the place of all factors of group g."""
    for m in range(s.forgetting.shape[0]):
        clear_factor(s, x, g, m)
    for i in range(s.prior.shape[0]):
        x.kept_info[g, i] = 0.0
        for j in range(x.sensitivity.shape[1]):
            for m in range(s.forgetting.shape[0]):
                x.sensitivity[g, j, i, m] = 0.0
    x.age[g] = 0
    for a in range(x.motion.shape[1]):
        for i in range(s.prior.shape[0]):
            x.motion[g, a, 0, i] = 0.0
            x.motion[g, a, 1, i] = 0.0
    for a in range(x.axis_gate.shape[1]):
        x.axis_gate[g, a] = 1.0


@compiled
def clear_factor(s: BankSettings, x: BankState, g: int, m: int) -> None:
    """Put the prior in the place of one factor."""
    p = s.prior.shape[0]
    for i in range(p):
        for k in range(p):
            x.R[g, i, k, m] = 0.0
        x.R[g, i, i, m] = s.prior[i, m]
        x.info[g, i, m] = s.prior[i, m] * s.prior[i, m]
    x.taken[g, m] = 0.0


@compiled
def copy_rows(of: Array, to: Array) -> None:
    """Copy a matrix: (n, k) each."""
    for i in range(of.shape[0]):
        for j in range(of.shape[1]):
            to[i, j] = of[i, j]
