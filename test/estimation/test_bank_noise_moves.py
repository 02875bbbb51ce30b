"""Noise in the states draws the estimates of a short memory from the truth; that is no change, and hides no loss."""

from __future__ import annotations

import numpy as np
import pytest
from estimation.test_bank import SMALL

from msls_ros.estimation import Identifier, from_mapping
from msls_ros.estimation.bank.losses import find_directions
from msls_ros.estimation.bank.noise_moves import find_noise_moves, take_off_noise
from msls_ros.estimation.bank.regression import BankRegression
from msls_ros.flights.closed_loop import fly
from msls_ros.flights.scenarios import find_scenario

FAULT = 24.0
MEMBER = 0


def prepared(noise: float) -> BankRegression:
    """Return an engine that has seen some samples, its scratch as a comparison prepares it."""
    random = np.random.default_rng(1)
    identifier = Identifier(from_mapping(SMALL))
    x, delta = random.standard_normal((80, 3)), random.standard_normal((80, 2))
    identifier.run(0.02 * np.arange(80, dtype=np.float64), x, -x, delta)
    engine = identifier._regression
    assert isinstance(engine, BankRegression)
    engine._work.noise[:] = noise
    engine.state.noisy[:] = 0.0
    find_directions(engine.settings, engine.state.R[0], MEMBER, engine._work)
    find_noise_moves(engine.settings, engine.state, 0, MEMBER, engine._work)
    return engine


def test_it_goes_as_least_squares_with_noisy_regressors_does_and_leaves_surfaces_alone() -> None:
    engine = prepared(0.04)
    s, x, work = engine.settings, engine.state, engine._work
    factor = np.tril(work.columns).T[1:, 1:]
    before = np.arange(1.0, 19.0).reshape(3, 6)
    draw = np.zeros(5)
    draw[:3] = -0.04 * x.taken[0, MEMBER] * before[0, 1:4]
    work.w[1:] = np.linalg.solve(factor.T, draw)
    assert np.abs(work.w).max() > 0.9
    take_off_noise(s, x, before, 0, MEMBER, work)
    assert np.abs(work.w[1:]).max() < 0.3, "states one after the other, which are nearly independent here"
    for i in range(1, 4):
        assert work.noise_moves[i, 0] == pytest.approx(0.04 * x.taken[0, MEMBER])
        for step in work.steps:
            assert step[1:] @ work.noise_moves[i, 1:] == pytest.approx(0.0, abs=1e-9)


def test_no_more_is_taken_off_than_noise_makes_and_nothing_without_noise() -> None:
    engine = prepared(0.04)
    s, x, work = engine.settings, engine.state, engine._work
    before = np.ones((3, 6))
    for away in (1.0, -3.0):  # the other way than noise draws; three times as far
        move = work.noise_moves[2].copy()
        draw = away * move[0] * np.concatenate([[0.0], move[1:]])
        work.noise_moves[[1, 3], 0] = 0.0
        work.w[:] = draw
        assert take_off_noise(s, x, before, 0, MEMBER, work) == 0
        left = draw if away > 0.0 else draw * 2.0 / 3.0
        np.testing.assert_allclose(work.w[1:], left[1:], rtol=1e-12)
    quiet = prepared(0.0)
    assert (quiet._work.noise_moves[:, 0] == 0.0).all()


@pytest.mark.parametrize(("noise", "within"), [("low", 0.4), ("med", 1.0)])
def test_half_an_aileron_that_only_dither_shows_is_seen_soon(noise: str, within: float) -> None:
    """An A-4 in straight flight: .7 s at low noise without short memories, never at medium with noise."""
    scenario = find_scenario("A4_aileron_half")
    for seed in (101, 102):
        log = fly(scenario.configuration(noise, seed, dither=True), scenario.flight(noise, seed), sparse=True)
        alarms = [time for time in log.alarms() if time > FAULT]
        assert alarms and alarms[0] - FAULT <= within
