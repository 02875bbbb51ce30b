"""The dither law, compiled: one sample after the other, from what is known of B to commands (see `dither`)."""

from __future__ import annotations

import math

from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.dither_allocation import allocate, felt_square, uncertain_square, worst_case
from msls_ros.estimation.dither_answer import (
    ACCELERATION,
    CAPPED,
    DISABLED,
    EQUATION_23,
    GAP,
    KNOWN,
    NOT_EXCITED,
    NOT_FINITE,
    DitherBlock,
)
from msls_ros.estimation.dither_inputs import Comb, Knowledge, Law
from msls_ros.estimation.dither_limits import (
    ACHIEVED,
    CAP,
    CORNER,
    LONGEST,
    SEQUENCE,
    WEIGHT,
    Effectors,
    boost,
    boost_left,
    command_gain,
    elapse,
    fill,
    move,
    note_reached,
    settle,
)
from msls_ros.estimation.dither_onset import begin
from msls_ros.estimation.dither_window import enter_window, hold_back, rest
from msls_ros.estimation.elementary import exponential, logarithm
from msls_ros.estimation.kernel import Array, Integers
from msls_ros.estimation.kinematics import GRAVITY
from msls_ros.estimation.sequences import CREST, multisine

SLOWEST = 0.1
"""An effector that is known to `dither.target_error` keeps at least this part of its share."""
RELIEF = 1.0
"""Time constant with which the share of a known effector goes down [s]."""
LARGEST_EFFECT = 1e12
"""A B-hat that holds more than this is not used: no sample has numbers of that size."""
LARGE = 1e200
"""More than any effect squared; keeps what is unknown and gets nothing finite."""
ERRORS = 2.0
"""Standard errors of B-hat that the window of a second allows for.

Largest rms of 1 s over its limit, 20 flights at medium noise, none and 2: tail 1.11, 1.03, cruise 1.24, 1.10, J-3
1.16, 1.06, A-4 1.32, 1.22; errors before the loss 6.9, 6.9, 5.2, 5.7, 4.6, 4.9, 2.3, 2.6 %. If it counted in full of
what is not known, that would get little and not be learnt: at a third of the limit the error before the loss is 41 %
then, not 23.
"""
START = 0.7
"""An effector of which nothing is known gets at least this part of `dither.cap_unreliable` (docs/choosing.md)."""


@compiled
def relative_error(b: Array, variance: Array, rows: Integers, j: int) -> float:
    """Standard error of effector j's largest entry over the entry: of rows P, Q, R; of all where those are absent."""
    angular = rows[3] >= 0 or rows[4] >= 0 or rows[5] >= 0
    largest, error = 0.0, math.inf
    for q in range(b.shape[0]):
        if angular and q != rows[3] and q != rows[4] and q != rows[5]:
            continue
        if abs(b[q, j]) > largest:
            largest = abs(b[q, j])
            error = math.sqrt(variance[q, j]) / largest
    return error


@compiled
def all_known(law: Law, b: Array, variance: Array) -> bool:
    """Whether every effector is known to `Law.known_error`."""
    known = True
    for j in range(b.shape[1]):
        known = known and relative_error(b, variance, law.rows, j) < law.known_error
    return known


@compiled
def relieve(law: Law, x: Effectors, b: Array, variance: Array, alarmed: bool, dt: float) -> bool:
    """Lower the shares of effectors that are known well enough, raise the others; whether all are lowered.

    An effector whose relative error is e gets closer to ``target_error`` with the power ``dt/RELIEF`` of their ratio;
    an alarm restores all shares at once.
    """
    lowered = law.target_error > 0.0
    for j in range(x.relief.shape[0]):
        if law.target_error <= 0.0 or alarmed:
            x.relief[j] = 1.0
            lowered = False
            continue
        ratio = relative_error(b, variance, law.rows, j) / law.target_error
        step = min(max(ratio - 1.0, -1.0), 1.0) * min(dt / RELIEF, 1.0)
        x.relief[j] = min(max(x.relief[j] * (1.0 + step), SLOWEST), 1.0)
        if x.relief[j] >= 1.0:
            lowered = False
    return lowered


@compiled
def set_caps(
    law: Law, x: Effectors, b: Array, variance: Array, excitation: Array, boosted: bool, period: float, caps: Array
) -> bool:
    """Fill in the largest rms of each surface (m,) [rad]; return whether one is lower for want of excitation.

    An effector gets the lower cap while it is neither excited now nor known: its largest entry to ``known_error``.
    """
    unexcited = False
    raised = law.limit_boosted / law.limit_nominal if boosted and law.limit_nominal > 0.0 else 1.0
    activity = law.activity_boosted if boosted else law.activity_nominal
    for j in range(caps.shape[0]):
        caps[j] = x.limits[j, CAP]
        lower = law.cap_unreliable * raised * x.limits[j, WEIGHT]
        unknown = law.worst_case or not relative_error(b, variance, law.rows, j) < law.known_error
        if excitation[j] < law.excitation and lower < caps[j] and unknown:
            caps[j] = lower
            unexcited = True
        if activity > 0.0:
            caps[j] = min(caps[j], activity / rate_per_rms(x, j, period))
    return unexcited


@compiled
def rate_per_rms(x: Effectors, j: int, period: float) -> float:
    """Rms rate of a surface over its rms [1/s]: of a first-order lag, or of its steps where there is no actuator."""
    corner = x.limits[j, CORNER]
    if corner <= 0.0:
        return math.sqrt(2.0) / period
    gain = command_gain(x, j, period)
    pole = x.pole[j, 1]
    colour = exponential(-x.limits[j, SEQUENCE] * period) if x.limits[j, SEQUENCE] > 0.0 else 0.0
    together = gain * gain * (1.0 - pole) * colour / (1.0 - pole * colour)
    return float(corner * math.sqrt(max(gain * gain + 1.0 - 2.0 * together, 0.0)))


@compiled
def choose(law: Law, x: Effectors, b: Array, limit: float, square: Array, caps: Array) -> tuple[float, bool]:
    """Fill in ``x.wanted``, the rms of each surface (m,) [rad] within limit and caps.

    Parameters
    ----------
    law, x
        The law and its effectors.
    b
        (r, m) B-hat.
    limit
        Acceleration [m/s^2 rms].
    square, caps
        (m,) ``E[g_j^2]`` and the largest rms of each surface.

    Returns
    -------
    tuple
        The common rms before weights, or the rms over the effectors [rad], and whether the limit binds.
    """
    m = caps.shape[0]
    weights = x.limits[:, WEIGHT]
    if not law.worst_case:
        binds = allocate(square, weights, caps, limit, law.information, x.wanted)
        total = 0.0
        for j in range(m):
            total += x.wanted[j] * x.wanted[j]
        return math.sqrt(total / m) if m > 0 else 0.0, binds
    # one common rms for all: the smallest that a cap or eq 23 allows
    common = math.inf
    for j in range(m):
        if weights[j] > 0.0:
            common = min(common, caps[j] / weights[j])
    unit = worst_case(b, weights, law.rows, law.station)
    binds = unit * common > limit
    if binds:
        common = limit / unit
    for j in range(m):
        x.wanted[j] = weights[j] * common if weights[j] > 0.0 else 0.0
    return common if math.isfinite(common) else 0.0, binds


@compiled
def weigh_entries(
    law: Law, x: Effectors, b: Array, variance: Array, square: Array, unsure: Array, scratch: Array
) -> bool:
    """Fill in ``E[g_j^2]``, see `dither_allocation`, and ``unsure`` (m,); return whether all of B is finite.

    ``unsure`` is the square that B-hat's errors may add to what is felt, for the window: of `ERRORS` standard errors,
    less the more of the estimate they are. What is not known is too large already, by its variance on average.

    Where the variance is so large that an effector would get next to nothing it counts less, so that there is always
    something to learn from: ``START`` of the cap of an effector that is not excited, unless the square at the estimate
    less its variance, which is unbiased, forbids it.
    """
    m = square.shape[0]
    limit = law.limit_nominal * GRAVITY / math.sqrt(m)
    finite = True
    for j in range(m):
        for q in range(b.shape[0]):
            if not abs(b[q, j]) < LARGEST_EFFECT:
                finite = False
        known = felt_square(b, law.rows, law.station, j, scratch)
        spread = uncertain_square(variance, law.rows, law.station, j)
        square[j] = max(known, spread)
        unsure[j] = ERRORS * ERRORS * spread * (1.0 - spread / known) if 0.0 < spread < known else 0.0
        least = START * law.cap_unreliable * x.limits[j, WEIGHT]
        if least > 0.0 and not square[j] * least * least < limit * limit:
            square[j] = max(limit * limit / (least * least), known - spread)
        square[j] = max(square[j], x.seen[j])
        if not square[j] < LARGE:
            square[j] = LARGE
    return finite


@compiled
def inject(
    law: Law,
    x: Effectors,
    time: Array,
    known: Knowledge,
    delta: Array,
    noise: Array,
    comb: Comb,
    scratch: Array,
    out: DitherBlock,
) -> None:
    """Fill ``out`` with the dithers that answer n samples.

    Parameters
    ----------
    law, x
        The law and its effectors.
    time
        (n,) [s].
    known
        What is known of B at each sample.
    delta
        (n, m) measured deflections [rad].
    noise
        (n, m) independent, zero mean, unit rms; not read where there are multisines.
    comb
        Of the multisines.
    scratch
        (5, m + 3).
    out
        Per sample.
    """
    m = delta.shape[1]
    for k in range(time.shape[0]):
        alarmed = False
        for q in range(known.alarm.shape[1]):
            if known.alarm[k, q] != 0:
                alarmed = True
        dt = elapse(x, time[k], law.period, law.stale_after)
        boosted = boost(x, dt, alarmed, law.boost_duration, law.boost_budget)
        limit = law.limit_boosted if boosted else law.limit_nominal
        raised = boosted and not boost_ends(law, x)
        aim = law.limit_boosted if raised else law.limit_nominal
        square, caps, wave, unsure, three = (
            scratch[0, :m],
            scratch[1, :m],
            scratch[2, :m],
            scratch[3, :m],
            scratch[4, :3],
        )
        held = min(dt, law.stale_after)
        gain = 1.0
        if law.enabled and not law.worst_case:
            sure = all_known(law, known.b[k], known.variance[k])
            gain = begin(law, x, sure, known.output[k], delta[k], held, three)
        finite = weigh_entries(law, x, known.b[k], known.variance[k], square, unsure, three)
        unit = 1.0 / (limit * limit * GRAVITY * GRAVITY) if finite and limit > 0.0 and not law.worst_case else 0.0
        factor = together = 1.0
        if unit > 0.0:
            together = enter_window(
                law, x, known.b[k], known.variance[k], unsure, unit, time[k] - (dt - held), held, three
            )
        if dt > law.stale_after or not law.enabled:
            rest(law, x, time[k] - (dt - held), dt - held)
            out.level[k] = 3 if law.enabled else 0
            out.reason[k] = GAP if law.enabled else DISABLED
            continue
        out.acceleration_limit[k] = limit
        out.level[k] = 2 if boosted else 1
        if not finite:
            settle(x, 0.0)
            out.reason[k] = NOT_FINITE
            continue
        unexcited = set_caps(law, x, known.b[k], known.variance[k], known.excitation[k], raised, held, caps)
        out.rms[k], binds = choose(law, x, known.b[k], aim * GRAVITY, square, caps)
        out.rms[k] *= gain
        for j in range(m):
            x.wanted[j] *= gain
        lowered = relieve(law, x, known.b[k], known.variance[k], alarmed, dt)
        if unit > 0.0:
            factor = fill(x, unit * wanted_square(x, square))
        waves = comb_value(comb, time[k], x.limits[:, CORNER], wave)
        predicted = send(x, delta[k], noise[k], wave, waves, factor, dt, square, caps, out.delta[k])
        predicted *= math.sqrt(together)
        if unit > 0.0:
            least = unit * (limit * limit) / (aim * aim) if aim > 0.0 else unit
            hold_back(law, x, known.b[k], unsure, least, delta[k], dt, three, out.delta[k])
        if law.worst_case:
            predicted = worst_case(known.b[k], x.wanted, law.rows, law.station)
        out.predicted_acceleration[k] = min(predicted / GRAVITY, limit)
        out.reason[k] = reason(law, binds, unexcited, lowered)


@compiled
def wanted_square(x: Effectors, square: Array) -> float:
    """Mean square of the acceleration that is wanted of independent surfaces, by ``E[g_j^2]`` (m,) [m^2/s^4]."""
    total = 0.0
    for j in range(square.shape[0]):
        wanted = x.relief[j] * x.wanted[j]
        total += square[j] * (wanted * wanted)
    return total


@compiled
def boost_ends(law: Law, x: Effectors) -> bool:
    """Whether what a boost commands now would be felt beyond its end as more than the nominal limit allows.

    The slowest actuator sheds it in ``ln(boosted/nominal)`` time constants, after the interval of the command. Eq 23,
    which is for the paper, does not ask.
    """
    if law.worst_case or not law.limit_boosted > law.limit_nominal > 0.0:
        return False
    constant = 2.0 * law.rest
    return bool(boost_left(x) < x.clock[LONGEST] + constant * logarithm(law.limit_boosted / law.limit_nominal))


@compiled
def reason(law: Law, binds: bool, unexcited: bool, lowered: bool) -> int:
    """Return the index into `REASONS` of what decides the rms."""
    if lowered:
        return KNOWN
    if unexcited and not binds:
        return NOT_EXCITED
    if not binds:
        return CAPPED
    return EQUATION_23 if law.worst_case else ACCELERATION


@compiled
def comb_value(comb: Comb, time: float, corners: Array, out: Array) -> bool:
    """Fill in the multisines now (m,); return whether there are any."""
    if comb.period <= 0.0:
        return False
    if not math.isfinite(comb.origin[0]):
        comb.origin[0] = time
    multisine(time - comb.origin[0], comb.frequencies, comb.phases, corners, out)
    return True


@compiled
def send(
    x: Effectors,
    delta: Array,
    noise: Array,
    wave: Array,
    waves: bool,
    factor: float,
    dt: float,
    square: Array,
    caps: Array,
    out: Array,
) -> float:
    """Fill in the commands (m,) [rad]; return the rms acceleration that they are predicted to make [m/s^2]."""
    decay = exponential(-dt / ACHIEVED)
    predicted = 0.0
    for j in range(out.shape[0]):
        x.wanted[j] *= x.relief[j]
        reached = note_reached(x, j, decay)
        predicted += square[j] * x.wanted[j] * x.wanted[j] * reached
        corner = x.limits[j, SEQUENCE]
        colour = exponential(-corner * dt) if corner > 0.0 else 0.0
        x.sequence[j] = colour * x.sequence[j] + math.sqrt(1.0 - colour * colour) * noise[j]
        unit = wave[j] if waves else command_gain(x, j, dt) * x.sequence[j]
        most = CREST * x.limits[j, CAP] * (command_gain(x, j, dt) if not waves else 2.0)
        size = min(factor * x.wanted[j], max(x.wanted[j], caps[j])) if factor > 1.0 else factor * x.wanted[j]
        wanted = min(max(size * unit, -most), most)
        out[j] = move(x, j, wanted, delta[j], dt)
    return math.sqrt(predicted)
