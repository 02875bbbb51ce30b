"""Which samples are learnt from: those of flight that were measured, without spikes; and how often they come.

**Flight.** On its wheels an aircraft obeys other equations, and what it learns there (that surfaces at rest have no
effect, that no moment turns the nose) stands against what flight says for as long as the longest memory. Below a share
of the reference speed nothing is learnt. What has been below it for a while, or is first seen at less than twice it,
may be rolling when it is faster: it flies once it climbs or sinks, by the flight path angle

    sin(gamma) = (u sin(theta) - v sin(phi) cos(theta) - w cos(phi) cos(theta)) / V

in the mean of a second, or when it has been that fast for longer than any take-off takes.

**Numbers that repeat** because nothing has measured them since are not learnt from: see `repeats`.

**Spikes** are not learnt from, and where one may be, not before it is seen that it is none: see `spikes`.

**Pace.** What is left may come more slowly than was said. Memories and windows are times; where samples have come half
as often again too slowly `SLOW_ROWS` times (more than they have not), or as much too quickly for the pace of before,
whoever learns from them begins anew at the rate at which they come. What has been learnt is not given up for a link
that fails for seconds: that must have gone on for half as long as the pace of before, or for `LASTS`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from msls_ros.estimation.compiled import Bound, compiled, passed_by_reference
from msls_ros.estimation.configuration import Configuration
from msls_ros.estimation.kernel import Array, Integers
from msls_ros.estimation.repeats import (
    COMPLETE,
    CULPRIT,
    PASSED,
    WAITING,
    RepeatSettings,
    RepeatState,
    repeat_settings,
    repeat_state,
    take_row,
)
from msls_ros.estimation.spikes import (
    DROPPED,
    LONGEST,
    ROOM,
    SPIKE,
    SpikeSettings,
    SpikeState,
    forget_held,
    judge_spike,
    spike_settings,
    spike_state,
)

LEARNT, HELD, GROUNDED, REPEATED = range(4)
"""Verdicts: learnt from, may be a spike or waits for the next measurement and is learnt from later, not of flight, not
measured."""
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
SLOW, SLOW_ROWS = 1.5, 12
"""How many times as long as the period samples take at another pace, and how many of them show it. A link that loses a
fifth of the samples shows that at e^-16 to one."""
LASTS, SHARE = 10.0, 0.5
"""For so long another pace must have gone on, or for such a share of the time of the one before [s, 1].

A V-tail of 4 kg whose commands (50 Hz of 100) were lost by 70 % for 2.5 s, six times in 160 s, forgot everything at
three of them.
"""
LONGEST_STEP = 0.3
"""Between samples that say anything of the pace [s]."""

FLYING, BELOW, ABOVE, PATH = range(4)
"""Of `FlightState.flight`: whether it flies (1; 0: no; -1: not known yet), time below and above the least speed [s],
mean sine of the path angle."""
LAST, PERIOD, SAID, SUM, FITS = range(5)
"""Of `PaceState.clock`: time of the last sample that was measured, period that is believed and that was said, sums of
the steps that are none of it, since one was, and of those that are [s]."""
SEEN, SHOWN, OTHER = range(3)
"""Of `PaceState.counts`: samples since the start, by how many another pace is shown, and how many steps are none of
what is believed."""


@passed_by_reference
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


@passed_by_reference
class FlightState(NamedTuple):
    """What is remembered of it."""

    flight: Array
    """(4,) see `FLYING`."""
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


@passed_by_reference
class PaceState(NamedTuple):
    """What is remembered of how often samples come."""

    clock: Array
    """(5,) see `LAST`."""
    counts: Integers
    """(3,) see `SEEN`."""


class Screened(NamedTuple):
    """Judged samples: k of them, l of which are learnt now, held ones from before among them.

    Fewer than were given where the pace changes with the last of them.
    """

    time: Array
    """(l,) [s]."""
    x: Array
    xdot: Array
    delta: Array
    """(l, n), (l, n), (l, m)."""
    verdict: Integers
    """(k,) `LEARNT`, `HELD`, `GROUNDED` or `REPEATED`."""
    learnt: Integers | None
    """(k,) how many are learnt at each; None: that one."""


def alike(learnt: Integers, verdict: Integers) -> int:
    """Return how many samples from the first on can be answered at once: each learnt alone, or none of flight."""
    if learnt[0] != 1 and verdict[0] != GROUNDED:
        return 1
    other = (learnt != learnt[0]) | (verdict != verdict[0])
    return int(np.argmax(other)) if other.any() else len(learnt)


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
        slopes = [*range(n, 2 * n), *[-1] * (n + m)]
        self._spike_settings = spike_settings(
            [*velocity, *velocity, *[False] * m],
            [*[False] * n, *[True] * n, *[False] * m],
            c.reference_speed,
            GAP / c.sample_rate,
            slopes,
            [*[False] * (2 * n), *[True] * m],
        )
        self._spikes = spike_state(2 * n + m)
        sensed = [s != "Psi" for s in c.states]
        self._repeat_settings = repeat_settings([*sensed, *[False] * (n + m)], c.sample_rate, LONGEST_STEP, slopes)
        self._repeats = repeat_state(self._repeat_settings)
        self._period = 1.0 / c.sample_rate
        self._pace = PaceState(np.zeros(5), np.zeros(3, np.int64))
        self._judge = Bound(judge_samples)
        self.reset()

    def reset(self) -> None:
        """Forget everything, counts too."""
        for array in (*self._flight, *self._spikes, *self._repeats, *self._pace):
            array[:] = 0
        self._flight.flight[FLYING] = -1.0
        self._pace.clock[PERIOD : SAID + 1] = self._period
        self._fit_gap()

    def _fit_gap(self) -> None:
        self._spike_settings = self._spike_settings._replace(gap=max(GAP * self.period, LONGEST))

    @property
    def flying(self) -> bool:
        """Whether the last sample was of flight."""
        return bool(self.idle or self._flight_settings.slowest == 0.0 or self._flight.flight[FLYING] != 0.0)

    @property
    def spikes(self) -> int:
        """Samples dropped as spikes."""
        return int(self._spikes.counts[DROPPED])

    @property
    def grounded(self) -> int:
        """Samples that were not of flight."""
        return int(self._flight.grounded[0])

    @property
    def repeated(self) -> int:
        """Samples that were not learnt from because a number in them had not been measured anew."""
        return int(self._repeats.counts[PASSED])

    @property
    def repeating(self) -> str:
        """Which number that was last; empty: there was none."""
        return self._names[int(self._repeats.counts[CULPRIT]) - 1] if self.repeated else ""

    @property
    def held(self) -> tuple[str, ...]:
        """Which numbers are not measured in every sample."""
        return tuple(name for name, held in zip(self._names, self._repeats.held.tolist(), strict=True) if held)

    @property
    def period(self) -> float:
        """Between samples that are learnt from, as it was said or has been seen [s]."""
        return float(self._pace.clock[PERIOD])

    @property
    def now(self) -> float:
        """When the last sample was measured [s]."""
        return float(self._pace.clock[LAST])

    @property
    def spike(self) -> str:
        """What jumped furthest in the last spike; empty: there was none."""
        return self._names[int(self._spikes.counts[SPIKE])] if self.spikes else ""

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
        samples = np.concatenate([x, xdot, delta], axis=1)
        room = count + len(self._repeats.waits) + ROOM
        verdict, learnt, times, rows = _zeros(count), _zeros(count), np.empty(room), np.empty((room, samples.shape[1]))
        settings = self._flight_settings, self._repeat_settings, self._spike_settings
        memories = self._flight, self._repeats, self._pace, self._spikes
        done = int(self._judge(settings, memories, time, samples, verdict, learnt, times, rows))
        self._fit_gap()
        verdict, learnt = verdict[:done], learnt[:done]
        if (learnt == 1).all() and (verdict == LEARNT).all() and (done == 0 or times[0] == time[0]):
            return Screened(time[:done], x[:done], xdot[:done], delta[:done], verdict, None)
        total = int(learnt.sum())
        rows = rows[:total]
        x, xdot, delta = (np.ascontiguousarray(part) for part in (rows[:, :n], rows[:, n : 2 * n], rows[:, 2 * n :]))
        return Screened(times[:total], x, xdot, delta, verdict, learnt)


def _zeros(count: int) -> Integers:
    return np.zeros(count, np.int64)


@compiled
def judge_samples(
    settings: tuple[FlightSettings, RepeatSettings, SpikeSettings],
    memories: tuple[FlightState, RepeatState, PaceState, SpikeState],
    time: Array,
    samples: Array,
    verdict: Integers,
    learnt: Integers,
    times: Array,
    rows: Array,
) -> int:
    """Judge k samples of c numbers in order, up to one with which the pace changes; return how many.

    Parameters
    ----------
    settings, memories
        Memories are updated.
    time, samples
        (k,) [s] and (k, c): states, derivatives, deflections.
    verdict, learnt
        (k,) out: `LEARNT`, `HELD`, `GROUNDED` or `REPEATED`, and how many are to be learnt then.
    times, rows
        (l,) and (l, c) out: those.
    """
    f, r, s = settings
    flight, repeats, pace, spikes = memories
    total = 0
    for k in range(len(time)):
        learnt[k] = 0
        measured = take_row(r, repeats, time[k], samples[k])
        if f.slowest > 0.0 and not is_flying(f, flight, time[k], samples[k]):
            verdict[k] = GROUNDED
            flight.grounded[0] += 1 + forget_held(spikes)
            repeats.counts[WAITING] = 0
            repeats.counts[COMPLETE] = 0
            pace.clock[LAST] = time[k]
            continue
        changes = False
        for i in range(repeats.counts[COMPLETE]):
            for j in range(judge_spike(s, spikes, repeats.waits_time[i], repeats.waits[i])):
                if spikes.spike[j] != 0:
                    continue
                times[total] = spikes.held_time[j]
                for n in range(samples.shape[1]):
                    rows[total, n] = spikes.held[j, n]
                total += 1
                learnt[k] += 1
            changes = changes_pace(pace, repeats.waits_time[i]) or changes
        verdict[k] = LEARNT if learnt[k] > 0 else HELD if measured else REPEATED
        if changes:
            return k + 1
    return len(time)


@compiled
def changes_pace(x: PaceState, time: float) -> bool:
    """Whether samples come at another pace from this one on, of a time [s]."""
    step = time - x.clock[LAST]
    x.clock[LAST] = time
    x.counts[SEEN] += 1
    if x.counts[SEEN] == 1 or not 0.0 < step <= LONGEST_STEP:
        return False
    if step > SLOW * x.clock[PERIOD] or (step * SLOW < x.clock[PERIOD] and x.clock[PERIOD] > x.clock[SAID]):
        x.counts[SHOWN] = min(x.counts[SHOWN] + 1, 2 * SLOW_ROWS)
        x.counts[OTHER] += 1
        x.clock[SUM] += step
    else:
        x.counts[SHOWN] = max(x.counts[SHOWN] - 1, 0)
        x.clock[FITS] += step
    lasts = x.clock[SUM] >= min(SHARE * x.clock[FITS], LASTS)
    if x.counts[SHOWN] > 0 and not (lasts and x.counts[SHOWN] >= SLOW_ROWS):
        return False
    before = x.clock[PERIOD]
    if x.counts[SHOWN] > 0:
        mean = x.clock[SUM] / x.counts[OTHER]
        x.clock[PERIOD] = mean if mean > SLOW * x.clock[SAID] else x.clock[SAID]
        x.clock[FITS] = 0.0
    x.counts[SHOWN] = 0
    x.counts[OTHER] = 0
    x.clock[SUM] = 0.0
    return bool(x.clock[PERIOD] != before)


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
    if x.flight[FLYING] < 0.0:
        x.flight[FLYING] = 1.0 if speed >= CERTAIN * s.slowest else 0.0
    if not fast:
        x.flight[BELOW] += step
        x.flight[ABOVE] = 0.0
        x.flight[PATH] = 0.0
        if x.flight[BELOW] >= GONE:
            x.flight[FLYING] = 0.0
        return False
    x.flight[BELOW] = 0.0
    if x.flight[FLYING] == 0.0:
        x.flight[ABOVE] += step
        x.flight[PATH] += min(step / CLIMB_MEMORY, 1.0) * (climb_of(s, sample) / speed - x.flight[PATH])
        climbs = x.flight[ABOVE] >= CLIMB_MEMORY and abs(x.flight[PATH]) > CLIMB
        if climbs or x.flight[ABOVE] >= ROLLING:
            x.flight[FLYING] = 1.0
    return bool(x.flight[FLYING] > 0.0)


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
