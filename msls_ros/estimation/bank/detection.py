"""Detection of abrupt changes in the bank: the last squared prediction errors against older ones, one setting.

``u`` is the squared one-step error of the member that predicts best (`BankState.sharpest`), or of the mixture if that
is smaller: what either of them predicts has not changed. (The former remembers a tenth of a second; it knows nothing of
an effector that has rested since, and errs when it moves again.) Over windows of a few lengths l the mean of the last
errors is compared with the nominal one, each in units of what noise alone reaches once in 1e8 samples (quantile q_l of
chi^2_l / l); the largest counts::

    T = max_l  mean_l( u_k / ((1 + d_k) n_k) ) / q_l / ( max(base, mean_l moved_k) + floor^2 energy )

An alarm is ``T > threshold``; of the row of u, where no other alarms, with what drag may do allowed for (`bank.drag`).
``base`` is the mean of u older than the longest window, ``moved = sum se_i^2 h_i^2`` what the standard errors of the
estimates allow the motion h of the last tenth of a second (`BankState.quick`) to be mispredicted by, at the time of
each error: that the motion has ended excuses its errors no less. ``energy`` is what the output had when it was excited
(`bank.energy`): model errors go with the manoeuvre, and the floor does not fade in the quiet before the next one. What
is mispredicted while nothing moves is no model error, so the floor can be low. ``d`` is that of the reference member,
the longest memory, and ``n`` by how much a regressor exceeds all that was seen of it: what is excited for the first
time cannot be called changed; it is learnt: no alarm for a second after a regressor goes five times as far as ever
before. Of an effector that no output has answered yet (`bank.attenuation.doubt`) nothing is known: where it goes five
times as far as in the last seconds its errors excuse whatever it does, and where it goes two and a half times as far an
alarm waits for the next sample. Where one goes twice as far as usual, the error that its own standard error allows is
added to the nominal one, times q_1 for every l: it is the same error in all samples. No noise level enters anywhere.

Effectors that a law has always moved together are known together, and none of them by itself: of what their standard
errors allow as much counts as ``h' V h`` is of ``sum V_ii h_i^2``, V the inverse of the reference member's information;
what is a share of each estimate (`common_square`) counts wholly. A delta with four elevons (2.5 t, 100 Hz, not one of
ours, rates differentiated, half of one lost in use or at rest, six flights): .5 to .9 rad/s^2 were mispredicted of a
noise of .03, .6 to .8 allowed, and none alarmed; now 4 do. With the states in that sum, noise in them alarms: 22 false
alarms in 216 flights of six other aircraft, 8 without and with effectors alone, and no loss more.

Where inputs have passed a window, a change comes in over all of its samples, and what predicts one sample ahead follows
it half-way: a third of it shows. So predictions are by the estimates of a whole window ago, ``moved`` is by what has
moved since, and as the errors of one window go together, q_l is that of fewer independent ones: by the autocorrelation
of white noise that has passed it, for slopes and for smoothed values (`bank.settings.independent_squares`).

Slopes of rates are noisy, but their sum is a difference of two rates, and other noise averages as well, while an
effector that has lost its effect is held for longer than a sample. So of rows of angular rates the mean prediction
error over a window is looked at too, with its sign, against what it is usually, and no less is allowed for model error
than above (as measured, F-16, seeds 100 to 119: of 20 half stabilators at medium noise 9 are seen within a second and
18 named, 6 and 16 without; at low noise after .08 s at worst, .7 s without; made-up linear aircraft, seeds 3000 to
3119: 31 of 62 losses within 3 s, 29 without, 12 false alarms either way)::

    T = max_l  (mean_l e)^2 / ( max(t^2 base_l, q_l mean_l moved_k) + q_l floor^2 energy )

``base_l`` is the mean of older such squares, t that quantile of Student's with as many degrees of freedom as the
windows in it that do not overlap, half as many again for those that do: ``1.5 (sum w)^2 / (l sum w^2)`` by its weights.

A fault seldom shows in one equation alone: where two rows reach two fifths of the threshold at once, both alarm
(`PAIR`; `SMOOTHED_PAIR` through a window); and with the first alarm, and for the longest window after it, a third of
the threshold suffices for the other rows (`LIKELY`), by the standard errors of before, which the fault itself has not
made wider yet.

References
----------
Wallace, "Bounds on normal approximations to Student's and the chi-square distributions", Ann. Math. Statist. 30 (1959).
"""

from __future__ import annotations

import math

from msls_ros.estimation.bank.answers import observe_answer
from msls_ros.estimation.bank.attenuation import doubt
from msls_ros.estimation.bank.delay import deflection_of
from msls_ros.estimation.bank.drag import drag_square
from msls_ros.estimation.bank.effector_noise import observe_entry, rounding_noise
from msls_ros.estimation.bank.energy import FIRST, observe_novelty
from msls_ros.estimation.bank.fed_noise import observe_followers
from msls_ros.estimation.bank.loop_settings import BankSettings
from msls_ros.estimation.bank.state import BankState
from msls_ros.estimation.bank.uncertainty import common_square
from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.elementary import exponential
from msls_ros.estimation.kernel import Array, Integers
from msls_ros.estimation.regressor_noise import OVERLAP

LIKELY = 1.0 / 3.0
"""Share of the threshold that suffices for other rows where one has just alarmed: what noise reaches once in 1e3."""
PAIR = 0.41
"""Share of the threshold that suffices where two rows reach it at once.

Noise reaches that, by every window, once in 1e4 at most: two rows at once no oftener than one reaches the whole.
"""
SMOOTHED_PAIR = 0.6
"""The same where inputs have passed a window: the edge of a gust comes in over all of its samples, in several rows.

16 intact flights of 300 s in moderate air, none and low noise, seeds 904 to 907: 3 false alarms, 7 with .41. Faults of
the F-16 seen, seeds 811 and 812: 22 of 36, not 23, half ailerons of four and of thirteen other aircraft as before.
"""
RESOLUTION = 1e-10
"""Square of the change that counts at least [(m/s^2)^2, (rad/s^2)^2]: of 1 micro-g, the best that a sensor resolves.

A simulated aircraft in trim has no residual but that of arithmetic, which changes.
"""
UNKNOWN = 60.0
"""Exponent beyond which a quantile of Student's t is as good as infinite: next to nothing is known of the variance."""
BY_NOISE = 9.0
"""Squared standard deviations of the noise in a deflection beyond which it is motion."""
BEGINS = 6.25
"""Squared deviations, over their mean in the last seconds, from which an effector may begin to move: one in 80 is."""
MAY_BEGIN = 2.71
"""The same from which it may begin within the noise of its record: one in ten is (those below had 3.6 to 5.8)."""
WITHIN_NOISE = 2
"""Samples for which the noise of its record may hide that an effector has begun to move: then it is out.

Four aircraft in flight test, .05 deg of noise in their surfaces, 24 flights: 5 alarmed at first inputs without it.
"""
FURTHER = 4.0
"""Squared deviation over the energy remembered from which a regressor goes further than usual."""


@compiled
def sense_bank(
    s: BankSettings, x: BankState, phi: Array, y: Array, e: Array, statistic: Array, alarm: Integers, row: Array
) -> bool:
    """Prediction errors and change statistics of all rows; True where any row alarms.

    Parameters
    ----------
    s, x
        Settings and state before the sample.
    phi
        (p,) regressor, constant first.
    y
        (r,) outputs.
    e, statistic, alarm
        (r,) out.
    row
        (p,) scratch.
    """
    any_alarm = False
    group = -1
    longitudinal = 0.0
    lateral = 0.0
    novelty = observe_novelty(s, x, phi)
    learning = x.learning[0] > 0 or begins_to_move(s, x)
    expected = 1.0
    axial = 0.0
    predictors = x.predictors[x.samples[0] % x.predictors.shape[0]]
    take_motion(s, x, phi)
    for q in range(y.shape[0]):
        keep_predictors(x, q)
        e[q] = prediction_error(x.mixed[q], phi, y[q])
        statistic[q] = 0.0
        alarm[q] = 0
        if x.group[q] != group:
            group = x.group[q]
            longitudinal = 0.0
            lateral = 0.0
        if s.row_axis[q] == 0:
            if longitudinal == 0.0:
                longitudinal = (1.0 + uncertainty_of(x.R[group], s.reference[0], phi, row)) * novelty
                find_shapes(s, x, group, 0, row)
            expected = longitudinal
        else:
            if lateral == 0.0:
                lateral = (1.0 + uncertainty_of(x.R[group], s.reference[1], phi, row)) * novelty
                find_shapes(s, x, group, 1, row)
            expected = lateral
        if x.age[group] > 2 * phi.shape[0]:
            observe_answer(s, x, q, phi, y[q], expected)
            if s.straddle == 0:
                observe_entry(s, x, q, e[q])
            else:
                observe_followers(s, x, q, phi, y[q])
        if not s.detect:
            continue
        error = prediction_error(predictors[0, q], phi, y[q])
        sharp = prediction_error(predictors[1, q], phi, y[q])
        statistic[q], alone, alarms = detect_change(s, x, q, phi, error, sharp, expected, learning)
        if q == s.axial:
            axial = alone
        if alarms:
            alarm[q] = 1
            any_alarm = True
    wanted = any_alarm or (not learning and is_pair(s, statistic))
    if x.alert[0] > 0:
        x.alert[0] -= 1
    elif wanted or x.waits[0] > 0:
        for q in range(y.shape[0]):
            if wanted and statistic[q] > LIKELY * s.threshold:
                alarm[q] = 1
        any_alarm = wait_for_motion(s, x, learning, statistic, alarm)
        x.alert[0] = x.ring.shape[1] if any_alarm else 0
    if s.axial >= 0 and alarm[s.axial] == 0:
        statistic[s.axial] = axial
    return any_alarm


@compiled
def prediction_error(theta: Array, phi: Array, y: float) -> float:
    """Return ``y - theta phi``, summed from the first regressor on; (p,) both."""
    left = y
    for i in range(phi.shape[0]):
        left -= theta[i] * phi[i]
    return left


@compiled
def detect_change(
    s: BankSettings, x: BankState, q: int, phi: Array, error: float, sharp: float, expected: float, learning: bool
) -> tuple[float, float, bool]:
    """Hold the prediction errors of row q against what is usual; what is usual is remembered.

    Parameters
    ----------
    s, x
        Settings and state before the sample.
    q
        Row.
    phi
        (p,) regressor, constant first.
    error, sharp
        Prediction errors, of the mixed estimates and of the sharpest member [output].
    expected
        Square of the error that is expected here, over the usual one [1].
    learning
        Whether nothing alarms yet.

    Returns
    -------
    tuple
        The statistic; that by which the row alarms when no other does, for drag may change the row of u; whether it
        alarms.
    """
    square = sharp * sharp
    smaller = min(square, error * error)
    surprise = smaller / expected
    signed = (sharp if square < error * error else error) / math.sqrt(expected)
    moved, unknown = moved_square(s, x, q), unknown_square(s, x, q, phi)
    timing = timing_square(s, x, q)
    moved += rounding_square(s, x, q) + max(timing, x.timing[q])
    x.timing[q] = timing
    excused = moved + drag_square(s, x) if q == s.axial else moved
    statistic = alone = 0.0
    if x.counted[q] >= x.ring.shape[1] and x.base[q, 1] >= s.rest:
        statistic = change_of(s, x, q, surprise, moved, unknown, x.allowed[q])
        if s.differenced[q] != 0:
            statistic = max(statistic, mean_change_of(s, x, q, signed, moved, unknown))
        alone = statistic if q != s.axial else change_of(s, x, q, surprise, excused, unknown, x.excused)
    joins = x.alert[0] > 0 and statistic > LIKELY * s.threshold
    if (alone > s.threshold or joins) and not learning:
        return statistic, alone, True
    if s.differenced[q] != 0 and x.counted[q] >= 0:
        remember_mean(s, x, q, signed)
    remember_square(s, x, q, square, smaller, surprise, moved)
    if q == s.axial and x.counted[q] > 0:
        x.excused[(x.counted[q] - 1) % x.excused.shape[0]] = excused
    return statistic, alone, False


@compiled
def is_pair(s: BankSettings, statistic: Array) -> bool:
    """Whether two rows at least are so far above what is usual that both alarm: (r,) statistics."""
    above = 0
    share = PAIR if s.straddle == 0 else SMOOTHED_PAIR
    for q in range(statistic.shape[0]):
        above += 1 if statistic[q] > share * s.threshold else 0
    return above > 1


@compiled
def uncertainty_of(R: Array, m: int, phi: Array, w: Array) -> float:
    """Return ``d = phi' (R'R)^-1 phi`` of member m by substitution, ``R' w = phi``; (p, p, m), (p,), scratch (p,)."""
    d = 0.0
    for j in range(phi.shape[0]):
        total = phi[j]
        for k in range(j):
            total -= R[k, j, m] * w[k]
        w[j] = total / R[j, j, m]
        d += w[j] * w[j]
    return d


@compiled
def take_motion(s: BankSettings, x: BankState, phi: Array) -> None:
    """Fill in ``x.moving`` (2, p): what effectors move now beyond noise, and how far phi (p,) is from their means."""
    for i in range(s.effectors_from + 1, s.effectors_to + 1):
        moves = x.quick[i] * x.quick[i] > noise_limit(s, x, i)
        x.moving[0, i] = x.quick[i] if moves else 0.0
        x.moving[1, i] = phi[i] - x.phi_mean[i]


@compiled
def find_shapes(s: BankSettings, x: BankState, g: int, axis: int, row: Array) -> None:
    """Find ``x.shapes`` (2, axes): the error of what `take_motion` found together, over that of each by itself."""
    m = s.reference[axis]
    for k in range(2):
        alone = 0.0
        for i in range(s.effectors_from + 1, s.effectors_to + 1):
            alone += x.moving[k, i] * x.moving[k, i] / x.info[g, i, m]
        together = uncertainty_of(x.R[g], m, x.moving[k], row) if alone > 0.0 else 0.0
        x.shapes[k, axis] = min(together / alone, 1.0) if alone > 0.0 else 1.0


@compiled
def unknown_square(s: BankSettings, x: BankState, q: int, phi: Array) -> float:
    """Squared error that row q may have because regressors go further than those that its estimates are known by."""
    total = 0.0
    for i in range(1, phi.shape[0]):
        deviation = phi[i] - x.phi_mean[i]
        if deviation * deviation > max(FURTHER * x.phi_remembered[i], noise_limit(s, x, i)):
            shape = x.shapes[1, s.row_axis[q]] if s.effectors_from < i <= s.effectors_to else 1.0
            total += shape * deviation * deviation * x.square_moved[q, i] * doubt(s, x, i)
    return total


@compiled
def noise_limit(s: BankSettings, x: BankState, i: int) -> float:
    """Square that the noise in the deflections hardly ever makes of regressor i (constant first); 0 for states."""
    if not s.effectors_from < i <= s.effectors_to:
        return 0.0
    return float(BY_NOISE * x.third_noise[i - s.effectors_from - 1])


@compiled
def rounding_square(s: BankSettings, x: BankState, q: int) -> float:
    """Squared error that row q may have by the rounding of the recorded deflections."""
    total = 0.0
    for j in range(x.quantum.shape[1]):
        effect = x.mixed[q, s.effectors_from + 1 + j]
        total += effect * effect * rounding_noise(s, x, j)
    return total


@compiled
def timing_square(s: BankSettings, x: BankState, q: int) -> float:
    """Squared error that row q may have because it is not known when between two samples a deflection moved.

    Of a step at any time of a sample that acts a part p of one late, all or nothing has acted, and p of it is reckoned
    with: ``p (1-p)`` of its square, and as much more as p is not known. What a short memory has learnt from it shows in
    the sample after it. Windows smooth steps.
    """
    if s.straddle > 0:
        return 0.0
    slot = x.samples[0] % x.recent.shape[0]
    whole = int(x.delay[s.kind[q], 0])
    part = x.delay[s.kind[q], 0] - whole
    share = part * (1.0 - part) + min(x.delay[s.kind[q], 1] * s.late * s.late, 0.25)
    total = 0.0
    for j in range(x.recent.shape[1]):
        i = s.effectors_from + 1 + j
        step = deflection_of(s, x, slot - whole, 0.0, j) - deflection_of(s, x, slot - whole, 1.0, j)
        if step * step > noise_limit(s, x, i):
            total += x.mixed[q, i] * x.mixed[q, i] * step * step * share
    return total


@compiled
def first_limit(s: BankSettings, x: BankState, i: int, share: float) -> float:
    """Square from which a deflection goes further than in the last seconds: ``share`` of their mean square.

    Against the noise alone one that a law has hardly moved yet would hide losses of others: half ailerons held in
    flight test through windows, seed 851: 10 of 12 are seen, 4 with five standard deviations of the noise.
    """
    if not s.effectors_from < i <= s.effectors_to or x.quick_samples[0] <= 0.0:
        return math.inf
    return float(share * x.moment[i, i] / x.quick_samples[0])


@compiled
def begins_to_move(s: BankSettings, x: BankState) -> bool:
    """Whether an effector that no output has answered yet may have begun to move: an alarm can wait for that."""
    for j in range(x.answered.shape[0]):
        i = s.effectors_from + 1 + j
        if x.answered[j] == 0 and x.quick[i] * x.quick[i] > first_limit(s, x, i, BEGINS):
            return True
    return False


@compiled
def wait_for_motion(s: BankSettings, x: BankState, learning: bool, statistic: Array, alarm: Integers) -> bool:
    """Hold alarms (r,) back while an effector may have begun to move; return whether they are raised now.

    Whether one has shows in the next samples: then it goes on (``learning``), and what alarmed is learnt.
    """
    if x.waits[0] == 0:
        if not may_begin_to_move(s, x):
            return True
        x.waits[0] = WITHIN_NOISE + 1
        x.held_statistic[:] = 0.0
    x.waits[0] = 0 if learning else x.waits[0] - 1
    raised = x.waits[0] == 0 and not learning
    for q in range(alarm.shape[0]):
        if alarm[q] != 0:
            x.held_statistic[q] = max(x.held_statistic[q], statistic[q])
        alarm[q] = 1 if raised and x.held_statistic[q] > 0.0 else 0
        if raised:
            statistic[q] = max(statistic[q], x.held_statistic[q])
    return bool(raised)


@compiled
def may_begin_to_move(s: BankSettings, x: BankState) -> bool:
    """Whether an effector that no output has answered goes further than its noise does in nine of ten samples."""
    for j in range(x.answered.shape[0]):
        i = s.effectors_from + 1 + j
        resting = x.answered[j] == 0 and x.third_noise[j] > 0.0
        if resting and x.quick[i] * x.quick[i] > first_limit(s, x, i, MAY_BEGIN):
            return True
    return False


@compiled
def moved_square(s: BankSettings, x: BankState, q: int) -> float:
    """Squared error that row q's standard errors allow the motion since they were made (`BankState.quick`)."""
    total = 0.0
    for i in range(1, x.quick.shape[0]):
        now = x.quick[i] * x.quick[i]
        if now > noise_limit(s, x, i):
            square = x.square_moved[q, i]
            if now > first_limit(s, x, i, FIRST):
                square *= doubt(s, x, i)
            if x.alert[0] > 0:
                square = min(square, x.square_past[1, q, i])
            if s.effectors_from < i <= s.effectors_to:
                shares = min(common_square(x, q, i), square)
                square = shares + x.shapes[0, s.row_axis[q]] * (square - shares)
            total += now * square
    return total


@compiled
def change_of(
    s: BankSettings, x: BankState, q: int, surprise: float, moved: float, unknown: float, past: Array
) -> float:
    """Return the statistic of row q, armed, with the squared error of now and what the motion of now allows of it.

    ``past`` (w,) is what it allowed in the samples before. The error of an estimate is the same in all samples of a
    window, it does not average: its quantile is that of one.
    """
    size = x.ring.shape[1]
    total = surprise
    allowed = moved
    taken = 1
    largest = 0.0
    usual = x.base[q, 2] / x.base[q, 1]
    floor = s.floor * s.floor * x.remembered[q] + RESOLUTION
    for i in range(s.windows.shape[0]):
        while taken < s.windows[i]:
            slot = (x.counted[q] - taken) % size
            total += x.surprise[q, slot]
            allowed += past[slot]
            taken += 1
        nominal = max(usual, allowed / s.windows[i]) + floor
        limit = nominal * s.quantiles[q, i] + unknown * s.quantiles[q, 0]
        if total > largest * limit * s.windows[i]:
            largest = total / s.windows[i] / limit if limit > 0.0 else 0.0
    return largest


@compiled
def mean_change_of(s: BankSettings, x: BankState, q: int, signed: float, moved: float, unknown: float) -> float:
    """Return the statistic of the mean prediction errors of row q, armed and of a rate, with the one of now."""
    size = x.ring.shape[1]
    total = signed
    allowed = moved
    taken = 1
    largest = 0.0
    floor = s.floor * s.floor * x.remembered[q] + RESOLUTION
    sums = x.mean_base[q]
    for i in range(1, s.windows.shape[0]):
        while taken < s.windows[i]:
            slot = (x.counted[q] - taken) % size
            total += x.signed[q, slot]
            allowed += x.allowed[q, slot]
            taken += 1
        mean = total / s.windows[i]
        free = OVERLAP * sums[0] * sums[0] / sums[1] / s.windows[i]
        noise = student_square(s.quantiles[q, 0], free) * sums[i + 2] / sums[0]
        model = s.quantiles[q, i] * (allowed / s.windows[i])
        nominal = max(noise, model) + s.quantiles[q, i] * floor + s.quantiles[q, 0] * unknown
        if mean * mean > largest * nominal:
            largest = mean * mean / nominal if nominal > 0.0 else 0.0
    return largest


@compiled
def student_square(square: float, free: float) -> float:
    """Return the quantile of the square of Student's t where that of a normal variable is ``square`` (Wallace)."""
    ratio = (8.0 * free + 3.0) / (8.0 * free + 1.0)
    return free * (exponential(min(square * ratio * ratio / free, UNKNOWN)) - 1.0)


@compiled
def remember_mean(s: BankSettings, x: BankState, q: int, signed: float) -> None:
    """Push a prediction error of a rate's row into its window; means that leave it enter the usual ones."""
    size = x.ring.shape[1]
    slot = x.counted[q] % size
    sums = x.mean_base[q]
    if x.counted[q] >= size:
        sums[0] = s.mean_forgetting * sums[0] + 1.0
        sums[1] = s.mean_forgetting * s.mean_forgetting * sums[1] + 1.0
        for i in range(1, s.windows.shape[0]):
            sums[i + 2] = s.mean_forgetting * sums[i + 2] + x.mean_square[q, i, slot]
    x.signed[q, slot] = signed
    total = signed
    taken = 1
    for i in range(1, s.windows.shape[0]):
        while taken < s.windows[i]:
            total += x.signed[q, (x.counted[q] - taken) % size]
            taken += 1
        mean = total / s.windows[i]
        x.mean_square[q, i, slot] = mean * mean


@compiled
def remember_square(
    s: BankSettings, x: BankState, q: int, square: float, smaller: float, surprise: float, moved: float
) -> None:
    """Push a squared error into row q's window, after the rest; what leaves it enters the nominal one."""
    if x.counted[q] < 0:
        x.counted[q] += 1
        return
    size = x.ring.shape[1]
    slot = x.counted[q] % size
    if slot == 0:
        for i in range(x.square.shape[1]):
            x.square_past[1, q, i] = x.square_past[0, q, i]
            x.square_past[0, q, i] = x.square_moved[q, i]
    if x.counted[q] >= size:
        x.base[q, 0] = s.base * x.base[q, 0] + x.ring[q, slot]
        x.base[q, 1] = s.base * x.base[q, 1] + 1.0
        x.base[q, 2] = s.base * x.base[q, 2] + x.smaller[q, slot]
    x.smaller[q, slot] = smaller
    x.ring[q, slot] = square
    x.surprise[q, slot] = surprise
    x.allowed[q, slot] = moved
    x.counted[q] += 1


@compiled
def keep_predictors(x: BankState, q: int) -> None:
    """Keep row q's estimates of now, and those of its sharpest member, to predict the next window by."""
    slot = (x.samples[0] - 1) % x.predictors.shape[0]
    for i in range(x.mixed.shape[1]):
        x.predictors[slot, 0, q, i] = x.mixed[q, i]
        x.predictors[slot, 1, q, i] = x.members[q, i, x.sharpest[q]]


@compiled
def forget_predictors(x: BankState, q: int) -> None:
    """Predict row q by its estimates of now alone."""
    for k in range(x.predictors.shape[0]):
        for i in range(x.mixed.shape[1]):
            x.predictors[k, 0, q, i] = x.mixed[q, i]
            x.predictors[k, 1, q, i] = x.members[q, i, x.sharpest[q]]
