"""The benchmark of error bars: what it counts is what it says."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from benchmarks import calibration, calibration_beds
from benchmarks.calibration_beds import (
    AIRCRAFT,
    OTHERS,
    RATES,
    VARIANTS,
    Recorded,
    f16_beds,
    flight_test_beds,
    intact_beds,
    keep_row,
    kept_rows,
    mapped,
    other_beds,
    record,
)


def recorded(n: int = 400, rate: float = 50.0) -> Recorded:
    """A flight that turns in its first half and is quiet in its second."""
    time = np.arange(n) / rate
    x = np.zeros((n, 9))
    x[:, 0] = 100.0
    x[: n // 2, 3] = 0.1 * np.sin(4.0 * time[: n // 2])
    x[:, 6] = np.cumsum(x[:, 3]) / rate
    xdot = np.diff(x, axis=0, append=x[-1:]) * rate
    truth = np.arange(0.0, time[-1], 0.2)
    return Recorded(time, x, xdot, np.zeros((n, 3)), truth, np.zeros((len(truth), 9, 9)), np.ones((len(truth), 9, 3)))


@pytest.mark.parametrize(
    ("since", "time", "alarms", "still", "phase"),
    [
        (0.5, 0.5, [], True, "first second"),
        (2.0, 2.0, [], False, "1-4 s"),
        (9.0, 9.0, [8.5], True, "1 s after"),
        (9.0, 9.0, [3.0, 6.0], True, "1-4 s after"),
        (9.0, 9.0, [1.0], True, "quiet"),
        (9.0, 9.0, [9.5], False, "manoeuvre"),
    ],
)
def test_a_time_belongs_to_one_phase(since: float, time: float, alarms: list[float], still: bool, phase: str) -> None:
    assert calibration.phase_of(since, time, alarms, still) == phase


@pytest.mark.parametrize(
    ("time", "alarms", "late"),
    [
        (52.0, [52.0], True),  # nothing had seen the fault of 50 s before
        (52.0, [50.4, 52.0], False),  # it had been seen
        (52.0, [20.0, 52.0], True),  # an alarm before the fault has not seen it
        (20.0, [20.0, 52.0], False),
    ],
)
def test_an_alarm_is_late_after_a_fault_that_none_has_seen(time: float, alarms: list[float], late: bool) -> None:
    assert calibration.is_late(time, [(50.0, 50.0)], alarms) is late


def test_quiet_is_where_no_rate_has_moved_for_a_second() -> None:
    still = calibration.find_quiet(recorded())
    assert not still[20:200].any() and not still[210] and still[260:].all()


def test_coverage_and_median_are_those_of_normal_errors() -> None:
    z = np.abs(np.random.default_rng(0).standard_normal(100_000))
    counts = np.histogram(z, calibration.BINS)[0].tolist()
    found = calibration.phase_numbers([[400_000, 100_000, counts], [0, 0, [0] * len(counts)]])
    assert found["share"] == 0.25
    assert found["coverage"] == pytest.approx(0.95, abs=0.005)
    assert found["median_z"] == pytest.approx(0.675, abs=0.02)
    assert calibration.phase_numbers([[10, 0, [0] * len(counts)]])["coverage"] is None


def test_through_mapped_inputs_rates_are_differentiated_and_all_else_keeps_their_time() -> None:
    flight = recorded()
    time, x, xdot, _ = mapped(flight, 40.0)
    assert len(time) == len(flight.time) - 4
    assert time[0] == pytest.approx(flight.time[2])
    assert xdot[100, 3] == pytest.approx(0.4 * np.cos(4.0 * time[100]), abs=0.02)
    assert x[100, 3] == pytest.approx(0.1 * np.sin(4.0 * time[100]), abs=0.001)


def test_an_interrupted_run_goes_on_and_the_table_is_json_and_text(
    tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    bed = next(flight_test_beds(("A4",), (25,), ("loss",)))
    flown: list[int] = []

    def fly(bed: Any, seed: int, folder: Any) -> Recorded:
        flown.append(seed)
        return recorded(n=100, rate=25.0)

    monkeypatch.setattr(calibration, "beds", lambda kind: [bed])
    monkeypatch.setattr(calibration, "record", fly)
    calibration.measure([1], tmp_path, lambda text: None)
    result = calibration.measure([1, 2], tmp_path, lambda text: None)
    assert flown == [1, 2]
    (direct, through) = json.loads(json.dumps(result))["table"].values()
    assert direct["flights"] == through["flights"] == 2
    assert direct["broken"] == direct["silent"] == 2
    assert "flight test, mapped: 2 flights" in calibration.render(result)


def refuse(*flight: Any) -> Recorded:
    raise AssertionError(f"{flight} is flown here")


def test_two_jobs_give_the_same_table_as_one_and_go_on_with_each_others_rows(
    tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The flights are of two groups: rows in the order in which they end, or were kept, may be another table."""
    beds = [*intact_beds(("none",)), *f16_beds(("roll_doublet",))]
    short = [replace(bed, scenario=replace(bed.scenario, duration=3.0)) for bed in beds if bed.noise == "low"]
    monkeypatch.setattr(calibration, "beds", lambda kind: short)
    said: list[str] = []
    alone = calibration.measure([1], tmp_path / "1", said.append)
    assert said == ["1 of 2: intact none air low, seed 1", "2 of 2: roll_doublet low, seed 1"]
    monkeypatch.setattr(calibration, "record", refuse)
    together = calibration.measure([1], tmp_path / "2", said.append, jobs=2)
    assert json.dumps(together) == json.dumps(alone)
    assert sorted(line.split(": ")[1] for line in said[2:]) == sorted(line.split(": ")[1] for line in said[:2])
    first, second = (sorted(path.name for path in (tmp_path / folder).iterdir()) for folder in "12")
    assert first == second and len(first) == 3, "two flights, and their rows"
    for file in tmp_path.glob("*/*.jsonl"):
        lines = sorted(file.read_text().splitlines())
        assert len(lines) == 4
        for order in (lines, lines[::-1]):
            file.write_text("\n".join([*order, ""]))
            again = calibration.measure([1], file.parent, lambda text: None)
            assert json.dumps(again) == json.dumps(alone)


def test_rows_of_other_code_are_not_gone_on_with(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Codes that begin alike, as all do: the digest is at their end."""
    for code, expected in (("msls_ros with sources 1", []), ("msls_ros with sources 2", []), (None, [{"one": 1}])):
        if code is not None:
            monkeypatch.setattr(calibration_beds, "running_code", lambda code=code: code)
        file, rows = kept_rows(tmp_path, "rows")
        assert rows == expected
        keep_row(file, {"one": 1})


def test_a_torn_line_is_passed_over_and_spoils_no_other(tmp_path: Any) -> None:
    file, _ = kept_rows(tmp_path, "rows")
    assert file is not None
    keep_row(file, {"one": {"inner": 1}})
    whole = file.read_text()
    for end in range(1, len(whole) - 1):
        file.write_text(whole + whole[:end])
        assert kept_rows(tmp_path, "rows") == (file, [json.loads(whole)])
        keep_row(file, {"two": 2})
        assert kept_rows(tmp_path, "rows") == (file, [json.loads(whole), {"two": 2}])


def judged(name: str, noise: str, seed: int, path: str) -> dict[str, Any]:
    """Fly a scenario of the F-16 and judge what is said of it."""
    (bed,) = f16_beds((name,), (noise,))
    return calibration.judge(bed, seed, record(bed, seed, None), path, bed.configuration(seed))


def test_bars_hold_where_a_strong_manoeuvre_carries_the_aircraft_through_the_envelope() -> None:
    number, of, counts = judged("strong", "low", 501, "direct")["phases"]["B"]["manoeuvre"]
    found = calibration.phase_numbers([[number, of, counts]])
    assert found["coverage"] > 0.88 and found["share"] > 0.2


def test_a_name_through_differentiated_rates_waits_until_its_share_is_right() -> None:
    for seed in (300, 301, 304):
        names = judged("nozzle_failure", "low", seed, "mapped")["isolations"]
        assert names and all(one["right"] and abs(one["z"]) <= calibration.BAND for one in names), names


def test_aircraft_that_nothing_is_chosen_on_have_files_of_their_own_and_are_not_among_the_others() -> None:
    beds = list(other_beds())
    assert len(beds) == len(OTHERS) * len(RATES) * len(VARIANTS)
    assert not set(OTHERS) & set(AIRCRAFT)
    for bed in beds:
        name = bed.name.split()[0]
        configuration = bed.configuration(1)
        assert bed.group == "other aircraft" and bed.scenario.aircraft.airframe.name == name
        assert configuration.reference_speed == OTHERS[name][1]
        assert configuration.sample_rate == bed.scenario.rates.sensors
