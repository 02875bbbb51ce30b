"""Laws flown: what the fixed law loses is kept, also when the identifier is cut off, lies, or the commands are late."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from msls_ros.control import ControlError
from msls_ros.control.controller import Controller
from msls_ros.flights import steering
from msls_ros.flights.closed_loop import FlightLog, fly
from msls_ros.flights.random_failures import KINDS, RandomFailures, describe
from msls_ros.flights.scenario_law import LAW_KEYS, changed_law
from msls_ros.flights.scenarios import Scenario, ScenarioError, find_scenario, read_scenario
from msls_ros.flights.tracking import track
from msls_ros.plant import CONDITIONS, F16_MATV, Aircraft

SEED = 21


def flown(scenario: Scenario, *, dither: bool = True) -> FlightLog:
    configuration = scenario.configuration("low", SEED, dither)
    return fly(configuration, scenario.flight("low", SEED), sparse=True)


def with_law(scenario: Scenario, **changes: object) -> Scenario:
    return replace(scenario, law=changed_law(scenario.law, changes))


def test_what_the_fixed_law_loses_is_kept_by_the_one_that_redesigns_itself() -> None:
    scenario = find_scenario("nozzle_hard_over")
    assert flown(with_law(scenario, law="fixed")).departed.startswith("angle of attack")
    log = flown(scenario)
    t = track(log, 4.0, 0.02)
    assert t.kept and t.alpha_max < math.radians(0.7) and t.roll_rms < math.radians(0.6) and t.recovery_s < 1.5
    effect, std = log.statuses[-1].effectiveness[5], log.statuses[-1].effectiveness_std[5]
    assert abs(effect) < 0.1 + 2.0 * std
    again = flown(scenario)
    assert np.array_equal(log.delta, again.delta)


@pytest.mark.parametrize("law", ["indi", "lq"])
def test_late_commands_and_two_failures_in_a_row_are_flown(law: str) -> None:
    log = flown(with_law(replace(find_scenario("two_failures"), duration=10.0), law=law, latency=2))
    assert not log.departed
    assert not log.statuses[-1].stuck.any()


@pytest.mark.parametrize("what", ["cut", "killed", "nan", "wrong"])
def test_an_identifier_that_is_cut_off_or_lies_costs_no_aircraft(what: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Models cut for 3 s from the failure on; none any more, and no dither; NaN; a B of the wrong sign, sure of it."""
    real: Callable[..., object] = Controller.update

    def told(self: Controller, time: float, x: object, xdot: object, delta: object, *rest: Any) -> object:
        command, model, dither = rest
        if model is not None and time > 4.0:
            if what == "killed" or (what == "cut" and time < 7.0):
                model = None
            elif what == "nan":
                model = replace(model, b=np.nan * model.b)
            elif what == "wrong":
                model = replace(model, b=-model.b, b_std=0.01 * np.abs(model.b))
        return real(self, time, x, xdot, delta, command, model, dither)

    monkeypatch.setattr(Controller, "update", told)
    scenario = replace(find_scenario("tail_hard_over"), duration=10.0)
    log = flown(scenario, dither=what != "killed")
    assert not log.departed
    said = {one.reason for one in log.statuses if one.time > 5.0}
    assert any("disproved" in one if what == "wrong" else "the last believed model" in one for one in said)


def test_a_hard_over_is_measured_where_the_actuator_went_and_shows_as_stuck() -> None:
    log = flown(replace(find_scenario("tail_driven_hard_over"), duration=7.0))
    place = np.array(log.delta)[-1] @ np.array(F16_MATV.mixing).T
    assert place[0] == pytest.approx(math.radians(10.0), abs=math.radians(0.1))
    assert log.statuses[-1].stuck.tolist() == [True, *[False] * 6] and not log.departed
    aircraft = Aircraft(CONDITIONS["high_alpha"])
    aircraft.damage("left_stabilator", 1.0, hard_over=0.2)
    aircraft.damage("left_stabilator", 1.0)
    for _ in range(100):
        aircraft.step(aircraft.trim.delta)
    assert aircraft.sample().delta == pytest.approx(aircraft.trim.delta, abs=1e-6)


def test_a_law_that_knows_nothing_waits_for_the_identifier_and_then_flies() -> None:
    log = flown(replace(find_scenario("learn_to_fly"), duration=9.0))
    laws = [one.law for one in log.statuses]
    assert laws[0] == "hold" and laws[-1] == "indi" and not log.departed
    assert abs(math.degrees(track(log, 5.0, 0.02).roll_rms)) < 2.5


def test_random_failures_are_those_of_the_seed_and_within_what_was_asked() -> None:
    failures = RandomFailures((1, 3), KINDS, 3)
    drawn = [failures.draw(seed, F16_MATV) for seed in range(200)]
    assert drawn == [failures.draw(seed, F16_MATV) for seed in range(200)]
    assert len({describe(one) for one in drawn}) > 150
    assert {len(one) for one in drawn} == {1, 2, 3}
    faults = [fault for one in drawn for fault in one]
    assert all(fault.time == 4.0 for fault in faults)
    assert any(fault.stuck for fault in faults) and any(fault.hard_over is not None for fault in faults)
    assert any(fault.bias for fault in faults) and any(0.0 < fault.effectiveness < 1.0 for fault in faults)


GOOD = """
description: a flight
condition: high_alpha
manoeuvre: roll_doublet
duration: 5.0
law: auto
identifier: {profile: f16}
"""


@pytest.mark.parametrize(
    ("more", "text"),
    [
        ("law: best", "law is 'best'; expected one of fixed, indi, lq, auto"),
        ("control: {caution: -1.0}", "control parameter 'caution' is -1.0; expected 0 to 100"),
        ("control: {cautoin: 1.0}", "'cautoin' does not exist"),
        ("control: {law: lq}", "expected the key law of the scenario itself"),
        ("prior: some", "prior is 'some'; expected one of truth, none"),
        ("latency: 1.5", "latency is 1.5; expected a whole number from 0 to 20 samples"),
        (
            "manoeuvre: [quiet 5]",
            "a list of inputs; expected one of roll_doublet, steady, strong, which law auto flies",
        ),
        ("random_failures: {surfaces: [3, 1]}", "expected fewest and most, from 1 to 7"),
        ("random_failures: {kinds: [bent]}", "expected a list of some of lost, offset, stuck, hard_over"),
    ],
)
def test_a_wrong_key_of_the_law_is_refused_with_what_would_be_right(tmp_path: Path, more: str, text: str) -> None:
    key = more.partition(":")[0]
    lines = [line for line in GOOD.strip().splitlines() if not line.startswith(f"{key}:")]
    file = tmp_path / "mine.yaml"
    file.write_text("\n".join([*lines, more]))
    with pytest.raises((ScenarioError, ControlError), match=text.replace("[", r"\[")):
        read_scenario(file)


def test_the_manual_of_the_law_has_its_keys() -> None:
    folder = Path(__file__).resolve().parents[2] / "config" / "scenarios"
    manual = (folder / "nozzle_hard_over.yaml").read_text() + (folder / "random_failures.yaml").read_text()
    assert all(f"\n{key}:" in manual for key in LAW_KEYS)
    assert find_scenario("nozzle_hard_over").law.plan is not None
    assert find_scenario("roll_doublet").law.law is None
    assert steering.surface_names(F16_MATV) == F16_MATV.surface_names
