"""What follows a name: other surfaces' effects are taken back; and other rows alarm sooner where one has alarmed."""

from __future__ import annotations

import numpy as np
import pytest
from estimation.test_bank import PERIOD, SMALL, uniform
from estimation.test_bank_losses import Flight, engine_of

from msls_ros.estimation import EventKind, Identifier, from_mapping
from msls_ros.estimation.bank.attenuation import prior_share
from msls_ros.estimation.bank.lags import lag_square
from msls_ros.estimation.bank.losses import TOLERANCE
from msls_ros.estimation.bank.regression import BankRegression
from msls_ros.estimation.bank.residual import kept_variance, residual_variance
from msls_ros.estimation.bank.restoring import information_before
from msls_ros.estimation.bank.uncertainty import leading_member

FAULT = 250


def broken(left: float, on_r: float = 0.0, n: int = 300, seed: int = 3, noise: float = 0.01) -> Flight:
    """Return a flight in which da keeps a share of its effect on P, and R jumps by so much."""
    x, delta = 0.25 * uniform(n, 3, 1), 0.125 * uniform(n, 2, 2)
    xdot = noise * uniform(n, 3, seed)
    share = np.where(np.arange(n) < FAULT, 1.0, left)
    xdot[:, 0] += -2.0 * x[:, 0] + 8.0 * share * delta[:, 0] + 3.0 * delta[:, 1]
    xdot[:, 1] += -1.0 * x[:, 1] - 4.0 * delta[:, 1]
    xdot[:, 2] += -0.5 * x[:, 2]
    xdot[FAULT:, 2] += on_r
    return PERIOD * np.arange(n, dtype=np.float64), x, xdot, delta


def broken_off(samples: int) -> tuple[Identifier, BankRegression]:
    """Return an identifier so many samples after da was lost."""
    identifier = Identifier(from_mapping(SMALL))
    identifier.run(*broken(0.0, n=FAULT + samples))
    return identifier, engine_of(identifier)


def test_restoring_adds_the_information_of_before_but_for_the_direction_of_the_named_surface() -> None:
    _, engine = broken_off(6)
    s, x = engine.settings, engine.state
    (row,) = np.flatnonzero(x.pending)
    g, first = x.group[row], s.effectors_from + 1
    noise, before = x.base[row, 0] / x.base[row, 1], x.theta_before[row].copy()
    known = np.zeros(len(before))
    late = np.array([lag_square(x, int(row), i) for i in range(len(before))])
    known[first:] = noise / (x.square_before[row] + late + (TOLERANCE * before) ** 2)[first:]
    a = np.zeros(len(before))
    a[first:] = s.gains[0]
    added = np.diag(known) - np.outer(known * a, a * known) / (a @ (known * a))
    R, members = x.R[g].copy(), x.members[row].copy()
    engine.restore([int(row)], 0)
    for m in range(R.shape[2]):
        information = R[:, :, m].T @ R[:, :, m]
        np.testing.assert_allclose(x.R[g, :, :, m].T @ x.R[g, :, :, m], information + added, rtol=1e-9, atol=1e-12)
        expected = np.linalg.solve(information + added, information @ members[:, m] + added @ before)
        np.testing.assert_allclose(x.members[row, :, m], expected, rtol=1e-6, atol=1e-6)
    assert added[first:, first:] @ s.gains[0] == pytest.approx(0.0, abs=1e-15)
    once = x.R[g].copy()
    engine.restore([int(row)], 0)
    assert np.array_equal(x.R[g], once), "the same knowledge is taken back once"


def test_a_name_takes_the_other_effects_back() -> None:
    errors = {False: 0.0, True: 0.0}
    for restored in errors:
        for seed in range(3, 15):
            identifier = Identifier(from_mapping(SMALL))
            if not restored:
                engine_of(identifier).restore = lambda rows, surface: None  # type: ignore[method-assign]
            estimates = identifier.run(*broken(0.0, seed=seed, noise=0.05)).estimates
            named = next(i for i, e in enumerate(estimates) if any(v.kind == EventKind.ISOLATED for v in e.events))
            errors[restored] += abs(estimates[named + 1].b[0, 1] - 3.0)
    assert errors[True] < 0.5 * errors[False]


def test_what_a_name_takes_back_counts_as_learnt_from_motion_and_a_prior_of_a_state_does_not() -> None:
    engine = engine_of(identifier := Identifier(from_mapping(SMALL)))
    identifier.run(*broken(1.0, seed=3))
    s, x = engine.settings, engine.state
    g, m = int(x.group[0]), leading_member(x, 0, engine._work.e)
    state, effector = 1, s.effectors_from + 1
    alone = [prior_share(s, x, g, i, m) for i in (state, effector)]
    for i in (state, effector):
        x.kept_info[g, i] = 0.9 * x.info[g, i, m]
    kept = [prior_share(s, x, g, i, m) for i in (state, effector)]
    assert kept == pytest.approx([alone[0] + 0.9, alone[1]])


@pytest.mark.parametrize(("interval", "expected"), [(0, 3e-4), (5, 1e-7)])
def test_through_a_window_what_is_taken_back_is_known_no_better_than_it_was(interval: int, expected: float) -> None:
    """Members follow what a window has smoothed, and their errors, by which bars go, are a thousandth of all."""
    engine = engine_of(Identifier(from_mapping(SMALL), interval))
    s, x = engine.settings, engine.state
    x.base[0], x.residual[0, :2], x.pending[0] = (3e-2, 100.0, 0.0), (1e-5, 100.0), 1
    i, error = s.effectors_from + 1, 0.3
    x.theta_before[0, i], x.square_before[0, i] = 0.4, error**2
    assert (s.straddle > 0) == (interval > 0)
    assert kept_variance(s, x, 0) == pytest.approx(expected)
    x.group[1:] = 1
    information = information_before(s, x, 0, i)
    bar = np.sqrt(residual_variance(x, 0) / information)
    assert information == pytest.approx(expected / (error**2 + (TOLERANCE * 0.4) ** 2))
    assert interval == 0 or bar >= error


def test_a_name_holds_for_the_rows_that_did_not_alarm() -> None:
    """Noise hides the loss in R, where the surface has an effect as well; P has alarmed, and the surface has a name."""
    errors = {False: 0.0, True: 0.0}
    covered = 0
    for seed in range(3, 13):
        time, x, xdot, delta = broken(0.5, seed=seed, n=320)
        xdot[:, 2] += 0.4 * uniform(len(time), 3, seed + 50)[:, 2]
        xdot[:, 2] += np.where(np.arange(len(time)) < FAULT, 4.0, 2.0) * delta[:, 0]
        for applied in errors:
            identifier = Identifier(from_mapping(SMALL))
            if not applied:
                engine_of(identifier).spread = lambda *_: None  # type: ignore[method-assign]
            estimates = identifier.run(time, x, xdot, delta).estimates
            events = [(i, v) for i, e in enumerate(estimates) for v in e.events]
            assert all("R" not in v.equations for _, v in events), "noise hides it"
            named = next(i for i, v in events if v.kind == EventKind.ISOLATED)
            after = estimates[named + 1]
            assert after.b[0, 0] == pytest.approx(4.0, abs=0.5) and abs(estimates[named + 1].b[1, 1] + 4.0) < 0.1
            errors[applied] += abs(after.b[2, 0] - 2.0)
            covered += applied and abs(after.b[2, 0] - 2.0) < 2.0 * after.b_std[2, 0]
    assert errors[True] < 0.5 * errors[False]
    assert covered >= 9


@pytest.mark.parametrize("beside", [False, True])
def test_a_change_too_small_to_be_alarmed_alone_is_where_another_row_alarms(beside: bool) -> None:
    flight = broken(0.0 if beside else 1.0, on_r=0.035)
    identifier = Identifier(from_mapping(SMALL))
    alarms = [v for e in identifier.run(*flight).estimates for v in e.events if v.kind == EventKind.DETECTED]
    at_once = [name for event in alarms if event.time < PERIOD * (FAULT + 2) for name in event.equations]
    assert ("R" in at_once) == beside
