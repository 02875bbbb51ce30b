"""Sensors: the published noise, seeded, and nothing else."""

from __future__ import annotations

import math

import numpy as np
import pytest

from msls_ros.plant import NOISE_LEVELS, PlantError, Sample, Sensors

FOOT = 0.3048
SAMPLE = Sample(1.5, np.arange(9.0), np.arange(9.0) - 4.0, np.linspace(-0.1, 0.1, 7))


def noise(level: str, seed: int, samples: int) -> np.ndarray:
    sensors = Sensors(level, seed)
    rows = []
    for _ in range(samples):
        measured = sensors.measure(SAMPLE)
        assert measured.time == SAMPLE.time
        rows.append(np.concatenate((measured.x - SAMPLE.x, measured.xdot - SAMPLE.xdot, measured.delta - SAMPLE.delta)))
    return np.array(rows)


def test_no_noise_changes_nothing() -> None:
    assert not noise("none", 0, 10).any()


@pytest.mark.parametrize(
    ("level", "published"), [("low", (0.05, 0.005, 0.02, 0.05, 0.005)), ("med", (0.2, 0.02, 0.1, 0.25, 0.02))]
)
def test_noise_has_the_published_size_and_no_correlation(level: str, published: tuple[float, ...]) -> None:
    values = noise(level, 1, 20_000)
    velocity, rate, acceleration, angular, deflection = published
    rms = np.sqrt(np.mean(values**2, axis=0))
    np.testing.assert_allclose(rms[0:3], velocity * FOOT, rtol=0.03)
    np.testing.assert_allclose(rms[3:6], math.radians(rate), rtol=0.03)
    np.testing.assert_allclose(rms[6:9], NOISE_LEVELS[level].attitude, rtol=0.03)
    np.testing.assert_allclose(rms[9:12], acceleration * FOOT, rtol=0.03)
    np.testing.assert_allclose(rms[12:15], math.radians(angular), rtol=0.03)
    np.testing.assert_allclose(rms[18:], math.radians(deflection), rtol=0.03)
    correlation = np.corrcoef(values.T)
    assert np.abs(correlation - np.eye(len(rms))).max() < 0.04
    assert np.abs(np.mean(values[1:] * values[:-1], axis=0) / rms**2).max() < 0.04


def test_the_seed_decides_the_noise() -> None:
    np.testing.assert_array_equal(noise("low", 3, 50), noise("low", 3, 50))
    assert not np.array_equal(noise("low", 3, 50), noise("low", 4, 50))


def test_two_suites_do_not_share_their_random_numbers() -> None:
    first, second = Sensors("low", 5), Sensors("low", 5)
    expected = [first.measure(SAMPLE).x for _ in range(3)]
    Sensors("low", 5).measure(SAMPLE)
    for x in expected:
        np.testing.assert_array_equal(second.measure(SAMPLE).x, x)


@pytest.mark.parametrize(
    ("level", "seed"), [("high", 0), ("", 0), ("low", -1), ("low", 1.5), ("low", "x"), ("low", True)]
)
def test_unknown_levels_and_bad_seeds_are_refused(level: str, seed: object) -> None:
    with pytest.raises(PlantError, match="expected"):
        Sensors(level, seed)  # type: ignore[arg-type]
