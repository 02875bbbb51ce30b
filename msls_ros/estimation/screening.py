"""Which samples are learnt from: those of flight, without spikes.

**Flight.** On its wheels an aircraft obeys other equations, and what it learns there (that surfaces at rest have no
effect, that no moment turns the nose) stands against what flight says for as long as the longest memory. Below a share
of the reference speed nothing is learnt. What has been below it for a while, or is first seen at less than twice it,
may be rolling when it is faster: it flies once it climbs or sinks, by the flight path angle

    sin(gamma) = (u sin(theta) - v sin(phi) cos(theta) - w cos(phi) cos(theta)) / V

in the mean of a second, or when it has been that fast for longer than any take-off takes.

**Spikes** are not learnt from, and where one may be, not before it is seen that it is none: see `spikes`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from msls_ros.estimation.compiled import Bound, compiled
from msls_ros.estimation.configuration import Configuration
from msls_ros.estimation.kernel import Array, Integers
from msls_ros.estimation.spikes import SpikeSettings, SpikeState, judge_spike, spike_settings, spike_state

LEARNT, HELD, GROUNDED = range(3)
"""Verdicts."""
GONE = 5.0
"""Slower than the least speed for so long: not flying any more; an airspeed may fail for a moment [s]."""
CLIMB = 0.05
"""Sine of the flight path angle, in the mean of `CLIMB_MEMORY`, of what flies: 3 deg. Vanes are off by a degree."""
CLIMB_MEMORY = 1.0
"""[s]"""
ROLLING = 60.0
"""Nothing rolls for longer at such a speed [s]."""
CERTAIN = 2.0
"""Faster than the least speed by so much at the first sample: flying."""
GAP = 2.5
"""Sample periods after which a difference says nothing."""


class FlightSettings(NamedTuple):
    """What says whether a sample is of flight."""

    slowest: float
    """Least speed of flight; 0: not looked at [m/s]."""
    velocity: Integers
    """(3,) which states are u, v, w; negative where absent."""
    angles: Integers
    """(2,) which are Phi and Theta; negative where absent."""
    longest_step: float
    """Of time that counts [s]."""


class FlightState(NamedTuple):
    """What is remembered of it."""

    flight: Array
    """Whether it flies (1; 0: no; -1: not known yet), time below and above the least speed [s], mean sine of the path
    angle."""
    clock: Array
    """(1,) of the last sample [s]."""
    grounded: Integers
    """(1,) samples that were not of flight."""


def flight_settings(configuration: Configuration) -> FlightSettings:
    """Return the settings of an identifier; velocities that are differences from a trim say nothing."""
    c = configuration
    find = {name: i for i, name in enumerate(c.states)}
    return FlightSettings(
        slowest=c.flying_speed * c.reference_speed if c.known_gravity and "u" in find else 0.0,
        velocity=np.array([find.get(s, -1) for s in ("u", "v", "w")], np.int64),
        angles=np.array([find.get(s, -1) for s in ("Phi", "Theta")], np.int64),
        longest_step=GAP / c.sample_rate,
    )


class Screened(NamedTuple):
    """Judged samples: k of them, l of which are learnt now, held ones from before among them."""

    time: Array
    """(l,) [s]."""
    x: Array
    xdot: Array
    delta: Array
    """(l, n), (l, n), (l, m)."""
    verdict: Integers
    """(k,) `LEARNT`, `HELD` or `GROUNDED`."""
    learnt: Integers | None
    """(k,) how many are learnt at each; None: that one."""


class Screen:
    """Say of samples which are learnt from, and when.

    Parameters
    ----------
    configuration
        Of the identifier. The paper's method and RLS learn from every sample.
    """

    def __init__(self, configuration: Configuration) -> None:
        """Start anew; see the class."""
        c = configuration
        self.idle = c.estimator.method != "bank"
        """Whether every sample is learnt from, whatever it holds."""
        n, m = len(c.states), len(c.effectors)
        velocity = [s in ("u", "v", "w") for s in c.states]
        self._names = (*c.states, *(f"d{name}/dt" for name in c.states), *c.effectors)
        self._flight_settings = flight_settings(c)
        self._flight = FlightState(np.zeros(4), np.zeros(1), np.zeros(1, np.int64))
        self._spike_settings = spike_settings(
            [*velocity, *velocity, *[False] * m],
            [*[False] * n, *[True] * n, *[False] * m],
            c.reference_speed,
            GAP / c.sample_rate,
            [*range(n, 2 * n), *[-1] * (n + m)],
        )
        self._spikes = spike_state(2 * n + m)
        self._judge = Bound(judge_samples)
        self.reset()

    def reset(self) -> None:
        """Forget everything, counts too."""
        for array in (*self._flight, *self._spikes):
            array[:] = 0
        self._flight.flight[0] = -1.0

    @property
    def flying(self) -> bool:
        """Whether the last sample was of flight."""
        return bool(self.idle or self._flight_settings.slowest == 0.0 or self._flight.flight[0] != 0.0)

    @property
    def spikes(self) -> int:
        """Samples dropped as spikes."""
        return int(self._spikes.counts[2])

    @property
    def grounded(self) -> int:
        """Samples that were not of flight."""
        return int(self._flight.grounded[0])

    @property
    def spike(self) -> str:
        """What jumped furthest in the last spike; empty: there was none."""
        return self._names[int(self._spikes.counts[3])] if self.spikes else ""

    def judge(self, time: Array, x: Array, xdot: Array, delta: Array) -> Screened:
        """Judge k samples in order.

        Parameters
        ----------
        time
            (k,) [s].
        x, xdot, delta
            (k, n), (k, n), (k, m).
        """
        count, n = len(time), x.shape[1]
        samples, verdict, released = np.concatenate([x, xdot, delta], axis=1), _zeros(count), _zeros(count)
        before = int(self._spikes.counts[1])
        held = (self._spikes.held_time[:before].copy(), self._spikes.held[:before].copy()) if before else None
        self._judge(
            self._flight_settings, self._flight, self._spike_settings, self._spikes, time, samples, verdict, released
        )
        if not verdict.any() and held is None:
            return Screened(time, x, xdot, delta, verdict, None)
        if held is not None:
            time, samples = np.concatenate([held[0], time]), np.concatenate([held[1], samples])
        learnt: list[int] = []
        waiting = list(range(before))
        for k, (said, out) in enumerate(zip(verdict.tolist(), released.tolist(), strict=True), before):
            if said == HELD:
                waiting.append(k)
                continue
            learnt += [*waiting[:out], k] if said == LEARNT else []
            waiting = []
        rows = samples[learnt]
        x, xdot, delta = (np.ascontiguousarray(part) for part in (rows[:, :n], rows[:, n : 2 * n], rows[:, 2 * n :]))
        return Screened(time[learnt], x, xdot, delta, verdict, np.where(verdict == LEARNT, released + 1, 0))


def _zeros(count: int) -> Integers:
    return np.zeros(count, np.int64)


@compiled
def judge_samples(
    f: FlightSettings,
    flight: FlightState,
    s: SpikeSettings,
    spikes: SpikeState,
    time: Array,
    samples: Array,
    verdict: Integers,
    released: Integers,
) -> None:
    """Judge k samples of c numbers in order.

    Parameters
    ----------
    f, flight, s, spikes
        Settings, and states; updated.
    time, samples
        (k,) [s] and (k, c): states, derivatives, deflections.
    verdict, released
        (k,) out: `LEARNT`, `HELD` or `GROUNDED`, and how many samples that were held are to be learnt before it.
    """
    for k in range(time.shape[0]):
        released[k] = 0
        if f.slowest > 0.0 and not is_flying(f, flight, time[k], samples[k]):
            verdict[k] = GROUNDED
            flight.grounded[0] += 1 + spikes.counts[1]
            spikes.counts[0] = 0
            spikes.counts[1] = 0
            continue
        verdict[k] = LEARNT
        released[k] = judge_spike(s, spikes, time[k], samples[k])
        if released[k] < 0:
            released[k] = 0
            verdict[k] = HELD


@compiled
def is_flying(s: FlightSettings, x: FlightState, time: float, sample: Array) -> bool:
    """Whether a sample, (c,) at a time [s], is of flight."""
    step = min(max(time - x.clock[0], 0.0), s.longest_step)
    x.clock[0] = time
    square = 0.0
    for i in range(3):
        if s.velocity[i] >= 0:
            square += sample[s.velocity[i]] * sample[s.velocity[i]]
    speed = math.sqrt(square)
    fast = speed >= s.slowest
    if x.flight[0] < 0.0:
        x.flight[0] = 1.0 if speed >= CERTAIN * s.slowest else 0.0
    if not fast:
        x.flight[1] += step
        x.flight[2] = 0.0
        x.flight[3] = 0.0
        if x.flight[1] >= GONE:
            x.flight[0] = 0.0
        return False
    x.flight[1] = 0.0
    if x.flight[0] == 0.0:
        x.flight[2] += step
        x.flight[3] += min(step / CLIMB_MEMORY, 1.0) * (climb_of(s, sample) / speed - x.flight[3])
        climbs = x.flight[2] >= CLIMB_MEMORY and abs(x.flight[3]) > CLIMB
        if climbs or x.flight[2] >= ROLLING:
            x.flight[0] = 1.0
    return bool(x.flight[0] > 0.0)


@compiled
def climb_of(s: FlightSettings, sample: Array) -> float:
    """Return the speed of climb of a sample, (c,); 0 where the attitude is not known [m/s]."""
    if s.angles[0] < 0 or s.angles[1] < 0:
        return 0.0
    phi = sample[s.angles[0]]
    theta = sample[s.angles[1]]
    climb = sample[s.velocity[0]] * math.sin(theta)
    if s.velocity[1] >= 0:
        climb -= sample[s.velocity[1]] * math.sin(phi) * math.cos(theta)
    if s.velocity[2] >= 0:
        climb -= sample[s.velocity[2]] * math.cos(phi) * math.cos(theta)
    return float(climb)
