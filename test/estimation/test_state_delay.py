"""Velocities that are measured after their derivatives: how late they are is found, and put right."""

from __future__ import annotations

import numpy as np
import pytest

from msls_ros.estimation import Estimate, Identifier, from_mapping
from msls_ros.estimation.kernel import Array
from msls_ros.estimation.regressor_noise import clear_defect, make_defect, make_noise, observe_defect

RATE = 50.0
A = np.array([[-2.0, 25.0], [-0.8, -3.0]])
B = np.array([[-4.0], [-20.0]])
FINE = 20
Flight = tuple[Array, Array, Array, Array]


def fly(gusts: float = 0.0, seed: int = 0, seconds: float = 40.0) -> Flight:
    """Return time, states w and Q through the air, their derivatives less gusts, and deflections, `FINE` per sample."""
    random = np.random.default_rng(seed)
    dt = 1.0 / RATE / FINE
    n = round(seconds * RATE) * FINE
    time = dt * np.arange(n, dtype=np.float64)
    delta = np.zeros((n, 1))
    for start in np.arange(3.0, seconds - 3.0, 5.0):
        for begin, end, size in ((0.0, 0.6, 0.05), (0.6, 1.0, -0.05), (1.0, 1.2, 0.05)):
            delta[(time >= start + begin) & (time < start + end)] = size
    x, slopes, own, gust = np.zeros((n, 2)), np.zeros((n, 2)), np.zeros(2), 0.0
    for k in range(n):
        x[k] = own[0] + gust, own[1]
        slopes[k] = A @ x[k] + B @ delta[k]
        own = own + dt * slopes[k]
        gust += -dt * gust / 2.0 + gusts * np.sqrt(dt) * random.normal()
    return time, x, slopes, delta


def record(flight: Flight, late: float, lag: float, noise: float = 0.01) -> Flight:
    """Return what is sampled of a flight, w delayed by ``late`` and lagging by ``lag`` [s], noise of w [m/s]."""
    time, x, slopes, delta = flight
    random = np.random.default_rng(1)
    w = np.interp(time - late, time, x[:, 0])
    if lag > 0.0:
        stays = np.exp(-(time[1] - time[0]) / lag)
        for k in range(1, len(w)):
            w[k] = stays * w[k - 1] + (1.0 - stays) * w[k]
    seen = np.column_stack([w, x[:, 1]])[::FINE]
    seen += random.normal(size=seen.shape) * [noise, 0.001]
    moves = slopes[::FINE] + random.normal(size=seen.shape) * [0.03, 0.03]
    return time[::FINE], seen, moves, delta[::FINE]


def find(samples: Flight) -> tuple[float, Array]:
    """Return how late w is found to be at the end [s], and w as it is learnt from."""
    time, x, slopes, delta = samples
    defect = make_defect(("w", "Q"), 1, RATE)
    clear_defect(defect)
    aligned = x.copy()
    observe_defect(defect, time, x, slopes, delta, np.arange(2), make_noise(len(x), 2), aligned)
    assert defect.delay.late[1] == 0.0 and (aligned[:, 1] == x[:, 1]).all(), "an angular rate is left as it is"
    return float(defect.delay.late[0]), aligned[:, 0]


@pytest.mark.parametrize(("late", "lag"), [(0.015, 0.0), (0.03, 0.0), (-0.02, 0.0), (0.0, 0.03)])
def test_how_late_a_velocity_is_is_found_and_put_right(late: float, lag: float) -> None:
    flight = fly()
    samples = record(flight, late, lag)
    found, aligned = find(samples)
    assert found == pytest.approx(late + lag, abs=0.004)
    half = len(aligned) // 2
    true = flight[1][::FINE, 0][half:]
    left, was = (float(np.std(w[half:] - true)) for w in (aligned, samples[1][:, 0]))
    assert left < 0.3 * was + 0.01


@pytest.mark.parametrize(("noise", "gusts"), [(0.1, 0.0), (0.2, 0.0), (0.01, 0.1)])
def test_noise_and_light_gusts_do_not_hide_it(noise: float, gusts: float) -> None:
    """Of noise of .2, a tenth of the motion, it was none while an aircraft might answer gusts with 10/s."""
    for late, lag in ((0.03, 0.0), (0.0, 0.04)):
        found, _ = find(record(fly(gusts), late, lag, noise))
        assert found == pytest.approx(late + lag, abs=0.006)


@pytest.mark.parametrize("gusts", [0.1, 0.3, 0.6, 1.0])
def test_gusts_are_no_delay(gusts: float) -> None:
    """A gust moves the velocity first, and the aircraft answers it, as it would if the velocity were late."""
    samples = record(fly(gusts), 0.0, 0.0)
    found, aligned = find(samples)
    moved = aligned - samples[1][:, 0]
    assert found == 0.0 and float(np.std(moved)) < 0.01 * float(np.std(aligned))


@pytest.mark.parametrize("noise", [0.0, 0.05, 0.3])
def test_noise_is_no_delay(noise: float) -> None:
    assert abs(find(record(fly(), 0.0, 0.0, noise))[0]) < 0.002


def test_nothing_is_put_right_before_it_is_certain() -> None:
    samples = record(fly(), 0.03, 0.0)
    _, aligned = find(samples)
    before = samples[0] < 3.0
    assert (aligned[before] == samples[1][before, 0]).all(), "nothing has moved yet"


@pytest.mark.parametrize("fine", [1, 2])
def test_integration_by_eulers_rule_is_no_delay(fine: int) -> None:
    """A simulator's velocity is half a step of integration behind its derivative, and right as it stands."""
    dt = 1.0 / RATE / fine
    n = round(60.0 / dt)
    delta = 0.05 * np.sign(np.sin(2.0 * np.pi * 0.7 * dt * np.arange(n)))[:, None]
    x, slopes = np.zeros((n, 2)), np.zeros((n, 2))
    for k in range(n):
        slopes[k] = A @ x[k] + B @ delta[k]
        x[k + 1 : k + 2] = x[k] + dt * slopes[k]
    kept = slice(None, None, fine)
    time = dt * np.arange(n, dtype=np.float64)
    found, aligned = find((time[kept], x[kept], slopes[kept], delta[kept]))
    assert found == 0.0 and (aligned == x[kept, 0]).all()


def identify(samples: Flight, method: str = "bank") -> Estimate:
    names = {"states": ("w", "Q"), "effectors": ("de",), "sample_rate": RATE, "known_gravity": False}
    return Identifier(from_mapping({**names, "estimator.method": method})).run(*samples).estimates[-1]


@pytest.mark.parametrize(("late", "lag"), [(0.0, 0.0), (0.02, 0.0), (0.0, 0.04)])
def test_the_model_of_a_late_velocity_is_that_of_the_aircraft(late: float, lag: float) -> None:
    estimate = identify(record(fly(), late, lag))
    assert estimate.state_delay.tolist()[1:] == [0.0]
    assert estimate.state_delay[0] == pytest.approx(late + lag, abs=0.006)
    assert (abs(estimate.a - A)[estimate.a_reliable] <= 3.0 * estimate.a_std[estimate.a_reliable]).all()
    assert (abs(estimate.b - B)[estimate.b_reliable] <= 3.0 * estimate.b_std[estimate.b_reliable]).all()
    assert estimate.a_reliable.sum() >= 3 and estimate.b_reliable.sum() == 2


def test_the_papers_method_takes_velocities_as_they_are() -> None:
    assert identify(record(fly(), 0.03, 0.0), "msls").state_delay.tolist() == [0.0, 0.0]


def test_a_delay_that_gusts_hide_is_in_the_errors_of_a() -> None:
    """Gusts may have made it, and it is not put right: without that A, where called reliable, was covered in .50."""
    reliable, covered = 0, 0
    for seed in range(3):
        names = {"states": ("w", "Q"), "effectors": ("de",), "sample_rate": RATE, "known_gravity": False}
        flight = record(fly(0.6, seed), 0.0, 0.05)
        for one in Identifier(from_mapping(names)).run(*flight, every=25).estimates:
            inside = abs(one.a - A) <= 1.96 * one.a_std
            reliable += int(one.a_reliable.sum())
            covered += int((one.a_reliable & inside).sum())
    assert reliable > 100 and covered >= 0.9 * reliable
