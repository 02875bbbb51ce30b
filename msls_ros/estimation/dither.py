"""Active noise injection (ANI): small random effector activity that keeps B identifiable (eqs 20-23).

The law solves eq 23 for the largest common rms ``Delta`` of the surfaces for which the worst-case acceleration at the
pilot stays at its limit, 0.012 g rms at the nominal level and 0.04 g rms for a short time after an alarm::

    a_p^2 = Delta^2 [ (S b_u)^2 + (S b_v + l2 S b_P + l1 S b_R)^2 + (S b_w + l1 S b_Q)^2 ]

with ``S b_i`` the sum of absolute values of row i of B-hat. Each effector gets its own zero-mean random sequence,
because effectors that the control law gangs together are otherwise inseparable. What the paper leaves out is here: the
command is larger than what is wanted at the surface by the gain of the actuator; rates and positions are limited; an
absolute cap holds whatever B-hat says, a lower one while B-hat is not excited; after a gap in the data the dither is
zero.

The sequences come from the raw stream of PCG64: equal seeds give equal bits on every machine.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.configuration import Configuration
from msls_ros.estimation.kernel import Array, Integers
from msls_ros.estimation.kinematics import GRAVITY

BLOCK = 1024
CREST = math.sqrt(3.0)
"""Peak over rms of a uniform sequence."""


class Level(enum.IntEnum):
    """Level of the dither; the numbers are those of the message."""

    OFF = 0
    NOMINAL = 1
    BOOSTED = 2
    INHIBITED = 3


@dataclass(frozen=True)
class Dither:
    """The dither that answers one sample."""

    delta: Array
    """(m,) what to add to the commands [rad]."""
    rms: float
    """Common rms wanted at the surfaces, before weights [rad]."""
    predicted_acceleration: float
    """Worst case at the pilot, eq 23 [g rms]."""
    acceleration_limit: float
    """Its limit at this level [g rms]."""
    level: Level
    reason: str


REASONS = (
    "dither is disabled",
    "no sample for longer than dither.stale_after",
    "B is not finite",
    "capped while B is not excited",
    "capped by dither.cap",
    "eq 23",
    "the estimator is frozen",
)
DISABLED, GAP, NOT_FINITE, NOT_EXCITED, CAPPED, EQUATION_23, FROZEN = range(len(REASONS))


class DitherBlock(NamedTuple):
    """The dithers that answer n samples, m effectors."""

    delta: Array
    """(n, m) what to add to the commands [rad]."""
    rms: Array
    predicted_acceleration: Array
    acceleration_limit: Array
    level: Integers
    reason: Integers
    """(n,) index into `REASONS`."""

    def at(self, k: int) -> Dither:
        """Return the dither that answers sample k."""
        return Dither(
            self.delta[k],
            float(self.rms[k]),
            float(self.predicted_acceleration[k]),
            float(self.acceleration_limit[k]),
            Level(int(self.level[k])),
            REASONS[int(self.reason[k])],
        )


class Law(NamedTuple):
    """What the compiled law needs to know."""

    enabled: bool
    limit_nominal: float
    limit_boosted: float
    """[g]"""
    boost_duration: float
    stale_after: float
    """[s]"""
    cap: float
    cap_unreliable: float
    """Common rms [rad]."""
    excitation: float
    forward: float
    above: float
    """Pilot [m]."""
    rows: Integers
    """(6,) index of u, v, w, P, Q, R among the rows; negative where absent."""
    limits: Array
    """(m, 8) per effector, see `shape_noise`."""


@compiled
def pilot_acceleration(effect: Array, rows: Integers, forward: float, above: float) -> float:
    """Worst-case rms acceleration at the pilot per rms of the surfaces, the square root of eq 23 [m/s^2/rad].

    Parameters
    ----------
    effect
        (r,) weighted sum of absolute values of each row of B-hat.
    rows
        (6,) index of the rows u, v, w, P, Q, R in ``effect``; negative where absent.
    forward, above
        l1 and l2, the pilot ahead of and above the centre of mass [m].
    """
    axial = effect[rows[0]] if rows[0] >= 0 else 0.0
    lateral = effect[rows[1]] if rows[1] >= 0 else 0.0
    normal = effect[rows[2]] if rows[2] >= 0 else 0.0
    if rows[3] >= 0:
        lateral += above * effect[rows[3]]
    if rows[5] >= 0:
        lateral += forward * effect[rows[5]]
    if rows[4] >= 0:
        normal += forward * effect[rows[4]]
    return math.sqrt(axial * axial + lateral * lateral + normal * normal)


@compiled
def shape_noise(
    noise: Array, rms: float, limits: Array, delta: Array, sequence: Array, surface: Array, out: Array
) -> None:
    """Turn one draw of unit-rms noise per effector into a command inside all limits, in place.

    Parameters
    ----------
    noise
        (m,) independent, zero mean, unit rms.
    rms
        Common rms wanted at the surfaces [rad].
    limits
        (m, 8) per effector: weight, command rms over surface rms, pole of the sequence, pole of the actuator, largest
        |command - surface| that keeps the rate [rad], lowest and highest position [rad], largest |command| [rad].
    delta
        (m,) measured deflections [rad].
    sequence, surface
        (m,) state: the unit-rms sequence and the dither's share of the surface position [rad].
    out
        (m,) the command [rad].
    """
    for j in range(noise.shape[0]):
        weight, gain, colour, pole, reach, low, high, most = limits[j]
        sequence[j] = colour * sequence[j] + math.sqrt(1.0 - colour * colour) * noise[j]
        command = weight * rms * gain * sequence[j]
        base = delta[j] - surface[j]
        command = min(max(command, min(0.0, low - base)), max(0.0, high - base))
        command = min(max(command, -most), most)
        command = min(max(command, surface[j] - reach), surface[j] + reach)
        surface[j] = pole * surface[j] + (1.0 - pole) * command
        out[j] = command


@compiled
def choose_rms(law: Law, unit: float, excitation: float, boosted: bool) -> tuple[float, int]:
    """Largest common rms of the surfaces that keeps every limit (eq 23) [rad], and which limit binds.

    Parameters
    ----------
    law
        Limits.
    unit
        Worst-case acceleration at the pilot per rms of the surfaces [g/rad].
    excitation
        Least excitation of an effector's column [1].
    boosted
        An alarm was a short time ago.
    """
    if not math.isfinite(unit):
        return 0.0, NOT_FINITE
    limit = law.limit_boosted if boosted else law.limit_nominal
    rms, why = law.cap, CAPPED
    if excitation < law.excitation:
        raised = limit / law.limit_nominal if law.limit_nominal > 0.0 else 1.0
        if law.cap_unreliable * raised < rms:
            rms, why = law.cap_unreliable * raised, NOT_EXCITED
    if unit * rms > limit:
        rms, why = limit / unit, EQUATION_23
    return rms, why


@compiled
def inject(
    law: Law,
    time: Array,
    effect: Array,
    excitation: Array,
    alarm: Integers,
    delta: Array,
    noise: Array,
    clock: Array,
    sequence: Array,
    surface: Array,
    out: DitherBlock,
) -> None:
    """Fill ``out`` with the dithers that answer n samples.

    Parameters
    ----------
    law
        Limits.
    time, effect, excitation, alarm, delta, noise
        Per sample: time [s], (n, r) effect of the effectors per row, least excitation, alarms per row (n, r), measured
        deflections [rad], unit-rms noise.
    clock
        (2,) state: time of the last sample, end of the boost [s].
    sequence, surface
        (m,) state, see `shape_noise`.
    out
        Per sample.
    """
    for k in range(time.shape[0]):
        gap = time[k] - clock[0]
        clock[0] = time[k]
        for q in range(alarm.shape[1]):
            if alarm[k, q] != 0:
                clock[1] = time[k] + law.boost_duration
        stale = math.isfinite(gap) and gap > law.stale_after
        if stale or not law.enabled:
            out.level[k] = 3 if law.enabled else 0
            out.reason[k] = GAP if law.enabled else DISABLED
            for j in range(surface.shape[0]):
                surface[j] *= law.limits[j, 3]
            continue
        boosted = time[k] < clock[1]
        unit = pilot_acceleration(effect[k], law.rows, law.forward, law.above) / GRAVITY
        rms, why = choose_rms(law, unit, excitation[k], boosted)
        shape_noise(noise[k], rms, law.limits, delta[k], sequence, surface, out.delta[k])
        out.rms[k] = rms
        limit = law.limit_boosted if boosted else law.limit_nominal
        out.predicted_acceleration[k] = min(unit * rms, limit) if rms > 0.0 else 0.0
        out.acceleration_limit[k] = limit
        out.level[k] = 2 if boosted else 1
        out.reason[k] = why


class DitherLaw:
    """Sequence generator and limiter; `commands` answers samples in their order.

    Parameters
    ----------
    configuration
        The identifier's; section ``dither``, names and sample rate are used.
    """

    def __init__(self, configuration: Configuration) -> None:
        """Prepare limits and sequences; see the class."""
        rows = [configuration.rows.index(s) if s in configuration.rows else -1 for s in "uvwPQR"]
        self._rows = np.array(rows, np.int64)
        self._effectors = len(configuration.effectors)
        self._seed = configuration.dither.seed
        self.configure(configuration)
        self.reset()

    def configure(self, configuration: Configuration) -> None:
        """Take over changed parameters; the sequences go on."""
        p = configuration.dither
        self.weights = np.array(p.weights or (1.0,) * self._effectors)
        heaviest = float(self.weights.max()) if self._effectors else 0.0
        share = 1.0 / heaviest if heaviest > 0.0 else 0.0
        self._law = Law(
            enabled=p.enabled,
            limit_nominal=p.limit_nominal,
            limit_boosted=p.limit_boosted,
            boost_duration=p.boost_duration,
            stale_after=p.stale_after,
            cap=p.cap * share,
            cap_unreliable=p.cap_unreliable * share,
            excitation=configuration.reliability.excitation,
            forward=p.pilot_forward,
            above=p.pilot_above,
            rows=self._rows,
            limits=_limits(configuration, self.weights),
        )

    def reset(self) -> None:
        """Start the sequences anew from the seed."""
        self._generator = np.random.PCG64(self._seed)
        self._noise = np.zeros((0, self._effectors))
        self._sequence = np.zeros(self._effectors)
        self._surface = np.zeros(self._effectors)
        self._clock = np.array([-math.inf, -math.inf])

    def commands(self, time: Array, effect: Array, excitation: Array, alarm: Integers, delta: Array) -> DitherBlock:
        """Return the dithers that answer n samples; see `inject` for the arguments."""
        out = self.silence(len(time))
        noise = self._draw(len(time))
        inject(
            self._law, time, effect, excitation, alarm, delta, noise, self._clock, self._sequence, self._surface, out
        )
        return out

    def silence(self, count: int) -> DitherBlock:
        """Return zero dithers for that many samples, for a frozen estimator; the sequences stand still."""
        zero = np.zeros(count)
        level, reason = np.zeros(count, np.int64), np.empty(count, np.int64)
        reason.fill(FROZEN)
        return DitherBlock(np.zeros((count, self._effectors)), zero, zero.copy(), zero.copy(), level, reason)

    def _draw(self, count: int) -> Array:
        """Return (count, m) noise: uniform, zero mean, unit rms; the same stream however it is asked for."""
        while len(self._noise) < count:
            raw = self._generator.random_raw(BLOCK * self._effectors) >> np.uint64(11)
            uniform: Array = raw.astype(np.float64) * 2.0**-52 - 1.0
            self._noise = np.concatenate([self._noise, (uniform * CREST).reshape(BLOCK, self._effectors)])
        drawn, self._noise = self._noise[:count], self._noise[count:]
        return drawn


def _limits(configuration: Configuration, weights: Array) -> Array:
    """Per effector the row of limits that `shape_noise` takes."""
    p = configuration.dither
    step = 1.0 / configuration.sample_rate
    colour = math.exp(-2.0 * math.pi * p.bandwidth * step) if p.bandwidth > 0.0 else 0.0
    rows = []
    for j, weight in enumerate(weights):
        pole = math.exp(-p.actuator_bandwidth[j] * step) if p.actuator_bandwidth else 0.0
        gain = math.sqrt((1.0 + pole) * (1.0 - colour * pole) / ((1.0 - pole) * (1.0 + colour * pole)))
        reach = math.inf
        if p.rate_limit:
            reach = p.rate_limit[j] * (1.0 / p.actuator_bandwidth[j] if p.actuator_bandwidth else step)
        low = p.position_low[j] if p.position_low else -math.inf
        high = p.position_high[j] if p.position_high else math.inf
        rows.append((weight, gain, colour, pole, reach, low, high, CREST * p.cap * gain))
    return np.array(rows).reshape(-1, 8)
