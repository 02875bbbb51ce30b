"""What an inspection of a bag advises for delays and units is what the map lacks, and is of use to its identifier."""

from __future__ import annotations

import json
import re
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from inputs import mapped_messages as made
from inputs.mapped_messages import Flight, Sent, rigid_flight, write_bag

from msls_ros.bags import open_any
from msls_ros.commands import inspect
from msls_ros.inputs import InputMap
from msls_ros.inputs.profiles import config_folder
from msls_ros.offline.opening import chosen_parameters

SHIPPED = Path(__file__).parents[2] / "config" / "inputs" / "px4_odometry.yaml"
SERVOS = "/fmu/out/actuator_servos"


@cache
def flown() -> Flight:
    return rigid_flight(20.0, bank=0.06)


def recorded(folder: Path, late_us: int = 0) -> Path:
    """Write the flight as PX4 does, servos stamped so much later."""
    sent: list[Sent] = []
    for logged, topic, msgtype, fields in made.px4(flown()):
        if topic == SERVOS:
            fields = {**fields, "timestamp_sample": fields["timestamp_sample"] + late_us}
        sent.append((logged, topic, msgtype, fields))
    return write_bag(folder / "bag", iter(sent), folder / "definitions")


def inspected(
    bag: Path, capsys: pytest.CaptureFixture[str], *changes: tuple[str, str], method: str = "bank"
) -> list[dict[str, Any]]:
    """Inspect a bag with the shipped map, changed; return the findings that are no notes."""
    text = SHIPPED.read_text()
    for old, new in (*changes, ("    inputs:\n", f"    estimator.method: {method}\n    inputs:\n")):
        assert old in text
        text = text.replace(old, new)
    path = bag.parent / "map.yaml"
    path.write_text(text)
    inspect.main([str(bag), "--params", str(path), "--json", "--definitions", str(bag.parent / "definitions")])
    findings = json.loads(capsys.readouterr().out)["findings"]
    return [f for f in findings if f["level"] != "note"]


def test_the_shipped_map_fits_its_bag(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = inspected(recorded(tmp_path), capsys)
    assert [f for f in found if f["kind"] in ("delay", "motion", "stamps", "names", "misalignment")] == []


def test_the_unit_that_is_advised_is_that_of_the_stamps(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = [f for f in inspected(recorded(tmp_path), capsys, ("unit=us", "unit=ms")) if f["kind"] == "stamps"]
    assert len(found) == 3 and {f["change"] for f in found} == {"unit=us, as the stamps count"}


@pytest.mark.parametrize(("late_us", "words"), [(20_000, "larger"), (-40_000, "smaller")])
def test_a_delay_is_changed_by_a_positive_number_and_what_to_write_is_said(
    late_us: int, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (found,) = (f for f in inspected(recorded(tmp_path, late_us), capsys) if f["kind"] == "delay")
    match = re.search(r"delay (larger|smaller) by (\S+) s in the topic's line: delay=(\S+)", found["change"])
    assert match and match[1] == words, found
    change, written = float(match[2]), float(match[3])
    assert change == pytest.approx(abs(late_us) * 1e-6, abs=0.011)
    assert written == pytest.approx(-0.02 + change * np.sign(late_us), abs=0.002)
    again = inspected(tmp_path / "bag", capsys, ("delay=-0.02", f"delay={written}"))
    assert not [f for f in again if f["kind"] == "delay"]


@pytest.mark.parametrize("late_us", [-40_000, 30_000])
def test_what_the_identifier_finds_itself_makes_no_numbers_wrong(
    late_us: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = recorded(tmp_path, late_us)
    said = {m: next(f for f in inspected(bag, capsys, method=m) if f["kind"] == "delay") for m in ("bank", "msls")}
    assert said["bank"]["level"] == "doubtful" and "the identifier looks for as much" in said["bank"]["what"]
    assert "B is wrong by it" in said["msls"]["what"]


@pytest.mark.parametrize(("namespace", "resolved"), [("/uav1", "/uav1/imu/data"), (None, "/imu/data")])
def test_relative_names_of_topics_are_resolved_in_the_namespace_as_the_node_does(
    tmp_path: Path, namespace: str | None, resolved: str
) -> None:
    shipped = (config_folder() / "inputs" / "odometry_jointstate.yaml").read_text()
    file = tmp_path / "map.yaml"
    file.write_text(shipped.replace("/imu/data sensor", "imu/data sensor"))
    chosen = chosen_parameters(open_any(recorded(tmp_path)), str(file), namespace)
    assert isinstance(chosen.inputs, InputMap)
    assert [source.topic for source in chosen.inputs.topics.values()] == ["/odom", resolved, "/joint_states"]
