"""State of the compiled loop of the bank, `BankState`: what it keeps; `bank.start` allocates and clears it.

As in `state`, groups are slots of the first axis: rows that share a history share the factors of one group. Inside the
bank the constant stands first among the regressors; `BankState.theta` and all that is handed out has it last.
"""

from __future__ import annotations

from typing import NamedTuple

from msls_ros.estimation.compiled import passed_by_reference
from msls_ros.estimation.kernel import Array, Integers


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
    noisy: Array
    """(g, r, m) weighted sums of the variances of the noise in the states, as it showed in those samples."""
    noisy_white: Array
    """(g, r, m) the same of what is white noise of their sensors."""
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
    origin: Array
    """(r, p) where they began, to which priors draw them, constant first."""
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
    excused: Array
    """(w,) the same of the row of u, with what drag may do."""
    signed: Array
    """(r, w) the prediction errors whose squares these are, of differenced rows."""
    mean_square: Array
    """(r, l, w) squares of their means over the l windows that ended at each of the last samples."""
    mean_base: Array
    """(r, 2 + l) sums of the weights of older ones, of the weights' squares, and weighted sums of them."""
    smaller: Array
    """(r, w) that smaller one itself."""
    square_hidden: Array
    """(r, p) what noise in the regressors adds to ``square_moved``, see `bank.allowances.hidden_square`."""
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
    squares: Array
    """(r, m) sums of every member's squared normalised prediction errors, see `bank.residual`."""
    residual: Array
    """(r, 2) weighted sums: the members' normalised squared errors one step ahead, their weights."""
    colour: Array
    """(r, 2) weighted sums: products of successive prediction errors, and their squares."""
    moving: Array
    """(2, p) what moves now beyond noise, and how far regressors are from their means; constant 0."""
    shapes: Array
    """(2, 2) by axis: the squared errors that these allow together, over those of each by itself, 1 at most."""
    quick: Array
    """(p,) the regressors above their mean of the last moment, and so since the estimates that predict them."""
    quick_past: Array
    """(l, c) the effectors of these over the last samples, a ring."""
    quick_late: Array
    """(c,) the oldest of them."""
    state_motion: Array
    """(4, p) squares by which states move beyond noise, see `bank.allowances.observe_states`."""
    slow_mean: Array
    """(p,) means of those over half a second."""
    quick_mean: Array
    """(p,) that mean."""
    quick_samples: Array
    """(1,) weighted number of samples in the sums that follow."""
    moment: Array
    """(p, p) weighted sums of products of the first, lower triangle."""
    together: Integers
    """(1,) whether effectors move together as they have not lately, see `bank.together`."""
    together_factor: Array
    together_moves: Array
    """Scratch of it: (c, c) Cholesky factor of the effectors' moments, and (c,)."""
    quick_moment: Array
    """(c, p) sums of products of these steps with the regressors."""
    predictors: Array
    """(s + 1, 2, r, p) the estimates, and those of the sharpest member, over the last samples, a ring."""
    lagged: Array
    """(l, c) the deflections through each lag, see `bank.responses`."""
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
    response_sums: Array
    """(t + r, t + r) weighted sums of products of quick states and outputs, lower triangle."""
    sent_sums: Array
    """(i, c, t + r) the same of deflections, each pair of `BankSettings.pairs`, with them."""
    sent_products: Array
    """(l, b, 2, c, c) of deflections with each other, and with those of a block before: as they were, a ring."""
    response_samples: Array
    """(1,) weighted number of samples in them."""
    response_block: Integers
    """(1,) the last block in them, from 0 on."""
    response_part: Array
    """(a,) part of l by which each response is late besides."""
    response_evidence: Array
    """(a,) for each response instead of that of now."""
    response_shown: Array
    """(a,) the same with what may stand in for states that noise hides, for the bars."""
    response_doubt: Array
    """(r,) share of an effect that it may be off by where another response has evidence [1]."""
    response_steps: Array
    """(c, p) scratch, as the next two."""
    response_squares: Array
    """(c, c)"""
    response_row: Array
    """(r, 4)"""
    response_fit: Array
    """(a, r, 3) likelihood of each response by each row, the share that effectors explain [1], and the share of what is
    left that noise in the deflections makes at most [1]."""
    response_effect: Array
    """(a, r, c) the effects that each has."""
    response_states: Array
    """(r, t) those of the states, by the last response that was looked at."""
    response_hidden: Array
    """(r,) share of what the present response leaves that noise in the states makes at most [1]."""
    response: Integers
    """(1,) which response is taken."""
    recent: Array
    """(k, c) the last deflections, a ring, see `bank.delay`."""
    delay: Array
    """(2, 5) by kind of rows, of responses after deflections: as it is used [samples], its variance [l^2], two sums
    that it comes from, and what it is before it is shrunk [l]."""
    output_mean: Array
    """(r,) mean of the outputs over the last moment, see `bank.delay`."""
    answer: Array
    """(r, c) sums of the quick outputs times the effectors' steps."""
    steps: Array
    """(c, c) sums of products of these steps, lower triangle."""
    early: Array
    """(r, p) sums of quick outputs times the quick regressors; their squares at the constant's place."""
    step_back: Array
    """(c,) by what the deflections would differ if they were taken back `BankSettings.late` samples more."""
    window_sums: Array
    """(k, p, p) sums of products of the regressors in each of the last blocks, lower triangle, a ring."""
    window_outputs: Array
    """(k, p, r) the same of the regressors with the outputs."""
    window_block: Integers
    """(k,) which block each holds, from 1 on; 0: none."""
    window_key: Integers
    """(2,) sample and group of what follows."""
    window_begun: Integers
    """(g,) sample before which nothing counts for a group: a loss has been applied to it then; 0: none has."""
    window_matrix: Array
    """(p, p) the sums of all blocks that the group has seen, less their means, lower triangle; their number first."""
    window_mean: Array
    """(p,) of the regressors in these."""
    window_noise: Array
    """(p,) variance of what is known to be noise in them."""
    window_white: Array
    """(p,) variance of what of them is white besides, and noise or may be."""
    window_factor: Array
    """(p, p) Cholesky factor of that, from 1 on, pivots inverted."""
    window_square: Array
    """(p,) variances of the effectors' effects by it, in units of the residual's."""
    window_row: Array
    """(p,) scratch, as the next two."""
    window_left: Array
    """(p,)"""
    window_vague: Array
    """(p,)"""
    window_change: Array
    """(p,) squares by which a row's effects may have changed."""
    gust_sums: Array
    """(p + v, p + v) the sums of the blocks of the last minute, lower triangle, see `bank.gusts`."""
    gust_outputs: Array
    """(p + v, r) the same of the regressors with the outputs."""
    gust_mean: Array
    """(p + v,) of the regressors."""
    gust_factor: Array
    """(p + v, p + v) Cholesky factor of the sums without means, from 1 on, pivots inverted."""
    gust_left: Array
    """(p + v,) scratch."""
    gust_theta: Array
    """(r, p + v) least squares by these, constant first, gamma last."""
    gust_direction: Array
    """(v, p + v) the rows of the inverse of the sums without means that say gamma."""
    gust_scatter: Array
    """(r, v) sum of the squares by which blocks have moved gamma, over its information."""
    gust_effect: Array
    """(r, v) the most that noise has of a velocity's effect; infinite: not known."""
    past_residuals: Array
    """(l, r) residuals of the member of the longest memory, a ring, see `bank.feedback`."""
    followed_residuals: Array
    """(r, l, p) sums of their products with the regressors later, by lag."""
    feedback_square: Array
    """(r, p) squared errors of effects for what of them may be gusts that a law answers."""
    gust_bias: Array
    """(r, v) the most bias by it, effect times variance."""
    gust_blocks: Integers
    """(1,) how many blocks were full."""
    sensitivity: Array
    """(g, c, p, m) what the members make of that: derivative of estimates by the delay, constant first, `bank.lags`."""
    ramps: Array
    """(g, h, p, m) what the members make of moments that grow for a while after an alarm, see `bank.ramps`."""
    ramp_samples: Integers
    """(g,) since that alarm."""
    cross: Array
    """(r, c) sums of prediction errors times these differences."""
    unexplained: Array
    """(c,) what the regressors leave of the sum of their squares, all of them quick; 0: too little."""
    unlike: Array
    """(2, r, c) squares of what of each effect may come so late in this row alone: what hides, what shows."""
    late_square: Array
    """(2, r, p) variance of the estimates by what is not known of delays, and by what shows of them alone."""
    deflections: Array
    """(3, c) the last deflections, a ring, see `bank.effector_noise`."""
    quantum: Array
    """(6, c) least step of the recorded deflections, how often it has shown, least and largest, where one rested, and
    for how many samples it has."""
    recorded: Array
    """(2, c) the last ones, a ring."""
    third_median: Array
    """(c,) median square of their third differences, of the size of their noise."""
    third_floor: Array
    """(c,) variance of the noise when no output had answered for a while; 0: never."""
    white_past: Array
    """(3, c) the last deflections taken back, a ring."""
    whites: Array
    """(late + 1, c) the last second differences, through a window third ones, as large as noise; 0 at edges; a ring."""
    white_median: Array
    """(c,) median square of these, edges and all."""
    timing: Array
    """(r,) squared error by timing in the last sample, see `bank.allowances.timing_square`."""
    white_errors: Array
    """(r, lags) the last prediction errors, without a window, a ring."""
    white_cross: Array
    """(r, c, lags) weighted sums of what outputs did by each delay, times these."""
    white_factor: Array
    """(lags, lags) lower factor of the autocorrelation of second differences of noise."""
    white_solved: Array
    """(lags,) scratch."""
    white_parts: Array
    """(2, lags) how much of these is in the noise itself, by kind and delay [1]."""
    white_power: Array
    """(r, c) of their squares."""
    white_answered: Array
    """(r, c) median square of what outputs did, without a window (r, 0) of the errors, over what is expected of it."""
    rest_cross: Array
    """(r, c, lags) the same in the present block of samples; through a window of the errors with what is quick."""
    rest_power: Array
    """(r, c) of the squares of what the outputs are held against there."""
    rest_square: Array
    """(r, c) sums of the squared errors these are held against, through a window."""
    rest_energy: Array
    """(c,) of the squares of what is quick of the deflections."""
    rest_evidence: Array
    """(2, c) that outputs do not answer them, and that they do, negative (cumulative sums)."""
    dithered: Array
    """(c,) `third_median` when all that moved was white and was answered; 0: never."""
    rested: Array
    """(c,) the same when nothing answered it; 0: never, or it has been answered since."""
    rest: Integers
    """(1,) number of that block."""
    suspected: Integers
    """(c,) whether the effector's loss may have made the last alarm."""
    unanswered: Array
    """(c,) for how long no output has answered [s]."""
    past_outputs: Array
    """(w, r) the outputs over the window that the inputs have passed, a ring; see `bank.fed_noise`."""
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
    measured: Array
    """(r,) K of `state_filter` [1]; 0: they are as measured."""
    left_late: Array
    """(r,) by how much states seem later than was put right [s]."""
    white_states: Array
    """(r,) variance of white noise in the states, as regressors, where derivatives are measured."""
    white_noise: Array
    """(r,) variance of what is left of it in the states as regressors, with what the filter has made of it."""
    third_noise: Array
    """(c,) variance of the noise in the deflections."""
    answered: Integers
    """(c,) 1 once an output has answered the effector for certain, see `bank.attenuation`."""
    effect: Array
    """(r, c) size of each effect when it was last known so well."""
    widened: Array
    """(r, p) factor by which noise in the regressors widens the squared errors, constant first [1]."""
    unlearnt: Array
    """(r, p) what of the squared errors is noise taken for motion, or the prior, over the rest, constant first [1]."""
    correction: Array
    """(r, p) what noise in the regressors has taken from the estimates, see `bank.correction`, constant first."""
    best_correction: Array
    """(r, p) that of the best estimates."""
    speed_logarithm: Array
    """(2, p) the last ratios of speeds of `bank.elsewhere`, and their logarithms: those are slow."""
    since_best: Array
    """(p,) scratch of `bank.uncertainty.keep_best`."""
    pulled: Array
    """(p,) scratch: what noise of the deflections has made of a row's last estimates, the middle of it."""
    vague: Array
    """(p,) scratch: by how much that may be more or less."""
    columns: Array
    """Scratch of `bank.correction`: (p, p) columns of the inverse information, of what has noise."""
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
    weights, the last one, and the energy that the output had in what they remember, see `bank.losses`."""
    innovation_sums: Array
    """(r, l) running sums of those of one member, a ring, and how many (r,) they are; see `bank.loss_noise`."""
    sums_taken: Integers
    sum_squares: Array
    """(r, k, 2) weighted sums of the squares of sums of 1, 2, 4, ... of them, over that number, and of weights."""
    whitened: Array
    """(g, a, w, p) the regressors of the last samples by the factors of these members, orthogonal, a ring."""
    motion: Array
    """(g, a, 2, p) sums of squares of how far they go in a window, and of what they are."""
    run: Integers
    """(a, 2) how many times in a row a loss was seen, and surely, see `bank.losses`."""
    suspect: Integers
    """(a,) of which surface."""
    calm: Integers
    """(a,) 1 where nothing has spoken for a loss lately: the next test is left out."""
    misfits: Integers
    """(r,) samples with an absurd prediction error, less those without; see `soundness`."""
    samples: Integers
    """(1,) samples since the last reset."""
    learning: Integers
    """(1,) samples left in which what is excited for the first time is learnt, not alarmed."""
    waits: Integers
    """(1,) samples for which an alarm still waits for an effector to move."""
    held_statistic: Array
    """(r,) its statistics, by row."""
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
    first, see `bank.batches`."""
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
    """(r, p) what is added to what is published, constant first, see `bank.shrinkage`."""
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
