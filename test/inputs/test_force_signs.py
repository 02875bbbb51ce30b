"""A sign of the accelerometer that is wrong is found where the weight hides it; gusts, noise and a far IMU are none."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from inputs import mapped_messages as made
from inputs.mapped_messages import Array, Flight, rigid_flight, write_bag

from msls_ros.commands import inspect
from msls_ros.inputs.force_signs import check_force_signs, force_slopes
from msls_ros.inputs.mends import LIMITS
from msls_ros.inputs.motion import Motion, Reading

ARM = np.array([0.3, 0.05, 0.1])


@cache
def flown() -> Flight:
    return rigid_flight(40.0, bank=0.06, side=0.3)


@cache
def felt() -> Array:
    return np.array([flown().force(k) for k in range(len(flown().x))])


def motion(signs: tuple[float, ...] = (1, 1, 1), noise: float = 0.0, far: bool = False, gusts: float = 0.0) -> Motion:
    """Return the flight at 50 Hz; noise [m/s, rad/s] of velocity and rates, ten times as much of forces."""
    random, x = np.random.default_rng(2), flown().x
    n = (len(x), 3)
    force = felt() * signs
    if far:
        omega = x[:, 3:6]
        force = force + np.cross(flown().xdot[:, 3:6], ARM) + np.cross(omega, np.cross(omega, ARM))
    air = np.cumsum(random.standard_normal(n), axis=0)
    air = gusts * (air - air.mean(axis=0)) / air.std(axis=0)
    velocity = x[:, :3] + noise * random.standard_normal(n) + air
    rates = x[:, 3:6] + 0.1 * noise * random.standard_normal(n)
    force = force + 2.0 * noise * random.standard_normal(n)
    return Motion(
        0.02, euler=x[::2, 6:9], rates=rates[::2], velocity=velocity[::2], force=force[::2], apart=2
    )  # fmt: skip


@pytest.mark.parametrize("signs", [(1, -1, 1), (-1, 1, 1), (-1, -1, 1)])
@pytest.mark.parametrize("noise", [0.0, 0.02])
@pytest.mark.parametrize("far", [False, True])
def test_a_wrong_sign_is_found_and_named_where_the_misfit_is_within_its_limit(
    signs: tuple[float, ...], noise: float, far: bool
) -> None:
    flight = motion(signs, noise, far)
    assert flight.misfits(Reading())["force"] < LIMITS["force"]
    (found,) = check_force_signs(flight, Reading(), "inputs.specific_force")
    assert found.change == "scale=" + ",".join(map(str, signs)), found


@pytest.mark.parametrize("noise", [0.0, 0.02, 0.2])
@pytest.mark.parametrize("gusts", [0.0, 0.3, 3.0])
@pytest.mark.parametrize("far", [False, True])
def test_right_signs_are_not_complained_of(noise: float, gusts: float, far: bool) -> None:
    assert list(check_force_signs(motion((1, 1, 1), noise, far, gusts), Reading(), "inputs.specific_force")) == []


def test_the_slopes_are_one_and_their_errors_hold() -> None:
    found = force_slopes(motion(noise=0.02), Reading())
    assert found is not None
    slopes, errors = found
    assert (np.abs(slopes - 1.0) < np.maximum(4.0 * errors, 0.02)).all(), found


def test_without_rates_or_in_a_short_flight_nothing_is_said() -> None:
    whole = motion()
    assert force_slopes(Motion(0.02, euler=whole.euler, velocity=whole.velocity, force=whole.force), Reading()) is None
    parts = {name: getattr(whole, name)[:350] for name in ("euler", "rates", "velocity", "force")}
    assert force_slopes(Motion(0.02, **parts), Reading()) is None


@pytest.mark.parametrize("signs", ["1,1,1", "1,-1,1"])
def test_a_bag_whose_side_force_has_the_wrong_sign_is_refused(
    signs: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    flight = replace(flown(), effectors=("elevator", "aileron", "rudder"))
    bag = write_bag(tmp_path / "bag", made.standard(flight), tmp_path / "definitions")
    text = (Path(__file__).parents[2] / "config" / "inputs" / "odometry_jointstate.yaml").read_text()
    line = re.search(r'specific_force: "(.*)"', text)
    assert line
    (tmp_path / "map.yaml").write_text(text.replace(line[1], f"{line[1]} scale={signs}"))
    refused = inspect.main([str(bag), "--params", str(tmp_path / "map.yaml")])
    assert (refused == 1) == ("-" in signs) == (f"change: scale={signs}" in capsys.readouterr().out)
