"""A surface whose stamps alone are early or late is found in a bag; of a bag whose map is right nothing is said."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from inputs import mapped_messages as made
from inputs.light_aircraft import SPEED, light_aircraft
from inputs.mapped_messages import Sent, write_bag

from msls_ros.commands import inspect

SURFACES = {"de": "elevator", "da": "aileron", "dr": "rudder"}
NOISE = 0.003
"""Of the rates [rad/s]."""
MAP = """
/**:
  ros__parameters:
    effectors: [de, da, dr]
    sample_rate: 100.0
    reference_speed: {speed}
    inputs:
      topics.odometry: /odom nav_msgs/msg/Odometry
      topics.imu: /imu/data sensor_msgs/msg/Imu
{topics}
      clock: imu
      velocity: odometry twist.twist.linear frame=flu
      attitude: odometry pose.pose.orientation frame=flu/enu
      angular_velocity: imu angular_velocity frame=flu
      specific_force: imu linear_acceleration frame=flu
{effectors}
"""


def flown(late: dict[str, float], size: float) -> Iterator[Sent]:
    """Return a flight's messages, each surface on a topic of its own, some of them stamped late [s]; with noise."""
    flight, random = light_aircraft(size), np.random.default_rng(4)
    for k in range(len(flight.x)):
        stamp, imu = flight.stamp(k), made.imu(flight, k)
        for axis in "xyz":
            imu["angular_velocity"][axis] += NOISE * random.standard_normal()
        yield stamp + 300, "/imu/data", made.IMU, imu
        if k % 2 == 0:
            yield stamp + 100, "/odom", made.ODOMETRY, made.odometry(flight, k)
            for j, name in enumerate(flight.effectors):
                head = made.header(stamp + round(1e9 * late.get(name, 0.0)))
                joint = {"header": head, "name": [SURFACES[name]], "position": np.array([flight.delta[k, j]])}
                yield stamp + 200, f"/{SURFACES[name]}", made.JOINTS, joint


def said(folder: Path, capsys: pytest.CaptureFixture[str], late: dict[str, float], size: float = 1.0) -> list[Any]:
    """Inspect such a bag; return all findings of delays."""
    bag = folder / "bag"
    if not bag.exists():
        write_bag(bag, flown(late, size), folder / "definitions")
    return inspected(bag, capsys, {})


def inspected(bag: Path, capsys: pytest.CaptureFixture[str], delays: dict[str, str]) -> list[Any]:
    """Inspect a bag with these delays in the lines of the topics; return the findings of delays."""
    topics = [f"      topics.{n}: /{s} {made.JOINTS} {delays.get(n, '')}" for n, s in SURFACES.items()]
    effectors = [f"      effectors.{n}: {n} position[name={s}]" for n, s in SURFACES.items()]
    path = bag.parent / "map.yaml"
    path.write_text(MAP.format(speed=SPEED, topics="\n".join(topics), effectors="\n".join(effectors)))
    inspect.main([str(bag), "--params", str(path), "--json"])
    return [f for f in json.loads(capsys.readouterr().out)["findings"] if f["kind"] in ("delay", "servo_lag")]


@pytest.mark.parametrize(("name", "late"), [("da", 0.06), ("de", 0.1), ("dr", -0.1)])
def test_a_surface_stamped_late_or_early_alone_is_named_with_what_to_write(
    name: str, late: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (found,) = said(tmp_path, capsys, {name: late})
    assert found["level"] != "note" and found["where"] == f"inputs.effectors.{name}", found
    assert f"too {'late' if late > 0 else 'early'} against the other surfaces" in found["what"]
    match = re.search(r"in its topic's line: (delay=(\S+?))(;|$)", found["change"])
    assert match and float(match[2]) == pytest.approx(late, abs=0.011), found
    (again,) = inspected(tmp_path / "bag", capsys, {name: match[1]})
    assert again["level"] == "note" and "as the map says" in again["what"], again


@pytest.mark.parametrize("size", [0.3, 1.0])
def test_of_surfaces_that_are_stamped_rightly_none_is_named(
    size: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (found,) = said(tmp_path, capsys, {}, size)
    assert found["level"] == "note" and "as the map says" in found["what"], found


def test_a_common_delay_is_that_of_all_surfaces(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (found,) = said(tmp_path, capsys, dict.fromkeys(SURFACES, 0.1))
    assert found["where"] == "inputs.effectors" and "answers 100 ms before the surfaces" in found["what"], found


def test_a_surface_that_hardly_moves_is_not_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert not [f for f in said(tmp_path, capsys, {"dr": 0.1}, 0.02) if "against the other surfaces" in f["what"]]
