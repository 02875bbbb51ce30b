"""The pieces of the laws: what is believed, actuators watched, the Riccati equation, margins."""

from __future__ import annotations

import math

import numpy as np
import pytest
from control.made_up import PERIOD, A, B, aircraft

from msls_ros.control import ControlError, ControlSettings, ModelEstimate
from msls_ros.control.actuators import StuckMonitor
from msls_ros.control.aircraft import Prior
from msls_ros.control.believed import Believed
from msls_ros.control.indi import pitch_gains
from msls_ros.control.linear import Array
from msls_ros.control.margins import smallest_margins
from msls_ros.control.riccati import riccati


def estimate(time: float, b: Array, std: float, alarm: bool = False) -> ModelEstimate:
    return ModelEstimate(time, A, b, np.full((9, 9), 0.01), np.full((9, 4), std), alarm)


@pytest.mark.parametrize("model", ["surface", "entry"])
def test_a_dead_surface_is_believed_dead_after_an_alarm_however_unreliable_its_zero_is(model: str) -> None:
    believed = Believed(aircraft(), ControlSettings(model=model))
    random = np.random.default_rng(1)
    dead = B.copy()
    dead[:, 1] = 0.0
    believed.alarm(0.0)
    for k in range(25):
        believed.take(k * 0.04, estimate(k * 0.04, dead + 0.15 * random.standard_normal(B.shape), 0.15))
    effect, std = believed.effectiveness
    assert abs(effect[1]) < 3.0 * std[1] + 0.05 and std[1] < 0.15
    assert np.abs(effect[[0, 2, 3]] - 1.0).max() < 0.25


def test_an_estimate_without_information_changes_nothing_and_one_that_is_none_is_refused() -> None:
    believed = Believed(aircraft(), ControlSettings())
    for std in (1e9, math.inf, math.nan):
        assert believed.take(0.1, estimate(0.1, -B, std))
        assert np.allclose(believed.effectiveness[0], 1.0, atol=1e-4)
    assert not believed.take(0.2, estimate(0.2, np.full_like(B, math.nan), 0.1))
    assert believed.updated == 0.1


def test_a_stranger_s_model_is_dropped_when_the_response_disproves_it() -> None:
    believed = Believed(aircraft(), ControlSettings())
    believed.alarm(0.0)
    for k in range(10):
        believed.take(k * 0.1, estimate(k * 0.1, 0.0 * B, 1e-3))
    assert believed.effectiveness[0].max() < 0.1
    random, dropped = np.random.default_rng(2), 0
    for k in range(50):
        moved = np.radians(2.0) * random.standard_normal(4)
        dropped += believed.judge(1.0 + k * PERIOD, B[3:6] @ moved, moved, PERIOD)
    assert dropped == 1
    assert np.allclose(believed.effectiveness[0], 1.0)
    assert not believed.take(1.1, estimate(1.1, 0.0 * B, 1e-3))


def test_the_pitch_gains_fall_with_the_pitching_power_that_is_left_and_the_damping_stays() -> None:
    settings, none = ControlSettings(), np.zeros(4, np.bool_)
    believed = Believed(aircraft(), settings)
    assert believed.pitching_power_left(none) == 1.0
    left = believed.pitching_power_left(np.array([False, True, False, False]))
    assert left == pytest.approx(0.6 / 3.1)  # of the surfaces that pitch, -2.5 and -0.6 rad/s^2 per rad
    pitch, alpha = pitch_gains(settings, left)
    assert pitch / alpha == pytest.approx(settings.pitch_gain / settings.alpha_gain)
    assert pitch == pytest.approx(settings.pitch_gain * left**settings.pitch_gain_power)
    assert pitch < settings.pitch_gain
    assert Believed(aircraft(prior=False), settings).pitching_power_left(none) == 1.0


def fly_actuators(lag: int, stuck: int | None, hard_over: float | None = None) -> list[str]:
    """Random commands on the made-up actuators; the second sample counts from when one fails at half time."""
    made = aircraft()
    monitor = StuckMonitor(made, ControlSettings())
    random = np.random.default_rng(3)
    place, commands = np.zeros(4), [np.zeros(4)] * (lag + 1)
    seen = []
    for k in range(200):
        late = commands[-1 - lag]
        target = late.copy()
        if stuck is not None and k >= 100:
            target[stuck] = place[stuck] if hard_over is None else hard_over
        place = place + np.clip((1.0 - math.exp(-0.4)) * (target - place), -0.02, 0.02)
        seen = monitor.update(place + np.radians(0.005) * random.standard_normal(4), commands[-1], PERIOD).tolist()
        commands.append(np.radians(0.4) * random.standard_normal(4) + np.radians(2.0) * math.sin(0.05 * k))
    return [name for name, one in zip(made.surfaces, seen, strict=True) if one]


@pytest.mark.parametrize("lag", [0, 1, 2, 3])
def test_a_stuck_actuator_is_found_and_latency_is_not_taken_for_one(lag: int) -> None:
    assert fly_actuators(lag, None) == []
    assert fly_actuators(lag, 2) == ["dr"]
    assert fly_actuators(lag, 1, math.radians(10.0)) == ["de"]


def test_the_riccati_equation_is_solved_by_the_stabilising_solution_or_by_none() -> None:
    random = np.random.default_rng(4)
    for n in (2, 7, 15):
        a, b = 3.0 * random.standard_normal((n, n)), random.standard_normal((n, 3))
        g, q = b @ b.T, np.eye(n)
        x = riccati(a, g, q, 8.0)
        assert np.abs(a.T @ x + x @ a - x @ g @ x + q).max() < 1e-9 * np.abs(x).max()
        assert np.linalg.eigvals(a - g @ x).real.max() < 0.0
    with pytest.raises(ControlError, match="no gain stabilises"):
        riccati(np.eye(2), np.diag([1.0, 0.0]), np.eye(2), 8.0)


def test_margins_are_those_of_a_loop_that_is_known() -> None:
    frequency = np.geomspace(0.05, 50.0, 4000)
    s = 1j * frequency
    found = smallest_margins(np.array([4.0 / (s * (s + 1.0) * (s + 4.0))]), frequency)
    assert found.gain == pytest.approx(5.0, rel=1e-3)  # 4/(w^2 + ...) crosses at w = 2 with -4/20
    assert found.reduction == 0.0
    crossing = float(np.interp(0.0, -np.log(np.abs(4.0 / (s * (s + 1.0) * (s + 4.0)))), frequency))  # |L| = 1
    assert found.phase == pytest.approx(math.pi / 2 - math.atan(crossing) - math.atan(crossing / 4.0), abs=2e-3)
    assert found.delay == pytest.approx(found.phase / crossing, rel=2e-3)


def test_wrong_settings_and_aircraft_are_refused_with_what_would_be_right() -> None:
    with pytest.raises(ControlError, match="'law' is 'best'; expected one of fixed, indi, lq, auto"):
        ControlSettings(law="best")
    with pytest.raises(ControlError, match=r"'caution' is -1.0; expected 0 to 100"):
        ControlSettings(caution=-1.0)
    with pytest.raises(ControlError, match="'cautoin' does not exist"):
        ControlSettings().changed({"cautoin": 1.0})
    with pytest.raises(ControlError, match="'weights' has 2 values; expected 3"):
        ControlSettings(weights=(1.0, 2.0))
    good = aircraft()
    with pytest.raises(ControlError, match="invertible"):
        type(good)(**{**good.__dict__, "mixing": np.zeros((4, 4))})
    with pytest.raises(ControlError, match="expected low <= high"):
        type(good)(**{**good.__dict__, "low": (1.0, 0.0, 0.0, 0.0)})
    with pytest.raises(ControlError, match="a prior of shapes"):
        type(good)(**{**good.__dict__, "prior": Prior(A, B[:, :2])})
