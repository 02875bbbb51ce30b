"""Effects that may have changed in calm flight, where nothing alarms: what is published of them must say so."""

from __future__ import annotations

import numpy as np
import pytest

from msls_ros.estimation import Estimate, EventKind, Identifier, from_mapping

RATE, CALM, LOST, END = 50, 20, 25, 40
"""[Hz]; inputs end, the elevator is lost (or most of it), and the flight ends [s]."""
A = np.array([[-1.0, 80.0], [-0.03, -1.5]])
B = np.array([-8.0, -10.0])
NOISE = np.array([0.1, 0.15])
"""Of the derivatives [m/s^2, rad/s^2]."""


def fly(seed: int, left: float, dither: float) -> list[Estimate]:
    """Return the estimates of doublets and a calm in which dither of that rms [rad] is all that moves."""
    random = np.random.default_rng(seed)
    n = END * RATE
    time = np.arange(n) / RATE
    delta = dither * random.normal(size=n)
    delta[: CALM * RATE] += 0.05 * np.sign(np.sin(2.0 * np.pi * 0.5 * time[: CALM * RATE]))
    x, states, slopes = np.zeros(2), np.zeros((n, 2)), np.zeros((n, 2))
    for k in range(n):
        slope = A @ x + B * (left if k >= LOST * RATE else 1.0) * delta[k]
        states[k], slopes[k] = x, slope
        x = x + slope / RATE
    slopes += NOISE * random.normal(size=slopes.shape)
    names = {"states": ["w", "Q"], "effectors": ["de"], "known_gravity": False, "sample_rate": float(RATE)}
    return Identifier(from_mapping(names)).run(time, states, slopes, delta[:, None]).estimates


@pytest.mark.parametrize("left", [0.4, 0.0])
def test_a_loss_in_calm_flight_that_is_not_alarmed_is_in_the_bar(left: float) -> None:
    wrong = 0
    for seed in range(6):
        found = [e for e in fly(seed, left, 0.006) if e.time > LOST + 8]
        alarmed = any(event.kind == EventKind.DETECTED for e in found for event in e.events)
        last = found[-1]
        wrong += not alarmed and last.b_reliable[1, 0] and abs(last.b[1, 0] - left * B[1]) > 1.96 * last.b_std[1, 0]
    assert wrong == 0


def test_what_has_not_changed_stays_known_in_the_calm() -> None:
    known = [fly(seed, 1.0, 0.006)[-1].b_reliable[1, 0] for seed in range(6)]
    assert all(known)


def test_what_was_before_an_alarm_is_not_held_against_what_was_learnt_since() -> None:
    """The rows go on in their group when dither shows a loss: with the last 8 s it would be known in half of this."""
    known = []
    for seed in range(6):
        found = fly(seed, 0.6, 0.03)
        alarm = max(v.time for e in found for v in e.events if v.kind == EventKind.DETECTED)
        known += [e.b_reliable[1, 0] for e in found if alarm < e.time < alarm + 7.0]
    assert np.mean(known) > 0.7
