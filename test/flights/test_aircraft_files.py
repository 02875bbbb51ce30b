"""Aircraft as data: what ships is read, the F-16/MATV is the plant's, and what is wrong is said in a sentence."""

from __future__ import annotations

import pickle
import shutil
from pathlib import Path

import jsbsim
import numpy as np
import pytest
import yaml

from msls_ros.commands import demo
from msls_ros.flights.aircraft_files import KEYS, OWN_KEYS, SURFACE, find_aircraft, shipped_aircraft
from msls_ros.flights.closed_loop import fly
from msls_ros.flights.scenario_yaml import ScenarioError
from msls_ros.flights.scenarios import find_scenario
from msls_ros.inputs.profiles import config_folder, read_profile
from msls_ros.plant import CONDITIONS, F16_MATV, Aircraft, PlantError, digest_of

FOLDER = config_folder() / "aircraft"
FAULTS = {
    "c172x_elevator_half": 0.5,
    "A4_aileron_half": 0.5,
    "T37_rudder_lost": 0.0,
    "J3Cub_elevator_half": 0.5,
}


def test_the_aircraft_of_the_issue_ship_and_the_f16_comes_first() -> None:
    assert shipped_aircraft()[0] == "f16_matv"
    assert {"c172x", "A4", "J3Cub", "T37"} <= set(shipped_aircraft())


def test_the_file_of_the_f16_says_what_the_plant_has() -> None:
    found = find_aircraft("f16_matv")
    assert found.airframe is F16_MATV
    assert {one.name: one for one in found.conditions} == dict(CONDITIONS)
    assert tuple(yaml.safe_load((FOLDER / "f16_matv.yaml").read_text())) == OWN_KEYS


def test_the_manual_has_every_key() -> None:
    manual = yaml.safe_load((FOLDER / "c172x.yaml").read_text())
    assert set(manual) == set(KEYS)
    assert tuple(manual["surfaces"]["elevator"]) == SURFACE


@pytest.mark.parametrize("name", shipped_aircraft())
def test_every_shipped_aircraft_has_a_profile_with_its_limits(name: str) -> None:
    airframe = find_aircraft(name).airframe
    profile = read_profile("f16" if name == "f16_matv" else name)
    assert profile.effectors == airframe.effectors
    np.testing.assert_allclose(profile.dither.position_low, [one.low for one in airframe.actuators], atol=1e-4)
    np.testing.assert_allclose(profile.dither.rate_limit, [one.rate_limit for one in airframe.actuators], rtol=1e-4)
    if name != "f16_matv":
        trim = Aircraft(find_aircraft(name).condition("")).trim
        assert profile.reference_speed == pytest.approx(trim.airspeed, rel=0.01)
        assert (profile.dither.pilot_forward, profile.dither.pilot_above) == airframe.station
    assert pickle.loads(pickle.dumps(airframe)) == airframe


@pytest.mark.parametrize("name", FAULTS)
def test_the_fault_of_every_aircraft_is_felt_as_it_is_written_and_seen(name: str) -> None:
    scenario = find_scenario(name)
    watch = scenario.watch
    configuration = scenario.configuration("low", 1, True)
    log = fly(configuration, scenario.flight("low", 1), follow=(watch.row, watch.column), sparse=True)
    truth = log.truth(lambda one: watch.of(one.a, one.b))
    start = scenario.fault_start
    assert start is not None
    time = np.array(log.time)
    before, after = truth[time <= start][-1], truth[time > start + 0.05][0]
    assert after == pytest.approx(FAULTS[name] * before, abs=0.05 * abs(before))
    assert log.followed[-1] == pytest.approx(truth[-1], abs=0.1 * abs(before))
    seen = [alarm for alarm in log.alarms() if alarm > start]
    assert seen
    assert len(log.alarms()) - len(seen) <= 1
    assert np.isfinite(np.array(log.x)).all() and np.degrees(np.abs(np.array(log.x)[:, 7])).max() < 45.0


def own(folder: Path, *changes: tuple[str, str]) -> Path:
    """The manual as a user's own file, with changes in its text."""
    text = (FOLDER / "c172x.yaml").read_text()
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new)
    path = folder / "mine.yaml"
    path.write_text(text)
    return path


def test_a_user_s_own_model_flies_from_its_own_folder(tmp_path: Path) -> None:
    source = Path(jsbsim.get_default_root_dir()) / "aircraft" / "c172x"
    shutil.copytree(source, tmp_path / "plane")
    (tmp_path / "plane" / "c172x.xml").rename(tmp_path / "plane" / "plane.xml")
    found = find_aircraft(own(tmp_path, ("model: c172x", "model: plane/plane.xml")))
    aircraft, shipped = Aircraft(found.condition("")), Aircraft(find_aircraft("c172x").condition(""))
    np.testing.assert_allclose(aircraft.truth().b, shipped.truth().b, rtol=1e-9, atol=1e-9)
    before = digest_of(found.airframe)
    (tmp_path / "plane" / "plane.xml").write_text((tmp_path / "plane" / "plane.xml").read_text() + "<!-- lighter -->")
    assert digest_of(found.airframe) != before  # a campaign flies it anew
    assert not digest_of(find_aircraft("c172x").airframe)


WRONG = {
    "a key misspelt": (("pulse: 0.8", "puls: 0.8"), "puls is unknown; expected 'pulse'"),
    "no such model file": (("model: c172x", "model: mine.xml"), "model is 'mine.xml'"),
    "limits reversed": (("high: 0.4014", "high: -0.6"), "surfaces.elevator.high is -0.6; expected more than low"),
    "a unit that is none": (("unit: rad", "unit: mrad"), "surfaces.elevator.unit is 'mrad'; expected rad, deg"),
    "a sign that is none": (("sign: 1", "sign: 0.5"), "surfaces.elevator.sign is 0.5; expected 1 or -1"),
    "a surface that is not there": (
        ("{rudder: 1.0}", "{ruder: 1.0}"),
        "effectors.dr.ruder is unknown; expected 'rudder'",
    ),
    "an axis that is not there": (("yaw: dr}", "yaw: dx}"), "axes.yaw is 'dx'; expected one of de, da, dr"),
    "effectors alike": (("dr: {rudder: 1.0}", "dr: {aileron: 1.0}"), "two effectors move the surfaces alike"),
    "two speeds": (("airspeed: 51.4444", "airspeed: 51.4444\n    mach: 0.2"), "conditions.cruise.airspeed and mach"),
    "a gain misspelt": (("theta: 0.25", "thetta: 0.25"), "pilot.thetta is unknown; expected 'theta'"),
    "a number as a word": (("altitude: 1219.2", "altitude: high"), "conditions.cruise.altitude is 'high'"),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_is_wrong_is_refused_with_file_key_found_and_expected(case: str, tmp_path: Path) -> None:
    change, expected = WRONG[case]
    path = own(tmp_path, change)
    with pytest.raises(ScenarioError) as caught:
        find_aircraft(path)
    assert str(caught.value).startswith(f"aircraft file '{path}'")
    assert expected in str(caught.value) and "\n" not in str(caught.value)


def test_an_aircraft_that_is_not_there_gets_the_nearest_name() -> None:
    with pytest.raises(ScenarioError, match="aircraft 'c172' does not exist; expected 'c172x'"):
        find_aircraft("c172")


SCENARIO = """
description: mine
aircraft: mine.yaml
manoeuvre: [quiet 1, elevator_3211 4]
duration: 5.0
identifier:
  profile: c172x
"""
REFUSED = {
    "does not trim": (("airspeed: 51.4444", "airspeed: 9.0"), "", "no trim for cruise of mine"),
    "property misspelt": (("position: fcs/rudder-pos-rad", "position: fcs/ruder-pos-rad"), "", "'fcs/ruder-pos-rad'"),
    "property set that is not there": (
        ("properties: {}", "properties: {fcs/flap-cmd-nrm: 0.0}"),
        "",
        "fcs/flap-cmd-nrm",
    ),
    "rate too low": (("rate: 50", "rate: 200"), "", "rates.flight_dynamics is 100 Hz; expected at least 200"),
    "profile of another": (("pulse: 0.8", "pulse: 0.8"), "f16", "expected those of the plant"),
    "manoeuvre misspelt": (("pulse: 0.8", "pulse: 0.8"), "elevator_3121", "'elevator_3211'"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_the_demo_refuses_in_one_sentence_with_exit_code_2(
    case: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    change, other, expected = REFUSED[case]
    own(tmp_path, change)
    text = SCENARIO
    if other.startswith("f16"):
        text = text.replace("profile: c172x", f"profile: {other}")
    elif other:
        text = text.replace("elevator_3211", other)
    path = tmp_path / "flight.yaml"
    path.write_text(text)
    assert demo.main(["--scenario", str(path), "--out", str(tmp_path / "out")]) == 2
    said = [line for line in capfd.readouterr().err.splitlines() if line.startswith("demo: ")]
    assert len(said) == 1 and expected in said[0]


def test_a_flight_that_diverges_names_the_rate_as_a_cause() -> None:
    aircraft = Aircraft(find_aircraft("c172x").condition(""))
    with pytest.raises(PlantError, match="diverged"):
        for _ in range(100_000):
            aircraft.step([0.3 if aircraft.time % 2.0 < 1.0 else -0.3, 0.2, 0.2])
            if aircraft.time > 1.0:
                aircraft._psi = float("nan")
