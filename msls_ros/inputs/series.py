"""What an inspection looks at: each stream of a map as arrays, read message by message, and what could not be read.

A stream whose messages lack the field, the element or the joint, or cannot be decoded, is not given up silently: the
first sentence of each kind of failure is kept, with how often it came.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msls_ros.estimation import LARGEST
from msls_ros.estimation.errors import EstimationError
from msls_ros.estimation.kernel import Array
from msls_ros.inputs.input_map import InputMap, StreamInput
from msls_ros.inputs.servo_lag import followed
from msls_ros.inputs.timeline import Refused

Stamps = NDArray[np.int64]
UNDECODED = "undecoded"
"""Reason of messages that cannot be decoded."""


@dataclass(frozen=True)
class Series:
    """One stream; k samples of c numbers."""

    stream: StreamInput
    stamps: Stamps
    """True instants, the delay taken off [ns]."""
    values: Array
    """(k, c) scaled, in the frame that they come in."""

    @property
    def time(self) -> Array:
        """(k,) [s]."""
        return np.multiply(self.stamps, 1e-9, dtype=np.float64)


@dataclass(frozen=True)
class TopicTimes:
    """When the messages of one topic came; k of them."""

    stamps: Stamps
    """As the map reads them, delays left in [ns]."""
    logged: Stamps
    """Log times [ns]."""
    repeated: int
    back: int
    """Stamps that repeat or go back."""


@dataclass
class Record:
    """All that was read of a log through a map."""

    inputs: InputMap
    series: dict[str, Series] = field(default_factory=dict)
    """By the name of the stream; those of which something could be read."""
    topics: dict[str, TopicTimes] = field(default_factory=dict)
    """By alias."""
    failures: dict[str, dict[str, tuple[int, str]]] = field(default_factory=dict)
    """By stream or alias: for each reason how often, and the first sentence."""

    def fail(self, where: str, reason: str, sentence: str) -> None:
        """Count a failure."""
        own = self.failures.setdefault(where, {})
        count, first = own.get(reason, (0, sentence))
        own[reason] = count + 1, first


class Collector:
    """Read messages through a map.

    Parameters
    ----------
    inputs
        The map.
    """

    def __init__(self, inputs: InputMap) -> None:
        """Hold nothing yet; see the class."""
        self._inputs = inputs
        self._aliases = {topic.topic: alias for alias, topic in inputs.topics.items()}
        self._streams = {alias: [s for s in inputs.streams.values() if s.source == alias] for alias in inputs.topics}
        self._rows: dict[str, tuple[list[int], list[tuple[float, ...]]]] = {n: ([], []) for n in inputs.streams}
        self._times: dict[str, tuple[list[int], list[int]]] = {alias: ([], []) for alias in inputs.topics}
        self._record = Record(inputs)

    def take(self, topic: str, logged: int, message: Any) -> None:
        """Take a message of a topic, with its log time [ns]."""
        alias = self._aliases.get(topic)
        if alias is None:
            return
        source = self._inputs.topics[alias]
        try:
            stamp = source.instant(logged, message)
        except (EstimationError, Refused) as error:
            self._fail(f"topics.{alias}", error)
            return
        times = self._times[alias]
        times[0].append(stamp)
        times[1].append(logged)
        for stream in self._streams[alias]:
            try:
                values = stream.read(message)
                if not sum(map(abs, values)) < LARGEST:
                    reason, text = (
                        "not_finite",
                        f"it is {', '.join(map(str, values))}; expected numbers of a size that flies",
                    )
                    raise Refused(reason, text)
                if stream.track.quaternion and not 0.25 < sum(v * v for v in values) < 4.0:
                    length = math.sqrt(sum(v * v for v in values))
                    reason, text = "quaternion", f"the quaternion has a length of {length:.3g}; expected 1, a rotation"
                    raise Refused(reason, text)
            except (EstimationError, Refused) as error:
                self._fail(stream.name, error)
                continue
            rows = self._rows[stream.name]
            rows[0].append(stamp - stream.delay)
            rows[1].append(values)

    def undecoded(self, topic: str, why: str) -> None:
        """Take note of a message of a topic that cannot be decoded."""
        alias = self._aliases.get(topic)
        if alias is not None:
            self._record.fail(f"topics.{alias}", UNDECODED, why)

    def record(self) -> Record:
        """Return what was read; of stamps that repeat or go back the first is kept."""
        result = self._record
        for name, (stamps, rows) in self._rows.items():
            if rows:
                times = np.array(stamps, dtype=np.int64)
                good = _rising(times)
                values = np.array(rows, dtype=np.float64)[good]
                if name.removeprefix("states.") in ("Phi", "Theta", "Psi"):
                    values = np.unwrap(values, axis=0)
                stream = self._inputs.streams[name]
                if stream.servo > 0.0:
                    values = followed(times[good], values[:, 0], stream.servo, stream.track.age)[:, None]
                one = Series(stream, times[good], values)
                result.series[name] = _unlagged(one) if one.stream.lag > 0.0 and len(one.stamps) > 1 else one
        for alias, (given, logged) in self._times.items():
            times = np.array(given, dtype=np.int64)
            step = np.diff(times)
            repeated, back = int((step == 0).sum()), int((step < 0).sum())
            result.topics[alias] = TopicTimes(times, np.array(logged, dtype=np.int64), repeated, back)
        return result

    def _fail(self, where: str, error: EstimationError | Refused) -> None:
        self._record.fail(where, error.reason if isinstance(error, Refused) else "field", str(error))


def _unlagged(series: Series) -> Series:
    """Return a stream with its lag taken back, as the adapter does."""
    step = np.diff(series.stamps)
    near = step <= series.stream.track.age
    slope = np.diff(series.values, axis=0) / (step * 1e-9)[:, None]
    values = 0.5 * (series.values[1:] + series.values[:-1]) + series.stream.lag * slope
    return Series(series.stream, (series.stamps[:-1] + step // 2)[near], values[near])


def _rising(stamps: Stamps) -> NDArray[np.bool_]:
    """Return which stamps are later than all before them."""
    if not len(stamps):
        return np.zeros(0, dtype=np.bool_)
    highest = np.maximum.accumulate(stamps)
    return np.concatenate(([True], stamps[1:] > highest[:-1]))


def on_grid(series: Mapping[str, Series], step: float, most: int) -> tuple[Array, dict[str, Array]] | None:
    """Return the streams at common instants, by linear interpolation.

    Parameters
    ----------
    series
        The streams.
    step
        Between instants [s].
    most
        Instants at most; the first of a longer record.

    Returns
    -------
    tuple or None
        Times (k,) [s] from the first instant, and values (k, c) by stream; None where the streams share less than a
        second.
    """
    begin = max(int(s.stamps[0]) for s in series.values())
    end = min(int(s.stamps[-1]) for s in series.values())
    count = min(int((end - begin) * 1e-9 / step), most)
    if count < max(2, round(1.0 / step)):
        return None
    time: Array = step * np.arange(count, dtype=np.float64)
    found: dict[str, Array] = {}
    for name, one in series.items():
        own = (one.stamps - begin) * 1e-9
        found[name] = np.stack([np.interp(time, own, column) for column in one.values.T], axis=1)
    return time, found
