"""Active noise injection (ANI): small random effector activity that keeps B identifiable (eqs 20-23).

The law solves eq 23 for the largest common rms ``Delta`` of the surfaces for which the worst-case acceleration at the
pilot stays at its limit, 0.012 g rms every day and 0.04 g rms for a short time after an alarm::

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

import numpy as np

from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.configuration import Configuration
from msls_ros.estimation.kernel import Array
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


@compiled
def pilot_acceleration(effect: Array, rows: Array, forward: float, above: float) -> float:
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
    b = np.zeros(6)
    for i in range(6):
        if rows[i] >= 0.0:
            b[i] = effect[int(rows[i])]
    lateral = b[1] + above * b[3] + forward * b[5]
    normal = b[2] + forward * b[4]
    return math.sqrt(b[0] * b[0] + lateral * lateral + normal * normal)


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


class DitherLaw:
    """Sequence generator and limiter; one `command` per sample.

    Parameters
    ----------
    configuration
        The identifier's; section ``dither``, names and sample rate are used.
    """

    def __init__(self, configuration: Configuration) -> None:
        """Prepare limits and sequences; see the class."""
        self._rows = np.array([configuration.rows.index(s) if s in configuration.rows else -1 for s in "uvwPQR"], float)
        self._effectors = len(configuration.effectors)
        self.configure(configuration)
        self._seed = configuration.dither.seed
        self.reset()

    def configure(self, configuration: Configuration) -> None:
        """Take over changed parameters; the sequences go on."""
        self._p = configuration.dither
        self._excitation = configuration.reliability.excitation
        self.weights = np.array(self._p.weights or (1.0,) * self._effectors)
        self._limits = _limits(configuration, self.weights)

    def reset(self) -> None:
        """Start the sequences anew from the seed."""
        self._generator = np.random.PCG64(self._seed)
        self._noise = np.zeros((0, self._effectors))
        self._next = 0
        self._sequence = np.zeros(self._effectors)
        self._surface = np.zeros(self._effectors)
        self._boost_until = -math.inf
        self._last_time = -math.inf

    def command(self, time: float, effect: Array, excitation: float, alarm: bool, delta: Array) -> Dither:
        """Return the dither that answers the sample at ``time``.

        Parameters
        ----------
        time
            Of the sample [s].
        effect
            (r,) weighted sum of absolute values of each row of B-hat.
        excitation
            Least excitation of an effector's column [1].
        alarm
            An abrupt change was declared at this sample.
        delta
            (m,) measured deflections [rad].
        """
        p = self._p
        gap = time - self._last_time
        self._last_time = time
        if alarm:
            self._boost_until = time + p.boost_duration
        if not p.enabled:
            return self._zero(Level.OFF, "dither is disabled")
        if math.isfinite(gap) and gap > p.stale_after:
            return self._zero(Level.INHIBITED, f"no sample for {gap:.3g} s, more than {p.stale_after:g} s")
        boosted = time < self._boost_until
        limit = p.limit_boosted if boosted else p.limit_nominal
        unit = pilot_acceleration(effect, self._rows, p.pilot_forward, p.pilot_above) / GRAVITY
        cap, why = p.cap, "eq 23"
        if excitation < self._excitation:
            cap = min(cap, p.cap_unreliable * (limit / p.limit_nominal if boosted and p.limit_nominal > 0.0 else 1.0))
            why = "capped while B is not excited"
        heaviest = float(self.weights.max())
        rms = cap / heaviest if heaviest > 0.0 else 0.0
        if math.isfinite(unit) and unit * rms > limit:
            rms, why = limit / unit, "eq 23"
        elif not math.isfinite(unit):
            rms, why = 0.0, "B is not finite"
        out = np.zeros(self._effectors)
        shape_noise(self._draw(), rms, self._limits, delta, self._sequence, self._surface, out)
        level = Level.BOOSTED if boosted else Level.NOMINAL
        return Dither(out, rms, unit * rms if rms > 0.0 else 0.0, limit, level, why)

    def _zero(self, level: Level, reason: str) -> Dither:
        self._surface *= self._limits[:, 3]
        return Dither(np.zeros(self._effectors), 0.0, 0.0, 0.0, level, reason)

    def _draw(self) -> Array:
        if self._next == len(self._noise):
            raw = self._generator.random_raw(BLOCK * self._effectors) >> np.uint64(11)
            uniform: Array = raw.astype(np.float64) * 2.0**-52 - 1.0
            self._noise = (uniform * CREST).reshape(BLOCK, self._effectors)
            self._next = 0
        self._next += 1
        row: Array = self._noise[self._next - 1]
        return row


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
