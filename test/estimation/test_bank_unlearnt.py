"""Without noise next to nothing in the residual is not knowledge: what no data have parted is not called reliable."""

from __future__ import annotations

import math

import numpy as np
import pytest
from estimation.test_bank_incidence import LONGITUDINAL, A, B
from estimation.test_bank_losses import Flight, events_of

from msls_ros.estimation import EventKind, Identifier, from_mapping
from msls_ros.estimation.kinematics import GRAVITY

RATE, FINE, SPEED = 50.0, 20, 40.0
TRUE = np.hstack([A, B[:, None]])
COLUMNS = [0, 1, 2]
"""Of u, w and Q."""
PITCH = 0.1
"""Angle of attack in trim [rad]."""


def fly(first: float, seconds: float, offset: float) -> tuple[Flight, np.ndarray]:
    """Return a noise-free flight, off its trim by ``offset`` [m/s], inputs from ``first`` [s]; and its A (n, 3, 3)."""
    dt = 1.0 / RATE / FINE
    n = round(seconds * RATE) * FINE
    time = dt * np.arange(n, dtype=np.float64)
    delta = np.zeros(n)
    for start in np.arange(first, seconds - 2.0, 3.0):
        for begin, end, sign in ((0.0, 0.6, 1.0), (0.6, 1.0, -1.0), (1.0, 1.2, 1.0)):
            delta[(time >= start + begin) & (time < start + end)] = sign * 0.05
    trim = np.array([SPEED * math.cos(PITCH), SPEED * math.sin(PITCH), 0.0])
    lift = np.array([GRAVITY * math.sin(PITCH), -GRAVITY * math.cos(PITCH), 0.0])
    own = np.array([trim[0] + offset, trim[1], 0.0, 0.0, PITCH])
    x, slopes, true = np.zeros((n, 5)), np.zeros((n, 5)), np.zeros((n, 3, 3))
    for k in range(n):
        u, w, q, _, pitch = own
        speed = math.hypot(u, w)
        faster = speed / SPEED
        at_constant = faster * (A @ (own[:3] - faster * trim))  # aerodynamic: angle of attack and rates at a speed
        air = faster * faster * (lift + B * delta[k]) + at_constant
        turn = [-q * w - GRAVITY * math.sin(pitch), q * u + GRAVITY * math.cos(pitch), 0.0]
        x[k], slopes[k] = own, [*(air + turn), 0.0, q]
        along = np.array([u, w, 0.0]) / speed
        by_speed = 2.0 * faster / SPEED * (lift + B * delta[k]) + A @ (own[:3] - 2.0 * faster * trim) / SPEED
        true[k] = faster * A + np.outer(by_speed, along)
        true[k, :, 2] += [-w, u, 0.0]
        true[k, :, :2] += np.array([[0.0, -q], [q, 0.0], [0.0, 0.0]])
        own = own + dt * slopes[k]
    kept = slice(None, None, FINE)
    return (time[kept], x[kept], slopes[kept], delta[kept, None]), true[kept]


def judged(flight: Flight, true: np.ndarray, start: float, stop: float) -> tuple[int, int]:
    """How many numbers of A are called reliable between two times [s], and how many of these are beyond their bands."""
    identifier = Identifier(from_mapping(LONGITUDINAL))
    reliable = beyond = 0
    for k, sample in enumerate(zip(*flight, strict=True)):
        time, *rest = sample
        found = identifier.update(float(time), *rest)
        if start <= time < stop:
            trust = found.a_reliable[np.ix_(COLUMNS, COLUMNS)]
            error = np.abs(found.a[np.ix_(COLUMNS, COLUMNS)] - true[k])
            far = error > 4.0 * found.a_std[np.ix_(COLUMNS, COLUMNS)] + 1e-3 * np.abs(true[k])
            reliable += int(trust.sum())
            beyond += int((trust & far).sum())
    return reliable, beyond


@pytest.mark.parametrize("offset", [1e-9, 1e-7, 1e-6])
def test_a_trim_that_is_a_little_off_is_not_taken_for_knowledge_of_a(offset: float) -> None:
    flight, true = fly(6.0, 6.0, offset)
    assert judged(flight, true, 0.5, 6.0)[1] == 0


def test_what_inputs_show_is_known() -> None:
    flight, true = fly(2.0, 14.0, 0.01)
    reliable, beyond = judged(flight, true, 8.0, 14.0)
    assert reliable > 4 * 300
    assert beyond <= 0.03 * reliable


def test_arithmetic_does_not_alarm() -> None:
    random = np.random.default_rng(3)
    n = 300
    size = np.where(np.arange(n) < 150, 1e-13, 3e-12)[:, None]
    own = np.array([SPEED * math.cos(PITCH), SPEED * math.sin(PITCH), 0.0, 0.0, PITCH])
    x = own + size * random.normal(size=(n, 5))
    slopes = size * random.normal(size=(n, 5))
    flight = np.arange(n) / RATE, x, slopes, size * random.normal(size=(n, 1))
    events = events_of(Identifier(from_mapping(LONGITUDINAL)), flight)
    assert [event for event in events if event.kind == EventKind.DETECTED] == []
