"""The dither law: no limit is ever passed, whatever B, alarms, stamps and deflections come."""

from __future__ import annotations

import math

import numpy as np
import pytest
from estimation.dither_bench import (
    LITERAL,
    ROWS,
    M,
    accelerations,
    aircraft,
    clock,
    drive,
    known,
    law,
    stamped,
    true_surfaces,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from msls_ros.estimation import EstimationError, Level, from_mapping
from msls_ros.estimation.dither.allocation import allocate, felt, felt_square, uncertain_square, worst_case
from msls_ros.estimation.dither.rms import LARGEST_EFFECT, START
from msls_ros.estimation.dither.sequences import multisines, peak_factor
from msls_ros.estimation.kinematics import GRAVITY

BEGUN = 130
"""Samples after which the dither has begun."""


@given(seed=st.integers(0, 2**31 - 1), scale=st.floats(-12.0, 12.0), std=st.floats(0.0, 1e6))
@settings(max_examples=60, derandomize=True, deadline=None)
def test_dither_and_prediction_are_finite_and_within_limits_whatever_b_is(seed: int, scale: float, std: float) -> None:
    dither, c = law(seed=seed)
    rng = np.random.default_rng(seed)
    b = aircraft(seed) * 10.0**scale
    b[rng.integers(6), rng.integers(M)] = rng.choice([0.0, math.inf, math.nan, 1e308])
    block = drive(dither, known(60, b, std, excitation=float(rng.uniform())))
    assert np.isfinite(block.delta).all()
    assert np.isfinite(block.predicted_acceleration).all()
    assert (block.predicted_acceleration <= block.acceleration_limit).all()
    assert (block.rms <= c.dither.cap * (1 + 1e-12)).all()
    if not (np.abs(b) < LARGEST_EFFECT).all():
        assert not block.delta.any()


# --- how the limit is shared out ---


def test_what_an_effector_is_felt_as_is_the_acceleration_of_a_point_of_a_rigid_body() -> None:
    b, station = aircraft(), np.array([3.0, 0.8, -0.4])
    c = from_mapping({"dither.pilot_forward": 3.0, "dither.pilot_above": 0.8, "dither.pilot_right": -0.4})
    out = np.zeros(3)
    for j in range(M):
        felt(b, ROWS, station, j, out)
        one = np.zeros((1, M))
        one[0, j] = 1.0
        np.testing.assert_allclose(out, accelerations(b, one, c)[0], rtol=1e-12)


def test_the_square_at_an_estimate_exceeds_the_true_one_by_its_variance() -> None:
    b, station, out = aircraft(), np.array([3.0, 0.8, -0.4]), np.zeros(3)
    rng = np.random.default_rng(1)
    std = np.abs(rng.standard_normal((6, M)))
    squares = []
    for _ in range(20_000):
        felt(b + std * rng.standard_normal((6, M)), ROWS, station, 2, out)
        squares.append(float(out @ out))
    exceeds = uncertain_square(np.square(std), ROWS, station, 2)
    assert felt_square(b, ROWS, station, 2, out) + exceeds == pytest.approx(np.mean(squares), rel=0.03)


def test_eq_23_is_solved_for_the_limit() -> None:
    dither, c = law(**LITERAL, cap=0.5, cap_unreliable=0.5)
    b = aircraft()
    block = drive(dither, known(5, b))
    total = np.abs(b).sum(axis=1)
    unit = math.sqrt(
        total[0] ** 2
        + (total[1] + c.dither.pilot_above * total[3] + c.dither.pilot_forward * total[5]) ** 2
        + (total[2] + c.dither.pilot_forward * total[4]) ** 2
    )
    station = np.array([c.dither.pilot_forward, c.dither.pilot_above, 0.0])
    assert worst_case(b, np.ones(M), ROWS, station) == pytest.approx(unit)
    assert block.rms[0] * unit / GRAVITY == pytest.approx(0.012, rel=1e-12)


@given(
    seed=st.integers(0, 10_000),
    m=st.integers(1, 8),
    limit=st.floats(1e-4, 10.0),
    information=st.booleans(),
)
@settings(max_examples=150, derandomize=True, deadline=None)
def test_the_limit_is_spent_exactly_or_all_are_at_their_caps(
    seed: int, m: int, limit: float, information: bool
) -> None:
    rng = np.random.default_rng(seed)
    square = np.square(rng.standard_normal(m)) * (rng.random(m) > 0.1)
    weights = rng.uniform(0.0, 2.0, m) * (rng.random(m) > 0.1)
    caps, out = rng.uniform(0.0, 1.0, m), np.zeros(m)
    binds = allocate(square, weights, caps, limit, information, out)
    assert (out >= 0.0).all() and (out <= caps * (1 + 1e-12)).all()
    spent = math.sqrt(float(np.sum(square * out**2)))
    assert spent <= limit * (1 + 1e-9)
    if binds:
        assert spent == pytest.approx(limit, rel=1e-9)
    else:
        np.testing.assert_array_equal(out[weights > 0.0], caps[weights > 0.0])


def test_where_no_acceleration_is_allowed_what_nobody_feels_is_not_moved_either() -> None:
    out = np.ones(3)
    assert allocate(np.array([0.0, 1.0, 0.0]), np.ones(3), np.full(3, 0.1), 0.0, True, out)
    assert not out.any()


def test_no_other_shares_of_the_same_limit_hold_more_information() -> None:
    rng = np.random.default_rng(3)
    square, caps, out = np.square(rng.standard_normal(5)), np.full(5, 0.4), np.zeros(5)
    allocate(square, np.ones(5), caps, 0.2, True, out)
    best = np.log(out).sum()
    for _ in range(2000):
        other = np.minimum(out * np.exp(0.3 * rng.standard_normal(5)), caps)
        other *= min(0.2 / math.sqrt(float(np.sum(square * other**2))), float((caps / other).min()))
        assert np.log(other).sum() <= best + 1e-12


def test_an_effector_that_is_not_known_starts_small_and_grows_as_it_becomes_known() -> None:
    rms = [drive(law()[0], known(BEGUN, aircraft(), std)).rms[-1] for std in (math.inf, 10.0, 1.0, 0.1)]
    assert rms == sorted(rms)
    assert rms[0] < 0.5 * rms[-1]
    nothing = drive(law()[0], known(BEGUN, np.zeros((6, M)), math.inf, excitation=0.0))
    assert nothing.rms[-1] >= START * law()[1].dither.cap_unreliable * (1 - 1e-12)


def test_the_cap_is_lower_for_an_effector_that_is_neither_excited_nor_known() -> None:
    _, c = law()
    small = 1e-6 * aircraft()
    assert drive(law()[0], known(BEGUN, small, 10.0, excitation=0.5)).rms[-1] == pytest.approx(c.dither.cap_unreliable)
    assert drive(law()[0], known(BEGUN, small, 0.1, excitation=0.5)).rms[-1] == pytest.approx(c.dither.cap)
    assert drive(law()[0], known(BEGUN, small, 10.0, excitation=0.9)).rms[-1] == pytest.approx(c.dither.cap)


def test_weights_multiply_the_shares() -> None:
    weights = [1.0, 0.5, 0.25, 1.0, 0.0, 1.0, 1.0]
    dither, _ = law(weights=weights, rate_limit=[], position_low=[], position_high=[])
    rms = np.sqrt(np.mean(np.square(drive(dither, known(4000, aircraft())).delta), axis=0))
    plain, _ = law(rate_limit=[], position_low=[], position_high=[])
    even = np.sqrt(np.mean(np.square(drive(plain, known(4000, aircraft())).delta), axis=0))
    assert rms[4] == 0.0
    ratio = rms / even
    assert ratio[1] / ratio[0] == pytest.approx(0.5, rel=0.1)
    assert ratio[2] / ratio[0] == pytest.approx(0.25, rel=0.1)


# --- levels ---


def test_an_alarm_boosts_for_its_window_only() -> None:
    block = drive(law()[0], known(120, aircraft(), alarms=(10,)))
    assert (block.level[:10] == Level.NOMINAL).all()
    assert (block.level[10:60] == Level.BOOSTED).all()
    assert (block.level[60:] == Level.NOMINAL).all()
    assert block.acceleration_limit[10] == 0.04


def test_alarms_without_end_boost_no_longer_than_the_budget_of_any_minute() -> None:
    dither, c = law(boost_budget=10.0)
    n = 50 * 240
    block = drive(dither, known(n, aircraft(), alarms=tuple(range(0, n, 45))))
    boosted = np.convolve(block.level == Level.BOOSTED, np.full(50 * 60, 0.02), "valid")
    assert boosted.max() <= c.dither.boost_budget + 0.05
    assert boosted.min() > 0.3 * c.dither.boost_budget


def test_what_is_known_to_the_target_error_gets_less_and_all_comes_back_at_an_alarm() -> None:
    dither, _ = law(target_error=0.05)
    n = 600
    knowledge = known(n, aircraft(), 0.01, alarms=(500,))
    block = drive(dither, knowledge)
    rms = lambda span: np.sqrt(np.mean(np.square(block.delta[span])))  # noqa: E731
    assert rms(slice(400, 500)) < 0.2 * rms(slice(0, 20))
    assert rms(slice(500, 540)) > rms(slice(0, 20))
    assert block.at(450).reason == "known to dither.target_error"
    unknown = drive(law(target_error=0.05)[0], known(n, aircraft(), 0.2))
    assert np.sqrt(np.mean(np.square(unknown.delta[400:]))) > 3.0 * rms(slice(400, 500))


def test_activity_is_limited_for_aircraft_without_a_pilot() -> None:
    corner, activity = 20.0, 0.05
    dither, _ = law(activity_nominal=activity, rate_limit=[], position_low=[], position_high=[])
    block = drive(dither, known(8000, 1e-6 * aircraft()))
    surface, rates = np.zeros(M), []
    for command in block.delta:
        rates.append(corner * (command - surface))
        surface = command + (surface - command) * math.exp(-corner * 0.02)
    rms = np.sqrt(np.mean(np.square(rates[100:]), axis=0))
    assert rms == pytest.approx(np.full(M, activity), rel=0.05)


def test_disabled_means_zero() -> None:
    block = drive(law(enabled=False)[0], known(10, aircraft(), alarms=(3,)))
    assert not block.delta.any()
    assert (block.level == Level.OFF).all()


# --- sequences ---


def test_prediction_and_what_is_felt_agree() -> None:
    for allocation in ("information", "equal"):
        dither, c = law(allocation=allocation)
        n, b = 6000, aircraft()
        block = drive(dither, known(n, b))
        shares, _, _ = true_surfaces(clock(n), block.delta, 20.0, 1.0)
        realised = np.linalg.norm(accelerations(b, shares, c), axis=1) / GRAVITY
        rms = math.sqrt(float(np.mean(np.square(realised[100:]))))
        assert 0.85 * c.dither.limit_nominal <= rms <= c.dither.limit_nominal
        assert block.predicted_acceleration[100:].mean() == pytest.approx(rms, rel=0.04)


def test_the_wanted_rms_arrives_at_the_surface_whatever_the_rate() -> None:
    for kind in ("even", "half rate", "double rate", "jitter"):
        dither, c = law(allocation="equal", rate_limit=[], cap=0.004, cap_unreliable=0.004)
        n = 20_000
        time = stamped(kind, n, 0)
        block = dither.commands(time, known(n, 1e-6 * aircraft()), np.zeros((n, M)))
        shares, _, _ = true_surfaces(time, block.delta, 20.0, 1.0)
        weight = np.diff(time, append=time[-1])
        rms = np.sqrt(np.average(np.square(shares[100:]), axis=0, weights=weight[100:]))
        assert rms == pytest.approx(np.full(M, c.dither.cap), rel=0.03 if kind == "even" else 0.08), kind


def test_the_effectors_move_independently() -> None:
    dither, _ = law(allocation="equal", cap=0.004, cap_unreliable=0.004)
    block = drive(dither, known(5000, 1e-6 * aircraft()))
    correlation = np.corrcoef(block.delta.T) - np.eye(M)
    assert np.abs(correlation).max() < 0.06


def test_what_the_window_holds_back_takes_a_hundredth_of_the_information() -> None:
    """It prefers what cancels: commands are correlated by .07 to .08 at most with six seeds."""
    for seed in range(3):
        correlation = np.corrcoef(drive(law(seed=seed)[0], known(5000, aircraft())).delta.T)
        assert np.abs(correlation - np.eye(M)).max() < 0.1
        assert np.linalg.det(correlation) ** (1.0 / M) > 0.99


def test_equal_seeds_give_equal_bits_and_blocks_do_not_matter() -> None:
    whole = drive(law(seed=3)[0], known(200, aircraft())).delta
    dither, _ = law(seed=3)
    time, parts = clock(200), []
    for start in range(0, 200, 7):
        n = min(7, 200 - start)
        block = dither.commands(time[start : start + n], known(n, aircraft()), np.zeros((n, M)))
        parts.append(block.delta.copy())
    assert np.array_equal(np.concatenate(parts), whole)
    assert not np.array_equal(drive(law(seed=4)[0], known(200, aircraft())).delta, whole)


def test_a_bandwidth_slows_the_sequence() -> None:
    free: dict[str, object] = {"rate_limit": [], "position_low": [], "position_high": []}
    block = drive(law(bandwidth=2.0, **free)[0], known(20_000, 1e-6 * aircraft()))
    one = block.delta[:, 0]
    assert np.corrcoef(one[1:], one[:-1])[0, 1] == pytest.approx(math.exp(-2.0 * math.pi * 2.0 * 0.02), abs=0.03)


def test_multisines_are_orthogonal_over_their_period_and_have_low_peaks() -> None:
    frequencies, phases = multisines(M, 10.0, 0.2, 8.0, seed=0)
    time = np.arange(500) / 50.0
    waves = np.cos(2.0 * np.pi * (frequencies[:, :, None] * time + phases[:, :, None])).sum(axis=1)
    waves *= math.sqrt(2.0 / frequencies.shape[1])
    np.testing.assert_allclose(waves @ waves.T / 500.0, np.eye(M), atol=1e-10)
    for j in range(M):
        harmonics = np.round(frequencies[j] * 10.0)
        assert peak_factor(harmonics, phases[j]) < 1.6
        assert peak_factor(harmonics, phases[j]) < 0.7 * peak_factor(harmonics, np.zeros(len(harmonics)))


def test_multisines_reach_the_surface_with_the_wanted_rms() -> None:
    dither, c = law(sequence="multisine", allocation="equal", rate_limit=[], cap=0.004, cap_unreliable=0.004)
    n = 5000
    block = drive(dither, known(n, 1e-6 * aircraft()))
    shares, _, _ = true_surfaces(clock(n), block.delta, 20.0, 1.0)
    assert np.sqrt(np.mean(np.square(shares[500:]), axis=0)) == pytest.approx(np.full(M, c.dither.cap), rel=0.12)


def test_too_few_harmonics_are_refused() -> None:
    with pytest.raises(EstimationError, match="leave 3 harmonics for 7 effectors; a longer period or a wider band"):
        law(sequence="multisine", multisine_period=1.0, multisine_low=0.5, multisine_high=3.0)
