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

from msls_ros.inputs.findings import NOTE, WRONG, Finding


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


@pytest.mark.parametrize("command", [STEPS, through_servo(STEPS), np.rint(500.0 * through_servo(STEPS)), BINARY])
def test_a_deflection_that_rests_at_the_levels_of_an_input_is_not_saturated(command: Any) -> None:
    assert saturations(command / np.abs(command).max()) == []


@pytest.mark.parametrize(
    "command", [np.clip(1.2 * STICK, -1.0, 1.0), np.clip(4.0 * STICK, -1.0, 1.0), RESTED, np.minimum(STICK, 0.5)]
)
def test_a_command_that_goes_beyond_a_limit_is_saturated(command: Any) -> None:
    assert saturations(command)
