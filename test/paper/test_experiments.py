"""The paper's linear experiments on few seeds: bounds that hold for these seeds, and what the numbers are made of."""

from __future__ import annotations

import math

import numpy as np
import pytest

from msls_ros.paper import linear_experiments
from msls_ros.paper.linear_experiments import (
    DETECTING,
    JUMP,
    RLS_FAST,
    Runs,
    acceptance,
    coverage,
    detected_share,
    false_alarms,
    history_one,
    history_two,
    jump_errors,
    make_problem,
    rms_constant,
    rms_varying,
    run_experiments,
    settling_samples,
    track,
    unexcited_samples,
)

SEEDS = 20


@pytest.fixture(scope="module")
def runs() -> dict[str, Runs]:
    return run_experiments(SEEDS)


def test_regressors_and_noise_have_the_deviations_of_the_paper() -> None:
    theta = np.tile([3.0, -2.0], (200_000, 1))
    problem = make_problem(0, theta)
    phi1, phi2 = problem.phi.T
    noise = problem.y[:, 0] - problem.phi @ [3.0, -2.0]
    assert np.var(phi1) == pytest.approx(1.0, rel=0.02)
    assert np.var(phi2 - phi1) == pytest.approx(0.01, rel=0.02)
    assert np.var(noise) == pytest.approx(0.1, rel=0.02)
    assert abs(np.corrcoef(noise, phi1)[0, 1]) < 0.01


def test_less_noise_in_phi2_changes_nothing_else() -> None:
    full, half = make_problem(3, history_one()), make_problem(3, history_one(), difference=0.05)
    np.testing.assert_array_equal(full.phi[:, 0], half.phi[:, 0])
    np.testing.assert_allclose(half.phi[:, 1] - half.phi[:, 0], 0.5 * (full.phi[:, 1] - full.phi[:, 0]), atol=1e-14)


def test_parameter_histories_are_those_of_the_experiments() -> None:
    one, two = history_one(), history_two()
    assert one.shape == (800, 2) and two.shape == (600, 2)
    assert not one[:201, 0].any()
    assert one[350, 0] == pytest.approx(200.0) and one[650, 0] == pytest.approx(-200.0)
    assert two[100, 0] == pytest.approx(200.0)
    assert set(two[:JUMP, 1]) == {100.0} and set(two[JUMP:, 1]) == {250.0}


def test_a_track_is_what_one_batch_of_the_same_estimator_ends_at() -> None:
    problem = make_problem(0, np.tile([3.0, -2.0], (300, 1)))
    estimate = track(problem, rls=True, prior=1e12, forgetting=1.0).theta[-1]
    np.testing.assert_allclose(estimate, np.linalg.lstsq(problem.phi, problem.y[:, 0], rcond=None)[0], rtol=1e-6)


def test_msls_attenuates_noise_and_tracks(runs: dict[str, Runs]) -> None:
    assert 2.0 <= rms_constant(runs["one_msls"]) <= 2.6
    assert 4.5 <= rms_varying(runs["one_msls"]) <= 5.4
    assert rms_varying(runs["one_rls"]) >= 3.0 * rms_varying(runs["one_msls"])


def test_a_larger_forgetting_factor_does_not_help_while_the_parameter_varies(runs: dict[str, Runs]) -> None:
    assert rms_constant(runs["one_rls_slow"]) <= 0.9
    assert rms_varying(runs["one_rls_slow"]) >= 24.0


def test_half_the_noise_in_phi2_hurts_msls_a_little_and_doubles_the_error_of_rls(runs: dict[str, Runs]) -> None:
    assert rms_varying(runs["one_msls_halved"]) <= 1.4 * rms_varying(runs["one_msls"])
    assert rms_varying(runs["one_rls_halved"]) >= 1.8 * rms_varying(runs["one_rls"])
    assert np.isfinite(runs["one_rls_halved"].estimate).all()


def test_detection_shortens_the_jump(runs: dict[str, Runs]) -> None:
    msls, rls, detecting = runs["two_msls"], runs["two_rls"], runs["two_msls_detecting"]
    assert 71.0 <= np.median(jump_errors(detecting)) <= 77.0
    assert np.median(jump_errors(detecting)) < np.median(jump_errors(msls)) < np.median(jump_errors(rls))
    assert np.median(settling_samples(detecting)) <= 1.0 < np.median(settling_samples(msls)) <= 6.0
    assert detected_share(detecting) >= 0.9
    assert sum(false_alarms(detecting)) <= 0.1
    assert not msls.alarms.any()


def test_before_the_first_alarm_detection_changes_no_bit(runs: dict[str, Runs]) -> None:
    plain, detecting = runs["two_msls"], runs["two_msls_detecting"]
    for one, other, alarms in zip(plain.estimate, detecting.estimate, detecting.alarms, strict=True):
        first = int(np.flatnonzero(alarms)[0])
        np.testing.assert_array_equal(one[:first], other[:first])
        assert one[first] != other[first]


def test_settling_is_the_start_of_ten_samples_in_a_row() -> None:
    error = np.full((3, 600), 50.0)
    error[0, JUMP:] = 0.0
    error[1, JUMP + 2 : JUMP + 11] = 0.0  # only nine
    error[1, JUMP + 40 :] = -19.9
    runs = Runs(np.zeros(600), error, np.zeros((3, 600), np.int64))
    assert settling_samples(runs).tolist() == [0, 40, 300]


def test_alarms_are_counted_before_at_and_after_the_jump() -> None:
    alarms = np.zeros((4, 600), np.int64)
    alarms[0, JUMP - 1] = alarms[1, JUMP] = alarms[2, JUMP + 2] = alarms[3, JUMP + 3] = 1
    runs = Runs(np.zeros(600), np.zeros((4, 600)), alarms)
    assert detected_share(runs) == 0.5
    assert false_alarms(runs) == (0.25, 0.25)


def test_unexcited_msls_stays_finite_where_rls_does_not() -> None:
    assert unexcited_samples(100_000) == 100_000
    assert unexcited_samples(100_000, **DETECTING) == 100_000
    assert unexcited_samples(1000, **RLS_FAST) < 400


def test_error_bars_cover_the_truth() -> None:
    assert 0.93 <= coverage(SEEDS) <= 0.97


def test_the_table_says_of_every_row_whether_it_is_within_its_bounds(
    runs: dict[str, Runs], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(linear_experiments, "UNEXCITED", 10_000)
    table = acceptance(runs, 2)
    assert len(table) == len({one.statistic for one in table}) == 17
    for one in table:
        assert math.isfinite(one.low) or math.isfinite(one.high)
        assert one.ok == (one.low <= one.measured <= one.high)
    worse = dict(runs, one_msls=runs["one_rls"])
    assert sum(not one.ok for one in acceptance(worse, 2)) >= 3
