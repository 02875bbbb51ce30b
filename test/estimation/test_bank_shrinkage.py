"""What was known of effects that move along one line now is not given up for what the line seems to say of them."""

from __future__ import annotations

import numpy as np
from estimation.test_bank import PERIOD, SMALL, uniform
from estimation.test_bank_losses import Flight, engine_of

from msls_ros.estimation import Estimate, Identifier, from_mapping
from msls_ros.estimation.bank.regression import BankRegression

DAMPING, COUPLING, EFFECT = -3.0, 0.5, 8.0
"""Of P by P, by R and by da."""
BENT = 0.02
"""By how much R leaves the line along which it moves with P."""
BEGIN = 600
"""Of that motion, in samples."""
READ = 3e-3
"""Noise of the gyroscopes [rad/s]."""


def along_a_line(n: int = 1600, left: float = 1.0, nonlinear: float = 1.0, damping: float = DAMPING) -> Flight:
    """Return a flight in which all moves by itself, and then R as twice P, nearly.

    What is not linear goes with what R leaves that line by. ``left`` is what is left of da's effect from then on; where
    it is not 1 all goes on moving by itself. From then on the effect of P by P is ``damping``. Deflections are what the
    motion takes.
    """
    time = PERIOD * np.arange(n, dtype=np.float64)
    x, rates = np.zeros((n, 3)), np.zeros((n, 3))
    for j, tones in enumerate(((1.3, 4.1, 9.7), (1.7, 5.3, 8.3), (2.3, 4.7, 7.1))):
        for tone in tones:
            x[:, j] += 0.1 * np.sin(tone * time + j)
            rates[:, j] += 0.1 * tone * np.cos(tone * time + j)
    bent = x[:, 0] * np.abs(x[:, 0])
    line = (np.arange(n) >= BEGIN) & (left == 1.0)
    x[:, 2] = np.where(line, 2.0 * x[:, 0] + BENT * bent, x[:, 2])
    rates[:, 2] = np.where(line, 2.0 * rates[:, 0] * (1.0 + BENT * np.abs(x[:, 0])), rates[:, 2])
    effect = EFFECT * np.where(np.arange(n) < BEGIN, 1.0, left)
    damped = np.where(np.arange(n) < BEGIN, DAMPING, damping)
    da = (rates[:, 0] - damped * x[:, 0] - COUPLING * x[:, 2] - nonlinear * line * bent) / effect
    delta = np.column_stack([da, -0.25 * (rates[:, 1] + x[:, 1])])
    return time, x + READ * uniform(n, 3, 1), rates + 1e-3 * uniform(n, 3, 3), delta


def identified(flight: Flight) -> tuple[BankRegression, Estimate]:
    identifier = Identifier(from_mapping({**SMALL, "detector.mode": "off"}))
    return engine_of(identifier), identifier.run(*flight).estimates[-1]


def test_a_line_does_not_move_what_was_known_of_the_effects_along_it() -> None:
    engine, last = identified(along_a_line())
    mixed = engine.theta[0]
    assert abs(mixed[0] - DAMPING) > 1.0, "least squares gives the damping up"
    assert engine.state.drawn[0] == 1
    for value, error, truth in zip(last.a[0, [0, 2]], last.a_std[0, [0, 2]], (DAMPING, COUPLING), strict=True):
        assert abs(value - truth) < min(1.96 * error, 0.2)


def test_the_prediction_for_the_last_sample_stays_the_same() -> None:
    flight = along_a_line()
    engine, last = identified(flight)
    _, x, _, delta = flight
    predicted = last.a[0] @ x[-1] + last.b[0] @ delta[-1] + last.bias[0]
    regressor = np.concatenate([x[-1], delta[-1], [1.0]])
    assert engine.state.drawn[0] == 1
    np.testing.assert_allclose(predicted, engine.theta[0] @ regressor, rtol=1e-9)


def test_what_was_known_is_not_held_against_a_change() -> None:
    _, last = identified(along_a_line(left=0.5))
    assert abs(last.b[0, 0] / (0.5 * EFFECT) - 1.0) < 0.05


def test_nothing_is_drawn_back_while_all_is_as_well_known_as_it_was() -> None:
    flight = along_a_line()
    engine, last = identified((flight[0][:BEGIN], flight[1][:BEGIN], flight[2][:BEGIN], flight[3][:BEGIN]))
    assert (np.abs(last.a - engine.theta[:, :3]) <= 0.1 * last.a_std)[:2].all(), "no model is behind the third row"


def test_where_an_effect_may_have_changed_the_bar_says_so_though_it_is_drawn_back() -> None:
    engine, last = identified(along_a_line(damping=0.5))
    assert engine.state.drawn[0] == 1
    for value, error, truth in zip(last.a[0, [0, 2]], last.a_std[0, [0, 2]], (0.5, COUPLING), strict=True):
        assert abs(value - truth) < 1.96 * error
