"""Pairs states and deflections by stamp, and refuses what cannot be used: one gate for live data, bags and tests.

A state sample and an effector sample of one stamp make one sample. What is refused is counted by reason; nothing is
dropped silently. Stamps are whole nanoseconds.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msls_ros.estimation import LARGEST

Array = NDArray[np.float64]

PENDING = 64
"""Unpaired samples kept per stream before the oldest is given up."""


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


class Refused(ValueError):
    """A message was refused: ``reason`` is the word it is counted under, the text says what was found and expected."""

    def __init__(self, reason: str, text: str) -> None:
        """Take the word and the sentence."""
        super().__init__(text)
        self.reason = reason


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
    """One input stream: its vector, what waits for a partner by stamp, the last stamp."""

    __slots__ = ("last", "pending", "vector")

    def __init__(self, kind: str, names: Sequence[str]) -> None:
        self.vector = NamedVector(kind, names)
        self.clear()

    def clear(self) -> None:
        self.pending: dict[int, tuple[Array, ...]] = {}
        self.last: int | None = None


class Synchronizer:
    """Pair the two input streams; `add_state` and `add_effectors` return a sample when it is complete.

    Parameters
    ----------
    states, effectors
        Names in the order that the identifier wants. Messages may carry them in another order, and more of them.
    time_jump
        A step back in time larger than this [s] starts anew; a smaller one is refused.
    """

    def __init__(self, states: Sequence[str], effectors: Sequence[str], time_jump: float = 1.0) -> None:
        """Start with nothing pending; see the class."""
        self._states, self._effectors = _Stream("state", states), _Stream("effector", effectors)
        self._jump = round(time_jump * 1e9)
        self.refused: Counter[str] = Counter()
        """Messages refused, by reason."""
        self.paired = 0
        """Samples made."""
        self.restarts = 0
        """Jumps back in time."""
        self.clear()

    def clear(self) -> None:
        """Forget what is pending and the last stamps; the counts stay."""
        self._states.clear()
        self._effectors.clear()
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

    def _add(
        self, stream: _Stream, stamp: int, names: Sequence[str], fields: Mapping[str, Sequence[float]]
    ) -> PairedSample | None:
        try:
            arrays = stream.vector.arrange_fields(names, fields)
        except Refused as refused:
            self.refused[refused.reason] += 1
            raise
        if stream.last is not None and stamp <= stream.last:
            self._step_back(stream.vector.kind, stamp, stream.last)
        stream.last = stamp
        stream.pending[stamp] = arrays
        return self._pair(stamp, stream)

    def _step_back(self, kind: str, stamp: int, last: int) -> None:
        """Refuse a stamp that repeats or goes back a little; start anew, in both streams, where it jumps back."""
        if last - stamp <= self._jump:
            word, what = ("stamp_repeated", "repeats") if stamp == last else ("stamp_back", "goes back")
            text = f"{kind} sample: stamp {stamp * 1e-9:.9f} s {what} (last {last * 1e-9:.9f} s); expected a later one"
            raise self.refuse(word, text)
        self.clear()
        self._restarted = True
        self.restarts += 1

    def _pair(self, stamp: int, stream: _Stream) -> PairedSample | None:
        states, effectors = self._states.pending, self._effectors.pending
        if stamp in states and stamp in effectors:
            x, xdot = states.pop(stamp)
            (delta,) = effectors.pop(stamp)
            if states or effectors:
                self._give_up(stamp)
            self.paired += 1
            restarted, self._restarted = self._restarted, False
            return PairedSample(stamp, x, xdot, delta, restarted)
        if len(stream.pending) > PENDING:
            self._give_up(next(iter(stream.pending)) + 1)
        return None

    def _give_up(self, before: int) -> None:
        """Count and drop what is older and can no longer be paired."""
        for stream in (self._states, self._effectors):
            for stamp in [s for s in stream.pending if s < before]:
                del stream.pending[stamp]
                self.refused[f"{stream.vector.kind}_unpaired"] += 1
