"""What noise takes from a state's effect is given back, and what is not known of it is known of no other effect."""

from __future__ import annotations

import math

import numpy as np
import pytest

from msls_ros.estimation import Estimate, Identifier, from_mapping
from msls_ros.estimation.bank.regression import BankRegression
from msls_ros.estimation.kernel import Array
from msls_ros.estimation.regressor_noise import clear_defect, make_defect, observe_defect
from msls_ros.inputs.derivatives import usual_intervals

RATE, SPEED = 50, 30.0
A = np.array([[-0.9, SPEED], [-0.3, -3.0]])
B = np.array([[-5.5], [-30.0]])
"""w, Q by de."""
NAMES = {"states": ("w", "Q"), "effectors": ("de",), "known_gravity": False, "sample_rate": float(RATE)}
SEEDS = range(6)


def fly(seed: int, noise: float, gusts: float = 0.0) -> tuple[Array, Array, Array, Array]:
    """Return time, states, derivatives, deflections: doublets of the elevator.

    ``noise`` times .01 of the speed in w, 3 mrad/s in Q; ``gusts``, which the vane and the aircraft feel, [m/s] in a
    second, a random walk that dies away in two.
    """
    n, parts = 60 * RATE, 4
    random = np.random.default_rng(seed)
    time = np.arange(n) / RATE
    u = np.zeros((n, 1))
    for start in range(2 * RATE, n, 6 * RATE):
        unit = round(random.uniform(0.3, 0.8) * RATE)
        u[start : start + unit] = random.uniform(0.02, 0.06)
        u[start + unit : start + 2 * unit] = -u[start]
    x, slopes, now, gust = np.zeros((n, 2)), np.zeros((n, 2)), np.zeros(2), 0.0
    for k in range(n):
        air = now + np.array([gust, 0.0])
        x[k], slopes[k] = air, A @ air + B @ u[k]
        for _ in range(parts):
            now = now + (A @ (now + np.array([gust, 0.0])) + B @ u[k]) / (parts * RATE)
        gust += -0.5 * gust / RATE + gusts * random.normal() / math.sqrt(RATE)
    x = x + noise * np.array([0.01 * SPEED, 0.003]) * random.normal(size=x.shape)
    slopes = slopes + noise * np.array([0.1, 0.015]) * random.normal(size=x.shape)
    return time, x, slopes, u


def identify(flight: tuple[Array, Array, Array, Array], straddle: int = 0) -> tuple[Estimate, Array]:
    """Return the last estimate, and what is added to the rows' least squares there, (r, p), constant first.

    Of states as they are measured: `state_filter` would take most of the noise off before.
    """
    identifier = Identifier(from_mapping(NAMES), straddle)
    identifier._preparation._filters = False
    last = identifier.run(*flight).estimates[-1]
    engine = identifier._regression
    assert isinstance(engine, BankRegression)
    return last, engine.state.correction


@pytest.mark.parametrize("noise", [1.0, 3.0])
def test_what_noise_takes_from_a_state_and_gives_to_the_elevator_is_given_back(noise: float) -> None:
    better = []
    for seed in SEEDS:
        last, correction = identify(fly(seed, noise))
        plain = abs(last.b[0, 0] - correction[0, 3] - B[0, 0])
        better.append(abs(last.b[0, 0] - B[0, 0]) / plain)
        assert plain > 1.2, "by least squares the elevator does what the angle of attack does"
        assert abs(last.a[0, 0] - A[0, 0]) < abs(last.a[0, 0] - correction[0, 1] - A[0, 0])
        assert abs(last.a[0, 1] - A[0, 1]) < abs(last.a[0, 1] - correction[0, 2] - A[0, 1])
    assert np.median(better) < (0.35 if noise == 1.0 else 0.7)
    assert max(better) < (0.6 if noise == 1.0 else 0.85)


@pytest.mark.parametrize("noise", [1.0, 3.0])
def test_an_elevator_whose_angle_of_attack_is_lost_in_noise_is_not_known_for_certain(noise: float) -> None:
    off = []
    for seed in SEEDS:
        last, _ = identify(fly(seed, noise))
        for value, error, sure, true in (
            (last.a, last.a_std, last.a_reliable, A),
            (last.b, last.b_std, last.b_reliable, B),
        ):
            off += list((abs(value - true) / error)[sure])
    assert len(off) > 2 * len(SEEDS)
    assert np.mean(np.array(off) <= 1.96) >= 0.9


def test_without_noise_it_is_known_and_nothing_is_corrected() -> None:
    last, correction = identify(fly(0, 0.0))
    assert last.b_reliable.all()
    assert last.b_std[0, 0] < 0.1 * abs(B[0, 0])
    assert abs(correction[0, 3]) < 0.01 * abs(B[0, 0])


def test_a_gust_that_the_aircraft_feels_is_no_error_of_the_vane() -> None:
    last, correction = identify(fly(0, 0.0, gusts=1.0))
    assert abs(last.a[0, 0] - A[0, 0]) < 0.05 * abs(A[0, 0])
    assert abs(correction[0, 1]) < 0.02 * abs(A[0, 0])


def test_through_windows_nothing_is_corrected() -> None:
    _, correction = identify(fly(0, 1.0), usual_intervals(RATE))
    assert (correction == 0.0).all()


def test_white_noise_of_a_state_is_what_the_next_step_takes_back_and_no_gust() -> None:
    n = 600
    random = np.random.default_rng(5)
    time = np.arange(n) / RATE
    gust = np.cumsum(random.normal(size=n)) * 0.2
    x = np.column_stack([gust, gust + 0.5 * random.normal(size=n), 0.5 * random.normal(size=n)])
    defect, out = make_defect(("u", "v", "w"), 0, float(RATE)), np.zeros((n, 6))
    clear_defect(defect)
    observe_defect(defect, time, x, np.zeros((n, 3)), np.zeros((n, 0)), np.arange(3), out, x.copy())
    found = np.median(out[200:], axis=0)
    assert found[3] < 0.1 * found[0], "a gust is noise between state and derivative, and not white"
    assert found[4:] == pytest.approx(0.25, rel=0.3)
