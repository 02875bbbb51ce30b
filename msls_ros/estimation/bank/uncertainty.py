"""Error bars of the bank: what members know now, and the best that was known before.

Per coefficient, with the members' shares W and informations I (`bank.mixing`)::

    now_i^2 = (s^2 c + 3 sum W_m I_mi (theta_mi - theta_i)^2) / sum W_m I_mi  +  b_i^2 / 5  +  (f rho theta_i)^2

The first term is covariance intersection times the variance of the residual. ``s^2`` is the mean of the members'
squared one-step prediction errors, each over 1 + d; they count once the estimates that made them could know anything.
``c`` corrects for colour, ``(1 + rho)/(1 - rho)`` with the lag-1 autocorrelation rho of the prediction errors, and for
the degrees of freedom that the parameters have taken and the tails that few leave, ``n/(n - k - 2)``, k of the p of
which are determined by the data and not by what the prior holds (`learnt_from_data`). The second term, the spread
between members, is the uncertainty about the model itself. ``b`` is the bias by noise in the states and by gusts
(`regressor_noise`), for the member that counts most. What noise is in the information widens all of that, see
`bank.attenuation`. The last is what no averaging removes: residuals that are autocorrelated are model error (vanes,
couplings), a share f rho of the estimate; and what is not known of delays (`bank.lags`). The first term is no less than
by how far the estimates move from one batch of data to the next (`bank.batches`). Where the aircraft is elsewhere in
the envelope than on average over the memory of that member, ``(theta_i |place - mean place| / reach)^2`` is added
(`bank.elsewhere`). The derivative of an angular acceleration by another rate also goes with the third one, through the
inertia (`inertial_square`, there).

**What is known and what is excited.** In the quiet the information of now fades, but not what was known. The best
estimate is kept with its error, time and place in the envelope, and serves as long as it is the better one::

    kept_i^2 = best_i^2 + (theta_i - theta_best_i)^2 + (theta_best_i |place - place_best| / reach)^2
    se_i = min(now_i, kept_i)

To both is added a quarter of the square by which the member that remembers the last second and a half contradicts the
estimate beyond two of its standard errors: what dither alone shows of a change counts little in the evidence, but it
must not be hidden. By what the last eight seconds contradict that of an effector's effect, what is published is wider
besides (`bank.changes`), and of a state's by how late velocities seem (`delay_square`).

By the triangle inequality the error of now is at most that of then plus what the estimate has moved since, while the
derivative itself is what it was; it changes with the velocity vector (``place``: mean velocities over their scale),
which is what the last term allows for. Where now is no worse than what is kept, and has been so for a quarter to half a
second, it is kept instead: a bias that changes sign passes through nothing, and is not known to be nothing then. What
is published of states' effects may be drawn back to what is kept (`bank.shrinkage`), whose error it has then, and what
it would have moved by (`withdrawn_square`).

Variance and colour are carried over an alarm; samples and the best known are not: nothing is claimed before ``k + 2``
samples, a few with what states keep through a fault (`bank.forgetting`).

References
----------
Bates and Granger, "The combination of forecasts", 1969; Buckland, Burnham and Augustin, "Model selection: an integral
part of inference", Biometrics 53 (1997) (spread between models). Grauer and Morelli, "Parameter uncertainty for
aircraft parameter estimates using recursive least squares", 2016 (coloured residuals).
"""

from __future__ import annotations

import math

from msls_ros.estimation.bank.attenuation import LEARNT, attenuation, doubt, widen
from msls_ros.estimation.bank.batches import batch_square, observe_batches
from msls_ros.estimation.bank.changes import find_changes
from msls_ros.estimation.bank.contradiction import disagreement, find_pulled
from msls_ros.estimation.bank.correction import correct
from msls_ros.estimation.bank.effector_noise import measured_noise
from msls_ros.estimation.bank.elsewhere import (
    distance_from_mean,
    distance_from_place,
    elsewhere_square,
    inertial_square,
    speed_from_best,
    speed_from_mean,
    turn_from_mean,
    turned_square,
)
from msls_ros.estimation.bank.fed_noise import follows_noise
from msls_ros.estimation.bank.feedback import find_feedback
from msls_ros.estimation.bank.isolability import instead_square
from msls_ros.estimation.bank.lags import (
    KEEP,
    find_late_square,
    lag_square,
)
from msls_ros.estimation.bank.loop_settings import BankSettings
from msls_ros.estimation.bank.mixing import sum_members
from msls_ros.estimation.bank.residual import autocorrelation, residual_variance
from msls_ros.estimation.bank.speed import power_of, ratio_of, slope_by_speed, speed_of
from msls_ros.estimation.bank.state import BankState
from msls_ros.estimation.bank.suspects import suspect_square
from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array

SYSTEMATIC = 0.018
"""Share of an estimate that no averaging makes certain where residuals are wholly autocorrelated [1].

With .03, 95 % of the errors were within .5 to 1.6 of a bar that this dominates (seeds 845 and 205, all beds).
"""
SPREAD = 3.0
"""So many times the spread between members counts: where once it dominated, 95 % of the errors were within 2 to 11."""
PARTED = 0.3
"""Share of a squared error that counts in a comparison at least.

Seeds 811 to 813, 486 runs: .6 names 16 of 36 half ailerons through windows, .3 names 24; one wrong name either way.
"""
HIDDEN = 17.0
"""Largest factor by which noise in the regressors widens what the detector allows the effectors [1].

Seeds 811 to 813: 47 of 54 faults of the F-16 seen, 4 false alarms in 144 flight tests; without a limit 43 and 3 (gusts
hide faults), by the noise of the effector's own sensor alone 49 and 14. Through windows it allows nothing: half
ailerons of four and of nineteen other aircraft, seeds 851, 852 and 206: 23 of 24 and 44 of 57 are seen, 1 false alarm;
with this 20 and 39, 7 false.
"""
ANSWERED = 25.0
"""Squared standard errors by which an output must answer an effector once, for what it does to be motion.

What is known to less than that is not known to a fifth of itself in any row. The size of each effect that is, is kept:
when the effector dies, what is left is held against it (`model`). F-16, medium noise, seeds 100 to 119: share of B that
is called reliable with the nozzle lost .176 -> .206, tail .202 -> .210, cruise .309 -> .316, as well covered (.98).
"""
LATELY = 0.0625
"""Stretch of which this and the last must show what is kept, over the autocorrelation's memory [1]: .25 s."""
RARELY = 4
"""What changes over seconds is looked at every so manieth time only."""
FIRST = 128
"""But in the first so many samples."""


@compiled
def leading_member(x: BankState, q: int, share: Array) -> int:
    """Return the member that counts most in row q's estimates, on average over the coefficients; (m,) scratch."""
    info = x.info[x.group[q]]
    weight = x.weight[q]
    for m in range(share.shape[0]):
        share[m] = 0.0
    for i in range(info.shape[0]):
        own = info[i]
        part = 1.0 / x.known[q, i]
        for m in range(share.shape[0]):
            share[m] += weight[m] * own[m] * part
    leader = 0
    most = -1.0
    for m in range(share.shape[0]):
        if share[m] > most:
            most = share[m]
            leader = m
    return leader


@compiled
def learnt_from_data(s: BankSettings, x: BankState, q: int, m: int) -> float:
    """Return how many of row q's coefficients the data determine, and not the priors of member m: p less its trace.

    ``p - trace((R'R)^-1 D)`` with D the diagonal information of the priors (Hastie, Tibshirani and Friedman, *The
    Elements of Statistical Learning*, 2nd ed., section 3.4.1: effective degrees of freedom).
    """
    g = x.group[q]
    number = 0.0
    for i in range(x.mixed.shape[1]):
        prior = s.prior[i, m] * s.prior[i, m] + x.kept_info[g, i]
        number += max(1.0 - prior / x.info[g, i, m], 0.0)
    return number


@compiled
def is_learnt(s: BankSettings, x: BankState, q: int, i: int, m: int) -> bool:
    """Whether data have said as much of row q's coefficient i as the prior of member m did, `LEARNT`, or more.

    The constant (0) is what is left where the aircraft flies, whatever the others are.
    """
    prior = s.prior[i, m]
    return bool(i == 0 or LEARNT * x.info[x.group[q], i, m] >= prior * prior)


@compiled
def withheld_square(s: BankSettings, x: BankState, q: int, i: int, m: int, square: float) -> float:
    """Square of what the prior of member m may have withheld from row q's coefficient i, beyond what it allows.

    A prior with a share r of the information lets an estimate go ``1 - r`` of the way from where it began to what the
    data say. Where that lies within the prior, its error is part of the posterior's, ``square``: ``r square`` of it.
    """
    prior = s.prior[i, m]
    share = min(prior * prior / x.info[x.group[q], i, m], LEARNT)
    withheld = (x.mixed[q, i] - x.origin[q, i]) * share / (1.0 - share)
    return float(max(withheld * withheld - share * square, 0.0)) if i > 0 else 0.0


@compiled
def rests_on_unlearnt(s: BankSettings, x: BankState, q: int, phi: Array, i: int, ratio: float, m: int) -> bool:
    """Whether row q's derivative i by the velocity along which the aircraft flies rests on one that is not learnt.

    It is S over the speed, for the most part (`bank.speed`), of which the effects of angle of attack and sideslip are
    a part. As `bank.speed.slope_by_speed`; m is the member that leads there.
    """
    speed = speed_of(s, phi) / ratio
    if 2.0 * slope_by_speed(s, phi, i, ratio) * phi[i] < ratio:
        return False
    for j in range(s.velocities.shape[0]):
        k = s.velocities[j]
        share = s.exponent[k] * abs(phi[k])
        unknown = x.best_square[q, k] == math.inf and not is_learnt(s, x, q, k, m)
        if k != i and share > SYSTEMATIC * ratio * speed and unknown:
            return True
    return False


@compiled
def direct_squares(
    s: BankSettings, x: BankState, q: int, leader: int, noise: Array, products: Array, bias: Array, squares: Array
) -> bool:
    """Squared standard errors by what the members know now, (p,) out, constant first; False while too few tell."""
    p = squares.shape[0]
    age = x.age[x.group[q]]
    find_pulled(s, x, q)
    free = age - learnt_from_data(s, x, q, leader) - 2.0
    if x.residual[q, 0] <= 0.0 or free <= 0.0:  # an output that has never done anything has said nothing
        for i in range(p):
            squares[i] = math.inf
        return False
    variance = residual_variance(x, q) * age / free
    systematic = common_part(x, q)
    attenuation(s, x, q, leader, noise, bias)
    away, apart = distance_from_mean(s, x, q, leader), speed_from_mean(s, x, q, leader)
    for i in range(p):
        info = x.info[x.group[q], i]
        theta = x.members[q, i]
        for m in range(products.shape[0]):
            difference = theta[m] - x.mixed[q, i]
            products[m] = x.weight[q, m] * info[m] * difference * difference
        stays = systematic * x.mixed[q, i]
        squares[i] = (
            max(variance / x.known[q, i], batch_square(s, x, q, i)) + SPREAD * sum_members(products) / x.known[q, i]
        )
        squares[i] += stays * stays
        squares[i] += withheld_square(s, x, q, i, leader, variance / x.known[q, i])
        squares[i] += disagreement(s, x, q, i) + lag_square(x, q, i) + x.feedback_square[q, i]
        squares[i] += elsewhere_square(s, x.mixed[q, i], i, away, apart) + turned_square(s, x, q, i, away)
        if s.coupled[q + 1, i] >= 0:
            squares[i] += inertial_square(s, x, q, i, turn_from_mean(s, x, q, s.coupled[q + 1, i], leader))
    widen(s, x, q, leader, bias, squares)
    return True


@compiled
def observe_answers(s: BankSettings, x: BankState, q: int, leader: int, bias: Array, squares: Array) -> None:
    """Note which effectors row q's output answers for certain; of what `widen` made of its squared errors (p,).

    Errors that are shares of the estimate itself do not count: they make no answer of none.
    """
    waiting = False
    for j in range(x.answered.shape[0]):
        waiting = waiting or x.answered[j] == 0
    away = 0.0
    apart = 0.0
    if waiting:
        away, apart = distance_from_mean(s, x, q, leader), speed_from_mean(s, x, q, leader)
    for j in range(x.answered.shape[0]):
        i = s.effectors_from + 1 + j
        square = x.mixed[q, i] * x.mixed[q, i]
        if x.answered[j] == 0 and not follows_noise(s, x, q, j):
            stays = common_part(x, q) * x.mixed[q, i]
            shares = stays * stays + elsewhere_square(s, x.mixed[q, i], i, away, apart)
            if ANSWERED * (squares[i] - bias[i] - x.widened[q, i] * shares) < x.widened[q, i] * square:
                x.answered[j] = 1
                forget_best(x, i)
        if ANSWERED * squares[i] < square:
            x.effect[q, j] = abs(x.mixed[q, i])


@compiled
def forget_best(x: BankState, i: int) -> None:
    """Forget what was known best of coefficient i (constant first) in all rows: while it rested that was noise."""
    for q in range(x.best_square.shape[0]):
        x.best_square[q, i] = math.inf


@compiled
def common_square(x: BankState, q: int, i: int) -> float:
    """Square of what coefficient i is off by in every estimate alike: late responses, what no averaging removes."""
    stays = common_part(x, q) * x.mixed[q, i]
    return float(lag_square(x, q, i) + stays * stays)


@compiled
def common_part(x: BankState, q: int) -> float:
    """Relative error of row q's estimates that no averaging removes, and what is not known of actuators [1]."""
    return float(max(SYSTEMATIC * autocorrelation(x, q), x.response_doubt[q]))


@compiled
def square_of_change(x: BankState, q: int, i: int, square: float) -> float:
    """Squared error of coefficient i in a comparison with a later estimate, which does not see `common_square`.

    Of ``square``, what it is in all. `PARTED` says what counts at least.
    """
    return float(max(square - common_square(x, q, i), PARTED * square))


@compiled
def known_square(s: BankSettings, x: BankState, q: int, i: int, value: float) -> float:
    """Squared standard error of a value of coefficient i (constant first) by the best that was known."""
    if x.best_square[q, i] == math.inf:
        return math.inf
    moved = value - x.best[q, i]
    return float(x.best_square[q, i] + moved * moved + square_since_best(s, x, q, i))


@compiled
def square_since_best(s: BankSettings, x: BankState, q: int, i: int) -> float:
    """Square by which coefficient i of row q may differ from its best, for the aircraft flies elsewhere."""
    away = 0.0
    for j in range(s.velocities.shape[0]):
        step = x.place[j] - x.best_place[q, i, j]
        away += step * step
    apart = speed_from_best(s, x, q, i)
    square = elsewhere_square(s, x.best[q, i], i, away, apart) + turned_square(s, x, q, i, away)
    other = s.coupled[q + 1, i]
    if other >= 0:
        place = s.velocities.shape[0] + other
        square += inertial_square(s, x, q, i, x.place[place] - x.best_place[q, i, place])
    return square


@compiled
def carried_square(s: BankSettings, x: BankState, q: int, i: int, value: float) -> float:
    """Return `known_square`, no less than what shows of delays, and what speaks against it now."""
    if x.best_square[q, i] == math.inf:
        return math.inf
    return float(max(known_square(s, x, q, i, value), x.late_square[1, q, i]) + disagreement(s, x, q, i))


@compiled
def withdrawn_square(x: BankState, q: int, i: int, value: float) -> float:
    """Square by which coefficient i of row q may have changed, though its estimate is drawn back (`bank.shrinkage`).

    That is how far the present one is from the best, beyond what `known_square` of the value that is published holds of
    it: noise may have drawn it there, or a change, and nothing says which.
    """
    if x.drawn[q] == 0 or not x.best_square[q, i] < math.inf:
        return 0.0
    moved = x.mixed[q, i] + x.correction[q, i] - x.best_correction[q, i] - x.best[q, i]
    step = value - x.best[q, i]
    return float(max(moved * moved - step * step, 0.0))


@compiled
def keep_best(
    s: BankSettings, x: BankState, q: int, noise: Array, products: Array, bias: Array, squares: Array
) -> None:
    """Keep row q's estimates where they are known better than what is kept is good for now."""
    turn = (x.samples[0] + q) // KEEP
    leader = leading_member(x, q, products)
    if turn % RARELY == 0:
        observe_batches(s, x, q, leader, RARELY * KEEP)
    if turn % RARELY == 0 or x.samples[0] < FIRST:
        find_late_square(s, x, q, products)
        find_feedback(s, x, q, squares)
    block = x.samples[0] // max(round(LATELY / (1.0 - s.colour_forgetting)), 1)
    if block != x.lately[q]:
        x.lately[q] = block
        for i in range(squares.shape[0]):
            x.square_lately[1, q, i] = x.square_lately[0, q, i]
            x.square_lately[0, q, i] = 0.0
    begun = direct_squares(s, x, q, leader, noise, products, bias, squares)
    if begun:
        observe_answers(s, x, q, leader, bias, squares)
    for i in range(squares.shape[0]):
        carried = math.inf
        if x.best_square[q, i] < math.inf:
            x.since_best[i] = square_since_best(s, x, q, i)
            step = x.mixed[q, i] - x.best[q, i]
            known = x.best_square[q, i] + step * step + x.since_best[i]
            carried = max(known, x.late_square[1, q, i]) + disagreement(s, x, q, i)
        x.carried[q, i] = carried
        x.square[q, i] = min(squares[i], carried) * doubt(s, x, i) + suspect_square(s, x, q, i)
        moved = math.inf
        if begun:
            moved = (squares[i] - bias[i]) / x.widened[q, i]
            if s.effectors_from < i <= s.effectors_to:
                moved *= min(x.widened[q, i], HIDDEN) if s.straddle == 0 else 1.0
        x.square_moved[q, i] = min(moved, carried)
        hidden = min(x.widened[q, i] - 1.0, HIDDEN) if begun else 0.0
        x.square_hidden[q, i] = hidden * x.square_moved[q, i] if x.square_moved[q, i] < math.inf else 0.0
    if not begun:
        for i in range(squares.shape[0]):
            x.correction[q, i] = 0.0
        return
    correct(s, x, q, leader, noise, bias, squares)
    for i in range(squares.shape[0]):
        if squares[i] == math.inf or not is_learnt(s, x, q, i, leader):
            continue
        x.square_lately[0, q, i] = max(squares[i], x.square_lately[0, q, i])
        lately = max(x.square_lately[0, q, i], x.square_lately[1, q, i])
        step = x.mixed[q, i] + x.correction[q, i] - x.best_correction[q, i] - x.best[q, i]
        if x.best_square[q, i] == math.inf or lately <= x.best_square[q, i] + step * step + x.since_best[i]:
            x.best[q, i] = x.mixed[q, i]
            x.best_correction[q, i] = x.correction[q, i]
            x.best_square[q, i] = lately
            x.best_time[q, i] = x.clock[0]
            for j in range(x.place.shape[0]):
                x.best_place[q, i, j] = x.place[j]


@compiled
def delay_square(s: BankSettings, x: BankState, q: int, i: int, phi: Array) -> float:
    """Square by which row q's coefficient of state i may be off for velocities that seem late, see `state_delay`.

    Where a velocity is late by tau, ``v + tau vdot`` makes of its effect ``A_qv`` an effect ``tau A_qv dvdot/dx_i`` of
    every other state, with what is known of its derivative besides (phi, (p,): where the estimates are wanted).
    """
    total = 0.0
    for n in range(s.velocities.shape[0]):
        j = s.velocities[n]
        late = x.left_late[j - 1]
        if late != 0.0:
            source = s.turning[j, i]
            moved = x.mixed[j - 1, i]
            if source > 0:
                moved += s.turned[j, i] * phi[source]
            total += late * x.mixed[q, j] * power_of(s, j, ratio_of(x)) * moved
    return float(total * total)


@compiled
def bank_errors(
    s: BankSettings,
    x: BankState,
    q: int,
    noise: Array,
    away: Array,
    phi: Array,
    ratio: float,
    products: Array,
    bias: Array,
    errors: Array,
) -> float:
    """Fill in the standard errors of row q's estimates.

    Parameters
    ----------
    s, x
        Settings and state.
    q
        Identified row.
    noise
        (r,) variance of the noise in the states, as regressors.
    away
        (r,) squares by which the states that the estimates are wanted at may be others.
    phi, ratio
        (p,) regressors, constant first, and ratio of speeds where the estimates are wanted, see `bank.speed.seen_at`.
    products, bias
        (m,) and (p,) scratch; ``bias[0]`` out, the error of S, see `bank.speed`.
    errors
        (p,) out, constant last; infinite before anything can be known.

    Returns
    -------
    float
        Standard deviation of the residual [output]; NaN before there is any data.
    """
    p = errors.shape[0]
    residual = math.sqrt(x.residual[q, 0] / x.residual[q, 1]) if x.residual[q, 1] > 0.0 else math.nan
    leader = leading_member(x, q, products)
    if direct_squares(s, x, q, leader, noise, products, bias, errors):
        correct(s, x, q, leader, noise, bias, errors)
    find_changes(s, x, q)
    sum_square = 0.0
    here = distance_from_place(s, x, phi)
    for i in range(p):
        value = x.mixed[q, i] + x.shift[q, i] - x.best_correction[q, i]
        carried = carried_square(s, x, q, i, value) + withdrawn_square(x, q, i, value)
        part = s.exponent[i] * phi[i]
        if part != 0.0:
            sum_square += part * part * min(errors[i], carried)
        errors[i] = min(errors[i], carried) if is_learnt(s, x, q, i, leader) else carried
    for i in range(p):
        source, part, power = s.turning[q + 1, i], s.turned[q + 1, i], power_of(s, i, ratio)
        square = errors[i] * doubt(s, x, i) + suspect_square(s, x, q, i) + x.window_change[i]
        square += turned_square(s, x, q, i, here)
        if s.effectors_from < i <= s.effectors_to:
            square += instead_square(s, x, q, i)
        if i <= s.effectors_from:
            square += elsewhere_square(s, x.mixed[q, i], i, here, 0.0)
        if i <= s.effectors_from:
            square += delay_square(s, x, q, i, phi)
        square *= power * power
        if source > 0:
            own = part / power_of(s, source, ratio_of(x))
            square += own * own * (measured_noise(s, x, source - 1, noise[source - 1]) + away[source - 1])
        slope = slope_by_speed(s, phi, i, ratio)
        if i == 0 and s.scaled:
            square += sum_square
        elif slope != 0.0:
            square += slope * slope * sum_square + 2.0 * power * slope * s.exponent[i] * phi[i] * errors[i]
        if slope != 0.0 and rests_on_unlearnt(s, x, q, phi, i, ratio, leader):
            square = math.inf
        bias[i] = math.sqrt(square)
    for i in range(p):
        errors[(i + p - 1) % p] = bias[i]
    bias[0] = math.sqrt(sum_square)
    return residual


@compiled
def factor_covariance(R: Array, m: int, variance: float, V: Array, covariance: Array) -> None:
    """``variance (R'R)^-1`` of member m: (p, p, m), scratch (p, p), (p, p) out."""
    p = covariance.shape[0]
    for k in range(p):
        V[k, k] = 1.0 / R[k, k, m]
        for i in range(k):
            total = 0.0
            for n in range(i, k):
                total += V[i, n] * R[n, k, m]
            V[i, k] = -total * V[k, k]
    for i in range(p):
        for j in range(i + 1):
            total = 0.0
            for k in range(i, p):
                total += V[i, k] * V[j, k]
            covariance[i, j] = variance * total
            covariance[j, i] = variance * total
