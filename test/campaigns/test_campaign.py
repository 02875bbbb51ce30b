"""Campaigns: every flight is flown once and told the same, whoever flies it and whatever is killed meanwhile."""

from __future__ import annotations

import csv
import io
import json
import math
import os
import signal
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from campaigns.running import kept, run, start, strict, table, wait_for, write

from msls_ros.campaigns.plan import plan
from msls_ros.campaigns.store import Store
from msls_ros.campaigns.table import summarise
from msls_ros.flights.judging import errors, exposed, false_alarms
from msls_ros.plant import Sample, Sensors, instruments


def rows_of(folder: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(table(folder).decode())))


def test_a_campaign_tells_each_flight_in_csv_and_all_in_one_json_value(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    todo = [write(tmp_path), "--seeds", 3, "--first-seed", 5, "--noise", "none,low", "--out", out, "--json"]
    code, text, err = run(capsys, *todo)
    summary = strict(text)
    assert (code, err, summary["flights_flown"], summary["complete"]) == (0, [], 6, True)
    quiet, noisy = summary["cells"]
    assert (quiet["noise"], noisy["noise"]) == ("none", "low")
    assert (quiet["flights"], quiet["detected"], quiet["missed"]) == (3, 3, 0)
    assert quiet["delay_s"] == {"median": 0.02, "low": 0.02, "high": 0.02}
    assert quiet["exposed_h"] == pytest.approx(3 * 2.0 / 3600.0)
    assert quiet["msls"]["rms_before"]["high"] < noisy["msls"]["rms_before"]["low"]
    b = quiet["coverage"]["b"]
    assert 0.5 < b["share"] < 1.0 and 100 < b["number"] < b["of"] == 3 * 20 * 42
    for cell in (quiet, noisy):
        dither = cell["dither"]
        assert 0.5 * dither["predicted_g_rms"] < dither["realised_g_rms"] < 1.1 * dither["predicted_g_rms"]
        assert 0.5 < dither["realised_of_limit_1s_max"] < 1.1
    rows = rows_of(out)
    assert [(row["noise"], row["seed"]) for row in rows] == [(n, s) for n in ("none", "low") for s in "567"]
    assert all(row["finite"] == "true" and row["fault1_delay_s"] == "0.02" for row in rows[:3])
    whole = strict((out / "campaign.json").read_text())
    assert len(whole["flights"]) == len(kept(out)) == 6
    assert all(strict(line)["wall_time_s"] > 0.0 for line in kept(out))
    assert {"jsbsim", "numpy", "code"} <= whole["versions"].keys()
    assert not list(out.glob(".*"))


def test_what_is_told_of_a_flight_is_what_the_demo_would_tell(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from msls_ros.inputs.profiles import config_folder
    from msls_ros.paper.flight_experiments import LITERAL_DITHER, MSLS_BY_NOISE, fly_loss

    paper = (config_folder() / "scenarios" / "roll_doublet_tail_fault.yaml").read_text()
    settings = {**MSLS_BY_NOISE["low"], **LITERAL_DITHER, "estimator.method": "msls"}
    (tmp_path / "paper.yaml").write_text(paper.replace("parameters: {}", f"parameters: {json.dumps(settings)}"))
    run(capsys, tmp_path / "paper.yaml", "--seeds", 1, "--noise", "low", "--out", tmp_path)
    flight, loss = json.loads(kept(tmp_path)[0]), fly_loss("low", 0)
    for name in ("msls", "msls_no_detection", "rls"):
        for quantity in ("settle_s", "rms_before", "rms_after", "peak_error"):
            assert flight[name][quantity] == loss.error(name, quantity), (name, quantity)
    assert flight["faults"][0]["delay_s"] == loss.delay
    assert flight["false_alarms"] == loss.summary["false_alarms"]


def test_two_jobs_give_the_same_table_as_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    todo = [write(tmp_path), "--seeds", 4, "--noise", "none,med", "--compare", "lambda=0.9,0.95"]
    for jobs in (1, 2):
        assert run(capsys, *todo, "--out", tmp_path / str(jobs), "--jobs", jobs)[0] == 0
    assert table(tmp_path / "1") == table(tmp_path / "2")
    assert len(rows_of(tmp_path / "1")) == 16


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_killed_campaign_goes_on_where_it_was(tmp_path: Path, capsys: pytest.CaptureFixture[str], jobs: int) -> None:
    todo = [write(tmp_path, duration="6.0"), "--seeds", 16]
    run(capsys, *todo, "--out", tmp_path / "whole")
    process = start(*todo, "--jobs", jobs, "--out", tmp_path / "killed")
    wait_for(tmp_path / "killed", 3, lambda: process.poll() is None)
    process.kill()
    process.communicate()
    before = kept(tmp_path / "killed")
    assert 3 <= len(before) < 16
    code, _, err = run(capsys, *todo, "--out", tmp_path / "killed")
    assert (code, err[-1]) == (0, f"campaign: {len(before)} of 16 flights are in '{tmp_path / 'killed'}'")
    after = kept(tmp_path / "killed")
    assert after[: len(before)] == before
    assert len(after) == len({json.loads(line)["key"] for line in after}) == 16
    assert table(tmp_path / "killed") == table(tmp_path / "whole")


def test_a_killed_worker_costs_only_time(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], scheduler: str, worker: Callable[..., int]
) -> None:
    todo = [write(tmp_path, duration="6.0"), "--seeds", 14]
    run(capsys, *todo, "--out", tmp_path / "one")
    victim, _ = worker(), worker()
    done: list[int] = []
    over = threading.Event()

    def kill() -> None:
        wait_for(tmp_path / "two", 2, lambda: not over.is_set())
        done.append(len(kept(tmp_path / "two")))
        os.kill(victim, signal.SIGKILL)

    killer = threading.Thread(target=kill, daemon=True)
    killer.start()
    code, _, err = run(capsys, *todo, "--out", tmp_path / "two", "--scheduler", scheduler)
    over.set()
    killer.join()
    assert (code, err) == (0, [])
    assert 2 <= done[0] < 14
    assert len(kept(tmp_path / "two")) == 14
    assert table(tmp_path / "two") == table(tmp_path / "one")


@pytest.mark.parametrize(("jobs", "end"), [(1, signal.SIGTERM), (2, signal.SIGINT), (2, signal.SIGTERM)])
def test_an_interrupted_campaign_says_what_is_kept_and_how_to_go_on(
    tmp_path: Path, jobs: int, end: signal.Signals
) -> None:
    out, file = tmp_path / "out", write(tmp_path, duration="6.0")
    process = start(file, "--seeds", 500, "--jobs", jobs, "--out", out, "--json", "--fresh")
    wait_for(out, 3, lambda: process.poll() is None)
    process.send_signal(end)
    text, err = process.communicate()
    said = [line for line in err.splitlines() if not line.startswith("flying ")]
    assert process.returncode == 130
    assert said == [
        f"campaign: interrupted; {len(kept(out))} of 500 flights are kept in '{out}', to go on: "
        f"campaign {file} --seeds 500 --jobs {jobs} --out {out} --json"
    ]
    assert not strict(text)["complete"]
    assert len(rows_of(out)) == len(kept(out)) == strict(text)["flights_flown"] >= 3


LAW = """
description: thrust vectoring in pitch lost
condition: high_alpha
manoeuvre: roll_doublet
duration: 5.0
faults: [{effector: nozzle_pitch, time: 1.5, effectiveness: 0.0, bias: -0.087}]
identifier:
  profile: f16
  parameters: {estimator.method: msls, estimator.forgetting_factor: 0.96, estimator.penalty: 9.0e-4}
"""


def test_laws_are_compared_by_flights_kept_and_tracking(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text(LAW)
    todo = [file, "--seeds", 1, "--compare", "law=fixed,indi,auto", "--out", tmp_path / "out"]
    code, out, _ = run(capsys, *todo)
    assert code == 0
    rows = {row["setting"]["law"]: row["tracking"] for row in map(json.loads, kept(tmp_path / "out"))}
    assert [rows[law]["kept"] for law in ("fixed", "indi", "auto")] == [False, True, True]
    assert rows["fixed"]["why"].startswith("angle of attack") and rows["fixed"]["recovery_s"] is None
    assert rows["auto"]["roll_rms"] < 1.0 and rows["auto"]["fixed_share"] == 0.0
    lines = out.splitlines()
    assert next(line for line in lines if "law=fixed" in line).split()[2:4] == ["0", "of"]
    for given, text in (
        ("law=best", "law is 'best'; expected one of fixed, indi, lq, auto"),
        ("control.caution=0.1", "the scenario has no law"),
        ("control.cautoin=0.1", "expected control. and a parameter"),
    ):
        code, _, err = run(capsys, file, "--seeds", 1, "--compare", given)
        assert code == 2 and text in err[-1], err


def test_a_torn_last_line_is_dropped_and_its_flight_flown_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    todo = [write(tmp_path), "--seeds", 3, "--out", tmp_path / "out"]
    run(capsys, *todo)
    whole, path = table(tmp_path / "out"), tmp_path / "out" / "flights.jsonl"
    path.write_bytes(path.read_bytes()[:-40])
    code, _, err = run(capsys, *todo)
    assert code == 0
    assert err == [
        f"campaign: '{path}': its last line was torn and is dropped; that flight is flown again",
        f"campaign: 2 of 3 flights are in '{tmp_path / 'out'}'",
    ]
    assert table(tmp_path / "out") == whole and len(kept(tmp_path / "out")) == 3
    assert run(capsys, *todo, "--fresh")[2] == []
    assert table(tmp_path / "out") == whole and len(kept(tmp_path / "out")) == 3


def test_lines_that_are_no_flights_are_passed_over_and_flown_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    todo = [write(tmp_path), "--seeds", 4, "--out", tmp_path / "out"]
    run(capsys, *todo)
    whole, path = table(tmp_path / "out"), tmp_path / "out" / "flights.jsonl"
    first, second, third, fourth = path.read_text().splitlines()
    lacking = {name: value for name, value in json.loads(second).items() if name != "faults"}
    unlike = json.dumps({**json.loads(third), "truth_end": math.nan})
    path.write_text("\n".join([first, json.dumps(lacking), unlike, "[" * 100_000, "null", fourth[:50]]) + "\n")
    code, _, err = run(capsys, *todo)
    assert code == 0
    assert err == [
        f"campaign: '{path}': 5 lines are no flights and are passed over",
        f"campaign: 1 of 4 flights are in '{tmp_path / 'out'}'",
    ]
    assert table(tmp_path / "out") == whole


def test_a_second_campaign_in_the_folder_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    todo = [write(tmp_path), "--seeds", 1, "--out", tmp_path / "out"]
    with Store(tmp_path / "out", fresh=False):
        code, out, (said,) = run(capsys, *todo, "--fresh")
    assert (code, out) == (2, "")
    assert said.startswith(f"campaign: another campaign is flying into '{tmp_path / 'out'}'; expected one at a time")
    assert run(capsys, *todo)[0] == 0


def test_a_scenario_that_was_changed_is_flown_anew(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def fly(seeds: int = 2, **changes: str) -> tuple[int, list[str]]:
        _, _, err = run(capsys, write(tmp_path, **changes), "--seeds", seeds, "--out", tmp_path / "out")
        return len(kept(tmp_path / "out")), [line.split("campaign: ")[1].split(" in ")[0] for line in err]

    assert fly() == (2, [])
    assert fly(description="another sentence") == (2, ["2 of 2 flights are"])
    assert fly(3) == (3, ["2 of 3 flights are"])
    assert fly(duration="2.5") == (5, [])
    assert fly(manoeuvre="steady") == (7, [])
    assert fly(watch="R/dtr") == (9, [])
    assert fly() == (9, ["2 of 2 flights are"])


def test_comparisons_fly_all_combinations_and_rls_has_the_same_lambda(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    todo = [write(tmp_path), "--seeds", 2, "--compare", "lambda=0.9,0.97", "--compare", "detector.mode=off,normalised"]
    code, text, _ = run(capsys, *todo, "--out", tmp_path / "out")
    assert code == 0 and "lambda=0.97 detector.mode=off" in text
    cells = strict((tmp_path / "out" / "campaign.json").read_text())["cells"]
    settings = [tuple(cell["setting"].values()) for cell in cells]
    assert settings == [(0.9, "off"), (0.9, "normalised"), (0.97, "off"), (0.97, "normalised")]
    assert [cell["detected"] for cell in cells] == [0, 2, 0, 2]
    for name in ("msls", "rls"):
        assert cells[1][name]["rms_before"] != cells[3][name]["rms_before"]
    off = cells[0]
    assert off["msls"] == off["msls_no_detection"]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--compare", "lambda=0.9,1.5"], "parameter 'estimator.forgetting_factor' is 1.5; it must be in [0.01, 1]"),
        (["--compare", "T=7,many"], "parameter 'detector.threshold' is 'many'; it must be a number"),
        (["--compare", "lamda=0.9"], "parameter 'lamda' does not exist; did you mean 'lambda'? There are lambda, "),
        (["--compare", "dither.seed=1,2"], "dither.seed: it cannot be compared, the seed gives it"),
        (["--compare", "dither.weights=1,2"], "dither.weights: it is a list; expected a parameter of one number"),
        (["--compare", "penalty=1e-3,0.001"], "estimator.penalty: '0.001' is there twice; expected each once"),
        (["--compare", "T=7", "--compare", "detector.threshold=8"], "'detector.threshold' is there twice"),
        (["--first-seed", "2147483647"], "--first-seed 2147483647 with --seeds 2: expected no seed beyond 2147483647"),
        (["roll_doublet"], "scenario: 'roll_doublet' is there twice; expected each once"),
        (["barrel_roll"], "scenario 'barrel_roll' does not exist; expected"),
        (["--noise", "none,loud"], "'loud' is no noise level; expected some of none,low,med"),
        (["--compare", "lambda"], "'lambda' is no comparison; expected NAME=VALUE,VALUE such as lambda=0.8,0.9,0.95"),
        (["--seeds=0"], "'0' is not a count; expected a whole number from 1"),
    ],
)
def test_what_cannot_be_flown_is_refused_in_one_line_before_anything_flies(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], sentence: str
) -> None:
    try:
        names = [one for one in arguments if "roll" in one]
        options = [one for one in arguments if one not in names]
        code, out, err = run(capsys, "roll_doublet", *names, "--seeds", 2, *options, "--out", tmp_path / "out")
    except SystemExit as end:
        code, (out, text) = int(str(end.code)), capsys.readouterr()
        err = text.splitlines()
    assert (code, out, len(err)) == (2, "", 1)
    assert sentence in err[0]
    assert not (tmp_path / "out").exists()


def test_a_flight_that_fails_is_a_row(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    class Broken(Sensors):
        def __init__(self, noise: str, seed: int) -> None:
            super().__init__(noise, seed)
            self.broken = seed in (1, 9)

        def measure(self, sample: Sample) -> Sample:
            good = super().measure(sample)
            bad = self.broken and sample.time > 1.0
            return Sample(good.time, np.full(9, np.nan), good.xdot, good.delta) if bad else good

    monkeypatch.setattr(instruments, "Sensors", Broken)
    todo = [write(tmp_path), "--seeds", 3, "--out", tmp_path / "out"]
    code, text, _ = run(capsys, *todo)
    assert code == 0
    assert "failed: x holds a number that is not finite or too large" in text
    (cell,) = strict((tmp_path / "out" / "campaign.json").read_text())["cells"]
    assert (cell["flights"], cell["failed"], cell["detected"], len(cell["errors"])) == (3, 1, 2, 1)
    good, bad, _ = rows_of(tmp_path / "out")
    assert (bad["seed"], bad["fault1_detected"], bad["finite"], good["error"]) == ("1", "", "", "")
    assert "not finite" in bad["error"]
    alone = [write(tmp_path), "--seeds", 1, "--first-seed", 9, "--out", tmp_path / "bad"]
    assert run(capsys, *alone)[0] == 2


def test_the_estimate_follows_a_slow_loss(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run(capsys, "ramp_loss", "--seeds", 5, "--noise", "none", "--out", tmp_path)
    flights = [json.loads(line) for line in kept(tmp_path)]
    assert len(flights) == 5
    for flight in flights:
        assert flight["truth_end"] == pytest.approx(0.5 * flight["truth_before"], rel=0.05)
        assert 0.0 < flight["bank"]["late_error_now"] < 0.15, flight["seed"]


def test_false_alarms_are_counted_over_the_hours_in_which_they_would_be_false() -> None:
    (cell,) = plan(["roll_doublet_tail_fault"], ["low"], [], dither=True)
    estimator = dict.fromkeys(
        ("settle_s", "rms_before", "rms_after", "rms_after_now", "peak_error", "late_error", "late_error_now")
    )
    part = {"share": 0.5, "number": 10, "of": 40}

    def row(**changes: Any) -> dict[str, Any]:
        made = {
            "error": None,
            "faults": [{"detected": True, "delay_s": 0.04}],
            "false_alarms": 0,
            "exposed_s": 90.0,
            "coverage": {"a": part, "b": {"share": None, "number": 0, "of": 40}},
            "named": {"rightly": 1, "wrongly": 0, "not": 0, "z": [0.5]},
            "reliable_share_before": 0.5,
            "dither": {
                "predicted_g_max": 0.012 + 0.001 * changes.get("false_alarms", 0),
                "predicted_g_rms": 0.011,
                "realised_g_rms": 0.01,
                "realised_of_limit": 0.8,
                "realised_of_limit_1s_max": 0.9,
            },
            "finite": True,
            **{name: {**estimator, "finite": True} for name in ("bank", "msls", "rls")},
        }
        return {**made, **changes}

    missed = {"detected": False, "delay_s": None}
    lost = {"error": "lost"}
    full = {"a": {**part, "share": 1.0, "number": 30}, "b": part}
    rows = [row(false_alarms=2), row(false_alarms=1, faults=[missed], coverage=full), row(finite=False), lost]
    found = summarise(cell, rows)
    assert (found["false_alarms"], found["exposed_h"], found["false_alarms_per_h"]) == (3, 270.0 / 3600.0, 40.0)
    assert (found["flights"], found["failed"], found["detected"], found["missed"]) == (4, 1, 2, 1)
    assert found["delay_s"] == {"median": 0.04, "low": 0.04, "high": 0.04}
    assert found["coverage"]["a"] == {"share": 0.8, "number": 50, "of": 120}
    assert found["coverage"]["b"]["share"] == 0.5
    assert found["not_finite"]["flight"] == 1 and found["errors"] == ["lost"]
    empty = summarise(cell, [])
    assert (empty["false_alarms_per_h"], empty["delay_s"], empty["dither"]) == (None, None, None)
    assert found["dither"]["predicted_g_max"] == 0.014 and found["dither"]["realised_g_rms"] == 0.01


def test_the_time_of_an_alarm_decides_whether_it_is_false() -> None:
    spans = [(4.0, 4.0), (4.5, 6.0), (11.5, 11.5)]
    assert exposed(spans, 12.0) == pytest.approx(4.0 + 4.5)
    assert exposed([], 12.0) == 12.0
    assert exposed([(4.0, 9.0), (4.5, 5.0)], 12.0) == pytest.approx(4.0 + 2.0)
    times = (3.0, 4.0, 4.02, 5.0, 7.0, 7.02, 11.9)
    assert false_alarms(spans, [(time, ("P",)) for time in times]) == 3


def test_what_is_no_number_has_not_settled() -> None:
    time = np.arange(0.0, 10.0, 0.5)
    truth, estimate = np.ones(20), np.ones(20)
    estimate[-4:] = np.nan
    assert errors(time, estimate, truth, (4.0, 4.0), 1.0)["settle_s"] == 5.5
    assert errors(time, truth, truth, (4.0, 4.0), 1.0)["settle_s"] == 0.0
    assert errors(time, truth, truth, (4.0, 4.0), 0.0)["settle_s"] is None
