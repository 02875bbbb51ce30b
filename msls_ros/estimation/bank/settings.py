"""From the parameters that people set to the numbers that the bank's loop takes: the grid, and what is measured."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from msls_ros.estimation.bank.answers import ANSWERED
from msls_ros.estimation.bank.feedback import LATER
from msls_ros.estimation.bank.loop_settings import BankSettings
from msls_ros.estimation.bank.loss_noise import LONGEST
from msls_ros.estimation.bank.losses import EVERY
from msls_ros.estimation.bank.ramps import LENGTHS
from msls_ros.estimation.configuration import Configuration
from msls_ros.estimation.kernel import Array, Integers
from msls_ros.estimation.kinematics import find_rotation
from msls_ros.estimation.regressor_noise import RATES
from msls_ros.estimation.surfaces import Surface, read_surfaces

PRIORS = (10.0, 300.0, 1e5)
"""Widths pi of the priors: ``R = diag(sigma/pi)``. Narrow ones hold back what a few noisy samples would say."""
DRIFTS = (0.1, 1.0, 10.0)
"""Walks kappa of the constant, per sample at `DRIFT_RATE`, over the standard deviation of the residual."""
LATERAL = ("v", "P", "R")
"""Rows that are excited together, as all others are."""
MOTION = ("u", "v", "w", "P", "Q", "R")
"""States whose effects on the aircraft go with airspeed, see `bank.speed`."""
SLOW = "u"
"""Speed changes by whatever an aircraft does: it says nothing of what excites its row's axis (with it the error of Q by
the elevator at the end of a flight test is .06, without .02)."""
FREE, APART = 0, -1
"""Kinds of members: with a share in every row; with none, for losses alone. From 1 on: held, by axis."""
DRIFT_RATE = 50.0
"""Sample rate at which kappa is quoted [Hz]."""
SIGMA = 0.01
"""The bank's unit of each regressor, as a share of its scale. A third and three times of it do as well."""
CONSTANT_PRIOR = 1e3
"""Least width of the prior of the constant, whose unit is 1."""
WIND_UP = 0.1
JUDGING = 1.0
"""Memory of the evidence in excited flight [s]."""
DELAY = 0.5
"""Of the delayed predictions [s]: several times the correlation time of the noise of real sensors."""
POWER, POWER_RATE = 0.3, 50.0
QUIET = 0.001
"""Least weight of a sample in the evidence; .0002 does as well, with .005 the quiet of a flight test outvotes it."""
ENERGY = (5.0, 0.5, 20.0, 0.5)
"""Memories of the outputs' mean, their present energy, the energy remembered, and its rise [s]."""
WINDOWS = (1, 3, 8, 20)
QUANTILES = (32.8, 13.3, 6.97, 4.25)
"""Quantile 1 - 1e-8 of chi^2 with that many degrees of freedom, over them."""
THRESHOLD = 1.5
FLOOR = 0.04
"""Of 36 half losses of an aileron, on twelve aircraft, .03 and .04 see all, .07 sees 19; .03 has more false alarms."""
BASE = 4.0
"""Memory of the nominal squared error [s]."""
MEAN_BASE = 30.0
"""Memory of what the mean of prediction errors over a window is usually: as the longest of the bank's [s].

Of 39 half losses of an aileron, rates differentiated, 33 are seen with 30 s, 31 with 12, 23 without means.
"""
REST = 20
"""Samples without detection at a start."""
RESIDUAL_MEMORY = 1.5
COLOUR_MEMORY = 4.0
"""[s]"""
LEARNING = 1.0
"""After a first excitation [s]; the longest window of the detector besides."""


Grid = Sequence[tuple[float, float, float, int]]
"""Members, see `bank_grid`."""


class Look(NamedTuple):
    """A memory in which losses of surfaces are looked for, see `bank.losses`."""

    memory: float
    """[s]"""
    back: float
    """By how much older what it is compared with is [s]."""
    stands: float
    """For how long a loss must be seen [s]."""
    limit: float
    """By how many standard errors, for so long."""
    sure: float
    """And by how many for half of that."""
    walk: float = 1.0
    """Walk of its constant, as `DRIFTS`."""


LOSSES = (
    Look(0.4, 1.0, 0.4, 4.0, 5.5),
    Look(0.1, 1.0, 0.1, 5.5, 7.0),
    Look(0.2, 1.0, 0.2, 4.7, 6.2),
    Look(1.5, 3.0, 0.4, 4.0, 5.5),
)
"""The first is the shortest at any rate and through windows; names compare it with the last.

Of .4 and 1.5 s: 32 intact flights of 300 s of the F-16, moderate air, none and low noise, seeds 904 to 911, as measured
and through windows: no false alarm of these tests; 9 with 4.5 for three tests. 136 runs of losses (F-16 seeds 811 and
812, others 1 and 811): 127 seen within 3 s both ways, 109 instead of 112 within one. Of 3.5 to 4.3 for 8 to 15 tests at
50 Hz beside 5 to 7 for 3 to 6 none has both fewer false alarms and more losses seen, nor have limits of the sum of z^2.

Shorter ones make more tests a second, and need more each: docs/bank_history.md, "Losses that only dither shows: short
memories".
"""
BLOCK = 1.0
"""Of the sums of the last seconds, see `bank.changes` [s]."""
WALK, NOISE_MEMORY = 0.3, 30.0
"""Walk of the constant, and memory of the member whose innovations say what noise is [s], where inputs have passed a
window, of the noise of which little is slow (`bank.loss_noise`).

A constant that walks by 1 follows within two samples, and only the edges of what is held show a loss; one that hardly
walks shows it late. Of 357 losses in 1,072 flights (`bank.loss_reference`) the member of .4 s by itself sees 236, 243,
250, 258 and 262 with 1, .5, .3, .2 and .1, and 37, 38, 36, 34 and 30 of them within a second; that of 1.5 s 238, 247,
253, 256 and 259. All alarm before any loss in 2 flights, but that of 1.5 s with .1 in 3. With .1 for both, names say
less is left than is (a held aileron .12 +- .07 of .5): a slow error of the model is no walk. With a further one of .4 s
and .1 three names of 114 are more, and a strong damper at rest is named lost (made-up linear seed 5108).
By the innovations of .4, 1.5, 5 and 30 s the member of .4 s alarmed falsely in 6, 4, 2 and 2 of 822 flights, and saw
207 of their losses with each.
"""
WINDOWED = (Look(0.4, 1.5, 0.4, 4.0, 5.5, WALK), Look(1.5, 3.0, 0.4, 4.0, 5.5, WALK))
"""The same there. Compared with 1, 1.5, 2 and 3 s ago the member of .4 s saw 183, 207, 206 and 190 of 289 losses in 822
flights."""
FEWEST = 5
"""Samples that the shorter memories hold at least: at 20 Hz .2 s alarms at an edge (made-up linear seed 3038)."""
RESTS, FEWEST_RESTING = 0.5, 12
"""In blocks of so long it is asked whether effectors rest [s]; and of so many samples at least."""
LANES = 4
"""Numbers that a vector instruction takes: the arrays hold the last member again until theirs is a multiple of it, for
what is left over costs as much as four times its number. A tenth of the time of a sample at 39 members."""
STRIDE = 0.1
"""Between estimates that are kept to compare with [s]."""
ENTRY = 30.0
"""Memory of whether the noise in the states is in the outputs [s]: as that of delays, both are of the sensors."""
QUICK = 0.1
"""Memory of the mean above which regressors are quick [s], of four samples at least (`QUICK_SAMPLES`).

That of the window of derivatives is added, which leaves nothing quicker than itself.
"""
QUICK_SAMPLES = 4.0
"""Of one sample nothing is quick, and what is found of delays is rounding errors: at 10 Hz estimates diverged.

Made-up linear aircraft as measured (as `benchmark linear`), 60 of seeds 4030 on at 10 Hz; 20 Hz: false alarms with 2.5
samples 3; 14, with 3 1; 8, with 4 1; 4; names 14; 22 with each. With .2 s at 50 Hz 15 of 30 losses are seen within 3 s,
17 with .1 s. Windows of derivatives hold more samples as they are.
"""
LATEST = 0.06
"""By how much deflections are taken back at most [s]."""
LATE = 0.02
"""By how much responses are looked for late, at least a sample [s]."""
LAGS = (0.035, 0.07, 0.14)
"""Of servos whose commands are recorded in place of deflections [s], see `bank.responses`.

With .045 s alone, a servo of 15 rad/s behind 30 ms: P by da .63 +- .07 of the truth after 20 s. With 35 and 60 ms
behind servos of 6 rad/s B is covered in .36 and .30 (`benchmark linear --record slow`, seeds 4120 on, 40; measured and
differentiated), with these in .86; of 10, 15 and 30 rad/s in .87 to .98 with either. Those of 4 rad/s are too slow
(.59).
"""
BACKS = (3, 5, 3, 3)
"""By how many steps of `LATE`, from none on, responses are looked for with no lag and with each of `LAGS`.

Commands .1 s late (made-up linear aircraft as measured, seeds 4200 on, 60): 27 false alarms with three of each, 13 with
these, 11 with five and no lag besides, which stand in for a servo of 7 rad/s in noise until fifty seconds have passed.
"""
EARLY = 2
"""Steps of `LATE` by which responses are looked for before the deflections: where these are recorded late.

Deflections 35 ms late (seeds 4120 on, 40): 111 false alarms with one step, 39 with two; 20 ms: 182 with none, 12.
"""
EARLY_LAGS = (1, 2)
"""Which of `LAGS` are looked for a step before the commands as well: where these are recorded late.

Made-up linear aircraft as measured, recorded 20 ms late, seeds 4200 on, 60, without and with: 28 and 17 false alarms, B
a second after them covered in .71 and .94.
"""
DELAY_OF_RECORDS = 0.018
"""Root mean square of the delays of real records, which are 10 to 25 ms: before anything is known of them [s]."""
DELAY_OF_SENSORS = 0.005
"""Standard deviation between the delays of accelerometers and of gyros, whose filters differ by as much [s]."""
BATCHES = ((1.0, 1.0), (4.0, 1.2), (16.0, 2.8))
"""Lengths of batches of data [s], and (t/1.96)^2 of Student's t for as many as the longest memory, 30 s, holds."""
PLACE = 0.5
"""Memory of the mean velocities [s]."""


def bank_grid(
    memories: Sequence[float], held: Sequence[float], axes: int = 1, straddle: int = 0
) -> list[tuple[float, float, float, int]]:
    """Return memory [s], prior width, drift and kind of every member: `FREE`, `APART`, or 1 + the axis it is held by.

    Held ones need one prior only, the narrow one (F-16, wide ones: .63 instead of .54 of the better peer), and a
    constant that walks: .1 and 1, and 10 for the shortest memory (without it A is covered in .87 in the second after an
    alarm, with it in .93; with constants that stay Q by the elevator is lost by .08 in a flight test, without by .06).
    """
    free = [(tau, pi, kappa, FREE) for tau in memories for pi in PRIORS for kappa in DRIFTS]
    walks = [(tau, kappa) for tau in held for kappa in (DRIFTS if tau == min(held) else DRIFTS[:-1])]
    kept = [(tau, PRIORS[0], kappa, 1 + axis) for axis in range(axes) for tau, kappa in walks]
    looks = [(one.memory, one.walk) for one in LOSSES if one.memory not in memories]
    if straddle > 0:
        longest = LOSSES[-1].memory, LOSSES[-1].walk
        looks = [longest, *[(one.memory, one.walk) for one in WINDOWED], (NOISE_MEMORY, WALK)]
    return free + kept + [(memory, PRIORS[-1], walk, APART) for memory, walk in looks]


def make_bank_settings(
    scale: Array,
    period: float,
    grid: Grid,
    *,
    axes: Sequence[int] | None = None,
    counts: Sequence[int] | None = None,
    effectors: tuple[int, int] = (0, 0),
    velocities: Sequence[int] = (),
    axial: int = -1,
    exponents: Sequence[int] = (),
    rates: Sequence[int] = (),
    turning: Mapping[tuple[int, int], tuple[int, float]] | None = None,
    surfaces: Sequence[Surface] = (),
    straddle: int = 0,
    servos: bool = False,
    differenced: Sequence[int] = (),
    detect: bool = True,
    threshold: float = THRESHOLD,
) -> BankSettings:
    """Build the settings of a bank.

    Parameters
    ----------
    scale
        (p,) of the regressors, the constant last (its scale is not used).
    period
        Of the samples [s].
    grid
        Members, see `bank_grid`.
    axes
        Of the rows: 0, or 1 for the other one; None: all 0.
    counts
        1 for rows whose output says that the axis is excited; None: all.
    effectors
        First and after the last effector among the regressors.
    straddle
        Samples over which the inputs were smoothed or differentiated.
    servos
        Whether deflections are commands behind servos that were declared.
    differenced
        Rows of angular rates: their outputs are differences of their states then, all others are smoothed; and they
        have a delay of their own (`bank.delay`). None: all rows have one.
    velocities
        Which regressors are velocities: they say where in the envelope a number was known.
    axial
        Row of the axial velocity, of the same index; negative: none.
    exponents
        (p - 1,) with which power of airspeed each effect goes; empty: all stay what they are.
    rates
        Which are the angular rates, all three or none: they couple through the inertia. The rows of the first
        regressors are theirs.
    turning
        Parts of derivatives that are known and not in the outputs: see `kinematics.find_rotation`.
    surfaces
        What can be lost.
    detect
        Whether alarms are raised.
    threshold
        Of the detector.
    """
    return BankSettings(
        period=period,
        straddle=straddle,
        servos=servos,
        effectors_from=effectors[0],
        effectors_to=effectors[1],
        detect=detect,
        threshold=threshold,
        **_members(scale, period, grid, axes, counts),
        **_evidence(period),
        **_detection(len(scale), period, straddle, differenced),
        **_envelope(scale, period, velocities, exponents, axial),
        **_kinematics(len(scale), rates, turning or {}),
        **_noise(period, straddle),
        **_responses(len(scale), period, straddle, differenced),
        **_losses(period, straddle, grid, surfaces, effectors[1] - effectors[0]),
        followed_row=-1,
        followed_column=-1,
    )


def _members(
    scale: Array,
    period: float,
    grid: Grid,
    axes: Sequence[int] | None,
    counts: Sequence[int] | None,
) -> dict[str, Any]:
    """Return what the members are, and in which rows they have a share; as `make_bank_settings`."""
    whole = [*grid, *[grid[-1]] * (-len(grid) % LANES)]
    tau, pi, kappa, kind = (np.array(column, dtype=np.float64) for column in zip(*whole, strict=True))
    sigma = np.concatenate([[0.0], SIGMA * scale[:-1]])
    prior = sigma[:, None] / pi[None, :]
    prior[0] = 1.0 / np.maximum(pi, CONSTANT_PRIOR)
    row_axis = np.zeros(len(scale), np.int64) if axes is None else np.array(axes, np.int64)
    axis = np.maximum(kind - 1, 0).astype(np.int64)
    mixes = (kind == FREE) | ((kind > FREE) & (axis == row_axis[:, None]))
    mixes[:, len(grid) :] = False
    return dict(
        members=len(grid),
        forgetting=np.array([math.exp(-period / t) for t in tau.tolist()]),
        held=(kind > FREE).astype(np.int64),
        axis=axis,
        row_axis=row_axis,
        counts=np.ones(len(scale), np.int64) if counts is None else np.array(counts, np.int64),
        mixes=mixes.astype(np.float64),
        drift=kappa * math.sqrt(period * DRIFT_RATE),
        prior=prior,
        sigma=sigma,
        wind_up=WIND_UP,
        reference=np.array([_widest(grid, 1 + of) for of in (0, 1)], np.int64),
        recent=_nearest(grid, LOSSES[-1].memory, 1.0),
        window=max(1, round(BLOCK / period)),
        batches=np.array([max(1, round(length / period)) for length, _ in BATCHES], np.int64),
        batch_factor=np.array([factor for _, factor in BATCHES]),
    )


def _evidence(period: float) -> dict[str, Any]:
    """Return what the members are judged by."""
    return dict(
        judging=math.exp(-period / JUDGING),
        delay=max(2, round(DELAY / period)),
        power=POWER * min(1.0, period * POWER_RATE),
        quiet=QUIET,
        energy=np.array([min(period / memory, 1.0) for memory in ENERGY]),
        residual_forgetting=math.exp(-period / RESIDUAL_MEMORY),
        colour_forgetting=math.exp(-period / COLOUR_MEMORY),
    )


def _detection(rows: int, period: float, straddle: int, differenced: Sequence[int]) -> dict[str, Any]:
    """Return what abrupt changes are seen by."""
    return dict(
        windows=np.array(WINDOWS, np.int64),
        quantiles=_quantiles(rows, straddle, differenced),
        differenced=np.array([int(row in differenced) for row in range(rows)], np.int64),
        mean_forgetting=max(1.0 - period / MEAN_BASE, 0.0),
        floor=FLOOR,
        base=max(1.0 - period / BASE, 0.0),
        rest=REST,
        learning=round(LEARNING / period) + WINDOWS[-1],
    )


def _envelope(
    scale: Array, period: float, velocities: Sequence[int], exponents: Sequence[int], axial: int
) -> dict[str, Any]:
    """Return what says where in the envelope the aircraft is, and what goes with airspeed."""
    return dict(
        velocities=np.array(velocities, np.int64) + 1,
        speed=np.array([scale[i] for i in velocities], dtype=np.float64),
        scaled=any(exponents),
        exponent=np.array([0, *(exponents or [0] * (len(scale) - 1))], np.int64),
        place=min(period / PLACE, 1.0),
        axial=axial,
    )


def _kinematics(
    regressors: int, rates: Sequence[int], turning: Mapping[tuple[int, int], tuple[int, float]]
) -> dict[str, Any]:
    """Return what is known of the derivatives without learning."""
    sources = {place: source + 1.0 for place, (source, _) in turning.items()}
    factors = {place: factor for place, (_, factor) in turning.items()}
    return dict(
        rates=np.array(rates, np.int64) + 1,
        coupled=_coupled(rates, regressors),
        turning=_by_regressor(sources, regressors).astype(np.int64),
        turned=_by_regressor(factors, regressors),
    )


def _noise(period: float, straddle: int) -> dict[str, Any]:
    """Return by what the noise of sensors is found, and what becomes of it where inputs have passed a window."""
    third, second, white_spread, slope_noise, rest_spread = _window_noise(straddle)
    return dict(
        third=third,
        second=second,
        white_spread=white_spread,
        rest_spread=rest_spread,
        answered=_answered(1 if straddle > 0 else 2 * max(1, round(LATE / period)) + 1),
        entry=min(period / ENTRY, 1.0),
        slope_noise=slope_noise * period * period,
        rest_block=max(round(RESTS / period), FEWEST_RESTING),
    )


def _responses(rows: int, period: float, straddle: int, differenced: Sequence[int]) -> dict[str, Any]:
    """Return how late responses to deflections may be, and by what that is seen."""
    late = max(1, round(LATE / period))
    quick = (QUICK if straddle > 0 else max(QUICK, QUICK_SAMPLES * period)) + straddle * period
    filters = [max(1, round(lag / (late * period))) for lag in LAGS]
    ahead = max(EARLY, *filters)
    responses = (
        [(lag, back) for lag, number in enumerate(BACKS) for back in range(number)]
        + [(0, -back) for back in range(1, 1 + EARLY)]
        + [(lag, -1) for lag in EARLY_LAGS]
        + [(1 + number, -back) for number, back in enumerate(filters)]
    )
    made_of = [((lag, ahead + back), (lag, ahead + back + 1)) for lag, back in responses]
    pairs = sorted({pair for two in made_of for pair in two})
    return dict(
        kind=np.array([int(len(differenced) > 0 and row not in differenced) for row in range(rows)], np.int64),
        quick=min(period / quick, 1.0),
        late=late,
        lags=np.array([(0.0, 0.0, 1.0), *(_lag(lag, period) for lag in LAGS)]),
        responses=np.array(responses, np.int64),
        pairs=np.array(pairs, np.int64),
        paired=np.array([[pairs.index(pair) for pair in two] for two in made_of], np.int64),
        lag_times=np.array([0.0, *LAGS]),
        ahead=ahead,
        block_forgetting=math.exp(-late * period / COLOUR_MEMORY),
        block_quick=min(late * period / quick, 1.0),
        latest=max(1, round(LATEST / period)),
        late_noise=_unlike(straddle, late),
        feedback_lags=np.array([max(1, round(lag / period)) + straddle for lag in LATER], np.int64),
        late_part=DELAY_OF_RECORDS / (late * period),
        late_apart=DELAY_OF_SENSORS / (late * period),
    )


def _losses(period: float, straddle: int, grid: Grid, surfaces: Sequence[Surface], effectors: int) -> dict[str, Any]:
    """Return what losses of surfaces are looked for by."""
    least = min((FEWEST - 0.5) * period, LOSSES[0].memory)
    losses = WINDOWED if straddle > 0 else [one for one in LOSSES if one.memory >= least]
    near = [_nearest(grid, one.memory, one.walk) for one in losses]
    stride = max(1, round(STRIDE / period))
    return dict(
        gains=np.array([one.gains for one in surfaces], dtype=np.float64).reshape(len(surfaces), effectors),
        shares=np.array([one.shares for one in surfaces], dtype=np.float64).reshape(len(surfaces), effectors),
        loss_members=np.array(near, np.int64),
        loss_delays=np.array([max(1, round(one.back / period / stride)) for one in losses], np.int64),
        ramp_lengths=np.array([max(1, round(length / period)) for length in LENGTHS], np.int64),
        loss_tests=np.array([max(3, round(one.stands / (EVERY * period))) for one in losses], np.int64),
        loss_sums=math.floor(math.log2(max(LONGEST / period, 1.0))) + 1,
        noise_member=_nearest(grid, NOISE_MEMORY, WALK),
        loss_limits=np.array([(one.limit, one.sure) for one in losses]),
        stride=stride,
        persistence=max(3, round(LOSSES[0].memory / (EVERY * period))),
    )


def _lag(constant: float, period: float) -> tuple[float, float, float]:
    """Return the weights of last output, last and present input of a lag, for an input that is straight between."""
    pole = math.exp(-period / constant)
    rise = (1.0 - pole) * constant / period
    return pole, rise - pole, 1.0 - rise


def _window(straddle: int) -> tuple[Array, Array]:
    """Return the weights of values and of slopes in a window of `msls_ros.inputs.derivatives` of so many intervals."""
    if straddle == 0:
        return np.ones(1), np.ones(1)
    raw = [0.0, *((i + 1.0) * (straddle - i) for i in range(straddle)), 0.0]
    values = np.array([0.5 * (raw[i] + raw[i + 1]) for i in range(straddle + 1)])
    for i in range(straddle if straddle > 1 else 0):
        for sample in (i, i + 1):
            middle = min(max(sample, 1), straddle - 1)
            values[middle - 1 : middle + 2] -= raw[i + 1] / 24.0 * np.array([1.0, -2.0, 1.0])
    return values, np.diff(raw)


def _window_noise(straddle: int) -> tuple[float, float, float, float, float]:
    """Return what white noise becomes in such a window.

    By what third and second differences of the values are as large as the noise in them; the variance of a sum of
    products of the former and of slopes of other noise, over that of independent ones (Bartlett's formula); the
    variance of the values over the least that the best prediction leaves of the slopes, the square of their first
    weight (Kolmogorov's formula) [sample^2]; and the variance of a sum of products of values, over that of independent
    ones.
    """
    window, slope = _window(straddle)
    thirds, seconds = (np.convolve(window, of) for of in ([1.0, -3.0, 3.0, -1.0], [1.0, -2.0, 1.0]))
    square = float(np.sum(window * window))
    over_slope = square / float(slope[0] * slope[0]) if straddle > 0 else 0.0
    alike, of_slopes = _filtered(thirds), _filtered(slope)
    shared = min(len(alike), len(of_slopes))
    spread = 2.0 * float(np.sum(alike[:shared] * of_slopes[:shared])) - 1.0
    third, second = math.sqrt(square / float(np.sum(thirds**2))), math.sqrt(square / float(np.sum(seconds**2)))
    whole = 2.0 * float(np.sum(_filtered(window) ** 2)) - 1.0
    return third, second, spread, over_slope, whole


def _answered(number: int) -> float:
    """Return the quantile of chi square of so many degrees that is `ANSWERED` of one (Wilson and Hilferty)."""
    if number == 1:
        return ANSWERED
    part = 2.0 / (9.0 * number)
    cube = 1.0 - part + math.sqrt(ANSWERED * part)
    return number * cube * cube * cube


def _unlike(straddle: int, lag: int) -> float:
    """Return 1 - r, r the autocorrelation of white noise that has passed such a window, ``lag`` samples on."""
    r = _filtered(_window(straddle)[0])
    return 1.0 - float(r[lag]) if lag < len(r) else 1.0


def _filtered(weights: Array) -> Array:
    """Return the autocorrelation of white noise that has passed a filter, from lag 0 on: (n,), (n,)."""
    n = len(weights)
    return np.array([np.sum(weights[: n - k] * weights[k:]) for k in range(n)]) / np.sum(weights * weights)


def _quantiles(rows: int, straddle: int, differenced: Sequence[int]) -> Array:
    """Return what means over `WINDOWS` of squared noise reach once in 1e8: (rows, w), see `independent_squares`."""
    values, slopes = _window(straddle)
    found = np.empty((rows, len(WINDOWS)))
    for row in range(rows):
        weights = slopes if row in differenced else values
        for i, length in enumerate(WINDOWS):
            number = math.log(independent_squares(length, weights))
            found[row, i] = math.exp(float(np.interp(number, np.log(WINDOWS), np.log(QUANTILES))))
    return found


def independent_squares(length: int, weights: Array) -> float:
    """Return how many independent squares have a mean that varies as that of white noise through a filter does.

    ``l^2 / sum r_k^2 (l - |k|)`` with the autocorrelation r of the filtered noise: the variance of the mean of l
    squares of Gaussian noise is twice the inverse (Bartlett).

    Parameters
    ----------
    length
        l, samples.
    weights
        (n,) of the filter.
    """
    r = _filtered(weights)
    total = float(length)
    for k in range(1, min(len(r), length)):
        total += 2.0 * float(r[k]) ** 2 * (length - k)
    return length * length / total


def _coupled(rates: Sequence[int], p: int) -> Integers:
    """Return by row's own regressor and column, constant first, which rate the product is with; -1: there is none."""
    found = np.full((p, p), -1, np.int64)
    for own in range(len(rates)):
        for by in range(len(rates)):
            if own != by:
                found[rates[own] + 1, rates[by] + 1] = 3 - own - by
    return found


def _by_regressor(parts: Mapping[tuple[int, int], float], p: int) -> Array:
    """Return (p, p), constant first, of what is given by row's own regressor and column, the constant last."""
    found = np.zeros((p, p))
    for (own, by), part in parts.items():
        found[own + 1, by + 1] = part
    return found


def _exponents(c: Configuration) -> list[int]:
    """Return with which power of airspeed the effect of each regressor goes, the constant's left out; see `bank.speed`.

    All stay what they are where airspeed is not known: without u, or where states may be deviations from a trim.
    """
    if not (c.dynamic_pressure and c.known_gravity and "u" in c.rows):
        return []
    thrust = c.effectors_of_thrust
    return [int(name in MOTION) for name in c.rows] + [0 if name in thrust else 2 for name in c.effectors]


def _nearest(grid: Grid, memory: float, walk: float) -> int:
    """Return the freest member of about that memory [s] and walk, of those that are not held if there are any."""
    far = [(kind > FREE, abs(tau - memory), -pi, abs(kappa - walk)) for tau, pi, kappa, kind in grid]
    return far.index(min(far))


def _widest(grid: Grid, kind: int) -> int:
    """Return the member of the longest memory and the widest prior, of that kind if there is one."""
    width = [(of == kind, tau, -kappa, pi) for tau, pi, kappa, of in grid]
    return width.index(max(width))


def bank_settings(c: Configuration, straddle: int = 0, *, servos: bool = False) -> BankSettings:
    """Translate the parameters, and over how many samples the inputs were smoothed, into what the loop takes."""
    axes = [int(name in LATERAL) for name in c.rows]
    axes = axes if len(set(axes)) > 1 else [0] * len(axes)
    counts = [int(name != SLOW or axes.count(axis) == 1) for name, axis in zip(c.rows, axes, strict=True)]
    scale = np.array([c.reference_speed if s in ("u", "v", "w") else 1.0 for s in c.regressors])
    return make_bank_settings(
        scale,
        1.0 / c.sample_rate,
        bank_grid(c.estimator.memories, c.estimator.held_memories, 1 + max(axes), straddle),
        axes=axes,
        counts=counts,
        effectors=(len(c.rows), len(c.rows) + len(c.effectors)),
        straddle=straddle,
        servos=servos,
        differenced=[i for i, name in enumerate(c.rows) if name in RATES],
        surfaces=read_surfaces(c.isolation.surfaces, c.effectors),
        velocities=[i for i, name in enumerate(c.rows) if name in ("u", "v", "w")],
        axial=c.rows.index("u") if "u" in c.rows else -1,
        exponents=_exponents(c),
        rates=[c.rows.index(name) for name in "PQR"] if set("PQR") <= set(c.rows) else (),
        turning=find_rotation(c.rows) if c.known_rotation else None,
        detect=c.detector.mode != "off",
    )
