"""What the compiled core promises: eq 14 to the last digits, the same bits compiled or not, finite in any units."""

from __future__ import annotations

import math
import os
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msls_ros.estimation import MSLS, RLS, EstimationError
from msls_ros.estimation.kernel import (
    Array,
    inverse_diagonal,
    make_work,
    msls_gain,
    propagate_covariance,
    rls_gain,
)

EXAMPLES = settings(derandomize=True, deadline=None, max_examples=60)
SIZES = st.integers(1, 9)
SEEDS = st.integers(0, 2**32 - 1)
FORGETTING = st.floats(0.1, 1.0)

BITS = """
import hashlib
import numpy as np
from msls_ros.estimation import MSLS, RLS
from msls_ros.estimation.compiled import HAVE_NUMBA
rng = np.random.default_rng(7)
phi, y = rng.normal(size=(150, 5)) * 10.0 ** rng.uniform(-6, 6, 5), rng.normal(size=(150, 3))
phi[40:60] = 0.0
digest = hashlib.sha256()
for kind in (MSLS(5, 3, 0.9, 0.01), MSLS(5, 3, 0.5, 1e-3, retained=False), RLS(5, 3, 0.98)):
    for k in range(150):
        digest.update(kind.update(phi[k], y[k]).tobytes())
        digest.update(kind.theta.tobytes() + kind.standard_errors().tobytes())
print(HAVE_NUMBA, digest.hexdigest())
"""


def stream(seed: int, p: int, rows: int, samples: int) -> tuple[Array, Array]:
    rng = np.random.default_rng(seed)
    return rng.normal(size=(samples, p)), rng.normal(size=(samples, rows))


def relative(found: Array, expected: Array) -> float:
    return float(np.linalg.norm(found - expected) / np.linalg.norm(expected))


@EXAMPLES
@given(SEEDS, SIZES, FORGETTING, st.floats(1e-2, 10.0))
def test_retained_penalty_equals_a_dense_qr_of_the_stacked_rows_of_eq_14(
    seed: int, p: int, forgetting: float, w0: float
) -> None:
    phi, y = stream(seed, p, 2, 40)
    ours = MSLS(p, 2, forgetting, w0)
    factor, theta = np.zeros((p, p)), np.zeros((2, p))
    for x, out in zip(phi, y, strict=True):
        stacked = np.vstack([math.sqrt(forgetting) * factor, x, w0 * np.eye(p)])
        right = np.concatenate([np.zeros(p), [1.0], np.zeros(p)])
        q, factor = np.linalg.qr(stacked)
        theta += np.outer(out - theta @ x, np.linalg.solve(factor, q.T @ right))
        ours.update(x, out)
        assert relative(ours.theta, theta) < 1e-12


@EXAMPLES
@given(SEEDS, SIZES, FORGETTING, st.floats(1e-2, 10.0))
def test_penalty_at_the_solve_only_equals_a_dense_solution(seed: int, p: int, forgetting: float, w0: float) -> None:
    phi, _ = stream(seed, p, 1, 30)
    R, omega, penalty, work = np.zeros((p, p)), np.zeros(p), np.full(p, w0), make_work(p)
    information = np.zeros((p, p))
    for x in phi:
        msls_gain(R, omega, x, penalty, 1.0, forgetting, False, work)
        information = forgetting * information + np.outer(x, x)
        assert relative(R.T @ R, information) < 1e-12
        stacked = np.vstack([R, w0 * np.eye(p)])
        _, S = np.linalg.qr(stacked)
        gain = np.linalg.solve(S, np.linalg.solve(S.T, x))
        assert relative(work.K, gain) < 1e-11


@EXAMPLES
@given(SEEDS, SIZES, FORGETTING, st.booleans(), st.data())
def test_scaling_a_regressor_by_a_power_of_two_scales_its_estimates_by_exactly_the_inverse(
    seed: int, p: int, forgetting: float, retained: bool, data: st.DataObject
) -> None:
    phi, y = stream(seed, p, 2, 40)
    scale = 2.0 ** np.array(data.draw(st.lists(st.integers(-40, 40), min_size=p, max_size=p)))
    plain, scaled = MSLS(p, 2, forgetting, 0.01, retained=retained), MSLS(
        p, 2, forgetting, 0.01 * scale, retained=retained
    )  # fmt: skip
    for x, out in zip(phi, y, strict=True):
        np.testing.assert_array_equal(plain.update(x, out), scaled.update(x * scale, out))
        np.testing.assert_array_equal(plain.theta, scaled.theta * scale)
        np.testing.assert_array_equal(plain.standard_errors(), scaled.standard_errors() * scale)


@EXAMPLES
@given(SEEDS, SIZES, st.permutations(range(4)))
def test_the_order_of_rows_is_irrelevant(seed: int, p: int, order: list[int]) -> None:
    phi, y = stream(seed, p, 4, 20)
    straight, permuted = MSLS(p, 4, 0.95, 0.01), MSLS(p, 4, 0.95, 0.01)
    for x, out in zip(phi, y, strict=True):
        straight.update(x, out)
        permuted.update(x, out[order])
    np.testing.assert_array_equal(permuted.theta, straight.theta[order])


@EXAMPLES
@given(SEEDS, st.lists(st.floats(-9.0, 9.0), min_size=2, max_size=6), FORGETTING, st.floats(-9.0, 9.0))
def test_any_units_give_finite_numbers(seed: int, exponents: list[float], forgetting: float, output: float) -> None:
    p = len(exponents)
    phi, y = stream(seed, p, 2, 200)
    phi[100:150] = 0.0
    scale = 10.0 ** np.array(exponents)
    for w0 in (np.full(p, 0.01), 0.01 * scale, 1e-6 * scale, np.zeros(p)):
        for retained in (True, False):
            ours = MSLS(p, 2, forgetting, w0, retained=retained)
            for x, out in zip(phi * scale, y * 10.0**output, strict=True):
                assert np.isfinite(ours.update(x, out)).all()
            assert np.isfinite(ours.theta).all()
            assert np.isfinite(ours.standard_errors()).all()


@pytest.mark.parametrize("retained", [True, False])
@pytest.mark.parametrize("forgetting", [0.1, 0.99])
def test_a_million_unexcited_samples_leave_the_estimate_alone(retained: bool, forgetting: float) -> None:
    phi, y = stream(3, 3, 1, 300)
    ours = MSLS(3, 1, forgetting, 0.01, retained=retained)
    for x, out in zip(phi, y, strict=True):
        ours.update(x, out)
    before = ours.theta.copy()
    quiet, out = np.zeros(3), np.zeros(1)
    for _ in range(250_000):
        ours.update(quiet, out)
    np.testing.assert_array_equal(ours.theta, before)
    quiet[0] = 1.0
    for _ in range(750_000):
        ours.update(quiet, out)
    assert np.isfinite(ours.theta).all()
    assert np.isfinite(ours.standard_errors()).all()
    assert abs(ours.theta[0, 0]) < 1e-9


def test_compiled_and_interpreted_give_the_same_bits() -> None:
    outputs = []
    for disable in ("0", "1"):
        environment = {**os.environ, "NUMBA_DISABLE_JIT": disable}
        done = subprocess.run(
            [sys.executable, "-c", BITS], env=environment, capture_output=True, text=True, check=True
        )  # fmt: skip
        outputs.append(done.stdout.split())
    assert outputs[0][1] == outputs[1][1]
    assert outputs[1][0] == "False"


def test_a_pivot_without_information_is_never_divided_by() -> None:
    ours = MSLS(3, 1, 0.9, 0.0)
    for k in range(50):
        ours.update(np.array([1.0, 0.0, 0.1 * k]), np.array([2.0]))
    np.testing.assert_allclose(ours.theta[0], [2.0, 0.0, 0.0], atol=1e-12)
    assert ours.theta[0, 1] == 0.0


@EXAMPLES
@given(SEEDS, SIZES)
def test_inverse_diagonal_equals_the_dense_inverse(seed: int, p: int) -> None:
    rng = np.random.default_rng(seed)
    upper = np.triu(rng.normal(size=(p, p))) + 3.0 * np.eye(p)
    found = np.zeros(p)
    columns = np.vstack([upper.T, np.full(p, math.nan)])
    inverse_diagonal(columns, np.full((p + 1, p), math.nan), found)
    np.testing.assert_allclose(found, np.diagonal(np.linalg.inv(upper.T @ upper)), rtol=1e-11)


def test_inverse_diagonal_is_infinite_where_a_pivot_is_zero_and_right_elsewhere() -> None:
    columns = np.array([[2.0, 0.0, 0.0], [1.0, 0.0, 0.0], [3.0, 5.0, 4.0], [0.0, 0.0, 0.0]])
    found = np.zeros(3)
    inverse_diagonal(columns, np.zeros((4, 3)), found)
    kept = np.array([[2.0, 3.0], [0.0, 4.0]])
    np.testing.assert_allclose(found[[0, 2]], np.diagonal(np.linalg.inv(kept.T @ kept)))
    assert found[1] == math.inf


@EXAMPLES
@given(SEEDS, SIZES, st.floats(-0.9, 0.995))
def test_covariance_follows_the_markov_chain_of_error_and_residual(seed: int, p: int, rho: float) -> None:
    rng = np.random.default_rng(seed)
    P, c, u, b = np.eye(p), np.zeros(p), np.zeros(p), 0.0
    joint = np.eye(p + 1)  # covariance of the pair (parameter error, residual)
    previous = np.zeros(p + 1)  # its covariance with the last prediction error
    for _ in range(20):
        phi, K = rng.normal(size=p), 0.3 * rng.normal(size=p)
        h = np.append(phi, 1.0)
        step = np.eye(p + 1)
        step[:p] -= np.outer(K, h)
        step[p, p] = rho
        noise = np.zeros((p + 1, p + 1))
        noise[p, p] = 1.0 - rho**2
        variance, lag, b = propagate_covariance(P, c, u, b, rho, phi, K, np.zeros(p))
        assert variance == pytest.approx(h @ joint @ h, rel=1e-9)
        assert lag == pytest.approx(h @ previous, rel=1e-9, abs=1e-9)
        previous = step @ joint @ h
        joint = step @ joint @ step.T + noise
        np.testing.assert_array_equal(P, P.T)
        np.testing.assert_allclose(P, joint[:p, :p], rtol=1e-9, atol=1e-9 * np.abs(P).max())
        np.testing.assert_allclose(c, joint[:p, p], rtol=1e-9, atol=1e-9)


@EXAMPLES
@given(SEEDS, SIZES, st.floats(0.8, 1.0))
def test_rls_equals_weighted_least_squares_and_stays_symmetric(seed: int, p: int, forgetting: float) -> None:
    phi, y = stream(seed, p, 1, 40)
    rls, C, work = RLS(p, 1, forgetting, prior=1e4), 1e4 * np.eye(p), make_work(p)
    for x, out in zip(phi, y, strict=True):
        rls.update(x, out)
        rls_gain(C, x, forgetting, work)
        np.testing.assert_array_equal(C, C.T)
    weight = forgetting ** np.arange(39.0, -1.0, -1.0)
    information = (phi.T * weight) @ phi + forgetting**40 / 1e4 * np.eye(p)
    np.testing.assert_allclose(rls.theta[0], np.linalg.solve(information, (phi.T * weight) @ y[:, 0]), rtol=1e-6)


@pytest.mark.parametrize("kind", [MSLS(2, 3, 0.9, 0.1), RLS(2, 3, 0.9)])
@pytest.mark.parametrize(
    ("phi", "y"),
    [
        ([1.0, math.nan], [1.0, 1.0, 1.0]),
        ([1.0, 1.0], [1.0, math.inf, 1.0]),
        ([1.0, 1.0, 1.0], [1.0, 1.0, 1.0]),
        ([1.0, 1.0], [1.0, 1.0]),
        ([[1.0, 1.0]], [1.0, 1.0, 1.0]),
    ],
)
def test_bad_samples_are_refused_and_change_nothing(kind: MSLS | RLS, phi: list[float], y: list[float]) -> None:
    kind.update(np.array([1.0, 2.0]), np.array([1.0, 2.0, 3.0]))
    theta, errors = kind.theta.copy(), kind.standard_errors()
    with pytest.raises(EstimationError):
        kind.update(np.array(phi), np.array(y))
    np.testing.assert_array_equal(kind.theta, theta)
    np.testing.assert_array_equal(kind.standard_errors(), errors)


def test_any_layout_of_a_sample_is_the_same_sample() -> None:
    phi, y = stream(1, 4, 2, 8)
    plain, other = MSLS(4, 2, 0.9, 0.1), MSLS(4, 2, 0.9, 0.1)
    for x, out in zip(phi, y, strict=True):
        first = plain.update(x, out)
        strided = np.repeat(x, 2)[::2]
        np.testing.assert_array_equal(other.update(strided, np.asfortranarray(out)), first)
    np.testing.assert_array_equal(plain.update(np.ones(4), np.ones(2)), other.update(np.ones(4, int), np.ones(2, int)))
