"""The identifier as an object: warm start, freeze, reset, refusals; the same numbers one by one and in one piece."""

from __future__ import annotations

import numpy as np
import pytest

from msls_ros.estimation import Configuration, EstimationError, Identifier, Level, from_mapping
from msls_ros.inputs import Refused, Synchronizer

STATES, EFFECTORS = ("p", "r"), ("da", "dr")
A = np.array([[-1.0, 0.3], [0.1, -0.5]])
B = np.array([[2.0, 0.2], [-0.1, 1.5]])
BIAS = np.array([0.1, -0.2])


def configuration(**changes: object) -> Configuration:
    named = {"states": list(STATES), "effectors": list(EFFECTORS)}
    return from_mapping({**named, "estimator.method": "msls", "detector.mode": "off", **changes})


def samples(n: int, seed: int = 0, noise: float = 0.01) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    x, delta = rng.standard_normal((n, 2)), 0.1 * rng.standard_normal((n, 2))
    return 0.02 * np.arange(n), x, x @ A.T + delta @ B.T + BIAS + noise * rng.standard_normal((n, 2)), delta


def test_it_finds_a_linear_system_within_its_error_bars() -> None:
    identifier = Identifier(configuration(**{"estimator.forgetting_factor": 0.98}))
    estimate = identifier.run(*samples(1000)).estimates[-1]
    assert (np.abs(estimate.b - B) <= 4.0 * estimate.b_std).all()
    assert (np.abs(estimate.a - A) <= 4.0 * estimate.a_std).all()
    assert estimate.b_reliable.all()
    assert estimate.bias == pytest.approx(BIAS, abs=0.01)
    assert estimate.residual_std == pytest.approx([0.01, 0.01], rel=0.35)


def test_a_warm_start_begins_where_it_is_told_and_moves_as_far_as_it_is_unsure() -> None:
    time, x, xdot, delta = samples(3, noise=0.0)
    sure, unsure = Identifier(configuration()), Identifier(configuration())
    wrong = B + 1.0
    sure.warm_start(A, wrong, BIAS, 1e-12 * np.eye(5))
    unsure.warm_start(A, wrong, BIAS, 1e6 * np.eye(5))
    first = sure.estimate(0.0, x[0])
    assert np.array_equal(first.b, wrong)
    for identifier, low, high in ((sure, 0.0, 1e-6), (unsure, 0.05, 10.0)):
        moved = np.abs(identifier.run(time, x, xdot, delta).estimates[-1].b - wrong).max()
        assert low <= moved <= high


def test_a_warm_start_without_a_covariance_is_refused_and_changes_nothing() -> None:
    identifier = Identifier(configuration())
    identifier.run(*samples(50))
    before = identifier.estimate(1.0, np.zeros(2)).b
    for covariance in (np.zeros((5, 5)), -np.eye(5), np.full((5, 5), np.nan), np.eye(4), np.triu(np.ones((5, 5)))):
        with pytest.raises(EstimationError, match=r"expected|must be"):
            identifier.warm_start(A, B, BIAS, covariance)
    assert np.array_equal(identifier.estimate(1.0, np.zeros(2)).b, before)


def test_what_a_warm_start_has_refused_is_not_begun_from_when_the_rate_changes() -> None:
    identifier = Identifier(configuration(**{"estimator.method": "bank"}))
    time, x, xdot, delta = samples(200)
    rate = identifier.learning_rate
    with pytest.raises(EstimationError, match="must be"):
        identifier.warm_start(A, B, BIAS, -np.eye(5))
    identifier.run(2.0 * time, x, xdot, delta)
    assert identifier.learning_rate == pytest.approx(0.5 * rate)


def test_frozen_it_learns_nothing_and_injects_nothing() -> None:
    identifier = Identifier(configuration())
    time, x, xdot, delta = samples(100)
    before = identifier.run(time[:50], x[:50], xdot[:50], delta[:50]).estimates[-1]
    identifier.enabled = False
    after = identifier.update(time[50], x[50], 100.0 * xdot[50], delta[50])
    assert np.array_equal(after.b, before.b)
    assert after.samples == before.samples
    assert after.dither.level == Level.OFF
    assert not after.dither.delta.any()
    assert "frozen" in after.dither.reason
    identifier.enabled = True
    assert not np.array_equal(identifier.update(time[51], x[51], xdot[51], delta[51]).b, before.b)


def test_a_reset_gives_the_same_numbers_again() -> None:
    identifier = Identifier(configuration())
    first = identifier.run(*samples(80)).estimates[-1]
    identifier.reset()
    second = identifier.run(*samples(80)).estimates[-1]
    assert np.array_equal(first.b, second.b)
    assert np.array_equal(first.b_std, second.b_std)
    assert np.array_equal(first.dither.delta, second.dither.delta)


@pytest.mark.parametrize("field", [1, 2, 3])
def test_numbers_that_are_not_finite_are_refused_and_change_nothing(field: int) -> None:
    identifier = Identifier(configuration())
    data = samples(20)
    before = identifier.run(*data).estimates[-1]
    bad = [v[0].copy() if v.ndim > 1 else 1.0 for v in data]
    bad[field][1] = np.nan  # type: ignore[index]
    with pytest.raises(EstimationError, match="not finite"):
        identifier.update(1.0, bad[1], bad[2], bad[3])  # type: ignore[arg-type]
    with pytest.raises(EstimationError, match=r"shape \(1, 3\); expected \(1, 2\)"):
        identifier.update(1.0, np.zeros(3), np.zeros(3), np.zeros(2))
    assert np.array_equal(identifier.estimate(1.0, np.zeros(2)).b, before.b)


def test_the_slow_memory_of_a_time_constant_and_auto_scale_work_together() -> None:
    identifier = Identifier(configuration(**{"estimator.time_constant": 1.0, "estimator.scale": "auto"}))
    estimate = identifier.run(*samples(600)).estimates[-1]
    assert estimate.forgetting_factor[0] == pytest.approx(np.exp(-0.02))
    assert estimate.b == pytest.approx(B, abs=0.1)


def test_the_gate_and_the_identifier_start_anew_together() -> None:
    gate, identifier = Synchronizer(STATES, EFFECTORS), Identifier(configuration())
    time, x, xdot, delta = samples(60)
    outcomes = []
    for _ in range(2):
        for k in range(60):
            stamp = round(time[k] * 1e9)
            assert gate.add_state(stamp, STATES, x[k], xdot[k]) is None
            sample = gate.add_effectors(stamp, EFFECTORS, delta[k])
            assert sample is not None
            if sample.restarted:
                identifier.reset()
            estimate = identifier.update(sample.time, sample.x, sample.xdot, sample.delta)
        outcomes.append(estimate)
    assert gate.restarts == 1
    assert np.array_equal(outcomes[0].b, outcomes[1].b)
    with pytest.raises(Refused):
        gate.add_state(round(time[59] * 1e9), STATES, x[0], xdot[0])


@pytest.mark.parametrize(
    "changes",
    [{}, {"detector.mode": "normalised"}, {"estimator.method": "rls"}, {"estimator.method": "bank"}],
)
def test_a_followed_parameter_has_the_bits_that_the_models_have(changes: dict[str, object]) -> None:
    time, x, xdot, delta = samples(400)
    xdot[200:] += x[200:] @ np.array([[3.0, 0.0], [0.0, 0.0]])
    chosen = configuration(**{"estimator.forgetting_factor": 0.95, **changes})
    whole = Identifier(chosen).run(time, x, xdot, delta).estimates
    assert any(e.events for e in whole) == (changes.get("detector.mode") == "normalised")
    for row, column, values in (("p", "p", [e.a[0, 0] for e in whole]), ("r", "dr", [e.b[1, 1] for e in whole])):
        follower = Identifier(chosen)
        follower.follow(row, column)
        followed = follower.run(time, x, xdot, delta, every=150).followed
        np.testing.assert_array_equal(np.concatenate(followed), values)
        assert follower.followed == values[-1]
        follower.reset()
        learnt = []
        for sample in zip(time[:50], x, xdot, delta, strict=False):
            follower.learn(*sample)
            learnt.append(follower.followed)
        assert learnt == values[:50]
    with pytest.raises(EstimationError, match=r"dp/dt by q is not identified; rows are .*, columns .*"):
        follower.follow("p", "q")
