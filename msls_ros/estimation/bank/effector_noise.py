"""Noise in the measured deflections: the quick part of them that is white, and that no output answers.

An effector that rests still moves in the records, by the noise of its sensor. Least squares takes that for motion: no
output answers it, so the effect is nothing, and certain. But nothing has been learnt of the effect. What
follows from that stands in `bank.attenuation`; here the variance of the noise is found.

Third differences see hardly anything of motion, so their median square, over what white noise makes of it, is the most
that noise can be::

    d = (u_k - 3 u_(k-1) + 3 u_(k-2) - u_(k-3)) / sqrt 20,      sigma^2 <= median d^2 / .455

It is that while no output answers (`bank.answers`); what an output answers, as dither, is motion. A sensor's noise does
not end when the effector moves: where a loss is looked for, it stays what it was (`resting_noise`). Whether it rests
says `bank.rest`.

Records have a step of their own, too (`observe_quanta`): all differences are multiples of the least one. What is
rounded off is noise, a twelfth of that step squared, whether an output answers or not, however rarely it shows. A
median does not see it: of an effector that rests most differences are none, and a few of a whole step. It is not white
where the effector moves by less than a step, and then up to a quarter of it squared: that counts where a loss is looked
for (`slow_noise`).

White noise that has passed a window has third differences of a known size, `BankSettings.third`. Of states that have
passed one with their derivatives, made of the same signal, nothing else shows the noise (`regressor_noise` compares
both): there it is at most what their third differences hold, and what makes the derivatives' prediction errors.
Elsewhere they say how much of the noise in a rate comes into an output with what is known of it (`entering_part`).

References
----------
Fuller, *Measurement Error Models*, 1987, section 1.1 (reliability ratio). Gasser, Sroka and Jennen-Steinmetz,
"Residual variance and residual pattern in nonlinear regression", Biometrika 73 (1986) (noise by differences).
"""

from __future__ import annotations

import math

from msls_ros.estimation.bank.answers import EDGE, MEDIAN, find_parts, median_of, square_of_answers
from msls_ros.estimation.bank.lags import KEEP
from msls_ros.estimation.bank.loop_settings import BankSettings
from msls_ros.estimation.bank.speed import power_of, ratio_of
from msls_ros.estimation.bank.state import BankState
from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array

SMALLEST = 1e-12
"""Least median over the square of the bank's unit: deflections that are computed have no noise."""
ROUNDING = 1.0 / 12.0
"""Variance of what rounding takes off, over the square of its step [1]."""
SLOW_ROUNDING = 0.25
"""The most that it can be: no value is off by more than half a step [1]."""
OFTEN, SURE = 3.0, 12.0
"""So many times a record must have moved by its least step, to be believed; and no more are counted."""
OTHERWISE = 4.0
"""So many times less it has, where it moves by what is no multiple: a single value that is wrong is two such steps."""
LEVELS = 10.0
"""Over so many steps a record must have moved: doublets are steps of a few levels, too."""
ALIKE_STEP = 1e-3
"""By which share of a step multiples may differ from it: records are in single precision, too [1]."""
RESTING = 1e-9
"""By which share of its range a record may move, and rests: through windows it is a sum [1]."""
QUIET = 1.5
"""For so long no output may answer, for it to be noise from then on [s].

60 made-up linear aircraft (as `benchmark linear`): wrong names 3 -> 0, false and late alarms 19 -> 11.
"""


@compiled
def observe_quanta(s: BankSettings, x: BankState, phi: Array) -> None:
    """Update the least step of recorded deflections, how often it has shown, their range and rest; phi (p,) as it came.

    It shows where a record rests and goes by it to where it rests again, or goes to and back. Through a window it rests
    once it has for longer than that: what goes to and back within one is a part of a step there, for as long.
    """
    k = x.samples[0]
    for j in range(x.quantum.shape[1]):
        now = phi[s.effectors_from + j]
        last, before = x.recorded[(k - 1) % 2, j], x.recorded[k % 2, j]
        x.recorded[k % 2, j] = now
        own = x.quantum[:, j]
        if k < 2:
            own[2] = now if k == 0 else min(own[2], now)
            own[3] = now if k == 0 else max(own[3], now)
            own[4] = now
            continue
        own[2] = min(own[2], now)
        own[3] = max(own[3], now)
        step = abs(last - now) if now == before and s.straddle == 0 else 0.0
        own[5] = own[5] + 1.0 if abs(now - last) <= RESTING * (own[3] - own[2]) else 0.0
        if own[5] > s.straddle:
            step = abs(now - own[4])
            own[4] = now
        moved = abs(now - last) if s.straddle == 0 else step
        times = moved / own[0] if own[0] > 0.0 else 0.0
        whole = math.floor(times + 0.5)
        if moved > RESTING * (own[3] - own[2]) and (whole < 1.0 or abs(times - whole) > ALIKE_STEP * whole):
            own[1] = max(own[1] - OTHERWISE, 0.0)
        if step > RESTING * (own[3] - own[2]):
            if own[1] == 0.0:
                own[0] = step
            if abs(step - own[0]) <= ALIKE_STEP * own[0]:
                own[1] = min(own[1] + 1.0, SURE)


@compiled
def most_noise(s: BankSettings, x: BankState, j: int) -> float:
    """Return the most that the variance of the noise in effector j can be: by third differences, or by its quantum."""
    return float(max(x.third_median[j] / MEDIAN, white_rounding(s, x, j)))


@compiled
def white_rounding(s: BankSettings, x: BankState, j: int) -> float:
    """Return as much of the rounding of effector j as is white: what of it has passed a window, differences show."""
    return rounding_noise(s, x, j) if s.straddle == 0 else 0.0


@compiled
def rounding_noise(s: BankSettings, x: BankState, j: int) -> float:
    """Return the variance of the rounding of effector j in its record."""
    if x.quantum[1, j] < OFTEN or x.quantum[3, j] - x.quantum[2, j] <= LEVELS * x.quantum[0, j]:
        return 0.0
    step = x.quantum[0, j] * power_of(s, s.effectors_from + 1 + j, ratio_of(x))
    return float(ROUNDING * step * step)


@compiled
def observe_deflections(s: BankSettings, x: BankState, phi: Array) -> None:
    """Update the median squares of the effectors' third differences; phi (p,), constant first."""
    begun = x.samples[0] - x.deflections.shape[0] - s.straddle
    for j in range(x.whites.shape[1]):
        i = s.effectors_from + 1 + j
        third = third_difference(s, x, x.deflections[:, j], phi[i])
        x.third_median[j] = median_of(x.third_median[j], third, SMALLEST * s.sigma[i] * s.sigma[i], begun)


@compiled
def observe_whites(s: BankSettings, x: BankState, phi: Array) -> None:
    """Find what may be noise of the effectors in phi (p,), constant first, deflections taken back; 0: edges."""
    begun = x.samples[0] - x.white_past.shape[0] - s.straddle
    for j in range(x.whites.shape[1]):
        i = s.effectors_from + 1 + j
        k = x.samples[0]
        second = (phi[i] - 2.0 * x.white_past[(k - 1) % 3, j] + x.white_past[(k - 2) % 3, j]) * s.second
        third = third_difference(s, x, x.white_past[:, j], phi[i])
        white = third if s.straddle > 0 else second
        x.white_median[j] = median_of(x.white_median[j], white, SMALLEST * s.sigma[i] * s.sigma[i], begun)
        x.rest_energy[j] += x.quick[i] * x.quick[i]
        inside = begun >= 0 and white * white < EDGE * max(x.white_median[j] / MEDIAN, white_rounding(s, x, j))
        x.whites[k % x.whites.shape[0], j] = white if inside else 0.0


@compiled
def third_difference(s: BankSettings, x: BankState, past: Array, value: float) -> float:
    """Return the third difference of a value and the three before it, a ring; of the size of white noise in them."""
    k = x.samples[0]
    last = past[k % 3]
    past[k % 3] = value
    return float((value - last + 3.0 * (past[(k - 2) % 3] - past[(k - 1) % 3])) * s.third)


@compiled
def observe_states(s: BankSettings, x: BankState, phi: Array) -> None:
    """Update the third differences of the states and their median squares; phi (p,), constant first."""
    begun = x.samples[0] - x.states.shape[0] - s.straddle
    for j in range(x.state_median.shape[0]):
        third = third_difference(s, x, x.states[:, j], phi[j + 1])
        x.state_third[j] = third if begun >= 0 else 0.0
        least = SMALLEST * s.sigma[j + 1] * s.sigma[j + 1]
        x.state_median[j] = median_of(x.state_median[j], third, least, begun)


@compiled
def state_noise(s: BankSettings, x: BankState, j: int, found: float) -> float:
    """Variance of the noise in state j, of which ``found`` shows between states and derivatives.

    Where the window has made both of the same signal nothing shows. Then the noise is at most what third differences
    hold, and what would make the prediction errors of the derivative.
    """
    if s.straddle == 0 or x.residual[j, 1] <= 0.0:
        return found
    most = min(x.state_median[j] / MEDIAN, s.slope_noise * x.residual[j, 0] / x.residual[j, 1])
    return float(max(found, most))


@compiled
def measured_noise(s: BankSettings, x: BankState, j: int, found: float) -> float:
    """Variance of the noise in state j as it was measured, with what `state_filter` has taken off."""
    share = x.measured[j]
    off = x.white_states[j] * (2.0 - share) * (1.0 - share) / share if share > 0.0 else 0.0
    return float(state_noise(s, x, j, found) + off)


@compiled
def observe_entry(s: BankSettings, x: BankState, q: int, error: float) -> None:
    """Update how row q's prediction error goes with the noise in the states, where `entering_part` asks for it."""
    x.entry_samples[q] += 1.0 - s.entry * x.entry_samples[q]
    for j in range(x.state_third.shape[0]):
        if s.turning[q + 1, j + 1] > 0:
            x.entry[q, j] += error * x.state_third[j] - s.entry * x.entry[q, j]


@compiled
def entering_part(s: BankSettings, x: BankState, q: int, i: int, turned: float) -> float:
    """Return as much of ``turned``, what is known of row q's derivative by regressor i, as its noise is in the output.

    What `kinematics` takes off an output holds the measured state, and so does what an accelerometer and the measured
    rates make of a derivative: then nothing of the noise is left in the output. A derivative that was measured for
    itself leaves all of it: ``error = -(theta + share turned) n + ...``. The third difference d of white noise n holds
    ``n / sqrt 20``, so ``sqrt 20 mean(error d) / mean(d^2)`` says ``-(theta + share turned)``. Two standard errors are
    added to the share. Through windows, where n is not white, it is one.
    """
    square = x.state_median[i - 1] / MEDIAN
    count = x.entry_samples[q]
    if s.straddle > 0 or square <= 0.0 or count <= 0.0 or turned == 0.0:
        return turned
    found = -x.entry[q, i - 1] / (s.third * count * square)
    chance = math.sqrt(x.residual[q, 0] / x.residual[q, 1] / (count * square)) / s.third
    share = (found - x.mixed[q, i]) / turned + 2.0 * chance / abs(turned)
    return float(turned * min(max(share, 0.0), 1.0))


@compiled
def find_noise(s: BankSettings, x: BankState) -> None:
    """Find the variance of the noise in the deflections, ``x.third_noise``: nothing where an output answers it."""
    if s.straddle == 0:
        find_parts(s, x)
    for j in range(x.whites.shape[1]):
        most = 0.0
        for q in range(x.white_cross.shape[0]):
            if s.straddle > 0 and s.differenced[q] == 0:
                continue
            if x.residual[q, 0] > 0.0 and x.white_power[q, j] > 0.0:
                variance = s.white_spread * x.residual[q, 0] / x.residual[q, 1] * x.white_power[q, j]
                most = max(most, square_of_answers(s, x, q, j) / variance)
        found = most_noise(s, x, j)
        noise = min(max(2.0 - most, 0.0), 1.0)
        x.third_noise[j] = max(noise * found, white_rounding(s, x, j))
        x.unanswered[j] = x.unanswered[j] + KEEP * s.period if most < 1.0 and s.straddle == 0 else 0.0
        if x.unanswered[j] > QUIET:
            x.third_floor[j] = found


@compiled
def resting_noise(s: BankSettings, x: BankState, j: int) -> float:
    """Variance of the noise in effector j, no less than it had when no output answered, nor more than there can be."""
    return float(max(x.third_noise[j], min(x.third_floor[j], most_noise(s, x, j))))


@compiled
def slow_noise(s: BankSettings, x: BankState, j: int) -> float:
    """Variance of it that cannot be excluded, of an effector that moves by less than a step of its record."""
    return float(max(resting_noise(s, x, j), SLOW_ROUNDING / ROUNDING * rounding_noise(s, x, j)))
