"""Answers to the colder questions: lag, numerics, information."""

from __future__ import annotations

import math

import numpy as np
import pytest

from msls_ros.paper.claims import find
from msls_ros.paper.linear_experiments import history_one, make_problem
from msls_ros.paper.linear_questions import (
    Finding,
    answer_breakdown,
    answer_information,
    answer_lag,
    answer_numerics,
    answer_precision,
    bisect,
    cholesky_gain,
    exact_gains,
    low_pass,
    phase_lag,
    sinusoid,
)


@pytest.fixture(scope="module")
def lag() -> list[Finding]:
    return answer_lag(4)


def test_a_known_delay_is_measured_as_lag() -> None:
    theta = sinusoid(1400, 600.0)[:, 0]
    delayed = np.concatenate([np.zeros(7), theta[:-7]])[None, :]
    assert phase_lag(delayed, 600.0, 200) == pytest.approx(7.0, abs=1e-6)


def test_the_lag_of_a_low_pass_is_the_one_of_theory() -> None:
    theta = sinusoid(1400, 600.0)[:1400, 0][None, :]
    assert phase_lag(low_pass(theta, 0.2), 600.0, 200) == pytest.approx(0.8 / 0.2, rel=0.01)


def test_bisection_finds_rising_and_falling_targets() -> None:
    assert bisect(lambda x: x * x, 0.0, 4.0, 2.0) == pytest.approx(math.sqrt(2.0), abs=4e-3)
    assert bisect(lambda x: -x, 0.0, 4.0, -3.0) == pytest.approx(3.0, abs=4e-3)


def test_the_penalty_lags_far_less_than_a_low_pass_of_the_same_noise(lag: list[Finding]) -> None:
    ours, filtered = find(lag, "lag of MSLS, theta1", "600"), find(lag, "lag", "low-pass", "600")
    assert 0.8 <= ours <= 1.8
    assert filtered >= 2.5 * ours
    assert find(lag, "error of MSLS") < 0.7 * find(lag, "error", "low-pass")
    assert find(lag, "error of MSLS") < 0.7 * find(lag, "error", "lambda tuned")


def test_equation_13_as_printed_lags_many_samples(lag: list[Finding]) -> None:
    assert 15.0 <= find(lag, "eq 13 as printed, theta1 of period 600") <= 21.0


def test_exact_gains_are_those_of_a_least_squares_solution() -> None:
    phi = make_problem(0, history_one(30)).phi
    weights = math.sqrt(0.5) ** np.arange(29, -1, -1)
    rows = [phi * weights[:, None]]
    rows += [w * 0.03 * np.eye(2) for w in weights]
    stacked = np.vstack(rows)
    target = np.zeros(len(stacked))
    target[29] = 1.0
    expected = np.linalg.lstsq(stacked, target, rcond=None)[0]
    np.testing.assert_allclose(exact_gains(phi, 0.03, 0.5)[-1], expected, rtol=1e-10)


def test_cholesky_solves_and_refuses_what_is_not_positive() -> None:
    generator = np.random.default_rng(0)
    a = generator.normal(size=(9, 5))
    phi = generator.normal(size=5)
    np.testing.assert_allclose(cholesky_gain(a.T @ a, phi), np.linalg.solve(a.T @ a, phi), rtol=1e-10)
    assert np.isnan(cholesky_gain(-np.eye(2), np.ones(2))).any()


def test_w0_alone_makes_normal_equations_accurate_in_float64() -> None:
    found = answer_numerics(200)
    for deviation in ("0.1:", "0.0001:", "1e-07:"):
        assert find(found, "W0 = 0.03,", deviation, "normal equations") < 1e-11
        assert find(found, "W0 = 0.03,", deviation, "square-root") < 1e-11
    assert find(found, "W0 = 0,", "1e-07:", "normal equations") == math.inf
    assert find(found, "W0 = 0,", "0.0001:", "square-root") < 1e-3 * find(
        found, "W0 = 0,", "0.0001:", "normal equations"
    )


def test_w0_cannot_tell_ganged_effectors_apart_and_dither_can() -> None:
    found = answer_information()
    for w in ("0.003", "0.0003", "3e-05"):
        assert find(found, f"w = {w}, dither 0 deg", "excitation") <= 0.5
        assert find(found, f"w = {w}, dither 0 deg", "error") > 0.9
    assert find(found, "w = 0.003, dither 1 deg", "excitation") >= 0.92
    assert find(found, "w = 0.003, dither 1 deg", "error") < 0.2


def test_dither_without_w0_leaves_nan_in_float32_and_w0_does_not() -> None:
    found = answer_precision(1000)
    for case in ("float64, dither", "float64, no dither", "float32, dither", "float32, no dither"):
        assert find(found, case, "with W0") == 0.0
    assert find(found, "float32, dither", "without W0", "Cholesky") > 100.0
    assert find(found, "float64, dither", "without W0", "Cholesky") == 0.0
    assert find(found, "float64, no dither", "without W0", "Cholesky") > 100.0
    assert find(found, "float32, no dither", "textbook RLS") < 1000.0


def test_textbook_rls_in_float32_doubles_its_error_at_half_the_noise() -> None:
    found = answer_breakdown(5)
    assert 1.7 < find(found, "noise in phi2 0.05:") / find(found, "noise in phi2 0.1:") < 2.5
    assert find(found, "finite") == 1.0
