"""Who joins late is given what an identifier has found, and only who asks for it: those who act do not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msls_msgs.msg import DitherCommand, FaultEvent, LinearModel
from nodes.made_up import Clockwork
from nodes.test_identifier import STEP, Feeder
from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy
from std_srvs.srv import Trigger

from msls_ros import messages
from msls_ros.estimation import Configuration, EventKind, Identifier
from msls_ros.estimation import FaultEvent as Event
from msls_ros.nodes.controller import ControllerNode
from msls_ros.nodes.identifier import IdentifierNode
from msls_ros.nodes.mixer import MixerNode
from msls_ros.nodes.pilot import PilotNode
from msls_ros.nodes.plant import PlantNode
from msls_ros.nodes.quality import INPUT, latched
from msls_ros.nodes.recorder import RecorderNode
from msls_ros.nodes.watching import WatchNode
from msls_ros.plant import EFFECTORS, STATES
from msls_ros.testing import Bench

LOST = Event(0.5, EventKind.DETECTED, ("P",), (9.0,), (7.0,), description="abrupt change in dP/dt")


def late(bench: Bench, kind: type[Any], topic: str) -> list[Any]:
    """Return what a subscription hears that is made now and asks for what was published before."""
    heard: list[Any] = []
    bench.probe.create_subscription(kind, topic, heard.append, latched(10))
    return heard


def test_who_joins_late_hears_of_what_was_lost_and_of_the_model_though_no_sample_comes_any_more(bench: Bench) -> None:
    feeder = Feeder(bench, lockstep=True)
    feeder.feed(30)
    assert feeder.node._sample is not None
    feeder.node._publish_event(feeder.node._sample, LOST)
    faults, models = late(bench, FaultEvent, "fault"), late(bench, LinearModel, "model")
    bench.spin_until(lambda: faults and models and models[-1].samples == 30, "what was said before")
    assert [f.description for f in faults] == [LOST.description]


def test_a_model_that_nobody_heard_is_kept_for_who_comes_when_the_samples_have_stopped(bench: Bench) -> None:
    node, clock = bench.add(IdentifierNode), Clockwork()
    node._steady = clock
    dithers = bench.listen(DitherCommand, "dither")
    bench.publish("state", messages.state_message(STEP, STATES, np.ones(9), np.zeros(9)))
    bench.publish("effectors", messages.effector_message(STEP, EFFECTORS, np.zeros(7)))
    bench.expect(dithers, 1)
    clock.nanoseconds += 200_000_000
    node._watch_inputs()
    models = late(bench, LinearModel, "model")
    bench.expect(models, 1)
    assert [messages.stamp_of(m) for m in models] == [STEP]


def test_every_tenth_model_is_every_tenth_also_where_somebody_has_listened_from_the_start(bench: Bench) -> None:
    node = bench.add(IdentifierNode, publish_every=10, lockstep=True)
    dithers, models = bench.listen(DitherCommand, "dither"), bench.listen(LinearModel, "model")
    for k in range(1, 31):
        bench.publish("state", messages.state_message(k * STEP, STATES, np.ones(9), np.zeros(9)))
        bench.publish("effectors", messages.effector_message(k * STEP, EFFECTORS, np.zeros(7)))
        bench.expect(dithers, k)
    bench.expect(models, 3)
    assert [m.samples for m in models] == [10, 20, 30] and node.events == 0


def test_a_reset_ends_what_was_found_for_who_joins_later(bench: Bench) -> None:
    feeder = Feeder(bench, lockstep=True)
    feeder.feed(2)
    assert feeder.node._sample is not None
    feeder.node._publish_event(feeder.node._sample, LOST)
    assert bench.call(Trigger, "identifier/reset").success
    assert bench.call(Trigger, "identifier/reset").success  # of nothing: no second event
    faults = late(bench, FaultEvent, "fault")
    bench.expect(faults, 2)
    assert [f.kind for f in faults] == [FaultEvent.DETECTED, FaultEvent.RESET]
    assert "~/reset" in faults[-1].description


@pytest.mark.parametrize("how", [INPUT, latched(10)], ids=["volatile, as a bag that is played", "latched"])
def test_watch_hears_each_event_once_and_late_where_the_publisher_keeps_it(bench: Bench, how: Any) -> None:
    model = messages.model_message(10**9, Identifier(Configuration()).estimate(1.0, np.zeros(9)))
    publishers = {kind: bench.probe.create_publisher(kind, topic, how) for kind, topic in TOPICS.items()}
    node, kept = None, how is not INPUT
    if kept:
        publishers[FaultEvent].publish(messages.fault_message(500_000_000, LOST))
        publishers[LinearModel].publish(model)
    node = bench.adopt(WatchNode(context=bench.context))
    count = 2 if kept else 1
    bench.spin_until(lambda: all(p.get_subscription_count() == count for p in publishers.values()), "the view")
    if kept:
        bench.spin_until(lambda: node.model is not None and node.events, "what was said before")
        assert node._counts["model"] == 0  # it did not come just now
    publishers[FaultEvent].publish(messages.fault_message(600_000_000, LOST))
    publishers[LinearModel].publish(model)
    bench.spin_until(lambda: node._counts["model"] == 1 and len(node.events) == count, "what is said now")
    model.header.stamp.sec += 1
    publishers[LinearModel].publish(model)  # the other subscription has had its turn by then
    bench.spin_until(lambda: node._counts["model"] == 2, "the next model")
    assert [messages.stamp_of(e) for e in node.events] == [500_000_000, 600_000_000][-count:]


TOPICS: dict[Any, str] = {FaultEvent: "fault", LinearModel: "model"}


def test_watch_drops_events_of_a_time_that_has_been_left(bench: Bench) -> None:
    node = bench.adopt(WatchNode(context=bench.context))
    bench.publish("fault", messages.fault_message(100 * 10**9, LOST))
    bench.spin_until(lambda: node.events, "the event")
    bench.publish("model", messages.model_message(10**9, Identifier(Configuration()).estimate(1.0, np.zeros(9))))
    bench.spin_until(lambda: node.model is not None, "a model of an earlier time")
    assert not node.events


@pytest.mark.parametrize("kind", [ControllerNode, MixerNode, PlantNode, PilotNode, RecorderNode])
def test_who_acts_asks_for_nothing_that_is_past(bench: Bench, kind: type[Node], tmp_path: Path) -> None:
    """A law that begins must not take an alarm of the last flight for one of now."""
    given: dict[type[Node], dict[str, Any]] = {
        PlantNode: {"autostart": False},
        RecorderNode: {"out": str(tmp_path / "bag")},
    }
    node = bench.add(kind, **given.get(kind, {}))
    asked = {s.topic_name: s.qos_profile.durability for s in node.subscriptions}
    assert asked and set(asked.values()) == {QoSDurabilityPolicy.VOLATILE}


def test_a_view_that_hears_no_model_names_the_namespaces_in_which_there_is_one(bench: Bench) -> None:
    node = bench.adopt(WatchNode(context=bench.context))
    assert "did you mean" not in node.waiting()
    for name in ("/uav1/model", "/uav1/truth/model"):
        bench.probe.create_publisher(LinearModel, name, 1)
    bench.probe.create_publisher(FaultEvent, "/uav2/model", 1)
    wanted = (
        "waiting for a model: /model: no publisher (did you mean --namespace /uav1?); no diagnostics of /identifier"
    )
    bench.spin_until(lambda: node.waiting() == wanted, node.waiting())
