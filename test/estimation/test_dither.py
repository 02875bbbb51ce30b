"""The dither law: no limit is ever passed, whatever B, alarms, gaps and deflections come."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msls_ros.estimation import Configuration, DitherBlock, DitherLaw, Level, from_mapping
from msls_ros.estimation.dither import CREST, pilot_acceleration
from msls_ros.estimation.kinematics import GRAVITY

LIMITED = {
    "dither.actuator_bandwidth": [20.0] * 7,
    "dither.rate_limit": [1.0, 2.0, 1.0, 1.4, 1.4, 0.8, 0.8],
    "dither.position_low": [-0.4] * 7,
    "dither.position_high": [0.4] * 7,
    "dither.weights": [1.0, 0.5, 2.0, 1.0, 0.0, 1.0, 1.0],
}


def law(**changes: object) -> tuple[DitherLaw, Configuration]:
    configuration = from_mapping({**LIMITED, **{f"dither.{k}": v for k, v in changes.items()}})
    return DitherLaw(configuration), configuration


def drive(
    dither: DitherLaw,
    n: int,
    effect: np.ndarray,
    excitation: float = 1.0,
    alarms: tuple[int, ...] = (),
    step: float = 0.02,
) -> DitherBlock:
    alarm = np.zeros((n, 6), np.int64)
    alarm[list(alarms), 3] = 1
    time = step * np.arange(n, dtype=np.float64)
    return dither.commands(time, np.tile(effect, (n, 1)), np.full(n, excitation), alarm, np.zeros((n, 7)))


EFFECT = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 2.0])


@given(
    seed=st.integers(0, 2**31 - 1),
    scale=st.floats(-12.0, 12.0),
    excitation=st.floats(0.0, 1.0),
    alarms=st.sets(st.integers(0, 59), max_size=6),
    spread=st.floats(0.0, 0.6),
    gaps=st.sets(st.integers(1, 59), max_size=3),
)
@settings(max_examples=60, derandomize=True, deadline=None)
def test_no_limit_is_passed_whatever_comes(
    seed: int, scale: float, excitation: float, alarms: set[int], spread: float, gaps: set[int]
) -> None:
    dither, c = law(seed=seed)
    p, n = c.dither, 60
    rng = np.random.default_rng(seed)
    effect = np.abs(rng.standard_normal((n, 6))) * 10.0**scale
    effect[rng.integers(n), rng.integers(6)] = rng.choice([0.0, math.inf, 1e308])
    delta = rng.uniform(-spread, spread, (n, 7))
    time = 0.02 * np.arange(n, dtype=np.float64)
    for gap in gaps:
        time[gap:] += 1.0
    alarm = np.zeros((n, 6), np.int64)
    alarm[sorted(alarms), 3] = 1
    block = dither.commands(time, effect, np.full(n, excitation), alarm, delta)
    assert np.isfinite(block.delta).all()
    assert (block.predicted_acceleration <= block.acceleration_limit).all()
    assert (block.acceleration_limit <= p.limit_boosted).all()
    assert (block.rms * max(p.weights) <= p.cap * (1 + 1e-12)).all()
    gain = math.sqrt((1.0 + math.exp(-0.4)) / (1.0 - math.exp(-0.4)))
    assert (np.abs(block.delta) <= CREST * p.cap * gain + 1e-12).all()
    boosted = block.level == Level.BOOSTED
    recent = [any(0 <= t - time[a] < p.boost_duration for a in alarms) for t in time]
    assert not (boosted & ~np.array(recent)).any()
    surface = np.zeros(7)
    for k in range(n):
        command = block.delta[k]
        assert (np.abs(command - surface) <= np.array(p.rate_limit) / 20.0 + 1e-9).all() or block.level[k] in (0, 3)
        surface = math.exp(-0.4) * surface + (1.0 - math.exp(-0.4)) * command
    for gap in gaps:
        assert block.level[gap] == Level.INHIBITED
        assert not block.delta[gap].any()


def test_a_surface_at_its_stop_is_not_pushed_further() -> None:
    dither, _ = law()
    n = 300
    delta = np.zeros((n, 7))
    delta[:, 0] = 0.4
    zero = np.zeros((n, 6))
    block = dither.commands(0.02 * np.arange(n, dtype=np.float64), zero, np.ones(n), zero.astype(np.int64), delta)
    surface = 0.0
    for k in range(n):
        base = delta[k, 0] - surface
        assert block.delta[k, 0] <= max(0.0, 0.4 - base) + 1e-12
        surface = math.exp(-0.4) * surface + (1.0 - math.exp(-0.4)) * block.delta[k, 0]


def test_eq_23_is_solved_for_the_limit() -> None:
    dither, c = law(cap=0.5, cap_unreliable=0.5)
    block = drive(dither, 5, EFFECT)
    unit = math.sqrt(
        EFFECT[0] ** 2
        + (EFFECT[1] + c.dither.pilot_above * EFFECT[3] + c.dither.pilot_forward * EFFECT[5]) ** 2
        + (EFFECT[2] + c.dither.pilot_forward * EFFECT[4]) ** 2
    )
    assert pilot_acceleration(EFFECT, np.arange(6), c.dither.pilot_forward, c.dither.pilot_above) == pytest.approx(unit)
    assert block.rms[0] * unit / GRAVITY == pytest.approx(0.012, rel=1e-12)


def test_an_alarm_boosts_for_its_window_only() -> None:
    dither, _ = law()
    block = drive(dither, 120, EFFECT, alarms=(10,))
    assert (block.level[:10] == Level.NOMINAL).all()
    assert (block.level[10:60] == Level.BOOSTED).all()
    assert (block.level[60:] == Level.NOMINAL).all()
    assert block.acceleration_limit[10] == 0.04


def test_the_cap_is_lower_while_b_is_not_excited() -> None:
    dither, c = law()
    block = drive(dither, 3, np.zeros(6), excitation=0.5)
    assert block.rms[0] == c.dither.cap_unreliable / 2.0
    assert "not excited" in block.at(0).reason
    assert drive(law()[0], 3, np.zeros(6), excitation=0.9).rms[0] == c.dither.cap / 2.0


def test_the_wanted_rms_arrives_at_the_surface() -> None:
    dither, _ = law(weights=[1.0] * 7, rate_limit=[], cap=0.004, cap_unreliable=0.004)
    block = drive(dither, 20000, np.zeros(6))
    pole, surface, seen = math.exp(-0.4), np.zeros(7), []
    for command in block.delta:
        surface = pole * surface + (1.0 - pole) * command
        seen.append(surface)
    rms = np.sqrt(np.mean(np.square(seen[100:]), axis=0))
    assert rms == pytest.approx(np.full(7, 0.004), rel=0.03)


def test_the_effectors_move_independently() -> None:
    block = drive(law(weights=[1.0] * 7)[0], 5000, np.zeros(6))
    correlation = np.corrcoef(block.delta.T) - np.eye(7)
    assert np.abs(correlation).max() < 0.06


def test_equal_seeds_give_equal_bits_and_blocks_do_not_matter() -> None:
    whole = drive(law(seed=3)[0], 200, EFFECT).delta
    dither, _ = law(seed=3)
    parts = []
    for start in range(0, 200, 7):
        n = min(7, 200 - start)
        time = 0.02 * np.arange(start, start + n, dtype=np.float64)
        zero = np.zeros((n, 6), np.int64)
        parts.append(dither.commands(time, np.tile(EFFECT, (n, 1)), np.ones(n), zero, np.zeros((n, 7))).delta.copy())
    assert np.array_equal(np.concatenate(parts), whole)
    assert not np.array_equal(drive(law(seed=4)[0], 200, EFFECT).delta, whole)


def test_disabled_means_zero() -> None:
    block = drive(law(enabled=False)[0], 10, EFFECT, alarms=(3,))
    assert not block.delta.any()
    assert (block.level == Level.OFF).all()


def test_a_bandwidth_keeps_the_wanted_rms_and_slows_the_sequence() -> None:
    block = drive(
        law(weights=[1.0] * 7, bandwidth=2.0, rate_limit=[], position_low=[], position_high=[])[0], 20000, EFFECT
    )
    one = block.delta[:, 0]
    assert np.corrcoef(one[1:], one[:-1])[0, 1] == pytest.approx(math.exp(-2.0 * math.pi * 2.0 * 0.02), abs=0.03)
