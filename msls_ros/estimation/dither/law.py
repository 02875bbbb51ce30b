"""The dither law, compiled: one sample after the other, from what is known of B to commands (see `dither`)."""

from __future__ import annotations

import math

from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.dither.allocation import worst_case
from msls_ros.estimation.dither.answer import (
    ACCELERATION,
    CAPPED,
    DISABLED,
    EQUATION_23,
    GAP,
    HELD_AT_ZERO,
    KNOWN,
    NOT_EXCITED,
    NOT_FINITE,
    DitherBlock,
)
from msls_ros.estimation.dither.inputs import Budget, Comb, DitherWork, Instant, Knowledge, Law
from msls_ros.estimation.dither.limits import (
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
from msls_ros.estimation.dither.onset import begin
from msls_ros.estimation.dither.rms import all_known, choose, relieve, set_caps, weigh_entries
from msls_ros.estimation.dither.sequences import CREST, multisine
from msls_ros.estimation.dither.window import enter_window, hold_back, rest
from msls_ros.estimation.elementary import exponential, logarithm
from msls_ros.estimation.kernel import Array, Integers
from msls_ros.estimation.kinematics import GRAVITY


@compiled
def inject(
    law: Law,
    x: Effectors,
    time: Array,
    known: Knowledge,
    delta: Array,
    noise: Array,
    comb: Comb,
    work: DitherWork,
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
    work
        Scratch.
    out
        Per sample.
    """
    for k in range(time.shape[0]):
        dt = elapse(x, time[k], law.period, law.stale_after)
        b, variance, excitation, output = known.b[k], known.variance[k], known.excitation[k], known.output[k]
        alarmed, held = has_alarm(known.alarm[k]), min(dt, law.stale_after)
        at = Instant(time[k], dt, held, b, variance, excitation, output, alarmed, delta[k], noise[k])
        answer(law, x, k, at, comb, work, out)


@compiled
def answer(law: Law, x: Effectors, k: int, at: Instant, comb: Comb, work: DitherWork, out: DitherBlock) -> None:
    """Answer a sample, the k-th of ``out``; as `inject`."""
    boosted = boost(x, at.dt, at.alarmed, law.boost_duration, law.boost_budget)
    limit = limit_of(law, boosted)
    raised = boosted and not boost_ends(law, x)
    aim = limit_of(law, raised)
    gain = onset_gain(law, x, at, work)
    until = at.time - (at.dt - at.held)
    finite, budget = account(law, x, at, limit, aim, until, work)
    if at.dt > law.stale_after or not law.enabled:
        rest(law, x, until, at.dt - at.held)
        out.level[k] = 3 if law.enabled else 0
        out.reason[k] = GAP if law.enabled else DISABLED
        return
    out.acceleration_limit[k] = limit
    out.level[k] = 2 if boosted else 1
    if not finite:
        settle(x, 0.0)
        out.reason[k] = NOT_FINITE
        return
    out.rms[k], out.reason[k] = find_rms(law, x, at, aim, raised, gain, work)
    predicted = command(law, x, at, comb, budget, work, out.delta[k])
    out.predicted_acceleration[k] = min(predicted / GRAVITY, limit)
    if budget.unit > 0.0 and out.rms[k] > 0.0 and is_zero(out.delta[k]):
        out.reason[k] = HELD_AT_ZERO


@compiled
def is_zero(values: Array) -> bool:
    """Whether all values, (m,), are zero: of commands that are wanted, only where the window leaves nothing."""
    found = True
    for j in range(values.shape[0]):
        if values[j] != 0.0:
            found = False
    return found


@compiled
def has_alarm(alarm: Integers) -> bool:
    """Whether any row, (r,), has an alarm."""
    found = False
    for q in range(alarm.shape[0]):
        if alarm[q] != 0:
            found = True
    return found


@compiled
def limit_of(law: Law, boosted: bool) -> float:
    """Return the limit of the acceleration [g rms]."""
    return law.limit_boosted if boosted else law.limit_nominal


@compiled
def onset_gain(law: Law, x: Effectors, at: Instant, work: DitherWork) -> float:
    """Return the part of what is wanted that is sent now, see `dither.onset`; 1 by eq 23, or if nothing is."""
    if not law.enabled or law.worst_case:
        return 1.0
    sure = all_known(law, at.b, at.variance)
    return begin(law, x, sure, at.output, at.delta, at.held, work.axes)


@compiled
def account(
    law: Law, x: Effectors, at: Instant, limit: float, aim: float, until: float, work: DitherWork
) -> tuple[bool, Budget]:
    """Fill in what effects may be, and enter into the window what was felt while the last commands were held.

    Parameters
    ----------
    law, x, at
        As in `answer`.
    limit, aim
        Acceleration that is allowed and that is aimed at [g rms].
    until
        When the last commands ended [s].
    work
        Scratch; what effects may be is filled in.

    Returns
    -------
    tuple
        Whether all of B is finite; what the window allows.
    """
    finite = weigh_entries(law, x, at.b, at.variance, work.square, work.unsure, work.axes)
    unit = 1.0 / (limit * limit * GRAVITY * GRAVITY) if finite and limit > 0.0 and not law.worst_case else 0.0
    together = 1.0
    if unit > 0.0:
        together = enter_window(law, x, at.b, at.variance, work.unsure, unit, until, at.held, work.axes)
    least = unit * (limit * limit) / (aim * aim) if unit > 0.0 and aim > 0.0 else unit
    return finite, Budget(unit, least, together)


@compiled
def find_rms(
    law: Law, x: Effectors, at: Instant, aim: float, raised: bool, gain: float, work: DitherWork
) -> tuple[float, int]:
    """Fill in ``x.wanted`` and ``x.relief``; return the rms of `choose` and what decides it.

    Parameters
    ----------
    law, x, at
        As in `answer`.
    aim, raised
        Acceleration that is aimed at [g rms], and whether it is the boosted one.
    gain
        Part that is sent, see `onset_gain`.
    work
        Scratch, with what effects may be; caps are filled in.
    """
    unexcited = set_caps(law, x, at.b, at.variance, at.excitation, raised, at.held, work.caps)
    rms, binds = choose(law, x, at.b, aim * GRAVITY, work.square, work.caps)
    for j in range(x.wanted.shape[0]):
        x.wanted[j] *= gain
    lowered = relieve(law, x, at.b, at.variance, at.alarmed, at.dt)
    return rms * gain, reason(law, binds, unexcited, lowered)


@compiled
def command(law: Law, x: Effectors, at: Instant, comb: Comb, budget: Budget, work: DitherWork, out: Array) -> float:
    """Fill in the commands (m,) [rad]; return the acceleration that is predicted of them [m/s^2 rms].

    Parameters
    ----------
    law, x, at, comb
        As in `answer`.
    budget
        What the window allows.
    work
        Scratch, with what effects may be and caps.
    out
        The commands.
    """
    factor = fill(x, budget.unit * wanted_square(x, work.square)) if budget.unit > 0.0 else 1.0
    waves = comb_value(comb, at.time, x.limits[:, CORNER], work.wave)
    predicted = send(x, at, waves, factor, work, out)
    if budget.unit > 0.0:
        hold_back(law, x, at.b, work.unsure, budget.least, at.delta, at.dt, work.axes, out)
    if law.worst_case:
        return worst_case(at.b, x.wanted, law.rows, law.station)
    return predicted * math.sqrt(budget.together)


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
def send(x: Effectors, at: Instant, waves: bool, factor: float, work: DitherWork, out: Array) -> float:
    """Fill in the commands (m,) [rad]; return the rms acceleration that they are predicted to make [m/s^2].

    Parameters
    ----------
    x, at
        As in `answer`.
    waves
        Whether there are multisines.
    factor
        By which what is wanted is sent [1].
    work
        What effects may be, caps, and multisines.
    out
        The commands.
    """
    decay = exponential(-at.dt / ACHIEVED)
    predicted = 0.0
    for j in range(out.shape[0]):
        x.wanted[j] *= x.relief[j]
        reached = note_reached(x, j, decay)
        predicted += work.square[j] * x.wanted[j] * x.wanted[j] * reached
        corner = x.limits[j, SEQUENCE]
        colour = exponential(-corner * at.dt) if corner > 0.0 else 0.0
        x.sequence[j] = colour * x.sequence[j] + math.sqrt(1.0 - colour * colour) * at.noise[j]
        unit = work.wave[j] if waves else command_gain(x, j, at.dt) * x.sequence[j]
        most = CREST * x.limits[j, CAP] * (command_gain(x, j, at.dt) if not waves else 2.0)
        size = min(factor * x.wanted[j], max(x.wanted[j], work.caps[j])) if factor > 1.0 else factor * x.wanted[j]
        wanted = min(max(size * unit, -most), most)
        out[j] = move(x, j, wanted, at.delta[j], at.dt)
    return math.sqrt(predicted)
