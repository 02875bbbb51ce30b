"""What moves the air data and not the aircraft is noise as far as outputs do not answer it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

from msls_ros.estimation import Estimate, Identifier, from_mapping
from msls_ros.estimation.bank.gusts import noise_part
from msls_ros.estimation.bank.regression import BankRegression

RATE, SPEED, SECONDS = 50, 30.0, 60
A = np.array([[-0.9, SPEED], [-0.3, -3.0]])
B = np.array([[-5.5], [-30.0]])
"""w, Q by de."""
NAMES = {"states": ("w", "Q"), "effectors": ("de",), "known_gravity": False, "sample_rate": float(RATE)}
SLOWS = 0.8
"""Autocorrelation of a vane's noise from sample to sample."""


class Air(NamedTuple):
    """What an aircraft flies in, and how its vane shows it."""

    gusts: float = 0.0
    """Walk of gusts in a second that dies away in two [m/s]; they act on the aircraft."""
    calm: float = SECONDS
    """When they end [s]."""
    vane: float = 0.0
    """Noise of the vane, standard deviation [m/s]."""
    turning: float = 0.0
    """What each step of a gust does to Q of its own, which nothing shows [rad/s per m/s]."""


def fly(seed: int, air: Air) -> list[Estimate]:
    """Return the estimates of doublets of the elevator, twice a second."""
    return run(seed, air)[0]


def run(seed: int, air: Air) -> tuple[list[Estimate], BankRegression]:
    """Return the estimates of doublets of the elevator, twice a second, and the engine at the end."""
    n, parts = SECONDS * RATE, 4
    random = np.random.default_rng(seed)
    u = np.zeros((n, 1))
    for start in range(2 * RATE, n, 6 * RATE):
        unit = round(random.uniform(0.3, 0.8) * RATE)
        u[start : start + unit] = random.uniform(0.02, 0.06)
        u[start + unit : start + 2 * unit] = -u[start]
    x, slopes, now, gust, vane = np.zeros((n, 2)), np.zeros((n, 2)), np.zeros(2), 0.0, 0.0
    for k in range(n):
        push = air.gusts * random.normal() / np.sqrt(RATE) if k < air.calm * RATE else 0.0
        gust += push - 0.5 * gust / RATE
        felt = np.array([gust, air.turning * push * RATE])
        vane = SLOWS * vane + np.sqrt(1.0 - SLOWS * SLOWS) * air.vane * random.normal()
        x[k], slopes[k] = now + np.array([gust + vane, 0.0]), A @ (now + felt) + B @ u[k]
        for _ in range(parts):
            now = now + (A @ (now + felt) + B @ u[k]) / (parts * RATE)
    x[:, 1] += 0.001 * random.normal(size=n)
    slopes += np.array([0.05, 0.01]) * random.normal(size=x.shape)
    identifier = Identifier(from_mapping(NAMES))
    found = identifier.run(np.arange(n) / RATE, x, slopes, u, every=RATE // 2).estimates
    engine = identifier._regression
    assert isinstance(engine, BankRegression)
    return found, engine


def part_of_noise(air: Air, seed: int = 0) -> list[float]:
    """Return which part of what is found in w counts as noise to w and Q at the end."""
    engine = run(seed, air)[1]
    return [noise_part(engine.settings, engine.state, q, 0, float(engine.noise[0])) for q in range(2)]


def test_a_gust_that_acts_is_no_noise() -> None:
    assert max(part_of_noise(Air(gusts=1.0))) < 0.05


def test_noise_of_a_vane_is_noise_of_whatever_colour() -> None:
    assert min(part_of_noise(Air(vane=0.1))) > 0.8
    assert 0.1 < part_of_noise(Air(gusts=0.5, vane=0.1))[0] < 0.8


def test_a_gust_that_turns_as_well_is_none_that_is_known() -> None:
    assert part_of_noise(Air(gusts=1.0, turning=0.02))[1] > 0.5


def test_noise_of_a_vane_stays_when_the_air_becomes_calm() -> None:
    """Its share of what is found was small in the gusts; now it is all of it. From .45 on all of it counts."""
    assert max(part_of_noise(Air(gusts=2.0, vane=0.1))) < 0.2
    assert min(part_of_noise(Air(gusts=2.0, calm=45.0, vane=0.1))) > 0.5


@pytest.mark.parametrize("air", [Air(gusts=1.0), Air(gusts=0.3, vane=0.1), Air(vane=0.1), Air(gusts=1.0, turning=0.02)])
def test_what_is_called_known_is(air: Air) -> None:
    off = []
    for seed in range(6):
        for e in fly(seed, air)[8:]:
            for value, error, sure, true in ((e.a, e.a_std, e.a_reliable, A), (e.b, e.b_std, e.b_reliable, B)):
                off += list((abs(value - true) / error)[sure])
    assert np.mean(np.array(off) <= 1.96) >= 0.9


def test_gusts_that_act_are_excitation() -> None:
    known = [e.a_reliable.mean() for seed in range(3) for e in fly(seed, Air(gusts=1.0))[20:]]
    assert np.mean(known) > 0.7
