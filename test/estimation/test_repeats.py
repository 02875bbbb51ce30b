"""Numbers that repeat because nothing has measured them since: rows between measurements are passed over."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.linear_beds import configure, draw, fly
from msls_ros.estimation import EventKind, Identifier, from_mapping
from msls_ros.estimation.kernel import Array
from msls_ros.estimation.repeats import ALIVE, BELIEVED, STUCK, RepeatFilter, repeat_settings
from msls_ros.estimation.screening import HELD, LASTS, LEARNT, SLOW_ROWS, Screen

RATE = 50.0
CONFIGURATION = {"states": ("v", "P"), "effectors": ("da",), "known_gravity": False, "estimator.method": "bank"}
Flight = tuple[Array, Array, Array, Array]


def measured(columns: Array, sensed: bool = False) -> NDArray[np.bool_]:
    """Return (k,) which rows (k, c) are said to be measured."""
    judge = RepeatFilter(repeat_settings([sensed] * columns.shape[1], RATE, 1.0))
    return np.array([judge.measured(row) for row in columns])


def held(count: int, every: int, seed: int = 1, first: int = 0) -> Array:
    """Return noise (count,) that is measured in every so manieth row from a first one on."""
    noise = np.random.default_rng(seed).normal(size=count)
    rows = np.maximum((np.arange(count) - first) // every * every + first, 0)
    return noise[rows]


def moving(count: int, seed: int = 2) -> Array:
    """Return noise (count,) that is measured in every row."""
    return np.random.default_rng(seed).normal(size=count)


@pytest.mark.parametrize("every", [2, 3, 5])
def test_rows_in_which_a_number_is_held_are_passed_over(every: int) -> None:
    said = measured(np.stack([moving(200), held(200, every)], axis=1))
    known = BELIEVED * every + 1
    assert said[:known].all()
    assert np.array_equal(said[known:], np.arange(known, 200) % every == 0)


def test_the_slowest_of_several_sets_the_pace_and_the_first_of_equals() -> None:
    said = measured(np.stack([held(400, 2), held(400, 5, 3, 1), held(400, 5, 4, 3)], axis=1))
    assert np.array_equal(np.flatnonzero(said[100:]) + 100, np.arange(101, 400, 5))


def test_uneven_runs_of_rows_are_measured_where_the_number_changes() -> None:
    rows = np.cumsum(np.random.default_rng(4).integers(2, 5, 200))
    values = np.random.default_rng(5).normal(size=200)
    column = values[np.maximum(np.searchsorted(rows, np.arange(rows[-1]), side="right") - 1, 0)]
    said = measured(column[:, None])
    changes = np.concatenate([[True], np.diff(column) != 0.0])
    assert np.array_equal(said[100:], changes[100:])


def test_what_rests_keeps_the_pace_until_it_moves_again() -> None:
    column = held(300, 4)
    column[120:200] = column[120]
    said = measured(column[:, None])
    expected = [k for k in range(100, 300, 4) if k != 124]  # which was too soon to say that it rests
    assert np.flatnonzero(said[100:]).tolist() == [k - 100 for k in expected]


@pytest.mark.parametrize("case", ["steps", "coarse and slow", "smooth", "noise", "twice a second"])
def test_what_is_measured_in_every_row_is_passed_over_in_none(case: str) -> None:
    t = np.arange(2000) / RATE
    columns = {
        "steps": np.sign(np.sin(3.0 * t)) * (1.0 + np.floor(t)),
        "coarse and slow": np.round(np.sin(0.6 * t) / 0.02) * 0.02,
        "smooth": np.sin(0.6 * t),
        "noise": moving(2000),
        "twice a second": held(2000, 25),
    }
    assert measured(columns[case][:, None]).all()


def test_a_record_that_is_coarse_in_fast_and_slow_motion_is_not_held() -> None:
    """At two thirds of a step a row it changes in two rows of three, further where it is faster."""
    t = np.arange(4000) / RATE
    motion = np.sin(0.8 * t) + 0.3 * np.sin(2.9 * t)
    for step in (0.002, 0.01, 0.03, 0.1):
        assert measured((np.round(motion / step) * step)[:, None]).all()


def test_a_sensor_that_stops_is_not_believed_until_it_goes_on() -> None:
    column = moving(600)
    column[300:400] = column[300]
    said = measured(np.stack([column, moving(600, 7)], axis=1), sensed=True)
    assert ALIVE < 300
    assert np.array_equal(np.flatnonzero(~said), np.arange(300 + STUCK, 400))
    assert measured(column[:, None]).all()  # a deflection may stop for good


def test_what_is_rounded_may_repeat_by_chance() -> None:
    column = np.round(moving(20_000) / 0.1) * 0.1
    assert np.sum(np.diff(column) == 0.0) > 300
    assert measured(column[:, None], sensed=True).all()


def test_what_comes_to_rest_has_not_stopped() -> None:
    column = np.exp(-0.2 * np.arange(600.0))
    column[column < 1e-8] = 0.0
    assert measured(column[:, None], sensed=True).all()


def flight_of(seed: int) -> tuple[Flight, Identifier, Array, int]:
    """Return a flight without loss whose deflections are measured, who identifies it, its B and its rate."""
    random = np.random.default_rng(seed)
    one = replace(draw(random), lost=-1, commands=False)
    return fly(one, random), Identifier(configure(one)), one.b, one.rate


def thinned(flight: Flight, kept: Any) -> Flight:
    time, x, slopes, moved = flight
    return time[kept], x[kept], slopes[kept], moved[kept]


def hold_deflections(flight: Flight, every: int) -> Flight:
    time, x, slopes, moved = flight
    return time, x, slopes, moved[np.arange(len(time)) // every * every]


@pytest.mark.parametrize("seed", [4423, 4424, 4428, 4431, 4434])
def test_deflections_that_are_held_are_no_losses_and_b_is_right(seed: int) -> None:
    """Learnt from in every row there were 2, 2, 1, 3 and 4 alarms."""
    flight, identifier, b, rate = flight_of(seed)
    run = identifier.run(*hold_deflections(flight, 3))
    assert not [e for estimate in run.estimates for e in estimate.events if e.kind == EventKind.DETECTED]
    assert identifier.learning_rate == pytest.approx(rate / 3)
    assert identifier.repeating in ("da", "dr", "de")
    assert 0.6 * len(flight[0]) < identifier.repeated < 0.7 * len(flight[0])
    last = run.estimates[-1]
    inside = np.abs(last.b - b) <= 1.96 * last.b_std
    assert last.b_reliable.sum() > 0
    assert inside[last.b_reliable].all()


@pytest.mark.parametrize("every", [2, 5])
def test_states_that_are_held_bias_nothing_and_no_row_is_passed_over(every: int) -> None:
    flight, identifier, b, rate = flight_of(4428)
    time, x, slopes, moved = flight
    run = identifier.run(time, x[np.arange(len(time)) // every * every], slopes, moved)
    last = run.estimates[-1]
    assert (identifier.learning_rate, identifier.repeated, identifier.held) == (rate, 0, ("v", "P", "R"))
    assert last.b_reliable.sum() > 0
    assert (np.abs(last.b - b) <= 1.96 * last.b_std)[last.b_reliable].all()


def test_one_by_one_it_is_the_same_to_the_bit_through_a_change_of_pace() -> None:
    flight, whole, _, rate = flight_of(4428)
    time, x, slopes, moved = (array[: 30 * rate] for array in hold_deflections(flight, 3))
    moved[: 10 * rate] = flight[3][: 10 * rate]  # measured in every row at first, and again at last
    moved[20 * rate :] = flight[3][20 * rate : 30 * rate]
    run = whole.run(time, x, slopes, moved)
    _, single, _, _ = flight_of(4428)
    for k, (one, sample) in enumerate(zip(run.estimates, zip(time, x, slopes, moved, strict=True), strict=True)):
        other = single.update(*sample)
        assert np.array_equal(one.a, other.a)
        assert np.array_equal(one.b_std, other.b_std), k
        assert one.samples == other.samples == k + 1
        assert np.array_equal(one.dither.delta, other.dither.delta)
    assert whole.learning_rate == single.learning_rate == rate


def test_at_another_pace_it_begins_from_the_warm_start_and_reset_forgets_pace_and_all() -> None:
    flight, identifier, b, rate = flight_of(4428)
    time, x, slopes, moved = (array[: 3 * rate] for array in hold_deflections(flight, 3))
    moved += 1e-5 * np.random.default_rng(1).normal(size=moved.shape)[np.arange(len(time)) // 3 * 3]
    n, m = x.shape[1], moved.shape[1]
    identifier.warm_start(-np.eye(n), b, np.zeros(n), 1e-12 * np.eye(n + m + 1))
    shown = (BELIEVED + 2 + SLOW_ROWS) * 3
    run = identifier.run(time[:shown], x[:shown], slopes[:shown], moved[:shown])
    assert identifier.learning_rate == pytest.approx(rate / 3)
    np.testing.assert_allclose(run.estimates[-1].b, b, rtol=1e-3, atol=1e-9)
    identifier.reset()
    assert (identifier.learning_rate, identifier.repeated, identifier.repeating) == (rate, 0, "")
    assert abs(identifier.run(time[:1], x[:1], slopes[:1], moved[:1]).estimates[-1].b).max() < 1e-3


def test_samples_that_come_more_slowly_than_was_said_are_learnt_from_at_their_rate() -> None:
    flight, identifier, b, rate = flight_of(4428)
    run = identifier.run(*thinned(flight, slice(None, None, 2)))
    assert identifier.learning_rate == pytest.approx(rate / 2)
    assert identifier.repeated == 0
    last = run.estimates[-1]
    assert (np.abs(last.b - b) <= 1.96 * last.b_std)[last.b_reliable].all()


def test_a_link_that_loses_a_fifth_of_the_samples_does_not_change_the_pace() -> None:
    flight, identifier, _, rate = flight_of(4428)
    kept = np.random.default_rng(3).uniform(size=len(flight[0])) > 0.2
    identifier.run(*thinned(flight, kept))
    assert identifier.learning_rate == rate


@pytest.mark.parametrize("lost", ["for seconds", "for good"])
def test_what_was_learnt_is_not_forgotten_for_a_link_that_fails_for_seconds_and_never_without_an_event(
    lost: str,
) -> None:
    flight, identifier, _, rate = flight_of(4428)
    time = flight[0]
    fails = (time > 40.0) & ((time % 15.0 < 2.5) if lost == "for seconds" else True)
    kept = np.where(fails, np.random.default_rng(3).uniform(size=len(time)) > 0.7, True)
    run = identifier.run(*thinned(flight, kept))
    resets = [e for estimate in run.estimates for e in estimate.events if e.kind == EventKind.RESET]
    if lost == "for seconds":
        assert identifier.learning_rate == rate
        assert not resets
    else:
        assert identifier.learning_rate < 0.6 * rate
        assert resets and 40.0 + LASTS < resets[0].time < 40.0 + 2.0 * LASTS
        assert "another rate" in resets[0].description


def test_a_state_that_is_held_goes_by_hermites_cubic_between_its_measurements() -> None:
    t = np.arange(400) / RATE
    x, slopes = (
        np.stack([np.sin(3.0 * t), moving(400)], axis=1),
        np.stack([3.0 * np.cos(3.0 * t), moving(400, 3)], axis=1),
    )
    held = x.copy()
    held[:, 0] = x[np.arange(400) // 5 * 5, 0]
    screen = Screen(from_mapping({**CONFIGURATION, "sample_rate": RATE}))
    first = screen.judge(t[:200], held[:200], slopes[:200], moving(200, 8)[:, None])
    assert first.learnt is not None and first.learnt[100:].tolist() == [5, 0, 0, 0, 0] * 20
    cubic = screen.judge(t[200:], held[200:], slopes[200:], moving(200, 9)[:, None])
    assert np.array_equal(cubic.time, t[196:396])
    np.testing.assert_allclose(cubic.x[:, 0], x[196:396, 0], atol=2.2e-5)  # (w T)^4 / 384
    assert np.array_equal(cubic.x[:, 1], x[196:396, 1])
    assert cubic.verdict.tolist() == [LEARNT, HELD, HELD, HELD, HELD] * 40


def test_rows_that_wait_for_a_measurement_are_dropped_where_a_gap_comes_instead() -> None:
    t = np.arange(400) / RATE
    x, moved = np.stack([held(400, 5), moving(400)], axis=1), moving(400, 8)[:, None]
    t[202:] += 1.0
    screen = Screen(from_mapping({**CONFIGURATION, "sample_rate": RATE}))
    screened = screen.judge(t, x, np.stack([moving(400, 4), moving(400, 5)], axis=1), moved)
    assert screened.time.tolist() == [*t[:201], *t[202:396]]
    assert screen.repeated == 1


def test_a_state_that_stands_still_is_believed_as_far_as_its_derivative_is_small() -> None:
    """A noise-free aircraft may come to rest at once; a gyro that is stuck while it turns has not."""
    for moves in (False, True):
        x, slopes = np.stack([moving(400), moving(400, 3)], axis=1), np.zeros((400, 2))
        x[300:350, 1] = x[300, 1]
        slopes[300:350, 1] = 20.0 * moves
        screen = Screen(from_mapping({**CONFIGURATION, "sample_rate": RATE}))
        screened = screen.judge(np.arange(400) / RATE, x, slopes, moving(400, 9)[:, None])
        assert (30 < screen.repeated < 49) if moves else screen.repeated == 0
        assert len(screened.time) == 400 - screen.repeated
        assert screen.repeating == ("P" if moves else "")


def test_what_is_not_of_flight_is_no_slower_pace() -> None:
    states = ("u", "P", "Phi", "Theta")
    settings = {"states": states, "effectors": ("da",), "reference_speed": 50.0, "estimator.method": "bank"}
    screen = Screen(from_mapping({**settings, "sample_rate": RATE}))
    x = np.stack([np.where(np.arange(400) % 3 == 0, 50.0, 1.0), *[moving(400)] * 3], axis=1)
    screened = screen.judge(np.arange(400) / RATE, x, np.stack([moving(400, 3)] * 4, axis=1), moving(400, 9)[:, None])
    assert screen.period == 1.0 / RATE
    assert len(screened.time) < 140


def test_what_rows_that_waited_say_is_said_of_the_sample_that_is_answered() -> None:
    """Two states are measured in turns, so that each row waits for the next; an effector is lost."""
    random = np.random.default_rng(4428)
    one = draw(random)
    time, x, slopes, moved = (array[50 * one.rate :] for array in fly(one, random))
    rows = np.arange(len(time))
    x[:, 0], x[:, 1] = x[rows // 2 * 2, 0], x[(rows + 1) // 2 * 2 - 1, 1]
    found = []
    for every in (1, 1000):
        run = Identifier(configure(one)).run(time, x, slopes, moved, every=every)
        found.append([(e.time, e.kind, e.description) for estimate in run.estimates for e in estimate.events])
    single = Identifier(configure(one))
    events = []
    for sample in zip(time, x, slopes, moved, strict=True):
        said = single.update(*sample).events
        assert all(e.time == sample[0] for e in said)
        events += [(e.time, e.kind, e.description) for e in said]
    assert one.lost >= 0 and single.held == ("v", "P")
    assert found[0] == found[1] == events != []
