"""Which topics come too seldom for the rate of the samples, and how many samples were made between their messages.

What lies between two messages is interpolated, without a word where they are near enough (`maximum_age`); and a sample
waits for the next message of each topic, which a dither may be too late for. A state may come at a quarter of the rate
(see `pacing`: nothing is lost by that), a deflection or a derivative, which may step, at two thirds of it: where those
set the pace of the samples, they are not too slow. What is held (``hold=true``), or changes as slowly as a wind, is
meant to come seldom.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from msls_ros.estimation.screening import SLOW, SLOW_ROWS
from msls_ros.inputs.input_map import WIND, StreamInput
from msls_ros.inputs.pacing import SHARE, STEPS

SLOW_STATE = 4.5
"""Samples per message of a state that are too many."""
LEAST = SLOW_ROWS + 1
"""Slow steps, more than quick ones, from which a topic is too slow; by then one that may set the pace does."""


class SlowTopics:
    """Watch the steps of streams, by their stamps.

    Parameters
    ----------
    streams
        All that are read, in order.
    topics
        The topic of each.
    sample_rate
        Configured [Hz]; 0: not known, nothing is too slow.
    slowest
        Longest step of a stream that sets the pace [s]; 0: none does.
    """

    def __init__(
        self, streams: Sequence[StreamInput], topics: Sequence[str], sample_rate: float, slowest: float = 0.0
    ) -> None:
        """Know of no message yet; see the class."""
        self._streams, self._topics, self._rate, self._slowest = streams, topics, sample_rate, slowest
        self.samples: Counter[str] = Counter()
        """Samples that were made while a topic was too slow, by topic."""
        self._said: set[str] = set()
        self.clear()

    def clear(self) -> None:
        """Forget the steps; the counts stay."""
        self._last: list[int | None] = [None] * len(self._streams)
        self._step = [0.0] * len(self._streams)
        self._slow = [0] * len(self._streams)
        self._pacer = -1

    def sample(self, index: int, stamp: int) -> None:
        """Take the stamp of a stream's sample [ns]."""
        stream, last = self._streams[index], self._last[index]
        self._last[index] = stamp
        if last is None or self._rate == 0.0 or stream.track.held or stream.name in (WIND, "states.Psi"):
            return
        step = (stamp - last) * 1e-9
        slow = step * self._rate > (SLOW if stream.name.startswith(STEPS) else SLOW_STATE)
        self._slow[index] = min(self._slow[index] + 1, 2 * LEAST) if slow else max(self._slow[index] - 1, 0)
        if slow:
            share = SHARE if self._step[index] > 0.0 else 1.0
            self._step[index] += share * (step - self._step[index])

    def made(self, count: int, pacer: int) -> None:
        """Count samples; the stream that sets their pace, and those of its topic, are not too slow."""
        for topic in self.found(pacer):
            self.samples[topic] += count

    def found(self, pacer: int) -> dict[str, str]:
        """Return a sentence for each topic that is too slow; ``pacer``: the stream that sets the pace, -1: none.

        That which has set the pace is not named while the clock does in between, as where samples are lost.
        """
        if pacer >= 0:
            self._pacer = pacer
        paced = pacer >= 0 or (self._pacer >= 0 and self._step[self._pacer] <= self._slowest)
        pace = self._topics[self._pacer] if paced else ""
        found: dict[str, str] = {}
        for index, stream in enumerate(self._streams):
            topic, slow = self._topics[index], self._slow[index] >= LEAST
            if slow and topic != pace and topic not in found:
                age, step = stream.track.age * 1e-9, self._step[index]
                refused = f" or, further than {age:g} s from a message, refused" if step > age else ""
                found[topic] = (
                    f"{topic} comes at {1.0 / step:.3g} Hz, too slow for sample_rate, {self._rate:g} Hz: samples wait "
                    f"for its next message, and between two it is interpolated{refused}; map a topic that is quicker, "
                    "or take it as the clock, with its rate as sample_rate"
                )
        return found

    def news(self, pacer: int) -> list[str]:
        """Return the sentences of topics that have become too slow since the last call."""
        found = self.found(pacer)
        new = [text for topic, text in found.items() if topic not in self._said]
        self._said = set(found)
        return new
