"""Active noise injection (ANI): small random effector activity that keeps B identifiable (eqs 20-23).

For each sample the law shares out the acceleration that is allowed at a station, 0.012 g rms at the nominal level and
0.04 g rms for a short time after an alarm, among the effectors (`dither.allocation`). Each effector gets its own
zero-mean sequence (`sequences`), because effectors that the control law gangs together are otherwise inseparable. What
the paper leaves out is here: the command is larger than what is wanted at the surface by the gain of the actuator;
rates and positions are limited in time as the stamps tell it (`dither.limits`); an absolute cap holds whatever B-hat
says, a lower one for an effector that is not excited; the acceleration that B-hat predicts from the commands actually
sent stays at its limit in every window of a second; after a gap in the data the dither is zero.
"""

from __future__ import annotations

import math

import numpy as np

from msls_ros.estimation.compiled import Bound
from msls_ros.estimation.configuration import Configuration
from msls_ros.estimation.dither.answer import FROZEN, DitherBlock
from msls_ros.estimation.dither.inputs import Comb, Knowledge, Law, make_dither_work
from msls_ros.estimation.dither.law import inject
from msls_ros.estimation.dither.limits import (
    CAP,
    CORNER,
    RATE,
    SEQUENCE,
    WEIGHT,
    elapse,
    make_effectors,
    positions,
    rows_of,
    settle,
)
from msls_ros.estimation.dither.sequences import WhiteNoise, multisines
from msls_ros.estimation.kernel import Array


class DitherLaw:
    """Sequence generator and limiter; `commands` answers samples in their order.

    Parameters
    ----------
    configuration
        The identifier's; section ``dither``, names and sample rate are used.
    """

    def __init__(self, configuration: Configuration) -> None:
        """Prepare limits and sequences; see the class."""
        self._rows = rows_of(configuration.rows)
        self._effectors = len(configuration.effectors)
        self._seed = configuration.dither.seed
        self._work = make_dither_work(self._effectors)
        self._inject = Bound(inject)
        self.configure(configuration)
        self.reset()

    def configure(self, configuration: Configuration) -> None:
        """Take over changed parameters; the sequences go on."""
        p = configuration.dither
        self._limits = _limits(configuration)
        self._law = Law(
            enabled=p.enabled,
            limit_nominal=p.limit_nominal,
            limit_boosted=p.limit_boosted,
            boost_duration=p.boost_duration,
            boost_budget=p.boost_budget,
            stale_after=p.stale_after,
            period=1.0 / configuration.sample_rate,
            cap_unreliable=p.cap_unreliable,
            excitation=configuration.reliability.excitation,
            known_error=configuration.reliability.relative_error,
            target_error=p.target_error,
            worst_case=p.acceleration == "worst_case",
            information=p.allocation == "information",
            rest=0.5 / min(p.actuator_bandwidth) if p.actuator_bandwidth else 0.0,
            activity_nominal=p.activity_nominal,
            activity_boosted=p.activity_boosted,
            station=np.array([p.pilot_forward, p.pilot_above, p.pilot_right]),
            rows=self._rows,
        )
        self._multisine = (p.sequence == "multisine", p.multisine_period, p.multisine_low, p.multisine_high)
        if hasattr(self, "_state"):
            self._state.limits[:] = self._limits

    def reset(self) -> None:
        """Start the sequences anew from the seed."""
        self._noise = WhiteNoise(self._effectors, self._seed)
        wanted, period, low, high = self._multisine
        empty = np.zeros((self._effectors, 1))
        frequencies, phases = (
            multisines(self._effectors, period, low, high, self._seed) if wanted else (empty, empty.copy())
        )
        self._comb = Comb(period if wanted else 0.0, frequencies, phases, np.array([math.nan]))
        self._state = make_effectors(self._limits.copy(), 0.5 * self._law.boost_budget)

    def commands(self, time: Array, known: Knowledge, delta: Array) -> DitherBlock:
        """Return the dithers that answer n samples.

        Parameters
        ----------
        time
            (n,) [s].
        known
            What is known of B after each.
        delta
            (n, m) measured deflections [rad].
        """
        out = self._zeros(len(time))
        noise = self._noise.draw(len(time))
        self._inject(self._law, self._state, time, known, delta, noise, self._comb, self._work, out)
        return out

    def silence(self, time: Array, why: int = FROZEN) -> DitherBlock:
        """Return zero dithers where nothing is learnt, ``why`` of `REASONS`; surfaces come to rest, sequences stay."""
        for one in time:
            dt = elapse(self._state, float(one), self._law.period, self._law.stale_after)
            settle(self._state, max(dt - self._law.stale_after, 0.0))
        return self._zeros(len(time), why)

    def _zeros(self, count: int, reason: int = FROZEN) -> DitherBlock:
        level, why = np.zeros((2, count), np.int64)
        why.fill(reason)
        rms, predicted, limit = np.zeros((3, count))
        return DitherBlock(np.zeros((count, self._effectors)), rms, predicted, limit, level, why)


def _limits(configuration: Configuration) -> Array:
    """Per effector the columns of `dither.limits`."""
    p, m = configuration.dither, len(configuration.effectors)
    weights = np.array(p.weights or (1.0,) * m)
    heaviest = float(weights.max()) if m else 0.0
    found = np.zeros((m, 7))
    found[:, WEIGHT] = weights / heaviest if heaviest > 0.0 else 0.0
    found[:, CORNER] = p.actuator_bandwidth or 0.0
    found[:, SEQUENCE] = 2.0 * math.pi * p.bandwidth
    found[:, RATE] = p.rate_limit or math.inf
    found[:, 4:6] = positions(p.position_low, p.position_high, m)
    found[:, CAP] = p.cap
    return found
