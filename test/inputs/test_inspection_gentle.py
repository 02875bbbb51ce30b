"""A gentle flight of a light aircraft: no unit is named by which it hardly flies, no delay that does not stand out."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from inputs.inspected import recorded
from inputs.light_aircraft import SPEED, light_aircraft
from inputs.mapped_messages import Flight

from msls_ros.inputs.findings import DOUBTFUL, NOTE, WRONG, Finding

GENTLE, NORMAL = 0.3, 1.0
HIDES = 0.002
"""Noise of the attitude [rad], which makes .1 m/s of the velocity over ground: it hides how a gentle flight changes."""
MAPS = {
    "frame=flu": "frame=frd",
    "frame=enu": "frame=frd",
    "frame=ned": "frame=frd",
    "scale=1.943844": "it is in knots",
    "scale=3.6": "it is in km/h",
    "scale=3.28084": "it is in ft/s",
    "scale=100": "it is in cm/s",
}
"""What a wrong map says of the velocity, and what mends it."""


def motion(found: list[Finding]) -> list[Finding]:
    return [f for f in found if f.kind == "motion" and f.level != NOTE]


@pytest.mark.parametrize("size", [GENTLE, NORMAL])
@pytest.mark.parametrize("wrong", MAPS)
def test_the_mend_of_a_velocity_is_named_in_a_gentle_flight_as_in_another(wrong: str, size: float) -> None:
    found = motion(recorded(light_aircraft(size), speed=SPEED, velocity=f"log velocity {wrong}"))
    assert len(found) == 1 and MAPS[wrong] in found[0].change, found
    assert "mm/s" not in found[0].change and ("cm/s" in found[0].change) == (wrong == "scale=100")


@pytest.mark.parametrize("wrong", MAPS)
def test_where_noise_hides_it_the_mend_is_not_excluded_and_no_other_is_certain(wrong: str) -> None:
    found = recorded(light_aircraft(GENTLE), HIDES, speed=SPEED, velocity=f"log velocity {wrong}")
    named = [f for f in motion(found) if MAPS[wrong] not in f.change]
    assert named == [] and not any("mm/s" in f.change for f in found)
    if not motion(found):
        assert any("frame and unit of the velocity are not seen" in f.what for f in found), found


@pytest.mark.parametrize("noise", [0.0, HIDES])
@pytest.mark.parametrize("size", [GENTLE, NORMAL])
def test_a_right_map_of_a_gentle_flight_has_no_finding(size: float, noise: float) -> None:
    found = recorded(light_aircraft(size), noise, speed=SPEED)
    assert [f for f in found if f.level != NOTE and f.kind != "excitation"] == []
    assert any(f.kind == "delay" and "as the map says" in f.what for f in found)


def test_no_speed_that_no_aircraft_flies_becomes_the_reference() -> None:
    found = recorded(light_aircraft(GENTLE), speed=SPEED, velocity="log velocity scale=0.001")
    (speed,) = (f for f in found if f.kind == "reference_speed")
    assert speed.level == DOUBTFUL and "no aircraft flies so" in speed.change and "reference_speed:" not in speed.change


def test_a_speed_in_another_unit_is_named_beside_another_reference() -> None:
    found = recorded(light_aircraft(GENTLE), HIDES, speed=SPEED, velocity="log velocity scale=3.6")
    (speed,) = (f for f in found if f.kind == "reference_speed")
    assert speed.change.startswith("reference_speed: 190") and "in km/h" in speed.change


def stamped(flight: Flight, late: int) -> Flight:
    """Return a flight whose surfaces are stamped so many samples late; early, where that is negative."""
    n = len(flight.x) - abs(late)
    motion, surfaces = (slice(late, late + n), slice(0, n)) if late > 0 else (slice(0, n), slice(-late, n - late))
    return replace(flight, x=flight.x[motion], xdot=flight.xdot[motion], delta=flight.delta[surfaces])


@pytest.mark.parametrize("late", [-200, -130, -70, -30, 30, 70, 130, 200, 290])
@pytest.mark.parametrize("noise", [0.0, HIDES])
def test_surfaces_that_are_stamped_far_off_are_found(late: int, noise: float) -> None:
    found = [f for f in recorded(stamped(light_aircraft(NORMAL), late), noise, speed=SPEED) if f.kind == "delay"]
    assert [f.level for f in found] == [WRONG], found
    match = re.search(r"delay=(\S+)", found[0].change)
    assert match and float(match[1]) == pytest.approx(0.01 * late, abs=0.011), found


@pytest.mark.parametrize("late", [-700, -500, 500, 700, 900])
def test_where_no_delay_stands_out_none_is_certified(late: int) -> None:
    found = recorded(stamped(light_aircraft(NORMAL), late), HIDES, speed=SPEED)
    assert not any("as the map says" in f.what or f.kind == "delay" for f in found), found
    assert [f.level for f in found if f.kind == "response"] == [DOUBTFUL]


def test_surfaces_of_another_flight_are_not_certified() -> None:
    own, other = light_aircraft(NORMAL), light_aircraft(NORMAL, 60.0)
    mixed = np.random.default_rng(0).permutation(other.delta[: len(own.delta)].reshape(-1, 100, 3)).reshape(-1, 3)
    found = recorded(replace(own, delta=mixed), HIDES, speed=SPEED)
    assert [f.level for f in found if f.kind == "response"] == [DOUBTFUL], found
