"""Velocities as regressors: noise that is none of their motion by their derivatives is taken off, and nothing else."""

from __future__ import annotations

import math

import numpy as np
import pytest
from estimation.test_bank_correction import NAMES, A, B, fly

from msls_ros.estimation import Estimate, Identifier, from_mapping
from msls_ros.estimation.kernel import Array
from msls_ros.estimation.regressor_noise import RegressorNoise, clear_defect, make_defect, make_noise, observe_defect
from msls_ros.estimation.state_filter import Filter, clear_filter, filter_states, make_filter

RATE = 50.0
SECONDS = 60.0


def filtered(
    x: Array, xdot: Array, names: tuple[str, ...] = ("w",), time: Array | None = None
) -> tuple[Array, RegressorNoise, Filter]:
    """Return the states (n, v) as they are learnt from, what is said of their noise, and the filter."""
    n, count = x.shape
    columns = np.arange(count)
    time = np.arange(n) / RATE if time is None else time
    defect = make_defect(names, 0, RATE)
    clear_defect(defect)
    one = make_filter(defect.size, defect.delay.velocity)
    clear_filter(one)
    noise, aligned, found = make_noise(n, count), x.copy(), np.zeros((n, count))
    observe_defect(defect, time, x, xdot, np.zeros((n, 0)), columns, noise, aligned)
    filter_states(one, time, aligned, xdot, columns, noise, found)
    return found, noise, one


def motion(seed: int = 0, held: bool = False) -> tuple[Array, Array]:
    """Return a velocity and its derivative, (n, 1): of a few tones, or of one that is held from sample to sample."""
    time = np.arange(round(SECONDS * RATE)) / RATE
    if held:
        slope = np.random.default_rng(seed).normal(size=len(time)) + 2.0 * np.cos(time)
        x = np.concatenate([[0.0], np.cumsum(slope)[:-1]]) / RATE
        return x[:, None], slope[:, None]
    tones = np.array([0.7, 1.9, 4.3])
    turns = time[:, None] * tones + tones
    return (np.sin(turns) / tones).sum(axis=1)[:, None], np.cos(turns).sum(axis=1)[:, None]


@pytest.mark.parametrize("noise", [0.1, 0.3])
def test_white_noise_is_taken_off_as_far_as_is_said(noise: float) -> None:
    errors, said = [], []
    for seed in range(4):
        x, xdot = motion()
        random = np.random.default_rng(seed)
        found, about, _ = filtered(x + noise * random.normal(size=x.shape), xdot + 0.1 * random.normal(size=x.shape))
        late = slice(len(x) // 2, None)
        errors.append(np.mean((found - x)[late] ** 2))
        said.append(np.mean(about.variance[late, 0]))
    assert math.sqrt(np.mean(errors)) < 0.5 * noise
    assert np.mean(errors) < 1.3 * np.mean(said)


def test_a_gust_that_no_derivative_shows_stays() -> None:
    x, xdot = motion()
    random = np.random.default_rng(1)
    gust = np.cumsum(0.05 * random.normal(size=x.shape), axis=0)
    found, _, one = filtered(x + gust + 0.02 * random.normal(size=x.shape), xdot)
    assert one.filled[0] > 0
    assert np.sqrt(np.mean((found - x - gust)[1000:] ** 2)) < 0.03


@pytest.mark.parametrize("held", [False, True])
def test_without_noise_nothing_changes(held: bool) -> None:
    """Of a derivative that is held from sample to sample, trapezoids make half a step too much, and that is found."""
    x, xdot = motion(held=held)
    found, about, _ = filtered(x, xdot)
    assert np.abs(found - x).max() < 1e-3 * np.std(x)
    assert about.variance[1000:, 0].max() < 1e-4 * np.var(x)


@pytest.mark.parametrize("factor", [0.0, -1.0, 9.81, math.pi / 180.0])
def test_what_is_not_the_integral_of_its_derivative_is_left_as_it_is(factor: float) -> None:
    x, xdot = motion()
    x = x + 0.3 * np.random.default_rng(2).normal(size=x.shape)
    found, about, _ = filtered(x, factor * xdot)
    assert (found == x).all()
    assert (about.believed[1:, 0] == 1.0).all()


def test_rates_are_left_as_they_are() -> None:
    x, xdot = motion()
    x = x + 0.3 * np.random.default_rng(2).normal(size=x.shape)
    assert (filtered(x, xdot, ("Q",))[0] == x).all()


def test_after_a_gap_it_begins_with_what_is_measured() -> None:
    x, xdot = motion()
    x = x + 0.3 * np.random.default_rng(3).normal(size=x.shape)
    time = np.arange(len(x)) / RATE
    kept = (time < 40.0) | (time >= 45.0)
    found, _, _ = filtered(x[kept], xdot[kept], time=time[kept])
    first = np.flatnonzero(time[kept] >= 45.0)[0]
    assert found[first] == x[kept][first]
    assert found[first - 1] != x[kept][first - 1]
    assert np.isfinite(found).all()


def identify(seed: int, noise: float) -> Estimate:
    return Identifier(from_mapping(NAMES)).run(*fly(seed, noise), every=3000).estimates[-1]


@pytest.mark.parametrize("noise", [1.0, 3.0])
def test_damping_and_stiffness_of_a_noisy_vane_are_those_of_the_aircraft(noise: float) -> None:
    """Of the vane as it is measured least squares leave a half of the stiffness, and a tenth."""
    lasts = [identify(seed, noise) for seed in range(6)]
    stiffness = np.median([one.a[1, 0] / A[1, 0] for one in lasts])
    elevator = np.median([one.b[1, 0] / B[1, 0] for one in lasts])
    assert abs(stiffness - 1.0) < 0.1
    assert abs(elevator - 1.0) < 0.05
    for one in lasts:
        assert (np.abs(one.b - B) <= 2.58 * one.b_std)[one.b_reliable].all()


def test_one_by_one_it_is_the_same_to_the_bit() -> None:
    flight = fly(0, 1.0)
    pieces = Identifier(from_mapping(NAMES)).run(*flight, every=500).estimates
    one = Identifier(from_mapping(NAMES))
    single = {e.samples: e for e in (one.update(*sample) for sample in zip(*flight, strict=True))}
    for estimate in pieces:
        for name in ("a", "b", "a_std", "b_std", "bias"):
            assert getattr(estimate, name).tobytes() == getattr(single[estimate.samples], name).tobytes()
