"""Losses that noise hides: the test in the direction of every surface, and forgetting in that direction alone."""

from __future__ import annotations

import math

import numpy as np
import pytest
from estimation.test_bank import PERIOD, SMALL, uniform

from msls_ros.estimation import EventKind, FaultEvent, Identifier, from_mapping
from msls_ros.estimation.bank.forgetting import apply_loss, forget_direction, mean_deflection
from msls_ros.estimation.bank.isolation import Decision, Losses, Name, find_name
from msls_ros.estimation.bank.losses import (
    EVERY,
    KNOWN,
    KNOWN_WELL,
    TOLERANCE,
    compare_surfaces,
    seen_loss,
)
from msls_ros.estimation.bank.regression import BankRegression
from msls_ros.estimation.bank.residual import residual_variance
from msls_ros.estimation.kernel import Array
from msls_ros.estimation.surfaces import read_surfaces

Flight = tuple[Array, Array, Array, Array]
FAULT = 250
KEPT = 10
"""Samples about whose mean an effect is changed."""
NOISE = 0.5
"""As large as what half of the effector does to P."""


def noisy(seed: int, left: float = 0.5, n: int = 450, noise: float = NOISE, trim: float = 0.0, ramp: int = 1) -> Flight:
    """Return a flight in which an effector keeps a share of its effects on P and R; one-step errors do not show it.

    It stands at ``trim`` in the mean, and is lost over so many samples.
    """
    x, delta = 0.25 * uniform(n, 3, seed), 0.125 * uniform(n, 2, seed + 1) + np.array([trim, 0.0])
    xdot = noise * uniform(n, 3, seed + 2) * np.array([1.0, 1.0, 0.25])
    share = 1.0 + np.clip((np.arange(n) - FAULT + 1) / ramp, 0.0, 1.0) * (left - 1.0)
    xdot[:, 0] += -2.0 * x[:, 0] + 8.0 * share * delta[:, 0]
    xdot[:, 1] += -1.0 * x[:, 1] - 4.0 * delta[:, 1]
    xdot[:, 2] += -0.5 * x[:, 2] + 2.0 * share * delta[:, 0]
    return PERIOD * np.arange(n, dtype=np.float64), x, xdot, delta


def engine_of(identifier: Identifier) -> BankRegression:
    engine = identifier._regression
    assert isinstance(engine, BankRegression)
    return engine


def events_of(identifier: Identifier, flight: Flight) -> list[FaultEvent]:
    return [event for estimate in identifier.run(*flight).estimates for event in estimate.events]


def test_half_an_effector_lost_in_noise_is_seen_and_named_with_an_honest_share() -> None:
    named, off = 0, []
    for seed in range(100, 140, 4):
        events = events_of(Identifier(from_mapping(SMALL)), noisy(seed))
        alarm = next(e for e in events if e.kind == EventKind.DETECTED)
        assert 0.0 < alarm.time - PERIOD * FAULT < 3.0
        assert alarm.statistic[0] > alarm.threshold[0]
        for event in (e for e in events if e.kind == EventKind.ISOLATED):
            assert event.suspected_effector == "da"
            off.append(abs(event.effectiveness - 0.5) / event.effectiveness_std)
            named += 1
    assert named >= 9
    assert np.median(off) < 1.5 and max(off) < 3.0


def gone(seed: int, n: int = 900) -> Flight:
    """Return the flight of `noisy` with all of the effect on P lost, of an aircraft that moments shake as much.

    Its states are what their derivatives make: where they are not, all of them may be noise.
    """
    delta, shaken = 0.125 * uniform(n, 2, seed + 1), NOISE * uniform(n, 3, seed + 2) * np.array([1.0, 1.0, 0.25])
    x, xdot = np.zeros((n, 3)), np.zeros((n, 3))
    for k in range(n):
        da, de = delta[k]
        roll = 8.0 * da if k < FAULT else 0.0
        xdot[k] = np.array([-2.0, -1.0, -0.5]) * x[k] + np.array([roll, -4.0 * de, 2.0 * da]) + shaken[k]
        if k + 1 < n:
            x[k + 1] = x[k] + PERIOD * xdot[k]
    return PERIOD * np.arange(n, dtype=np.float64), x, xdot, delta


def test_that_an_effect_is_gone_is_known_when_the_error_is_small_for_what_it_was() -> None:
    known = 0
    for seed in range(100, 140, 4):
        estimates = Identifier(from_mapping(SMALL)).run(*gone(seed)).estimates
        before, after = estimates[FAULT - 1], estimates[-1]
        assert before.b_reliable[0, 0] and before.b[0, 0] == pytest.approx(8.0, abs=2.0)
        assert abs(after.b[0, 0]) < 2.0 * after.b_std[0, 0]
        assert after.b_std[0, 0] > 0.3 * abs(after.b[0, 0]), "a share of nothing would not be small enough"
        known += bool(after.b_reliable[0, 0])
    assert known >= 9


def test_it_is_this_test_that_sees_it() -> None:
    identifier = Identifier(from_mapping(SMALL))
    engine = engine_of(identifier)
    engine.settings = engine.settings._replace(gains=np.zeros((0, 2)), shares=np.zeros((0, 2)))
    assert events_of(identifier, noisy(100)) == []


def test_nothing_is_alarmed_where_nothing_breaks() -> None:
    for seed in range(200, 240, 4):
        assert events_of(Identifier(from_mapping(SMALL)), noisy(seed, left=1.0)) == []


def test_a_loss_is_alarmed_when_a_member_has_seen_it_for_as_long_as_its_limits_say() -> None:
    """Or, where it is far beyond the limit, half as long; at once then, and never sooner."""
    how: set[bool] = set()
    for seed in range(100, 140, 4):
        identifier = Identifier(from_mapping(SMALL))
        engine = engine_of(identifier)
        s = engine.settings
        limits = [
            (int(tests), float(low), float(high))
            for tests, (low, high) in zip(s.loss_tests, s.loss_limits, strict=True)
        ]
        assert [tests for tests, _, _ in limits] == [10, 3, 5, 10]
        seen: list[list[float]] = [[] for _ in limits]
        for sample in zip(*noisy(seed), strict=True):
            identifier.learn(*sample)
            if identifier.alarms:
                break
            if engine.state.samples[0] % EVERY == 0:
                for a, one in enumerate(seen):
                    one.append(loss_of(engine, a))
        assert identifier.alarms and engine.state.samples[0] > FAULT
        due = []
        for one, (tests, low, high) in zip(seen, limits, strict=True):
            half = (tests + 1) // 2
            for end in range(tests, len(one) + 1):
                assert min(one[end - tests : end]) <= low and min(one[end - half : end]) <= high
            due.append((min(one[1 - tests :]) > low, min(one[1 - half :]) > high))
        assert any(long or sure for long, sure in due)
        how.update(long for long, _ in due)
    assert how == {True, False}


def loss_of(engine: BankRegression, a: int) -> float:
    """Return by how many standard errors the effect of da has decreased for one of the members, if that is a loss."""
    s, x, work = engine.settings, engine.state, engine._work
    back = int(s.loss_delays[a])
    if x.kept[0] - x.kept[1] <= back:
        return 0.0
    slot = (x.kept[0] - 1 - back) % len(x.kept_theta)
    work.concerned[:] = 1
    seen = seen_loss(s, x, a, x.kept_theta[slot], x.kept_square[slot], work)
    return float(work.deviation[0]) if seen == 0 else 0.0


def test_a_moment_from_nowhere_is_alarmed_at_once_where_noise_is_all_that_was_ever_seen() -> None:
    time, x, xdot, delta = noisy(100, left=1.0)
    small = 0.02
    xdot = NOISE * uniform(len(time), 3, 102) + small * xdot
    xdot[FAULT:, 0] += 20.0 * NOISE
    alarms = [e for e in events_of(Identifier(from_mapping(SMALL)), (time, small * x, xdot, small * delta))]
    first = alarms[0]
    assert (first.kind, first.equations, first.time) == (EventKind.DETECTED, ("P",), time[FAULT])


def test_a_surface_is_not_named_where_another_explains_nearly_as_much() -> None:
    limits = from_mapping(SMALL).isolation
    surfaces = read_surfaces("", ("da", "de"))
    for rival, name in ((70.0, "da"), (80.0, None)):
        losses = Losses([-0.5, -0.5], [0.05, 0.05], [100.0, rival], 20.0, 120.0)
        found = find_name(losses, surfaces, limits)
        assert (found.surface if found else None) == name


@pytest.mark.parametrize(("rate", "error"), [(0.0, 0.05), (0.1, 0.158), (0.3, None)])
def test_what_still_moves_is_named_with_the_lag_of_the_rows_that_go_on_in_its_error(
    rate: float, error: float | None
) -> None:
    """A share that falls by 0.1 a second is behind by 1.5 s of memory; by 0.3, it is not said."""
    slow = round(0.6 / PERIOD)
    decision = Decision(8, slow, 1.5 / 0.6)
    said = [decision.take(Name("da", 9.0, 0.8 - rate * PERIOD * n, 0.05), anew=False) for n in range(slow)]
    assert said[:-1] == [None] * (slow - 1)
    assert (said[-1].error if said[-1] else None) == (pytest.approx(error, abs=0.005) if error else None)


def test_a_name_of_rows_that_have_begun_anew_stands_a_few_samples() -> None:
    decision = Decision(8, 30, 2.5)
    said = [decision.take(Name("da", 9.0, 0.5, 0.05)) for _ in range(8)]
    assert [one is not None for one in said] == [False] * 7 + [True]


def test_what_is_known_of_everything_else_is_kept() -> None:
    identifier = Identifier(from_mapping(SMALL))
    estimates = identifier.run(*noisy(102)).estimates
    k = next(i for i, e in enumerate(estimates) if any(v.kind == EventKind.DETECTED for v in e.events))
    before, alarmed, after = estimates[k - 1 : k + 2]
    assert after.a_std[0, 0] < 1.2 * before.a_std[0, 0]
    assert after.b_std[0, 0] > 2.0 * before.b_std[0, 0]
    assert alarmed.b[0, 0] < 0.75 * before.b[0, 0]
    assert estimates[-1].b[0, 0] == pytest.approx(4.0, abs=3.0 * estimates[-1].b_std[0, 0])


def test_forgetting_a_direction_adds_to_the_covariance_along_it_and_nothing_else() -> None:
    """Along the effect about the mean deflection of the last samples: the constant goes the other way."""
    identifier = Identifier(from_mapping(SMALL))
    flight = noisy(100, n=200, trim=0.25)
    identifier.run(*flight)
    engine = engine_of(identifier)
    s, x, R = engine.settings, engine.state, engine.state.R[0].copy()
    assert len(x.last_phi) == KEPT
    mean = mean_deflection(s, x, 0)
    assert mean == pytest.approx(flight[3][-KEPT:, 0].mean(), rel=1e-12)
    precision, direction = 0.3, np.array([-mean, 0.0, 0.0, 0.0, 1.0, 0.0])
    for m in range(R.shape[2]):
        before = np.linalg.inv(R[:, :, m].T @ R[:, :, m])
        forget_direction(s, R, m, 0, mean, precision, engine._work)
        assert (np.tril(R[:, :, m], -1) == 0.0).all() and (np.diagonal(R[:, :, m]) > 0.0).all()
        after = np.linalg.inv(R[:, :, m].T @ R[:, :, m])
        assert after == pytest.approx(before + precision * np.outer(direction, direction), rel=1e-9, abs=1e-12)


def test_a_loss_moves_the_effect_and_the_constants_meet_the_last_samples() -> None:
    identifier = Identifier(from_mapping(SMALL))
    flight = noisy(100, n=240, trim=0.25)
    identifier.run(*flight)
    engine = engine_of(identifier)
    s, x, work = engine.settings, engine.state, engine._work
    phi = np.column_stack((np.ones(KEPT), flight[1][-KEPT:], flight[3][-KEPT:]))
    y = flight[2][-KEPT:, 0]
    x.theta_before[:] = x.mixed
    work.concerned[:] = [1, 0, 0]
    before, members = x.mixed.copy(), x.members.copy()
    apply_loss(s, x, 0, -0.4, 0.5, work)
    for theta in (x.mixed[0], *x.members[0].T):
        assert theta[4] == pytest.approx(0.6 * before[0, 4], rel=1e-9)
        assert np.mean(y - phi @ theta) == pytest.approx(0.0, abs=1e-9)
    assert list(x.group) == [1, 0, 0]
    assert (x.members[1:] == members[1:]).all() and (x.members[0, 1:4] == members[0, 1:4]).all()
    g = x.group[0]
    found = np.sqrt(residual_variance(x, 0) / x.info[g, 4])
    assert found.min() == pytest.approx(0.5 * before[0, 4], rel=0.02), "once, and as the bars count it"


def test_what_constants_have_followed_is_no_evidence_against_a_loss() -> None:
    """An effector that is deflected in the mean fades; constants follow its moment until the loss is alarmed."""
    off = []
    for seed in range(100, 180, 4):
        estimates = Identifier(from_mapping(SMALL)).run(*noisy(seed, 0.0, noise=0.3, trim=0.25, ramp=150)).estimates
        alarm = next(k for k, e in enumerate(estimates) if any(v.kind == EventKind.DETECTED for v in e.events))
        then = alarm + KEPT
        if then < len(estimates):
            off.append(estimates[then].b[0, 0] - 8.0 * max(1.0 - (then - FAULT + 1) / 150, 0.0))
    assert len(off) >= 18
    assert abs(np.mean(off)) < 2.0 * np.std(off) / math.sqrt(len(off))


def test_the_change_is_the_least_squares_one_in_its_direction() -> None:
    identifier = Identifier(from_mapping(SMALL))
    identifier.run(*noisy(100, n=240))
    engine = engine_of(identifier)
    s, x, work = engine.settings, engine.state, engine._work
    which, row, column = len(s.loss_members) - 1, 0, 4
    member = int(s.loss_members[which])
    before = x.mixed.copy()
    before[row, column] *= 1.25
    work.concerned[:] = [1, 0, 0]
    compare_surfaces(s, x, which, before, 1e-12 * np.ones_like(before), KNOWN, False, False, work)
    R = x.R[0, 1:, 1:, member]
    a = np.zeros(5)
    a[column - 1] = before[row, column]
    difference = x.members[row, 1:, member] - before[row, 1:]
    expected = a @ R.T @ R @ difference / (a @ R.T @ R @ a)
    assert work.change[0] == pytest.approx(expected, rel=1e-9)
    assert work.change[0] == pytest.approx(-0.2, abs=0.1)


def test_an_error_of_the_reference_is_an_error_of_what_is_left_in_proportion() -> None:
    """Of half an effect, half of it."""
    identifier = Identifier(from_mapping(SMALL))
    identifier.run(*noisy(100, n=240))
    engine = engine_of(identifier)
    s, x, work = engine.settings, engine.state, engine._work
    relative, row, column = 0.2, 0, 4
    for part in (1.0, 2.0, 5.0):
        before = x.mixed.copy()
        before[row, column] *= part
        work.concerned[:] = [1, 0, 0]
        compare_surfaces(s, x, len(s.loss_members) - 1, before, np.square(relative * before), KNOWN, False, False, work)
        noise = 0.5 / work.information[0, 0] + TOLERANCE**2
        assert work.change[0] == pytest.approx(1.0 / part - 1.0, abs=0.1)
        assert math.sqrt(work.variance[0] - noise) == pytest.approx(relative * (1.0 + work.change[0]), rel=1e-9)
        compare_surfaces(s, x, len(s.loss_members) - 1, before, np.square(0.25 * before), KNOWN_WELL, True, False, work)
        assert work.variance[0] == math.inf, "what is known to a quarter does not alarm"
