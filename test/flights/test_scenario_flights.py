"""Scenarios flown: faults at their time, the same over DDS and without ROS, truth that bends with a ramp, the demo."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from msls_ros.commands import demo
from msls_ros.flights.closed_loop import Flight, Rates
from msls_ros.flights.closed_loop import fly as fly_without_ros
from msls_ros.flights.scenarios import Scenario, find_scenario
from msls_ros.flights.watch import Watch
from msls_ros.nodes.flight import fly
from msls_ros.offline.replay import load
from msls_ros.plant import EFFECTORS, STATES, Fault, FaultSchedule, PlantError


def test_a_fault_strikes_after_the_first_sample_that_is_not_earlier_and_turns_the_truth_where_it_bends() -> None:
    class Airframe:
        def __init__(self) -> None:
            self.struck: list[str] = []

        def damage(self, surface_or_effector: str, *_: float, **__: Any) -> str:
            self.struck.append(surface_or_effector)
            return surface_or_effector

    airframe = Airframe()
    faults = (Fault("rudder", 0.0, 0.0), Fault("ddt", 0.041, 0.0, 0.05), Fault("dte", 0.06, 0.0))
    schedule = FaultSchedule(faults, 0.02)
    said = [schedule.strike(sample, airframe) for sample in range(6)]
    assert said == [["rudder"], [], [], ["ddt", "dte"], [], []]
    assert airframe.struck == ["rudder", "ddt", "dte"]
    assert [k for k in range(8) if schedule.turns(k)] == [0, 1, 3, 4, 5, 6]  # the ramp ends at 5.5 samples


GUSTY = Scenario(
    "gusty",
    "everything at once",
    "high_alpha",
    "strong",
    3.0,
    "f16",
    "low",
    "moderate",
    Rates(flight_dynamics=200, sensors=40, truth=10),
    (
        Fault("left_stabilator", 1.01, 0.25, ramp=1.04, bias=0.01),
        Fault("nozzle_yaw", 1.5, 0.5, stuck=True),
    ),
    Watch("Q", "de"),
)


def test_over_dds_and_without_ros_a_flight_is_the_same_to_the_last_bit(tmp_path: Path) -> None:
    configuration = GUSTY.configuration("low", 4, dither=True)
    log = fly_without_ros(configuration, GUSTY.flight("low", 4))
    record = fly(GUSTY, configuration, tmp_path / "bag", noise="low", seed=4)
    flown = load(record.bag)
    assert (record.samples, len(log.time), dict(record.refused)) == (121, 120, {})
    assert [t for t, _ in flown.topic("state")][:120] == [round(t * 1e9) for t in log.time]
    for topic, field, ours in (
        ("state", "x", log.x),
        ("state", "xdot", log.xdot),
        ("effectors", "delta", log.delta),
        ("dither", "delta", [e.dither.delta for e in log.estimates]),
        ("model", "a", [e.a.ravel() for e in log.estimates]),
        ("model", "b", [e.b.ravel() for e in log.estimates]),
    ):
        theirs = [getattr(m, field) for _, m in flown.topic(topic)][:120]
        np.testing.assert_array_equal(theirs, ours, err_msg=f"{topic}.{field}")
    truths = {round(t * 1e-9 * 40): m for t, m in flown.topic("truth/model") if t < 3_000_000_000}
    assert list(truths) == list(log.truths)
    assert {41, 42, 60, 61, 82, 83} <= set(truths)  # strikes at 1.025 s and ends 1.04 s later
    for k, truth in log.truths.items():
        np.testing.assert_array_equal(truths[k].b, truth.b.ravel())


def test_the_truth_of_a_ramp_bends_where_it_begins_and_ends_and_is_straight_between() -> None:
    fault = Fault("left_stabilator", 0.21, 0.0, ramp=0.3)
    flight = Flight("none", 0, 0.8, faults=(fault,), rates=Rates(truth=1))
    log = fly_without_ros(find_scenario("roll_doublet").configuration("none", 0, True), flight)
    left = log.truth(lambda one: one.b)[:, STATES.index("P"), EFFECTORS.index("ddt")]
    left /= left[0]
    time = np.array(log.time)
    assert sorted(log.truths) == [0, 11, 12, 26]
    expected = 1.0 - 0.5 * np.clip((time - 0.22) / 0.3, 0.0, 1.0)
    np.testing.assert_allclose(left, expected, atol=0.01)
    assert left[26] == pytest.approx(0.5, abs=0.01)


@pytest.mark.parametrize(
    ("field", "value"), [("sensors", 30), ("sensors", True), ("truth", 0), ("flight_dynamics", 2000)]
)
def test_rates_that_do_not_go_together_are_refused(field: str, value: Any) -> None:
    with pytest.raises(PlantError, match=rf"^{field} .*: expected"):
        Rates(**{field: value})


@pytest.mark.parametrize(
    ("text", "symbol", "unit"),
    [("P/ddt", "b43", "1/s²"), ("R/dtr", "b67", "1/s²"), ("P/w", "a43", "rad/(m s)"), ("w/Q", "a35", "m/s")],
)
def test_a_watched_parameter_is_named_as_the_paper_does(text: str, symbol: str, unit: str) -> None:
    row, column = text.split("/")
    watch = Watch(row, column)
    assert (watch.symbol, watch.unit) == (symbol, unit)
    a, b = np.arange(81.0).reshape(9, 9), np.arange(63.0).reshape(9, 7) + 100.0
    i, j = int(symbol[1]) - 1, int(symbol[2]) - 1
    assert watch.of(a, b) == (b if symbol[0] == "b" else a)[i, j]


OWN = """\
description: two of them
condition: high_alpha
manoeuvre: steady
duration: 6.0
noise: none
rates: {flight_dynamics: 100, sensors: 100, truth: 20}
faults:
  - {effector: dtr, time: 2.0, effectiveness: 0.25, ramp: 0.5}
  - {effector: left_stabilator, time: 4.0, effectiveness: 0.0, stuck: true}
watch: R/dtr
identifier:
  profile: f16
  parameters: {estimator.method: msls, none: {estimator.penalty: 3.0e-4}}
"""


def test_the_demo_flies_an_own_file_and_judges_it_by_what_it_watches(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "mine.yaml").write_text(OWN)
    assert demo.main(["--scenario", str(tmp_path / "mine.yaml"), "--out", str(tmp_path / "out")]) == 0
    out = capsys.readouterr().out
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert (summary["scenario"], summary["noise"], summary["samples"]) == ("mine", "none", 601)
    assert (summary["description"], summary["watch"]) == ("two of them", "R/dtr")
    b67 = summary["b67"]
    assert b67["truth_after"] == pytest.approx(0.25 * b67["truth_before"], rel=0.02)
    assert b67["truth_before"] < -2.0
    assert b67["msls"]["rms_after"] < 0.02
    assert len(summary["detections"]) == 2
    assert 0.0 < summary["detections"][1]["delay_s"] <= 0.05
    assert (tmp_path / "out" / "b67.png").stat().st_size > 10_000
    for text in ("error of b67", "fault at 2.00 s", "it grows until 2.50 s", "fault at 4.00 s"):
        assert text in out
