"""Outputs that answer the inputs of a sample ago: the error bars say so, and say nothing where both are in step."""

from __future__ import annotations

import math

import numpy as np
import pytest
from estimation.test_bank import PERIOD, SMALL, uniform

from msls_ros.estimation import Estimate, Identifier, from_mapping
from msls_ros.estimation.bank.lags import known_effect, lag_square, shift_estimates
from msls_ros.estimation.bank.losses import keep_reference
from msls_ros.estimation.bank.regression import BankRegression
from msls_ros.estimation.bank.settings import bank_settings
from msls_ros.estimation.bank.uncertainty import PARTED, square_of_change
from msls_ros.estimation.kernel import Array

EFFECT = 8.0


def fly(
    late: float, slow: bool = False, answers: bool = False, keeps: float = 0.8, flown: bool = False
) -> tuple[Identifier, Estimate]:
    """Return the identifier after 400 samples in which a share of an effect comes late, and what it says then.

    ``slow``: of inputs that hardly move; ``answers``: with a first state that follows the last input, ``keeps`` that
    share of what it was; ``flown``: with states that are what their derivatives make.
    """
    n = 400
    x, delta = 0.25 * uniform(n, 3, 31), 0.125 * uniform(n, 2, 32)
    if slow:
        delta += np.sin(2.0 * np.arange(n) * PERIOD)[:, None] * np.array([1.0, 0.5])
        delta[:, 0] = np.convolve(delta[:, 0], np.ones(25) / 25, "same")
    before: Array = np.concatenate([delta[:1], delta[:-1]])
    if answers:
        for k in range(1, n):
            x[k, 0] = keeps * x[k - 1, 0] + 2.0 * delta[k - 1, 0]
    seen = (1.0 - late) * delta + late * before
    moved = 0.05 * uniform(n, 3, 33)
    moved[:, 0] += EFFECT * seen[:, 0]
    moved[:, 1] += -4.0 * seen[:, 1]
    for k in range(1, n if flown else 0):
        x[k] = x[k - 1] + PERIOD * (moved[k - 1] - x[k - 1])
    xdot = moved - x
    identifier = Identifier(from_mapping({**SMALL, "sample_rate": 1.0 / PERIOD}))
    return identifier, identifier.run(PERIOD * np.arange(n, dtype=np.float64), x, xdot, delta).estimates[-1]


@pytest.mark.parametrize("late", [0.1, 0.3, 0.7])
def test_an_effect_that_comes_late_in_part_is_found_in_full(late: float) -> None:
    _, estimate = fly(late)
    errors = np.abs([estimate.b[0, 0] - EFFECT, estimate.b[1, 1] + 4.0])
    assert errors.max() < 0.02 * EFFECT
    assert (errors < 1.96 * np.array([estimate.b_std[0, 0], estimate.b_std[1, 1]])).all()


def test_a_state_that_answers_the_last_input_does_not_stand_in_for_it() -> None:
    _, estimate = fly(0.3, answers=True)
    error = abs(estimate.a[0, 0] + 1.0)
    assert error < 0.02
    assert error < 1.96 * estimate.a_std[0, 0]


def test_where_a_state_is_the_last_input_the_delay_is_that_of_the_other_effector_and_the_bar_allows_for_more() -> None:
    """Nothing of the late part is left for the errors: delays may be unlike each other."""
    identifier, estimate = fly(0.3, answers=True, keeps=0.0)
    engine = identifier._regression
    assert isinstance(engine, BankRegression)
    assert engine.state.unexplained[0] == 0.0
    error, effector = abs(estimate.b[0, 0] - EFFECT), engine.settings.effectors_from + 1
    assert error < 1.96 * math.sqrt(lag_square(engine.state, 0, effector))


@pytest.mark.parametrize("late", [0.5, 0.7, 1.0])
def test_what_seemed_known_before_a_delay_could_show_does_not_hold_the_bar_down(late: float) -> None:
    """In the first moment a few samples fit any delay, and the bar is small; what shows after 3 s counts in full."""
    n = 160
    x, delta = 0.25 * uniform(n, 3, 41), 0.125 * uniform(n, 2, 42)
    before: Array = np.concatenate([delta[:1, 0], delta[:-1, 0]])
    xdot = 5e-4 * uniform(n, 3, 43) - x
    xdot[:, 0] += EFFECT * ((1.0 - late) * delta[:, 0] + late * before)
    xdot[:, 1] += -4.0 * delta[:, 1]
    estimates = Identifier(from_mapping(SMALL)).run(PERIOD * np.arange(n, dtype=np.float64), x, xdot, delta).estimates
    assert abs(estimates[-1].b[0, 0] - EFFECT) < 1.96 * estimates[-1].b_std[0, 0]


def test_the_sensitivity_is_what_a_little_more_delay_does_to_all_members() -> None:
    """Members that learn from deflections of a tenth of a sample ago differ by a tenth of it, to the second order."""
    n, more = 300, 0.1
    x, delta = 0.25 * uniform(n, 3, 51), 0.125 * uniform(n, 2, 52)
    delta[1:] = 0.5 * delta[1:] + 0.5 * delta[:-1]
    xdot = -x + delta @ np.array([[EFFECT, 0.0, 1.0], [0.0, -4.0, 2.0]])
    found = []
    for share in (0.0, more):
        seen = delta.copy()
        seen[1:] += share * (delta[:-1] - delta[1:])
        settings = bank_settings(from_mapping({**SMALL, "sample_rate": 1.0 / PERIOD}))._replace(late_part=1e-9)
        engine = BankRegression(settings, 3)
        engine.advance(np.concatenate([x, seen, np.ones((n, 1))], axis=1), xdot.copy())
        found.append(engine)
    first, second = (engine.state for engine in found)
    assert first.delay[0, 0] == second.delay[0, 0] == 0.0
    apart = float(np.abs(second.members - first.members)[:, 1:].max())
    assert apart > 0.05
    shift_estimates(found[0].settings, first, 0, more)
    assert float(np.abs(second.members - first.members)[:, 1:].max()) < 0.15 * apart


def test_a_comparison_does_not_see_what_is_in_both_estimates() -> None:
    identifier, _ = fly(0.5)
    engine = identifier._regression
    assert isinstance(engine, BankRegression)
    state, effector = engine.state, engine.settings.effectors_from + 1
    state.late_square[0, 0, effector] = 0.9 * state.square[0, effector]
    whole = float(state.square[0, effector])
    assert square_of_change(state, 0, effector, whole) == pytest.approx(PARTED * whole)


def test_where_both_are_in_step_hardly_anything_is_added() -> None:
    """The delay is known to half a millisecond then, of which each makes a twentieth of such an effect."""
    identifier, estimate = fly(0.0, flown=True)
    engine = identifier._regression
    assert isinstance(engine, BankRegression)
    assert lag_square(engine.state, 0, engine.settings.effectors_from + 1) < (0.03 * EFFECT) ** 2
    assert estimate.b_reliable[0, 0] and abs(estimate.b[0, 0] - EFFECT) < 0.1


def test_a_slow_input_hardly_sees_a_delay() -> None:
    squares = []
    for slow in (False, True):
        identifier, estimate = fly(0.3, slow=slow)
        engine = identifier._regression
        assert isinstance(engine, BankRegression)
        squares.append(lag_square(engine.state, 0, engine.settings.effectors_from + 1))
        assert abs(estimate.b[0, 0] - EFFECT) < 0.01 * EFFECT
    assert squares[1] < 0.25 * squares[0]


def test_however_much_delays_may_do_the_references_of_losses_are_positive() -> None:
    identifier, _ = fly(0.3)
    engine = identifier._regression
    assert isinstance(engine, BankRegression)
    state, settings = engine.state, engine.settings
    state.late_square[0] = 30.0 * state.square
    state.samples[0] = settings.stride * (state.samples[0] // settings.stride)
    slot = state.kept[0] % state.kept_theta.shape[0]
    keep_reference(settings, state)
    assert (lag_square(state, 0, 4) > state.square[0]).any(), "more than the whole error, which is bounded"
    assert state.kept_square[slot].min() > 0.0


def test_an_effect_corrects_as_far_as_it_is_known_and_after_an_alarm_as_far_as_it_was() -> None:
    engine = Identifier(from_mapping(SMALL))._regression
    assert isinstance(engine, BankRegression)
    x = engine.state
    i = engine.settings.effectors_from + 1
    x.mixed[0, i] = -2.0
    for square, expected in ((0.0, -2.0), (4.0, -1.0), (math.inf, 0.0)):
        x.square[0, i] = square
        assert known_effect(x, 0, i) == pytest.approx(expected)
    x.pending[0], x.square_before[0, i] = 1, 4.0
    assert known_effect(x, 0, i) == pytest.approx(-1.0)
    x.mixed[0, i] = 0.0
    assert known_effect(x, 0, i) == 0.0
