"""What is found of surfaces in a flight with a law that feeds back: delays, and commands beyond a limit."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from inputs import mapped_messages as made
from inputs.inspected import recorded
from inputs.mapped_messages import Flight

from msls_ros.inputs.findings import DOUBTFUL, NOTE, WRONG, Finding


@cache
def fed_back() -> Flight:
    """Return a flight of a wing with two elevons, roll damping 20 1/s, whose law feeds bank, pitch and rates back."""
    n, step, parts = 3000, 0.01, 5
    random = np.random.default_rng(2)
    x, states, rates, delta = made.TRIM.copy(), np.empty((n, 9)), np.empty((n, 9)), np.empty((n, 2))
    rest = -made.rotation(made.TRIM[6:]).T @ np.array([0.0, 0.0, made.GRAVITY])
    moments = np.array([[0, -2.0, 0, -20.0, 0, 3.0], [0, 0, -4.0, 0, -4.0, 0], [0, 0.6, 0, -0.3, 0, -0.6]])
    wanted = np.repeat(random.uniform(-1.0, 1.0, (n // 60, 2)), 60, axis=0) * [0.5, 0.1]
    servo = np.zeros(2)
    for k in range(n):
        for part in range(parts):
            off = x - made.TRIM
            roll = 0.06 * (4.0 * (wanted[k, 0] - x[6]) - x[3])
            pitch = 0.12 * (3.5 * (wanted[k, 1] - off[7]) - x[4])
            turn = x[4] * math.sin(x[6]) + x[5] * math.cos(x[6])
            euler = [x[3] + math.tan(x[7]) * turn, x[4] * math.cos(x[6]) - x[5] * math.sin(x[6]), turn / math.cos(x[7])]
            force = rest + np.diag([-0.1, -0.5, -5.0]) @ off[:3] + [0.0, 0.0, -8.0 * servo.sum()]
            down = made.rotation(x[6:]).T @ np.array([0.0, 0.0, made.GRAVITY])
            effect = [90.0 * (servo[0] - servo[1]), -50.0 * servo.sum(), 0.0]
            slope = np.concatenate([force + down - np.cross(x[3:6], x[:3]), moments @ off[:6] + effect, euler])
            if part == 0:
                states[k], rates[k], delta[k] = x, slope, servo
            x = x + step / parts * slope
            servo = servo + step / parts * 25.0 * (np.array([roll - pitch, -roll - pitch]) - servo)
    return Flight(effectors=("left", "right"), x=states, xdot=rates, delta=delta)


def delays(found: list[Finding]) -> list[Finding]:
    return [f for f in found if f.kind == "delay" and f.level != NOTE]


def test_damping_and_a_law_that_feeds_back_are_no_delay() -> None:
    assert delays(recorded(fed_back())) == []
    assert delays(recorded(fed_back(), noise=0.002)) == []


@pytest.mark.parametrize("noise", [0.0, 0.002])
def test_surfaces_that_are_really_late_are_found_in_that_flight(noise: float) -> None:
    found = delays(recorded(fed_back(), noise, behind=10))
    assert [f.level for f in found] == [WRONG] and re.search(r"larger by 0\.(09|10)", found[0].change), found


def test_without_a_velocity_no_change_of_a_delay_is_advised() -> None:
    found = [f for f in recorded(fed_back(), velocity=None, specific_force=None) if f.kind == "delay"]
    assert [(f.level, f.change) for f in found] == [(NOTE, "")]


def commanded(lag: float, later: int = 0) -> Flight:
    """Return that flight with the commands, held, that servos of a lag [s] follow after so many samples."""
    flight, stays = fed_back(), math.exp(-0.01 / lag)
    commands = (flight.delta[1:] - stays * flight.delta[:-1]) / (1.0 - stays)
    return replace(flight, delta=np.concatenate([commands[later:], commands[-1 - later :]])[: len(flight.delta)])


@pytest.mark.parametrize(("lag", "later"), [(0.04, 0), (0.06, 2), (0.1, 0)])
def test_of_commands_that_servos_follow_the_lag_is_said_and_no_delay_is_advised(lag: float, later: int) -> None:
    found = recorded(commanded(lag, later), 0.001, surfaces=f"delay={-0.01 * later}")
    assert not delays(found)
    (servo,) = [f for f in found if f.kind == "servo_lag"]
    assert servo.level == DOUBTFUL and f"lag of about {1e3 * lag:.0f} ms" in servo.what
    assert f"servo={lag:g} delay={-0.01 * later + 0.0:.3f}" in servo.change and "leave delay= as it is" in servo.change


def test_a_delay_beside_the_lag_of_a_servo_is_to_be_written() -> None:
    (servo,) = [f for f in recorded(commanded(0.06, 3), surfaces="") if f.kind == "servo_lag"]
    assert "30 ms later than the map says" in servo.what and "write delay=-0.03" in servo.change


@pytest.mark.parametrize("delay", [-0.05, -0.06, -0.07])
def test_a_delay_that_stands_for_the_lag_of_a_servo_is_to_be_taken_back(delay: float) -> None:
    (found,) = delays(recorded(commanded(0.06), 0.001, surfaces=f"delay={delay}"))
    assert found.level == DOUBTFUL and f"delay={delay:.3f} stands for a servo's lag" in found.what
    assert "take it down to about 0.00" in found.change and "servo=0.06 delay=0.000" in found.change


@pytest.mark.parametrize("words", ["servo=0.06 delay=-0.02", "servo=0.06 delay=-0.03"])
def test_with_its_servo_in_the_map_nothing_is_said_of_a_command(words: str) -> None:
    found = recorded(commanded(0.06, 2), 0.001, surfaces=words)
    assert not delays(found) and any("answers the surfaces as the map says" in f.what for f in found)


@pytest.mark.parametrize("late", [3, 5])
def test_a_true_delay_in_the_map_stands_for_no_servo(late: int) -> None:
    flight = fed_back()
    early = replace(flight, delta=np.concatenate([flight.delta[late:], flight.delta[-late:]]))
    found = recorded(early, 0.001, surfaces=f"delay={-0.01 * late}")
    assert not delays(found) and any("answers the surfaces as the map says" in f.what for f in found)


def test_what_is_said_of_a_short_delay_does_not_call_effects_right() -> None:
    (found,) = delays(recorded(fed_back(), 0.001, behind=4))
    assert "B may be wrong until it has found it" in found.what and "the true delay in the map" in found.change


def throttled(name: str, **parameters: Any) -> list[Finding]:
    """Inspect a flight with an effector from .2 to .98 beside the elevons."""
    flight = fed_back()
    lever = 0.59 + 0.39 * np.sin(0.3 * np.arange(len(flight.x)) * 0.01)
    columns = np.column_stack([flight.delta, lever])
    found = recorded(replace(flight, effectors=("left", "right", name), delta=columns), parameters=parameters)
    return [f for f in found if f.where.endswith(f".{name}")]


def test_an_effector_of_thrust_is_no_angle() -> None:
    assert [f.kind for f in throttled("thr")] == ["units"]
    assert throttled("thr", thrust_effectors="thr") == []


TIME = 0.01 * np.arange(3000)
STEPS = np.array([0.0, 1.0, -1.0, 1.0, -1.0, 0.0])[
    np.searchsorted([2.0, 5.0, 7.0, 8.0, 9.0], TIME % 15.0, side="right")
]


def through_servo(values: Any, rate: float = 25.0) -> Any:
    """Return what a servo of first order [1/s] makes of a command at `RATE`."""
    out, keep = np.array(values), math.exp(-0.01 * rate)
    for k in range(1, len(out)):
        out[k] = keep * out[k - 1] + (1.0 - keep) * values[k - 1]
    return out


BINARY = np.repeat(np.random.default_rng(4).choice([-1.0, 1.0], 100), 30)
STICK = np.sin(0.8 * np.pi * TIME)
RESTED = np.where(TIME < 8.0, 0.0, np.clip(2.0 * STICK, -1.0, 1.0))


def saturations(command: Any) -> list[str]:
    """Inspect a flight with this elevator, one at most; return what is said of saturation."""
    flight = replace(fed_back(), delta=np.column_stack([0.1 * command, fed_back().delta[:, 1]]))
    return [f.what for f in recorded(flight) if f.kind == "saturation"]


TRIMMED = np.interp(TIME, [8.0, 8.4, 13.6, 14.0, 25.0, 25.3], [-1.0, -0.2, -0.2, 0.8, 0.8, 0.1])
AGAIN = np.interp(TIME, [8.0, 9.5, 13.6, 15.0, 25.0, 26.3], [-1.0, -0.2, -0.2, 0.8, 0.8, -1.0])
"""A stabilizer that rests between trim moves."""


@pytest.mark.parametrize(
    "command",
    [TRIMMED, np.rint(20.0 * AGAIN), STEPS, through_servo(STEPS), np.rint(500.0 * through_servo(STEPS)), BINARY],
)
def test_a_deflection_that_rests_at_the_levels_of_an_input_is_not_saturated(command: Any) -> None:
    assert saturations(command / np.abs(command).max()) == []


@pytest.mark.parametrize(
    "command", [np.clip(1.2 * STICK, -1.0, 1.0), np.clip(4.0 * STICK, -1.0, 1.0), RESTED, np.minimum(STICK, 0.5)]
)
def test_a_command_that_goes_beyond_a_limit_is_saturated(command: Any) -> None:
    assert saturations(command)
