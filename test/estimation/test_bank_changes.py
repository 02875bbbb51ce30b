"""Effects that may have changed in calm flight, where nothing alarms: what is published of them must say so."""

from __future__ import annotations

import numpy as np
import pytest

from msls_ros.estimation import Estimate, EventKind, Identifier, from_mapping
from msls_ros.inputs.derivatives import DerivativeFilter

RATE, CALM, LOST, END = 50, 20, 25, 40
"""[Hz]; inputs end, the elevator is lost (or most of it), and the flight ends [s]."""
A = np.array([[-1.0, 80.0], [-0.03, -1.5]])
B = np.array([-8.0, -10.0])
NOISE = np.array([0.1, 0.15])
"""Of the derivatives [m/s^2, rad/s^2]."""


def fly(seed: int, left: float, dither: float, noise: float = 0.0) -> list[Estimate]:
    """Return the estimates of doublets and a calm in which dither of that rms [rad] is all that moves.

    The deflections are recorded with white noise [rad].
    """
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
    delta += noise * random.normal(size=n)
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


def test_an_effector_that_rests_stays_known_though_its_record_is_noisy() -> None:
    """That nothing answers noise says nothing of the effect: with it in the fit two of these are known."""
    known = [fly(seed, 1.0, 0.0, 0.002)[-1].b_reliable[1, 0] for seed in range(6)]
    assert all(known)


def damped(seed: int) -> list[Estimate]:
    """Return the estimates of two doublets and a calm in which a damper moves the elevator by its gyro's noise."""
    random = np.random.default_rng(seed)
    fine, rate, elevator, gyro = 4, 0.0, 0.0, 0.0
    rows = []
    for k in range(30 * RATE * fine):
        t = k / (RATE * fine)
        up, down = (any(begin <= t < begin + 0.6 for begin in begins) for begins in ((3.0, 6.0), (3.6, 6.6)))
        slope = -1.5 * rate - 6.0 * elevator
        if k % fine == 0:
            gyro = rate + 2e-3 * random.normal()
            rows.append((gyro, slope, elevator))
        elevator += 20.0 * (0.05 * (up - down) + 0.4 * gyro - elevator) / (RATE * fine)
        rate += slope / (RATE * fine)
    x, slopes, delta = (np.array(rows) + random.normal(size=(len(rows), 3)) * [0.0, 0.01, 4e-4]).T
    names = {"states": ["Q"], "effectors": ["de"], "known_gravity": False, "sample_rate": float(RATE)}
    time = np.arange(len(rows)) / RATE
    identifier = Identifier(from_mapping(names))
    return identifier.run(time, x[:, None], slopes[:, None], delta[:, None], every=10).estimates


def test_noise_of_a_gyro_that_a_damper_feeds_to_the_elevator_is_no_change() -> None:
    """Its effect was called reliable in .12 to .94 of the calm: what the last seconds made of noise was a change."""
    for seed in range(5):
        calm = [e for e in damped(seed) if e.time > 13.0]
        assert all(abs(e.b[0, 0] + 6.0) < 1.96 * e.b_std[0, 0] for e in calm)
        assert sum(bool(e.b_reliable[0, 0]) for e in calm) > 0.7 * len(calm)


def test_what_was_before_an_alarm_is_not_held_against_what_was_learnt_since() -> None:
    """The rows go on in their group when dither shows a loss: with the last 8 s it would be known in half of this."""
    known = []
    for seed in range(6):
        found = fly(seed, 0.6, 0.03)
        alarm = max(v.time for e in found for v in e.events if v.kind == EventKind.DETECTED)
        known += [e.b_reliable[1, 0] for e in found if alarm < e.time < alarm + 7.0]
    assert np.mean(known) > 0.7


def differentiate(seed: int, left: float, lost: float = 40.0, end: float = 52.0) -> list[Estimate]:
    """Return the estimates of aileron doublets every 20 s and rest, by a roll rate that is differentiated.

    The aileron keeps so much of its effect from ``lost`` [s] on; sensors of the rate and of the aileron have small
    noise (.05 deg/s, .05 deg).
    """
    random = np.random.default_rng(seed)
    n = round(end * RATE)
    time = np.arange(n) / RATE
    delta, rate = np.zeros(n), np.zeros(n)
    for k in range(1, n):
        ups = np.searchsorted([7.0, 7.8, 8.6, 9.0, 9.4, 9.8], time[k] % 20.0, "right")
        command = 0.07 * (0.0, 1.0, -1.0, 0.0, 1.0, -1.0, 0.0)[ups]
        delta[k] = delta[k - 1] + 0.4 * (command - delta[k - 1])
        rate[k] = rate[k - 1] + (-7.6 * rate[k - 1] - 25.7 * (left if time[k] >= lost else 1.0) * delta[k - 1]) / RATE
    rate += 9e-4 * random.normal(size=n)
    delta += 9e-4 * random.normal(size=n)
    window = DerivativeFilter(5, 2, 10**9)
    rows = zip(time, rate, delta, strict=True)
    kept = [one for t, p, d in rows if (one := window.push(round(t * 1e9), np.array([p, d]))) is not None]
    smooth, slope = np.array([one.smooth for one in kept]), np.array([one.slope for one in kept])
    names = {"states": ["P"], "effectors": ["da"], "known_gravity": False, "sample_rate": float(RATE)}
    stamps = np.array([one.stamp * 1e-9 for one in kept])
    return Identifier(from_mapping(names), 5).run(stamps, smooth[:, :1], slope[:, :1], smooth[:, 1:]).estimates


def alarms_of(found: list[Estimate]) -> list[float]:
    return [v.time for e in found for v in e.events if v.kind == EventKind.DETECTED]


def test_through_windows_noise_of_an_aileron_that_rests_is_neither_a_loss_nor_a_doubt() -> None:
    """Where it counted as motion, four of these six alarmed, and in half of this the effect was not known."""
    for seed in range(6):
        found = differentiate(seed, 1.0)
        assert alarms_of(found) == []
        assert np.mean([e.b_reliable[0, 0] for e in found if 34.0 < e.time < 40.0]) > 0.8


def test_a_loss_while_an_effector_rests_is_seen_at_its_next_input_and_known_soon() -> None:
    """What the loss moves the estimate by is no move that batches hold: with it, bars are .5 to 2 of the effect."""
    for seed in range(6):
        found = differentiate(seed, 0.5)
        assert len(alarms_of(found)) == 1
        assert 47.0 < alarms_of(found)[0] < 47.5
        assert found[-1].b_std[0, 0] < 0.1 * abs(found[-1].b[0, 0])
