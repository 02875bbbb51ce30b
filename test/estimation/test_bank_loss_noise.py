"""Noise of slopes by direction: least where an effector stays, and what is made of it where losses are looked for."""

from __future__ import annotations

import math

import numpy as np
import pytest
from estimation.test_bank import PERIOD, SMALL, uniform

from msls_ros.estimation import Identifier, from_mapping
from msls_ros.estimation.bank.loss_noise import BEGUN, find_whitening, noise_over, observe_sums
from msls_ros.estimation.bank.losses import KNOWN_WELL, compare_surfaces
from msls_ros.estimation.bank.regression import BankRegression
from msls_ros.inputs.derivatives import DerivativeFilter

INTERVALS = 4
LAST = -1
"""The member of a second and a half."""
TRUTH = np.array([[0.0, -3.0, 0.0, 0.0, 8.0, 0.0], [0.0, 0.0, -2.0, 0.0, 0.0, -4.0], [0.0, 0.0, 0.0, -1.0, 2.0, 0.0]])
"""(r, p), constant first."""


def engine_of(identifier: Identifier) -> BankRegression:
    engine = identifier._regression
    assert isinstance(engine, BankRegression)
    return engine


def windowed() -> Identifier:
    return Identifier(from_mapping({**SMALL, "sample_rate": 1.0 / PERIOD}), INTERVALS)


def fly(seed: int, n: int = 900, noise: float = 0.01) -> Identifier:
    """Identify a flight in which nothing breaks: one effector is held for seconds, another swings; slopes of rates."""
    time = PERIOD * np.arange(n, dtype=np.float64)
    delta = np.stack([0.1 * np.sign(np.sin(2.0 * time)), 0.05 * np.sin(9.0 * time)], axis=1)
    x = np.zeros((n, 3))
    for k in range(1, n):
        middle = 0.5 * (delta[k - 1] + delta[k])
        x[k] = x[k - 1] + PERIOD * (TRUTH[:, 1:4] @ x[k - 1] + TRUTH[:, 4:] @ middle)
    read = np.concatenate([x, delta], axis=1)
    read[:, :3] += noise * math.sqrt(3.0) * uniform(n, 3, seed)
    window = DerivativeFilter(INTERVALS, 5, 10**9)
    kept = [one for t, row in zip(time, read, strict=True) if (one := window.push(round(t * 1e9), row)) is not None]
    smooth, slope = np.array([one.smooth for one in kept]), np.array([one.slope for one in kept])
    identifier = windowed()
    identifier.run(np.array([one.stamp * 1e-9 for one in kept]), smooth[:, :3], slope[:, :3], smooth[:, 3:])
    return identifier


@pytest.mark.parametrize(
    "weights", [[1.0], [-2.0, -1.0, 0.0, 1.0, 2.0], [0.2, 0.6, 0.2]], ids=["white", "slopes", "values"]
)
def test_sums_have_the_variance_of_the_noise_that_is_summed(weights: list[float]) -> None:
    """A filter h of white noise has sums over B of the variance ``sum (h * 1_B)^2``."""
    engine = engine_of(windowed())
    s, x = engine.settings._replace(mean_forgetting=1.0), engine.state
    for e in np.convolve(np.random.default_rng(5).normal(size=40_000), weights, "valid"):
        observe_sums(s, x, 0, float(e), 0.5)
    for j in range(s.loss_sums):
        length = 2**j
        expected = float(np.sum(np.convolve(weights, np.ones(length)) ** 2)) / length
        assert x.sum_squares[0, j, 0] / x.sum_squares[0, j, 1] == pytest.approx(expected, rel=0.1), length


def test_variances_between_those_that_are_remembered_lie_between() -> None:
    engine = engine_of(windowed())
    s, x = engine.settings, engine.state
    x.sums_taken[:] = BEGUN * 2**s.loss_sums
    x.sum_squares[..., 1] = 1.0
    x.sum_squares[0, :, 0] = [9.0, 12.0, 10.0, 6.0, 3.0, 1.5][: s.loss_sums]
    last = [9.0, 12.0, 10.0, 6.0, 3.0, 1.5][s.loss_sums - 1]
    found = [noise_over(s, x, 0, samples) for samples in (1.0, INTERVALS, 6.0, 8.0, 12.0, 16.0, math.inf)]
    assert found == pytest.approx([12.0, 12.0, 9.0, 6.0, 4.5, 3.0, last])
    x.sums_taken[:] = BEGUN * 8
    assert noise_over(s, x, 0, math.inf) == 6.0, "of longer sums too few have been taken"
    x.sums_taken[:] = 0
    assert noise_over(s, x, 0, math.inf) == 0.0


def test_an_outlier_among_sums_counts_as_much_as_nine() -> None:
    engine = engine_of(windowed())
    s, x = engine.settings, engine.state
    for k in range(2000):
        observe_sums(s, x, 0, (-1.0) ** k, 1.0)
    before = x.sum_squares[0, 0].copy()
    observe_sums(s, x, 0, 1e6, 1.0)
    assert x.sum_squares[0, 0, 0] == pytest.approx(s.mean_forgetting * before[0] + 9.0, rel=1e-9)


def test_where_derivatives_are_measured_all_directions_have_the_same_noise() -> None:
    identifier = Identifier(from_mapping(SMALL))
    n = 300
    x, delta = 0.25 * uniform(n, 3, 1), 0.125 * uniform(n, 2, 2)
    xdot = 0.5 * uniform(n, 3, 3) - x
    identifier.run(PERIOD * np.arange(n, dtype=np.float64), x, xdot, delta)
    engine = engine_of(identifier)
    engine._work.whitening[:] = 0.0
    find_whitening(engine.settings, engine.state, 0, 0, 1.0, 0.1, engine._work)
    assert (engine._work.whitening == 1.0).all()


def test_what_is_held_and_what_swings_have_noise_of_their_own() -> None:
    """The standard deviation of a change, by what it is said to be: of an effector that is held and of one that swings.

    Of 24 flights; the estimates of a second and a half are held against the truth, which is known to be right.
    """
    off: list[list[float]] = [[], []]
    for seed in range(0, 240, 10):
        engine = engine_of(fly(seed))
        s, x, work = engine.settings, engine.state, engine._work
        work.concerned[:] = 1
        compare_surfaces(
            s, x, len(s.loss_members) - 1, TRUTH, 1e-12 * np.ones_like(TRUTH), KNOWN_WELL, False, False, work
        )
        for k in range(2):
            information = work.information[:, k]
            off[k].append(float(np.sum(work.against[:, k]) / math.sqrt(0.5 * np.sum(information))))
    sizes = [float(np.sqrt(np.mean(np.square(one)))) for one in off]
    print(sizes)
    assert all(0.5 < size < 1.3 for size in sizes)


def test_a_regressor_that_stays_is_summed_over_the_memory_and_one_that_is_gone_over_longer() -> None:
    """What is remembered ends now: there the noise that is yet to be taken off is in the change."""
    engine = engine_of(windowed())
    s, x, work = engine.settings, engine.state, engine._work
    a = 0
    memory = 1.0 / (1.0 - s.forgetting[s.loss_members[a]])
    x.sums_taken[:] = BEGUN * 2**s.loss_sums
    x.sum_squares[..., 1] = 1.0
    x.sum_squares[:, :, 0] = 2.0 ** -np.arange(s.loss_sums)
    x.motion[:, a, 1] = memory
    row = int(np.flatnonzero(s.differenced)[0])

    def noise(now: float) -> float:
        x.whitened[:, a] = now
        find_whitening(s, x, a, row, 1.0, 0.0, work)
        return float(work.whitening[1] ** -2)

    assert noise(1.0) == pytest.approx(noise_over(s, x, row, memory), rel=1e-9)
    assert noise(0.0) == pytest.approx(noise_over(s, x, row, math.inf), rel=1e-9)
    assert noise(1.0) > noise(0.9) > noise(0.0)
