"""The section ``inputs`` of a parameter file: which fields of which messages are states, derivatives and deflections.

Every entry is a ROS parameter of one line, words separated by spaces::

    topics.ALIAS:     TOPIC TYPE [stamp=PATH|arrival] [unit=s|ms|us|ns] [delay=SECONDS] [servo=SECONDS]
    everything else:  ALIAS PATH [scale=1] [zero=0] [offset=0] [frame=...] [hold=true] [age=SECONDS] [delay=SECONDS]
                      [lag=SECONDS] [servo=SECONDS]

A value is ``scale * (raw - zero) + offset``; a negative scale turns the sign. Of a vector each of the three may be one
number, or one for each axis: ``zero=0.01,-0.02,0.0``. An effector that several channels of a message make has a path to
each and is the sum of their values: ``servos control[0],control[1] scale=0.5,-0.5``. The true instant of a message is
its stamp less its delay. What follows with a first-order lag T, as the pressure of a static port does, is taken back:
``m + T dm/dt`` of the measured m, midway between each two samples. An effector that is a command becomes the deflection
of a servo whose time constant is known (see `servo_lag`). See `field_paths` for PATH, and the shipped profiles for
examples.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

from msls_ros.estimation.configuration import flatten
from msls_ros.estimation.errors import EstimationError, nearest
from msls_ros.inputs.alignment import Track, Values
from msls_ros.inputs.field_paths import FieldPath, VectorPath, listed
from msls_ros.inputs.frames import BODY, EARTH
from msls_ros.inputs.synchronizer import Refused

VECTORS: Mapping[str, tuple[str, ...]] = {
    "velocity": ("u", "v", "w"),
    "attitude": ("Phi", "Theta", "Psi"),
    "angular_velocity": ("P", "Q", "R"),
    "specific_force": ("fx", "fy", "fz"),
    "angular_acceleration": ("dP", "dQ", "dR"),
}
"""Vectors that can be mapped, and what they give."""
AIR_DATA = ("airspeed", "alpha", "beta")
"""True airspeed [m/s], angle of attack and of sideslip [rad] at the vane: together they give u, v, w. An airspeed
beside a velocity is only compared with it."""
WIND = "wind"
"""Of the air over ground, in an earth frame: taken off a velocity over ground [m/s]."""
SCALARS = ("states", "derivatives", "effectors")
_EFFECTORS = "effectors."
_SLOWEST_SERVO = 1.0
"""Time constant of any servo, at most [s]."""
UNITS = {"s": 1_000_000_000, "ms": 1_000_000, "us": 1_000, "ns": 1}


@dataclass(frozen=True)
class TopicInput:
    """A topic that is listened to."""

    topic: str
    msgtype: str
    stamp: FieldPath | None
    """Path to the stamp; None: the time of arrival."""
    unit: int
    """Of a stamp that is a number [ns]."""
    delay: int
    """What is recorded was true so long before its stamp [ns]."""
    servo: float = 0.0
    """Time constant of the servos that follow its effectors, which are commands [s]; 0: they are deflections."""

    def instant(self, arrival: int, message: Any) -> int:
        """Return the stamp of a message [ns]; the delay is not yet taken off.

        Raises
        ------
        EstimationError, Refused
            If there is no stamp where it should be; if it is no number.
        """
        if self.stamp is None:
            return arrival
        found = self.stamp.read(message)
        if hasattr(found, "nanosec"):
            return int(found.sec) * 1_000_000_000 + int(found.nanosec)
        try:
            return operator.index(found) * self.unit
        except TypeError:
            pass
        try:
            return round(float(found) * self.unit)
        except (TypeError, ValueError, OverflowError):
            what = repr(found) if isinstance(found, (int, float)) else type(found).__name__
            text = f"the path '{self.stamp.text}' leads to {what} in {self.msgtype}; expected a stamp"
            raise (Refused("not_finite", text) if isinstance(found, float) else EstimationError(text)) from None


@dataclass(frozen=True)
class StreamInput:
    """A number or vector that is read from the messages of one topic."""

    name: str
    """A key of `VECTORS`, one of `AIR_DATA`, `WIND`, or ``states.NAME``, ``derivatives.NAME``, ``effectors.NAME``."""
    source: str
    """Alias of the topic."""
    path: VectorPath
    scale: tuple[float, ...]
    zero: tuple[float, ...]
    offset: tuple[float, ...]
    """One for each number."""
    body: str
    earth: str
    """Frames; of a velocity only one is given, the other is empty."""
    delay: int
    """[ns]"""
    track: Track
    lag: float = 0.0
    """Time constant with which what is measured follows [s]."""
    servo: float = 0.0
    """Time constant of the servo that follows a command [s]; 0: it is no command, or its servo is not known."""

    @cached_property
    def summed(self) -> bool:
        """Whether it is an effector of several channels: the sum of their values."""
        return self.path.size > 1 and self.name.startswith(_EFFECTORS)

    @cached_property
    def size(self) -> int:
        """How many numbers `read` returns."""
        return 1 if self.summed else self.path.size

    @cached_property
    def _plain(self) -> bool:
        """Whether the numbers are taken as they are."""
        return not self.summed and not any((*self.zero, *self.offset)) and set(self.scale) == {1.0}

    def read(self, message: Any) -> Values:
        """Return the values of a message, scaled, in the frame that they come in.

        Raises
        ------
        EstimationError, Refused
            As `VectorPath.read`.
        """
        found = self.path.read(message)
        if self._plain:
            return tuple([value + 0.0 for value in found])  # the same bits as below, in less time
        values = tuple(
            scale * (raw - zero) + offset
            for raw, scale, zero, offset in zip(found, self.scale, self.zero, self.offset, strict=True)
        )
        return (sum(values),) if self.summed else values


def unlagged(lag: float, earlier: Values, later: Values, seconds: float) -> Values:
    """Return what was true midway between two samples that follow with a lag [s] and are so many seconds apart."""
    share = lag / seconds
    return tuple(0.5 * (a + b) + share * (b - a) for a, b in zip(earlier, later, strict=True))


@dataclass(frozen=True)
class InputMap:
    """What is read where, and how it is brought together."""

    topics: Mapping[str, TopicInput]
    """By alias."""
    streams: Mapping[str, StreamInput]
    """By name."""
    clock: str
    """Alias of the topic whose stamps are the instants of the samples."""
    maximum_age: int
    """[ns]"""
    intervals: int
    """Of the window of derivatives that are not measured; 0: `derivatives.usual_intervals`."""
    imu_position: tuple[float, float, float]
    """Of the accelerometer, from the centre of mass, FRD [m]."""
    vane_position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Where airspeed, alpha and beta are measured, from the centre of mass, FRD [m]."""

    @property
    def compared(self) -> tuple[str, ...]:
        """Streams that no sample needs: `inspect` compares them with others."""
        return () if "alpha" in self.streams else ("airspeed",)

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any]) -> InputMap:
        """Build it from the section's entries, nested or with dotted names.

        Raises
        ------
        EstimationError
            For an entry that is unknown, malformed or missing; the sentence names it.
        """
        flat = flatten(values)
        _check_known(flat)
        plain = {name: flat.pop(name, default) for name, default in PLAIN.items()}
        age = round(1e9 * _number("maximum_age", plain["maximum_age"], 1e-6, 10.0))
        intervals = plain["intervals"]
        if type(intervals) is not int or not 0 <= intervals <= 1000:
            message = f"inputs.intervals is {intervals!r}; it must be a whole number from 1 to 1000, or 0"
            raise EstimationError(message)
        topics = {n[7:]: _parse(f"inputs.{n}", v, _topic) for n, v in flat.items() if n.startswith("topics.")}
        streams = {}
        for name, value in flat.items():
            if not name.startswith("topics."):
                streams[name] = _parse(f"inputs.{name}", value, partial(_stream, name, topics, age))
        if plain["clock"] not in topics:
            message = f"inputs.clock is '{plain['clock']}'; it must be one of the topics, {listed(topics)}"
            message += nearest(str(plain["clock"]), topics)
            raise EstimationError(message)
        _check_servos(topics, streams.values())
        names = [t.topic for t in topics.values()]
        if len(set(names)) != len(names):
            message = f"inputs.topics: {listed(names)}: each topic can have one alias only"
            raise EstimationError(message)
        places = (_position(name, plain[name]) for name in ("imu_position", "vane_position"))
        return cls(topics, streams, plain["clock"], age, intervals, *places)


PLAIN: Mapping[str, Any] = {
    "clock": "",
    "maximum_age": 0.1,
    "intervals": 0,
    "imu_position": (0.0, 0.0, 0.0),
    "vane_position": (0.0, 0.0, 0.0),
}
"""Entries that are no lines of words, with their defaults."""


def _check_known(names: Iterable[str]) -> None:
    """Refuse the first entry that does not exist, before the values of others are looked at."""
    single, groups = (*PLAIN, *VECTORS, *AIR_DATA, WIND), ("topics", *SCALARS)
    for name in names:
        group, _, rest = name.partition(".")
        if name not in single and not (group in groups and rest):
            known = (*PLAIN, "topics.ALIAS", *VECTORS, *AIR_DATA, WIND, *(f"{s}.NAME" for s in SCALARS))
            near = nearest(name, (*single, *(f"{each}.{rest}" if rest else each for each in groups)))
            message = f"parameter 'inputs.{name}' does not exist; there are {', '.join(known)}{near}"
            raise EstimationError(message)


def _check_servos(topics: Mapping[str, TopicInput], streams: Iterable[StreamInput]) -> None:
    """Refuse the servo of a topic that gives no effector."""
    commanded = {s.source for s in streams if s.name.startswith(_EFFECTORS)}
    for alias, topic in topics.items():
        if topic.servo > 0.0 and alias not in commanded:
            message = f"parameter 'inputs.topics.{alias}': servo={topic.servo:g}, but it gives no effector; a servo "
            message += "follows the commands of effectors only"
            raise EstimationError(message)


def _parse(name: str, value: Any, make: Callable[[_Words], Any]) -> Any:
    """Make what a line of words says; put the entry's name before any complaint."""
    try:
        if not isinstance(value, str):
            message = f"it is {value!r}; it must be a line of words in quotes"
            raise EstimationError(message)
        words = _Words(value)
        made = make(words)
        words.check_empty()
    except EstimationError as error:
        message = f"parameter '{name}': {error}"
        raise EstimationError(message) from None
    return made


class _Words:
    """A line taken apart: the words first, then key=value in any order."""

    def __init__(self, line: str) -> None:
        split = line.split()
        self.first = [word for word in split[:2]]
        if len(self.first) < 2:
            message = f"it is '{line}'; it must begin with two words"
            raise EstimationError(message)
        self._options: dict[str, str] = {}
        for word in split[2:]:
            key, equals, value = word.partition("=")
            if not equals or not value or key in self._options:
                message = f"'{word}' is not KEY=VALUE, or is given twice"
                raise EstimationError(message)
            self._options[key] = value
        self._known: list[str] = []

    def take(self, key: str, default: str) -> str:
        self._known.append(key)
        return self._options.pop(key, default)

    def number(self, key: str, default: float, low: float = -math.inf, high: float = math.inf) -> float:
        return _number(key, self.take(key, repr(default)), low, high)

    def numbers(self, key: str, default: float, size: int) -> tuple[float, ...]:
        """Take one number for all, or one for each of ``size``, separated by commas."""
        found = self.take(key, repr(default)).split(",")
        if len(found) not in (1, size):
            message = f"{key} has {len(found)} numbers; expected 1" + (f" or {size}" if size > 1 else "")
            raise EstimationError(message)
        values = tuple(_number(key, word, -math.inf, math.inf) for word in found)
        return values if len(values) == size else values * size

    def choice(self, key: str, default: str, choices: Sequence[str]) -> str:
        found = self.take(key, default)
        if found not in choices:
            message = f"{key} is '{found}'; it must be one of {', '.join(choices)}{nearest(found, choices)}"
            raise EstimationError(message)
        return found

    def refuse(self, key: str, why: str) -> None:
        """Refuse an option that other lines have."""
        if key in self._options:
            message = f"{key}={self._options[key]}: {why}"
            raise EstimationError(message)

    def check_empty(self) -> None:
        if self._options:
            wrong = min(self._options)
            message = f"'{wrong}' does not exist here; there are {', '.join(self._known)}{nearest(wrong, self._known)}"
            raise EstimationError(message)


def _number(name: str, value: Any, low: float, high: float) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if isinstance(value, bool) or not (math.isfinite(number) and low <= number <= high):
        limits = f" from {low:g} to {high:g}" if math.isfinite(high) else ""
        message = f"{name} is {value!r}; it must be a number{limits}"
        raise EstimationError(message)
    return number


def _position(name: str, value: Any) -> tuple[float, float, float]:
    if isinstance(value, str) or not hasattr(value, "__len__") or len(value) != 3:
        message = f"inputs.{name} is {value!r}; it must be 3 numbers: forward, right, down"
        raise EstimationError(message)
    x, y, z = (_number(f"inputs.{name}", v, -1e3, 1e3) for v in value)
    return x, y, z


def _topic(words: _Words) -> TopicInput:
    topic, msgtype = words.first
    parts = msgtype.split("/")
    if len(parts) not in (2, 3) or not all(parts):
        message = f"'{msgtype}' is not a type; expected PACKAGE/msg/NAME"
        raise EstimationError(message)
    stamp = words.take("stamp", "header.stamp")
    return TopicInput(
        topic,
        f"{parts[0]}/msg/{parts[-1]}",
        None if stamp == "arrival" else FieldPath(stamp),
        UNITS[words.choice("unit", "s", tuple(UNITS))],
        round(1e9 * words.number("delay", 0.0, -10.0, 10.0)),
        words.number("servo", 0.0, 0.0, _SLOWEST_SERVO),
    )


def _stream(name: str, topics: Mapping[str, TopicInput], age: int, words: _Words) -> StreamInput:
    source, path = words.first
    if source not in topics:
        message = f"'{source}' is not a topic; inputs.topics has {listed(topics)}{nearest(source, topics)}"
        raise EstimationError(message)
    size = _size(name, path)
    body, earth = _frames(name, words)
    own_age = round(1e9 * words.number("age", age * 1e-9, 1e-6, 3600.0))
    held = words.choice("hold", "false", ("true", "false")) == "true"
    return StreamInput(
        name,
        source,
        VectorPath(path, size),
        words.numbers("scale", 1.0, size),
        words.numbers("zero", 0.0, size),
        words.numbers("offset", 0.0, size),
        body,
        earth,
        round(1e9 * words.number("delay", topics[source].delay * 1e-9, -10.0, 10.0)),
        Track(f"{name} ({topics[source].topic} {path})", held, own_age, size == 4),
        lag := words.number("lag", 0.0, 0.0, 10.0) if name != "attitude" else 0.0,
        _servo(name, topics[source].servo, words, held=held, lag=lag),
    )


def _servo(name: str, of_topic: float, words: _Words, *, held: bool, lag: float) -> float:
    """Return the time constant of the servo that follows an effector [s]."""
    if not name.startswith(_EFFECTORS):
        words.refuse("servo", "a servo follows the command of an effector; of what is measured give lag")
        return 0.0
    servo = words.number("servo", of_topic, 0.0, _SLOWEST_SERVO)
    if servo > 0.0 and (held or lag > 0.0):
        other = "hold=true" if held else f"lag={lag:g}"
        message = f"servo={servo:g} and {other}: give one of the two; servo=0 is none, where the topic has one"
        raise EstimationError(message)
    return servo


def _size(name: str, path: str) -> int:
    """Return how many numbers an entry reads; a wind may have north and east alone, an effector several channels."""
    if name == "attitude":
        return 4
    if name == WIND:
        return 2 if path.count(",") == 1 else 3
    if name.startswith(_EFFECTORS):
        return path.count(",") + 1
    return 3 if name in VECTORS else 1


def _frames(name: str, words: _Words) -> tuple[str, str]:
    """Return body and earth frame of a vector."""
    if name == "attitude":
        both = {f"{b}/{e}": (b, e) for b in BODY for e in EARTH}
        return both[words.choice("frame", "frd/ned", tuple(both))]
    if name == "velocity":
        frame = words.choice("frame", "frd", (*BODY, *EARTH))
        return ("", frame) if frame in EARTH else (frame, "")
    if name == WIND:
        return "", words.choice("frame", "ned", tuple(EARTH))
    if name in VECTORS:
        return words.choice("frame", "frd", tuple(BODY)), ""
    return "", ""
