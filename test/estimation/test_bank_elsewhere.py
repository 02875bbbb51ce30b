"""What is known of a derivative where the aircraft is not where it was learnt."""

from __future__ import annotations

import math

import numpy as np
import pytest

from msls_ros.estimation import Identifier, from_mapping
from msls_ros.estimation.bank.elsewhere import REACH_STATES, turned_square
from msls_ros.estimation.bank.regression import BankRegression

STATES = ("u", "v", "w", "P", "Q", "R")


@pytest.mark.parametrize("plane", [(0, 2), (0, 1), (1, 2)], ids=["incidence", "sideslip", "roll"])
def test_a_force_that_turns_with_the_velocity_is_within_its_error(plane: tuple[int, int]) -> None:
    """In axes that turn by an angle a force's derivatives are ``T A T'`` and ``T B``.

    To first order that is a sum of two terms at most, of which the error is the root of the sum of squares.
    """
    random = np.random.default_rng(3)
    engine = Identifier(from_mapping({"states": STATES, "effectors": ("de",), "known_gravity": False}))._regression
    assert isinstance(engine, BankRegression)
    s, x = engine.settings, engine.state
    angle, closest = 1e-4, 0.0
    turn = np.eye(6)
    one, other = plane
    turn[one, one] = turn[other, other] = math.cos(angle)
    turn[one, other], turn[other, one] = -math.sin(angle), math.sin(angle)
    for _ in range(20):
        a, b = random.normal(size=(6, 6)), random.normal(size=6)
        x.mixed[:, 1:7], x.mixed[:, 7] = a, b
        moved = np.column_stack([turn @ a @ turn.T, turn @ b]) - np.column_stack([a, b])
        moved[:, 3:6] = (turn @ a - a)[:, 3:6]  # rates are taken in the body's axes
        error = np.array([[math.sqrt(turned_square(s, x, q, i, angle * angle)) for i in range(1, 8)] for q in range(3)])
        assert (np.abs(moved[:3]) <= 1.001 * math.sqrt(2.0) * error + 1e-7).all()
        closest = max(closest, float(np.max(np.abs(moved[:3]) / error)))
    assert closest > 0.8
    assert not any(turned_square(s, x, q, i, 1.0) for q in range(3, 6) for i in range(8))


def test_what_is_published_is_for_the_velocity_of_its_stamp() -> None:
    """Bars at another angle of attack than that of the last half second are wider by what that may make."""
    random = np.random.default_rng(4)
    names = {"states": ("v", "w", "P"), "effectors": ("da",), "known_gravity": False}
    c = from_mapping({**names, "sample_rate": 50.0, "reference_speed": 50.0})
    count, dt = 500, 0.02
    x, da = np.zeros((count + 1, 3)), 0.05 * np.sign(np.sin(np.arange(count) * 0.13) + np.sin(np.arange(count) * 0.041))
    slopes = np.zeros((count, 3))
    for k in range(count):
        v, w, p = x[k]
        slopes[k] = -0.5 * v + 3.0 * p, -1.0 * w, -0.05 * v - 3.0 * p + 20.0 * da[k]
        x[k + 1] = x[k] + dt * slopes[k]
    x = x[:count] + [0.0, 50.0, 0.0] + 0.001 * random.normal(size=(count, 3))
    slopes += 0.02 * random.normal(size=(count, 3))
    identifier = Identifier(c)
    identifier.run(np.arange(count) / 50.0, x, slopes, da[:, None], every=count)
    engine = identifier._regression
    assert isinstance(engine, BankRegression)
    place = 50.0 * engine.state.place[:2]
    here = identifier.estimate(10.0, np.array([*place, 0.0]))
    there = identifier.estimate(10.0, np.array([place[0] + 6.0, place[1], 0.0]))
    assert here.a[2, 2] == pytest.approx(-3.0, abs=3.0 * here.a_std[2, 2])
    assert there.a_std[2, 2] == pytest.approx(abs(there.a[2, 2]) * 6.0 / 50.0 / REACH_STATES, rel=0.1)
    assert there.a_std[2, 2] > 5.0 * here.a_std[2, 2]
    assert there.b_std[2, 0] == pytest.approx(here.b_std[2, 0]), "an effector's moment is not held against the stamp"
