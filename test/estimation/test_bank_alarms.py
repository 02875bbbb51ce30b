"""What an alarm leaves: rows that join it later begin from before it, and what may be lost is suspected in all rows."""

from __future__ import annotations

import numpy as np
import pytest
from estimation.test_bank_responses import fly

from msls_ros.estimation import EventKind, Identifier, from_mapping
from msls_ros.estimation.bank.regression import BankRegression
from msls_ros.estimation.bank.rows import split_bank
from msls_ros.estimation.bank.suspects import find_suspects, suspect_square


@pytest.fixture(scope="module")
def engine() -> BankRegression:
    return fly(0.0, 0.0, measured=True, seconds=10.0)[0]


def alarm_of(*rows: int) -> np.ndarray:
    alarm = np.zeros(3, np.int64)
    alarm[list(rows)] = 1
    return alarm


def test_a_row_that_joins_an_alarm_begins_from_what_it_was_before_it(engine: BankRegression) -> None:
    """It took the samples of the loss as any others, and where little was known all of the loss went there."""
    s, x = engine.settings, engine.state
    x.alert[0] = x.ring.shape[1]
    split_bank(s, x, alarm_of(0))
    before = x.kept_theta[(x.kept[0] - 1) % len(x.kept_theta), 1].copy()
    x.mixed[1] += 5.0
    x.alert[0] -= 1
    split_bank(s, x, alarm_of(1))
    np.testing.assert_array_equal(x.mixed[1], before)
    np.testing.assert_array_equal(x.theta_before[1], before)
    np.testing.assert_array_equal(x.members[1], np.repeat(before[:, None], x.members.shape[2], axis=1))


def test_a_first_alarm_begins_from_the_estimates_of_then(engine: BankRegression) -> None:
    s, x = engine.settings, engine.state
    x.pending[:] = 0
    x.mixed[2] += 1.0
    now = x.mixed[2].copy()
    x.alert[0] = x.ring.shape[1]
    split_bank(s, x, alarm_of(2))
    np.testing.assert_array_equal(x.mixed[2], now)


def suspects(engine: BankRegression, deflection: float, mean: float, gains: list[list[float]]) -> list[int]:
    """Return which effectors are suspected where the first is deflected so far, and the error is half its effect."""
    s, x = engine.settings, engine.state
    x.pending[:] = 0
    x.suspected[:] = 0
    first = s.effectors_from + 1
    x.mixed[0] = 0.0
    x.mixed[0, first] = 2.0
    phi = np.zeros(x.mixed.shape[1])
    phi[first] = deflection
    x.phi_mean[:] = 0.0
    x.phi_mean[first] = mean
    error = np.array([0.6 * 2.0 * 0.05, 0.0, 0.0])
    find_suspects(s._replace(gains=np.array(gains)), x, phi, error, alarm_of(0))
    return [int(one) for one in x.suspected]


APART = [[1.0, 0.0], [0.0, 1.0]]


def test_a_loss_at_trim_is_suspected_for_its_moment_is_lost_as_well(engine: BankRegression) -> None:
    assert suspects(engine, 0.05, 0.05, APART) == [1, 0]
    assert suspects(engine, 0.0, -0.05, APART) == [1, 0], "as far as it moves"
    assert suspects(engine, 0.01, 0.0, APART) == [0, 0], "its loss makes less"


def test_all_effectors_of_a_surface_are_suspected_together(engine: BankRegression) -> None:
    assert suspects(engine, 0.05, 0.05, [[1.0, 1.0]]) == [1, 1]


def test_a_suspect_may_have_lost_half_of_its_effect_on_rows_that_did_not_alarm(engine: BankRegression) -> None:
    s, x = engine.settings, engine.state
    suspects(engine, 0.05, 0.05, APART)
    first = s.effectors_from + 1
    x.pending[0] = 1
    x.theta_before[0, first], x.square_before[0, first], x.square[0, first] = 2.0, 1e-4, np.inf
    x.mixed[1, first] = 0.4
    assert suspect_square(s, x, 1, first) == pytest.approx((0.5 * 0.4) ** 2)
    assert suspect_square(s, x, 0, first) == 0.0, "it begins anew"
    assert suspect_square(s, x, 1, first + 1) == 0.0


@pytest.mark.parametrize("over", [0, 100])
def test_no_row_has_recovered_when_it_alarms_nor_sooner_than_after_four_samples_per_regressor(over: int) -> None:
    """A loss at once, of which rows begin anew, and one over 2 s, which the estimate takes in as it stands."""
    random = np.random.default_rng(0)
    count, period = 700, 0.02
    delta = random.normal(0.0, 0.1, (count, 2))
    x = random.normal(0.0, 0.1, (count, 5)) + np.array([100.0, 1.0, 0.0, 0.0, 0.1])
    b = np.array([[1.0, 0.2], [-5.0, 0.5], [-3.0, 1.0], [0.0, 0.0], [0.0, 0.0]])
    left = np.interp(np.arange(count), [300, 301 + over], [1.0, 0.0])
    moved = delta * np.column_stack([left, np.ones(count)])
    xdot = -0.5 * x + moved @ b.T + random.normal(0.0, 0.03, (count, 5))
    c = from_mapping({"states": ("u", "w", "Q", "Phi", "Theta"), "effectors": ("de", "dr")})
    run = Identifier(c).run(period * np.arange(count, dtype=np.float64), x, xdot, delta)
    alarmed: dict[str, float] = {}
    recovered = 0
    for event in (e for one in run.estimates for e in one.events):
        for row in event.equations:
            if event.kind == EventKind.DETECTED:
                alarmed[row] = event.time
            elif event.kind == EventKind.RECOVERED:
                waited = (event.time - alarmed.pop(row)) / period
                assert waited >= 4 * len(c.regressors) - 1.01
                recovered += 1
    assert recovered >= 2
