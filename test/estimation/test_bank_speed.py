"""Effects go with airspeed: what is learnt at one speed holds at another, and what is handed out is a tangent."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from msls_ros.estimation import Configuration, EstimationError, Identifier
from msls_ros.estimation.configuration import from_mapping
from msls_ros.estimation.kernel import Array

STATES, EFFECTORS = ("u", "v", "w", "P", "Q", "R", "Phi", "Theta", "Psi"), ("de", "da", "dn")
RATE, SPEED = 50.0, 30.0
A = np.zeros((9, 9))
A[0, [0, 2]] = -0.06, 0.2
A[1, [1, 5]] = -0.7, 0.3
A[2, [0, 2, 4]] = -0.1, -3.0, -0.8
A[3, [1, 3, 5]] = -0.15, -9.0, 2.0
A[4, [0, 2, 4]] = 0.01, -0.8, -4.0
A[5, [1, 3, 5]] = 0.35, -0.7, -1.5
B = np.zeros((9, 3))
B[2, 0], B[3, 1], B[4, 0], B[4, 2], B[5, 1] = -5.0, 40.0, -25.0, 8.0, -2.0
"""Of effects at ``SPEED``; the nozzle dn does not go with it."""
CONSTANT = np.array([1.0, 0.0, 9.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0])


def configuration(**changes: Any) -> Configuration:
    base = {"states": STATES, "effectors": EFFECTORS, "sample_rate": RATE, "reference_speed": SPEED}
    return from_mapping({**base, "thrust_effectors": "dn", **{k.replace("__", "."): v for k, v in changes.items()}})


def forces(x: Array, delta: Array) -> Array:
    """What forces and moments make of the states: the model that the bank assumes."""
    s = float(np.linalg.norm(x[:3])) / SPEED
    found: Array = CONSTANT + s * (A @ x) + B @ (delta * np.array([s * s, s * s, 1.0]))
    return found


def jacobian(x: Array, delta: Array) -> Array:
    step = 1e-5
    columns = [(forces(x + step * e, delta) - forces(x - step * e, delta)) / (2.0 * step) for e in np.eye(9)]
    return np.array(columns).T


def speeds(time: Array) -> Array:
    """Airspeed [m/s]: half a minute at 30, then up to 42 in quiet."""
    return SPEED + 12.0 * np.clip((time - 30.0) / 20.0, 0.0, 1.0)


def flight(noise: float = 1e-3) -> tuple[Array, Array, Array, Array, Array]:
    """Doublets of all effectors for half a minute, then a faster flight in which nothing moves; with true forces."""
    time = np.arange(0.0, 60.0, 1.0 / RATE)
    random = np.random.default_rng(1)
    delta = np.zeros((len(time), 3))
    for j, period in enumerate((1.3, 1.7, 2.3)):
        delta[:, j] = 0.08 * np.sign(np.sin(2.0 * np.pi * time / period)) * (time < 30.0)
    delta += [0.03, -0.02, 0.01]
    x = np.zeros((len(time), 9))
    for i, (period, size) in enumerate(((3.1, 0.5), (1.9, 1.0), (2.9, 1.0), (1.1, 0.4), (1.4, 0.3), (2.1, 0.2))):
        x[:, i] = size * np.sin(2.0 * np.pi * time / period) * (time < 30.0)
    air = speeds(time)
    x[:, 0] += air
    x[:, 2] += 2.0 * (SPEED / air) ** 2
    x[:, 7] = 0.1
    made = np.array([forces(one, moved) for one, moved in zip(x, delta, strict=True)])
    known = np.zeros_like(x)
    g = 9.80665
    known[:, 0], known[:, 2] = -g * np.sin(0.1), g * np.cos(0.1)
    known[:, :3] -= np.cross(x[:, 3:6], x[:, :3])
    known[:, 4] += 0.8 * x[:, 3] * x[:, 5]
    xdot = made + known + noise * random.normal(size=x.shape)
    return time, x, xdot, delta, made


def identify(changed: Configuration, noise: float = 1e-3) -> tuple[Any, Array, Array]:
    time, x, xdot, delta, _ = flight(noise)
    identifier = Identifier(changed)
    return identifier.run(time, x, xdot, delta, every=len(time)).estimates[-1], x[-1], delta[-1]


def test_what_is_learnt_at_one_speed_holds_at_another() -> None:
    estimate, x, delta = identify(configuration())
    s = float(np.linalg.norm(x[:3])) / SPEED
    assert s > 1.39
    for row, column, power in (("P", "da", 2), ("Q", "de", 2), ("Q", "dn", 0)):
        i, j = STATES.index(row), EFFECTORS.index(column)
        true = B[i, j] * s**power
        assert estimate.b[i, j] == pytest.approx(true, rel=0.02)
        assert abs(estimate.b[i, j] - true) < 1.96 * estimate.b_std[i, j]
        assert estimate.b_best[i, j] == pytest.approx(true, rel=0.02)
    true_a = jacobian(x, delta)
    for row, column in (("P", "P"), ("Q", "w"), ("Q", "Q"), ("R", "v")):
        i, j = STATES.index(row), STATES.index(column)
        assert estimate.a[i, j] == pytest.approx(true_a[i, j], rel=0.05)
        assert abs(estimate.a[i, j] - true_a[i, j]) < 1.96 * estimate.a_std[i, j]
        assert abs(estimate.a_best[i, j] - true_a[i, j]) < 1.96 * np.hypot(estimate.a_std, estimate.a_best_std)[i, j]


def test_without_it_an_effect_is_that_of_where_it_was_learnt_and_the_bar_says_so() -> None:
    """By `dynamic_pressure: false`; and with the nozzle taken for a surface, whose bar must hold the mistake."""
    estimate, x, _ = identify(configuration(dynamic_pressure=False))
    s = float(np.linalg.norm(x[:3])) / SPEED
    i, j = STATES.index("P"), EFFECTORS.index("da")
    assert estimate.b[i, j] == pytest.approx(B[i, j], rel=0.05)
    assert abs(estimate.b[i, j] - B[i, j] * s * s) < 1.96 * estimate.b_std[i, j]
    mistaken, _, _ = identify(configuration(thrust_effectors=""))
    i, j = STATES.index("Q"), EFFECTORS.index("dn")
    assert mistaken.b[i, j] == pytest.approx(B[i, j] * s * s, rel=0.05)
    assert abs(mistaken.b[i, j] - B[i, j]) < 2.2 * mistaken.b_std[i, j]


def test_what_is_handed_out_is_the_tangent_at_the_state_that_is_asked_for() -> None:
    time, x, xdot, delta, made = flight(0.0)
    identifier = Identifier(configuration())
    count = round(29.2 * RATE)  # no step of a deflection is so new that it may be a spike
    identifier.run(time[:count], x[:count], xdot[:count], delta[:count], every=count)
    at, moved = x[count - 1].copy(), delta[count - 1]
    estimate = identifier.estimate(float(time[count - 1]), at)
    known_a, known_bias = identifier._assembly.known_at(at)
    made_of_it = (estimate.a - known_a) @ at + estimate.b @ moved + estimate.bias - known_bias
    np.testing.assert_allclose(made_of_it[:6], made[count - 1, :6], atol=0.02)
    np.testing.assert_allclose(
        (estimate.a - known_a)[[2, 4]][:, [0, 2]], jacobian(at, moved)[[2, 4]][:, [0, 2]], atol=0.01
    )
    at[:3] *= 1.3
    faster = identifier.estimate(float(time[count - 1]), at)
    square = (float(np.linalg.norm(at[:3])) / SPEED) ** 2
    true = [square * B[2, 0], square * B[3, 1], B[4, 2]]
    np.testing.assert_allclose(faster.b[[2, 3, 4], [0, 1, 2]], true, rtol=0.01)


@pytest.mark.parametrize("where", [0, 1])
def test_a_model_is_started_from_as_it_was_handed_out(where: int) -> None:
    """At another speed than it was learnt at, with deflections."""
    time, x, xdot, delta, _ = flight()
    first, second = Identifier(configuration()), Identifier(configuration())
    count = (round(29.6 * RATE), len(time))[where]
    estimate = first.run(time[:count], x[:count], xdot[:count], delta[:count], every=count).estimates[-1]
    at, moved = x[count - 1], delta[count - 1]
    second.warm_start(estimate.a, estimate.b, estimate.bias, first.covariance, at, moved)
    again, elsewhere = second.estimate(0.0, at), np.array([24.0, 1.0, 3.0, 0.1, -0.1, 0.2, 0.1, 0.2, 0.0])
    for one, other in ((estimate, again), (first.estimate(0.0, elsewhere), second.estimate(0.0, elsewhere))):
        for name in ("a", "b", "bias"):
            np.testing.assert_allclose(getattr(other, name), getattr(one, name), atol=1e-9)
    with pytest.raises(EstimationError, match=r"deflections delta of shape \(2,\); expected \(3,\), finite"):
        second.warm_start(estimate.a, estimate.b, estimate.bias, first.covariance, at, moved[:2])


def test_the_estimate_that_is_followed_goes_with_speed_too() -> None:
    time, x, xdot, delta, _ = flight()
    for row, column in (("P", "da"), ("Q", "w"), ("w", "u")):
        identifier = Identifier(configuration())
        identifier.follow(row, column)
        run = identifier.run(time, x, xdot, delta, every=100)
        last, i = run.estimates[-1], STATES.index(row)
        said = last.b[i, EFFECTORS.index(column)] if column in EFFECTORS else last.a[i, STATES.index(column)]
        assert np.concatenate(run.followed)[-1] == pytest.approx(said, rel=1e-9)


@pytest.mark.parametrize(
    "changes", [{"known_gravity": False}, {"dynamic_pressure": False}, {"estimator__method": "rls"}], ids=str
)
def test_where_airspeed_is_not_known_nothing_goes_with_it(changes: dict[str, Any]) -> None:
    time, x, xdot, delta, _ = flight()
    identifier = Identifier(configuration(**changes))
    identifier.run(time[:1400], x[:1400], xdot[:1400], delta[:1400], every=1400)
    slow, fast = (identifier.estimate(0.0, x[0] * np.array([f] * 3 + [1.0] * 6)) for f in (1.0, 1.5))
    np.testing.assert_array_equal(slow.b, fast.b)


def test_an_effector_of_thrust_that_is_none_is_refused() -> None:
    with pytest.raises(EstimationError, match=r"'thrust_effectors' names 'nozzle'; effectors are de, da, dn"):
        configuration(thrust_effectors="dn, nozzle")
    with pytest.raises(EstimationError, match=r"names 'dm' \(did you mean 'dn'\?\)|names 'dm'"):
        configuration(thrust_effectors="dm")
