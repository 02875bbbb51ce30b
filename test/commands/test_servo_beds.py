"""The flights of small aircraft by the commands to their servos."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks import calibration
from benchmarks.servo_beds import QUANTUM, SMALLS, ServoBed, derivative, fly, servo_beds, trim, truth


def bed(small: str) -> ServoBed:
    found = next(one for one in servo_beds() if one.small == small and one.rate == 50 and one.gusts == 0.0)
    return replace(found, duration=4.0, steps=True)


@pytest.mark.parametrize("name", SMALLS)
def test_they_fly_straight_when_trimmed_and_answer_their_surfaces(name: str) -> None:
    one = SMALLS[name]
    x, delta, thrust = trim(one)
    rates, felt = derivative(one, x, delta, thrust, np.zeros(3))
    np.testing.assert_allclose(rates[:6], 0.0, atol=1e-8)
    assert felt[2] == pytest.approx(-9.80665 * np.cos(x[7]), abs=1e-6)
    a, b = truth(one, x, delta, thrust, np.zeros(3))
    assert a[3, 3] < -5.0
    assert a[4, 2] < 0.0
    assert b[4, 0] < 0.0 < b[3, 1]
    small = 1e-3 * np.eye(3)[1]
    moved, _ = derivative(one, x, delta + small, thrust, np.zeros(3))
    np.testing.assert_allclose(moved[3:6] - rates[3:6], b[3:6] @ small, rtol=1e-6, atol=1e-9)


def test_a_flight_is_the_same_for_the_same_seed_and_holds_commands() -> None:
    first, again, other = fly(bed("aerosonde"), 1), fly(bed("aerosonde"), 1), fly(bed("aerosonde"), 2)
    for name, value in vars(first).items():
        np.testing.assert_array_equal(value, vars(again)[name])
    assert (first.x != other.x).any()
    steps = first.delta / QUANTUM
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)
    assert len(first.time) == 200
    assert first.truth_b.shape[1:] == (9, 3)


def test_what_is_commanded_acts_late_and_through_the_servo() -> None:
    """Roll acceleration goes with the aileron of two samples ago, not with that of now."""
    flight = fly(replace(bed("tenth"), duration=20.0), 3)
    rolling = flight.xdot[:, 3] - flight.x[:, 3] * flight.truth_a[0, 3, 3]
    together = [np.corrcoef(rolling[5:], flight.delta[5 - back : len(rolling) - back, 1])[0, 1] for back in range(6)]
    assert int(np.argmax(together)) >= 2


def test_they_are_beds_of_calibration_through_mapped_inputs_alone() -> None:
    found = calibration.beds("servos")
    assert {one.group for one in found} == {"servo commands"}
    one = replace(bed("measured"), duration=8.0)
    row = calibration.judge(one, 1, fly(one, 1), "mapped", one.configuration(1))
    assert row["faults"] == row["false_alarms"] == 0
    assert row["phases"]["B"]["1-4 s"][0] > 0
