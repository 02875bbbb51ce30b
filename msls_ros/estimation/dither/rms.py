"""The rms that the dither of each effector has at its surface: by what is known of B, within caps and the limit.

`weigh_entries` says how large effects may be, `set_caps` how far each effector may go, `choose` shares the limit out
among them (eq 23, or `dither.allocation`), and `relieve` lowers the share of an effector that is known well.
"""

from __future__ import annotations

import math

from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.dither.allocation import allocate, felt_square, uncertain_square, worst_case
from msls_ros.estimation.dither.inputs import Law
from msls_ros.estimation.dither.limits import CAP, CORNER, SEQUENCE, WEIGHT, Effectors, command_gain
from msls_ros.estimation.elementary import exponential
from msls_ros.estimation.kernel import Array, Integers
from msls_ros.estimation.kinematics import GRAVITY

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
    """Fill in ``E[g_j^2]``, see `dither.allocation`, and ``unsure`` (m,); return whether all of B is finite.

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
