"""The rate of samples by their stamps: pauses are none of it."""

from __future__ import annotations

from collections.abc import Iterable

import pytest

from msls_ros.inputs.freshness import RateWatch

SECOND = 1_000_000_000


def said(nominal: float, steps: Iterable[float]) -> list[str]:
    """Return what is said while samples come in such steps [s]."""
    watch, stamp, sentences = RateWatch(nominal), 0, []
    for step in steps:
        stamp += round(step * SECOND)
        if watch.take(stamp):
            sentences.append(watch.sentence)
    return sentences


USUAL = [0.02] * 300


@pytest.mark.parametrize("pause", [0.13, 0.3, 0.9, 2.8, 60.0])
@pytest.mark.parametrize("before", [0, 1, 2, 50, 300])
def test_samples_of_the_promised_rate_with_pauses_are_not_complained_of(pause: float, before: int) -> None:
    assert said(50.0, [*USUAL[:before], pause, *USUAL, pause, pause, *USUAL]) == []


@pytest.mark.parametrize("pauses", [[], [0.5], [2.8], [0.5, 0.025, 0.025, 2.8]])
def test_another_rate_is_said_once_as_it_is_with_pauses_too(pauses: list[float]) -> None:
    other = [0.025] * 150
    assert said(50.0, [*other, *pauses, *other]) == [
        "samples come at 40 Hz, sample_rate is 50 Hz: set it to what comes"
    ]


@pytest.mark.parametrize("rate", [5.0, 0.4])
def test_a_rate_that_falls_far_is_said_once_and_measured_as_it_is(rate: float) -> None:
    watch, stamp, count = RateWatch(50.0), 0, 0
    for step in [*USUAL, *[1.0 / rate] * 20]:
        stamp += round(step * SECOND)
        count += watch.take(stamp)
    assert count == 1 and watch.deviates
    assert watch.measured == pytest.approx(rate)


def test_samples_that_were_lost_count() -> None:
    (found,) = said(50.0, [0.02, 0.02, 0.04] * 100)
    assert found.startswith("samples come at 37.")


def test_uneven_steps_are_averaged() -> None:
    assert said(33.3, [0.03, 0.03, 0.04] * 200) == []
    (found,) = said(100.0, [0.0001, 0.0399] * 200)
    assert found.startswith("samples come at 50 Hz") or found.startswith("samples come at 49.")
