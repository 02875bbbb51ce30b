"""Made-up linear aircraft: what they fly is their seed's, and what is said of them is counted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.linear_beds import (
    COARSE,
    PATHS,
    PHASES,
    RECORDS,
    REST,
    configure,
    differentiate,
    draw,
    fly,
    judge,
    keep,
    render,
)
from msls_ros.commands.benchmark import parser
from msls_ros.estimation import EventKind, Identifier
from msls_ros.inputs.derivatives import usual_intervals


def test_a_seed_is_an_aircraft_and_its_flight() -> None:
    first, again, other = (np.random.default_rng(seed) for seed in (5, 5, 6))
    one = draw(first)
    assert one.states == draw(again).states
    assert all(np.array_equal(a, b) for a, b in zip(fly(one, first), fly(one, again), strict=True))
    assert not np.array_equal(draw(other).b, one.b)


def test_derivatives_are_those_of_the_states_and_a_loss_is_one() -> None:
    random = np.random.default_rng(7)
    drawn = draw(random)
    one = replace(drawn, noise=0.0, gusts=0.0, servo=0.0, delay=0.0, commands=False, lost=0, left=0.5, time=50.0)
    t, x, slopes, moved = fly(one, random)
    for span, part in ((t < 50.0, 1.0), (t >= 50.0, 0.5)):
        b = one.b.copy()
        b[:, 0] *= part
        np.testing.assert_allclose(slopes[span], x[span] @ one.a.T + moved[span] @ b.T, atol=1e-9)
    change = 0.5 * (slopes[1:] + slopes[:-1]) / one.rate
    assert np.corrcoef(np.diff(x[:, 1]), change[:, 1])[0, 1] > 0.9


@pytest.mark.parametrize("path", PATHS)
def test_what_is_said_is_counted(path: str) -> None:
    row = judge((1002, path, RECORDS[0]))
    assert {f"{matrix} {phase}" for matrix in "AB" for phase in PHASES} == set(row["phases"])
    assert all(total >= reliable >= covered for total, reliable, covered in row["phases"].values())
    assert render([row]).startswith(f"1 linear aircraft, {path};")


@pytest.mark.parametrize(
    ("seed", "record"),
    [(4141, "coarse"), (4205, "coarse"), (4229, "coarse"), (4285, "coarse"), (4147, "late"), (4153, "late")],
)
def test_rounded_or_late_records_of_deflections_are_no_losses(seed: int, record: str) -> None:
    """Before: an effector that rests by a step of its record, or an edge that comes a sample late, was named lost."""
    random = np.random.default_rng(seed)
    one = replace(draw(random), lost=-1)
    flight = keep(record, one, fly(one, random))
    events = [e for estimate in Identifier(configure(one), 0).run(*flight).estimates for e in estimate.events]
    assert not [e for e in events if e.kind == EventKind.ISOLATED]
    assert len([e for e in events if e.kind == EventKind.DETECTED]) <= (1 if record == "late" else 0)


def test_a_step_between_two_samples_is_no_change() -> None:
    """Commands act 20 ms later, half of a sample at 25 Hz: six alarms and two names before."""
    random = np.random.default_rng(4435)
    one = draw(random)
    time, x, slopes, moved = (array[::2] for array in fly(one, random))
    estimates = Identifier(configure(replace(one, rate=one.rate // 2))).run(time, x, slopes, moved).estimates
    assert one.commands and one.lost < 0
    assert not [e for estimate in estimates for e in estimate.events if e.kind == EventKind.DETECTED]


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("seed", [4424, 4428])
def test_deflections_that_are_held_are_no_losses(seed: int, path: str) -> None:
    row = judge((seed, path, "held"))
    assert (row["false"], row["wrong"]) == (0, 0)


@pytest.mark.parametrize("seed", [5103, 5107, 5108, 5109, 5117, 5123])
def test_a_damper_that_follows_the_noise_of_its_sensor_teaches_nothing_at_rest(seed: int) -> None:
    """Before, the error of an effect was less than five times its size in four of the six; the first input says it."""
    random = np.random.default_rng(seed)
    drawn = draw(random)
    noise = max(drawn.noise, 0.1)
    one = replace(drawn, noise=noise, gusts=0.0, lost=-1, damped=True, feedback=3.0, rate=100)
    run = Identifier(configure(one), usual_intervals(one.rate)).run(*differentiate(one, fly(one, random)))
    resting = [e for e in run.estimates if 1.0 < e.time < REST]
    assert all((e.b_std > 5.0 * np.abs(e.b)).all() for e in resting)
    learnt = max(run.estimates, key=lambda e: e.b_reliable[1:].sum())
    assert learnt.b_reliable[1, 0]
    assert not [e for estimate in run.estimates for e in estimate.events if e.kind == EventKind.ISOLATED]


def test_a_first_input_after_rest_with_a_damper_is_no_loss() -> None:
    row = judge((4635, "differentiated", "damped"))
    assert (row["false"], row["wrong"]) == (0, 0)


def test_the_command_offers_every_record() -> None:
    assert [parser().parse_args(["linear", "--record", one]).record for one in RECORDS] == list(RECORDS)


def test_what_a_record_does_to_deflections_or_velocity_is_done_to_nothing_else() -> None:
    random = np.random.default_rng(5)
    one = draw(random)
    flight = fly(one, random)
    for record in RECORDS:
        kept = keep(record, one, flight)
        of_velocity = record in ("vane", "old velocity")
        assert kept[0] is flight[0] and kept[2] is flight[2]
        assert np.array_equal(kept[1][:, 1:], flight[1][:, 1:])
        assert np.array_equal(kept[1][:, 0], flight[1][:, 0]) != of_velocity
        assert np.array_equal(kept[3], flight[3]) == (
            of_velocity or record in ("as drawn", "slow", "damped", "elevons")
        )
    assert np.abs(keep("coarse", one, flight)[3] - flight[3]).max() <= 0.5 * COARSE + 1e-12


def test_an_effector_that_has_only_followed_a_rate_does_not_end_the_estimate() -> None:
    """Noise-free: its effect on v, put in step with the moments by itself, went to 7e8 in half a second."""
    random = np.random.default_rng(2040)
    one = draw(random)
    time, x, slopes, moved = (part[: 20 * one.rate] for part in differentiate(one, fly(one, random)))
    found = Identifier(configure(one), usual_intervals(one.rate)).run(time, x, slopes, moved)
    assert not [e for one in found.estimates for e in one.events if e.kind == EventKind.RESET]
    np.testing.assert_allclose(found.estimates[-1].b[1, 0], one.b[1, 0], rtol=0.1)


@pytest.mark.parametrize("seed", [4000, 4005])
def test_ten_samples_a_second_are_enough_where_derivatives_are_measured(seed: int) -> None:
    """Nothing was quicker than a mean over one sample, and delays were found in rounding errors: B by 1e32."""
    random = np.random.default_rng(seed)
    one = replace(draw(random), rate=10, noise=0.0, gusts=0.0, servo=0.0, delay=0.0, commands=False, lost=-1)
    found = Identifier(configure(one), 0).run(*fly(one, random)).estimates
    assert not [e for estimate in found for e in estimate.events]
    last = found[-1]
    np.testing.assert_allclose(last.b, one.b, rtol=0.01, atol=0.01)
    assert (abs(last.b - one.b) <= 1.96 * last.b_std).all() and last.b_reliable.any()


def test_differentiated_it_is_the_same_aircraft() -> None:
    random = np.random.default_rng(7)
    one = replace(draw(random), noise=0.0, gusts=0.0, servo=0.0, delay=0.0, commands=False, lost=-1)
    flight = fly(one, random)
    time, x, slopes, moved = differentiate(one, flight)
    assert len(time) == len(flight[0]) - usual_intervals(one.rate)
    expected = x @ one.a.T + moved @ one.b.T
    assert np.abs(slopes - expected).max() < 0.05 * np.abs(expected).max()
