"""The benchmark of errors: what it says is what the flights show, and what the bank must reach on them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks import accuracy
from benchmarks.calibration_beds import Bed, Recorded, f16_beds, flight_test_beds, record


def test_delayed_deflections_are_predicted_by_what_they_were() -> None:
    """A model without error predicts all of the variance where its delay is known, and little where it is not."""
    (bed,) = flight_test_beds(("A4",), (50,), ("smooth",))
    configuration = bed.configuration(1)
    time = np.arange(3000) / 50.0
    delta = np.sin(np.outer(8.0 * time, [1.0, 1.3, 1.7]))
    x, xdot = np.zeros((len(time), 9)), np.zeros((len(time), 9))
    xdot[:, 4] = 2.0 + 3.0 * np.interp(time - 0.1, time, delta[:, 0])
    flight = Recorded(time, x, xdot, delta, time[:2], np.zeros((2, 9, 9)), np.zeros((2, 9, 3)))
    last = accuracy.estimates_of(configuration.replace(accuracy.BATCH), flight)[-1]
    b = np.zeros((9, 3))
    b[4, 0] = 3.0
    model = replace(last, a=np.zeros((9, 9)), b=b, delay=0.1)
    assert accuracy.r_squared(configuration, model, flight, accuracy.KEYS[0]) == pytest.approx(1.0, abs=1e-3)
    assert accuracy.r_squared(configuration, replace(model, delay=0.0), flight, accuracy.KEYS[0]) < 0.6


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """The rows of a smooth flight test of the J-3, in which nothing but its inputs moves it."""
    (bed,) = flight_test_beds(("J3Cub",), (25,), ("smooth",))
    again = replace(bed, scenario=replace(bed.scenario, manoeuvre_scale=accuracy.REPEAT))
    return accuracy.judge_flight_test(bed, 811, record(bed, 811, None), record(again, 5811, None))


def test_what_an_elevator_input_taught_is_still_known_two_minutes_of_other_inputs_later(flown: dict[str, Any]) -> None:
    bank = flown["methods"]["bank"]
    assert bank["end"]["Q/de"] < 0.12  # .08 before effects went with airspeed: this elevator lies in the slipstream
    assert bank["r2_lost"]["Q"] < 0.05
    others = [method["end"]["Q/de"] for name, method in flown["methods"].items() if name != "bank"]
    assert min(others) > 2.0 * bank["end"]["Q/de"]


def test_the_truth_is_nearer_than_batch_is_to_it(flown: dict[str, Any]) -> None:
    for key in ("P/da", "P/P", "R/dr", "R/v"):
        assert flown["methods"]["bank"]["truth"][key] < 0.6 * flown["batch_to_truth"][key], key
    assert flown["delay"] == pytest.approx(0.014, abs=0.005)


def test_two_jobs_give_the_same_table_as_one(monkeypatch: pytest.MonkeyPatch) -> None:
    beds = [replace(bed, scenario=replace(bed.scenario, duration=7.0)) for bed in f16_beds(("half_loss",))]
    monkeypatch.setattr(accuracy, "f16_cells", lambda: beds[:2])
    alone, together = (accuracy.measure([1], None, lambda text: None, ["f16"], jobs=jobs) for jobs in (1, 2))
    assert len(alone["f16"]["cells"]) >= 6
    assert json.dumps(together) == json.dumps(alone)


def test_an_interrupted_run_goes_on_and_the_tables_are_json_and_text(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, flown: dict[str, Any]
) -> None:
    (bed,) = flight_test_beds(("J3Cub",), (25,), ("smooth",))
    (doublet,) = f16_beds(("roll_doublet_tail_fault",), ("low",))
    judged: list[int] = []

    def judge(bed: Bed, seed: int, *flights: Recorded) -> dict[str, Any]:
        judged.append(seed)
        return flown | {"seed": seed}

    monkeypatch.setattr(accuracy, "smooth_beds", lambda others: [bed])
    monkeypatch.setattr(accuracy, "f16_cells", lambda: [doublet])
    monkeypatch.setattr(accuracy, "record", lambda bed, seed, folder: None)
    monkeypatch.setattr(accuracy, "judge_flight_test", judge)
    errors = {"bank": {"watched before": 0.01}, "MSLS": {"watched before": 0.04}, "RLS": {"watched before": 0.02}}
    monkeypatch.setattr(accuracy, "judge_f16", lambda bed, seed, _: {"bed": bed.name, "seed": seed, "errors": errors})
    accuracy.measure([1], tmp_path, lambda text: None, ["flight_test"])
    result = accuracy.measure([1, 2], tmp_path, lambda text: None, ["f16", "flight_test"])
    assert judged == [1, 2]
    json.dumps(result)
    assert result["f16"]["geometric_mean"] == pytest.approx(0.5)
    text = accuracy.render(result)
    assert "J3Cub 25 Hz smooth" in text and "geometric mean 0.50" in text
