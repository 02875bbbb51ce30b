"""Inputs that have passed a window, and estimates that move: changes are seen, and the bars hold what moves."""

from __future__ import annotations

import math

import numpy as np
import pytest
from estimation.test_bank import PERIOD, SMALL, uniform

from msls_ros.estimation import EventKind, Identifier, from_mapping
from msls_ros.estimation.bank.batches import batch_square, observe_batches
from msls_ros.estimation.bank.regression import BankRegression
from msls_ros.estimation.bank.settings import _window, bank_settings, independent_squares
from msls_ros.estimation.bank.statistics import change_of, student_square
from msls_ros.estimation.kernel import Array
from msls_ros.inputs.derivatives import DerivativeFilter, sample_weights

INTERVALS = 4
FAULT = 900


def held(share: float, noise: float = 1e-3) -> tuple[Array, Array, Array, Array]:
    """Return samples of a flight in which an effector keeps a share of its effect from `FAULT` on, while it is held.

    Rates and deflections, with white noise, pass the window; the derivatives are its slopes.
    """
    n = 1200
    time = PERIOD * np.arange(n, dtype=np.float64)
    delta = np.stack([0.1 * np.sign(np.sin(2.0 * time)), 0.05 * np.sin(3.1 * time)], axis=1)
    delta[FAULT - 100 :, 0] = 0.1
    for j in range(2):
        delta[:, j] = np.convolve(delta[:, j], np.ones(8) / 8, "same")
    delta[FAULT - 100 : FAULT + 200, 0] = 0.1
    effect = np.where(np.arange(n) < FAULT, 8.0, share * 8.0)
    x = np.zeros((n, 3))
    for k in range(1, n):
        before = x[k - 1]
        push = np.array([effect[k - 1] * delta[k - 1, 0], -4.0 * delta[k - 1, 1], delta[k - 1, 0]])
        x[k] = before + PERIOD * (push - np.array([3.0, 2.0, 1.0]) * before)
    read = np.concatenate([x, delta], axis=1) + noise * math.sqrt(3.0) * uniform(n, 5, 95)
    window = DerivativeFilter(INTERVALS, 5, 10**9)
    kept = [one for t, row in zip(time, read, strict=True) if (one := window.push(round(t * 1e9), row)) is not None]
    smooth, slope = np.array([one.smooth for one in kept]), np.array([one.slope for one in kept])
    return np.array([one.stamp * 1e-9 for one in kept]), smooth[:, :3], slope[:, :3], smooth[:, 3:]


def windowed() -> Identifier:
    return Identifier(from_mapping({**SMALL, "sample_rate": 1.0 / PERIOD}), INTERVALS)


def alarms(share: float, noise: float = 1e-3) -> list[float]:
    """Return the times of alarms."""
    run = windowed().run(*held(share, noise))
    return [v.time for e in run.estimates for v in e.events if v.kind == EventKind.DETECTED]


@pytest.mark.parametrize("noise", [1e-3, 6e-3], ids=["by one error", "by the mean of many"])
def test_what_was_known_before_an_alarm_is_from_before_all_that_raised_it(noise: float) -> None:
    """Samples of a window, and those that a mean is over, hold the change: estimates have learnt from them."""
    identifier, known = windowed(), []
    engine = identifier._regression
    assert isinstance(engine, BankRegression)
    for sample in zip(*held(0.0, noise), strict=True):
        identifier.learn(*sample)
        if identifier.alarms:
            break
        known.append(engine.state.mixed[0].copy())
    before = engine.state.theta_before[0]
    ago = next(k for k, one in enumerate(reversed(known), 1) if (one == before).all())
    assert ago > INTERVALS + engine.settings.windows[-1]
    assert before[4] == pytest.approx(8.0, rel=0.1)


def test_a_loss_is_seen_through_a_window_as_soon_as_the_window_is_past_it() -> None:
    """What predicts one sample ahead follows a change that comes in over five: a third of it shows."""
    found = [time - PERIOD * FAULT for time in alarms(0.5)]
    assert found, "half of the effect is lost while it is in use"
    assert -0.5 * INTERVALS * PERIOD <= found[0] <= (INTERVALS + 2) * PERIOD


def test_errors_that_the_motion_allowed_are_allowed_when_it_has_ended() -> None:
    identifier = Identifier(from_mapping({**SMALL, "sample_rate": 1.0 / PERIOD}))
    engine = identifier._regression
    assert isinstance(engine, BankRegression)
    n = 300
    x, delta = 0.25 * uniform(n, 3, 1), 0.125 * uniform(n, 2, 2)
    xdot = 0.01 * uniform(n, 3, 3)
    xdot[:, 0] += 8.0 * delta[:, 0] - 2.0 * x[:, 0]
    identifier.run(PERIOD * np.arange(n, dtype=np.float64), x, xdot, delta)
    s, state = engine.settings, engine.state
    state.remembered[0] = state.allowed[0] = 0.0
    usual = state.base[0, 2] / state.base[0, 1]
    state.surprise[0] = 30.0 * usual
    still = change_of(s, state, 0, 30.0 * usual, 0.0, 0.0, state.allowed[0])
    state.allowed[0] = 30.0 * usual
    assert still > s.threshold > 1.0 > change_of(s, state, 0, 30.0 * usual, 0.0, 0.0, state.allowed[0])


def test_a_loss_that_noise_hides_sample_by_sample_is_seen_in_the_mean() -> None:
    """Noise of slopes cancels in their sum, the error that a held input makes does not; squares alone say nothing."""
    found = [time - PERIOD * FAULT for time in alarms(0.5, 6e-3)]
    assert found and 0.1 < found[0] < 0.5


@pytest.mark.parametrize("noise", [1e-3, 6e-3])
def test_nothing_is_alarmed_where_nothing_changes(noise: float) -> None:
    assert alarms(1.0, noise) == []


@pytest.mark.parametrize(("free", "quantile"), [(5.0, 2.5706), (10.0, 2.2281), (30.0, 2.0423), (120.0, 1.9799)])
def test_quantiles_of_students_t_are_those_of_the_tables(free: float, quantile: float) -> None:
    """Two-sided, .05."""
    assert math.sqrt(student_square(1.95996**2, free)) == pytest.approx(quantile, rel=3e-3)


def test_batches_give_the_variance_by_what_the_estimates_move() -> None:
    """Four batches of information 1 each, of which the second says 2 and the others 1."""
    settings = bank_settings(from_mapping({**SMALL, "sample_rate": 1.0 / PERIOD}))
    engine = BankRegression(settings._replace(batches=np.array([4]), batch_factor=np.array([1.0])), 3)
    s, x, leader = engine.settings, engine.state, int(np.argmax(engine.settings.held))
    x.axis_gate[:] = 0.0  # nothing is forgotten
    said = [1.0, 2.0, 1.0, 1.0]
    for k, _ in enumerate(said, 1):
        x.mixed[0, 4], x.known[0, 4] = float(np.mean(said[:k])), float(k)
        x.samples[0] = 4 * k
        observe_batches(s, x, 0, leader, 4)
    moves = [0.0, (1.5 - 1.0) * 1.0 / 2.0, (4.0 / 3.0 - 1.5) * 2.0 / 3.0, (1.25 - 4.0 / 3.0) * 3.0 / 4.0]
    # each as a part of the whole: S of k batches is (k/4)^2 of what it adds in the end
    expected = sum((move * k / 4.0) ** 2 for k, move in enumerate(moves, 1))
    assert batch_square(s, x, 0, 4) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(
    "weights",
    [[1.0], [0.1, 0.25, 0.3, 0.25, 0.1], [-2.0, -1.0, 0.0, 1.0, 2.0]],
    ids=["no window", "values", "slopes"],
)
def test_squared_noise_through_a_window_averages_as_so_many_independent_squares(weights: list[float]) -> None:
    """The variance of the mean of n independent squares is 2/n of the square of their mean."""
    noise = np.convolve(np.random.default_rng(17).normal(size=200_000), weights, "valid")
    squares = noise * noise / np.mean(noise * noise)
    for length in (1, 3, 8, 20):
        means = np.convolve(squares, np.ones(length) / length, "valid")
        number = independent_squares(length, np.array(weights))
        assert 2.0 / float(np.var(means)) == pytest.approx(number, rel=0.1), length


@pytest.mark.parametrize("seed", [95, 96, 97])
def test_a_loss_of_a_few_standard_deviations_is_seen_in_the_mean_of_what_is_measured(seed: int) -> None:
    """Half of an effect that is held is four standard deviations of the noise: squares of errors saw none of these."""
    n = 1200
    time = PERIOD * np.arange(n, dtype=np.float64)
    delta = np.stack([0.1 * np.sign(np.sin(2.0 * time)), 0.05 * np.sin(3.1 * time)], axis=1)
    delta[FAULT - 100 :, 0] = 0.1
    effect = np.where(np.arange(n) < FAULT, 8.0, 4.0)
    x, xdot = np.zeros((n, 3)), np.zeros((n, 3))
    for k in range(n):
        push = np.array([effect[k] * delta[k, 0], -4.0 * delta[k, 1], delta[k, 0]])
        xdot[k] = push - np.array([3.0, 2.0, 1.0]) * x[k]
        if k + 1 < n:
            x[k + 1] = x[k] + PERIOD * xdot[k]
    read = xdot + 0.1 * math.sqrt(3.0) * uniform(n, 3, seed)
    run = Identifier(from_mapping({**SMALL, "sample_rate": 1.0 / PERIOD})).run(time, x, read, delta)
    found = [v.time for e in run.estimates for v in e.events if v.kind == EventKind.DETECTED]
    assert len(found) == 1 and 0.0 <= found[0] - PERIOD * FAULT < 0.3


@pytest.mark.parametrize("intervals", [1, 2, 4, 5, 10, 40])
def test_the_bank_knows_the_weights_of_the_window(intervals: int) -> None:
    """By other ones a V-tail's losses were seen in 17 of 32 flights, not 24."""
    values = _window(intervals)[0]
    np.testing.assert_allclose(values / values.sum(), sample_weights(intervals), rtol=1e-9)
