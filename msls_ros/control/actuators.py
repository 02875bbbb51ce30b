"""Actuators watched: whether each surface follows its command.

A surface that is stuck does not show in B, which is per measured deflection. Two signs, per surface:

- **following**: measured increments against those of a modelled actuator (first-order, rate-limited) that is given the
  command with its dither, correlated at lags of 0 to 3 samples, for the latency of the stack is not known; the gain at
  the best lag below 0.25 is stuck, above 0.6 free again;
- **offset**: the measured position is away from that of the modelled actuator for many samples: a hard-over, or a
  surface that stays behind.
"""

from __future__ import annotations

import math

import numpy as np

from msls_ros.control.aircraft import ControlledAircraft
from msls_ros.control.compiled import compiled
from msls_ros.control.linear import Array, Flags
from msls_ros.control.settings import ControlSettings

LAGS = 4
"""Lags from 0 samples on."""
MEMORY = 12.5
"""Of the correlations [samples]."""
ENERGY = math.radians(0.6) ** 2
"""Least sum of squared command increments in that memory, for an answer [rad^2]."""
STUCK_BELOW, FREE_ABOVE = 0.25, 0.6


class StuckMonitor:
    """Which surfaces do not follow.

    Parameters
    ----------
    aircraft
        Whose actuators.
    settings
        See `ControlSettings`.
    """

    def __init__(self, aircraft: ControlledAircraft, settings: ControlSettings) -> None:
        """Watch nothing yet; see the class."""
        self._low, self._high = np.array(aircraft.low), np.array(aircraft.high)
        self._rate, self._bandwidth = np.array(aircraft.rate_limit), np.array(aircraft.bandwidth)
        self._settings = settings
        self.stuck: Flags = np.zeros(len(aircraft.surfaces), np.bool_)
        """(s,)"""
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        s = len(self._low)
        self._state = np.zeros((2, s))
        self._sums = np.zeros((2 * LAGS, s))
        self._past = np.zeros((LAGS, s))
        self._away = np.zeros(s)
        self.stuck = np.zeros(s, np.bool_)
        self._begun = False

    def update(self, measured: Array, command: Array, period: float) -> Flags:
        """Take measured positions, and the command that was held until they were measured.

        Parameters
        ----------
        measured, command
            (s,) [rad]; the command with its dither.
        period
            Since the last sample [s].
        """
        if not self._begun or not self._settings.stuck_monitor:
            self._state[:] = measured
            self._begun = True
            return self.stuck
        answer = 1.0 - np.exp(-self._bandwidth * period)
        target = np.clip(command, self._low, self._high)
        offset, samples = self._settings.stuck_offset, float(self._settings.stuck_samples)
        watch(
            *(measured, target, answer, self._rate * period, self._state, self._past, self._sums, self._away),
            *(self.stuck, offset, samples),
        )
        return self.stuck


@compiled
def watch(
    measured: Array,
    target: Array,
    answer: Array,
    largest: Array,
    state: Array,
    past: Array,
    sums: Array,
    away: Array,
    stuck: Flags,
    offset: float,
    samples: float,
) -> None:
    """Update the monitor; arrays of (s,) but ``state`` (2, s), ``past`` (lags, s) and ``sums`` (2 lags, s)."""
    forget = 1.0 - 1.0 / MEMORY
    for i in range(measured.shape[0]):
        step = min(max((target[i] - state[0, i]) * answer[i], -largest[i]), largest[i])
        state[0, i] += step
        moved = measured[i] - state[1, i]
        state[1, i] = measured[i]
        for lag in range(LAGS - 1, 0, -1):
            past[lag, i] = past[lag - 1, i]
        past[0, i] = step
        enough, best = True, -1e300
        for lag in range(LAGS):
            sums[lag, i] = forget * sums[lag, i] + past[lag, i] * past[lag, i]
            sums[LAGS + lag, i] = forget * sums[LAGS + lag, i] + past[lag, i] * moved
            enough = enough and sums[lag, i] > ENERGY
            best = max(best, sums[LAGS + lag, i] / max(sums[lag, i], 1e-12))
        away[i] = away[i] + 1.0 if abs(measured[i] - state[0, i]) > offset else 0.0
        if (enough and best < STUCK_BELOW) or away[i] > samples:
            stuck[i] = True
        if enough and best > FREE_ABOVE:
            stuck[i] = False
