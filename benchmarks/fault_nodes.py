"""Damaged messages over DDS to every node, raw bytes too: the node lives, and its answers are those without them.

Each node flies the same flight twice, undisturbed and with damaged messages before each good one. What it publishes
must be the same, field by field.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from msls_msgs.msg import EffectorCommand, EffectorSample, StateSample
from rclpy.logging import LoggingSeverity, set_logger_level
from rclpy.serialization import deserialize_message, serialize_message

from benchmarks.fault_messages import PER_GOOD, START, STEP, Count, damaged
from msls_ros import messages
from msls_ros.bags import BagReader
from msls_ros.estimation import Dither, Level
from msls_ros.nodes.identifier import IdentifierNode
from msls_ros.nodes.mixer import MixerNode
from msls_ros.nodes.pilot import PilotNode
from msls_ros.nodes.plant import PlantNode
from msls_ros.nodes.recorder import RecorderNode
from msls_ros.plant import CONDITIONS, EFFECTORS, STATES, Aircraft
from msls_ros.testing import Bench

TRIM = Aircraft(CONDITIONS["high_alpha"]).trim
ZERO = Dither(np.zeros(len(EFFECTORS)), 0.0, 0.0, 0.0, Level.NOMINAL, "storm")
AUTHORITY = 0.02
"""Of the mixer [rad]."""


class Link:
    """Publishes good messages, with damaged ones before them, and listens.

    Parameters
    ----------
    bench
        With the node.
    row
        Where damaged messages are counted; None: there are none.
    away
        Whether stamps far from the others are among them.
    """

    def __init__(self, bench: Bench, row: Count | None, away: bool) -> None:
        self.bench, self._row, self._away = bench, row, away
        self._rng = random.Random(0)
        self._begun: set[str] = set()
        self.sent = 0
        """Messages published, good and damaged."""

    def send(self, topic: str, good: Any) -> None:
        """Publish a message, and before it what harms."""
        if self._row is not None and topic in self._begun:
            for _, data in damaged(good, self._rng, self._away):
                self.bench._publishers[topic].publish(data)
                self._row["tried"] += 1
                self.sent += 1
        self.bench.publish(topic, good)
        self._begun.add(topic)
        self.sent += 1


def measure(count: int, say: Callable[[str], None]) -> list[dict[str, Any]]:
    """Send so many damaged messages to each node; give a row for each."""
    rows = []
    for name, fly in FLIGHTS.items():
        say(f"{count} damaged messages over DDS to the {name}")
        rows.append(dict(storm(name, fly, count)))
    return rows


def storm(name: str, fly: Callable[[Bench, Link, int], list[Any]], count: int) -> Count:
    """Fly twice, undisturbed and disturbed, and compare."""
    row = Count(f"{name}, over DDS")
    answers = []
    for disturbed in (False, True):
        with Bench() as bench:
            link = Link(bench, row if disturbed else None, name != "pilot")
            for node in (name, "probe"):
                set_logger_level(node, LoggingSeverity.FATAL)
            try:
                answers.append(fly(bench, link, 4 - (-count // PER_GOOD)))
                if disturbed:
                    refused = _refused(bench.nodes[-1])
                    row["refused"] = row["tried"] if refused is None else min(refused, row["tried"])
                    row["unlogged"] = max(row["tried"] - row["refused"], 0)
            except Exception as error:
                row.crash(name, error)
                answers.append(None)
            finally:
                set_logger_level(name, LoggingSeverity.INFO)
    row["same_bits"] = bool(answers[0]) and answers[0] == answers[1]
    return row


def _refused(node: Any) -> int | None:
    """How many messages a node has refused; None: it passes on or keeps what it cannot read."""
    if not isinstance(node, IdentifierNode | PlantNode | PilotNode):
        return None
    return sum((node.refused if hasattr(node, "refused") else node.synchronizer.refused).values())


def fields(message: Any) -> tuple[Any, ...]:
    """Return the content of a message, bytes of padding left out."""
    found = []
    for name in message.get_fields_and_field_types():
        value = getattr(message, name)
        if hasattr(value, "get_fields_and_field_types"):
            found.append(fields(value))
        else:
            found.append(value.tobytes() if hasattr(value, "tobytes") else repr(value))
    return tuple(found)


def _samples(count: int) -> Any:
    rng = np.random.default_rng(0)
    a, b = 0.1 * rng.normal(size=(9, 9)), rng.normal(size=(9, 7))
    for k in range(count):
        x, delta = 0.1 * rng.normal(size=9), 0.05 * rng.normal(size=7)
        x[0] += 60.0
        yield START + k * STEP, x, a @ x + b @ delta, delta


def fly_identifier(bench: Bench, link: Link, goods: int) -> list[Any]:
    """Identify; give the dithers and the last model."""
    made = bench.identifier("f16", dither__stale_after=60.0)
    traffic = made.node._monitor.traffic
    for k, (stamp, x, xdot, delta) in enumerate(_samples(goods // 2)):
        link.send("state", messages.state_message(stamp, STATES, x, xdot))
        bench.spin_until(lambda: sum(t.count for t in traffic.values()) >= link.sent, "the states to be read")
        link.send("effectors", messages.effector_message(stamp, EFFECTORS, delta))
        bench.spin_until(lambda: sum(t.count for t in traffic.values()) >= link.sent, "the deflections to be read")
        bench.expect(made.dithers, k + 1, "the dither")
    bench.expect(made.models, goods // 2, "the models")
    return [fields(message) for message in [*made.dithers, made.models[-1]]]


def fly_plant(bench: Bench, link: Link, goods: int) -> list[Any]:
    """Fly in lockstep at trim; give the states."""
    plant = bench.add(PlantNode, autostart=False, time_out=3600.0)
    states = bench.listen(StateSample, "state")
    effectors = bench.listen(EffectorSample, "effectors")
    for topic in ("command", "dither"):
        link.send(topic, _answer(topic, 0))  # connects, and is refused: the flight has not begun
    bench.spin_until(lambda: sum(plant.refused.values()) + sum(a is not None for a in plant._answers.values()) >= 2)
    bench.spin_until(lambda: plant.effector_publisher.get_subscription_count() > 0)
    plant.start()
    for k in range(goods // 2):
        bench.expect(effectors, k + 1, "the next sample")
        bench.expect(states, k + 1, "the next sample")
        stamp = messages.stamp_of(effectors[-1])
        for topic in ("command", "dither"):
            link.send(topic, _answer(topic, stamp))
    bench.expect(states, goods // 2 + 1, "the last sample")
    return [fields(message) for message in states]


def _answer(topic: str, stamp: int) -> Any:
    if topic == "command":
        return messages.command_message(stamp, EFFECTORS, TRIM.delta)
    return messages.dither_message(stamp, EFFECTORS, ZERO)


def fly_pilot(bench: Bench, link: Link, goods: int) -> list[Any]:
    """Answer states; give the commands."""
    pilot = bench.add(PilotNode)
    commands = bench.listen(EffectorCommand, "command")
    for stamp, _, xdot, _ in _samples(goods):
        link.send("state", messages.state_message(stamp, STATES, TRIM.x, xdot))
        bench.spin_until(lambda: len(commands) + sum(pilot.refused.values()) >= link.sent, "the command")
    return [fields(message) for message in commands]


def fly_mixer(bench: Bench, link: Link, goods: int) -> list[Any]:
    """Mix dithers into commands; give whether each output is the command, or is within the authority of it."""
    node = bench.add(MixerNode, authority=[AUTHORITY] * len(EFFECTORS), queue=100)
    out: list[bytes] = []
    bench.probe.create_subscription(EffectorCommand, "command_out", out.append, 100, raw=True)
    bench.spin_until(lambda: node._publisher.get_subscription_count() > 0, "the output's connection")
    dither = Dither(np.full(len(EFFECTORS), 0.01), 0.01, 0.0, 0.0, Level.NOMINAL, "storm")
    right = []
    for k in range(goods // 2):
        link.send("dither", messages.dither_message(START + k * STEP, EFFECTORS, dither))
        command = messages.command_message(START + k * STEP, EFFECTORS, 0.1 * TRIM.delta)
        before = node.passed + node.mixed
        link.send("command_in", command)
        bench.expect(out, before + (1 if link._row is None or k == 0 else 1 + PER_GOOD), "the commands")
        good = deserialize_message(out[-1], EffectorCommand)
        off = np.abs(np.array(good.delta) - np.array(command.delta)).max()
        same = out[-1] == serialize_message(command) or fields(good) == fields(command)
        right.append(same or off <= AUTHORITY)
    return right


def fly_recorder(bench: Bench, link: Link, goods: int) -> list[Any]:
    """Record commands; give those of the good ones that are in the bag."""
    with TemporaryDirectory() as folder:
        node = bench.add(RecorderNode, out=str(Path(folder) / "bag"))
        kept = []
        for k in range(goods):
            good = messages.command_message(START + k * STEP, EFFECTORS, TRIM.delta + 1e-6 * k)
            kept.append(serialize_message(good))
            link.send("command", good)
            bench.spin_until(lambda: sum(node.counts.values()) + sum(node.refused.values()) >= link.sent, "a record")
        bench.remove(node)
        found = {fields(deserialize_message(m.data, EffectorCommand)) for m in _whole(Path(folder) / "bag")}
        good_ones = [fields(deserialize_message(data, EffectorCommand)) for data in kept]
        return [content in found for content in good_ones]


def _whole(bag: Path) -> list[Any]:
    """Return the messages of a bag that can be decoded."""
    found = []
    for message in BagReader(bag):
        try:
            deserialize_message(message.data, EffectorCommand)
        except Exception:  # one of the damaged ones
            continue
        found.append(message)
    return found


FLIGHTS: dict[str, Callable[[Bench, Link, int], list[Any]]] = {
    "identifier": fly_identifier,
    "plant": fly_plant,
    "pilot": fly_pilot,
    "mixer": fly_mixer,
    "recorder": fly_recorder,
}
