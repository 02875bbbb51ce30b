"""The same results under a single-threaded and a multi-threaded executor; clocks that start late, stop and jump."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msls_msgs.msg import DitherCommand, EffectorCommand, LinearModel
from nodes.made_up import linear_samples
from rclpy.context import Context
from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
from rosgraph_msgs.msg import Clock

from benchmarks.fault_soak import plain
from msls_ros import messages
from msls_ros.bags import BagReader
from msls_ros.estimation import Dither, Level
from msls_ros.flights.scenarios import find_scenario
from msls_ros.nodes.flight import fly
from msls_ros.nodes.mixer import MixerNode
from msls_ros.plant import EFFECTORS, STATES
from msls_ros.testing import Bench, IdentifierBench

STEP = 20_000_000
COUNT = 60
SECOND = 1_000_000_000


class Threaded(MultiThreadedExecutor):
    """Ends its threads with itself: rclpy leaves them, and a callback may still run while its node is destroyed."""

    def shutdown(self, timeout_sec: float | None = None) -> bool:
        self._executor.shutdown(wait=True)
        return bool(super().shutdown(timeout_sec))


def threaded(context: Context) -> MultiThreadedExecutor:
    return Threaded(num_threads=4, context=context)


EXECUTORS: tuple[Callable[..., Any], ...] = (SingleThreadedExecutor, threaded)


def test_plant_pilot_controller_identifier_and_recorder_fly_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario = replace(find_scenario("nozzle_hard_over"), duration=3.0)
    flown = []
    for number, executor in enumerate(EXECUTORS):
        monkeypatch.setattr("msls_ros.nodes.flight.SingleThreadedExecutor", executor)
        bag = tmp_path / str(number)
        record = fly(scenario, scenario.configuration("low", 5, dither=True), bag, noise="low", seed=5)
        assert record.time_outs == 0 and not record.refused
        topics: dict[str, list[tuple[int, Any]]] = {}
        reader = BagReader(bag)
        for message in reader:
            topics.setdefault(message.topic, []).append((message.stamp_ns, plain(reader.decode(message))))
        flown.append(topics)
    assert len(flown[0]["/model"]) == record.samples
    assert len(flown[0]["/control_status"]) >= record.samples - 1
    for topics in flown:
        del topics["/control_status"]  # not compared: it differs, its command (compared) does not
    assert flown[0] == flown[1]


def taken(node: MixerNode, stamp: int) -> bool:
    return node._stamp == stamp


def test_the_mixer_mixes_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    said = []
    for executor in EXECUTORS:
        monkeypatch.setattr("msls_ros.testing.SingleThreadedExecutor", executor)
        with Bench() as bench:
            names = ["de", "dr"]
            node = bench.add(MixerNode, effectors=names, command_type="msls_msgs/msg/EffectorCommand")
            node._steady = lambda: 0  # no dither grows stale by the pace of this machine
            out = bench.listen(EffectorCommand, "command_out")
            for k in range(1, 41):
                at = k * STEP
                dither = Dither(np.array([1e-3 * k, -1e-3]), 0.0, 0.0, 0.0, Level.NOMINAL, "test")
                if k % 3:
                    bench.publish("dither", messages.dither_message(at, names, dither))
                    bench.spin_until(partial(taken, node, at), "the dither")
                bench.publish("command_in", messages.command_message(at, names, np.array([0.1, 0.2])))
                bench.expect(out, k, "the command")
        said.append(out)
    assert len({tuple(message.delta) for message in said[0]}) > 20
    assert said[0] == said[1]


def shows(identifier: IdentifierBench, now: int) -> bool:
    return identifier.node.get_clock().now().nanoseconds == now


def answers(dithers: list[DitherCommand], stamp: int) -> bool:
    return bool(dithers) and messages.stamp_of(dithers[-1]) == stamp


def clocked(bench: Bench, times: Sequence[int | None]) -> tuple[list[LinearModel], list[DitherCommand]]:
    """Feed samples to an identifier with use_sim_time, each after what /clock said; return what it answers."""
    identifier = bench.identifier(use_sim_time=True, dither__stale_after=60.0)
    models, dithers = identifier.models, identifier.dithers
    x, xdot, delta = linear_samples(COUNT)
    answered = 0
    for k, now in enumerate(times):
        if now is not None:
            bench.publish("/clock", Clock(clock=messages.time_message(now)))
            bench.spin_until(partial(shows, identifier, now), "the clock")
        at = SECOND + k * STEP
        bench.publish("state", messages.state_message(at, STATES, x[k], xdot[k]))
        bench.publish("effectors", messages.effector_message(at, EFFECTORS, delta[k]))
        bench.expect(models, k + 1, "the model")
        if now is None or abs(now - at) < SECOND:  # else too old for a dither, or of another epoch: only learnt from
            answered += 1
            bench.spin_until(partial(answers, dithers, at), "the dither")
    assert len(dithers) >= answered
    return models, dithers


def stamps() -> list[int]:
    return [SECOND + k * STEP for k in range(COUNT)]


CLOCKS: dict[str, Sequence[int | None]] = {
    "never starts": [None] * COUNT,
    "starts late": [*[None] * 30, *stamps()[30:]],
    "stops": [*stamps()[:30], *[None] * 30],
    "jumps ahead": stamps()[:30] + [at + 3600 * SECOND for at in stamps()[30:]],
    "jumps back": [at + 3600 * SECOND for at in stamps()[:30]] + stamps()[30:],
}


@pytest.mark.parametrize("name", CLOCKS)
def test_the_estimates_are_those_of_the_stamps_whatever_the_clock_does(name: str) -> None:
    with Bench() as bench:
        right = clocked(bench, stamps())
    with Bench() as bench:
        models, dithers = clocked(bench, CLOCKS[name])
    values = [[messages.values(getattr(m, f)).tobytes() for f in ("a", "b", "a_std", "b_std")] for m in models]
    expected = [[messages.values(getattr(m, f)).tobytes() for f in ("a", "b", "a_std", "b_std")] for m in right[0]]
    assert values == expected
    assert all(np.isfinite(messages.values(d.delta)).all() for d in dithers)
