"""Scenarios as files: what ships is read, own files too; what is wrong is refused with file, key, found, expected."""

from __future__ import annotations

import dataclasses
import pickle
import shutil
from pathlib import Path

import pytest
import yaml

from msls_ros.commands import demo
from msls_ros.estimation import EstimationError
from msls_ros.flights.closed_loop import Rates
from msls_ros.flights.scenarios import (
    FAULT,
    IDENTIFIER,
    KEYS,
    RATES,
    Scenario,
    ScenarioError,
    find_scenario,
    shipped,
    shipped_names,
)
from msls_ros.flights.watch import Watch
from msls_ros.inputs import profiles
from msls_ros.inputs.profiles import config_folder, profile_path, read_profile
from msls_ros.plant import NOISE_LEVELS, Fault, PlantError

FOLDER = config_folder() / "scenarios"
PAPER = ("roll_doublet_tail_fault", "roll_doublet")
LOSS = Fault("left_stabilator", 4.0, 0.0)
GOOD = """\
description: a flight
condition: high_alpha
manoeuvre: roll_doublet
duration: 12.0
faults:
  - {effector: left_stabilator, time: 4.0, effectiveness: 0.0}
  - {effector: rudder, time: 5, effectiveness: 0.5, ramp: 2.0}
identifier:
  profile: f16
"""


def write(folder: Path, text: str, name: str = "mine.yaml") -> Path:
    file = folder / name
    file.write_text(text)
    return file


@pytest.mark.parametrize("name", shipped_names())
def test_every_shipped_scenario_is_read_and_has_an_identifier_for_each_noise(name: str) -> None:
    scenario = find_scenario(name)
    assert scenario.name == name
    for noise in NOISE_LEVELS:
        configuration = scenario.configuration(noise, 7, dither=False)
        assert (configuration.dither.seed, configuration.dither.enabled) == (7, False)
        assert configuration.sample_rate == scenario.rates.sensors
        assert scenario.flight(noise, 7).faults == scenario.faults_of(7)
    assert pickle.loads(pickle.dumps(scenario)) == scenario


def test_the_paper_s_scenarios_come_first() -> None:
    assert shipped_names()[:2] == PAPER
    assert list(shipped()) == list(shipped_names())
    assert {"cruise_tail_fault", "half_loss", "ramp_loss", "nozzle_failure", "turbulence", "strong"} <= set(shipped())


@pytest.mark.parametrize(
    ("name", "condition", "profile", "faults"),
    [
        ("roll_doublet_tail_fault", "high_alpha", "f16", (LOSS,)),
        ("roll_doublet", "high_alpha", "f16", ()),
        ("cruise_tail_fault", "cruise", "f16", (LOSS,)),
    ],
)
def test_the_recorded_flights_are_flown_as_before(
    name: str, condition: str, profile: str, faults: tuple[Fault, ...]
) -> None:
    found = find_scenario(name)
    expected = Scenario(name, found.description, condition, "roll_doublet", 12.0, profile, faults=faults)
    assert found == expected
    for noise in ("none", "low", "med"):
        assert found.configuration(noise, 3, dither=True) == read_profile(profile).replace({"dither.seed": 3})


def test_no_scenario_that_ships_sets_anything_but_dither_and_nothing_by_noise() -> None:
    for scenario in shipped().values():
        assert read_profile(scenario.profile).estimator.method == "bank"
        settings = [scenario.parameters.get(noise, {}) for noise in ("none", "low", "med")]
        assert settings[0] == settings[1] == settings[2]
        assert all(name.startswith("dither.") for name in settings[0])


def test_what_stands_beside_a_noise_holds_at_every_noise_and_what_stands_below_it_goes_first(tmp_path: Path) -> None:
    parameters = "{estimator.method: msls, estimator: {penalty: 0.25}, low: {estimator.penalty: 0.5}}"
    scenario = find_scenario(str(write(tmp_path, GOOD + f"  parameters: {parameters}\n")))
    for noise, penalty in (("none", 0.25), ("low", 0.5), ("med", 0.25)):
        estimator = scenario.configuration(noise, 0, True).estimator
        assert (estimator.method, estimator.penalty) == ("msls", penalty)


def test_the_manual_has_every_key() -> None:
    manual = yaml.safe_load((FOLDER / "roll_doublet_tail_fault.yaml").read_text())
    assert tuple(manual) == KEYS
    assert tuple(manual["rates"]) == RATES
    assert tuple(manual["faults"][0]) == FAULT
    assert tuple(manual["identifier"]) == IDENTIFIER
    assert dataclasses.asdict(Rates()) == manual["rates"]


def test_an_own_file_with_a_profile_beside_it_is_read_from_anywhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "own" / "profiles").mkdir(parents=True)
    shutil.copy(profile_path("f16"), tmp_path / "own" / "profiles" / "fast.yaml")
    text = GOOD.replace("profile: f16", "profile: profiles/fast.yaml")
    file = write(tmp_path / "own", text + "  parameters: {low: {estimator: {penalty: 0.5}}}\n")
    monkeypatch.chdir(tmp_path)
    scenario = find_scenario("own/mine.yaml")
    monkeypatch.chdir(file.parent)
    assert (scenario.name, scenario.description, scenario.watch) == ("mine", "a flight", Watch("P", "ddt"))
    assert scenario.configuration("med", 0, True).reference_speed == read_profile("f16").reference_speed
    assert scenario.configuration("low", 0, True).estimator.penalty == 0.5
    assert scenario.faults == (LOSS, Fault("rudder", 5.0, 0.5, 2.0))
    assert scenario.fault_spans == ((4.0, 4.0), (5.0, 7.0))
    assert (scenario.fault_start, scenario.fault_end) == (4.0, 7.0)


def test_scenarios_are_no_parameter_files_and_are_not_rewritten(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(EstimationError, match="does not exist") as caught:
        read_profile("ramp_loss")
    assert not set(shipped_names()) & set(str(caught.value).replace(",", " ").split())
    shutil.copytree(config_folder(), tmp_path / "config")
    monkeypatch.setattr(profiles, "config_folder", lambda: tmp_path / "config")
    profiles.refresh()
    for path in FOLDER.glob("*.yaml"):
        assert (tmp_path / "config" / "scenarios" / path.name).read_bytes() == path.read_bytes()


LAST = "{effector: rudder, time: 5, effectiveness: 0.5, ramp: 2.0}"
WRONG: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "a missing key": ("manoeuvre: roll_doublet\n", "", ("manoeuvre is missing", "one of roll_doublet")),
    "a misspelt key": ("manoeuvre:", "maneuver:", ("maneuver is unknown", "'manoeuvre'")),
    "an unknown key": ("duration:", "wind: 3\nduration:", ("wind is unknown", "one of description")),
    "a number as a key": ("duration:", "3: 3\nduration:", ("3 is unknown", "description")),
    "a key twice": ("duration: 12.0", "duration: 12.0\nduration: 13.0", ("duration stands in line 4 and in line 5",)),
    "a fault's key twice": (LAST, LAST[:-1] + ", time: 6}", ("faults[1].time stands in line 7 and in line 7",)),
    "an unknown condition": ("high_alpha\nm", "high_alfa\nm", ("condition is 'high_alfa'", "'high_alpha', or another")),
    "an unknown manoeuvre": ("roll_doublet", "loop", ("manoeuvre is 'loop'", "one of roll_doublet, steady, strong")),
    "an empty description": ("a flight", "''", ("description is ''", "one line of text")),
    "a description of two lines": ("a flight", "|\n  a\n  flight", ("description is 'a", "one line of text")),
    "a duration of words": ("12.0", "long", ("duration is 'long'", "a number from 0.1 to 36000 s")),
    "a duration that is true": ("12.0", "true", ("duration is true", "a number from 0.1")),
    "a flight of five samples": (
        "12.0\nfaults:",
        "5.0\nrates: {sensors: 1, truth: 1}\nfaults:",
        ("duration is 5 s", "at least 10 samples, 10 s at 1 Hz"),
    ),
    "a fault that no sample feels": ("time: 5,", "time: 11.99,", ("faults[1].time is 11.99 s", "11.96 s or less")),
    "a parameter in two spellings": (
        "  profile: f16\n",
        "  profile: f16\n  parameters: {low: {estimator: {penalty: 1.0e-3}, estimator.penalty: 2.0e-3}}\n",
        ("identifier.parameters.low.estimator.penalty stands there twice", "expected once"),
    ),
    "the plant's states as a parameter": (
        "  profile: f16\n",
        "  profile: f16\n  parameters: {low: {states: [P]}}\n",
        ("identifier.parameters.low.states is", "the plant gives it"),
    ),
    "what YAML itself cannot make": ("12.0", "!!timestamp 99", ("is not YAML",)),
    "an anchor within itself": ("a flight", "&a [*a]", ("nested without end",)),
    "no duration": ("12.0", "", ("duration is empty", "a number from 0.1")),
    "a duration that is not a number": ("12.0", ".nan", ("duration is nan", "a number from 0.1")),
    "an endless duration": ("12.0", ".inf", ("duration is inf", "to 36000 s")),
    "a number that YAML takes for a word": ("12.0", "12e0", ("duration is the word '12e0'", "1.0e-3, not 1e-3")),
    "an unknown noise": ("faults:", "noise: loud\nfaults:", ("noise is 'loud'", "one of none, low, med")),
    "an unknown turbulence": ("faults:", "turbulence: mild\nfaults:", ("turbulence is 'mild'", "moderate")),
    "rates that are a number": ("faults:", "rates: 50\nfaults:", ("rates is 50", "a section of keys")),
    "an unknown rate": ("faults:", "rates: {sensor: 50}\nfaults:", ("rates.sensor is unknown", "'sensors'")),
    "sensors that do not divide": (
        "faults:",
        "rates: {sensors: 40}\nfaults:",
        ("rates.sensors is 40 Hz", "a divisor of flight_dynamics, 100 Hz"),
    ),
    "a truth that does not divide": (
        "faults:",
        "rates: {truth: 20}\nfaults:",
        ("rates.truth is 20 Hz", "a divisor of sensors, 50 Hz"),
    ),
    "half a sample": ("faults:", "rates: {sensors: 12.5}\nfaults:", ("rates.sensors is 12.5", "a whole number")),
    "slow flight dynamics": (
        "faults:",
        "rates: {flight_dynamics: 10, sensors: 10}\nfaults:",
        ("rates.flight_dynamics is 10 Hz", "from 50 to 1000"),
    ),
    "faults that are a word": (
        GOOD[GOOD.index("faults:") : GOOD.index("ident")],
        "faults: all\n",
        ("faults is 'all'",),
    ),
    "a fault that is a word": (LAST, "rudder", ("faults[1] is 'rudder'", "a section of keys")),
    "a fault without a time": (LAST, "{effector: dr, effectiveness: 0}", ("faults[1].time is missing", "a number")),
    "a fault of no effector": (
        LAST,
        "{effector: ruder, time: 5, effectiveness: 0}",
        ("faults[1].effector is 'ruder'", "'rudder'"),
    ),
    "too much left": (LAST, LAST.replace("0.5", "1.5"), ("faults[1].effectiveness is 1.5", "from 0 to 1")),
    "a ramp back in time": (LAST, LAST.replace("ramp: 2.0", "ramp: -1"), ("faults[1].ramp is -1", "from 0 to 3600 s")),
    "a word for stuck": (LAST, LAST.replace("ramp: 2.0", "stuck: 1"), ("faults[1].stuck is 1", "true or false")),
    "a bias beyond the travel": (LAST, LAST.replace("ramp: 2.0", "bias: 0.9"), ("faults[1].bias is 0.9 rad", "within")),
    "a fault after the end": (
        LAST,
        LAST.replace("5", "12"),
        ("faults[1].time is 12 s", "duration of the flight, 12 s"),
    ),
    "faults out of order": (
        LAST,
        LAST.replace("5", "3", 1),
        ("faults[1].time is 3 s", "no earlier than faults[0], 4 s"),
    ),
    "a surface broken twice at once": (
        LAST,
        "{effector: ddt, time: 4, effectiveness: 0.5}",
        ("faults[1].effector is 'ddt' at 4 s", "one fault on left_stabilator at a time, faults[0]"),
    ),
    "a parameter that does not exist to be watched": (
        "faults:",
        "watch: P/flap\nfaults:",
        ("watch is 'P/flap'", "ROW/COLUMN such as P/ddt"),
    ),
    "an equation without parameters": ("faults:", "watch: Phi/ddt\nfaults:", ("watch is 'Phi/ddt'", "u v w P Q R")),
    "no profile": ("  profile: f16\n", "  parameters: {}\n", ("identifier.profile is missing", "shipped")),
    "an unknown profile": ("f16", "f17", ("identifier.profile", "'f17' does not exist", "f16")),
    "a profile that is not there": ("f16", "own.yaml", ("identifier.profile", "own.yaml", "cannot be read")),
    "a profile of another aircraft": (
        "f16",
        "odometry_jointstate",
        ("identifier.profile has", "da", "those of the plant"),
    ),
    "parameters of an unknown noise": (
        "f16",
        "f16\n  parameters: {high: {}}",
        ("identifier.parameters.high is unknown", "a parameter of the identifier, or a noise"),
    ),
    "an unknown parameter": (
        "f16",
        "f16\n  parameters: {low: {estimator.penality: 1}}",
        ("identifier.parameters.low.estimator.penality is unknown", "'estimator.penalty'"),
    ),
    "a parameter out of range": (
        "f16",
        "f16\n  parameters: {low: {estimator.penalty: -1}}",
        ("identifier.parameters.low.estimator.penalty", "is -1", "[0, 1000]"),
    ),
    "a parameter that the rates give": (
        "f16",
        "f16\n  parameters: {low: {sample_rate: 25}}",
        ("identifier.parameters.low.sample_rate is 25", "rates.sensors"),
    ),
    "no YAML": ("faults:", "faults: [", ("is not YAML", "line")),
    "a list": (GOOD, "- a\n- b\n", ("is a list", "a section of keys")),
    "nothing": (GOOD, "", ("is empty", "a section of keys")),
}


@pytest.mark.parametrize("what", WRONG)
def test_what_is_wrong_is_refused_with_file_key_found_and_expected(what: str, tmp_path: Path) -> None:
    old, new, words = WRONG[what]
    assert old in GOOD
    file = write(tmp_path, GOOD.replace(old, new, 1))
    with pytest.raises(ScenarioError) as caught:
        find_scenario(file)
    sentence = str(caught.value)
    assert sentence.startswith(f"scenario file '{file}'")
    assert "\n" not in sentence
    for word in words:
        assert word in sentence
    read_good = find_scenario(write(tmp_path, GOOD))
    assert len(read_good.faults) == 2


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("ramp_los", ("'ramp_los' does not exist", "'ramp_loss'", "roll_doublet_tail_fault")),
        ("moon", ("'moon' does not exist", *shipped_names(), "a .yaml file")),
        ("nowhere/mine.yaml", ("nowhere/mine.yaml", "cannot be read", "No such file")),
        ("", ("'' does not exist", ".yaml")),
    ],
)
def test_a_scenario_that_is_not_there_is_refused(name: str, words: tuple[str, ...]) -> None:
    with pytest.raises(ScenarioError) as caught:
        find_scenario(name)
    for word in words:
        assert word in str(caught.value)


def test_the_demo_refuses_a_wrong_file_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = write(tmp_path, GOOD.replace("12.0", "3.0"))
    assert demo.main(["--scenario", str(file), "--out", str(tmp_path / "out")]) == 2
    err = capsys.readouterr().err.splitlines()
    assert err == [
        f"demo: scenario file '{file}': faults[0].time is 4 s; expected less than the duration of the flight, 3 s"
    ]
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "fault",
    [LOSS, Fault("ddt", 0.1, 1 / 3, 2.5, True, -0.01), Fault("nozzle_yaw", 1e-3, 1.0, stuck=True, bias=1e-7)],
    ids=lambda fault: fault.effector,
)
def test_a_fault_written_as_a_line_is_read_back(fault: Fault) -> None:
    assert Fault.parse(str(fault)) == fault


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("rudder time=4", "has no effectiveness"),
        ("rudder effectiveness=0", "has no time"),
        ("rudder time=4 effectiveness=0 ramp", "'ramp': expected a number"),
        ("rudder time=4 effectiveness=0 stuck=yes", "'stuck=yes': expected stuck=true or stuck=false"),
        ("rudder time=4 effectiveness=0 wind=3", "'wind=3' stands in the fault"),
        ("rudder time=4 effectiveness=0 time=5", "'time=5' stands again in the fault"),
        ("rudder time=nan effectiveness=0", "time nan s: expected a number from 0"),
        ("wing time=4 effectiveness=0", "effector 'wing': expected one of left_stabilator"),
        ("", "has no time; expected EFFECTOR time="),
    ],
)
def test_a_line_that_is_no_fault_is_refused(line: str, expected: str) -> None:
    with pytest.raises(PlantError) as caught:
        Fault.parse(line)
    assert expected in str(caught.value)
