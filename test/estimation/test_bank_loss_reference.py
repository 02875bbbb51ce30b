"""What older estimates did not know is no change: it is whitened by its error, or projected out."""

from __future__ import annotations

import math

import numpy as np
import pytest
from estimation.test_bank import PERIOD, SMALL
from estimation.test_bank_loss_noise import INTERVALS, TRUTH, engine_of, fly

from msls_ros.estimation import Identifier, from_mapping
from msls_ros.estimation.bank.loss_reference import discount_reference, whiten, whiten_directions
from msls_ros.estimation.bank.losses import KNOWN_WELL, compare_surfaces, find_loss
from msls_ros.estimation.bank.regression import BankRegression
from msls_ros.estimation.kernel import Array

FIRST = 4
"""Of the effectors among the coefficients, constant first; before it are three states."""


def prepared(
    square: Array, noise: float = 0.5, intervals: int = INTERVALS
) -> tuple[BankRegression, Array, Array, float]:
    """Return an engine after both steps, the factor and the change before them, and the degrees taken."""
    random = np.random.default_rng(3)
    engine = engine_of(Identifier(from_mapping({**SMALL, "sample_rate": 1.0 / PERIOD}), intervals))
    work = engine._work
    p = len(work.w)
    factor, w = np.triu(random.normal(size=(p, p)) + 3.0 * np.eye(p)), random.normal(size=p)
    work.columns[:], work.w[:], work.whitening[:] = factor.T, w, random.uniform(0.5, 2.0, p)
    work.steps[:, 1:] = (factor[1:, FIRST:] @ np.diag([1.0, 1.0])).T
    whiten_directions(work)
    whiten(work)
    scale = work.whitening[1:]
    taken = discount_reference(engine.settings, TRUTH, square, 0, noise, KNOWN_WELL, work)
    return engine, scale[:, None] * factor[1:, 1:], scale * w[1:], taken


@pytest.mark.parametrize("error", [0.3, 30.0])
def test_products_are_those_by_the_covariance_with_the_errors_of_the_older_estimates(error: float) -> None:
    """In ``w' cov^-1 w`` the noise is n/2; only what is not known well counts."""
    square = np.full_like(TRUTH, 1e-6)
    square[0, [1, 3, 5]] = error * error
    noise = 0.5
    engine, factor, w, taken = prepared(square, noise)
    work = engine._work
    covariance = np.eye(len(w))
    unknown = [j for j in range(1, 6) if square[0, j] >= (KNOWN_WELL * TRUTH[0, j]) ** 2]
    assert unknown == ([2, 3, 5] if error < 1.0 else [1, 2, 3, 5])
    for j in unknown:
        covariance += 2.0 / noise * square[0, j] * np.outer(factor[:, j - 1], factor[:, j - 1])
    inverse = np.linalg.inv(covariance)
    for k in range(2):
        step = factor[:, FIRST - 1 + k]
        own = work.white_steps[k, 1:]
        assert own @ own == pytest.approx(step @ inverse @ step, rel=1e-9)
        assert own @ work.w[1:] == pytest.approx(step @ inverse @ w, rel=1e-9)
    assert work.w[1:] @ work.w[1:] == pytest.approx(w @ inverse @ w, rel=1e-9)
    assert taken == pytest.approx(len(w) - np.trace(inverse), abs=0.1)


def test_what_was_never_known_is_projected_out() -> None:
    square = np.full_like(TRUTH, 1e-12)
    square[0, [2, 5]] = math.inf
    engine, factor, w, taken = prepared(square)
    unknown = factor[:, [1, 4]]
    left = w - unknown @ np.linalg.lstsq(unknown, w, rcond=None)[0]
    assert engine._work.w[1:] == pytest.approx(left, rel=1e-6)
    assert taken == pytest.approx(2.0, abs=1e-6)


def test_where_derivatives_are_measured_errors_of_states_alone_are_whitened() -> None:
    square = np.full_like(TRUTH, 1e-12)
    square[0, 2] = 0.09
    _, _, alone, taken = prepared(square, intervals=0)
    square[0, FIRST:] = math.inf
    _, _, both, taken_with_effectors = prepared(square, intervals=0)
    assert np.array_equal(alone, both)
    assert taken == taken_with_effectors > 0.0


def changed(effector: int, by: float, square: Array) -> tuple[int, float]:
    """Return which loss is seen, and by how many standard errors that of da.

    The older estimates differ from the truth in one effector's effect on the first row; square is of their errors.
    """
    engine = engine_of(fly(9, noise=1e-4))
    s, x, work = engine.settings, engine.state, engine._work
    before = TRUTH.copy()
    before[0, FIRST + effector] += by
    work.concerned[:] = [1, 0, 0]
    excess = compare_surfaces(s, x, len(s.loss_members) - 1, before, square, KNOWN_WELL, True, s.straddle > 0, work)
    return find_loss(s, work, excess, 4.0), float(work.deviation[0])


def test_an_effect_that_was_never_known_is_not_taken_for_a_loss_of_another() -> None:
    square = np.full_like(TRUTH, 1e-4)
    assert changed(0, 8.0, square)[0] == 0, "half of da is lost"
    assert abs(changed(0, 0.0, square)[1]) < 3.0
    known, unknown = square.copy(), square.copy()
    unknown[0, FIRST + 1] = 1e6
    assert changed(1, -100.0, known)[1] > 8.0, "what dr does is in part what da would have done"
    seen, deviation = changed(1, -100.0, unknown)
    assert seen < 0 and abs(deviation) < 1.0
    assert changed(0, 8.0, unknown)[0] == 0, "half of da is still seen"
