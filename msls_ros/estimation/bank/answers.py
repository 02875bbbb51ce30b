"""Whether outputs answer the noise of the deflections: second differences, held against prediction errors.

With second differences w of a deflection (in phase with what oscillates), the prediction error e of a row and the
effect theta that is known, sums over seconds at every delay l that is looked for, -20 to 20 ms, say what the output
does by them::

    C_l = sum (e_(k+l) w_k + c_l theta w_k^2) g_k,      z^2 = C' G^-1 C / (s^2 sum w^2 g)

``-theta n`` of the noise n is in e; c_l is as much of n_(k+l) as goes with w_k, so that C_l is none where nothing
answers. G is the autocorrelation of w of noise: with it all delays count together, as chi square; one alone is enough,
too. Within three standard deviations all is noise, from twice that square on nothing
(`bank.effector_noise.find_noise`). ``g`` is less where the error is usually larger than `UNUSUAL` times the residual s,
squared (generalised least squares): in manoeuvres model errors are. Deflections that are taken back by part of a sample
are mixed of two of their values, and so are c_l and G (`find_parts`).

Why so: by the whole deflection an input, a thousand times the noise, went with it by chance, by 5,600 squared standard
errors, and was remembered; errors are what inputs leave. At one time alone what is late by .6 of a sample is a quarter
of a period behind and passes for noise: its delay is not found then. Edges, which hide for seconds what is noise, are
left out; what an output does counts no more than three times what it usually does, for one step of it answered noise
for 20 s.

Through windows second differences hold motion too; there it is third ones, and at their end what the output does by the
whole deflection, of rates alone: one step ahead a window leaves next to nothing of others.

References
----------
White, "A heteroskedasticity-consistent covariance matrix estimator", Econometrica 48 (1980) (why errors that are not
alike are weighed). Wilson and Hilferty, "The distribution of chi-square", PNAS 17 (1931).
"""

from __future__ import annotations

import math

from msls_ros.estimation.bank.lags import MOMENTS
from msls_ros.estimation.bank.loop_settings import BankSettings
from msls_ros.estimation.bank.state import BankState
from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array

MEDIAN = 0.4549
"""Median of the square of a standard normal variable."""
PACE = 0.005
"""By which share the median moves with a sample; faster in the first ones."""
FIRST_PACE = 2.0
"""That over the number of samples so far: with 1, one small first value is seen for 10 s at 25 Hz."""
FIRST_VALUES = 20
"""Among so many values a median begins with the first that is not nothing: in steps, noise is that now and then."""
EDGE = 9.0
"""Squared standard deviations, as the median has them, beyond which a difference is an edge."""
UNUSUAL = 4.0
"""From how many times the squared residual on an error is weighed less [1].

Of 20 half stabilators of the F-16 at medium noise 14 are named with 4, none wrongly; with 2 11, one wrongly; with 1,
and all delays together alone, 7, one wrongly. For the elevons of a flying wing that is better.
"""
ANSWERED = 9.0
"""Squared standard errors by which an output may go with the noise by chance, of several rows and seconds, at one time.

At all delays together the quantile of chi square that this is of one degree, `BankSettings.answered`.
"""


@compiled
def median_of(median: float, value: float, least: float, begun: int) -> float:
    """Return the median square after so manieth a value; negative ones count for nothing."""
    if begun < 0:
        return median
    square = value * value
    if begun == 0 or (begun < FIRST_VALUES and median <= least):
        return square
    pace = 1.0 + max(PACE, FIRST_PACE / (begun + 1.0))
    return max(median * pace if square > median else median / pace, least)


@compiled
def observe_answer(s: BankSettings, x: BankState, q: int, phi: Array, y: float, expected: float) -> None:
    """Update how row q's output y goes with what may be noise of the effectors (`observe_whites`).

    The estimates are those from before all samples of the difference: those of now go with it, for members of a short
    memory have learnt from the noise in it. ``expected`` is by what the square of the error by the regressor phi (p,),
    constant first, is larger than that of the residual, for the estimates are not known yet. What is usual goes up and
    down by a half with a sample: it follows dither that begins, and no single step.
    """
    theta = x.mixed[q]
    back = 1 + (x.deflections.shape[0] + s.straddle) // s.stride
    if x.learning[0] == 0 and x.kept[0] - x.kept[1] > back:
        theta = x.kept_theta[(x.kept[0] - 1 - back) % x.kept_theta.shape[0], q]
    error = y
    for i in range(phi.shape[0]):
        error -= theta[i] * phi[i]
    residual = x.residual[q, 0] / x.residual[q, 1] if x.residual[q, 1] > 0.0 else 0.0
    if s.straddle > 0:
        observe_smoothed(s, x, q, phi, theta, error, expected, residual)
    else:
        observe_late(s, x, q, theta, error, expected, residual)


@compiled
def observe_late(
    s: BankSettings, x: BankState, q: int, theta: Array, error: float, expected: float, residual: float
) -> None:
    """`observe_answer` of what is measured: by the prediction error, at every delay that is looked for.

    It holds what the estimates make of the noise, with the opposite sign; as much as goes with the difference is added.
    """
    usual = median_of(x.white_answered[q, 0], error / math.sqrt(expected), MEDIAN * residual, 3)
    x.white_answered[q, 0] = usual
    most = math.sqrt(EDGE / MEDIAN * usual * expected)
    most_usual = UNUSUAL * MEDIAN * residual
    weight = 1.0 / expected if usual <= most_usual else most_usual / (usual * expected)
    k = x.samples[0]
    lags = x.white_errors.shape[1]
    x.white_errors[q, k % lags] = min(max(error, -most), most)
    for j in range(x.whites.shape[1]):
        white = x.whites[(k + 1 - s.late) % x.whites.shape[0], j]
        weighed = white * weight
        power = white * weighed
        x.white_power[q, j] = s.colour_forgetting * x.white_power[q, j] + power
        x.rest_power[q, j] += power
        known = theta[s.effectors_from + 1 + j] * power
        for lag in range(lags):
            cross = x.white_errors[q, (k + 1 + lag - lags) % lags] * weighed + x.white_parts[s.kind[q], lag] * known
            x.white_cross[q, j, lag] = s.colour_forgetting * x.white_cross[q, j, lag] + cross
            x.rest_cross[q, j, lag] += cross


@compiled
def observe_smoothed(
    s: BankSettings, x: BankState, q: int, phi: Array, theta: Array, error: float, expected: float, residual: float
) -> None:
    """`observe_answer` through a window: by what the output does by the whole deflection and beyond the model."""
    for j in range(x.whites.shape[1]):
        i = s.effectors_from + 1 + j
        used = error + theta[i] * (phi[i] - x.quick_mean[i])
        usual = median_of(x.white_answered[q, j], used / math.sqrt(expected), MEDIAN * residual, 3)
        x.white_answered[q, j] = usual
        most = math.sqrt(EDGE / MEDIAN * usual * expected)
        used = min(max(used, -most), most)
        own = x.whites[x.samples[0] % x.whites.shape[0], j]
        white = own / expected
        x.white_cross[q, j, 0] = s.colour_forgetting * x.white_cross[q, j, 0] + used * white
        x.white_power[q, j] = s.colour_forgetting * x.white_power[q, j] + own * white
        quick = phi[i] - x.quick_mean[i]
        left = min(max(error, -most), most)
        x.rest_cross[q, j, 0] += left * quick / expected
        x.rest_power[q, j] += quick * quick / expected
        x.rest_square[q, j] += left * left / expected


@compiled
def find_parts(s: BankSettings, x: BankState) -> None:
    """Fill in ``x.white_parts``, c_l, and the factor of ``x.white_factor``, of noise that is taken back by a delay.

    By part of a sample, noise is mixed of two of its values; of deflections that forces are late by, other two.
    """
    lags = x.white_parts.shape[1]
    whole = int(x.delay[MOMENTS, 0])
    part = x.delay[MOMENTS, 0] - whole
    size = noise_of_second(0, part)
    for kind in range(x.white_parts.shape[0]):
        offset = int(x.delay[kind, 0]) - whole
        own = x.delay[kind, 0] - int(x.delay[kind, 0])
        for lag in range(lags):
            shift = lag - s.late - offset
            ends = common_noise(shift - 1, part, own) + common_noise(shift + 1, part, own)
            x.white_parts[kind, lag] = (ends - 2.0 * common_noise(shift, part, own)) / (s.second * size)
    factor = x.white_factor
    for j in range(lags):
        for k in range(j + 1):
            left = noise_of_second(j - k, part) / size
            for i in range(k):
                left -= factor[j, i] * factor[k, i]
            factor[j, k] = math.sqrt(left) if j == k else left / factor[k, k]


@compiled
def noise_of_second(shift: int, part: float) -> float:
    """Covariance of second differences of noise that is late by ``part`` of a sample, so many samples on."""
    total = 6.0 * common_noise(shift, part, part)
    total -= 4.0 * (common_noise(shift - 1, part, part) + common_noise(shift + 1, part, part))
    return total + common_noise(shift - 2, part, part) + common_noise(shift + 2, part, part)


@compiled
def common_noise(shift: int, part: float, own: float) -> float:
    """Covariance of white noise that is late by ``part`` of a sample, and by ``own`` of one, so many samples on."""
    if shift == 0:
        return (1.0 - part) * (1.0 - own) + part * own
    if shift == 1:
        return (1.0 - part) * own
    if shift == -1:
        return part * (1.0 - own)
    return 0.0


@compiled
def square_of_answers(s: BankSettings, x: BankState, q: int, j: int) -> float:
    """Return what row q does by the second differences of effector j, squared, over what it may do by chance.

    At one delay, or at all of them together, ``C' G^-1 C``.
    """
    lags = x.white_cross.shape[2]
    largest = 0.0
    for m in range(lags):
        largest = max(largest, x.white_cross[q, j, m] * x.white_cross[q, j, m])
    if lags == 1:
        return float(largest / ANSWERED)
    total = 0.0
    for m in range(lags):
        left = x.white_cross[q, j, m]
        for i in range(m):
            left -= x.white_factor[m, i] * x.white_solved[i]
        x.white_solved[m] = left / x.white_factor[m, m]
        total += x.white_solved[m] * x.white_solved[m]
    return float(max(largest / ANSWERED, total / s.answered))
