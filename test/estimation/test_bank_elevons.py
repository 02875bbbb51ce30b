"""Elevons that have only moved together are learnt when they first go apart: neither alarms nor names."""

from __future__ import annotations

import numpy as np
import pytest

from msls_ros.estimation import EventKind, FaultEvent, Identifier, from_mapping

RATE = 100
PITCH, ROLL = 4.0, 7.0
"""When the pilot first moves each axis [s]."""


def fly(seed: int, *, noise: float = 1.0, left: float = 1.0, duration: float = 11.0) -> list[FaultEvent]:
    """Return the events of an aircraft whose two elevons a law moves: together in pitch, apart in roll.

    Parameters
    ----------
    seed
        Of the sensors.
    noise
        Of rates, their derivatives and deflections, over .05 deg/s, .25 deg/s^2 and .02 deg [1].
    left
        Of the effect of the left elevon from 9 s on [1].
    duration
        [s]
    """
    random = np.random.default_rng(seed)
    steps = 2
    dt, count = 1.0 / (RATE * steps), round(duration * RATE)
    p = q = w = 0.0
    elevons = np.zeros(2)
    rows = []
    for k in range(count * steps):
        t = k * dt
        pilot = [
            0.03 * ((b <= t < b + n) - 1.0 * (b + n <= t < b + 2.0 * n))
            for b, n in ((PITCH, 0.8), (ROLL, 0.7), (9.5, 0.7))
        ]
        pitch, roll = pilot[0] - 0.12 * q - 0.3 * w, pilot[1] + pilot[2] - 0.03 * p
        keep = left if t >= 9.0 else 1.0
        acting = elevons * [keep, 1.0]
        slopes = (
            -2.0 * p + 18.0 * (acting[0] - acting[1]),
            -1.2 * q - 2.0 * w - 9.0 * (acting[0] + acting[1]),
        )
        if k % steps == 0:
            rows.append((w, p, q, q - 0.9 * w, *slopes, *elevons))
        w += dt * (q - 0.9 * w)
        p += dt * slopes[0]
        q += dt * slopes[1]
        elevons += dt * 30.0 * (np.array([-pitch + roll, -pitch - roll]) - elevons)
    scales = noise * np.deg2rad([0.05, 0.05, 0.05, 0.25, 0.25, 0.25, 0.02, 0.02])
    data = np.array(rows) + random.normal(size=(count, 8)) * scales
    c = from_mapping(
        {"states": ("w", "P", "Q"), "effectors": ("left", "right"), "known_gravity": False, "sample_rate": float(RATE)}
    )
    run = Identifier(c).run(np.arange(count) / RATE, data[:, :3], data[:, 3:6], data[:, 6:], every=10)
    return [event for one in run.estimates for event in one.events]


@pytest.mark.parametrize("noise", [1.0, 4.0])
def test_elevons_that_first_go_apart_are_learnt(noise: float) -> None:
    assert not [e.description for seed in range(1, 7) for e in fly(seed, noise=noise) if e.kind != EventKind.RESET]


def test_one_that_has_lost_half_is_alarmed_at_the_next_input() -> None:
    for seed in range(1, 5):
        events = [e for e in fly(seed, left=0.5, duration=13.0) if e.kind == EventKind.DETECTED]
        assert events and 9.5 < events[0].time < 10.0
