"""Rows of many flights: kept as they come, in order at last; what cannot be had is said, and costs no other."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from benchmarks import calibration, flight_rows
from benchmarks.calibration_beds import f16_beds, keep_row, kept_rows
from benchmarks.flight_rows import Flight, Row, judge_flights
from msls_ros.commands import benchmark
from msls_ros.fleet import Done, FleetError

FLIGHTS = [Flight(bed, seed, ("direct", "mapped")) for bed in f16_beds(("half_loss",), ("low",)) for seed in (1, 2, 3)]


def judge(flight: Flight) -> list[Row]:
    return [{"bed": flight.bed.name, "seed": flight.seed, "path": path} for path in flight.paths]


def silent(text: str) -> None:
    """Take a line of progress."""


def test_of_a_flight_only_the_paths_that_are_not_kept_are_judged(tmp_path: Path) -> None:
    asked: list[tuple[int, tuple[str, ...]]] = []

    def noted(flight: Flight) -> list[Row]:
        asked.append((flight.seed, flight.paths))
        return judge(flight)

    file, _ = kept_rows(tmp_path, "rows")
    (row,) = judge(Flight(FLIGHTS[1].bed, 2, ("mapped",)))
    for one in (row, {**row, "seed": 9}):
        keep_row(file, one)
    said: list[str] = []
    rows = judge_flights(noted, FLIGHTS[:2], tmp_path, "rows", said.append)
    assert asked == [(1, ("direct", "mapped")), (2, ("direct",))]
    assert [(row["seed"], row["path"]) for row in rows] == [(s, path) for s in (1, 2) for path in ("direct", "mapped")]
    assert said == ["1 of 2: half_loss low, seed 1", "2 of 2: half_loss low, seed 2"]
    assert judge_flights(noted, FLIGHTS[:2], tmp_path, "rows", said.append) == rows
    assert len(asked) == 2 and said[2:] == said[:2]


def test_a_flight_that_kills_its_workers_is_named_when_all_others_are_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def ends(function: Any, tasks: list[Flight], **how: Any) -> Iterator[Done]:
        yield Done(1, None, "the worker process died")
        yield from (Done(k, function(tasks[k]), None) for k in (2, 0))

    monkeypatch.setattr(flight_rows, "run", ends)
    with pytest.raises(FleetError, match=r"^half_loss low, seed 2: the worker process died$"):
        judge_flights(judge, FLIGHTS, tmp_path, "rows", silent, jobs=2)
    assert [row["seed"] for row in kept_rows(tmp_path, "rows")[1]] == [3, 3, 1, 1]


def test_what_ends_in_an_interrupt_that_was_swallowed_is_not_kept(tmp_path: Path) -> None:
    begun: list[int] = []

    def noted(flight: Flight) -> list[Row]:
        begun.append(flight.seed)
        return judge(flight)

    with pytest.raises(KeyboardInterrupt):
        judge_flights(noted, FLIGHTS, tmp_path, "rows", silent, stopped=lambda: begun[-1:] == [2])
    assert begun == [1, 2]
    assert [row["seed"] for row in kept_rows(tmp_path, "rows")[1]] == [1, 1]


@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_benchmark_says_in_one_line_what_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], end: signal.Signals
) -> None:
    monkeypatch.setattr(calibration, "record", lambda bed, seed, folder: os.kill(os.getpid(), end))
    assert benchmark.main(["calibration", "--quick", "--json", "--folder", str(tmp_path)]) == 130
    out, err = capsys.readouterr()
    assert out == ""
    kept = f"what has ended is kept in '{tmp_path}', the same command goes on"
    assert err.splitlines()[-1] == f"benchmark: interrupted; {kept}"
