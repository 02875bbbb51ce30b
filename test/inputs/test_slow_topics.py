"""A topic that comes too seldom for the rate of the samples is named; pauses and what sets the pace are not."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace as Message
from typing import Any

import pytest
import yaml
from inputs import mapped_messages as made

from msls_ros.inputs import InputAdapter, InputMap
from msls_ros.inputs.pacing import slowest_pace
from msls_ros.inputs.profiles import config_folder, read_profile
from msls_ros.inputs.slow_topics import SlowTopics

RATE = 50.0
FILE = config_folder() / "inputs" / "odometry_jointstate.yaml"


def message(fields: Any) -> Any:
    return Message(**{k: message(v) for k, v in fields.items()}) if isinstance(fields, dict) else fields


def adapted(rates: dict[str, float], *, hold: str = "", lost: tuple[float, float] = (0.0, 0.0)) -> InputAdapter:
    """Return what has read 6 s of flight, topics thinned to a rate [Hz], nothing of the odometry between two times."""
    entries: dict[str, Any] = yaml.safe_load(FILE.read_text())["/**"]["ros__parameters"]["inputs"]
    entries |= {"maximum_age": 0.4} | {name: entries[name] + hold for name in ("velocity", "attitude")}
    configuration = read_profile("odometry_jointstate")
    adapter = InputAdapter(
        InputMap.from_parameters(entries),
        configuration.states,
        configuration.effectors,
        sample_rate=RATE,
        slowest=slowest_pace(configuration),
    )
    flight = replace(made.rigid_flight(6.0), effectors=("elevator", "aileron", "rudder"))
    next_at: dict[str, float] = {}
    for _, topic, _, fields in made.standard(flight):
        stamp = fields["header"]["stamp"]
        t = stamp["sec"] + stamp["nanosec"] * 1e-9
        if t >= next_at.get(topic, t) and not (topic == "/odom" and lost[0] < t < lost[1]):
            next_at[topic] = t + 1.0 / rates.get(topic, RATE) - 1e-6
            adapter.push(topic, 0, message(fields))
    return adapter


@pytest.mark.parametrize(
    ("topic", "rate", "slow"),
    [
        *[("/odom", 50.0, False), ("/odom", 12.5, False), ("/odom", 5.0, True), ("/odom", 2.5, True)],
        *[("/joint_states", 25.0, False), ("/joint_states", 10.0, True), ("/joint_states", 5.0, True)],
    ],
)
def test_states_may_come_at_a_quarter_of_the_rate_deflections_as_often_as_they_set_the_pace(
    topic: str, rate: float, slow: bool
) -> None:
    adapter = adapted({topic: rate})
    assert set(adapter.too_slow) == set(adapter.slow.samples) == ({topic} if slow else set())
    if slow:
        assert f"{topic} comes at {rate:.3g} Hz" in adapter.too_slow[topic]
        assert len(adapter.newly_slow()) == 1 and not adapter.newly_slow()


def test_a_pause_and_what_is_held_are_not_too_slow() -> None:
    assert not adapted({}, lost=(2.0, 4.0)).slow.samples
    assert not adapted({"/odom": 5.0}, hold=" hold=true").slow.samples


def test_a_new_beginning_forgets_the_steps_and_keeps_the_counts() -> None:
    adapter = adapted({"/odom": 5.0})
    count = adapter.slow.samples["/odom"]
    adapter.clear()
    assert count and adapter.slow.samples["/odom"] == count and not adapter.too_slow


def test_a_topic_that_sets_the_pace_with_breaks_is_not_too_slow_until_it_can_set_none() -> None:
    streams = [Message(name="effectors.e", track=Message(held=False, age=10**8))]
    slow, stamp = SlowTopics(streams, ["/e"], 100.0, 0.13), 0  # type: ignore[arg-type]
    said = []
    for k in range(200):
        stamp += 20_000_000
        slow.sample(0, stamp)
        slow.made(1, -1 if 50 < k < 60 or k > 150 else 0)
        said += slow.news(-1 if 50 < k < 60 or k > 150 else 0)
    assert said == [] and not slow.samples
    for _ in range(100):
        stamp += 250_000_000
        slow.sample(0, stamp)
    (text,) = slow.news(-1)
    assert text.startswith("/e comes at 4 Hz, too slow")
