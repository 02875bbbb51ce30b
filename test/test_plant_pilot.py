"""The pilot holds the aircraft together: intact, damaged, in noise, with dither, for 12 s and for minutes."""

from __future__ import annotations

import math

import numpy as np
import pytest

from msls_ros.plant import (
    CONDITIONS,
    EFFECTORS,
    Aircraft,
    Manoeuvre,
    Pilot,
    PlantError,
    RollDoublet,
    Sensors,
    Steady,
    actuator_gain,
)
from msls_ros.plant.pilot import riccati_gain

LOSS = 4.0


def fly(
    name: str,
    noise: str,
    seed: int,
    *,
    loss: float | None,
    seconds: float = 12.0,
    dither: bool = True,
    manoeuvre: Manoeuvre | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times [s], states (n, 9), and alpha error and sideslip (n, 2) [deg]."""
    aircraft = Aircraft(CONDITIONS[name])
    pilot = Pilot(aircraft.trim, aircraft.truth(), manoeuvre or RollDoublet())
    sensors = Sensors(noise, seed)
    random = np.random.default_rng(900 + seed)
    times, states = [], []
    for _ in range(round(seconds * 50)):
        time = aircraft.time
        if time == loss:
            aircraft.damage("left_stabilator", 0.0)
        sample = aircraft.sample()
        times.append(time)
        states.append(sample.x)
        command = pilot.command(time, sensors.measure(sample).x)
        if dither:
            boosted = loss is not None and loss <= time < loss + 1.0
            rms = math.radians(0.86 if boosted else 0.26) / actuator_gain(50.0)
            command = command + random.standard_normal(len(EFFECTORS)) * rms
        aircraft.step(command)
        aircraft.step(command)
    x = np.array(states)
    alpha = np.arctan2(x[:, 2], x[:, 0]) - aircraft.trim.alpha
    beta = np.arcsin(x[:, 1] / np.sqrt(np.sum(x[:, :3] ** 2, axis=1)))
    return np.array(times), x, np.degrees(np.column_stack((alpha, beta)))


@pytest.mark.parametrize("noise", ["none", "low", "med"])
@pytest.mark.parametrize("name", CONDITIONS)
def test_the_intact_doublet_stays_on_condition(name: str, noise: str) -> None:
    for seed in range(6):
        for dither in (False, True):
            _, x, angles = fly(name, noise, seed, loss=None, dither=dither)
            assert np.isfinite(x).all()
            assert np.abs(angles[:, 0]).max() < 1.0
            assert np.abs(angles[:, 1]).max() < 3.0


@pytest.mark.parametrize("noise", ["none", "low", "med"])
@pytest.mark.parametrize("name", CONDITIONS)
def test_the_doublet_survives_the_loss_of_the_left_stabilator(name: str, noise: str) -> None:
    for seed in range(6):
        for dither in (False, True):
            times, x, angles = fly(name, noise, seed, loss=LOSS, dither=dither)
            assert np.isfinite(x).all()
            assert np.abs(angles[times < LOSS, 0]).max() < 1.0
            assert np.abs(angles[:, 0]).max() < 2.0
            assert np.abs(angles[:, 1]).max() < 3.0


def test_the_papers_doublet_rolls_one_way_and_back() -> None:
    times, x, angles = fly("high_alpha", "none", 0, loss=None, dither=False)
    bank = np.degrees(x[:, 6])
    assert bank.max() == pytest.approx(22.0, abs=2.0)
    assert times[np.argmax(bank)] == pytest.approx(5.5, abs=0.5)
    assert abs(bank[-1]) < 2.0
    assert 38.5 + angles[:, 0].min() > 38.1 and 38.5 + angles[:, 0].max() < 38.8


@pytest.mark.parametrize("loss", [None, 60.0])
@pytest.mark.parametrize("name", CONDITIONS)
def test_long_flights_stay_in_the_air(name: str, loss: float | None) -> None:
    _, x, angles = fly(name, "med", 3, loss=loss, seconds=170.0, manoeuvre=Steady())
    assert np.isfinite(x).all()
    assert np.abs(angles[:, 0]).max() < 2.0
    assert np.abs(angles[:, 1]).max() < 3.0
    assert np.degrees(np.abs(x[:, 6])).max() < (3.0 if loss is None else 30.0)


def test_the_same_measurements_get_the_same_commands() -> None:
    first, second = (fly("high_alpha", "med", 7, loss=LOSS)[1] for _ in range(2))
    np.testing.assert_array_equal(first, second)


def test_a_pilot_whose_time_goes_back_starts_afresh() -> None:
    aircraft = Aircraft(CONDITIONS["high_alpha"])
    truth = aircraft.truth()
    off = aircraft.trim.x + np.array([0.0, 0.1, 2.0, 0.01, 0.01, 0.0, 0.1, 0.0, 0.0])
    used, fresh = (Pilot(aircraft.trim, truth, RollDoublet()) for _ in range(2))
    for k in range(100):
        used.command(5.0 + 0.02 * k, off)
    for k in range(20):
        np.testing.assert_array_equal(used.command(0.02 * k, off), fresh.command(0.02 * k, off))


@pytest.mark.parametrize(
    ("time", "x"),
    [(math.nan, [60.0] + [0.0] * 8), (0.0, [math.nan] * 9), (0.0, [60.0] * 8), (0.0, [math.inf] + [0.0] * 8)],
)
def test_measurements_that_are_no_numbers_are_refused(time: float, x: list[float]) -> None:
    aircraft = Aircraft(CONDITIONS["high_alpha"])
    with pytest.raises(PlantError, match="expected"):
        Pilot(aircraft.trim, aircraft.truth(), Steady()).command(time, x)


def test_riccati_gain_of_the_double_integrator_is_the_textbook_one() -> None:
    a, b = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]])
    np.testing.assert_allclose(riccati_gain(a, b, np.eye(2), np.eye(1)), [[1.0, math.sqrt(3.0)]], atol=1e-9)


def test_riccati_gain_refuses_what_cannot_be_stabilised() -> None:
    with pytest.raises(PlantError, match="no stabilising gain"):
        riccati_gain(np.zeros((2, 2)), np.zeros((2, 1)), np.zeros((2, 2)), np.eye(1))


def test_doublet_is_right_then_left_then_free() -> None:
    doublet = RollDoublet()
    degrees = [round(math.degrees(doublet.roll_rate(t)), 9) for t in (0.0, 0.99, 1.0, 4.99, 5.0, 8.99, 9.0, 50.0)]
    assert degrees == [0.0, 0.0, 6.0, 6.0, -6.0, -6.0, 0.0, 0.0]
    assert [doublet.active(t) for t in (0.5, 1.0, 8.99, 9.0)] == [False, True, True, False]
    assert Steady().roll_rate(3.0) == 0.0 and not Steady().active(3.0)
