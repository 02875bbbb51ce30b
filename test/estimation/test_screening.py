"""What is not learnt from: the ground, and numbers that jump away and back."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from msls_ros.estimation import Configuration, Identifier, Level, from_mapping
from msls_ros.estimation.dither.answer import NOT_FLYING, REASONS
from msls_ros.estimation.kernel import Array
from msls_ros.estimation.spikes import LEAST, LONGEST, REST, SpikeFilter, spike_settings

Samples = tuple[Array, Array, Array, Array]
RATE = 50.0
SPEED = 40.0
STATES, EFFECTORS = ("u", "w", "Q", "Phi", "Theta"), ("de",)


def configured(**changes: Any) -> Configuration:
    return from_mapping(
        {"states": STATES, "effectors": EFFECTORS, "reference_speed": SPEED, "sample_rate": RATE, **changes}
    )


def flight(seconds: float = 20.0, seed: int = 0, begin: float = 0.0) -> Samples:
    """An aircraft of known A and B in straight flight, its elevator moved by slow noise."""
    rng = np.random.default_rng(seed)
    count = round(seconds * RATE)
    moved = 0.03 * rng.normal(size=count)
    for k in range(1, count):
        moved[k] += 0.9 * moved[k - 1]
    x = np.tile([SPEED, 1.0, 0.0, 0.0, 0.025], (count, 1))
    xdot = np.zeros_like(x)
    for k in range(count):
        w, q = x[k, 1] - 1.0, x[k, 2]
        xdot[k, 1:3] = -1.5 * w + SPEED * q, -0.2 * w - 2.0 * q - 8.0 * moved[k]
        if k + 1 < count:
            x[k + 1, 1:3] = x[k, 1:3] + xdot[k, 1:3] / RATE
    x, xdot = x + 1e-3 * rng.normal(size=x.shape), xdot + 1e-2 * rng.normal(size=x.shape)
    return begin + np.arange(count) / RATE, x, xdot, moved[:, None]


def rest(seconds: float, begin: float = 0.0, speed: float = 0.0, climb: float = 0.0) -> Samples:
    """On its wheels: the elevator moves and nothing answers; or climbing, with the nose above the flow."""
    time, x, xdot, delta = flight(seconds, 9, begin)
    x[:] = [speed, 0.0, 0.0, 0.0, climb]
    xdot[:] = 0.0
    return time, x + 1e-3 * np.random.default_rng(1).normal(size=x.shape), xdot, delta


def joined(*parts: Samples) -> Samples:
    time, x, xdot, delta = (np.concatenate(column) for column in zip(*parts, strict=True))
    return time, x, xdot, delta


def without(samples: Samples, at: range) -> Samples:
    time, x, xdot, delta = (np.delete(column, list(at), axis=0) for column in samples)
    return time, x, xdot, delta


def model(identifier: Identifier, samples: Samples) -> tuple[bytes, ...]:
    estimate = identifier.estimate(float(samples[0][-1]), samples[1][-1])
    return tuple(part.tobytes() for part in (estimate.a, estimate.b, estimate.bias, estimate.a_std, estimate.b_std))


JUMPS = {
    "an elevator for a tenth of a second": ("delta", 0, 0.5, 5),
    "an elevator for a sample": ("delta", 0, -0.5, 1),
    "a pitch rate": ("x", 2, 2.0, 2),
    "a speed that reads nothing": ("x", 0, -SPEED, 3),
    "a pitch acceleration": ("xdot", 2, 200.0, 1),
    "a pitch rate, differenced": ("xdot", 2, (50.0, -50.0), 2),
}


@pytest.mark.parametrize("name", JUMPS)
def test_what_jumps_away_and_back_is_not_learnt_from_at_all(name: str) -> None:
    where, column, size, length = JUMPS[name]
    samples = flight()
    at = range(600, 600 + length)
    time, x, xdot, delta = (part.copy() for part in samples)
    {"x": x, "xdot": xdot, "delta": delta}[where][at, column] += np.asarray(size)
    clean, dirty = Identifier(configured()), Identifier(configured())
    clean.run(*without(samples, at))
    found = dirty.run(time, x, xdot, delta, every=10)
    assert model(dirty, samples) == model(clean, samples)
    assert not [event for estimate in found.estimates for event in estimate.events]
    gone = where == "x" and column == 0  # not of flight, then
    assert (dirty.grounded, dirty.spikes) == ((length, 0) if gone else (0, length))
    assert dirty.spike == ("" if gone else {"delta": "de", "x": "Q", "xdot": "dQ/dt"}[where])


def test_a_step_is_learnt_from_once_it_has_not_gone_back() -> None:
    """All samples enter in their order: the model is that of whoever holds nothing."""
    samples = flight()
    for part, column, size in ((samples[3], 0, 0.4), (samples[2], 2, 30.0), (samples[1], 0, -8.0)):
        part[600:, column] += size
    screened, plain = Identifier(configured()), Identifier(configured())
    plain._screen.idle = True
    screened.run(*samples)
    plain.run(*samples)
    assert model(screened, samples) == model(plain, samples)
    assert screened.spikes == 0


def test_held_samples_are_answered_by_dither_and_never_lost_from_the_count() -> None:
    samples = flight()
    samples[3][600:602] += 0.5
    samples[3][700:] -= 0.5
    run = Identifier(configured(**{"dither.seed": 3})).run(*samples)
    assert len(run.estimates) == len(samples[0])
    assert [estimate.samples for estimate in run.estimates] == list(range(1, len(samples[0]) + 1))
    level = np.concatenate([block.level for block in run.dithers])
    assert np.isin(level[590:720], (Level.NOMINAL, Level.BOOSTED)).all()


@pytest.mark.parametrize("every", [1, 7])
def test_one_by_one_in_blocks_and_in_halves_it_is_the_same_to_the_bit(every: int) -> None:
    """Ground, take-off, spikes and steps, cut where samples are held."""
    samples = joined(rest(6.0), rest(2.0, 6.0, 0.6 * SPEED), rest(3.0, 8.0, 0.8 * SPEED, 0.15), flight(15.0, 1, 11.0))
    samples[3][800:803] += 0.5
    samples[2][900, 2] -= 50.0
    samples[3][1000:] += 0.3
    whole, cut, single = (Identifier(configured()) for _ in range(3))
    expected = whole.run(*samples, every=every)
    parts = []
    for begin, end in ((0, 801), (801, 1001), (1001, len(samples[0]))):
        t, x, xdot, delta = (column[begin:end] for column in samples)
        parts.append(cut.run(t, x, xdot, delta, every=every))
    one = [(single.update(float(t), *rows), single.last_dither) for t, *rows in zip(*samples, strict=True)]
    dithers = np.concatenate([block.delta for block in expected.dithers])
    assert dithers.tobytes() == np.concatenate([b.delta for p in parts for b in p.dithers]).tobytes()
    assert dithers.tobytes() == np.array([dither.delta for _, dither in one]).tobytes()
    stated = [(e.samples, e.b.tobytes(), e.b_std.tobytes()) for e in expected.estimates]
    assert stated == [(e.samples, e.b.tobytes(), e.b_std.tobytes()) for p in parts for e in p.estimates]
    due = {e.samples: (e.samples, e.b.tobytes(), e.b_std.tobytes()) for e, _ in one}
    assert stated == [due[samples] for samples, *_ in stated]
    assert (whole.spikes, whole.grounded) == (single.spikes, single.grounded)
    assert whole.spikes == 4


def test_on_the_ground_nothing_is_learnt_and_the_dither_is_zero_until_it_climbs() -> None:
    ground = joined(rest(10.0), rest(5.0, 10.0, 0.7 * SPEED))
    identifier = Identifier(configured())
    run = identifier.run(*ground)
    assert not identifier.flying
    assert identifier.grounded == len(ground[0])
    assert not np.concatenate([block.delta for block in run.dithers]).any()
    assert {REASONS[int(why)] for block in run.dithers for why in block.reason} == {REASONS[NOT_FLYING]}
    assert run.estimates[-1].b_std[:3].min() == np.inf
    identifier.run(*rest(2.0, 15.0, 0.8 * SPEED, 0.15))
    assert identifier.flying
    flown = flight(20.0, 2, 17.0)
    identifier.run(*flown)
    late = Identifier(configured())
    late.run(*flown)
    both = [one.estimate(37.0, flown[1][-1]) for one in (identifier, late)]
    np.testing.assert_allclose(both[0].b[2], -8.0, atol=4.0 * both[0].b_std[2, 0])
    assert both[0].b_std[2, 0] < 2.0 * both[1].b_std[2, 0]


def test_nothing_rolls_for_a_minute_and_what_starts_fast_flies() -> None:
    identifier = Identifier(configured())
    identifier.run(*rest(1.0))
    identifier.run(*rest(59.0, 1.0, 0.7 * SPEED))
    assert not identifier.flying
    identifier.run(*rest(2.0, 60.0, 0.7 * SPEED))
    assert identifier.flying
    aloft = Identifier(configured())
    aloft.run(*flight(1.0))
    assert (aloft.flying, aloft.grounded) == (True, 0)


@pytest.mark.parametrize(("seconds", "stays"), [(3.0, True), (8.0, False)])
def test_an_airspeed_that_fails_for_a_moment_does_not_end_the_flight(seconds: float, stays: bool) -> None:
    identifier = Identifier(configured())
    identifier.run(*flight(5.0))
    identifier.run(*rest(seconds, 5.0))
    assert identifier.grounded == round(seconds * RATE)
    identifier.run(*flight(1.0, 3, 5.0 + seconds))
    assert identifier.flying == stays


@pytest.mark.parametrize(
    "changes", [{"flying_speed": 0.0}, {"known_gravity": False}, {"estimator.method": "msls"}], ids=str
)
def test_whoever_wants_it_learns_from_all(changes: dict[str, Any]) -> None:
    identifier = Identifier(configured(**changes))
    identifier.run(*rest(3.0))
    assert (identifier.flying, identifier.grounded) == (True, 0)


def test_the_filter_of_rows_gives_back_what_it_held_in_order() -> None:
    window = SpikeFilter(spike_settings([False, True], [False, False], 30.0, 0.05))
    rng = np.random.default_rng(0)
    rows = [np.array([0.1, 20.0]) + 0.01 * rng.normal(size=2) for _ in range(REST + 40)]
    used: list[tuple[int, Array]] = []
    dropped: list[int] = []
    for k, row in enumerate(rows):
        if k in (REST + 10, REST + 11):
            row[0] += 1.0  # back after two
        row[1] += 9.0 * (k >= REST + 30)  # and this stays
        used += window.push(k * 20_000_000, row)
        dropped += window.dropped
    assert dropped == [k * 20_000_000 for k in (REST + 10, REST + 11)]
    assert [stamp for stamp, _ in used] == [k * 20_000_000 for k in range(len(rows)) if k not in (REST + 10, REST + 11)]
    assert all((row == rows[stamp // 20_000_000]).all() for stamp, row in used)


def test_a_jump_below_the_least_is_motion() -> None:
    window = SpikeFilter(spike_settings([False], [False], 1.0, 0.05))
    for k in range(2 * REST):
        assert len(window.push(k * 20_000_000, np.array([0.9 * LEAST * (k == REST + 5)]))) == 1


def stepping(seconds: float) -> list[Array]:
    """Return rows of a rate with a little noise and of a deflection that steps by .4 rad every second, both ways."""
    rng = np.random.default_rng(1)
    found = []
    for k in range(round(seconds * RATE)):
        command = 0.4 * ((k // round(RATE)) % 2)
        found.append(np.array([0.01 * rng.normal(), command + 1e-4 * rng.normal()]))
    return found


def filtered(rows: list[Array], effector: list[bool]) -> tuple[list[int], list[int]]:
    """Return the numbers of the rows used and dropped; all are used in order."""
    window = SpikeFilter(spike_settings([False, False], [False, False], 1.0, 0.05, effector=effector))
    used: list[int] = []
    dropped: list[int] = []
    for k, row in enumerate(rows):
        used += [round(stamp * RATE * 1e-9) for stamp, _ in window.push(round(k / RATE * 1e9), row)]
        dropped += [round(stamp * RATE * 1e-9) for stamp in window.dropped]
    assert used == sorted(used)
    assert not set(used) & set(dropped)
    return used, dropped


def test_a_deflection_that_comes_back_is_a_spike_though_steps_of_commands_are_as_large() -> None:
    rows = stepping(12.0)
    at = round(8.4 * RATE)
    for k in (at, at + 1):
        rows[k][1] += 0.3
    assert filtered(rows, [False, True])[1] == [at, at + 1]
    assert filtered(rows, [False, False])[1] == []  # a state that steps like that moves


def test_no_step_of_a_command_is_dropped_and_each_is_used_within_the_longest_spike() -> None:
    rows = stepping(12.0)
    used, dropped = filtered(rows, [False, True])
    assert dropped == []
    assert len(rows) - len(used) <= LONGEST * RATE + 1


def test_a_spike_is_found_among_samples_that_another_number_has_held_up() -> None:
    rows = stepping(12.0)
    at = round(8.4 * RATE)
    for row in rows[at:]:
        row[0] += 1.0  # stays
    rows[at + 2][1] += 0.3
    used, dropped = filtered(rows, [False, True])
    assert dropped == [at + 2]
    assert at in used


def test_what_has_jumped_and_stayed_is_remembered_whole() -> None:
    rng = np.random.default_rng(2)
    rows = [0.01 * rng.normal(size=2) for _ in range(round(12.0 * RATE))]
    first, second = round(8.0 * RATE), round(10.0 * RATE)
    for row in rows[first:]:
        row[0] += 1.0
    for k in (second, second + 1):
        rows[k][0] += 1.4  # not further than half as much again
    assert filtered(rows, [False, False])[1] == []
    rows[second + 10][0] += 4.0
    assert len(filtered(rows, [False, False])[1]) == 1
