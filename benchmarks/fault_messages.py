"""Messages that are damaged or meant to do harm, among good ones: through the gate and the maps of other stacks.

Good samples of a made-up aircraft come in order; before each, damaged ones. What may come of these is a refusal that is
counted. At the end the estimates are compared, bit for bit, with those of a run that saw the good ones only. A message
that is damaged so that nobody can tell is no test: none of them is both whole and new.
"""

from __future__ import annotations

import hashlib
import importlib
import math
import random
import struct
import sys
from collections.abc import Callable, Iterator
from copy import deepcopy
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from rclpy.serialization import deserialize_message, serialize_message

from msls_ros import messages
from msls_ros.estimation import Configuration, Identifier
from msls_ros.estimation.errors import EstimationError
from msls_ros.inputs import InputAdapter, PairedSample, Refused, Synchronizer
from msls_ros.inputs.profiles import read_inputs, read_profile
from msls_ros.nodes.inputs import EFFECTORS, STATE, OwnInputs

MAPS = {"odometry_jointstate": "standard", "mavros_fixed_wing": "mavros", "px4_odometry": "px4"}
STEP = 20_000_000
START = 1_000_000_000_000
PER_GOOD = 12
"""Damaged messages before each good one."""
AWAY = (0, -(10**9), 1, START - 60 * 10**9, START + 86400 * 10**9, 2**31 * 10**9 - 1)
"""Stamps that are far from the flight's [ns]."""
Sample = tuple[int, tuple[str, ...], dict[str, Any]]


class Count(dict[str, Any]):
    """Row of the table: tried, refused, without a word, crashed, not finite, and whether the bits are the same."""

    def __init__(self, kind: str) -> None:
        super().__init__(kind=kind, tried=0, refused=0, unlogged=0, crashed=0, not_finite=0, same_bits=True)
        self["examples"] = []

    def crash(self, how: str, error: Exception) -> None:
        """Count a crash."""
        self["crashed"] += 1
        if len(self["examples"]) < 5:
            self["examples"].append(f"{how}: {type(error).__name__}: {error}")


class Learner:
    """An identifier, and a hash of all that it says."""

    def __init__(self, configuration: Configuration) -> None:
        self._identifier = Identifier(configuration, gated=True)
        self._digest = hashlib.sha256()
        self.samples = 0
        self.finite = True

    def use(self, sample: PairedSample | None) -> None:
        """Learn from a sample, if there is one."""
        if sample is None:
            return
        if sample.restarted:
            self._identifier.reset()
        found = self._identifier.update(sample.time, sample.x, sample.xdot, sample.delta)
        for array in (found.a, found.b, found.bias, found.dither.delta):
            self._digest.update(np.ascontiguousarray(array + 0.0).tobytes())
            self.finite = self.finite and bool(np.isfinite(array).all())
        self.samples += 1

    @property
    def digest(self) -> str:
        """Of all samples so far."""
        return f"{self.samples} {self._digest.hexdigest()}"


def measure(count: int, say: Callable[[str], None], seed: int = 0) -> list[dict[str, Any]]:
    """Send so many damaged messages through the gate, and as many through the maps; give a row for each way."""
    say(f"{count} damaged messages through gate and identifier")
    rows = [gate_storm(count, seed)]
    for name in MAPS:
        say(f"{-(-count // len(MAPS))} damaged messages through the inputs of {name}")
        rows.append(map_storm(name, -(-count // len(MAPS)), seed))
    return [dict(row) for row in rows]


# --- our own messages, serialised ---


def gate_storm(count: int, seed: int) -> Count:
    """Storm the gate with serialised messages of our own."""
    rng, configuration = random.Random(seed), Configuration()
    row = Count("gate and identifier, serialised")
    gate, quiet = Synchronizer.of(configuration), Synchronizer.of(configuration)
    inputs, undisturbed = OwnInputs(gate), OwnInputs(quiet)
    learner, reference = Learner(configuration), Learner(configuration)
    for sample in _good(configuration, 1 - (-count // (2 * PER_GOOD))):
        for topic in (STATE, EFFECTORS):
            good = whole(topic, sample)
            for how, data in () if sample[0] == START else damaged(good, rng):
                row["tried"] += 1
                before = sum(gate.refused.values())
                try:
                    learner.use(inputs.offer(topic, data))
                except Refused:
                    row["refused"] += 1
                    row["unlogged"] += sum(gate.refused.values()) == before
                except Exception as error:
                    row.crash(f"{topic}, {how}", error)
            learner.use(inputs.offer(topic, serialize_message(good)))
            reference.use(undisturbed.offer(topic, serialize_message(good)))
    waited = sum(gate.refused.values()) - row["refused"]  # refused once they were contradicted
    row["refused"] += waited
    row["unlogged"] += max(row["tried"] - row["refused"] - row["crashed"], 0)
    return _close(row, learner, reference)


def _close(row: Count, learner: Learner, reference: Learner) -> Count:
    row["same_bits"] = learner.digest == reference.digest and learner.samples > 0
    row["not_finite"] = int(not learner.finite)
    return row


def _good(configuration: Configuration, count: int) -> Iterator[Sample]:
    """Samples of an aircraft that is none."""
    rng = np.random.default_rng(1)
    n, m = len(configuration.states), len(configuration.effectors)
    a, b = 0.1 * rng.normal(size=(n, n)), rng.normal(size=(n, m))
    for k in range(count):
        x, delta = 0.1 * rng.normal(size=n), 0.05 * rng.normal(size=m)
        x[0] += 100.0
        fields = {"x": x, "xdot": a @ x + b @ delta + 1e-3 * rng.normal(size=n), "delta": delta}
        yield START + k * STEP, (*configuration.states, *configuration.effectors), fields


def whole(topic: str, sample: Sample) -> Any:
    """Return one of the two messages of a sample."""
    stamp, names, fields = sample
    n = len(fields["x"])
    if topic == STATE:
        return messages.state_message(stamp, names[:n], fields["x"], fields["xdot"])
    return messages.effector_message(stamp, names[n:], fields["delta"])


def damaged(good: Any, rng: random.Random, away: bool = True) -> Iterator[tuple[str, bytes]]:
    """Yield damaged messages that come before a good one of ours, and how they were damaged.

    Parameters
    ----------
    good
        A message with a header, names and numbers.
    rng
        Of the damage.
    away
        Whether stamps far from the good one's are among it.
    """
    data, stamp = serialize_message(good), messages.stamp_of(good)
    for number in range(PER_GOOD):
        message = deserialize_message(data, type(good))
        if number < 2 and away:  # three in a row would be a new time
            far = rng.choice(AWAY)
            message.header.stamp = messages.time_message(far)
            yield f"stamp {far}", serialize_message(message)
        elif rng.random() < 0.3:
            how, change = rng.choice(list(BYTES.items()))
            yield how, change(data, rng)
        else:
            how, spoil = rng.choice(list(FIELDS.items()))
            spoil(message, stamp, rng)
            yield how, serialize_message(message)


def _vector(message: Any, rng: random.Random) -> Any:
    return getattr(message, rng.choice(["x", "xdot"]) if hasattr(message, "x") else "delta")


def _names(message: Any) -> list[str]:
    found: list[str] = message.states if hasattr(message, "states") else message.effectors
    return found


def _number(message: Any, stamp: int, rng: random.Random) -> None:
    vector = _vector(message, rng)
    vector[rng.randrange(len(vector))] = rng.choice((math.nan, math.inf, -math.inf, 1e12, -1e13, 1e308))


def _length(message: Any, stamp: int, rng: random.Random) -> None:
    vector = _vector(message, rng)
    del vector[slice(rng.randrange(len(vector)), None) if rng.random() < 0.7 else slice(1)]


def _longer(message: Any, stamp: int, rng: random.Random) -> None:
    _vector(message, rng).extend([0.0] * rng.choice((1, 1000)))


def _name(message: Any, stamp: int, rng: random.Random) -> None:
    names = _names(message)
    names[rng.randrange(len(names))] = rng.choice((names[0] + names[-1], "", "x" * 10_000, "\u00e9", "u\n"))


def _fewer_names(message: Any, stamp: int, rng: random.Random) -> None:
    del _names(message)[rng.randrange(len(_names(message))) :]


def _repeated(message: Any, stamp: int, rng: random.Random) -> None:
    back = STEP if rng.random() < 0.5 else rng.randrange(STEP + 1, 900_000_000)
    message.header.stamp = messages.time_message(stamp - back)


FIELDS: dict[str, Callable[[Any, int, random.Random], None]] = {
    "a number that is none, or huge": _number,
    "numbers left out": _length,
    "numbers added": _longer,
    "a wrong name": _name,
    "names left out": _fewer_names,
    "a stamp repeated or back": _repeated,
}
BYTES: dict[str, Callable[[bytes, random.Random], bytes]] = {
    "cut off": lambda b, r: b[: r.randrange(len(b))],
    "nothing": lambda b, r: b"",
    "noise": lambda b, r: r.randbytes(r.choice((1, 4, 12, 500))),
    "noise in an envelope": lambda b, r: b[:12] + r.randbytes(r.choice((1, 8, 500))),
    "a wrong envelope": lambda b, r: bytes([0, r.randrange(2, 256)]) + b[2:],
    "a huge length": lambda b, r: b[:12] + struct.pack("<I", r.choice((2**31, 2**32 - 1, 10**6))) + b[16:],
}


# --- messages of other stacks, through their maps ---


def map_storm(name: str, count: int, seed: int) -> Count:
    """Storm the inputs of a shipped map with messages of its types."""
    rng, row = random.Random(seed), Count(f"inputs of {name}")
    sent = _mapped(name, 40 + count // PER_GOOD)
    configuration, inputs = read_profile(name), read_inputs(name)
    if inputs is None:
        message = f"{name} maps nothing"
        raise RuntimeError(message)
    gates = [Synchronizer.of(configuration) for _ in range(2)]
    ways = [InputAdapter(inputs, configuration.states, configuration.effectors, refused=g.refused) for g in gates]
    learners = [Learner(configuration) for _ in range(2)]

    def push(which: int, topic: str, stamp: int, message: Any) -> None:
        for made in ways[which].push(topic, stamp, message):
            try:
                learners[which].use(made.offer(gates[which]))
            except Refused:
                continue

    last: dict[str, int] = {}
    for arrival, topic, message in sent:
        for number in range(PER_GOOD if topic in last and row["tried"] < count else 0):
            how, bad = spoiled(message, last[topic], number, rng, topic == inputs.topics[inputs.clock].topic)
            row["tried"] += 1
            before = sum(gates[0].refused.values())
            try:
                push(0, topic, arrival, bad)
            except EstimationError:
                row["refused"] += 1
                continue
            except Exception as error:
                row.crash(f"{topic}, {how}", error)
            counted = sum(gates[0].refused.values()) - before
            row["refused"] += counted > 0
            row["unlogged"] += counted == 0 and not ways[0].waiting
        for which in range(2):
            push(which, topic, arrival, message)
        last[topic] = stamp_of(message)
    row["refused"] = row["tried"] - row["unlogged"] - row["crashed"]
    return _close(row, *learners)


def _mapped(name: str, samples: int) -> list[tuple[int, str, Any]]:
    """Return a flight as messages of other types, good ones."""
    tests = str(Path(__file__).parents[1] / "test")
    if tests not in sys.path:
        sys.path.append(tests)
    made: Any = importlib.import_module("inputs.mapped_messages")
    flight = made.rigid_flight(samples / made.RATE)
    flight.start = START  # a second after 0, a stamp of 0 would be near
    if name == "odometry_jointstate":
        flight.effectors = ("elevator", "aileron", "rudder")
    return [(log, topic, _object(content)) for log, topic, _, content in getattr(made, MAPS[name])(flight)]


def _object(content: Any) -> Any:
    """Return nested mappings as objects with attributes."""
    if isinstance(content, dict):
        return SimpleNamespace(**{key: _object(value) for key, value in content.items()})
    return content


def stamp_of(message: Any) -> int:
    """Stamp of a message of another type [ns], wherever it stands."""
    if hasattr(message, "header"):
        return int(message.header.stamp.sec * 10**9 + message.header.stamp.nanosec)
    return int(getattr(message, "timestamp_sample", message.timestamp)) * 1000


def set_stamp(message: Any, stamp: int) -> None:
    """Write it."""
    if hasattr(message, "header"):
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
    else:
        message.timestamp = message.timestamp_sample = stamp // 1000


def spoiled(good: Any, last: int, number: int, rng: random.Random, clock: bool) -> tuple[str, Any]:
    """Return a damaged message that comes before a good one of its topic, and how it was damaged."""
    bad, stamp = deepcopy(good), stamp_of(good)
    if number < 2:
        away = rng.choice([-(10**9), 0, stamp + 86400 * 10**9, 2**31 * 10**9 - 10**9])
        if away < last - 10**9 or away > last + 10**9:
            set_stamp(bad, away)
            return f"stamp {away}", bad
    if rng.random() < 0.3:
        set_stamp(bad, last if rng.random() < 0.5 else last - rng.randrange(1000, 900_000_000, 1000))
        return "a stamp repeated or back", bad
    set_stamp(bad, (stamp + 2 * last) // 3 if not clock else last)
    value = rng.choice((math.nan, math.inf, 1e308))
    return ("a field left out", _pruned(bad, rng)) if rng.random() < 0.3 else ("no numbers", _without(bad, value))


def _pruned(message: Any, rng: random.Random) -> Any:
    """Leave out the stamp, so that nothing of the message can be used."""
    for name in ("header", "timestamp", "timestamp_sample"):
        if hasattr(message, name):
            delattr(message, name) if rng.random() < 0.5 else setattr(message, name, "text")
    return message


def _without(message: Any, value: float) -> Any:
    """Put a value that is none everywhere but in the stamp."""
    for key, old in vars(message).items():
        if key in ("header", "timestamp", "timestamp_sample"):
            continue
        if isinstance(old, SimpleNamespace):
            _without(old, value)
        elif isinstance(old, float):
            setattr(message, key, value)
        elif isinstance(old, np.ndarray):
            setattr(message, key, np.full(old.shape, value))
    return message
