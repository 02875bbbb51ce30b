"""The dither's share of each surface in time, and the limits that it keeps whatever the stamps do.

Between two samples the last command is held, for at most `dither.stale_after`; then whoever applies the dither lets it
go to zero. A first-order actuator of corner w takes the dither's share of the surface along::

    share(t_k) = pole share(t_(k-1)) + (1 - pole) command_(k-1),    pole = exp(-w (t_k - t_(k-1)))

with the stamps as they are: lost samples, jitter and other rates than the configured one change the poles, not the
limits. A rate limit bounds the next step, ``|command - share| <= rate/w`` (the rate of a first-order actuator is
largest at once); without an actuator the command is the surface, and moves by ``rate dt`` at most.

White commands reach the surface with their rms lowered by the actuator. For independent intervals::

    E[share^2] / E[command^2] = E[(1-pole)^2] / (1 - E[pole^2]) * (1 + c E[pole]) / (1 - c E[pole])

with c the autocorrelation of the sequence over one interval; the means are kept as the stamps come.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from msls_ros.estimation.compiled import compiled, passed_by_reference
from msls_ros.estimation.elementary import exponential
from msls_ros.estimation.kernel import Array, Integers

BUCKETS = 128
"""Parts of the sliding window of `WINDOW` in which the acceleration is kept."""
WINDOW = 1.0
"""Over which the rms of the acceleration is held [s]."""
AHEAD = 0.2
"""What is left of the window's square is spent over this time [s]."""
MOST = 0.98
"""Largest rms over the window that is aimed at, over the limit: B-hat errs, intervals vary.

With 1.0 the worst second of 20 flights (tail) is 1.02 and 1.04 of the limit without and at low noise, now 1.00, 1.01.
"""
MORE = 1.2
"""Largest factor by which commands make good what the window lacks [1].

Felt where the limit decides (tail, seeds 100 to 119, medians at no, low, medium noise), share of the limit: without
.88, .87, .79, with 1.2 .90, .89, .82; over the flight .87, .86, .79 with 1.2, .88, .87, .80 with 1.5, whose worst
second at medium noise is 1.06, not 1.03. Only where the dither has been nominal for a second: after a start or an alarm
B-hat errs (cruise 1.18 at worst).
"""
PROMISED = 1.1
"""Largest rms over the window, over the limit, also when no sample comes any more."""
INTERVALS = 20.0
"""Memory of the mean poles [samples]."""
ACHIEVED = 2.0
"""Memory of what the actuators' limits leave of the rms that is wanted [s]."""

WEIGHT, CORNER, SEQUENCE, RATE, LOW, HIGH, CAP = range(7)
"""Columns of `Effectors.limits`: weight; actuator's, sequence's corner and rate [rad/s]; positions and rms [rad]."""


@passed_by_reference
class Effectors(NamedTuple):
    """What the dither does to m effectors, from sample to sample."""

    limits: Array
    """(m, 7) see the columns; a corner of 0: none."""
    sequence: Array
    """(m,) unit-rms sequence."""
    command: Array
    """(m,) last command [rad]."""
    surface: Array
    """(m,) its share of the surface now [rad]."""
    pole: Array
    """(m, 3) of the last interval, mean, mean square [1]."""
    reached: Array
    """(m, 2) mean squares that the surface reached, and that were wanted [rad^2]."""
    together: Array
    """(2,) mean square of the acceleration by all surfaces, and the sum of their own mean squares [m^2/s^4]."""
    squares: Array
    """(m,) mean squares of the surfaces, over the same time [rad^2]."""
    relief: Array
    """(m,) part of its share that an effector needs, 1 at most (`dither.target_error`)."""
    wanted: Array
    """(m,) rms wanted at the surface now [rad]."""
    clock: Array
    """(9,) time of the last sample, end of the boost, boost left [s]; interval [ns]; slot of the window; last share;
    longest interval of late [s]; since when the dither is nominal [s];
    what the window holds over what was entered [1]."""
    onset: Array
    """(5,) see `dither.onset`."""
    seen: Array
    """(m,) squares of the effects at the station that are seen at first [m^2/s^4/rad^2]."""
    moments: Array
    """(m + 1, 5) of deflections and accelerations, see there."""
    window: Array
    """(BUCKETS,) acceleration squared over its limit squared, times time [s]."""


LAST, BOOST_END, BOOST_LEFT, INTERVAL, SLOT, SHARE, LONGEST, SINCE, GROWN = range(9)
FADING = 0.99
"""Per sample, of the longest interval: after a hundred samples it is that of the samples since."""


def make_effectors(limits: Array, boost: float) -> Effectors:
    """Allocate at rest; ``boost`` is what there is of it [s]."""
    m = len(limits)
    relief = np.zeros(m)
    relief.fill(1.0)
    return Effectors(
        limits=limits,
        sequence=np.zeros(m),
        command=np.zeros(m),
        surface=np.zeros(m),
        pole=np.zeros((m, 3)),
        reached=np.zeros((m, 2)),
        together=np.zeros(2),
        squares=np.zeros(m),
        relief=relief,
        wanted=np.zeros(m),
        clock=np.array([-math.inf, -math.inf, boost, -1.0, 0.0, 0.0, 0.0, math.inf, 1.0]),
        onset=np.zeros(5),
        seen=np.zeros(m),
        moments=np.zeros((m + 1, 5)),
        window=np.zeros(BUCKETS),
    )


@compiled
def elapse(x: Effectors, time: float, nominal: float, stale_after: float) -> float:
    """Let the surfaces move while the last command is held; return the interval [s], nominal at the first sample.

    What is left of the interval after `stale_after` is for `settle`.

    Parameters
    ----------
    x
        The effectors.
    time
        Of the sample [s].
    nominal
        Period of the samples where none is known [s].
    stale_after
        How long a command is held [s].
    """
    first = not math.isfinite(x.clock[LAST])
    dt = nominal if first else time - x.clock[LAST]
    x.clock[LAST] = time
    if first:
        x.clock[SINCE] = time
    held = min(dt, stale_after)
    x.clock[LONGEST] = max(held, FADING * x.clock[LONGEST])
    nanoseconds = math.floor(held * 1e9 + 0.5)
    fresh = nanoseconds != x.clock[INTERVAL]
    x.clock[INTERVAL] = nanoseconds
    for j in range(x.surface.shape[0]):
        corner = x.limits[j, CORNER]
        if fresh:
            x.pole[j, 0] = exponential(-corner * held) if corner > 0.0 else 0.0
        pole = x.pole[j, 0]
        gain = 1.0 if first else 1.0 / INTERVALS
        x.pole[j, 1] += gain * (pole - x.pole[j, 1])
        x.pole[j, 2] += gain * (pole * pole - x.pole[j, 2])
        x.surface[j] = pole * x.surface[j] + (1.0 - pole) * x.command[j]
    return dt


@compiled
def settle(x: Effectors, dt: float) -> None:
    """Let the surfaces come to rest: nothing is commanded for ``dt`` s, nor from now on."""
    for j in range(x.surface.shape[0]):
        corner = x.limits[j, CORNER]
        x.surface[j] *= exponential(-corner * dt) if corner > 0.0 and dt > 0.0 else 1.0 if corner > 0.0 else 0.0
        x.command[j] = 0.0
    x.clock[SINCE] = x.clock[LAST]


@compiled
def command_gain(x: Effectors, j: int, period: float) -> float:
    """Rms of white, low-passed commands over the rms that reaches the surface [1]."""
    mean, square = x.pole[j, 1], x.pole[j, 2]
    passed = 1.0 - 2.0 * mean + square
    colour = exponential(-x.limits[j, SEQUENCE] * period) if x.limits[j, SEQUENCE] > 0.0 else 0.0
    if not passed > 0.0:
        return 0.0
    return float(math.sqrt((1.0 - square) * (1.0 - colour * mean) / (passed * (1.0 + colour * mean))))


@compiled
def move(x: Effectors, j: int, wanted: float, delta: float, dt: float) -> float:
    """Return the command nearest to the wanted one that keeps position, rate and size [rad].

    Parameters
    ----------
    x, j
        The effectors, and which.
    wanted
        [rad].
    delta
        Measured deflection, the dither's share in it [rad].
    dt
        Last interval [s].
    """
    base = delta - x.surface[j]
    command = min(max(wanted, min(0.0, x.limits[j, LOW] - base)), max(0.0, x.limits[j, HIGH] - base))
    corner, rate = x.limits[j, CORNER], x.limits[j, RATE]
    reach = rate / corner if corner > 0.0 else rate * dt
    command = min(max(command, x.surface[j] - reach), x.surface[j] + reach)
    x.command[j] = command
    return float(command)


@compiled
def spend(x: Effectors, time: float, dt: float, share: float) -> None:
    """Enter an interval's acceleration into the window.

    Parameters
    ----------
    x
        The effectors.
    time, dt
        Of the sample, and the interval before it [s].
    share
        Acceleration squared over its limit squared.
    """
    slot = math.floor(time * (BUCKETS / WINDOW))
    past = slot - x.clock[SLOT]
    if past < 0 or past > BUCKETS:
        past = BUCKETS
    for i in range(int(past)):
        x.window[int((slot - i) % BUCKETS)] = 0.0
    x.clock[SLOT] = slot
    x.window[int(slot % BUCKETS)] += 0.5 * (share + x.clock[SHARE]) * min(dt, WINDOW)
    x.clock[SHARE] = share


@compiled
def fill(x: Effectors, wanted: float) -> float:
    """Return what factor the next commands may have: 0 to `MORE`, above 1 while the window lacks of what is wanted.

    ``wanted`` is the mean square of the acceleration that is wanted, over its limit squared.
    """
    factor = math.sqrt(min(left_of_window(x, AHEAD, MOST) / AHEAD, 1.0))
    if factor < 1.0 or not wanted > 0.0 or not x.clock[LAST] >= x.clock[SINCE] + WINDOW:
        return factor
    lacks = left_of_window(x, AHEAD, MOST * math.sqrt(min(wanted, 1.0))) / (AHEAD * wanted)
    return min(max(math.sqrt(lacks), 1.0), MORE)


@compiled
def left_of_window(x: Effectors, ahead: float, most: float) -> float:
    """Return what the next ``ahead`` s may add to the window: share of the squared limit times time [s], 0 or more.

    ``most`` is the largest rms over the window, over the limit.
    """
    place, total = int(x.clock[SLOT] % BUCKETS), 0.0
    for _ in range(int(BUCKETS * (1.0 - min(ahead / WINDOW, 1.0)))):
        total += x.window[place]
        place = place - 1 if place > 0 else BUCKETS - 1
    return float(max(most * most * WINDOW - x.clock[GROWN] * total, 0.0))


@compiled
def note_reached(x: Effectors, j: int, decay: float) -> float:
    """Update what the limits leave of effector j's wanted square; return the share that is reached, 0 to 1."""
    x.reached[j, 0] = decay * x.reached[j, 0] + (1.0 - decay) * x.surface[j] * x.surface[j]
    x.reached[j, 1] = decay * x.reached[j, 1] + (1.0 - decay) * x.wanted[j] * x.wanted[j]
    if x.reached[j, 1] <= 0.0:
        return 1.0
    return float(min(x.reached[j, 0] / x.reached[j, 1], MORE * MORE))


@compiled
def note_together(x: Effectors, resultant: float, apart: float, decay: float) -> float:
    """Update what holding back leaves of the squares' sum, which would be felt of independent surfaces; 0 to 1."""
    x.together[0] = decay * x.together[0] + (1.0 - decay) * resultant
    x.together[1] = decay * x.together[1] + (1.0 - decay) * apart
    return float(min(x.together[0] / x.together[1], 1.0)) if x.together[1] > 0.0 else 1.0


@compiled
def boost(x: Effectors, dt: float, alarmed: bool, duration: float, budget: float) -> bool:
    """Whether the dither is boosted now; spends and restores the budget, at most ``budget`` s in any minute.

    Half of the budget may be spent at once, and half is restored over a minute. An alarm starts or prolongs a boost
    only where the budget holds all of it.

    Parameters
    ----------
    x
        The effectors.
    dt
        Last interval [s].
    alarmed
        Whether there is an alarm now.
    duration, budget
        Of a boost, and of all boosts of a minute [s].
    """
    left = min(x.clock[BOOST_LEFT] + min(dt, 60.0) * budget / 120.0, 0.5 * budget)
    if alarmed and left >= min(duration, 0.5 * budget):
        x.clock[BOOST_END] = x.clock[LAST] + duration
    boosted = x.clock[LAST] < x.clock[BOOST_END] and left >= dt
    x.clock[BOOST_LEFT] = left - dt if boosted else left
    if boosted:
        x.clock[SINCE] = x.clock[LAST]
    return bool(boosted)


@compiled
def boost_left(x: Effectors) -> float:
    """Return how long the boost of now will last at least, after `boost`: to its end, or that of its budget [s]."""
    return float(min(x.clock[BOOST_END] - x.clock[LAST], x.clock[BOOST_LEFT]))


def positions(low: tuple[float, ...], high: tuple[float, ...], m: int) -> Array:
    """Return (m, 2) lowest and highest positions [rad]; infinite where none is given."""
    return np.column_stack([low or (-math.inf,) * m, high or (math.inf,) * m])


def rows_of(names: tuple[str, ...]) -> Integers:
    """Return where the rows u, v, w, P, Q, R stand among the names: (6,), -1 where absent."""
    return np.array([names.index(s) if s in names else -1 for s in "uvwPQR"], np.int64)
