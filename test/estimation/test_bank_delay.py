"""Responses that are recorded after the deflections: by how much is found in flight, and taken out."""

from __future__ import annotations

import numpy as np
import pytest
from estimation.test_bank import SMALL, uniform

from msls_ros.estimation import Estimate, Identifier, from_mapping
from msls_ros.estimation.bank.regression import BankRegression
from msls_ros.inputs.derivatives import sample_weights

STEP = 0.002
"""Of the simulation [s]."""
ACTUATOR = 20.0
"""[rad/s]"""
EFFECTS = np.array([[8.0, 0.0], [0.0, -4.0], [1.0, 0.0]])


def fly(
    delay: float, rate: int, noise: float = 0.05, seconds: float = 8.0, lost: float = 0.0, said: float = 1.0
) -> tuple[float, list[Estimate]]:
    """Return the delay that was found [s], and the estimates: dither in both effectors, responses that much later.

    A share of the samples is lost; the rate that the identifier is given is ``said`` times that of the samples.
    """
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
    identifier = Identifier(from_mapping({**SMALL, "sample_rate": said * rate}))
    time, read = STEP * np.arange(n, dtype=np.float64)[taken], xdot[taken]
    kept = uniform(len(read), 1, 83)[:, 0] >= 2.0 * lost - 1.0
    samples = time, x[taken], read + noise * uniform(len(read), 3, 82), delta[taken]
    t, states, rates, deflections = (part[kept] for part in samples)
    estimates = identifier.run(t, states, rates, deflections).estimates
    engine = identifier._regression
    assert isinstance(engine, BankRegression)
    return float(engine.state.delay[0, 0]) / (said * rate), estimates


@pytest.mark.parametrize("rate", [25, 50, 100])
@pytest.mark.parametrize("delay", [0.0, 0.006, 0.014, 0.02])
def test_a_delay_of_all_responses_is_found_and_the_effects_are_right(delay: float, rate: int) -> None:
    found, estimates = fly(delay, rate)
    estimate = estimates[-1]
    assert found == pytest.approx(delay, abs=0.002 if rate > 25 else 0.1 / rate)
    assert estimate.delay == pytest.approx(found)
    if delay < 0.02:
        assert abs(estimate.delay - delay) <= 1.96 * estimate.delay_std + 0.001
    np.testing.assert_allclose(estimate.b, EFFECTS, atol=(0.04 if rate > 25 else 0.05) * 8.0)
    assert (np.abs(estimate.b - EFFECTS) <= 1.96 * estimate.b_std).all()


def test_a_longer_one_is_found_once_another_response_is_taken() -> None:
    """That is looked at every second or so, and all begins anew then."""
    estimate = fly(0.03, 50, seconds=20.0)[1][-1]
    assert estimate.delay == pytest.approx(0.03, abs=0.003)
    np.testing.assert_allclose(estimate.b, EFFECTS, atol=0.04 * 8.0)


def test_before_anything_moves_nothing_is_taken_out() -> None:
    found, _ = fly(0.014, 50, seconds=0.2)
    assert found == 0.0


@pytest.mark.parametrize("delay", [0.0, 0.014])
def test_lost_samples_are_no_change_of_the_aircraft(delay: float) -> None:
    """What the deflections were in a gap is not known; taken for those of a sample ago they were the loss of "da"."""
    _, estimates = fly(delay, 50, 0.01, seconds=20.0, lost=0.05)
    assert len(estimates) < 970
    assert not [event for estimate in estimates for event in estimate.events]
    own = np.abs(EFFECTS) > 0.0
    np.testing.assert_allclose(estimates[-1].b[own], EFFECTS[own], atol=0.02 * 8.0)
    assert (np.abs(estimates[-1].b - EFFECTS) <= 1.96 * estimates[-1].b_std)[own].all()


def test_samples_that_come_slower_than_was_said_are_not_all_gaps() -> None:
    found, estimates = fly(0.014, 50, seconds=20.0, said=2.0)
    assert 2.0 * found == pytest.approx(0.014, abs=0.004)  # by the rate that was said
    np.testing.assert_allclose(estimates[-1].b, EFFECTS, atol=0.15 * 8.0)


LIFT_AND_PITCH = np.array([[-20.0, 6.0], [-8.0, 3.0]])
"""Of w and Q, by elevator and flap."""


@pytest.mark.parametrize(("forces", "moments"), [(0.0, 0.014), (0.004, 0.014), (0.012, 0.012), (0.014, 0.006)])
def test_forces_and_moments_may_be_late_by_unlike_times(forces: float, moments: float) -> None:
    """Accelerometers and gyros have filters of their own; both rows are right for all that, and say so."""
    n = 5000
    every = round(0.02 / STEP)
    held = np.repeat(0.1 * uniform(n // every, 2, 86), every, axis=0)
    delta, x, xdot = np.zeros((n, 2)), np.zeros((n, 2)), np.zeros((n, 2))
    back = round(forces / STEP), round(moments / STEP)
    for k in range(n):
        acting = np.array([LIFT_AND_PITCH[q] @ delta[max(k - back[q], 0)] for q in range(2)])
        xdot[k] = acting - np.array([0.5, 2.0]) * x[k]
        if k + 1 < n:
            delta[k + 1] = delta[k] + STEP * ACTUATOR * (held[k] - delta[k])
            x[k + 1] = x[k] + STEP * xdot[k]
    small = {**SMALL, "states": ("w", "Q"), "effectors": ("de", "df"), "sample_rate": 50.0}
    read = xdot[::every] + 0.02 * uniform(n // every, 2, 87)
    time = STEP * np.arange(n, dtype=np.float64)[::every]
    estimate = Identifier(from_mapping(small)).run(time, x[::every], read, delta[::every]).estimates[-1]
    assert abs(estimate.delay - moments) <= 1.96 * estimate.delay_std + 0.001
    np.testing.assert_allclose(estimate.b, LIFT_AND_PITCH, rtol=0.04)
    assert (np.abs(estimate.b - LIFT_AND_PITCH) <= 1.96 * estimate.b_std).all()


def fly_by_hand(delay: float, window: int) -> Estimate:
    """Return the last estimate: slow inputs, measured with noise; both through a window of derivatives."""
    n, back = 6000, round(100 * delay)
    t = 0.01 * np.arange(n, dtype=np.float64)
    delta = 0.1 * np.stack([np.sin(3.0 * t + np.sin(0.7 * t)), np.sin(4.0 * t + 2.0 * np.sin(0.3 * t))], axis=1)
    x, xdot = np.zeros((n, 3)), np.zeros((n, 3))
    for k in range(n):
        xdot[k] = EFFECTS @ delta[max(k - back, 0)] - np.array([2.0, 1.0, 0.5]) * x[k]
        if k + 1 < n:
            x[k + 1] = x[k] + 0.01 * xdot[k]
    weights = sample_weights(window) if window else np.ones(1)
    noisy = xdot + 0.05 * uniform(n, 3, 84), delta + 0.004 * uniform(n, 2, 85)
    means = [np.array([np.convolve(one, weights, "valid") for one in part.T]).T for part in (t[:, None], x, *noisy)]
    identifier = Identifier(from_mapping({**SMALL, "sample_rate": 100.0}), window)
    return identifier.run(means[0][:, 0], means[1], means[2], means[3]).estimates[-1]


@pytest.mark.parametrize("window", [0, 4])
@pytest.mark.parametrize("delay", [0.0, 0.01])
def test_noise_in_the_deflections_draws_the_delay_nowhere(delay: float, window: int) -> None:
    """Interpolation averages it, most so half-way, at 10 ms: what that gains is reckoned out, and little is known."""
    estimate = fly_by_hand(delay, window)
    assert estimate.delay <= delay + 0.004
    assert abs(estimate.delay - delay) <= 1.96 * estimate.delay_std
