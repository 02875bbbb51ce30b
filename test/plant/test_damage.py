"""Damage that grows and surfaces that stick: in flight, in the measurements and in the truth."""

from __future__ import annotations

import math

import numpy as np
import pytest

from msls_ros.plant import CONDITIONS, EFFECTORS, Aircraft, Fault, PlantError

HIGH_ALPHA = CONDITIONS["high_alpha"]
P, DDT, DE = 3, EFFECTORS.index("ddt"), EFFECTORS.index("de")


def fly(aircraft: Aircraft, seconds: float, offset: np.ndarray | None = None) -> None:
    for _ in range(round(seconds * aircraft.rate)):
        aircraft.step(aircraft.trim.delta if offset is None else aircraft.trim.delta + offset)


def b43(aircraft: Aircraft) -> float:
    return float(aircraft.truth().b[P, DDT])


def test_a_ramp_takes_its_time_and_ends_where_a_step_would() -> None:
    ramped = Aircraft(HIGH_ALPHA)
    intact = b43(ramped)
    fly(ramped, 0.1)
    sentence = ramped.damage("ddt", 0.5, ramp=0.4)
    assert "50% effective" in sentence and "0.10 s" in sentence and "over 0.4 s" in sentence
    left = [b43(ramped) / intact]
    for _ in range(5):
        fly(ramped, 0.1)
        left.append(b43(ramped) / intact)
        assert np.abs(ramped.twin_derivative() - ramped.sample().xdot).max() < 1e-7
    assert left == pytest.approx([1.0, 0.875, 0.75, 0.625, 0.5, 0.5], abs=0.01)


def test_a_bias_grows_with_the_ramp() -> None:
    aircraft = Aircraft(HIGH_ALPHA)
    aircraft.damage("ddt", 1.0, bias=0.01, ramp=0.1)
    rolls = []
    for _ in range(12):
        aircraft.step(aircraft.trim.delta)
        rolls.append(aircraft.sample().xdot[P])
    expected = np.minimum(np.arange(1, 13) / 10.0, 1.0) * 0.01 * b43(aircraft)
    np.testing.assert_allclose(rolls, expected, rtol=0.03)


def test_new_damage_ends_a_ramp() -> None:
    aircraft = Aircraft(HIGH_ALPHA)
    intact = b43(aircraft)
    aircraft.damage("left_stabilator", 0.0, ramp=1.0)
    fly(aircraft, 0.5)
    aircraft.damage("left_stabilator", 1.0)
    fly(aircraft, 1.0)
    assert b43(aircraft) == pytest.approx(intact, rel=0.01)


def test_a_ramp_starts_from_the_damage_there_is() -> None:
    aircraft = Aircraft(HIGH_ALPHA)
    intact = b43(aircraft)
    aircraft.damage("ddt", 0.5)
    aircraft.damage("ddt", 0.0, ramp=1.0)
    fly(aircraft, 0.5)
    assert b43(aircraft) == pytest.approx(0.25 * intact, rel=0.02)


def test_a_stuck_surface_stays_until_it_is_freed() -> None:
    aircraft = Aircraft(HIGH_ALPHA)
    offset = np.zeros(7)
    offset[DE] = 0.02
    assert "left_stabilator intact, stuck" in aircraft.damage("left_stabilator", 1.0, stuck=True)
    fly(aircraft, 0.5, offset)
    sample = aircraft.sample()
    assert sample.delta[DE] - aircraft.trim.delta[DE] == pytest.approx(0.01, abs=1e-4)
    assert sample.delta[DDT] == pytest.approx(-0.01, abs=1e-4)
    assert np.abs(aircraft.twin_derivative() - sample.xdot).max() < 1e-7
    assert b43(aircraft) == pytest.approx(b43(Aircraft(HIGH_ALPHA)), rel=0.02), "per rad of measured deflection"
    aircraft.damage("left_stabilator", 1.0)
    fly(aircraft, 0.5, offset)
    assert aircraft.sample().delta[DE] - aircraft.trim.delta[DE] == pytest.approx(0.02, abs=1e-4)


@pytest.mark.parametrize(
    ("key", "value"),
    [("ramp", -1.0), ("ramp", math.nan), ("ramp", math.inf), ("ramp", "5"), ("stuck", 1), ("stuck", None)],
)
def test_bad_ramps_and_bad_sticking_are_refused_and_damage_nothing(key: str, value: object) -> None:
    aircraft = Aircraft(HIGH_ALPHA)
    with pytest.raises(PlantError, match="expected"):
        aircraft.damage("ddt", 0.0, **{key: value})  # type: ignore[arg-type]
    np.testing.assert_array_equal(aircraft.truth().b, Aircraft(HIGH_ALPHA).truth().b)


def test_what_is_left_of_a_surface_on_its_way_and_at_the_end() -> None:
    slow, abrupt = Fault("left_stabilator", 4.0, 0.2, ramp=5.0), Fault("left_stabilator", 4.0, 0.2)
    times = (0.0, 4.0, 6.5, 9.0, 20.0)
    assert [slow.left(time) for time in times] == pytest.approx([1.0, 1.0, 0.6, 0.2, 0.2])
    assert [abrupt.left(time) for time in times] == pytest.approx([1.0, 0.2, 0.2, 0.2, 0.2])
