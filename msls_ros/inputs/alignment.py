"""Streams of different rates and delays, brought onto the clock of one of them.

Each sample of the clock is an instant t. A stream gives its value there by linear interpolation between the samples on
both sides of t, so an instant waits for the next sample of every such stream; what comes out does not depend on the
order in which the streams arrive. A stream that is held gives the newest sample not after t that has come, for slow
streams whose next sample cannot be waited for. Samples further than a stated age from t are not used: the
instant is refused and counted.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass

from msls_ros.inputs.synchronizer import Refused
from msls_ros.inputs.timeline import FORWARD, TWO_CLOCKS

GONE_ON = FORWARD // 5
"""By how much streams of two clocks go on apart, both of them, until they are called so [ns]."""
KEPT = 4096
"""Samples kept per stream where the clock has stopped."""

Values = tuple[float, ...]


@dataclass(frozen=True)
class Track:
    """How a stream is aligned.

    Attributes
    ----------
    name
        What it is called in sentences.
    held : bool
        Hold instead of interpolate.
    age
        Largest distance in time of a sample that is used [ns].
    quaternion : bool
        The values are a quaternion: q and -q are the same attitude.
    """

    name: str
    held: bool
    age: int
    quaternion: bool = False


class _Buffer:
    """The samples of a stream that are still needed."""

    def __init__(self, track: Track, clock: str) -> None:
        """Start empty; the clock has no name, where it is of the same messages."""
        self.track, self.clock = track, clock
        self.clear()

    def clear(self) -> None:
        self.samples: deque[tuple[int, Values]] = deque(maxlen=KEPT)
        self._ahead = 0
        """By how much the newest was after the clock's newest instant as it came [ns]."""
        self._since: tuple[int, int] | None = None
        """Stamps of stream and clock from which on they have been far apart; None: they are not."""
        self._apart = False

    def compare(self, stamp: int, clock: int) -> None:
        """Note how far a stamp is from the clock's newest [ns].

        Of two clocks both go on far apart; after a stall, what has waited of one comes before that of the other.
        """
        self._ahead = stamp - clock
        if abs(self._ahead) <= FORWARD:
            self._since = None
        elif self._since is None:
            self._since = stamp, clock
        self._apart = self._since is not None and min(stamp - self._since[0], clock - self._since[1]) >= GONE_ON

    def add(self, stamp: int, values: Values) -> None:
        if self.track.quaternion and self.samples:
            last = self.samples[-1][1]
            if sum(a * b for a, b in zip(last, values, strict=True)) < 0.0:
                values = tuple(-v for v in values)
        self.samples.append((stamp, values))

    def at(self, t: int) -> Values | None:
        """Return the value at an instant; None: not yet.

        Raises
        ------
        Refused
            There is none of the age allowed, and none can come.
        """
        samples = self.samples
        while len(samples) > 1 and samples[1][0] <= t:
            samples.popleft()
        if samples and samples[0][0] == t:
            return samples[0][1]
        if self.track.held:
            if not samples or samples[0][0] > t:
                raise self._refused(t, "there is none before")
            if t - samples[0][0] > self.track.age:
                raise self._refused(t, f"the last is {(t - samples[0][0]) * 1e-9:.3f} s old")
            return samples[0][1]
        if not samples or samples[-1][0] < t:
            return None
        if samples[0][0] > t:
            raise self._refused(t, "there is none before")
        (before, a), (after, b) = samples[0], samples[1]
        if max(t - before, after - t) > self.track.age:
            raise self._refused(t, f"there is a gap of {(after - before) * 1e-9:.3f} s")
        share = (t - before) / (after - before)
        return tuple(p + share * (q - p) for p, q in zip(a, b, strict=True))

    def _refused(self, t: int, found: str) -> Refused:
        text = f"{self.track.name}: no sample near enough to {t * 1e-9:.3f} s: {found}"
        return Refused("stale", f"{text}; expected one within {self.track.age * 1e-9:g} s{self.why}")

    @property
    def why(self) -> str:
        """The same as the end of a sentence."""
        return f"; {self.apart}" if self.apart else ""

    @property
    def apart(self) -> str:
        """That stamps are too far from the clock's for a delay or a gap; empty: they are not."""
        if not self._apart or not self.clock:
            return ""
        where = "after" if self._ahead > 0 else "before"
        return f"its stamps are {abs(self._ahead) * 1e-9:.1f} s {where} those of {self.clock}: {TWO_CLOCKS}"


class Aligner:
    """Align streams; see the module.

    Parameters
    ----------
    tracks
        The streams.
    patience
        How far the clock may go on before an instant that waits is refused [ns].
    refuse
        Told about each instant that is refused.
    clock
        What sets the instants, as it is called in sentences.
    own
        Indices of the streams that come in the clock's own messages.
    """

    def __init__(
        self,
        tracks: Sequence[Track],
        patience: int,
        refuse: Callable[[Refused], None],
        clock: str = "the clock",
        own: Container[int] = (),
    ) -> None:
        """Start empty; see the class."""
        self._buffers = [_Buffer(track, "" if i in own else clock) for i, track in enumerate(tracks)]
        self._patience, self._refuse = patience, refuse
        self._instants: deque[int] = deque()
        self._newest = 0

    def clear(self) -> None:
        """Forget all samples and instants."""
        self._instants.clear()
        self._newest = 0
        for buffer in self._buffers:
            buffer.clear()

    @property
    def waiting(self) -> tuple[int, ...]:
        """The instants that are not complete yet [ns]."""
        return tuple(self._instants)

    def apart(self, track: int) -> str:
        """Say that the stamps of the stream with an index are of another clock or unit; empty: they are not."""
        return self._buffers[track].apart

    def add(self, track: int, stamp: int, values: Values) -> None:
        """Take a sample of the stream with an index among the tracks; stamps [ns] of a stream rise."""
        self._buffers[track].add(stamp, values)
        if self._newest:
            self._buffers[track].compare(stamp, self._newest)

    def tick(self, stamp: int) -> None:
        """Take an instant of the clock [ns], later than those before."""
        self._instants.append(stamp)
        self._newest = stamp

    def ready(self) -> list[tuple[int, list[Values]]]:
        """Return the instants that are complete, each with the values of all streams."""
        made: list[tuple[int, list[Values]]] = []
        while self._instants:
            t = self._instants[0]
            try:
                values = self._values(t)
            except Refused as refused:
                self._instants.popleft()
                self._refuse(refused)
                continue
            if values is not None:
                self._instants.popleft()
                made.append((t, values))
            elif self._newest - t > self._patience:
                self._give_up()
            else:
                break
        return made

    def _values(self, t: int) -> list[Values] | None:
        values = []
        for buffer in self._buffers:
            value = buffer.at(t)
            if value is None:
                return None
            values.append(value)
        return values

    def _give_up(self) -> None:
        t = self._instants.popleft()
        late = next(b for b in self._buffers if b.at(t) is None)
        text = f"{late.track.name}: no sample after {t * 1e-9:.3f} s has come; expected one within"
        self._refuse(Refused("stale", f"{text} {self._patience * 1e-9:g} s{late.why}"))
