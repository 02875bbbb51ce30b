"""Pairs states and deflections by stamp, and refuses what cannot be used: one gate for live data, bags and tests.

A state sample and an effector sample of one stamp (or, where asked for, of nearly one) make one sample. What is refused
is counted by reason; nothing is dropped silently. Stamps are whole nanoseconds.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msls_ros.estimation import LARGEST, Configuration
from msls_ros.inputs.timeline import FORWARD, TWO_CLOCKS, Refused, Timeline

__all__ = ["PENDING", "NamedVector", "PairedSample", "Refused", "Synchronizer"]

Array = NDArray[np.float64]
Arrays = tuple[Array, ...]

PENDING = 64
"""Unpaired samples kept per stream before the oldest is given up."""
RECENT = 2 * PENDING
"""Stamps remembered per stream, to say how far the partner was."""


class PairedSample(NamedTuple):
    """States, derivatives and deflections of one instant."""

    stamp: int
    """[ns]"""
    x: Array
    xdot: Array
    delta: Array
    restarted: bool
    """Time jumped back before this sample: start anew."""

    @property
    def time(self) -> float:
        """Time of the sample [s]."""
        return self.stamp * 1e-9


class NamedVector:
    """Puts the values of a message into the order that is wanted, by their names, and refuses what does not fit.

    Parameters
    ----------
    kind
        What it is called in sentences (state, effector, command, dither).
    names
        The names wanted, in order. Messages may carry them in another order, and more of them.
    """

    def __init__(self, kind: str, names: Sequence[str]) -> None:
        """Know no layout yet; see the class."""
        self.kind = kind
        self.names = tuple(names)
        self._orders: dict[tuple[str, ...], NDArray[np.intp]] = {}

    def arrange(self, names: Sequence[str], **fields: Sequence[float]) -> tuple[Array, ...]:
        """Return each field's values in the order wanted.

        Parameters
        ----------
        names
            Names of the message's values.
        **fields
            Field name and values, one per name.

        Raises
        ------
        Refused
            For a name that is missing or repeated, a wrong length, or a number that is not finite or too large.
        """
        return self.arrange_fields(names, fields)

    def arrange_fields(self, names: Sequence[str], fields: Mapping[str, Sequence[float]]) -> tuple[Array, ...]:
        """As `arrange`, with the fields in one mapping."""
        order = self._orders.get(tuple(names))
        if order is None:
            order = self._new_order(tuple(names))
        shape = (len(names),)
        arrays = []
        for field, values in fields.items():
            array = np.asarray(values, dtype=np.float64)
            if array.shape != shape:
                text = f"{self.kind} sample: {field} has {array.size} values; expected one per name, {len(names)}"
                raise Refused("length", text)
            array = array[order]
            if not sum(map(abs, array.tolist())) < LARGEST:
                self._check_numbers(field, array)
            arrays.append(array)
        return tuple(arrays)

    def _check_numbers(self, field: str, array: Array) -> None:
        """Refuse the first number that is not finite, or too large for any aircraft."""
        for name, number in zip(self.names, array.tolist(), strict=True):
            if not math.isfinite(number):
                text = f"{self.kind} sample: {field} of {name} is {number}; expected a finite number"
                raise Refused("not_finite", text)
            if abs(number) >= LARGEST:
                text = f"{self.kind} sample: {field} of {name} is {number:g}; expected less than {LARGEST:g} in size"
                raise Refused("too_large", text)

    def _new_order(self, names: tuple[str, ...]) -> NDArray[np.intp]:
        """Return where our names stand among the message's; remembered per layout."""
        missing = [n for n in self.names if n not in names]
        if missing or len(set(names)) != len(names):
            what = f"no '{missing[0]}' among the names {list(names)}" if missing else f"repeated names in {list(names)}"
            raise Refused("names", f"{self.kind} sample: {what}; expected {list(self.names)}")
        order = np.array([names.index(n) for n in self.names], dtype=np.intp)
        if len(self._orders) < PENDING:
            self._orders[names] = order
        return order


class _Stream:
    """One input stream: its vector, what waits for a partner by stamp, the newest stamps."""

    __slots__ = ("pending", "recent", "vector")

    def __init__(self, kind: str, names: Sequence[str]) -> None:
        self.vector = NamedVector(kind, names)
        self.pending: dict[int, Arrays] = {}
        self.recent: deque[int] = deque(maxlen=RECENT)

    @property
    def name(self) -> str:
        return f"{self.vector.kind} sample"

    def clear(self) -> None:
        self.pending.clear()
        self.recent.clear()

    def nearest(self, stamp: int) -> int | None:
        """Return the nearest stamp among those that wait."""
        return min(self.pending, key=lambda s: abs(s - stamp), default=None)


class Synchronizer:
    """Pair the two input streams; `add_state` and `add_effectors` return a sample when it is complete.

    Parameters
    ----------
    states, effectors
        Names in the order that the identifier wants. Messages may carry them in another order, and more of them.
    time_jump
        A step back in time larger than this [s] starts anew, once it is confirmed (see `timeline`); a smaller one is
        refused.
    tolerance
        Largest difference between the stamps of a pair [s], less than half the period of the samples; 0: equal stamps.
        The sample has the stamp of its state.
    report
        Told of each message that is refused after it was taken: unpaired, or with a rogue stamp.
    """

    def __init__(
        self,
        states: Sequence[str],
        effectors: Sequence[str],
        time_jump: float = 1.0,
        tolerance: float = 0.0,
        report: Callable[[Refused], None] = lambda _: None,
    ) -> None:
        """Start with nothing pending; see the class."""
        self._states, self._effectors = _Stream("state", states), _Stream("effector", effectors)
        self._streams = {s.name: s for s in (self._states, self._effectors)}
        self._timeline: Timeline[Arrays] = Timeline(round(time_jump * 1e9), self._late)
        self._tolerance, self._report = round(tolerance * 1e9), report
        self.refused: Counter[str] = Counter()
        """Messages refused, by reason."""
        self.paired = 0
        """Samples made."""
        self.restarts = 0
        """Jumps back in time."""
        self.clear()

    @classmethod
    def of(cls, configuration: Configuration, report: Callable[[Refused], None] = lambda _: None) -> Synchronizer:
        """Return the gate of an identifier."""
        c = configuration
        return cls(c.states, c.effectors, c.time_jump, c.pairing_tolerance, report)

    @property
    def newest(self) -> int:
        """The newest stamp that passed [ns]; 0 before the first."""
        return max(self._timeline.last.values(), default=0)

    def clear(self) -> None:
        """Forget what is pending and the last stamps; the counts stay."""
        for stream in self._streams.values():
            stream.clear()
        self._timeline.clear()
        self._restarted = False

    def add_state(
        self, stamp: int, names: Sequence[str], x: Sequence[float], xdot: Sequence[float]
    ) -> PairedSample | None:
        """Take a state sample.

        Parameters
        ----------
        stamp
            [ns]
        names, x, xdot
            Of equal length.

        Returns
        -------
        PairedSample or None
            The sample that this message completes.

        Raises
        ------
        Refused
            The message cannot be used; it has been counted.
        """
        if len(xdot) == 0 and len(x) > 0:
            raise self.refuse("xdot_missing", "state sample without xdot: the derivatives are needed")
        return self._add(self._states, stamp, names, {"x": x, "xdot": xdot})

    def add_effectors(self, stamp: int, names: Sequence[str], delta: Sequence[float]) -> PairedSample | None:
        """Take an effector sample; as `add_state`."""
        return self._add(self._effectors, stamp, names, {"delta": delta})

    def refuse(self, reason: str, text: str) -> Refused:
        """Count a refusal and return it, to be raised; also for what is found outside of this class."""
        self.refused[reason] += 1
        return Refused(reason, text)

    def _late(self, refused: Refused) -> None:
        """Count and report the refusal of a message that was taken before."""
        self.refused[refused.reason] += 1
        self._report(refused)

    def _add(
        self, stream: _Stream, stamp: int, names: Sequence[str], fields: Mapping[str, Sequence[float]]
    ) -> PairedSample | None:
        try:
            arrays = stream.vector.arrange_fields(names, fields)
            passed = self._timeline.take(stream.name, stamp, arrays)
        except Refused as refused:
            self.refused[refused.reason] += 1
            raise
        if passed.restarted:
            for each in self._streams.values():
                each.clear()
            self._restarted = True
            self.restarts += 1
        pairs = [self._pair(self._streams[name], at, item) for name, at, item in passed.items]
        return next((p for p in pairs if p is not None), None)

    def _pair(self, stream: _Stream, stamp: int, arrays: Arrays) -> PairedSample | None:
        """Pair a message with what waits in the other stream, or let it wait."""
        other = self._effectors if stream is self._states else self._states
        stream.recent.append(stamp)
        partner: int | None = stamp
        if self._tolerance:
            partner = other.nearest(stamp)
        if partner is None or partner not in other.pending or abs(partner - stamp) > self._tolerance:
            stream.pending[stamp] = arrays
            if len(stream.pending) > PENDING:
                self._give_up(stream, next(iter(stream.pending)) + 1)
            return None
        found = other.pending.pop(partner)
        for each, before in ((stream, stamp), (other, partner)):
            if each.pending:
                self._give_up(each, before)
        (x, xdot), (delta,) = (arrays, found) if stream is self._states else (found, arrays)
        self.paired += 1
        restarted, self._restarted = self._restarted, False
        return PairedSample(stamp if stream is self._states else partner, x, xdot, delta, restarted)

    def _give_up(self, stream: _Stream, before: int) -> None:
        """Count, report and drop what is older and can no longer be paired."""
        other = self._effectors if stream is self._states else self._states
        for stamp in [s for s in stream.pending if s < before]:
            del stream.pending[stamp]
            text = f"{stream.name} at {stamp * 1e-9:.9f} s has no partner: no {other.name} has come"
            if other.recent:
                nearest = min(other.recent, key=lambda s: abs(s - stamp)) - stamp
                text = f"{stream.name} at {stamp * 1e-9:.9f} s has no partner: the nearest {other.name} is stamped "
                text += f"{nearest * 1e-6:+.6f} ms from it; expected within pairing_tolerance, "
                text += f"{self._tolerance * 1e-6:g} ms"
                text += f": {TWO_CLOCKS}" if abs(nearest) > FORWARD else ""
            self._late(Refused(f"{stream.vector.kind}_unpaired", text))
