"""What the benchmarks promise: they compare like with like, say what is missing, and the stream leaves ours alone."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from benchmarks import control, kernel, peers, plain_c, stress
from benchmarks.peers import OURS, PEERS, Estimator, Peer
from msls_ros.commands import benchmark
from msls_ros.estimation import MSLS
from msls_ros.estimation.kernel import make_work

LOCAL = [OURS, "msls_ros RLS", "numpy covariance RLS"]
"""Estimators that need nothing beyond our own dependencies."""


def missing(p: int, rows: int, forgetting: float, w0: float) -> Estimator:
    message = "no module named peer"
    raise ImportError(message)


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    found = {name: PEERS[name] for name in LOCAL} | {"absent": Peer("nothing", missing)}
    monkeypatch.setattr(kernel, "PEERS", found)
    monkeypatch.setattr(stress, "PEERS", found)
    monkeypatch.setattr(kernel, "LOOP", 400)
    monkeypatch.setattr(kernel, "CALLS", 20)


@pytest.mark.parametrize(("p", "rows"), [(17, 9), (8, 3), (1, 1)])
@pytest.mark.parametrize("forgetting", [0.1, 0.98])
def test_plain_c_computes_the_same_gain_and_estimates_as_ours(p: int, rows: int, forgetting: float) -> None:
    rng = np.random.default_rng(5)
    plain = plain_c.PlainC(plain_c.build(), p, rows, forgetting, 0.01)
    kernel.check_agreement(
        plain, MSLS(p, rows, forgetting, 0.01), rng.normal(size=(200, p)), rng.normal(size=(200, rows))
    )


def test_another_problem_is_not_compared() -> None:
    rng = np.random.default_rng(5)
    plain = plain_c.PlainC(plain_c.build(), 3, 1, 0.9, 0.01)
    with pytest.raises(kernel.MismatchError, match="expected at most 1e-10"):
        kernel.check_agreement(plain, MSLS(3, 1, 0.9, 0.0101), rng.normal(size=(50, 3)), rng.normal(size=(50, 1)))


def test_what_is_timed_without_error_bars_gives_the_same_estimates() -> None:
    rng = np.random.default_rng(6)
    phi, y = rng.normal(size=(100, 4)), rng.normal(size=(100, 2))
    ours, bare = MSLS(4, 2, 0.9, 0.01), MSLS(4, 2, 0.9, 0.01)
    for x, out in zip(phi, y, strict=True):
        ours.update(x, out)
    work = make_work(4)
    kernel.run_gains(bare.R, bare.omega, bare.w0, bare.theta, phi, y, 0.9, work)
    np.testing.assert_array_equal(bare.theta, ours.theta)


@pytest.mark.parametrize("name", sorted(PEERS))
def test_every_peer_that_can_be_imported_solves_a_benign_problem(name: str) -> None:
    rng = np.random.default_rng(1)
    true = rng.normal(size=(3, 4))
    try:
        estimator = PEERS[name].make(4, 3, 0.98, 1e-3)
    except ImportError:
        assert name not in LOCAL
        return
    for _ in range(400):
        phi = rng.normal(size=4)
        estimator.update(phi, true @ phi)
    np.testing.assert_allclose(estimator.theta, true, atol=1e-4)


@pytest.mark.parametrize(("forgetting", "p"), stress.CASES)
def test_the_stress_stream_leaves_ours_finite_with_a_small_peak_error(forgetting: float, p: int) -> None:
    dead, peak = stress.survive(PEERS[OURS], forgetting, p, 100_000)
    assert dead is None
    assert peak < 1.5


def test_the_stress_stream_is_what_ruins_a_square_root_without_penalty() -> None:
    free = Peer("no penalty", lambda p, r, forgetting, w0: MSLS(p, r, forgetting, 1e-7))
    dead, peak = stress.survive(free, 0.1, 2, 100_000)
    assert dead is None
    assert peak > 20.0


def test_an_estimator_that_fails_is_reported_with_the_sample() -> None:
    class Fails:
        theta = np.zeros((1, 2))

        def update(self, phi: peers.Array, y: peers.Array) -> None:
            self.theta = self.theta + (math.nan if abs(phi[0]) > 2.0 else 0.25)

    phi, _, _ = stress.stream(2, 1000)
    first = int(np.argmax(np.abs(phi[:, 0]) > 2.0))
    assert stress.survive(Peer("", lambda p, r, forgetting, w0: Fails()), 0.9, 2, 1000)[0] == first


@pytest.mark.usefixtures("few")
def test_kernel_prints_one_json_value_with_every_contender(capsys: pytest.CaptureFixture[str]) -> None:
    assert benchmark.main(["kernel", "--rounds", "2", "--json"]) == 0
    sizes = json.loads(capsys.readouterr().out)
    assert [(size["p"], size["rows"]) for size in sizes] == [(17, 9), (8, 3)]
    for size in sizes:
        rows = {row["name"]: row for row in size["results"]}
        assert rows[kernel.PLAIN_C]["to_plain_c"] == 1.0
        assert rows[f"{OURS}, per call"]["to_ours_per_call"] == 1.0
        assert rows["absent"]["us"] is None
        assert "cannot be imported" in rows["absent"]["note"]
        assert all(row["us"] <= row["us_median"] for row in rows.values() if row["us"] is not None)


@pytest.mark.usefixtures("few")
def test_both_tables_name_what_is_missing(capsys: pytest.CaptureFixture[str]) -> None:
    for arguments in (["kernel", "--rounds", "1"], ["stress", "--samples", "50"]):
        assert benchmark.main(arguments) == 0
        out = capsys.readouterr().out
        assert "cannot be imported" in out
        assert OURS in out


@pytest.mark.usefixtures("few")
def test_without_a_compiler_the_rest_is_still_measured(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("CC", "no-such-compiler")
    assert benchmark.main(["kernel", "--rounds", "1"]) == 0
    assert "no C compiler 'no-such-compiler'" in capsys.readouterr().out


@pytest.mark.parametrize("arguments", [[], ["kernel", "--rounds", "0"], ["stress", "--samples", "x"], ["other"]])
def test_bad_usage_ends_with_2(arguments: list[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        benchmark.main(arguments)
    assert caught.value.code == 2


def test_damaged_bags_crash_nothing_and_lose_nothing_in_silence(capsys: pytest.CaptureFixture[str]) -> None:
    assert benchmark.main(["faults", "--only", "bags", "--bags", "150", "--seed", "5", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["bags"]
    assert len(rows) == 10 and all(row["tried"] == 15 for row in rows)
    for row in rows:
        assert (row["silent"], row["crashed"], row["hung"]) == (0, 0, 0), row
        assert row["whole"] < row["tried"], row
    assert benchmark.main(["faults", "--only", "bags", "--bags", "10"]) == 0
    assert "repair of rosbag2 MCAP" in capsys.readouterr().out


def test_campaign_prints_how_many_times_real_time_a_flight_takes(capsys: pytest.CaptureFixture[str]) -> None:
    assert benchmark.main(["campaign", "--flights", "2", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["flights"], found["simulated_s"], found["truth_hz"]) == (2, 12.0, 10)
    speed, wall = found["x_real_time"], found["flight_ms"]
    assert 1.0 < speed["low"] <= speed["median"] <= speed["high"]
    assert speed["high"] * wall["low"] == pytest.approx(12_000.0)
    assert benchmark.main(["campaign", "--flights", "1"]) == 0
    assert "x real time" in capsys.readouterr().out


def test_random_failures_count_where_the_law_that_knows_the_truth_survives_and_all_without_it() -> None:
    rows = [
        {"law": law, "scenario": "random_cruise", "noise": "low", "seed": seed, "kept": kept}
        for law, seed, kept in (("auto", 1, True), ("auto", 2, False), ("truth", 1, True), ("truth", 2, False))
    ]
    assert [row["law"] for row in control.survivable(rows)] == ["auto", "truth"]
    assert control.survivable(rows[:2]) == rows[:2]
