"""Whether the air moves: told from velocities and accelerations; not noise, manoeuvres, gaps or made derivatives."""

from __future__ import annotations

import numpy as np
import pytest

from msls_ros.estimation.gusts import WINDOW, clear_air, make_air, observe_air

STEP, FORGETTING = 0.02, 1.0 - 1.0 / 150.0


def share(time: np.ndarray, x: np.ndarray, xdot: np.ndarray, pieces: int = 1) -> float:
    air = make_air(3)
    clear_air(air)
    found = 0.0
    for part in np.array_split(np.arange(len(time)), pieces):
        found = observe_air(air, time[part], x[part], xdot[part], np.arange(3), FORGETTING)
    return found


def motion(n: int = 1000, *, gust: float = 0.0, noise: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, velocities through the air, accelerations: a weave, a random walk of the air, noise of the velocities."""
    rng = np.random.default_rng(3)
    time = np.arange(n) * STEP
    phase = np.array([0.0, 1.0, 2.0])
    x = 70.0 + 0.5 * np.sin(2.0 * time[:, None] + phase)
    xdot = np.cos(2.0 * time[:, None] + phase)
    x = x + gust * np.cumsum(rng.standard_normal((n, 3)), axis=0) + noise * rng.standard_normal((n, 3))
    return time, x, xdot


def test_a_manoeuvre_in_still_air_is_none_of_the_airs() -> None:
    assert share(*motion()) < 1e-4


def test_noise_of_the_velocities_is_no_gust() -> None:
    assert share(*motion(noise=0.06)) < 0.01


@pytest.mark.parametrize("noise", [0.0, 0.06])
def test_moving_air_is_told(noise: float) -> None:
    assert share(*motion(gust=0.1, noise=noise)) > 0.2


def test_derivatives_made_from_the_velocities_tell_nothing() -> None:
    time, x, _ = motion(gust=0.1)
    assert share(time, x, np.gradient(x, STEP, axis=0)) < 0.05


def test_a_gap_or_a_time_that_goes_back_is_no_gust() -> None:
    time, x, xdot = motion()
    keep = np.r_[0:300, 340:341, 400:700]
    assert share(time[keep], x[keep], xdot[keep]) < 1e-4
    time[500:] -= 8.0
    x[500:] += 20.0
    assert share(time, x, xdot) < 1e-4


def test_a_window_must_be_full_before_anything_is_said() -> None:
    time, x, xdot = motion(gust=0.1)
    assert share(time[: WINDOW + 1], x[: WINDOW + 1], xdot[: WINDOW + 1]) == 0.0
    assert share(time[: 3 * WINDOW], x[: 3 * WINDOW], xdot[: 3 * WINDOW]) > 0.1


def test_smoothed_noise_of_the_velocities_is_no_gust() -> None:
    time, x, _ = motion(noise=0.2)
    smooth = np.stack([np.convolve(v, np.ones(9) / 9.0, "same") for v in x.T], axis=1)
    made = np.stack([np.convolve(v, np.arange(4, -5, -1) / 60.0 / STEP, "same") for v in x.T], axis=1)
    inside = slice(20, -20)
    assert share(time[inside], smooth[inside], made[inside]) < 0.05


def test_a_small_bias_of_the_accelerometers_is_no_gust() -> None:
    time, x, xdot = motion(noise=0.02)
    assert share(time, x, xdot + 0.05) < 0.05


def test_one_by_one_and_in_one_piece_give_the_same_bits() -> None:
    flight = motion(gust=0.1, noise=0.06)
    assert share(*flight) == share(*flight, pieces=7) == share(*flight, pieces=1000)
