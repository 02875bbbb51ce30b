"""Whatever is accepted, with whatever settings are allowed: finite estimates, an event where all was lost, recovery."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from msls_ros.estimation import Estimate, EventKind, Identifier, from_mapping
from msls_ros.estimation.kernel import Array

Samples = tuple[Array, Array, Array]
STORM, CALM = 1500, 1000
EFFECTORS = 7
A = np.diag([-0.5] * 6 + [0.0] * 3)
B = np.vstack([np.random.default_rng(1).normal(size=(6, EFFECTORS)), np.zeros((3, EFFECTORS))])
SETTINGS: dict[str, dict[str, Any]] = {
    "msls without a penalty": {"estimator.penalty": 0.0, "estimator.forgetting_factor": 0.99},
    "msls whose penalty is no number to divide by": {"estimator.penalty": 1e-200},
    "msls that forgets nothing": {"estimator.forgetting_factor": 1.0},
    "msls with the penalty at the solve only": {"estimator.penalty_retained": False},
    "rls that forgets at once": {"estimator.method": "rls", "estimator.forgetting_factor": 0.1},
    "rls that forgets nothing": {"estimator.method": "rls", "estimator.forgetting_factor": 1.0},
    "bank": {"estimator.method": "bank"},
}


def storm(kind: str, seed: int = 0) -> Samples:
    """Random samples over twelve orders of magnitude and more, from sample to sample or from number to number."""
    rng = np.random.default_rng(seed)
    found = []
    for width in (9, 9, EFFECTORS):
        size = rng.uniform(-12.0, 11.5, (STORM, 1 if kind == "samples" else width))
        found.append(np.clip(rng.normal(size=(STORM, width)) * 10.0**size, -9.9e11, 9.9e11))
    return found[0], found[1], found[2]


def calm(seed: int = 2) -> Samples:
    """An aircraft that is linear, excited, and measured well."""
    rng = np.random.default_rng(seed)
    x, delta = 0.1 * rng.normal(size=(CALM, 9)) + [100.0, *[0.0] * 8], 0.1 * rng.normal(size=(CALM, EFFECTORS))
    return x, x @ A.T + delta @ B.T + 1e-3 * rng.normal(size=(CALM, 9)), delta


def finite(estimate: Estimate) -> bool:
    """Whether all is a number; errors may be infinite, where nothing is known."""
    numbers = all(np.isfinite(v).all() for v in (estimate.a, estimate.b, estimate.bias, estimate.dither.delta))
    errors = not np.isnan(estimate.a_std).any() and not np.isnan(estimate.b_std).any()
    return numbers and errors and bool((estimate.excitation >= 0.0).all() and (estimate.excitation <= 1.0).all())


@pytest.mark.parametrize("kind", ["samples", "numbers"])
@pytest.mark.parametrize("name", SETTINGS)
def test_after_a_storm_of_accepted_values_the_estimates_are_finite_and_right_again(name: str, kind: str) -> None:
    identifier = Identifier(from_mapping({**SETTINGS[name], "detector.mode": "off"}))
    stormy = identifier.run(np.arange(STORM) / 50.0, *storm(kind), every=20).estimates
    assert all(finite(estimate) for estimate in stormy)
    after = identifier.run((STORM + np.arange(CALM)) / 50.0, *calm(), every=20).estimates
    assert all(finite(estimate) for estimate in after)
    assert any(event.kind == EventKind.RESET for estimate in (*stormy, *after) for event in estimate.events)
    error = np.abs(after[-1].b - B)[3:6].max()
    if name != "rls that forgets at once":  # it is no estimator, but it must stay finite
        assert error < 0.02
    wrong = [(np.abs(e.b - B) > 1.0)[3:6] & e.b_reliable[3:6] for e in (*stormy, *after)]
    assert not np.any(wrong)


@pytest.mark.parametrize(("method", "length"), [("msls", 5), ("rls", 5), ("bank", 10)])
def test_a_burst_that_nothing_forgets_never_leaves_a_wrong_estimate_reliable(method: str, length: int) -> None:
    """To the bank a burst of a tenth of a second is a spike, see below."""
    changes = {"estimator.method": method, "estimator.forgetting_factor": 1.0, "detector.mode": "off"}
    identifier = Identifier(from_mapping(changes))
    x, xdot, delta = calm()
    rng = np.random.default_rng(3)
    burst = slice(700, 700 + length)
    x[burst], delta[burst] = 1e3 * rng.normal(size=(length, 9)), 1e3 * rng.normal(size=(length, EFFECTORS))
    xdot[burst] = 1e10 * rng.normal(size=(length, 9))
    estimates = identifier.run(np.arange(CALM) / 50.0, x, xdot, delta).estimates
    reset = next(v for e in estimates[burst.stop :] for v in e.events if v.kind == EventKind.RESET)
    assert reset.time * 50.0 - burst.stop < 3 * len(identifier.configuration.regressors)
    assert "larger than any of an aircraft" in reset.description and reset.equations == identifier.configuration.rows
    wrong = [(np.abs(e.b - B) > 100.0)[3:6] & e.b_reliable[3:6] for e in estimates[burst.stop :]]
    assert not np.any(wrong)
    assert np.abs(estimates[-1].b - B)[3:6].max() < 0.02


def test_a_burst_of_a_tenth_of_a_second_leaves_the_bank_as_if_it_had_not_been() -> None:
    identifier = Identifier(from_mapping({"detector.mode": "off"}))
    x, xdot, delta = calm()
    rng = np.random.default_rng(3)
    burst = slice(700, 705)
    x[burst], delta[burst] = 1e3 * rng.normal(size=(5, 9)), 1e3 * rng.normal(size=(5, EFFECTORS))
    xdot[burst] = 1e10 * rng.normal(size=(5, 9))
    estimates = identifier.run(np.arange(CALM) / 50.0, x, xdot, delta).estimates
    assert identifier.spikes == 5
    assert not [v for e in estimates for v in e.events]
    assert all(np.abs(e.b - B)[3:6].max() < 0.02 for e in estimates[burst.start :])


@pytest.mark.parametrize("size", [1.0, 30.0, 1e5])
@pytest.mark.parametrize("method", ["msls", "rls"])
def test_a_burst_that_is_not_absurd_widens_the_bars_as_long_as_it_is_remembered(method: str, size: float) -> None:
    changes = {"estimator.method": method, "estimator.forgetting_factor": 1.0, "detector.mode": "off"}
    identifier = Identifier(from_mapping(changes))
    x, xdot, delta = (np.vstack([one, two]) for one, two in zip(calm(), calm(4), strict=True))
    burst = slice(400, 405)
    delta[burst] = size * np.random.default_rng(3).normal(size=(5, EFFECTORS))
    estimates = identifier.run(np.arange(2 * CALM) / 50.0, x, xdot, delta, every=10).estimates
    errors = np.array([np.abs(e.b - B)[3:6] for e in estimates])
    reliable = np.array([e.b_reliable[3:6] for e in estimates])
    assert reliable[39].all() and errors[39].max() < 0.01, "before the burst"
    assert errors[-1].max() > 0.3, "it is remembered"
    assert not (reliable & (errors > 0.3)).any()


def test_a_reset_is_the_same_in_blocks_as_sample_by_sample() -> None:
    x, xdot, delta = (np.vstack(parts) for parts in zip(storm("samples"), calm(), strict=True))
    time = np.arange(STORM + CALM) / 50.0
    single, blocks = (Identifier(from_mapping({"detector.mode": "off"})) for _ in range(2))
    one = single.run(time, x, xdot, delta, every=1).estimates
    many = blocks.run(time, x, xdot, delta, every=STORM + CALM).estimates
    events = [[(v.time, v.kind) for e in found for v in e.events] for found in (one, many)]
    assert events[0] == events[1] and sum(map(len, events[0])) > 0
    np.testing.assert_array_equal(one[-1].b, blocks.estimate(time[-1], x[-1]).b)


def test_an_ordinary_aircraft_is_never_reset() -> None:
    for method in ("msls", "rls", "bank"):
        identifier = Identifier(from_mapping({"estimator.method": method}))
        estimates = identifier.run(np.arange(CALM) / 50.0, *calm()).estimates
        assert not [v for e in estimates for v in e.events if v.kind == EventKind.RESET]
