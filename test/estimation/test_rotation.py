"""The turning of the body's axes is known to the bank: it is taken off the outputs and comes back in A."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import yaml

from msls_ros.estimation import Configuration, Estimate, EstimationError, Identifier
from msls_ros.estimation.bank.energy import turned_output
from msls_ros.estimation.bank.settings import bank_settings
from msls_ros.estimation.bank.start import make_bank_state
from msls_ros.estimation.kernel import Array
from msls_ros.estimation.kinematics import (
    FLIGHT_STATES,
    GYROSCOPIC_PITCH,
    add_known,
    find_forces,
    find_rotation,
    find_states,
)
from msls_ros.inputs.model_file import read_model, start_from, write_model

SPEED, PERIOD = 60.0, 0.02
EFFECTORS = ("de", "da", "dr")


def configuration(method: str = "bank") -> Configuration:
    return Configuration(effectors=EFFECTORS, reference_speed=SPEED).replace({"estimator.method": method})


def flight(n: int = 1000) -> tuple[Array, Array, Array, Array, Array]:
    """Return time, states, derivatives, deflections of an aircraft that rolls and slips far, and its linear forces."""
    rng = np.random.default_rng(4)
    time: Array = PERIOD * np.arange(n, dtype=np.float64)
    phase = np.arange(9) * 1.3
    x = np.sin(2.0 * math.pi * time[:, None] * (0.17 + 0.06 * np.arange(9)) + phase)
    x *= np.array([4.0, 9.0, 4.0, 0.8, 0.3, 0.4, 0.4, 0.2, 0.3])
    x[:, 0] += SPEED
    delta = 0.05 * rng.standard_normal((n, 3))
    forces = np.zeros((9, 9))
    forces[:6, :6] = rng.uniform(-0.3, 0.3, (6, 6)) - 0.5 * np.eye(6)
    b = np.zeros((9, 3))
    b[:6] = rng.uniform(-5.0, 5.0, (6, 3))
    xdot = x @ forces.T + delta @ b.T
    xdot[:, :6] += 0.01 * rng.standard_normal((n, 6))
    for k in range(n):
        a, bias = known(x[k])
        xdot[k] += a @ x[k] + bias
    return time, x, xdot, delta, forces


def pitching(x: Array) -> float:
    return float(GYROSCOPIC_PITCH * x[3] * x[5])


def known(x: Array) -> tuple[Array, Array]:
    a, bias = np.zeros((9, 9)), np.zeros(9)
    add_known(x, find_states(FLIGHT_STATES), True, a, bias)
    return a, bias


def test_what_is_taken_off_an_output_is_what_its_energy_is_counted_with() -> None:
    settings = bank_settings(configuration())
    x = np.random.default_rng(1).uniform(-2.0, 2.0, 9)
    phi = np.concatenate([[1.0], x[:6], np.zeros(3)])
    state = make_bank_state(settings, 6, 4)
    turned = [turned_output(settings, state, phi, q) for q in range(6)]
    np.testing.assert_allclose(turned, [*-np.cross(x[3:6], x[:3]), 0.0, pitching(x), 0.0], atol=1e-14)


def test_the_bank_follows_derivatives_that_go_with_the_motion_and_msls_cannot() -> None:
    """dv/dt by P is w and more, by R it is -u and more: A holds for the states of now, to its error bars."""
    time, x, xdot, delta, forces = flight()

    def errors(method: str) -> tuple[float, float]:
        estimates = Identifier(configuration(method)).run(time, x, xdot, delta, every=10).estimates[30:]
        off, inside = [], []
        for estimate in estimates:
            k = round(estimate.time / PERIOD)
            true = forces + known(x[k])[0]
            rows = np.abs(estimate.a - true)[:3, :6]
            off.append(rows)
            inside.append(rows <= 1.96 * estimate.a_std[:3, :6])
        return float(np.median(np.array(off)[:, 1, 3])), float(np.mean(inside))

    bank, covered = errors("bank")
    assert bank < 0.05 and covered >= 0.9
    assert errors("msls")[0] > 10.0 * bank


def value(estimate: Estimate, row: str, column: str) -> float:
    i = FLIGHT_STATES.index(row)
    if column in EFFECTORS:
        return float(estimate.b[i, EFFECTORS.index(column)])
    return float(estimate.a[i, FLIGHT_STATES.index(column)])


def test_the_estimate_that_is_followed_is_that_of_the_model() -> None:
    time, x, xdot, delta, _ = flight(300)
    for row, column in (("v", "P"), ("w", "Q"), ("u", "v"), ("P", "da"), ("v", "v")):
        identifier = Identifier(configuration())
        identifier.follow(row, column)
        run = identifier.run(time, x, xdot, delta, every=50)
        last = run.estimates[-1]
        assert np.concatenate(run.followed)[-1] == pytest.approx(value(last, row, column), rel=1e-12)
        assert identifier.followed == pytest.approx(value(last, row, column), rel=1e-12)
        identifier.enabled = False
        frozen = identifier.run(time[-1:] + PERIOD, x[:1], xdot[:1], delta[:1])
        assert frozen.followed[-1][-1] == pytest.approx(value(identifier.estimate(0.0, x[0]), row, column), rel=1e-12)
        identifier.reset()
        assert identifier.followed == 0.0


@pytest.mark.parametrize("method", ["bank", "msls"])
def test_a_saved_model_starts_elsewhere_as_it_was(method: str, tmp_path: Path) -> None:
    """What is known stands in A and bias at the states of then: it is taken off before it comes on again."""
    time, x, xdot, delta, _ = flight(400)
    first, second = Identifier(configuration(method)), Identifier(configuration(method))
    estimate = first.run(time, x, xdot, delta, every=400).estimates[-1]
    write_model(tmp_path / "model.yaml", first, estimate, x[399], delta[399], 1)
    start_from(second, tmp_path / "model.yaml")
    elsewhere = np.array([50.0, -5.0, 3.0, 0.5, -0.2, 0.1, 0.3, 0.2, 0.0])
    expected, found = first.estimate(8.0, elsewhere), second.estimate(8.0, elsewhere)
    for name in ("a", "b", "bias"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), atol=1e-9)
    refuse_what_does_not_say_where(second, estimate, tmp_path / "model.yaml")


def refuse_what_does_not_say_where(identifier: Identifier, estimate: Estimate, path: Path) -> None:
    with pytest.raises(EstimationError, match=r"expected \(9,\), finite"):
        identifier.warm_start(estimate.a, estimate.b, estimate.bias, identifier.covariance, np.full(9, math.nan))
    content = yaml.safe_load(path.read_text())
    content.pop("x")
    path.write_text(yaml.safe_dump(content))
    with pytest.raises(EstimationError, match=r"^the model .* is of an earlier version: it has no x, .* save it anew$"):
        read_model(path)


def test_rotation_is_known_of_the_states_that_there_are() -> None:
    assert find_rotation(("u", "w", "Q")) == {(0, 1): (2, -1), (0, 2): (1, -1), (1, 0): (2, 1), (1, 2): (0, 1)}
    assert find_rotation(("P", "Q", "R")) == {(1, 0): (2, GYROSCOPIC_PITCH), (1, 2): (0, GYROSCOPIC_PITCH)}
    assert find_rotation(("P", "R")) == {}
    assert find_forces(("u", "P", "Q", "R"), True).tolist() == [0, -1, -1, 2]
    assert find_forces(("u", "P", "Q"), True).tolist() == [0, -1, -1, -1]
    assert configuration().known_rotation
    assert not configuration("msls").known_rotation
    assert not configuration().replace({"known_gravity": False}).known_rotation
