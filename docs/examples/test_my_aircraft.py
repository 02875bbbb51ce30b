"""Does the identifier find half of an aileron lost? A linear model stands in for the aircraft, at 50 Hz for 8 s."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from msls_msgs.msg import FaultEvent
from numpy.typing import NDArray

from msls_ros.testing import Bench

Array = NDArray[np.float64]
PROFILE = Path(__file__).with_name("my_aircraft.yaml")
A = np.array([[-2.0, 0.8], [-0.4, -0.9]])  # rows and columns P, R [1/s]
B = np.array([[12.0, 1.5], [-0.6, -5.0]])  # columns da, dr [1/s^2]
DT = 0.02
LOSS = 4.0  # [s]


def fly(left: float) -> tuple[Array, Array, Array, Array]:
    """Return time, x, xdot and delta of a flight; from `LOSS` on, ``left`` of the aileron's effect remains."""
    random = np.random.default_rng(0)
    time = np.arange(0.0, 8.0, DT)
    delta = 0.02 * random.standard_normal((len(time), 2))
    x, xdot = np.zeros((len(time), 2)), np.zeros((len(time), 2))
    for k, t in enumerate(time):
        effect = B * ([left, 1.0] if t >= LOSS else [1.0, 1.0])
        xdot[k] = A @ x[k] + effect @ delta[k]
        if k + 1 < len(time):
            x[k + 1] = x[k] + DT * xdot[k]
    return time, x, xdot + 0.001 * random.standard_normal(xdot.shape), delta


def test_an_intact_aircraft_raises_no_alarm_and_is_identified() -> None:
    """No false alarm, and B within 3 %."""
    with Bench() as bench:
        identifier = bench.identifier(PROFILE)
        identifier.feed(*fly(left=1.0))
        model = identifier.await_models(400)[-1]
        assert not identifier.events
    assert np.reshape(model.b, (2, 2)) == pytest.approx(B, rel=0.03)
    assert all(model.b_reliable)


def test_half_of_the_aileron_lost_is_detected_and_isolated() -> None:
    """The event names the aileron and what is left of it."""
    with Bench() as bench:
        identifier = bench.identifier(PROFILE)
        identifier.feed(*fly(left=0.5))
        detected, isolated = identifier.await_events(2)[:2]
    assert detected.kind == FaultEvent.DETECTED
    assert isolated.kind == FaultEvent.ISOLATED
    assert isolated.suspected_effector == "da"
    assert isolated.effectiveness == pytest.approx(0.5, abs=0.1)
