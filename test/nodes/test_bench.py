"""The bench for a user's own pytest: what is fed comes back as models, events and dithers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import rclpy
from msls_msgs.msg import EffectorSample, LinearModel
from nodes.made_up import linear_samples
from nodes.test_mapped_inputs import PROFILE, decoded, flight_messages, offline
from rclpy.context import Context
from rclpy.node import Node

from msls_ros import messages, testing
from msls_ros.estimation import EstimationError, Identifier
from msls_ros.inputs.profiles import read_profile
from msls_ros.messages import stamp_of
from msls_ros.testing import Bench, IdentifierBench, claim_domain

EXAMPLES = Path(__file__).parents[2] / "docs/examples"
MAPPED, MY_AIRCRAFT = EXAMPLES / "my_stack.yaml", EXAMPLES / "my_aircraft.yaml"
COUNT = 130
LAST = 2_380_000_000
"""Stamp of the last of 20 samples at 50 Hz, from 2 s on [ns]."""


def made_up(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    return (0.02 * np.arange(count), *linear_samples(count))


def test_the_node_on_the_bench_says_what_the_identifier_says() -> None:
    time, x, xdot, delta = made_up(COUNT)
    xdot[100:, 3] -= 40.0 * delta[100:, 2]
    with Bench() as bench:
        identifier = bench.identifier("f16", dither__seed=3)
        identifier.feed(time, x, xdot, delta)
        models = identifier.await_models(COUNT)
        events = identifier.await_events(1)
    alone = Identifier(read_profile("f16").replace({"dither.seed": 3}))
    stamped = np.round(1e9 * (1.0 + time)) * 1e-9  # the node knows times by their stamps
    expected = alone.run(stamped, x, xdot, delta).estimates
    assert np.array_equal(messages.values(models[-1].b), expected[-1].b.ravel())
    assert len(identifier.dithers) == COUNT
    assert events[0].kind == events[0].DETECTED and "P" in events[0].equations


def test_fed_twice_it_counts_on() -> None:
    time, x, xdot, delta = made_up(20)
    with Bench() as bench:
        identifier = bench.identifier()
        for first in (1.0, 2.0):
            identifier.feed(time, x, xdot, delta, first=first)
        assert len(identifier.await_models(40)) == 40


def test_what_does_not_come_is_named() -> None:
    with Bench(patience=0.1) as bench, pytest.raises(AssertionError, match=r"the moon did not come within 0\.1 s"):
        bench.spin_until(lambda: False, "the moon")


def test_who_listens_beside_an_identifier_or_twice_hears_each_message_once() -> None:
    with Bench() as bench:
        identifier = bench.identifier()
        heard = [bench.listen(LinearModel, topic) for topic in ("model", "/model")]
        for first in (1.0, 2.0):
            identifier.feed(*made_up(20), first=first)
        for models in (identifier.models, *heard):
            bench.spin_until(lambda models=models: models and stamp_of(models[-1]) == LAST, "the last model")  # type: ignore[misc]
            assert len({stamp_of(model) for model in models}) == len(models) == 40
        assert heard[1] is bench.heard["model"]


class Talker(Node):
    """Publishes from outside of the executor."""

    def __init__(self, **how: object) -> None:
        super().__init__("talker", **how)  # type: ignore[arg-type]
        self.out = self.create_publisher(EffectorSample, "said", 10)


class Listener(Node):
    def __init__(self, **how: object) -> None:
        super().__init__("listener", **how)  # type: ignore[arg-type]
        self.heard: list[EffectorSample] = []
        self.create_subscription(EffectorSample, "said", self.heard.append, 10)


@pytest.mark.parametrize("kinds", [(Talker, Listener), (Listener, Talker)])
def test_the_first_message_of_a_node_reaches_what_is_on_the_bench(kinds: tuple[type[Node], type[Node]]) -> None:
    """Nothing has spun since either was added."""
    with Bench() as bench:
        made = {kind: bench.add(kind) for kind in kinds}
        made[Talker].out.publish(EffectorSample(effectors=["de"]))  # type: ignore[attr-defined]
        bench.expect(made[Listener].heard, 1)  # type: ignore[attr-defined]


def free_domains(count: int) -> list[int]:
    """Return domains that benches may have."""
    claims = [claim_domain() for _ in range(count)]
    for _, lock in claims:
        lock.close()
    return [domain for domain, _ in claims]


def test_a_bench_takes_neither_the_domain_of_a_running_stack_nor_that_of_the_environment(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    running, named, free = free_domains(3)
    monkeypatch.setattr(testing, "DOMAINS", [running, named, free])
    monkeypatch.setenv("ROS_DOMAIN_ID", str(named))
    context = Context()
    rclpy.init(context=context, domain_id=running)
    stack = Node("stack", context=context)
    try:
        with Bench() as bench:
            assert bench.domain == free
            with pytest.raises(RuntimeError, match="all DDS domains"):
                Bench()
    finally:
        stack.destroy_node()
        context.shutdown()


def test_a_profile_that_is_not_there_is_refused(bench: Bench) -> None:
    with pytest.raises(EstimationError, match="shipped are"):
        IdentifierBench(bench, "no_such_profile", {})


def test_a_mapped_file_subscribes_to_its_topics_and_identifies() -> None:
    messages = flight_messages(400)
    expected = offline(messages)
    with Bench() as bench:
        identifier = bench.identifier(PROFILE, time_jump=0.2)
        identifier.play(messages)
        models = identifier.await_models(len(expected))
        subscribed = {one.topic_name for one in identifier.node.subscriptions}
    assert {"/odom", "/imu/data", "/joint_states"} <= subscribed and not {"/state", "/effectors"} & subscribed
    assert decoded(models) == expected
    assert np.reshape(models[-1].b, (9, 3))[4, 0] == pytest.approx(-30.0, rel=0.05)  # Q by the elevator


def test_all_that_a_file_says_reaches_the_node_and_keywords_go_before_it(tmp_path: Path) -> None:
    own = "    queue: 0.3\n    publish_every: 5\n    frame_id: hull\n    autostart: false\n"
    file = tmp_path / "own.yaml"
    file.write_text(MY_AIRCRAFT.read_text() + own + "/**:\n  ros__parameters:\n    model_file: kept.yaml\n")
    names = ("queue", "publish_every", "frame_id", "model_file", "dither.seed", "sample_rate", "effectors")
    with Bench(patience=30.0) as bench:
        one = bench.identifier(file, publish_every=2, dither__seed=4)
        found = [one.node.get_parameter(name).value for name in names]
        time = np.arange(100) * 0.02
        one.feed(time, *np.random.default_rng(0).normal(size=(3, 100, 2)) * 0.01)
        assert len(one.await_models(40)) <= 50  # the newest samples wait: either may be a spike
    assert found == [0.3, 2, "hull", "kept.yaml", 4, 50.0, ["da", "dr"]]
    assert one.models[0].header.frame_id == "hull" and one.configuration.dither.seed == 4


def test_feeding_samples_to_a_mapped_identifier_is_refused_and_without_its_inputs_it_is_fed() -> None:
    time, x, xdot, delta = 0.01 * np.arange(5), np.ones((5, 9)), np.zeros((5, 9)), np.zeros((5, 3))
    with Bench() as bench, pytest.raises(EstimationError, match=r"inputs are /odom, /imu/data, /joint_states: give"):
        bench.identifier(MAPPED).feed(time, x, xdot, delta)
    with Bench() as bench, pytest.raises(EstimationError, match=r"topic /odo is not an input of .* inputs are /odom, "):
        bench.identifier(MAPPED).play([("/odo", EffectorSample())])
    with Bench(patience=30.0) as bench:
        identifier = bench.identifier(read_profile(MAPPED))
        identifier.feed(time, x, xdot, delta)
        assert len(identifier.await_models(5)) == 5


class Plain(Node):
    def __init__(self) -> None:
        super().__init__("plain")


def test_a_node_that_takes_no_keywords_is_refused_with_what_to_write(bench: Bench) -> None:
    with pytest.raises(TypeError, match=r"Plain does not take .* write 'def __init__\(self, \*\*kwargs\)'"):
        bench.add(Plain)
