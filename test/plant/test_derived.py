"""Any JSBSim aircraft: it flies as the original, its truth is that of the flight, and it breaks as it is told to."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import jsbsim
import numpy as np
import pytest

from msls_ros.flights.aircraft_files import find_aircraft, shipped_aircraft
from msls_ros.plant import STATES, Aircraft, FlightCondition, PlantError

OTHERS = [name for name in shipped_aircraft() if name != "f16_matv"]
BODY = slice(0, 6)


def condition(name: str) -> FlightCondition:
    return find_aircraft(name).condition("")


def fly(aircraft: Aircraft, seconds: float, offset: np.ndarray | float = 0.0) -> None:
    for _ in range(round(seconds * aircraft.rate)):
        aircraft.step(aircraft.trim.delta + offset)


@pytest.mark.parametrize("name", OTHERS)
def test_every_shipped_aircraft_trims_and_stays_there(name: str) -> None:
    aircraft = Aircraft(condition(name))
    assert np.abs(aircraft.sample().xdot[BODY]).max() < 1e-3
    fly(aircraft, 5.0)
    drift = np.abs(aircraft.sample().x - aircraft.trim.x)
    assert drift[:3].max() < 0.1 and drift[3:].max() < 0.01


@pytest.mark.parametrize("name", ["c172x", "A4"])
def test_an_intact_aircraft_without_commands_is_the_original(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # JSBSim's own models write their log where they are loaded
    where = condition(name)
    fdm = jsbsim.FGFDMExec(None)
    fdm.set_debug_level(0)
    fdm.set_dt(0.01)
    root = Path(jsbsim.get_default_root_dir())
    assert fdm.load_model_with_paths(name, str(root / "aircraft"), str(root / "engine"), str(root / "systems"))
    assert where.airspeed is not None
    for key, value in (
        ("propulsion/fuel_freeze", 1.0),
        ("ic/h-sl-ft", where.altitude / 0.3048),
        ("ic/vc-kts", where.airspeed / 0.3048 / (1852.0 / 0.3048 / 3600.0)),
        ("ic/gamma-deg", 0.0),
        *where.properties,
    ):
        fdm.set_property_value(key, value)
    fdm.run_ic()
    fdm.set_property_value("propulsion/set-running", -1)
    fdm.set_property_value("simulation/do_simple_trim", 1)
    aircraft = Aircraft(where)
    for _ in range(300):
        fdm.run()
    fly(aircraft, 3.0)
    axes = ("p", "q", "r")
    rates = np.array([fdm.get_property_value(f"velocities/{axis}-rad_sec") for axis in axes])
    np.testing.assert_allclose(aircraft.sample().x[3:6], rates, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("name", OTHERS)
def test_truth_is_the_difference_of_two_flights_within_two_percent(name: str) -> None:
    """Two flights part at an input: the gap of their derivatives is A and B times that of states and deflections."""
    airframe = condition(name).airframe
    for effector in airframe.effectors:
        offset = np.zeros(len(airframe.effectors))
        offset[airframe.effectors.index(effector)] = 0.01
        one, other = Aircraft(condition(name)), Aircraft(condition(name))
        fly(one, 0.5)
        fly(other, 0.5)
        truth = one.truth()
        fly(one, 0.15)
        fly(other, 0.15, offset)
        a, b = one.sample(), other.sample()
        found = (b.xdot - a.xdot)[BODY]
        expected = (truth.a @ (b.x - a.x) + truth.b @ (b.delta - a.delta))[BODY]
        largest = int(np.argmax(np.abs(found[3:]))) + 3
        assert expected[largest] == pytest.approx(found[largest], rel=0.02), (effector, STATES[largest])


@pytest.mark.parametrize("name", OTHERS)
def test_the_twin_computes_the_derivatives_of_the_flight(name: str) -> None:
    """But for the rates of incidence, which JSBSim's aerodynamics read one step late."""
    aircraft, random = Aircraft(condition(name)), np.random.default_rng(3)
    size = len(aircraft.airframe.effectors)
    seen, off = [], []
    for k in range(150):
        fly(aircraft, 0.02, random.standard_normal(size) * 0.01 * (k > 2))
        sample = aircraft.sample()
        seen.append(sample.xdot[BODY])
        off.append(aircraft.twin_derivative()[BODY] - sample.xdot[BODY])
    spread = np.std(seen, axis=0)
    assert (np.std(off, axis=0) < 0.06 * np.maximum(spread, spread[3:].max() * 0.1)).all()


def test_the_truth_holds_the_surfaces_that_a_yaw_damper_moves() -> None:
    aircraft = Aircraft(condition("A4"))
    truth = aircraft.truth()
    yaw = STATES.index("R")
    assert truth.a[yaw, yaw] == pytest.approx(-0.344, abs=0.01), "with the damper it would read -7.7"
    fly(aircraft, 0.5, np.array([0.0, 0.0, 0.05]))
    sample = aircraft.sample()
    commanded = aircraft.trim.delta[2] + 0.05
    assert abs(sample.delta[2] - commanded) > 0.3 * abs(sample.x[yaw]), "the damper moves the rudder that is measured"


@pytest.mark.parametrize("name", OTHERS)
def test_an_effectiveness_scales_the_column_of_b(name: str) -> None:
    aircraft = Aircraft(condition(name))
    before = aircraft.truth().b
    for i, effector in enumerate(aircraft.airframe.effectors):
        aircraft.damage(effector, 0.4)
        np.testing.assert_allclose(aircraft.truth().b[3:6, i], 0.4 * before[3:6, i], rtol=0.05, atol=0.06)
        aircraft.damage(effector, 1.0)


def test_a_stuck_surface_stays_and_a_bias_moves_the_air_alone() -> None:
    aircraft = Aircraft(condition("c172x"))
    elevator = 0
    aircraft.damage("elevator", 1.0, stuck=True)
    fly(aircraft, 0.5, np.array([0.05, 0.0, 0.0]))
    assert aircraft.sample().delta[elevator] == pytest.approx(aircraft.trim.delta[elevator], abs=1e-9)
    other = Aircraft(condition("c172x"))
    other.damage("elevator", 1.0, bias=0.02)
    other.step(other.trim.delta)
    assert other.sample().delta[elevator] == pytest.approx(other.trim.delta[elevator], abs=1e-6)
    assert other.sample().xdot[STATES.index("Q")] == pytest.approx(-23.6 * 0.02, rel=0.05)


def test_a_ramp_ends_where_a_step_would() -> None:
    one, other = Aircraft(condition("c172x")), Aircraft(condition("c172x"))
    one.damage("de", 0.5, ramp=0.3)
    other.damage("elevator", 0.5)
    for aircraft in (one, other):
        fly(aircraft, 0.4)
    np.testing.assert_allclose(one.truth().b[4, 0], other.truth().b[4, 0], rtol=0.02)


def test_two_fresh_flights_are_bit_identical() -> None:
    flights = []
    for _ in range(2):
        aircraft, random = Aircraft(condition("c172x"), gusts=0.3, seed=4), np.random.default_rng(1)
        rows = []
        for _ in range(50):
            aircraft.step(aircraft.trim.delta + random.standard_normal(3) * 0.01)
            rows.append(np.concatenate((aircraft.sample().x, aircraft.truth().a.ravel())))
        flights.append(np.array(rows))
    assert flights[0].tobytes() == flights[1].tobytes()


def test_gusts_have_their_size_and_blow_by_the_seed() -> None:
    def wind(seed: int) -> np.ndarray:
        aircraft = Aircraft(condition("A4"), gusts=0.5, seed=seed)
        rows = []
        for _ in range(3000):
            aircraft.step(aircraft.trim.delta)
            rows.append(aircraft._model.surroundings().wind)
        return np.array(rows) * 0.3048

    found = wind(1)
    assert (found[:, 0] == 0.0).all()
    assert 0.3 < found[:, 1].std() < 0.7 and 0.3 < found[:, 2].std() < 0.7
    assert not np.array_equal(found, wind(2))


def test_ballast_sits_at_the_centre_of_mass_and_is_carried() -> None:
    light = Aircraft(condition("c172x"))
    heavy = Aircraft(dataclasses.replace(condition("c172x"), ballast=100.0))
    assert heavy.trim.alpha > light.trim.alpha + 0.003
    assert heavy.trim.delta[0] != pytest.approx(light.trim.delta[0], abs=1e-4)


WRONG = {
    "a speed that it cannot fly": ({"airspeed": 8.0}, "no trim for cruise of c172x"),
    "a property that does not exist": ({"properties": (("gear/gear-cmd-nrm", 0.0),)}, "no property gear/gear-cmd-nrm"),
    "a speed that is none": ({"airspeed": math.nan}, "finite numbers"),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_condition_that_cannot_be_flown_is_refused_in_one_sentence(case: str) -> None:
    changes, expected = WRONG[case]
    with pytest.raises(PlantError) as caught:
        Aircraft(dataclasses.replace(condition("c172x"), **changes))  # type: ignore[arg-type]
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)


def test_what_the_model_lacks_is_refused_in_one_sentence() -> None:
    base = condition("c172x")
    first, *others = base.airframe.surfaces
    surfaces = (dataclasses.replace(first, position="fcs/elevator-pos-radd"), *others)
    ailerons = [
        dataclasses.replace(one, position=one.position.replace("effective-aileron-pos", "left-aileron-pos-rad"))
        for one in others
    ]
    cases: list[tuple[dict[str, Any], str]] = [
        ({"surfaces": surfaces}, "do not read 'fcs/elevator-pos-radd'; expected one of"),
        ({"model": "c172y"}, "model 'c172y' is not among those that ship with JSBSim"),
        (
            {"model": "L17", "surfaces": (first, *ailerons)},
            "cannot start the model: FGPropertyValue::GetValue() The property",
        ),
        ({"least_rate": 200}, "rate 100 Hz: c172x needs at least 200 steps per second"),
    ]
    for changes, expected in cases:
        airframe = dataclasses.replace(base.airframe, **changes)
        with pytest.raises(PlantError) as caught:
            Aircraft(dataclasses.replace(base, airframe=airframe))
        assert expected in str(caught.value)
        assert "\n" not in str(caught.value)


def test_two_effectors_that_move_the_surfaces_alike_are_refused() -> None:
    airframe = condition("c172x").airframe
    with pytest.raises(PlantError, match="independent"):
        dataclasses.replace(airframe, mixing=((1.0, 1.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)))
