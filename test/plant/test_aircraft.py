"""The flying F-16/MATV: refuses what would poison it, repeats itself, and is one consistent instant per sample."""

from __future__ import annotations

import math
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from msls_ros.plant import (
    ACTUATORS,
    CONDITIONS,
    EFFECTORS,
    SURFACE_ACTUATORS,
    SURFACES,
    Aircraft,
    PlantError,
    actuator_gain,
    find_trim,
)
from msls_ros.plant import airframe as airframe_module

HIGH_ALPHA = CONDITIONS["high_alpha"]
CRUISE = CONDITIONS["cruise"]


def excitation(steps: int, seed: int, rms: float = 0.003) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal((steps, len(EFFECTORS))) * rms


@pytest.mark.parametrize("name", CONDITIONS)
def test_trim_leaves_nothing_accelerating_and_the_flight_stays_there(name: str) -> None:
    aircraft = Aircraft(CONDITIONS[name])
    assert aircraft.trim.residual < 1e-6
    start = aircraft.sample()
    assert np.abs(start.xdot[:6]).max() < 1e-6
    np.testing.assert_allclose(start.x, aircraft.trim.x, atol=1e-9)
    np.testing.assert_allclose(start.delta, aircraft.trim.delta, atol=1e-9)
    for _ in range(100):
        aircraft.step(aircraft.trim.delta)
    np.testing.assert_allclose(aircraft.sample().x, aircraft.trim.x, atol=0.02)


def test_trim_of_the_papers_condition() -> None:
    trim = find_trim(HIGH_ALPHA)
    assert math.degrees(trim.alpha) == pytest.approx(38.5, abs=1e-9)
    assert trim.x[:3] / 0.3048 == pytest.approx([186.6, 0.0, 148.5], abs=0.1)
    assert math.degrees(trim.flight_path_angle) == pytest.approx(-11.8, abs=0.1)
    assert trim.throttle == pytest.approx(0.564, abs=0.005)
    assert trim.delta[EFFECTORS.index("dte")] == 0.5 * trim.delta[EFFECTORS.index("de")]


def test_trim_with_the_lift_sign_of_the_bundled_file(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(airframe_module, "_mirror_columns", lambda _table: None)
    airframe_module._aircraft_xml.cache_clear()
    try:
        trim = find_trim.__wrapped__(HIGH_ALPHA)
        cruise = find_trim.__wrapped__(CRUISE)
    finally:
        airframe_module._aircraft_xml.cache_clear()
    assert math.degrees(trim.flight_path_angle) == pytest.approx(-13.45, abs=0.05)
    assert math.degrees(trim.x[7]) == pytest.approx(25.05, abs=0.05)
    assert trim.throttle == pytest.approx(0.514, abs=0.001)
    assert math.degrees(trim.delta[0]) == pytest.approx(-4.25, abs=0.05)
    assert math.degrees(cruise.alpha) == pytest.approx(2.73, abs=0.05)


def test_cruise_is_level_at_mach_0_6() -> None:
    trim = find_trim(CRUISE)
    assert trim.flight_path_angle == pytest.approx(0.0, abs=1e-12)
    assert math.degrees(trim.alpha) == pytest.approx(2.86, abs=0.02)
    assert trim.airspeed == pytest.approx(189.6, abs=0.2)


@pytest.mark.parametrize(
    "condition",
    [
        replace(HIGH_ALPHA, ballast=0.0),
        replace(HIGH_ALPHA, mach=0.05),
        replace(CRUISE, mach=3.0),
        replace(CRUISE, mach=math.nan),
        replace(CRUISE, altitude=math.inf),
        replace(CRUISE, ballast=-1.0),
    ],
    ids=["too light", "too slow", "too fast", "no number", "nowhere", "negative mass"],
)
def test_condition_without_steady_flight_is_refused(condition: object) -> None:
    with pytest.raises(PlantError, match="expected"):
        Aircraft(condition)  # type: ignore[arg-type]


@pytest.mark.parametrize("rate", [0, -100, 10, 10_000, 100.0, True, "100"])
def test_rate_out_of_range_is_refused(rate: object) -> None:
    with pytest.raises(PlantError, match="steps per second"):
        Aircraft(CRUISE, rate=rate)  # type: ignore[arg-type]


BAD_COMMANDS = [
    [math.nan] * 7,
    [0.0, 0.0, 0.0, math.inf, 0.0, 0.0, 0.0],
    [0.0] * 6,
    [0.0] * 8,
    [[0.0] * 7],
    0.0,
    "abcdefg",
    None,
    [0.0, 0.0, 0.0, "x", 0.0, 0.0, 0.0],
]


def test_bad_commands_are_refused_and_leave_the_flight_untouched() -> None:
    clean, tried = Aircraft(HIGH_ALPHA), Aircraft(HIGH_ALPHA)
    for k, noise in enumerate(excitation(90, seed=1)):
        with pytest.raises(PlantError, match="expected"):
            tried.step(BAD_COMMANDS[k % len(BAD_COMMANDS)])  # type: ignore[arg-type]
        for aircraft in (clean, tried):
            aircraft.step(aircraft.trim.delta + noise)
    assert clean.time == tried.time
    np.testing.assert_array_equal(clean.sample().x, tried.sample().x)
    np.testing.assert_array_equal(clean.sample().delta, tried.sample().delta)


@pytest.mark.parametrize(
    ("name", "effectiveness", "bias"),
    [
        ("left_wing", 0.0, 0.0),
        ("", 0.0, 0.0),
        ("ddt", -0.1, 0.0),
        ("ddt", 1.5, 0.0),
        ("ddt", math.nan, 0.0),
        ("ddt", "half", 0.0),
        ("ddt", 0.5, math.nan),
        ("rudder", 0.5, 3.0),
    ],
)
def test_bad_damage_is_refused_and_damages_nothing(name: str, effectiveness: float, bias: float) -> None:
    aircraft = Aircraft(CRUISE)
    with pytest.raises(PlantError, match="expected"):
        aircraft.damage(name, effectiveness, bias)
    np.testing.assert_array_equal(aircraft.truth().b, Aircraft(CRUISE).truth().b)


def test_two_fresh_flights_are_bit_identical() -> None:
    flights = []
    for _ in range(2):
        aircraft = Aircraft(HIGH_ALPHA)
        rows = []
        for k, noise in enumerate(excitation(300, seed=2)):
            if k == 150:
                aircraft.damage("left_stabilator", 0.0)
            aircraft.step(aircraft.trim.delta + noise)
            sample = aircraft.sample()
            rows.append(np.concatenate(([sample.time], sample.x, sample.xdot, sample.delta)))
        flights.append(np.array(rows))
    np.testing.assert_array_equal(flights[0], flights[1])


@pytest.mark.parametrize("name", CONDITIONS)
def test_the_integral_of_the_derivatives_is_the_states(name: str) -> None:
    aircraft = Aircraft(CONDITIONS[name])
    samples = [aircraft.sample()]
    for noise in excitation(300, seed=3):
        aircraft.step(aircraft.trim.delta + noise)
        samples.append(aircraft.sample())
    x = np.array([s.x for s in samples])
    integral = x[0] + np.cumsum([s.xdot / aircraft.rate for s in samples[:-1]], axis=0)
    worst = np.abs(integral - x[1:]).max(axis=0)
    travelled = np.abs(x - x[0]).max(axis=0)
    assert (worst[3:6] < 1e-7).all(), "body rates are integrated by Euler's rule"
    assert (worst < np.maximum(0.03 * travelled, 2e-4)).all()


@pytest.mark.parametrize("rate", [100, 200])
def test_actuator_follows_a_first_order_lag(rate: int) -> None:
    aircraft = Aircraft(CRUISE, rate=rate)
    step = np.full(7, 0.004)
    measured = []
    for _ in range(rate // 10):
        aircraft.step(aircraft.trim.delta + step)
        measured.append(aircraft.sample().delta - aircraft.trim.delta)
    times = (np.arange(rate // 10) + 1.0) / rate
    expected = 0.004 * (1.0 - np.exp(-20.0 * (times - 0.5 / rate)))
    np.testing.assert_allclose(np.array(measured), np.tile(expected[:, None], 7), atol=0.004 * 0.02)


def test_actuators_respect_their_rates_and_positions() -> None:
    aircraft = Aircraft(CRUISE)
    before = aircraft.sample().delta
    for _ in range(5):
        aircraft.step(np.full(7, 0.35))
        after = aircraft.sample().delta
        for i, actuator in enumerate(ACTUATORS):
            assert abs(after[i] - before[i]) <= 0.01 * actuator.rate_limit + 1e-9
            assert actuator.low - 1e-9 <= after[i] <= actuator.high + 1e-9
        before = after


def test_actuator_limits_are_the_published_ones() -> None:
    assert tuple(SURFACE_ACTUATORS) == SURFACES
    degrees = {
        name: (round(math.degrees(a.rate_limit)), round(math.degrees(a.high))) for name, a in SURFACE_ACTUATORS.items()
    }
    assert degrees["left_stabilator"] == degrees["right_stabilator"] == (60, 25)
    assert degrees["left_flaperon"] == degrees["right_flaperon"] == (80, 20)
    assert degrees["rudder"] == (120, 30)
    assert degrees["nozzle_pitch"] == degrees["nozzle_yaw"] == (45, 17)
    assert {actuator.bandwidth for actuator in ACTUATORS} == {20.0}


@pytest.mark.parametrize(("rate", "hold"), [(100, 1), (50, 2)])
def test_actuator_gain_is_that_of_a_white_command(rate: int, hold: int) -> None:
    aircraft = Aircraft(CRUISE)
    positions = []
    for noise in excitation(3000, seed=4, rms=0.001):
        for _ in range(hold):
            aircraft.step(aircraft.trim.delta + noise)
        positions.append(aircraft.sample().delta - aircraft.trim.delta)
    rms = np.sqrt(np.mean(np.square(positions), axis=0))
    np.testing.assert_allclose(rms / 0.001, actuator_gain(rate), rtol=0.12)
    assert actuator_gain(100) == pytest.approx(0.316, abs=0.001)
    assert actuator_gain(50) == pytest.approx(0.444, abs=0.001)


@pytest.mark.parametrize("rate", [0.0, -50.0, math.nan, math.inf])
def test_actuator_gain_refuses_an_impossible_rate(rate: float) -> None:
    with pytest.raises(PlantError, match="expected"):
        actuator_gain(rate)


def test_heading_is_continuous_through_north() -> None:
    aircraft = Aircraft(CRUISE)
    right = aircraft.trim.delta.copy()
    left = aircraft.trim.delta.copy()
    right[EFFECTORS.index("dr")] += 0.05
    left[EFFECTORS.index("dr")] -= 0.05
    headings = []
    for k in range(400):
        aircraft.step(right if k < 100 else left)
        headings.append(aircraft.sample().x[8])
    assert np.abs(np.diff(headings)).max() < 0.05
    assert min(headings) < -1e-3 < 1e-3 < max(headings)


def test_jsbsim_prints_nothing_and_leaves_nothing_behind_in_any_thread() -> None:
    program = """
import threading
from msls_ros.plant import CONDITIONS, Aircraft
aircraft = Aircraft(CONDITIONS["high_alpha"])
def fly():
    aircraft.truth()
    for k in range(400):
        aircraft.step([1.0 if k % 100 < 50 else -1.0] * 7)
    Aircraft(CONDITIONS["cruise"]).truth()
for _ in range(2):
    thread = threading.Thread(target=fly)
    thread.start()
    thread.join()
"""
    with tempfile.TemporaryDirectory() as folder:
        root = str(Path(airframe_module.__file__).parents[2])
        environment = {"PYTHONPATH": root, "TMPDIR": folder, "PYTHONDONTWRITEBYTECODE": "1"}
        done = subprocess.run(
            [sys.executable, "-c", program], capture_output=True, text=True, env=environment, timeout=60, check=False
        )
        assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
        assert list(Path(folder).iterdir()) == []
