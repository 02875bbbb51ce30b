"""Rates that are turned against the attitude are found in bags; attitudes that follow badly are no such rotation."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from inputs import mapped_messages as made
from inputs.mapped_messages import Array, Flight, Sent, rigid_flight, write_bag

from msls_ros.commands import inspect
from msls_ros.inputs.misalignment import misalignment
from msls_ros.inputs.motion import Motion, Reading

DEGREE = float(np.radians(1.0))
SECONDS = 24.0


@cache
def flown() -> Flight:
    return replace(rigid_flight(SECONDS, bank=0.06), effectors=("elevator", "aileron", "rudder"))


def turn(axis: int, degrees: float) -> Array:
    """Matrix (3, 3) by which a vector is turned about an axis."""
    return made.rotation(degrees * DEGREE * np.eye(3)[axis])


def askew(matrix: Array) -> Iterator[Sent]:
    """Return the messages of a flight whose IMU has other axes, with noise of .01 rad/s and .1 m/s^2."""
    random = np.random.default_rng(1)
    in_flu = made.FRD_OF_FLU @ matrix @ made.FRD_OF_FLU
    for logged, topic, msgtype, fields in made.standard(flown()):
        if topic == "/imu/data":
            for name, noise in (("angular_velocity", 0.01), ("linear_acceleration", 0.1)):
                values = in_flu @ np.array(list(fields[name].values())) + noise * random.standard_normal(3)
                fields[name] = dict(zip("xyz", values.tolist(), strict=True))
        yield logged, topic, msgtype, fields


def said(folder: Path, matrix: Array, capsys: pytest.CaptureFixture[str]) -> list[str]:
    """Inspect a bag of such messages; return the lines of its rates."""
    bag = write_bag(folder / "bag", askew(matrix), folder / "definitions")
    inspect.main([str(bag), "--params", "odometry_jointstate"])
    return [line for line in capsys.readouterr().out.splitlines() if "rates look turned" in line]


@pytest.mark.parametrize(("axis", "degrees"), [(1, 5.0), (1, -5.0), (2, 5.0), (0, 5.0)])
def test_an_imu_that_is_mounted_askew_is_found_with_axis_and_angle(
    axis: int, degrees: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (line,) = said(tmp_path, turn(axis, degrees), capsys)
    angle, axes = line.split("turned by ")[1].split(" +- ")[0], line.split("deg about ")[1][0]
    assert axes == "xyz"[axis] and line.count("deg about") == 1
    assert abs(float(angle) + degrees) < 0.7, line


@pytest.mark.parametrize("degrees", [0.0, 1.5])
def test_an_imu_that_is_mounted_well_or_nearly_so_is_not_complained_of(
    degrees: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert said(tmp_path, turn(1, degrees), capsys) == []


def late(x: Array) -> Array:
    return np.vstack([np.repeat(x[:1], 4, axis=0), x[:-4]])


def leaning(x: Array) -> Array:
    """Return an attitude whose bank is drawn to none, as in turns by an accelerometer, within 5 s."""
    bank, rest = np.array(x[:, 0]), x[0, 0]
    for k in range(1, len(x)):
        rest += x[k, 0] - x[k - 1, 0] - 0.002 * rest
        bank[k] = rest
    return np.column_stack([bank, x[:, 1:]])


def drawn(x: Array) -> Array:
    """Return an attitude whose heading a magnetometer draws aside in banks."""
    return np.column_stack([x[:, :2], x[:, 2] + 0.12 * np.sin(x[:, 0])])


ATTITUDES: dict[str, Callable[[Array], Array]] = {
    "as it is": lambda x: x, "40 ms late": late, "leaning": leaning, "heading drawn": drawn,
    "rounded to .1 deg": lambda x: np.round(x / (0.1 * DEGREE)) * 0.1 * DEGREE,
}  # fmt: skip


@pytest.mark.parametrize("name", ATTITUDES)
@pytest.mark.parametrize("scale", [(1.0, 1.0, 1.0), (1.05, 0.95, 1.05)])
def test_other_errors_of_attitude_and_gyroscopes_are_no_rotation(name: str, scale: tuple[float, ...]) -> None:
    found = misalignment(motion(ATTITUDES[name], np.eye(3) * scale), Reading())
    assert found is not None
    assert not any(shown and abs(a) > max(3.0 * DEGREE, 5.0 * s) for a, s, shown in
                   zip(found.angle, found.std, found.shown, strict=True)), found  # fmt: skip


@pytest.mark.parametrize("name", ["as it is", "40 ms late", "rounded to .1 deg"])
def test_a_rotation_is_measured_through_them(name: str) -> None:
    found = misalignment(motion(ATTITUDES[name], turn(2, 5.0) * 1.03), Reading())
    assert found is not None and found.shown[2]
    assert abs(found.angle[2] + 5.0 * DEGREE) < max(0.5 * DEGREE, 3.0 * found.std[2])


def test_without_rates_or_in_a_short_flight_nothing_is_said() -> None:
    short: dict[str, Any] = {"step": 0.02, "euler": flown().x[:700:2, 6:9]}
    assert misalignment(Motion(**short), Reading()) is None
    assert misalignment(Motion(**short, rates=flown().x[:700:2, 3:6]), Reading()) is None


def motion(attitude: Callable[[Array], Array], sensor: Array) -> Motion:
    """Return the motion of the flight at 50 Hz, as such an attitude and such gyroscopes show it."""
    x = flown().x
    return Motion(0.02, euler=attitude(x[:, 6:9])[::2], rates=(x[:, 3:6] @ sensor.T)[::2])
