"""Names held against the rows that did not alarm: a surface that is lost is lost in all of them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from estimation.test_bank import PERIOD, SMALL, uniform
from estimation.test_bank_losses import Flight, engine_of, events_of

from msls_ros.estimation import EventKind, Identifier, from_mapping
from msls_ros.estimation.bank.unalarmed import LEAST_SINCE, QUICK, is_denied, keep_alarm, loss_information

FAULT = 250
NOISE = 0.02


def struck(seed: int, left: tuple[float, float], quiet: float = NOISE, n: int = 450) -> Flight:
    """Return a flight in which an effector keeps these shares of its effects on P and on R; noise of R's equation.

    Without noise R holds more of it: nearly nothing else moves R, and model error goes with all that does.
    """
    x, delta = 0.25 * uniform(n, 3, seed), 0.125 * uniform(n, 2, seed + 1)
    xdot = uniform(n, 3, seed + 2) * np.array([NOISE, NOISE, quiet])
    share = np.ones((n, 2))
    share[FAULT:] = left
    xdot[:, 0] += -2.0 * x[:, 0] + 8.0 * share[:, 0] * delta[:, 0] + 8.0 * delta[:, 1]
    xdot[:, 1] += -1.0 * x[:, 1] - 4.0 * delta[:, 1]
    xdot[:, 2] += -0.1 * x[:, 2] + share[:, 1] * delta[:, 0]
    return PERIOD * np.arange(n, dtype=np.float64), x, xdot, delta


def names_in(flight: Flight) -> tuple[list[str], set[str]]:
    """Return what is named in a flight, and the equations that alarmed."""
    events = events_of(Identifier(from_mapping(SMALL)), flight)
    alarmed = {row for e in events if e.kind == EventKind.DETECTED for row in e.equations}
    return [e.suspected_effector for e in events if e.kind == EventKind.ISOLATED], alarmed


@pytest.mark.parametrize("seed", [300, 310, 320, 330])
def test_what_one_row_alone_has_lost_is_no_loss_of_the_surface(seed: int) -> None:
    assert names_in(struck(seed, (0.4, 1.0), quiet=0.001)) == ([], {"P"})


@pytest.mark.parametrize("seed", [300, 310, 320, 330])
@pytest.mark.parametrize("left", [0.4, 0.0])
def test_what_all_rows_have_lost_is_named(seed: int, left: float) -> None:
    assert names_in(struck(seed, (left, left)))[0] == ["da"]


@pytest.mark.parametrize("seed", [300, 310, 320, 330])
@pytest.mark.parametrize("quiet", [0.1, 0.5])
def test_a_row_that_holds_little_of_the_effect_denies_nothing(seed: int, quiet: float) -> None:
    assert names_in(struck(seed, (0.4, 1.0), quiet=quiet))[0] == ["da"]


def test_nothing_is_denied_before_the_other_rows_have_seen_enough_since() -> None:
    identifier = Identifier(from_mapping(SMALL))
    time, x, xdot, delta = struck(300, (1.0, 1.0), quiet=0.001)
    identifier.run(time[:240], x[:240], xdot[:240], delta[:240])
    engine = engine_of(identifier)
    s, state, work = engine.settings, engine.state, engine._work
    alarm = keep_alarm(s, state, work, None)
    memory = -1.0 / math.log(float(s.forgetting[s.loss_members[QUICK]]))
    denied = []
    for k in range(240, 300):
        identifier.run(time[k : k + 1], x[k : k + 1], xdot[k : k + 1], delta[k : k + 1])
        denied.append(is_denied(s, state, work, alarm, [0], 0, -0.9))
    silent = math.floor(-memory * math.log(1.0 - LEAST_SINCE)) - 1
    assert not any(denied[:silent])
    assert denied[-1]
    assert not is_denied(s, state, work, alarm, [0, 2], 0, -0.9), "no row is left that knows it"


def test_a_second_alarm_keeps_what_was_known_before_the_first() -> None:
    identifier = Identifier(from_mapping(SMALL))
    time, x, xdot, delta = struck(300, (1.0, 1.0))
    identifier.run(time[:240], x[:240], xdot[:240], delta[:240])
    engine = engine_of(identifier)
    s, state, work = engine.settings, engine.state, engine._work
    first = keep_alarm(s, state, work, None)
    identifier.run(time[240:280], x[240:280], xdot[240:280], delta[240:280])
    second = keep_alarm(s, state, work, first)
    assert (first.samples, second.samples) == (240, 280)
    assert second.before is first.before
    assert not np.array_equal(second.before, state.mixed)
    assert np.array_equal(second.information, loss_information(s, state, work))
