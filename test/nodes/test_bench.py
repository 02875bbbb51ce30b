"""The bench for a user's own pytest: what is fed comes back as models, events and dithers."""

from __future__ import annotations

import numpy as np
import pytest
import rclpy
from msls_msgs.msg import EffectorSample, LinearModel
from nodes.made_up import linear_samples
from rclpy.context import Context
from rclpy.node import Node

from msls_ros import messages, testing
from msls_ros.estimation import EstimationError, Identifier
from msls_ros.inputs.profiles import read_profile
from msls_ros.messages import stamp_of
from msls_ros.testing import Bench, IdentifierBench, claim_domain

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
