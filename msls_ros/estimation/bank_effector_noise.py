"""Noise in the measured deflections: the quick part of them that is white, and that no output answers.

An effector that rests still moves in the records, by the noise of its sensor. Least squares takes that for motion: no
output answers it, so the effect is nothing, and certain. But nothing has been learnt of the effect. What
follows from that stands in `bank_attenuation`; here the variance of the noise is found.

Third differences see hardly anything of motion, so their median square, over what white noise makes of it, is the most
that noise can be::

    d = (u_k - 3 u_(k-1) + 3 u_(k-2) - u_(k-3)) / sqrt 20,      sigma^2 <= median d^2 / .455

It is that while no output answers d: the sum over seconds of d times what a row's output does by the effector and
beyond the model is within `ANSWERED`; nothing from twice that on. What an output answers, as dither, is motion.

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

from msls_ros.estimation.bank_state import BankSettings, BankState
from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array

MEDIAN = 0.4549
"""Median of the square of a standard normal variable."""
PACE = 0.005
"""By which share the median moves with a sample; faster in the first ones."""
SMALLEST = 1e-12
"""Least median over the square of the bank's unit: deflections that are computed have no noise."""
ANSWERED = 9.0
"""Squared standard errors by which an output may go with the noise by chance, of several rows and seconds."""


@compiled
def observe_deflections(s: BankSettings, x: BankState, phi: Array) -> None:
    """Update the third differences of the effectors and their median squares; phi (p,), constant first."""
    size = x.deflections.shape[0]
    k = x.samples[0]
    begun = k >= size + s.straddle
    pace = 1.0 + max(PACE, 1.0 / (k - size - s.straddle + 1.0)) if begun else 1.0
    for j in range(x.third.shape[0]):
        i = s.effectors_from + 1 + j
        last = x.deflections[k % size, j]
        x.deflections[k % size, j] = phi[i]
        if not begun:
            continue
        inner = x.deflections[(k - 2) % size, j] - x.deflections[(k - 1) % size, j]
        x.third[j] = (phi[i] - last + 3.0 * inner) * s.third
        square = x.third[j] * x.third[j]
        median = x.third_median[j] * pace if square > x.third_median[j] else x.third_median[j] / pace
        x.third_median[j] = square if k == size + s.straddle else max(median, SMALLEST * s.sigma[i] * s.sigma[i])
        x.third_power[j] = s.colour_forgetting * x.third_power[j] + square


@compiled
def observe_states(s: BankSettings, x: BankState, phi: Array) -> None:
    """Update the third differences of the states and their median squares; phi (p,), constant first."""
    size = x.states.shape[0]
    k = x.samples[0]
    begun = k - size - s.straddle
    pace = 1.0 + max(PACE, 1.0 / (begun + 1.0)) if begun >= 0 else 1.0
    for j in range(x.state_median.shape[0]):
        last = x.states[k % size, j]
        x.states[k % size, j] = phi[j + 1]
        if begun < 0:
            continue
        inner = x.states[(k - 2) % size, j] - x.states[(k - 1) % size, j]
        third = (phi[j + 1] - last + 3.0 * inner) * s.third
        square = third * third
        x.state_third[j] = third
        x.state_median[j] *= pace if square > x.state_median[j] else 1.0 / pace
        x.state_median[j] = square if begun == 0 else max(x.state_median[j], SMALLEST * s.sigma[j + 1] * s.sigma[j + 1])


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
def observe_answer(s: BankSettings, x: BankState, q: int, phi: Array, error: float, expected: float) -> None:
    """Update how row q's output goes with the third differences.

    ``error`` is what the output does beyond the estimates by the regressor phi (p,), constant first: what these make of
    the noise in an effector is in both, and is none of what the output does. ``expected`` is by what the square of the
    error is larger than that of the residual, for the estimates are not known yet.
    """
    first = s.effectors_from + 1
    for j in range(x.third.shape[0]):
        answer = error + x.mixed[q, first + j] * (phi[first + j] - x.quick_mean[first + j])
        x.third_cross[q, j] = s.colour_forgetting * x.third_cross[q, j] + answer * x.third[j] / math.sqrt(expected)


@compiled
def find_noise(s: BankSettings, x: BankState) -> None:
    """Find the variance of the noise in the deflections, ``x.third_noise``: nothing where an output answers it."""
    for j in range(x.third.shape[0]):
        most = 0.0
        for q in range(x.third_cross.shape[0]):
            if x.residual[q, 0] > 0.0 and x.third_power[j] > 0.0:
                variance = x.residual[q, 0] / x.residual[q, 1] * x.third_power[j]
                most = max(most, x.third_cross[q, j] * x.third_cross[q, j] / variance)
        noise = min(max(2.0 - most / ANSWERED, 0.0), 1.0)
        x.third_noise[j] = noise * x.third_median[j] / MEDIAN
