"""Spikes: a number that jumps several times further than it has within a minute, and is back within a few samples.

No aircraft moves like that, but logs and links do: a lost bit, a sensor that reads nothing for a moment, a filter that
starts anew. Least squares would believe it for as long as it remembers, and the more the larger it is; and a deflection
that nothing answers is what the loss of a surface looks like. So samples from such a jump on are held until it is seen
which of the two it is, by the number that jumped furthest and by all that jumped absurdly far: they are dropped if it
comes back, and else the first is used and the next are held against that. What a measured rate of change accounts for
is no jump. A step is learnt a few samples late; where a rate of change has jumped, as where something breaks, and
stays, or what has jumped goes on, one sample.

Steps are commanded that are as large as any spike, so a deflection's is held against what has jumped and come back.

References
----------
Menold, Pearson and Allgoewer, "Online outlier detection and removal", Proc. 7th Mediterranean Conference on Control and
Automation, 1999: filters that look at the neighbours of a sample.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from msls_ros.estimation.compiled import Bound, compiled, passed_by_reference
from msls_ros.estimation.kernel import Array, Integers

FURTHER, FURTHER_RATE = 3.0, 15.0
"""By how much a spike jumps further than anything that is remembered. Differences of Gaussian noise reach 4 standard
deviations in a minute, and three times that never. Rates of change jump where something breaks, which is not to be
learnt late: by three times after quiet flight, with the F-16's tail hard over; and a moment of twenty times the noise
is ten times the largest difference of that."""
SHARPER, BEYOND = 5.0, 1.5
"""Or by how much further than anything remembered that came back within `LONGEST`; of a state, if it is besides so much
further than any jump.

Whole flights of four small aircraft, forty a seed, in two fifths of which numbers jump every 5 s: by the first rule
alone 37 false alarms and 4 wrong names (seed 12, looked at) and 21 and 2 (seed 13, not looked at), with these 17 and 0,
12 and 0. Flights by commands without spikes, 96 (seeds 7 to 9): 6 and 0, 7 and 0.
"""
REMEMBERED = 60.0
"""Memory of the largest jump [s]."""
GROWTH = 1.5
"""By how much a sample that was not held may raise it at most: a spike not seen as one does not hide the next."""
ONWARD = 1.5
"""What has gone on by the next sample is so many jumps away at least."""
BACK = 0.25
"""What is back is no further from where it was than this share of the jump."""
ALIKE, ABSURD = 0.75, 10.0
"""What jumps by more than so many of its limits decides beside what jumps furthest; and nothing is back while another
number is away by so many, or by this share of the furthest jump, each over its limit."""
LEAST, LEAST_RATE = 0.01, 1.0
"""Least jump that counts, of rad, rad/s and shares of the speed, and of their rates of change, a tenth of it for those
of velocities [1/s]."""
LONGEST, LONGEST_RATE = 0.12, 0.06
"""Longest spike of states and deflections, and of rates of change, which jump where something breaks [s]."""
REST = 50
"""Samples before any jump counts."""
ROOM = 64
"""Samples held at most."""

USED, HELD, SETTLED, DROPPED, SPIKE, AWAY = range(6)
"""Of `SpikeState.counts`: samples used since the start, held, and settled of these; dropped; which number jumped
furthest in the last spike, and in what is not settled."""


@passed_by_reference
class SpikeSettings(NamedTuple):
    """What does not change; c numbers of a sample."""

    least: Array
    """(c,) least jump that counts."""
    further: Array
    """(c,) by how much a spike jumps further than what is remembered [1]."""
    sharper: Array
    """(c,) or by how much further than what has jumped and come back [1],"""
    beyond: Array
    """(c,) and besides than anything [1]."""
    longest: Array
    """(c,) longest spike [s]."""
    slope: Integers
    """(c,) which number is the rate of change of each; negative: none is."""
    gap: float
    """Samples further apart say nothing of each other [s]."""


@passed_by_reference
class SpikeState(NamedTuple):
    """What is remembered."""

    clock: Array
    """(1,) of the last sample used [s]."""
    counts: Integers
    """(6,) see `USED`."""
    last: Array
    """(c,) the last sample used."""
    jump: Array
    """(c,) by how much each has jumped that decides; 0: it does not."""
    furthest: Array
    """(1,) by how much what is held has jumped, over its limit [1]."""
    largest: Array
    """(c,) largest jump remembered."""
    returned: Array
    """(c,) largest one remembered that came back within `LONGEST`."""
    edge: Array
    """(2, c) largest jump up, and down, of late."""
    edge_time: Array
    """(2, c) when [s]."""
    held: Array
    """(`ROOM` + 1, c) samples held; the first of them, that have been settled now, until the next comes."""
    held_time: Array
    """(`ROOM` + 1,) [s]."""
    spike: Integers
    """(`ROOM` + 1,) whether each that has been settled is a spike, to be dropped, and not to be used now."""


def spike_settings(
    velocity: Sequence[bool],
    rate: Sequence[bool],
    speed: float,
    gap: float,
    slope: Sequence[int] = (),
    effector: Sequence[bool] = (),
) -> SpikeSettings:
    """Return the settings for samples of c numbers.

    Parameters
    ----------
    velocity, rate
        (c,) which numbers are velocities or their rates of change, and which are rates of change.
    speed
        Of flight [m/s].
    gap
        Longest step of time in samples of one stretch [s].
    slope
        (c,) which number is measured as the rate of change of each, negative for none; empty: of none.
    effector
        (c,) which are deflections, of which steps are commanded; empty: none.
    """
    fast, derived = np.array(velocity, bool), np.array(rate, bool)
    least = np.where(derived, np.where(fast, 0.1 * speed, 1.0) * LEAST_RATE, np.where(fast, speed, 1.0) * LEAST)
    further = np.where(derived, FURTHER_RATE, FURTHER)
    sharper = np.where(derived, math.inf, SHARPER)
    beyond = np.where(np.array(effector or [False] * len(fast)), 0.0, BEYOND)
    own = np.array(slope or [-1] * len(fast), np.int64)
    longest = np.where(derived, LONGEST_RATE, LONGEST)
    return SpikeSettings(least, further, sharper, beyond, longest, own, max(gap, LONGEST))


def spike_state(count: int) -> SpikeState:
    """Return the state for samples of so many numbers, nothing seen yet."""
    last, jump, largest, returned = np.zeros((4, count))
    edge, edge_time = np.zeros((2, 2, count))
    held, held_time, spike = np.zeros((ROOM + 1, count)), np.zeros(ROOM + 1), np.zeros(ROOM + 1, np.int64)
    remembered = last, jump, np.zeros(1), largest, returned, edge, edge_time
    return SpikeState(np.zeros(1), np.zeros(6, np.int64), *remembered, held, held_time, spike)


class SpikeFilter:
    """The filter, for rows of c numbers that come one by one.

    Parameters
    ----------
    settings
        See `spike_settings`.
    """

    def __init__(self, settings: SpikeSettings) -> None:
        """Compile, and start anew; see the class."""
        self._settings = settings
        self._state = spike_state(len(settings.least))
        self._judge = Bound(judge_spike)
        self.dropped: list[int] = []
        """Stamps of what the last row has shown to be a spike [ns]."""
        self.clear()
        self.push(0, np.zeros(len(settings.least)))
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        for array in self._state:
            array[:] = 0
        self._stamps: list[int] = []

    @property
    def furthest(self) -> int:
        """Which number jumped furthest in the last spike."""
        return int(self._state.counts[SPIKE])

    def push(self, stamp: int, row: Array) -> list[tuple[int, Array]]:
        """Take a row (c,), stamped [ns]; return stamps and rows to use from now on: those that were held, and it."""
        settled = int(self._judge(self._settings, self._state, stamp * 1e-9, row))
        self._stamps.append(stamp)
        stamps, self._stamps = self._stamps[:settled], self._stamps[settled:]
        spikes = self._state.spike[:settled].tolist()
        self.dropped = [one for one, spike in zip(stamps, spikes, strict=True) if spike]
        return [(stamps[k], self._state.held[k].copy()) for k, spike in enumerate(spikes) if not spike]


@compiled
def judge_spike(s: SpikeSettings, x: SpikeState, time: float, sample: Array) -> int:
    """Return how many samples are settled now, the first of ``x.held``: of those held and this one, (c,).

    They are settled in order: what jumped and came back is a spike, what stays is used, and the next is held against
    it.
    """
    forget_settled(x)
    hold(x, time, sample)
    number, first = x.counts[HELD], 0
    while first < number:
        step = x.held_time[first] - x.clock[0]
        apart = step > s.gap or step <= 0.0  # from the last sample used: what lies between may have been motion
        growth = GROWTH
        if not apart and x.counts[USED] >= REST and find_jump(s, x, x.held[first], step):
            end, back = find_end(s, x, first, number)
            if end == number and number < x.held.shape[0]:
                break
            if back:
                drop(x, first, end)
                first = end
                apart = True
            else:
                growth = math.inf
        use(s, x, first, step, apart, growth)
        first += 1
    x.counts[SETTLED] = first
    return int(first)


@compiled
def forget_settled(x: SpikeState) -> None:
    """Drop the samples that were settled, and have been used."""
    gone = x.counts[SETTLED]
    x.counts[SETTLED] = 0
    x.counts[HELD] -= gone
    if gone == 0:
        return
    for k in range(x.counts[HELD]):
        x.held_time[k] = x.held_time[k + gone]
        for i in range(x.held.shape[1]):
            x.held[k, i] = x.held[k + gone, i]


@compiled
def forget_held(x: SpikeState) -> int:
    """Start anew with the next sample, but for what jumps were like; return how many of those held are lost by that."""
    number = x.counts[HELD] - x.counts[SETTLED]
    x.counts[USED] = 0
    x.counts[HELD] = 0
    x.counts[SETTLED] = 0
    return int(number)


@compiled
def hold(x: SpikeState, time: float, sample: Array) -> None:
    """Keep a sample, (c,), for later."""
    place = x.counts[HELD]
    for i in range(sample.shape[0]):
        x.held[place, i] = sample[i]
    x.held_time[place] = time
    x.counts[HELD] = place + 1


@compiled
def find_end(s: SpikeSettings, x: SpikeState, first: int, number: int) -> tuple[int, bool]:
    """Return which held sample settles a jump of the ``first``, and whether it is back; ``number``, of all: none."""
    for k in range(first + 1, number):
        if x.held_time[k] - x.held_time[k - 1] > s.gap or x.held_time[k] <= x.held_time[k - 1]:
            return int(k), False
        if is_back(s, x, x.held[k], x.held_time[k] - x.clock[0], k - first + 1):
            return int(k), True
        if not may_be_back(s, x, x.held_time[k] - x.held_time[first], x.held[k]):
            return int(k), False
    return int(number), False


@compiled
def drop(x: SpikeState, first: int, end: int) -> None:
    """Drop the held samples from ``first`` to before ``end``: a spike."""
    for k in range(first, end):
        x.spike[k] = 1
    x.counts[DROPPED] += end - first
    x.counts[SPIKE] = x.counts[AWAY]


@compiled
def use(s: SpikeSettings, x: SpikeState, k: int, step: float, apart: bool, growth: float) -> None:
    """Have held sample k used."""
    x.spike[k] = 0
    remember(s, x, x.held[k], x.held_time[k], step, apart, growth)
    x.clock[0] = x.held_time[k]


@compiled
def may_be_back(s: SpikeSettings, x: SpikeState, since: float, sample: Array) -> bool:
    """Whether what has jumped, since [s], may come back yet: it is not long, and no rate of change jumped and stays."""
    longest = 0.0
    moving = 0
    for i in range(sample.shape[0]):
        if x.jump[i] != 0.0:
            longest = max(longest, s.longest[i])
            moved = (sample[i] - x.last[i]) / x.jump[i]
            stays = s.longest[i] < LONGEST and abs(moved - 1.0) <= BACK
            moving += 0 if stays or moved >= ONWARD else 1
    return moving > 0 and since < longest


@compiled
def find_jump(s: SpikeSettings, x: SpikeState, sample: Array, step: float) -> bool:
    """Find what jumps furthest beyond memory, and what absurdly far, ``x.jump``; whether anything does."""
    x.furthest[0] = 1.0
    x.counts[AWAY] = -1
    for i in range(sample.shape[0]):
        jump = jump_of(s, x, sample, i, step)
        further = abs(jump) / limit_of(s, x, i)
        x.jump[i] = jump if further > ABSURD else 0.0
        if further > x.furthest[0]:
            x.furthest[0] = further
            x.counts[AWAY] = i
    which = x.counts[AWAY]
    if which < 0:
        return False
    x.jump[which] = jump_of(s, x, sample, which, step)
    return True


@compiled
def limit_of(s: SpikeSettings, x: SpikeState, i: int) -> float:
    """Return what number i jumps further than in a spike."""
    sharp = max(s.sharper[i] * max(x.returned[i], s.least[i]), s.beyond[i] * x.largest[i])
    return float(max(s.least[i], min(s.further[i] * x.largest[i], sharp)))


@compiled
def jump_of(s: SpikeSettings, x: SpikeState, sample: Array, i: int, step: float) -> float:
    """Return by how much number i has changed since the last sample, ``step`` [s] ago, beyond what its rate makes."""
    change = sample[i] - x.last[i]
    rate = s.slope[i]
    if rate < 0:
        return float(change)
    left = change - 0.5 * step * (sample[rate] + x.last[rate])
    return float(left if abs(left) < abs(change) else change)


@compiled
def is_back(s: SpikeSettings, x: SpikeState, sample: Array, step: float, number: int) -> bool:
    """Whether all that has jumped is back in a sample, (c,), and no other number is away.

    It is the ``number``-th after the last used, ``step`` [s] later: others may have moved by so many times as much.
    """
    most = min(ALIKE * x.furthest[0], ABSURD) * number
    for i in range(sample.shape[0]):
        if x.jump[i] != 0.0:
            if abs(sample[i] - x.last[i]) > BACK * abs(x.jump[i]):
                return False
        elif abs(jump_of(s, x, sample, i, step)) > most * limit_of(s, x, i):
            return False
    return True


@compiled
def come_back(x: SpikeState, i: int, change: float, time: float) -> float:
    """Note a jump of number i; return how much of an earlier one, within `LONGEST`, it takes back."""
    own, other = (0, 1) if change > 0.0 else (1, 0)
    jump = abs(change)
    if jump >= x.edge[own, i] or time - x.edge_time[own, i] > LONGEST:
        x.edge[own, i] = jump
        x.edge_time[own, i] = time
    return float(min(jump, x.edge[other, i])) if time - x.edge_time[other, i] <= LONGEST else 0.0


@compiled
def remember(
    s: SpikeSettings, x: SpikeState, sample: Array, time: float, step: float, apart: bool, growth: float
) -> None:
    """Update the largest jumps with a sample, (c,), that is used; nothing is known of one apart from the last."""
    fade = max(1.0 - max(step, 0.0) / REMEMBERED, 0.0)
    for i in range(sample.shape[0]):
        change = 0.0 if apart or x.counts[USED] == 0 else jump_of(s, x, sample, i, step)
        jump = abs(change)
        back = come_back(x, i, change, time)
        x.largest[i] = max(fade * x.largest[i], min(jump, growth * max(x.largest[i], s.least[i])))
        x.returned[i] = max(fade * x.returned[i], min(back, growth * max(x.returned[i], s.least[i])))
    for i in range(sample.shape[0]):
        x.last[i] = sample[i]
    x.counts[USED] += 1
