"""Noise in the measured deflections: the quick part of them that is white, and that no output answers.

An effector that rests still moves in the records, by the noise of its sensor. Least squares takes that for motion: no
output answers it, so the effect is nothing, and certain. But nothing has been learnt of the effect. What
follows from that stands in `bank_attenuation`; here the variance of the noise is found.

Third differences see hardly anything of motion, so their median square, over what white noise makes of it, is the most
that noise can be::

    d = (u_k - 3 u_(k-1) + 3 u_(k-2) - u_(k-3)) / sqrt 20,      sigma^2 <= median d^2 / .455

It is that while no output answers d: the sum over seconds of d times what a row's output does by the effector and
beyond the model is within `ANSWERED`; nothing from twice that on. What an output answers, as dither, is motion.

Noise that has passed through a window is not white, and little of it is left: there it is not looked for.

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
    begun = k >= size and s.straddle == 0
    pace = 1.0 + max(PACE, 1.0 / (k - size + 1.0)) if begun else 1.0
    for j in range(x.third.shape[0]):
        i = s.effectors_from + 1 + j
        last = x.deflections[k % size, j]
        x.deflections[k % size, j] = phi[i]
        if not begun:
            continue
        inner = x.deflections[(k - 2) % size, j] - x.deflections[(k - 1) % size, j]
        x.third[j] = (phi[i] - last + 3.0 * inner) / math.sqrt(20.0)
        square = x.third[j] * x.third[j]
        median = x.third_median[j] * pace if square > x.third_median[j] else x.third_median[j] / pace
        x.third_median[j] = square if k == size else max(median, SMALLEST * s.sigma[i] * s.sigma[i])
        x.third_power[j] = s.colour_forgetting * x.third_power[j] + square


@compiled
def observe_answer(s: BankSettings, x: BankState, q: int, error: float) -> None:
    """Update how row q's output goes with the third differences; ``error`` is what it does beyond the model."""
    first = s.effectors_from + 1
    for j in range(x.third.shape[0]):
        answer = error + x.mixed[q, first + j] * x.quick[first + j]
        x.third_cross[q, j] = s.colour_forgetting * x.third_cross[q, j] + answer * x.third[j]


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
