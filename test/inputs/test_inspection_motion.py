"""Whether frames, signs and units agree with the motion: in noise and in banks, where a right map has no finding."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from inputs.inspected import (
    EULER,
    FORCE,
    OVER_GROUND,
    RATES,
    VANES,
    VELOCITY,
    Message,
    banking,
    look,
    messages_of,
    of,
    recorded,
    vector,
)

from msls_ros.inputs.check_effectors import speed_of_flight
from msls_ros.inputs.findings import NOTE, WRONG


def with_noise() -> Callable[[Message], Message]:
    """Return what adds the noise of real sensors to messages."""
    random = np.random.default_rng(3)

    def noisy(message: Message) -> Message:
        for path, size in ((RATES, 0.02), (FORCE, 0.5), (VELOCITY, 0.15)):
            message = of(*path)(vector(lambda x, size=size: x + size * random.standard_normal()))(message)  # type: ignore[misc]
        for name, size in (("tas", 0.3), ("alpha", 0.01), ("beta", 0.01), ("vn", 0.15), ("ve", 0.15), ("vd", 0.15)):
            message = of("/air", name)(lambda x, size=size: x + size * random.standard_normal())(message)  # type: ignore[misc]
        return message

    return noisy


@pytest.mark.parametrize("lines", [{}, VANES, OVER_GROUND, EULER])
def test_noise_of_real_sensors_is_no_finding(lines: dict[str, Any]) -> None:
    assert [f for f in look(lines, with_noise()) if f.level == WRONG] == []


@pytest.mark.parametrize("side", [1.0, 0.1, 0.0])
@pytest.mark.parametrize("noise", [False, True])
def test_gravity_that_turns_with_a_banking_aircraft_is_no_side_force(side: float, noise: bool) -> None:
    """An aircraft without a fin, whose accelerometer feels hardly anything to the side, banks all the same."""
    flight = banking(side)
    assert np.ptp(flight.x[:, 6]) > 1.0
    change = with_noise() if noise else lambda message: message
    assert [f for f in look({}, change, messages_of(flight)) if f.kind == "motion" and f.level != NOTE] == []


def test_a_side_force_of_the_wrong_sign_is_found_in_banks_too() -> None:
    wrong = {"specific_force": "imu linear_acceleration frame=flu scale=1,-1,1"}
    found = [f for f in look(wrong, sent=messages_of(banking(1.0))) if f.kind == "motion"]
    assert [f.level for f in found] == [WRONG] and "scale=1,-1,1" in found[0].change


def test_the_speed_of_flight_is_that_in_the_air_where_a_log_begins_and_ends_at_rest() -> None:
    flown = np.random.default_rng(0).normal(20.0, 1.0, (300, 1))
    log = np.vstack([np.zeros((500, 1)), np.linspace(0.0, 20.0, 50)[:, None], flown, np.zeros((400, 1))])
    assert speed_of_flight(log) == pytest.approx(20.0, abs=0.5)
    assert speed_of_flight(np.hstack([log, 0.0 * log, 0.0 * log])) == pytest.approx(20.0, abs=0.5)


@pytest.mark.parametrize("noise", [0.006, 0.015])
def test_noise_of_attitude_and_rates_is_no_wrong_frame(noise: float) -> None:
    found = recorded(banking(1.0), noise)
    assert [f for f in found if f.kind == "motion" and f.level != NOTE] == []


@pytest.mark.parametrize("signs", ["-1,1,1", "1,-1,1", "1,1,-1"])
def test_a_wrong_sign_of_a_rate_is_found_in_that_noise(signs: str) -> None:
    found = recorded(banking(1.0), 0.006, angular_velocity=f"log rates scale={signs}")
    assert [f.level for f in found if f.kind == "motion"] == [WRONG], found
