"""Responses that are recorded after the deflections: by how much is found in flight, and taken out."""

from __future__ import annotations

import numpy as np
import pytest
from estimation.test_bank import SMALL, uniform

from msls_ros.estimation import Estimate, Identifier, from_mapping
from msls_ros.estimation.bank_regression import BankRegression

STEP = 0.002
"""Of the simulation [s]."""
ACTUATOR = 20.0
"""[rad/s]"""
EFFECTS = np.array([[8.0, 0.0], [0.0, -4.0], [1.0, 0.0]])


def fly(delay: float, rate: int, noise: float = 0.05, seconds: float = 8.0) -> tuple[float, Estimate]:
    """Return the delay that was found [s], and the estimate: dither in both effectors, responses that much later."""
    n = round(seconds / STEP)
    every = round(1.0 / (rate * STEP))
    held = np.repeat(0.1 * uniform(n // every + 1, 2, 81), every, axis=0)[:n]
    delta, x, xdot = np.zeros((n, 2)), np.zeros((n, 3)), np.zeros((n, 3))
    back = round(delay / STEP)
    for k in range(n):
        xdot[k] = EFFECTS @ delta[max(k - back, 0)] - np.array([2.0, 1.0, 0.5]) * x[k]
        if k + 1 < n:
            delta[k + 1] = delta[k] + STEP * ACTUATOR * (held[k] - delta[k])
            x[k + 1] = x[k] + STEP * xdot[k]
    taken = slice(0, n, every)
    identifier = Identifier(from_mapping({**SMALL, "sample_rate": float(rate)}))
    time, read = STEP * np.arange(n, dtype=np.float64)[taken], xdot[taken]
    estimates = identifier.run(time, x[taken], read + noise * uniform(len(read), 3, 82), delta[taken]).estimates
    engine = identifier._regression
    assert isinstance(engine, BankRegression)
    return float(engine.state.delay[0]) / rate, estimates[-1]


@pytest.mark.parametrize("rate", [25, 50, 100])
@pytest.mark.parametrize("delay", [0.0, 0.006, 0.014, 0.02])
def test_a_delay_of_all_responses_is_found_and_the_effects_are_right(delay: float, rate: int) -> None:
    found, estimate = fly(delay, rate)
    assert found == pytest.approx(delay, abs=0.002 if rate > 25 else 0.1 / rate)
    assert estimate.delay == pytest.approx(found)
    if delay < 0.02:
        assert abs(estimate.delay - delay) <= 1.96 * estimate.delay_std + 0.001
    np.testing.assert_allclose(estimate.b, EFFECTS, atol=(0.04 if rate > 25 else 0.05) * 8.0)
    assert (np.abs(estimate.b - EFFECTS) <= 1.96 * estimate.b_std).all()


def test_a_longer_one_is_found_once_another_response_is_taken() -> None:
    """That is looked at every second or so, and all begins anew then."""
    _, estimate = fly(0.03, 50, seconds=20.0)
    assert estimate.delay == pytest.approx(0.03, abs=0.003)
    np.testing.assert_allclose(estimate.b, EFFECTS, atol=0.04 * 8.0)


def test_before_anything_moves_nothing_is_taken_out() -> None:
    found, _ = fly(0.014, 50, seconds=0.2)
    assert found == 0.0
