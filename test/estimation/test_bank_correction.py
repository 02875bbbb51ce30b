"""What noise hides of a state's effect is in the effects of what moves it: those are not known better than that."""

from __future__ import annotations

import numpy as np
import pytest

from msls_ros.estimation import Estimate, Identifier, from_mapping
from msls_ros.estimation.kernel import Array

RATE, SPEED = 50, 30.0
A = np.array([[-0.9, SPEED], [-0.3, -3.0]])
B = np.array([[-5.5], [-30.0]])
"""w, Q by de."""
NAMES = {"states": ("w", "Q"), "effectors": ("de",), "known_gravity": False, "sample_rate": float(RATE)}


def fly(seed: int, noise: float) -> tuple[Array, Array, Array, Array]:
    """Return time, states, derivatives, deflections; of `noise` times the usual one, of which w has most."""
    n, parts = 60 * RATE, 4
    random = np.random.default_rng(seed)
    time = np.arange(n) / RATE
    u = np.zeros((n, 1))
    for start in range(2 * RATE, n, 6 * RATE):
        unit = round(random.uniform(0.3, 0.8) * RATE)
        u[start : start + unit] = random.uniform(0.02, 0.06)
        u[start + unit : start + 2 * unit] = -u[start]
    x, slopes, now = np.zeros((n, 2)), np.zeros((n, 2)), np.zeros(2)
    for k in range(n):
        x[k], slopes[k] = now, A @ now + B @ u[k]
        for _ in range(parts):
            now = now + (A @ now + B @ u[k]) / (parts * RATE)
    of_states, of_slopes = np.array([0.01 * SPEED, 0.003]), np.array([0.1, 0.015])
    x = x + noise * of_states * random.normal(size=x.shape)
    slopes = slopes + noise * of_slopes * random.normal(size=x.shape)
    return time, x, slopes, u


def last_of(seed: int, noise: float) -> Estimate:
    return Identifier(from_mapping(NAMES)).run(*fly(seed, noise)).estimates[-1]


@pytest.mark.parametrize("seed", range(6))
def test_an_elevator_whose_angle_of_attack_is_lost_in_noise_is_not_known_for_certain(seed: int) -> None:
    last = last_of(seed, 3.0)
    assert abs(last.b[0, 0] - B[0, 0]) <= 1.96 * last.b_std[0, 0], "takes over what w does"
    assert abs(last.b[1, 0] - B[1, 0]) <= 1.96 * last.b_std[1, 0]
    assert abs(last.a[0, 1] - A[0, 1]) <= 1.96 * last.a_std[0, 1]


def test_without_noise_it_is_known() -> None:
    last = last_of(0, 0.0)
    assert last.b_reliable.all()
    assert last.b_std[0, 0] < 0.1 * abs(B[0, 0])
