"""Late samples: a line in the log at growing intervals, and whether their stamps fall behind the clock."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from msls_ros.estimation import Configuration, Dither, Identifier, Level
from msls_ros.inputs import PairedSample, Synchronizer
from msls_ros.inputs.answers import Answers
from msls_ros.inputs.lateness import DriftWatch, Seldom

SECOND = 1_000_000_000
START = 1_796_000_000 * SECOND


def test_a_warning_comes_at_once_then_at_intervals_that_double_up_to_a_minute() -> None:
    seldom = Seldom()
    said = [k / 50 for k in range(50 * 300) if seldom.due(SECOND * k // 50)]
    assert said == [0, 1, 3, 7, 15, 31, 63, 123, 183, 243]
    assert not seldom.due(301 * SECOND) and seldom.due(362 * SECOND) and seldom.due(363 * SECOND)


def drift(age: Callable[[float], float], seconds: float = 60.0) -> DriftWatch:
    """Return the watch after samples at 50 Hz of such ages [s], with the jitter of a loaded machine."""
    watch, random = DriftWatch(), np.random.default_rng(0)
    for k in range(round(50 * seconds)):
        watch.take(age(k / 50) + random.exponential(0.04), k * SECOND // 50)
    return watch


@pytest.mark.parametrize("rate", [0.005, 0.016, 0.3])
def test_ages_that_rise_steadily_are_a_drift(rate: float) -> None:
    watch = drift(lambda t: 0.02 + rate * t)
    assert watch.rate == pytest.approx(rate, rel=0.1)
    assert f"stamps fall behind the clock by {100 * watch.rate:.2g} %" in watch.sentence


@pytest.mark.parametrize(
    "age",
    [lambda t: 0.2, lambda t: 0.2 + 1e-4 * t, lambda t: 0.6 if t > 50 else 0.02, lambda t: 0.5 - 0.016 * t,
     lambda t: 0.3 * ((t // 7) % 2)],
)  # fmt: skip
def test_ages_that_stay_step_or_fall_are_none(age: Any) -> None:
    for seconds in range(1, 61, 4):
        assert not drift(age, seconds).sentence


def test_a_simulation_slower_than_real_time_is_told_of_a_few_times() -> None:
    """One minute at 1.6 % less than real time, as of a user; samples are old from 5 s on."""
    configuration = Configuration().replace({"states": ("w", "Q"), "effectors": ("de", "ds"), "known_gravity": False})
    said: list[tuple[float, str]] = []
    now = 0.0
    answers = Answers(
        Identifier(configuration),
        Synchronizer.of(configuration),
        lambda now, since: "",
        lambda stamp, one: None,
        lambda text: said.append((now, text)),
        lockstep=False,
    )
    none, dither = np.zeros(2), Dither(np.zeros(2), 0.0, 0.0, 0.0, Level.NOMINAL, "")
    for k in range(50 * 60):
        now = k / 50 * 1.016 + 0.02
        steady = round(now * SECOND)
        sample = PairedSample(START + k * SECOND // 50, none, none, none, False)
        answers.take(sample, dither, steady, START + steady)
        if answers.overdue(steady):
            answers.stop(sample.stamp, "late")
    assert len(said) < 10
    assert "fall behind" not in said[0][1] and said[0][0] < 6.0
    first = next(time for time, text in said if "stamps fall behind the clock by 1.6 %" in text)
    assert first < 12.0 and "stamps fall behind the clock by 1.6 %" in said[-1][1]
    pause = answers.pause(round(now * SECOND))
    assert pause is not None and "stamps fall behind the clock by 1.6 %" in pause.message
