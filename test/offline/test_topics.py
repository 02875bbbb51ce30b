"""Live, offline and through topics: the same numbers to the last bit. A killed recorder leaves a bag that replays."""

from __future__ import annotations

import dataclasses
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from msls_msgs.msg import DitherCommand, EffectorSample, FaultEvent, LinearModel, StateSample
from offline.replayed import BAGS, FLIGHTS, OUTPUTS, Decoded, assert_same, inputs, outputs, plain

from msls_ros.bags import BagMessage, read, typestore
from msls_ros.commands import recorder, replay
from msls_ros.commands.record_flights import FLIGHTS as SCENARIO_OF
from msls_ros.estimation import Configuration
from msls_ros.estimation.configuration import as_mapping
from msls_ros.flights.scenarios import find_scenario
from msls_ros.inputs.profiles import read_profile
from msls_ros.nodes.flight import LOCKSTEP, fly, overrides
from msls_ros.nodes.identifier import IdentifierNode
from msls_ros.nodes.quality import INPUT
from msls_ros.offline.replay import kept_parameters
from msls_ros.offline.replay import replay as replay_bag
from msls_ros.testing import PATIENCE, Bench

KINDS: dict[str, Any] = {"/model": LinearModel, "/fault": FaultEvent, "/dither": DitherCommand}
STORE = typestore()
RATIO = {"detector.mode": "ratio", "detector.window": 50, "detector.threshold": 3.5}
"""What MSLS's detector wants in medium noise."""


class Player:
    """Publishes the serialised samples of a bag, each after the answer to the one before, to a node that runs."""

    def __init__(self, bench: Bench, configuration: Configuration) -> None:
        self._bench = bench
        given = overrides({**as_mapping(configuration), **LOCKSTEP})
        self.node = bench.adopt(IdentifierNode(context=bench.context, parameter_overrides=given))
        self._heard: dict[str, list[bytes]] = {topic: [] for topic in OUTPUTS}
        for topic, heard in self._heard.items():
            bench.probe.create_subscription(KINDS[topic], topic, heard.append, INPUT, raw=True)
        kinds = {"/state": StateSample, "/effectors": EffectorSample}
        self._publishers = {t: bench.probe.create_publisher(kind, t, INPUT) for t, kind in kinds.items()}
        connected = [*self._publishers.values()]
        bench.spin_until(lambda: all(p.get_subscription_count() for p in connected), "the identifier's subscriptions")
        bench.spin_until(lambda: all(bench.probe.count_publishers(t) for t in OUTPUTS), "the identifier's topics")

    def play(self, messages: list[BagMessage]) -> Decoded:
        """Return what the node said."""
        for heard in self._heard.values():
            heard.clear()
        for k, message in enumerate(messages):
            self._publishers[message.topic].publish(message.data)
            if k % 2:
                self._bench.expect(self._heard["/dither"], k // 2 + 1, "the answer to a sample")
        self._bench.expect(self._heard["/model"], len(messages) // 2, "the last model")
        found: Decoded = {}
        for topic, heard in self._heard.items():
            kind = f"msls_msgs/msg/{KINDS[topic].__name__}"
            decoded: list[Any] = [STORE.deserialize_cdr(bytes(data), kind) for data in heard]
            stamps = [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in decoded]
            found[topic] = [(stamp, plain(m)) for stamp, m in zip(stamps, decoded, strict=True)]
        return found


@pytest.mark.parametrize("name", FLIGHTS)
def test_a_recorded_flight_through_topics_is_as_in_flight_and_again_when_played_twice(name: str, bench: Bench) -> None:
    player = Player(bench, read_profile(kept_parameters(BAGS / name)))
    messages, live = inputs(BAGS / name), outputs(BAGS / name)
    assert_same(player.play(messages), live)
    assert (player.node.synchronizer.restarts, sum(player.node.synchronizer.refused.values())) == (0, 0)
    assert_same(player.play(messages), live)
    assert (player.node.synchronizer.restarts, sum(player.node.synchronizer.refused.values())) == (1, 0)


@pytest.mark.parametrize(
    ("method", "noise", "fault", "changes"),
    [
        ("bank", "none", 3.2, {}),  # it alarms at nothing before that: what is excited first is learnt
        ("bank", "low", 3.2, {}),
        ("msls", "none", 2.0, {"estimator.penalty": 3e-4}),
        ("msls", "med", 2.0, {"estimator.penalty": 1e-2, **RATIO}),
    ],
    ids=["bank-none", "bank-low", "msls-none", "msls-med"],
)
@pytest.mark.parametrize("name", FLIGHTS)
def test_live_offline_and_through_topics_are_equal(
    name: str, method: str, noise: str, fault: float, changes: dict[str, Any], bench: Bench, tmp_path: Path
) -> None:
    scenario = find_scenario(SCENARIO_OF[name])
    faults = tuple(dataclasses.replace(one, time=fault) for one in scenario.faults)
    short = dataclasses.replace(scenario, duration=4.0, faults=faults)
    configuration = short.configuration(noise, 5, dither=True).replace({"estimator.method": method, **changes})
    fly(short, configuration, tmp_path / "bag", noise=noise, seed=5)
    live = outputs(tmp_path / "bag")
    assert len(live["/model"]) == 201
    assert bool(live["/fault"]) or not scenario.has_fault

    assert read_profile(kept_parameters(tmp_path / "bag")) == configuration
    replay_bag(tmp_path / "bag", tmp_path / "out", configuration)
    assert_same(outputs(tmp_path / "out"), live)
    assert_same(Player(bench, configuration).play(inputs(tmp_path / "bag")), live)


def test_a_recorder_killed_in_flight_loses_at_most_the_last_second(
    bench: Bench, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = tmp_path / "bag"
    code = "import sys; from msls_ros.commands.recorder import main; sys.exit(main())"
    arguments = ["--ros-args", "-p", f"out:={bag}"]
    environment = {**os.environ, "ROS_DOMAIN_ID": str(bench.domain)}
    flight = inputs(BAGS / "tail_fault")
    sent: list[float] = []
    kinds = {"/state": StateSample, "/effectors": EffectorSample}
    with subprocess.Popen([sys.executable, "-c", code, *arguments], env=environment) as process:
        publishers = {t: bench.probe.create_publisher(kind, t, INPUT) for t, kind in kinds.items()}
        bench.spin_until(lambda: all(p.get_subscription_count() for p in publishers.values()), "the recorder")
        start = time.monotonic()
        while time.monotonic() - start < 2.5 or len(sent) < 100:
            assert time.monotonic() - start < PATIENCE
            pair = flight[2 * len(sent) : 2 * len(sent) + 2]
            for message in pair:
                publishers[message.topic].publish(message.data)
            sent.append(time.monotonic())
            bench.executor.spin_once(timeout_sec=0.02)
        process.send_signal(signal.SIGKILL)
        killed = time.monotonic()
        process.wait()
    whole = list(read(bag))
    kept = [message.stamp_ns for message in whole if message.topic == "/effectors"]
    assert kept == [message.stamp_ns for message in flight[1 : 2 * len(kept) : 2]]
    assert len(kept) >= sum(at < killed - 1.0 for at in sent) > 20

    arguments = [str(bag), "--params", "f16", "--out", str(tmp_path / "out"), "--json"]
    assert replay.main(arguments) == 0
    err = [line for line in capsys.readouterr().err.splitlines() if line.startswith("replay:")]
    assert len(err) == 1 and f"log time {whole[-1].stamp_ns / 1e9:.9g} s" in err[0]
    assert recorder.main(["--repair", str(bag)]) == 0
    assert replay.main([*arguments, "--overwrite"]) == 0
    assert "warning" not in capsys.readouterr().err
    assert_same(outputs(tmp_path / "out" / "bag"), head(outputs_with("f16", flight, tmp_path), len(kept)))


def outputs_with(profile: str, flight: list[BagMessage], folder: Path) -> Decoded:
    replay_bag(BAGS / "tail_fault", folder / "whole", read_profile(profile))
    return outputs(folder / "whole")


def head(found: Decoded, samples: int) -> Decoded:
    """Return what was said up to a sample."""
    end = found["/dither"][samples - 1][0]
    return {topic: [message for message in messages if message[0] <= end] for topic, messages in found.items()}
