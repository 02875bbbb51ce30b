"""The pilot holds the aircraft together: intact, damaged, in noise, with dither, for 12 s and for minutes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest

from msls_ros.plant import (
    CONDITIONS,
    EFFECTORS,
    MANOEUVRES,
    Aircraft,
    Manoeuvre,
    Pilot,
    PlantError,
    RollDoublet,
    Sensors,
    Steady,
    StrongManoeuvre,
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
    turbulence: str = "none",
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times [s], states (n, 9), and alpha error and sideslip (n, 2) [deg]."""
    aircraft = Aircraft(CONDITIONS[name], turbulence=turbulence, seed=seed)
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


@pytest.mark.parametrize(("name", "seeds"), [("high_alpha", 6), ("cruise", 3)])
def test_the_strong_manoeuvre_in_turbulence_stays_inside_the_tables(name: str, seeds: int) -> None:
    trim = math.degrees(Aircraft(CONDITIONS[name]).trim.alpha)
    for seed in range(seeds):
        times, x, angles = fly(
            name, "low", seed, loss=None, seconds=170.0, manoeuvre=MANOEUVRES["strong"], turbulence="moderate"
        )
        assert np.isfinite(x).all()
        assert trim + angles[:, 0].min() > -10.0 and trim + angles[:, 0].max() < 45.0
        assert np.abs(angles[:, 1]).max() < 10.0
        assert np.degrees(np.abs(x[:, 6])).max() < 60.0
        assert np.degrees(np.abs(x[:, 3])).max() > 15.0
        wobble = np.exp(-2j * np.pi * times / 5.0) @ angles[:, 0] * 2.0 / times.size
        assert abs(wobble) > 1.3


@pytest.mark.parametrize(("name", "reached"), [("high_alpha", 2.2), ("cruise", 1.3)])
def test_the_strong_manoeuvre_in_still_air_wobbles_and_keeps_the_heading(name: str, reached: float) -> None:
    times, x, angles = fly(name, "none", 0, loss=None, seconds=60.0, manoeuvre=StrongManoeuvre(), dither=False)
    wobble = np.exp(-2j * np.pi * times / 5.0) @ angles[:, 0] * 2.0 / times.size
    assert reached < abs(wobble) < 3.0
    assert np.degrees(np.abs(x[:, 6])).max() < 45.0
    assert np.degrees(np.abs(x[:, 8])).max() < 40.0


@dataclass(frozen=True)
class _Pitched(Steady):
    def alpha_offset(self, time: float) -> float:
        return math.radians(2.0) if time >= 1.0 else 0.0


@pytest.mark.parametrize("name", CONDITIONS)
def test_the_angle_of_attack_goes_where_the_manoeuvre_wants_it(name: str) -> None:
    _, _, angles = fly(name, "none", 0, loss=None, seconds=20.0, manoeuvre=_Pitched(), dither=False)
    assert angles[-1, 0] == pytest.approx(2.0, abs=0.3)
    assert np.abs(angles[:50, 0]).max() < 0.05


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


def test_the_strong_manoeuvre_rolls_both_ways_by_turns_and_rests_between() -> None:
    strong = StrongManoeuvre()
    degrees = [
        round(math.degrees(strong.roll_rate(t)), 9) for t in (0.5, 1.0, 2.9, 3.0, 4.9, 5.0, 8.9, 9.0, 11.1, 13.1, 17.1)
    ]
    assert degrees == [0.0, 20.0, 20.0, -20.0, -20.0, 0.0, 0.0, -20.0, 20.0, 0.0, 20.0]
    assert [strong.active(t) for t in (0.9, 1.0, 4.9, 5.0, 8.9, 9.0)] == [False, True, True, False, False, True]
    alpha = np.degrees([strong.alpha_offset(t) for t in np.arange(1.0, 1001.0, 0.05)])
    assert strong.alpha_offset(0.99) == 0.0
    assert (alpha.min(), alpha.max()) == pytest.approx((-3.5, 2.5), abs=1e-6)


def test_every_manoeuvre_has_a_name_and_only_the_strong_one_moves_the_angle_of_attack() -> None:
    assert list(MANOEUVRES) == ["roll_doublet", "steady", "strong"]
    moved = {name for name, m in MANOEUVRES.items() if any(m.alpha_offset(0.3 * k) for k in range(100))}
    assert moved == {"strong"}
