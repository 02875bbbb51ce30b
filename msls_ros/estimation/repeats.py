"""Numbers that repeat: what is read more often than it is measured, and what a sensor that is stuck goes on saying.

A record in rows holds a number until its sensor has measured again: an airspeed of 10 Hz in rows of 100 Hz rests for
nine rows of ten. Taken for measurements these rows say that the derivatives move without the states, that responses
come before deflections, and that surfaces are lost. A number is held if it changes in every second row at most, time
and again and never by the same step (as a coarse record does that moves slowly).

A **state** that is held has gone from one measurement to the next as its derivative says, by Hermite's cubic; the rows
between wait for that. Nobody knows how a **deflection**, or a derivative, has gone: the rows between its changes are
passed over, and of several such numbers the slowest sets the pace. While it rests the pace goes on.

A state that has changed in every row for seconds and does so no more, though its derivative has moved it by more than
any row did, and most others go on, is not measured any more: what comes is passed over until it changes again. Where no
derivative is known it is enough that it stops. Deflections may stop for good.

References
----------
Klein and Morelli, *Aircraft System Identification*, 2006, ch. 10: data of different rates, time skews.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from msls_ros.estimation.compiled import Bound, compiled, passed_by_reference
from msls_ros.estimation.kernel import Array, Integers

SLOWEST = 0.13
"""Longest time between two measurements of a number that is held [s]: 10 Hz and some jitter. What changes more seldom
is taken for what moves seldom."""
BELIEVED, MOST = 8, 16
"""Changes that show it: first, and as many as count."""
AGAINST = 4
"""What a change in two rows one after the other takes off."""
SAME = 1e-3
"""Steps that differ by less than this share of one are the same, as a coarse record's [1]."""
RUNS = 8
"""Runs of rows between changes of which the longest is the pace."""
ALIVE = 200
"""Rows one after the other in which a number has changed, before repetitions say that its sensor is stuck."""
STUCK = 5
"""So many repetitions: of what is rounded to a tenth of its noise one row in 30 repeats the last."""
NOTHING = 1e-4
"""Share of the largest change: what stops with one of less has come to rest [1]."""
FADES = 1e-4
"""What the largest change loses in a row [1]."""

SEEN, PASSED, CULPRIT, WAITING, COMPLETE = range(5)
"""Of `RepeatState.counts`: rows seen, and passed over; what set the pace last, or was stuck, from 1 on (0: none); rows
that wait, and how many of them are complete."""


@passed_by_reference
class RepeatSettings(NamedTuple):
    """What does not change; c numbers of a row."""

    sensed: Array
    """(c,) 1 where a number cannot rest in flight: states; 0 elsewhere."""
    slope: Integers
    """(c,) which number is the rate of change of each; negative: none is."""
    longest: int
    """Rows between two measurements, at most."""
    gap: float
    """Rows further apart say nothing of each other [s]."""


@passed_by_reference
class RepeatState(NamedTuple):
    """What is remembered of each number."""

    last: Array
    """(c,) in the last row."""
    step: Array
    largest: Array
    """(c,) size of the last change, and of the largest."""
    since: Integers
    """(c,) rows since the last change."""
    shown: Integers
    """(c,) by how many changes it is held; `BELIEVED`: it is."""
    held: Integers
    """(c,) whether it is believed to be; once so, until nothing shows it."""
    runs: Integers
    """(c, `RUNS`) rows between the last changes."""
    alive: Integers
    """(c,) changes in rows one after the other; as they were, while it stands still."""
    moved: Array
    """(c,) by how much its rate of change has moved a number since its last change."""
    fresh: Array
    """(3, c) the last measurement of each number that is held: when [s], it, and its rate of change."""
    waits: Array
    """(k, c) rows that wait for the next."""
    waits_time: Array
    """(k,) [s]."""
    clock: Array
    """(1,) of the last row [s]."""
    counts: Integers
    """(5,) see `SEEN`."""


def repeat_settings(
    sensed: Sequence[bool], sample_rate: float, gap: float, slope: Sequence[int] = ()
) -> RepeatSettings:
    """Return the settings for rows of c numbers.

    Parameters
    ----------
    sensed
        (c,) see `RepeatSettings`.
    sample_rate
        Of the rows [Hz].
    gap
        Longest step of time in rows of one stretch [s].
    slope
        (c,) which number is measured as the rate of change of each, negative for none; empty: of none.
    """
    own = np.array(slope or [-1] * len(sensed), np.int64)
    return RepeatSettings(np.array(sensed, np.float64), own, max(round(SLOWEST * sample_rate), 1), gap)


def repeat_state(settings: RepeatSettings) -> RepeatState:
    """Return the state for rows of so many numbers, nothing seen yet."""
    count, room = len(settings.sensed), 2 * settings.longest + 2
    last, step, largest, moved = np.zeros((4, count))
    since, shown, held, alive = np.zeros((4, count), np.int64)
    return RepeatState(
        last,
        step,
        largest,
        since,
        shown,
        held,
        np.zeros((count, RUNS), np.int64),
        alive,
        moved,
        np.zeros((3, count)),
        np.zeros((room, count)),
        np.zeros(room),
        np.zeros(1),
        np.zeros(5, np.int64),
    )


class RepeatFilter:
    """Says which rows of c numbers, that come one by one, were measured; no number is known by its rate of change.

    Parameters
    ----------
    settings
        See `repeat_settings`.
    """

    def __init__(self, settings: RepeatSettings) -> None:
        """Compile, and start anew; see the class."""
        self._settings = settings
        self._state = repeat_state(settings)
        self._judge = Bound(is_measured)
        self.measured(np.zeros(len(settings.sensed)))
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        for array in self._state:
            array[:] = 0

    def measured(self, row: Array) -> bool:
        """Whether all of a row, (c,), was measured when it was recorded."""
        return bool(self._judge(self._settings, self._state, row))


@compiled
def take_row(s: RepeatSettings, x: RepeatState, time: float, row: Array) -> bool:
    """Take a row, (c,), of a time [s]; the first `COMPLETE` that wait are complete then, and to be dropped.

    Returns
    -------
    bool
        Whether it waits, or is complete; False: it is passed over.
    """
    drop_complete(x)
    step = time - x.clock[0]
    x.clock[0] = time
    for i in range(row.shape[0]):
        if s.slope[i] >= 0:
            x.moved[i] += min(max(step, 0.0), s.gap) * row[s.slope[i]]
    if not 0.0 < step <= s.gap:
        x.counts[PASSED] += x.counts[WAITING]
        x.counts[WAITING] = 0
        for i in range(row.shape[0]):
            if s.slope[i] >= 0:
                fill_between(s, x, i, time, row)
    measured = is_measured(s, x, row)
    if measured and x.counts[WAITING] < x.waits.shape[0]:
        place = x.counts[WAITING]
        x.counts[WAITING] += 1
        x.waits_time[place] = time
        for i in range(row.shape[0]):
            x.waits[place, i] = row[i]
    since = time
    for i in range(row.shape[0]):
        if x.held[i] == 0 or s.slope[i] < 0:
            continue
        pace = pace_of(x, i)
        if x.since[i] == 0 or x.since[i] >= 2 * pace:
            fill_between(s, x, i, time, row)
        since = min(since, x.fresh[0, i])
    complete = 0
    while complete < x.counts[WAITING] and x.waits_time[complete] <= since:
        complete += 1
    x.counts[COMPLETE] = complete if x.counts[WAITING] < x.waits.shape[0] else x.counts[WAITING]
    return measured


@compiled
def drop_complete(x: RepeatState) -> None:
    """Drop the rows that were complete, and have been used."""
    gone = x.counts[COMPLETE]
    x.counts[COMPLETE] = 0
    if gone == 0:
        return
    for k in range(gone, x.counts[WAITING]):
        x.waits_time[k - gone] = x.waits_time[k]
        for i in range(x.waits.shape[1]):
            x.waits[k - gone, i] = x.waits[k, i]
    x.counts[WAITING] -= gone


@compiled
def fill_between(s: RepeatSettings, x: RepeatState, i: int, time: float, row: Array) -> None:
    """Put what state i has been since its last measurement into the rows that wait; this row, (c,), is the next."""
    before = x.fresh[0, i]
    whole = time - before
    for k in range(x.counts[WAITING]):
        gone = x.waits_time[k] - before
        if gone > 0.0 and x.waits_time[k] < time and row[i] != x.fresh[1, i]:
            p = gone / whole
            rest = 1.0 - p
            value = rest * rest * (1.0 + 2.0 * p) * x.fresh[1, i] + p * p * (3.0 - 2.0 * p) * row[i]
            x.waits[k, i] = value + whole * p * rest * (rest * x.fresh[2, i] - p * row[s.slope[i]])
    x.fresh[0, i] = time
    x.fresh[1, i] = row[i]
    x.fresh[2, i] = row[s.slope[i]]


@compiled
def is_measured(s: RepeatSettings, x: RepeatState, row: Array) -> bool:
    """Whether all of a row, (c,), was measured when it was recorded; see the module."""
    x.counts[SEEN] += 1
    stuck = -1
    for i in range(row.shape[0]):
        change = abs(row[i] - x.last[i])
        x.last[i] = row[i]
        x.largest[i] = max((1.0 - FADES) * x.largest[i], change if x.counts[SEEN] > 1 else 0.0)
        x.since[i] += 1
        if change > 0.0:
            observe_change(s, x, i, change)
        elif x.alive[i] < ALIVE or x.step[i] <= NOTHING * x.largest[i]:
            x.alive[i] = 0
        elif s.sensed[i] > 0.0 and x.since[i] >= STUCK and (s.slope[i] < 0 or contradicts(s, x, i)):
            stuck = i
    if stuck >= 0:
        x.counts[PASSED] += 1
        x.counts[CULPRIT] = stuck + 1
        return False
    pacer, pace = find_pacer(s, x)
    if pacer < 0:
        return True
    since = x.since[pacer]
    if since == 0 or (since >= 2 * pace and since % pace == 0):
        return True
    x.counts[PASSED] += 1
    x.counts[CULPRIT] = pacer + 1
    return False


@compiled
def contradicts(s: RepeatSettings, x: RepeatState, i: int) -> bool:
    """Whether state i, that stands still, has not come to rest: its derivative moves it on, and most others move."""
    states = 0
    still = 0
    for j in range(x.alive.shape[0]):
        if s.slope[j] >= 0 and x.alive[j] >= ALIVE:
            states += 1
            still += 1 if x.since[j] > 0 else 0
    return bool(abs(x.moved[i]) > x.largest[i] and 2 * still <= states)


@compiled
def observe_change(s: RepeatSettings, x: RepeatState, i: int, change: float) -> None:
    """Note that number i has changed, and by how much; rows since the last one are 0 from now on."""
    run = x.since[i]
    x.since[i] = 0
    x.moved[i] = 0.0
    if run == 1:
        x.alive[i] += 1
        x.shown[i] = max(x.shown[i] - AGAINST, 0)
        x.held[i] = x.held[i] if x.shown[i] > 0 else 0
    else:
        x.alive[i] = 0
    if 1 < run <= s.longest:
        for k in range(RUNS - 1, 0, -1):
            x.runs[i, k] = x.runs[i, k - 1]
        x.runs[i, 0] = run
        if abs(change - x.step[i]) > SAME * change:
            x.shown[i] = min(x.shown[i] + 1, MOST)
            x.held[i] = 1 if x.shown[i] >= BELIEVED else x.held[i]
    x.step[i] = change


@compiled
def pace_of(x: RepeatState, i: int) -> int:
    """Return how many rows there are between two measurements of number i, at most; 1 where it is not held."""
    longest = 1
    if x.held[i] > 0:
        for k in range(RUNS):
            longest = max(longest, x.runs[i, k])
    return longest


@compiled
def find_pacer(s: RepeatSettings, x: RepeatState) -> tuple[int, int]:
    """Return which number sets the pace, and how many rows that is; -1: none that has no rate of change is held.

    Of the slowest it is the first that moves, or where none does, that which has done so last.
    """
    pace = 1
    for i in range(x.last.shape[0]):
        if s.slope[i] < 0:
            pace = max(pace, pace_of(x, i))
    pacer = -1
    for i in range(x.last.shape[0]):
        if pace > 1 and s.slope[i] < 0 and x.held[i] > 0 and pace_of(x, i) >= pace - 1:
            moves = x.since[i] < 2 * pace
            if pacer < 0 or (x.since[pacer] >= 2 * pace and (moves or x.since[i] < x.since[pacer])):
                pacer = i
    return pacer, pace
