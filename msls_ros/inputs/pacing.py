"""At which instants rows are made: those of the clock, or of the slowest deflection where that is slower.

Between two of its samples a stream is a straight line to whoever interpolates it. A state goes nearly so; a deflection,
or a derivative, may have stepped at any time between them, and where it did not, as much is missing in the equations.
So where such a stream has come half as often again too slowly `screening.SLOW_ROWS` times (more than it has not), its
samples are the instants, at which all others are interpolated. One that comes more seldom than `SLOWEST`, or than a
dither can be held, sets no pace: too few rows would be left. While its messages are lost one that sets it goes on to
do so, for `screening.LASTS`: at another pace whoever learns begins anew.

What a message repeats because nobody has measured it since is no sample of its stream: see `repeats`.

Made-up linear aircraft, differentiated, 30 flights (seeds 4440 on): false alarms, names right, B called reliable and
covered, as drawn 0, 7, .42 1.0; of what is interpolated, and at its pace::

    deflections, every second sample      4, 8, .40 .99     0, 8, .46 .99
    every fourth                          22, 6, .39 .95    1, 7, .44 .96
    a velocity, every second              0, 7, .41 .99
    every fourth                          0, 7, .43 .94

As measured, 20 flights (4420 on), deflections every third: 49 and 23 false alarms, of those that record deflections and
not commands 16 and 0; a velocity at 10 Hz: 0 and 12.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from msls_ros.estimation.configuration import Configuration
from msls_ros.estimation.repeats import SLOWEST, RepeatFilter, repeat_settings
from msls_ros.estimation.screening import LASTS, SLOW, SLOW_ROWS
from msls_ros.inputs.input_map import WIND, StreamInput

SHARE = 0.1
"""Of the newest step in the mean one."""
STEPS = ("effectors.", "derivatives.", "angular_acceleration", "specific_force")
"""What streams begin with that may step."""
USUAL = 100.0
"""Rate where none is said [Hz]."""
LONGEST = 1.0
"""Of a single pause so much counts as messages that are lost [s]."""
MOST_HELD = 0.6
"""Share of the time for which a dither is held, that may pass between two instants [1]."""


def slowest_pace(configuration: Configuration) -> float:
    """Return the longest step that an identifier takes of a stream that sets the pace [s]; 0: none.

    The paper's method and RLS learn from every sample, and their memories are counted in samples.
    """
    if configuration.estimator.method != "bank":
        return 0.0
    dither = configuration.dither
    return min(SLOWEST, MOST_HELD * dither.stale_after) if dither.enabled else SLOWEST


class Pacer:
    """Say of the samples of streams, and of ticks of the clock, which are instants.

    Parameters
    ----------
    streams
        All that are read, in order.
    sample_rate
        Of the clock [Hz]; 0: not known.
    slowest
        Longest step of a stream that sets the pace [s]; 0: the clock does always, and what repeats is a sample.
    """

    def __init__(self, streams: Sequence[StreamInput], sample_rate: float, slowest: float) -> None:
        """Compile, and start anew; see the class."""
        self._slowest = slowest
        self._counts = [not one.track.held and one.name.startswith(STEPS) for one in streams]
        rate = sample_rate or USUAL
        rests = [one.name.startswith("effectors.") or one.name in (WIND, "states.Psi") for one in streams]
        self._filters = [
            RepeatFilter(repeat_settings([not rest] * one.size, rate, SLOWEST))
            for one, rest in zip(streams, rests, strict=True)
            if slowest > 0.0
        ]
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        count = len(self._counts)
        for one in self._filters:
            one.clear()
        self._last: list[int | None] = [None] * (count + 1)  # the clock's is the last of each
        self._step = [0.0] * (count + 1)
        self._slow = [0] * count
        self._instant: int | None = None
        self._lost = 0.0
        """Time for which more of the messages of the stream that sets the pace are lost than come [s]."""
        self.pacer = -1
        """Index of the stream that sets the pace; -1: the clock does."""

    @property
    def period(self) -> float:
        """Mean step between instants [s]; 0: not known yet."""
        return self._step[self.pacer]

    def measured(self, index: int, values: Sequence[float]) -> bool:
        """Whether the values of a stream's message were measured anew."""
        return self._slowest == 0.0 or self._filters[index].measured(np.array(values))

    def tick(self, stamp: int) -> bool:
        """Whether a tick of the clock [ns] is an instant."""
        self._observe(-1, stamp)
        return self.pacer < 0 and self._later(stamp)

    def sample(self, index: int, stamp: int) -> bool:
        """Whether a stream's sample, stamped [ns], is an instant."""
        last = self._last[index]
        step = self._observe(index, stamp)
        if index == self.pacer and last is not None:
            self._observe_losses((stamp - last) * 1e-9)
        if not self._counts[index] or self._step[-1] == 0.0 or step == 0.0:
            return False
        slow = SLOW * self._step[-1] < step <= self._slowest
        if index != self.pacer or step <= self._slowest:
            self._slow[index] = min(self._slow[index] + 1, 2 * SLOW_ROWS) if slow else max(self._slow[index] - 1, 0)
        believed = self._slow[index] >= SLOW_ROWS
        if index == self.pacer:
            self.pacer = index if self._slow[index] > 0 else -1
        elif believed and (self.pacer < 0 or self._step[index] > SLOW * self._step[self.pacer]):
            self.pacer = index
            self._lost = 0.0
        return index == self.pacer and self._later(stamp)

    def _observe_losses(self, step: float) -> None:
        """Note a step [s] of the stream that sets the pace: it does no more where too few of its messages come."""
        lost = min(step, LONGEST) if step > self._slowest else -step
        self._lost = max(self._lost + lost, 0.0)
        if self._lost >= LASTS:
            self.pacer = -1
            self._slow = [0] * len(self._slow)

    def _observe(self, index: int, stamp: int) -> float:
        """Note a stamp [ns]; return the step to it [s], 0 where it says nothing."""
        last, self._last[index] = self._last[index], stamp
        step = 0.0 if last is None else (stamp - last) * 1e-9
        if not 0.0 < step <= 2.0 * SLOWEST:
            return 0.0
        share = SHARE if self._step[index] > 0.0 else 1.0
        self._step[index] += share * (step - self._step[index])
        return step

    def _later(self, stamp: int) -> bool:
        """Whether an instant is later than the last, which it is from now on."""
        later = self._instant is None or stamp > self._instant
        self._instant = stamp if later else self._instant
        return later
