"""The controller node: the same flight over DDS as without ROS, and what it does when something is missing."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from msls_msgs.msg import ControlStatus, DitherCommand, EffectorCommand
from rclpy.parameter import Parameter

from msls_ros import messages
from msls_ros.control import PilotCommand as Asked
from msls_ros.flights.closed_loop import fly as fly_without_ros
from msls_ros.flights.closed_loop import still_air
from msls_ros.flights.scenarios import find_scenario
from msls_ros.flights.steering import controlled
from msls_ros.inputs.profiles import config_folder
from msls_ros.nodes.control_parameters import PARAMETERS, profile
from msls_ros.nodes.controller import ControllerNode
from msls_ros.nodes.flight import fly
from msls_ros.nodes.parameters import NodeError
from msls_ros.offline.comparison import compare
from msls_ros.offline.recontrol import answer_again
from msls_ros.offline.replay import load
from msls_ros.plant import CONDITIONS, EFFECTORS, STATES, Fault
from msls_ros.testing import Bench

TRIM, TRUTH = still_air(CONDITIONS["high_alpha"])
STEP = 20_000_000


def test_over_dds_and_without_ros_a_law_flies_the_same_to_the_last_bit(tmp_path: Path) -> None:
    scenario = find_scenario("nozzle_hard_over")
    faults = (Fault("nozzle_pitch", 1.5, 0.0, bias=-0.087), Fault("left_stabilator", 2.4, 1.0, hard_over=0.1))
    scenario = replace(scenario, duration=3.6, faults=faults, law=replace(scenario.law, latency=1))
    configuration = scenario.configuration("low", 5, dither=True)
    record = fly(scenario, configuration, tmp_path / "bag", noise="low", seed=5)
    log = fly_without_ros(configuration, scenario.flight("low", 5), sparse=True)
    found = compare(record.bag, configuration, scenario.watch, scenario.airframe)
    assert record.time_outs == 0 and not record.refused and not log.departed
    assert len(log.time) == record.samples - 1
    assert np.array_equal(np.array(log.delta), found.delta[: len(log.time)])
    assert log.statuses[-1].stuck.tolist().index(True) == 0
    assert scenario.law.plan is not None
    flown = dict(load(record.bag).topic("command"))
    stamps, commands, statuses = answer_again(record.bag, controlled(TRIM, TRUTH), scenario.law.plan.settings)
    assert len(stamps) == record.samples
    assert all(np.array_equal(flown[stamp].delta, one) for stamp, one in zip(stamps, commands, strict=True))
    assert [one.law for one in statuses[: len(log.statuses)]] == [one.law for one in log.statuses]


class Hand:
    """A controller on the bench, fed by hand."""

    def __init__(self, bench: Bench, **parameters: Any) -> None:
        self.bench = bench
        self.node = bench.add(ControllerNode, **{"condition": "high_alpha", **parameters})
        for topic, kind in (("command", EffectorCommand), ("control_status", ControlStatus)):
            bench.listen(kind, topic)
        self.k = 0

    def sample(
        self, x: Any = None, *, measured: bool = True, asked: bool = True, delta: Any = TRIM.delta
    ) -> ControlStatus:
        """Feed a sample at trim, with what the pilot asks; return the status that answers it."""
        self.k += 1
        stamp, x = self.k * STEP, TRIM.x if x is None else x
        if asked:
            message = messages.pilot_command_message(stamp, EFFECTORS, Asked(0.0, TRIM.alpha, stack=TRIM.delta))
            self.bench.publish("pilot_command", message)
            self.bench.spin_until(lambda: self.node._command_at > 0, "a pilot_command")
        xdot = np.zeros(9) if measured else np.zeros(0)
        self.bench.publish("state", messages.state_message(stamp, STATES, x, xdot))
        self.bench.publish("effectors", messages.effector_message(stamp, EFFECTORS, delta))
        said = self.bench.heard["control_status"]
        self.bench.spin_until(lambda: bool(said) and messages.stamp_of(said[-1]) == stamp, "a status")
        return said[-1]


def test_what_is_missing_is_done_without_and_said() -> None:
    with Bench() as bench:
        hand = Hand(bench)
        first = hand.sample(asked=False)
        assert first.law == "hold" and first.reason.startswith("there is no command that can be followed")
        assert hand.sample().law == "indi"
        assert "accelerations are derived" in hand.sample(measured=False).reason
        stranger = messages.truth_message(hand.k * STEP, STATES, EFFECTORS, TRUTH.a, np.nan * TRUTH.b, TRUTH.bias)
        bench.publish("model", stranger)
        bench.spin_until(lambda: hand.node._model is not None, "the stranger's model")
        for _ in range(12):
            after = hand.sample()
        assert after.law == "indi" and after.reason == "no model yet"
        assert np.isfinite(bench.heard["command"][-1].delta).all()
        assert np.degrees(np.abs(np.array(bench.heard["command"][-1].delta) - TRIM.delta)).max() < 1.0
        bench.spin_until(lambda: bench.heard["control_status"][-1].law == "hold", "the last trim")
        assert "no sample for" in bench.heard["control_status"][-1].reason


def test_dithers_that_come_before_or_after_their_sample_leave_no_surface_stuck() -> None:
    random = np.random.default_rng(6)
    place, target, answer = TRIM.delta.copy(), TRIM.delta, -math.expm1(-20.0 * 0.02)
    with Bench() as bench:
        hand = Hand(bench)
        for k in range(100):
            early, dither = bool(random.integers(2)), np.radians(0.5) * random.standard_normal(len(EFFECTORS))
            message = messages.effector_message((hand.k + 1) * STEP, EFFECTORS, dither)
            sent = DitherCommand(header=message.header, effectors=message.effectors, delta=message.delta)
            if early:
                bench.publish("dither", sent)
                bench.spin_until(lambda: (hand.k + 1) * STEP in hand.node._dithers, "the dither")
            status = hand.sample(delta=place)
            if not early:
                bench.publish("dither", sent)
                bench.spin_until(lambda: hand.k * STEP in hand.node._dithers, "the dither")
            place = place + answer * (target - place)
            target = np.array(bench.heard["command"][-1].delta) + dither  # answers reach the actuators a sample later
            assert not any(status.stuck), k


def test_the_law_changes_in_flight_and_nothing_else_does() -> None:
    with Bench() as bench:
        hand = Hand(bench)

        def changed(name: str, value: Any) -> bool:
            return bool(hand.node.set_parameters([Parameter(name, value=value)])[0].successful)

        assert hand.sample().law == "indi"
        assert changed("law", "fixed") and hand.sample().law == "fixed"
        assert changed("law", "lq") and hand.sample().law == "lq"
        assert not changed("law", "best") and not changed("caution", 1.0)
        hand.node.trigger_deactivate()
        count = hand.node.answered
        bench.publish("state", messages.state_message((hand.k + 1) * STEP, STATES, TRIM.x, np.zeros(9)))
        assert hand.node.answered == count


def test_wrong_parameters_are_refused_with_what_would_be_right(capfd: pytest.CaptureFixture[str]) -> None:
    cases: list[tuple[dict[str, Any], str]] = [
        ({"law": "best"}, "one of fixed, indi, lq, auto"),
        ({"caution": -1.0}, "0 to 100"),
        ({"weights": [1.0, 2.0]}, "'weights' has 2 values; expected 3"),
    ]
    with Bench() as bench:
        for given, text in cases:
            with pytest.raises(NodeError, match=text):
                bench.add(ControllerNode, **given)
        for given, text in (
            ({"aircraft": ""}, "expected own.effectors"),
            ({"prior": "file", "prior_file": "nowhere.yaml"}, "'nowhere.yaml' cannot be read"),
        ):
            with pytest.raises(NodeError, match="could not be configured"):
                bench.add(ControllerNode, **given)
            assert text in capfd.readouterr().err


def test_an_own_aircraft_is_flown_from_lists_without_a_prior() -> None:
    own = {
        "own__effectors": ["de", "da", "dr"],
        **{f"own__{name}": [value] * 3 for name, value in (("low", -0.3), ("high", 0.3))},
        **{f"own__{name}": [value] * 3 for name, value in (("rate_limit", 1.0), ("bandwidth", 20.0))},
    }
    with Bench() as bench:
        node = bench.add(ControllerNode, aircraft="", prior="none", **own)
        assert node._aircraft.surfaces == ("de", "da", "dr") and node._aircraft.prior is None


def test_the_shipped_file_is_the_manual() -> None:
    path = config_folder() / "control" / "controller.yaml"
    assert path.read_text() == profile()
    given = yaml.safe_load(profile())["/**"]["ros__parameters"]
    flat = {f"own.{k}": v for k, v in given.pop("own").items()} | given
    assert set(flat) == set(PARAMETERS)
    assert math.isclose(flat["caution"], PARAMETERS["caution"][0])
