"""Whether a stamp goes on, is refused, or begins a new time: for several streams of one clock.

A clock that restarts (a bag played again, a simulator reset) moves all streams; a driver's bad message moves one stream
for one sample, a stamp that was not filled in (0, or of the wall clock) perhaps several at once. So a stamp that is far
from the last of its stream waits until it is confirmed:

* another stream is near it;
* all streams have jumped near it; or
* `SEVERAL` in a row of its own stream agree.

Confirmed, all that waited passes in the order of arrival; contradicted by a stamp that goes on from where the stream
was, it is refused as rogue. `SEVERAL` may agree in error while the other streams go on: a stream that jumps back to
where another one is returns from a time that was wrong.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, NamedTuple, TypeVar

T = TypeVar("T")
SEVERAL = 3
"""Stamps of one stream in a row that confirm a new time alone."""
FORWARD = 1_000_000_000
"""A step forward up to this is a gap, whatever the jump is [ns]."""

TWO_CLOCKS = "two clocks (use_sim_time, header.stamp), or another unit"
"""Why the stamps of two streams are further apart than that, as `check_timing` has it."""


class Refused(ValueError):
    """A message was refused: ``reason`` is the word it is counted under, the text says what was found and expected."""

    def __init__(self, reason: str, text: str) -> None:
        """Take the word and the sentence."""
        super().__init__(text)
        self.reason = reason


class Passed(NamedTuple, Generic[T]):
    """What a stamp lets pass."""

    items: list[tuple[str, int, T]]
    """Stream, stamp [ns] and message, in the order of arrival; empty while a stamp waits to be confirmed."""
    restarted: bool
    """Time has jumped back: start anew before using them."""
    returned: int | None = None
    """The stamp from which the last item returns to where another stream is [ns], a time that ends here; None: no."""


class Timeline(Generic[T]):
    """Follow the stamps of several streams; see the module.

    Parameters
    ----------
    jump
        A step back larger than this waits for confirmation, a smaller one is refused [ns]. A step forward waits where
        it is larger than this and than `FORWARD`.
    refuse
        Told of each message that waited and was contradicted.
    """

    def __init__(self, jump: int, refuse: Callable[[Refused], None]) -> None:
        """Know no stamp yet; see the class."""
        self._jump, self._refuse = jump, refuse
        self._reach = max(jump, FORWARD)
        self.last: dict[str, int] = {}
        """The last stamp that passed, by stream [ns]."""
        self._waiting: list[tuple[str, int, T]] = []

    @property
    def waiting(self) -> bool:
        """Whether a stamp waits to be confirmed."""
        return bool(self._waiting)

    def clear(self) -> None:
        """Forget all stamps and what waits."""
        self.last.clear()
        self._waiting.clear()

    def take(self, stream: str, stamp: int, item: T) -> Passed[T]:
        """Take a message of a stream.

        Parameters
        ----------
        stream
            Its name, as in sentences.
        stamp
            [ns]
        item
            What is to pass.

        Raises
        ------
        Refused
            If the stamp repeats or goes back by no more than the jump.
        """
        last = self.last.get(stream)
        if last is None or last < stamp <= last + self._reach:
            if self._waiting:
                self._contradict(stream)
            self.last[stream] = stamp
            return Passed([(stream, stamp, item)], False)
        if last - self._jump <= stamp <= last:
            word, what = ("stamp_repeated", "repeats") if stamp == last else ("stamp_back", "goes back")
            text = f"{stream}: stamp {stamp * 1e-9:.9f} s {what} (last {last * 1e-9:.9f} s); expected a later one"
            raise Refused(word, text)
        return self._suspect(stream, stamp, last, item)

    def _suspect(self, stream: str, stamp: int, last: int, item: T) -> Passed[T]:
        """Keep what is far from the last stamp until it is confirmed."""
        own = [s for name, s, _ in self._waiting if name == stream]
        if own and (stamp <= own[-1] or (own[-1] < last) != (stamp < last)):
            self._contradict(stream)
            own = []
        reach = self._jump if stamp < last else self._reach
        near = any(abs(s - stamp) <= reach for name, s in self.last.items() if name != stream)
        moved = {name for name, s, _ in self._waiting if name != stream and abs(s - stamp) <= reach}
        self._waiting.append((stream, stamp, item))
        together = bool(moved) and self.last.keys() <= {stream, *moved}
        if not (near or together or len(own) + 1 >= SEVERAL):
            return Passed([], False)
        same = [(w[1] < self.last[w[0]]) == (stamp < last) for w in self._waiting]
        items = [w for w, passes in zip(self._waiting, same, strict=True) if passes]
        self._waiting = [w for w, passes in zip(self._waiting, same, strict=True) if not passes]
        for name in dict.fromkeys(w[0] for w in self._waiting):
            self._contradict(name)
        back = stamp < last
        if back:
            self.last = {name: s for name, s in self.last.items() if near and s <= stamp + reach}
        for name, passed, _ in items:
            self.last[name] = passed
        return Passed(items, back and not near, last if back and near else None)

    def _contradict(self, stream: str) -> None:
        """Refuse what waits of a stream."""
        for name, stamp, _ in self._waiting:
            if name == stream:
                text = (
                    f"{stream}: stamp {stamp * 1e-9:.9f} s alone is far from the others of its "
                    f"stream (last {self.last[stream] * 1e-9:.9f} s); expected one near them"
                )
                self._refuse(Refused("stamp_rogue", text))
        self._waiting = [w for w in self._waiting if w[0] != stream]
