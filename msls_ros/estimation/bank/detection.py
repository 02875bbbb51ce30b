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

from msls_ros.estimation.bank.allowances import (
    find_shapes,
    moved_square,
    observe_states,
    rounding_square,
    take_motion,
    timing_square,
    uncertainty_of,
    unknown_square,
)
from msls_ros.estimation.bank.answers import observe_answer
from msls_ros.estimation.bank.drag import drag_square
from msls_ros.estimation.bank.effector_noise import observe_entry
from msls_ros.estimation.bank.energy import observe_novelty
from msls_ros.estimation.bank.fed_noise import observe_followers
from msls_ros.estimation.bank.loop_settings import BankSettings
from msls_ros.estimation.bank.state import BankState
from msls_ros.estimation.bank.statistics import change_of, mean_change_of, remember_mean, remember_square
from msls_ros.estimation.bank.together import observe_together
from msls_ros.estimation.bank.waiting import begins_to_move, wait_for_motion
from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array, Integers

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
    observe_together(s, x)
    learning = x.learning[0] > 0 or begins_to_move(s, x)
    expected = 1.0
    axial = 0.0
    predictors = x.predictors[x.samples[0] % x.predictors.shape[0]]
    take_motion(s, x, phi)
    observe_states(s, x)
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
