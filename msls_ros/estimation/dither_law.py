"""The dither law, compiled: one sample after the other, from what is known of B to commands (see `dither`)."""

from __future__ import annotations

import math

from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.dither_allocation import worst_case
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
from msls_ros.estimation.dither_rms import all_known, choose, relieve, set_caps, weigh_entries
from msls_ros.estimation.dither_window import enter_window, hold_back, rest
from msls_ros.estimation.elementary import exponential, logarithm
from msls_ros.estimation.kernel import Array
from msls_ros.estimation.kinematics import GRAVITY
from msls_ros.estimation.sequences import CREST, multisine


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
