"""Which samples are answered by a dither: fresh ones; old ones are learnt from only, and where none come it is zero.

While rows are held, until it is seen whether a number that has jumped comes back (see `SpikeFilter`), data arrive all
the same: the last dither goes on, stamped as the rows that wait. These are not answered again when they are released.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from msls_ros.estimation import Dither, Identifier, Level
from msls_ros.estimation.spikes import LONGEST
from msls_ros.inputs.dither_echo import DitherEcho
from msls_ros.inputs.freshness import Freshness
from msls_ros.inputs.lateness import DriftWatch, Seldom
from msls_ros.inputs.synchronizer import PairedSample, Synchronizer


class Pause(NamedTuple):
    """Why there is no fresh sample."""

    reason: str
    """As the zero dither says it."""
    message: str
    """The same for /diagnostics and the log, with what follows of it."""
    coming: bool
    """Samples come, but are held or late."""


class Answered:
    """Which stamps have been answered: also those of rows that were held, by the dither of the last sample before."""

    def __init__(self) -> None:
        """Know of none; see the class."""
        self._until = -1

    def clear(self) -> None:
        """Answer samples of any stamp again, as time begins anew."""
        self._until = -1

    def hold(self, stamp: int, held_for: int) -> int:
        """Return the stamp that the last dither goes on to answer [ns].

        Parameters
        ----------
        stamp, held_for
            Of the last sample [ns], and the time from the last row that was used to the newest that is held [ns].
        """
        self._until = stamp + held_for
        return self._until

    def is_open(self, stamp: int) -> bool:
        """Whether a stamp [ns] is not answered yet."""
        return stamp > self._until


class Answers:
    """Answer samples with dither, and watch whether it comes back.

    Parameters
    ----------
    identifier
        `dither.stale_after` of its configuration is the age of an old sample [s]; its last dither is what goes on.
    gate
        Knows the newest stamp of all streams.
    silent
        Says which inputs are silent, from two instants of the steady clock [ns], now and that of the last sample.
    publish
        Takes the stamp that is answered [ns], and the dither.
    warn
        Takes a sentence for the log; of samples that are late at growing intervals, see `Seldom`.
    lockstep
        The plant waits for every answer: no sample is old, and no dither is set to zero.
    """

    def __init__(
        self,
        identifier: Identifier,
        gate: Synchronizer,
        silent: Callable[[int, int], str],
        publish: Callable[[int, Dither], None],
        warn: Callable[[str], None],
        *,
        lockstep: bool,
    ) -> None:
        """Know of no sample yet; see the class."""
        self._identifier, self._gate = identifier, gate
        self._silent, self._publish, self._warn, self._lockstep = silent, publish, warn, lockstep
        self._freshness = Freshness()
        configuration = identifier.configuration
        self.echo = DitherEcho(configuration.effectors, configuration.sample_rate, identifier.straddle)
        """What is known of the dither in the deflections."""
        self.stale = True
        """Whether the dither is zero as no sample was fresh, or somebody has stopped it."""
        self.age = 0.0
        """Of the newest sample, by its stamp [s]."""
        self.old = 0
        """Samples too old for a dither."""
        self._stamp, self._going = 0, identifier.last_dither
        self._fresh: int | None = None
        self._drift, self._seldom = DriftWatch(), {kind: Seldom() for kind in ("old", "late")}
        self._held = self._late = 0
        self._answered = Answered()

    @property
    def backlog(self) -> int:
        """Samples that have come after the one in work."""
        return max(round(self.age * self._identifier.configuration.sample_rate), 0)

    def clear(self) -> None:
        """Answer samples of any stamp again, as time begins anew."""
        self._answered.clear()
        self._drift = DriftWatch()

    def take(self, sample: PairedSample, dither: Dither, steady: int, now: int, newest: bool = True) -> bool:
        """Answer a sample if it is fresh; return whether it is.

        Parameters
        ----------
        sample, dither
            The sample, and what the identifier says to it.
        steady, now
            The steady clock, and the ROS clock [ns].
        newest
            Whether it is the newest of those that come at once, as when a jump is seen to be none: the age of that one
            is told.
        """
        if sample.restarted:
            self.clear()
        self._stamp = sample.stamp
        old = not self._lockstep and self._old(sample.stamp, steady, now, newest)
        if not old:
            self.stale, self._fresh = False, steady
            if self._answered.is_open(sample.stamp):
                self._going = dither
                self._publish(sample.stamp, dither)
        self.echo.take(sample.time, sample.delta, None if old else self._going.delta)
        return not old

    def _old(self, stamp: int, steady: int, now: int, newest: bool) -> bool:
        """Whether a sample is too old to be answered by a dither; it is learnt from all the same."""
        limit = self._identifier.configuration.dither.stale_after
        self.age = self._freshness.age(stamp, self._gate.newest, now) * 1e-9
        rises = self._drift.take(self.age, steady) if newest else False
        if self.age <= limit:
            return False
        if newest:
            self.old += 1
            self._late = steady
            if self._seldom["old"].due(steady) or rises:
                what = f"samples are {self.age:.2f} s old, more than {limit:g} s: learnt from, but no dither for them"
                self._warn(what + self._falling)
        return True

    @property
    def _falling(self) -> str:
        return f"; {self._drift.sentence}" if self._drift.sentence else ""

    def hold(self, held_for: int | None, steady: int) -> bool:
        """Have the last dither go on if more rows are held than before; return whether it does.

        Data that arrive are not stale while they are held: that is no pause, for as long as a spike may last.

        Parameters
        ----------
        held_for
            See `InputAdapter.newly_held`.
        steady
            The steady clock [ns].
        """
        if held_for is None:
            return False
        self._held = steady if held_for else 0
        if not held_for or self.stale or self.pause(steady) is not None:
            return False
        self._going = self._identifier.last_dither
        self._publish(self._answered.hold(self._stamp, held_for), self._going)
        return True

    def pause(self, steady: int) -> Pause | None:
        """Return why no fresh sample has come for longer than `dither.stale_after` until now [ns]; None: one has."""
        limit, since = self._identifier.configuration.dither.stale_after, self._fresh or 0
        age = (steady - since) * 1e-9 if self._fresh is not None else 0.0
        waits = (steady - self._held) * 1e-9 <= limit and age <= limit + LONGEST
        if self._fresh is not None and (age <= limit or waits):
            return None
        more = f"more than {limit:g} s"
        if 2 * (self._held - since) > steady - since:
            reason = f"samples held for {age:.2f} s, {more}, as a number may be a spike"
            return Pause(reason, f"{reason}: the dither pauses", True)
        if 2 * (self._late - since) > steady - since:
            reason = f"samples come {self.age:.2f} s late, {more}"
            return Pause(reason, f"{reason}: learnt from, but the dither is zero{self._falling}", True)
        message = f"no samples for {age:.2f} s ({self._silent(steady, since)}): the dither is zero"
        return Pause(f"no sample for {age:.2f} s, {more}", message, False)

    def overdue(self, steady: int) -> str:
        """Return why the dither is to be zero from now on [ns], and warn; empty: it is to go on, or is zero already."""
        pause = None if self.stale or self._lockstep else self.pause(steady)
        if pause is None:
            return ""
        if not pause.coming or self._seldom["late"].due(steady):
            self._warn(pause.message)
        return pause.reason

    def stop(self, stamp: int, reason: str) -> None:
        """Answer a stamp [ns] with a zero dither, until a fresh sample comes."""
        self.stale = True
        count = len(self._identifier.configuration.effectors)
        self._publish(stamp, Dither(np.zeros(count), 0.0, 0.0, 0.0, Level.INHIBITED, reason))

    def report(self) -> dict[str, object]:
        """Return what it knows of the samples, for /diagnostics."""
        return {
            "age of the newest sample [s]": f"{self.age:.3f}",
            "backlog [samples]": self.backlog,
            "too old for a dither [samples]": self.old,
        }
