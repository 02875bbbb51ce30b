"""Sensors as on real aircraft: each error has its size, is off by default, and repeats with the seed."""

from __future__ import annotations

import math

import numpy as np
import pytest

from msls_ros.plant import (
    SUITES,
    Instruments,
    PlantError,
    Sample,
    Sensors,
    instrument_lines,
    make_sensors,
    parse_instruments,
)

DEG = math.pi / 180.0
X = np.array([60.0, 1.0, 4.0, 0.1, 0.05, -0.04, 0.2, 0.08, 1.0])
XDOT = np.array([0.3, -0.2, 0.5, 0.4, -0.3, 0.2, 0.105, 0.057, -0.03])
DELTA = np.array([0.02, -0.03, 0.05])


def still(time: float = 0.0) -> Sample:
    return Sample(time, X, XDOT, DELTA)


def measured(instruments: Instruments, samples: int = 4000, seed: int = 1) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    sensors = make_sensors(instruments, "none", seed)
    found = [sensors.measure(still(0.04 * k)) for k in range(samples)]
    return tuple(np.array([getattr(one, name) for one in found]) for name in ("x", "xdot", "delta"))  # type: ignore[return-value]


def numbers(**values: float) -> tuple[tuple[str, float], ...]:
    return tuple(values.items())


def test_without_instruments_the_noise_level_alone_acts() -> None:
    plain, noise = make_sensors(None, "low", 3), Sensors("low", 3)
    for k in range(5):
        one, other = plain.measure(still(k)), noise.measure(still(k))
        np.testing.assert_array_equal(one.x, other.x)
        np.testing.assert_array_equal(one.delta, other.delta)


@pytest.mark.parametrize("vanes", [False, True])
def test_perfect_instruments_say_what_is(vanes: bool) -> None:
    x, xdot, delta = measured(Instruments(vanes=vanes, vane_position=2.0), 2)
    np.testing.assert_allclose(x[0], X, rtol=0.0, atol=0.01)
    np.testing.assert_allclose(xdot[0, :6], XDOT[:6], rtol=0.0, atol=0.01)
    np.testing.assert_array_equal(delta[0], DELTA)


def test_noise_has_its_size_and_its_colour() -> None:
    suite = Instruments(white=numbers(P=0.01), coloured=numbers(Q=0.02), correlation=numbers(Q=0.9))
    x, _, _ = measured(suite)
    p, q = x[:, 3] - X[3], x[:, 4] - X[4]
    assert p.std() == pytest.approx(0.01, rel=0.05) and q.std() == pytest.approx(0.02, rel=0.2)
    assert abs(np.corrcoef(p[1:], p[:-1])[0, 1]) < 0.05
    assert np.corrcoef(q[1:], q[:-1])[0, 1] == pytest.approx(0.9, abs=0.03)
    assert x[:, 5].std() == 0.0


def test_deflections_have_noise_of_their_own_each() -> None:
    _, _, delta = measured(Instruments(white=numbers(deflection=0.001)))
    assert delta.std(axis=0) == pytest.approx([0.001] * 3, rel=0.1)
    assert np.abs(np.corrcoef(delta.T) - np.eye(3)).max() < 0.06


def test_bias_scale_and_resolution() -> None:
    suite = Instruments(bias=numbers(az=0.06), scale=numbers(P=0.1), resolution=numbers(R=0.01, deflection=0.004))
    x, xdot, delta = measured(suite, 1)
    assert x[0, 3] == pytest.approx(1.1 * X[3]) and x[0, 5] == pytest.approx(-0.04)
    assert xdot[0, 2] - XDOT[2] == pytest.approx(0.06 + (x[0, 3] - X[3]) * X[1] * -1.0, abs=0.12)
    assert delta[0] == pytest.approx([0.02, -0.032, 0.048])


def test_an_accelerometer_off_the_centre_of_mass_feels_the_rotation() -> None:
    place = np.array([3.0, 0.0, -1.0])
    _, xdot, _ = measured(Instruments(accelerometer_position=(3.0, 0.0, -1.0)), 1)
    rates, turning = X[3:6], XDOT[3:6]
    expected = np.cross(turning, place) + np.cross(rates, np.cross(rates, place))
    np.testing.assert_allclose(xdot[0, :3] - XDOT[:3], expected, atol=1e-9)


def test_responses_come_late_against_the_deflections() -> None:
    sensors = make_sensors(Instruments(delay=0.014), "none", 0)
    for k in range(41):
        time = 0.01 * k
        sensors.follow(Sample(time, X * time, XDOT, DELTA * time))
    found = sensors.measure(Sample(0.41, X * 0.41, XDOT, DELTA * 0.41))
    np.testing.assert_allclose(found.x[3:9], X[3:9] * (0.41 - 0.014), rtol=1e-6)
    np.testing.assert_allclose(found.delta, DELTA * 0.41)


def test_servo_records_are_held_at_their_rate() -> None:
    sensors = make_sensors(Instruments(servo_rate=5.0), "none", 0)
    found = [sensors.measure(Sample(0.04 * k, X, XDOT, DELTA * k)).delta[0] / DELTA[0] for k in range(11)]
    assert found == pytest.approx([0, 0, 0, 0, 0, 5, 5, 5, 5, 5, 10])


def test_differentiated_rates_stand_for_angular_accelerations() -> None:
    sensors = make_sensors(Instruments(differentiated=True), "none", 0)
    moved = [Sample(0.04 * k, X + 0.04 * k * XDOT, 9.0 * XDOT, DELTA) for k in range(3)]
    found = [sensors.measure(one).xdot[3:6] for one in moved]
    np.testing.assert_allclose(found[0], 0.0)
    np.testing.assert_allclose(found[2], XDOT[3:6], rtol=1e-9)


def test_samples_are_lost_at_their_share_by_the_seed() -> None:
    lost = [make_sensors(Instruments(dropped=0.2), "none", seed) for seed in (1, 1, 2)]
    rows = [[sensors.lost() for _ in range(2000)] for sensors in lost]
    assert np.mean(rows[0]) == pytest.approx(0.2, abs=0.03)
    assert rows[0] == rows[1] != rows[2]


def test_the_seed_decides_the_errors() -> None:
    one, again, other = (measured(SUITES["flight_test"], 20, seed)[0] for seed in (4, 4, 5))
    assert one.tobytes() == again.tobytes() != other.tobytes()


def test_the_flight_test_suite_is_of_the_published_size() -> None:
    x, xdot, delta = measured(SUITES["flight_test"])
    assert np.degrees(x[:, 3:6].std(axis=0)) == pytest.approx([0.09, 0.085, 0.07], rel=0.1)
    assert np.degrees(xdot[:, 3:6].std(axis=0)) == pytest.approx([0.24, 0.6, 0.22], rel=0.2)
    assert np.degrees(delta.std(axis=0)) == pytest.approx([0.013] * 3, rel=0.15)


@pytest.mark.parametrize("name", SUITES)
def test_a_suite_is_written_as_it_is_read(name: str) -> None:
    assert parse_instruments(instrument_lines(SUITES[name])) == SUITES[name]
    assert parse_instruments([f"suite={name}"]) == SUITES[name]


WRONG = {
    "dropped=2": "dropped 2: expected 0 to 0.9",
    "white.yaw=1": "white of 'yaw': expected one of airspeed",
    "white=1": "'white=1'",
    "delay=soon": "'delay=soon'",
    "vanes=perhaps": "true or false",
    "colour.P=1": "'colour.P=1'",
}


@pytest.mark.parametrize("line", WRONG)
def test_what_is_no_instrument_is_refused_in_one_sentence(line: str) -> None:
    with pytest.raises(PlantError) as caught:
        parse_instruments([line])
    assert WRONG[line] in str(caught.value) and "\n" not in str(caught.value)
