"""Spikes: a number that jumps several times further than it has within a minute, and is back within a few samples.

No aircraft moves like that, but logs and links do: a lost bit, a sensor that reads nothing for a moment, a filter that
starts anew. Least squares would believe it for as long as it remembers, and the more the larger it is; and a deflection
that nothing answers is what the loss of a surface looks like. So samples from such a jump on are held until it is seen
which of the two it is: they are dropped if all that jumped comes back, and used, in order, with the first sample that
settles it otherwise. What a measured rate of change accounts for is no jump. A step is learnt a few samples late; where
only rates of change have jumped, as where something breaks, and stay, or what has jumped goes on, one sample.

References
----------
Menold, Pearson and Allgoewer, "Online outlier detection and removal", Proc. 7th Mediterranean Conference on Control and
Automation, 1999: filters that look at the neighbours of a sample.
"""

from __future__ import annotations

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
REMEMBERED = 60.0
"""Memory of the largest jump [s]."""
GROWTH = 1.5
"""By how much one sample may raise it at most: a spike that was not seen as one does not hide the next."""
ONWARD = 1.5
"""What has gone on by the next sample is so many jumps away at least."""
BACK = 0.25
"""What is back is no further from where it was than this share of the jump."""
LEAST, LEAST_RATE = 0.01, 1.0
"""Least jump that counts, of rad, rad/s and shares of the speed, and of their rates of change, a tenth of it for those
of velocities [1/s]."""
LONGEST, LONGEST_RATE = 0.12, 0.06
"""Longest spike of states and deflections, and of rates of change, which jump where something breaks [s]."""
REST = 50
"""Samples before any jump counts."""
ROOM = 64
"""Samples held at most."""


@passed_by_reference
class SpikeSettings(NamedTuple):
    """What does not change; c numbers of a sample."""

    least: Array
    """(c,) least jump that counts."""
    further: Array
    """(c,) by how much a spike jumps further than what is remembered [1]."""
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
    """(1,) of the last sample [s]."""
    counts: Integers
    """Samples used since the start, held now, dropped; which number jumped furthest in the last spike,
    and in what is held."""
    last: Array
    """(c,) the last sample used."""
    jump: Array
    """(c,) by how much each has jumped; 0: it has not."""
    largest: Array
    """(c,) largest jump remembered."""
    held: Array
    """(`ROOM`, c) samples held."""
    held_time: Array
    """(`ROOM`,) [s]."""


def spike_settings(
    velocity: Sequence[bool], rate: Sequence[bool], speed: float, gap: float, slope: Sequence[int] = ()
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
    """
    fast, derived = np.array(velocity, bool), np.array(rate, bool)
    least = np.where(derived, np.where(fast, 0.1 * speed, 1.0) * LEAST_RATE, np.where(fast, speed, 1.0) * LEAST)
    further = np.where(derived, FURTHER_RATE, FURTHER)
    own = np.array(slope or [-1] * len(fast), np.int64)
    return SpikeSettings(least, further, np.where(derived, LONGEST_RATE, LONGEST), own, max(gap, LONGEST))


def spike_state(count: int) -> SpikeState:
    """Return the state for samples of so many numbers, nothing seen yet."""
    last, jump, largest = np.zeros((3, count))
    return SpikeState(np.zeros(1), np.zeros(5, np.int64), last, jump, largest, np.zeros((ROOM, count)), np.zeros(ROOM))


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
        self._held: list[tuple[int, Array]] = []

    @property
    def furthest(self) -> int:
        """Which number jumped furthest in the last spike."""
        return int(self._state.counts[3])

    def push(self, stamp: int, row: Array) -> list[tuple[int, Array]]:
        """Take a row (c,), stamped [ns]; return stamps and rows to use from now on: those that were held, and it."""
        self.dropped = []
        used = int(self._judge(self._settings, self._state, stamp * 1e-9, row))
        self._held.append((stamp, row))
        if used < 0:
            return []
        held, self._held = self._held, []
        first = len(held) - 1 - used
        self.dropped = [one for one, _ in held[:first]]
        return held[first:]


@compiled
def judge_spike(s: SpikeSettings, x: SpikeState, time: float, sample: Array) -> int:
    """Return how many held samples are used before this one, (c,); negative: this one is held as well."""
    held = x.counts[1]
    step = time - x.clock[0]
    apart = step > s.gap or step <= 0.0  # from the last sample used: what lies between may have been motion
    x.clock[0] = time
    if held > 0 and not apart:
        if is_back(x, sample):
            x.counts[2] += held
            x.counts[3] = x.counts[4]
            held = 0
            apart = True
        elif held < x.held.shape[0] and may_be_back(s, x, time, sample):
            hold(x, time, sample)
            return -1
    if held == 0 and not apart and x.counts[0] >= REST and find_jumps(s, x, sample, step):
        x.counts[1] = 0
        hold(x, time, sample)
        return -1
    for k in range(held):
        remember(s, x, x.held[k], step, False)
    remember(s, x, sample, step, apart)
    x.counts[1] = 0
    return int(held)


@compiled
def may_be_back(s: SpikeSettings, x: SpikeState, time: float, sample: Array) -> bool:
    """Whether what has jumped may come back yet: it is not long ago, and no rate of change that jumped and stays."""
    longest = 0.0
    moving = 0
    for i in range(sample.shape[0]):
        if x.jump[i] != 0.0:
            longest = max(longest, s.longest[i])
            moved = (sample[i] - x.last[i]) / x.jump[i]
            stays = s.longest[i] < LONGEST and abs(moved - 1.0) <= BACK
            moving += 0 if stays or moved >= ONWARD else 1
    return moving > 0 and time - x.held_time[0] < longest


@compiled
def hold(x: SpikeState, time: float, sample: Array) -> None:
    """Keep a sample, (c,), for later."""
    place = x.counts[1]
    for i in range(sample.shape[0]):
        x.held[place, i] = sample[i]
    x.held_time[place] = time
    x.counts[1] = place + 1


@compiled
def find_jumps(s: SpikeSettings, x: SpikeState, sample: Array, step: float) -> bool:
    """Find what jumps further than ever within memory, ``x.jump``; whether anything does."""
    furthest = 0.0
    for i in range(sample.shape[0]):
        jump = jump_of(s, x, sample, i, step)
        limit = max(s.least[i], s.further[i] * x.largest[i])
        x.jump[i] = jump if abs(jump) > limit else 0.0
        if abs(x.jump[i]) > furthest * limit:
            furthest = abs(jump) / limit
            x.counts[4] = i
    return furthest > 0.0


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
def is_back(x: SpikeState, sample: Array) -> bool:
    """Whether all that has jumped is back."""
    away = 0
    for i in range(sample.shape[0]):
        if x.jump[i] != 0.0 and abs(sample[i] - x.last[i]) > BACK * abs(x.jump[i]):
            away += 1
    return away == 0


@compiled
def remember(s: SpikeSettings, x: SpikeState, sample: Array, step: float, apart: bool) -> None:
    """Update the largest jumps with a sample, (c,), that is used; nothing is known of one apart from the last."""
    fade = max(1.0 - max(step, 0.0) / REMEMBERED, 0.0)
    for i in range(sample.shape[0]):
        jump = 0.0 if apart or x.counts[0] == 0 else abs(jump_of(s, x, sample, i, step))
        x.largest[i] = max(fade * x.largest[i], min(jump, GROWTH * max(x.largest[i], s.least[i])))
    for i in range(sample.shape[0]):
        x.last[i] = sample[i]
    x.counts[0] += 1
