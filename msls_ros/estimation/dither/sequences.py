"""Random sequences of the dither: independent, zero mean, unit rms at the surface, one for each effector.

``white``: uniform noise from the raw stream of PCG64, low-passed to `dither.bandwidth`. ``multisine``: orthogonal
phase-optimised multisines (Morelli): a comb of harmonics of one period, dealt to the effectors in turn, so that over a
whole period all sequences are orthogonal, in time and in frequency; phases by Schroeder, then the best of a number of
random time shifts of them by peak factor, so that the peak is small for its power. Equal seeds give equal bits on every
machine.

References
----------
Schroeder, "Synthesis of Low-Peak-Factor Signals and Binary Sequences with Low Autocorrelation", IEEE Transactions on
Information Theory 16(1), 1970. Morelli, "Flight Test Maneuvers for Efficient Aerodynamic Modeling", Journal of
Aircraft 49(6), 2012.
"""

from __future__ import annotations

import math

import numpy as np

from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array
from msls_ros.estimation.kinematics import sine_cosine

BLOCK = 1024
CREST = math.sqrt(3.0)
"""Peak over rms of a uniform sequence."""
TRIALS = 64
"""Sets of phases that are tried per effector."""
POINTS = 512
"""Instants of a period at which the peak of a multisine is looked for."""


class WhiteNoise:
    """Uniform noise, zero mean, unit rms; the same stream however it is asked for.

    Parameters
    ----------
    effectors
        How many sequences.
    seed
        Of PCG64.
    """

    def __init__(self, effectors: int, seed: int) -> None:
        """Seed the generator; see the class."""
        self._effectors = effectors
        self._generator = np.random.PCG64(seed)
        self._noise = np.zeros((0, effectors))

    def draw(self, count: int) -> Array:
        """Return the next (count, m) numbers."""
        while len(self._noise) < count:
            raw = self._generator.random_raw(BLOCK * self._effectors) >> np.uint64(11)
            uniform: Array = raw.astype(np.float64) * 2.0**-52 - 1.0
            self._noise = np.concatenate([self._noise, (uniform * CREST).reshape(BLOCK, self._effectors)])
        drawn, self._noise = self._noise[:count], self._noise[count:]
        return drawn


@compiled
def peak_factor(harmonics: Array, phases: Array) -> float:
    """Peak over the rms of a sum of unit cosines, over sqrt(2): 1 for a single one.

    Parameters
    ----------
    harmonics, phases
        (h,) in cycles per period, and in cycles.
    """
    most = 0.0
    for i in range(POINTS):
        total = 0.0
        for k in range(harmonics.shape[0]):
            total += cosine_of_cycles(harmonics[k] * i / POINTS + phases[k])
        most = max(most, abs(total))
    return most / math.sqrt(harmonics.shape[0])


@compiled
def cosine_of_cycles(cycles: float) -> float:
    """Return the cosine of a phase in cycles."""
    _, cosine = sine_cosine(2.0 * math.pi * (cycles - math.floor(cycles)))
    return cosine


def multisines(effectors: int, period: float, low: float, high: float, seed: int) -> tuple[Array, Array]:
    """Return frequencies [Hz] and phases [cycles] of each effector's multisine, (m, h) each.

    Parameters
    ----------
    effectors
        How many sequences; h harmonics each, as many as the band holds for all of them.
    period
        Of the comb [s]: the harmonics are multiples of 1/period.
    low, high
        The band [Hz].
    seed
        Of the phases that are tried.

    Raises
    ------
    ValueError
        If the band holds not one harmonic for each effector.
    """
    first, last = max(math.ceil(low * period), 1), math.floor(high * period)
    each = (last - first + 1) // max(effectors, 1)
    if effectors and each < 1:
        message = (
            f"from {low:g} to {high:g} Hz are {max(last - first + 1, 0)} harmonics of {period:g} s, and "
            f"{effectors} effectors need one each"
        )
        raise ValueError(message)
    raw = np.random.PCG64(seed)
    harmonics = np.empty((effectors, each))
    phases = np.empty((effectors, each))
    k = np.arange(each)
    for j in range(effectors):
        harmonics[j] = first + j + effectors * k
        schroeder = -k * (k + 1.0) / (2.0 * each)
        best = math.inf
        for trial in range(TRIALS):
            noise = (raw.random_raw(each) >> np.uint64(11)).astype(np.float64) * 2.0**-53
            tried = schroeder + noise * (trial / TRIALS)
            factor = peak_factor(harmonics[j], tried)
            if factor < best:
                best, phases[j] = factor, tried
    return harmonics / period, phases - np.floor(phases)


@compiled
def multisine(t: float, frequencies: Array, phases: Array, corners: Array, out: Array) -> None:
    """Evaluate multisines, each raised so that the surface behind its actuator has unit rms.

    Parameters
    ----------
    t
        Time since the sequences began [s].
    frequencies, phases
        (m, h) [Hz] and [cycles].
    corners
        (m,) of the actuators [rad/s]; 0: none.
    out
        (m,) the commands.
    """
    for j in range(frequencies.shape[0]):
        total = 0.0
        for k in range(frequencies.shape[1]):
            ratio = 2.0 * math.pi * frequencies[j, k] / corners[j] if corners[j] > 0.0 else 0.0
            total += math.sqrt(1.0 + ratio * ratio) * cosine_of_cycles(frequencies[j, k] * t + phases[j, k])
        out[j] = total * math.sqrt(2.0 / frequencies.shape[1])
