"""The rate of samples by their stamps: pauses are none of it."""

from __future__ import annotations

from collections.abc import Iterable

import pytest

from msls_ros.inputs.freshness import LossWatch, RateWatch

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


def test_the_rate_that_is_said_to_be_configured_is_that_and_the_topic_that_sets_the_pace_is_named() -> None:
    watch = RateWatch(100.0)
    watch.expect(50.0, "/surfaces")
    assert sum(watch.take(k * SECOND // 40) for k in range(200)) == 1
    assert watch.sentence == (
        "samples come at 40 Hz, sample_rate is 100 Hz: they follow /surfaces, the slowest topic, which came at 50 Hz; "
        "publish it faster, or set sample_rate to what comes"
    )
    watch.expect(100.0)
    assert "/surfaces" not in watch.sentence


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


def losses(speed: float, lost: int, of: int, seconds: float = 30.0) -> tuple[LossWatch, list[str]]:
    """Return the watch and what it says of samples at 50 Hz, the last ``lost`` of each ``of`` missing."""
    watch, said = LossWatch(50.0, 0.1), []
    for k in range(round(50 * seconds)):
        if k % of < of - lost and watch.take(k * SECOND // 50, round(k * SECOND / 50 / speed)):
            said.append(watch.sentence)
    return watch, said


@pytest.mark.parametrize(("lost", "of", "share"), [(1, 10, 10), (30, 40, 75), (1, 25, 4)])
def test_samples_that_are_lost_faster_than_real_time_name_the_queue_once(lost: int, of: int, share: int) -> None:
    watch, (said,) = losses(10.0, lost, of)
    assert said.startswith("samples come 10 times as fast as real time") and "'queue', 1 or more" in said
    assert abs(int(said.partition(" %")[0].rpartition(" ")[2]) - share) <= 5
    assert watch.sentence and 0.8 * 1250 * lost / of < watch.lost <= 1500 * lost / of


@pytest.mark.parametrize(("speed", "lost", "of"), [(10.0, 0, 10), (1.0, 2, 10), (0.1, 5, 10), (1.3, 30, 40)])
def test_what_is_lost_in_real_time_or_not_at_all_names_no_queue(speed: float, lost: int, of: int) -> None:
    watch, said = losses(speed, lost, of)
    assert (said, watch.sentence, watch.lost) == ([], "", 0)


def test_a_loss_that_is_over_is_no_longer_said_nor_counts_what_a_jump_of_time_skips() -> None:
    watch, _ = losses(10.0, 5, 10)
    last = 1_000 * SECOND
    for k in range(1, 2000):
        watch.take(last + k * SECOND // 50, last + k * SECOND // 500)
    assert watch.sentence == ""
    before = watch.lost
    assert not watch.take(SECOND, 2 * last) and watch.lost == before


def test_what_makes_up_for_a_stall_names_no_queue() -> None:
    """In real time at 50 Hz, a stall of 5 s; then what has waited, a third of it lost, at three times real time."""
    watch, said, now = LossWatch(50.0, 0.1), [], 0
    for k in range(50 * 60):
        behind = 0 if k < 1000 else max(5 * SECOND - (k - 1000) * SECOND * 2 // 150, 0)
        now = k * SECOND // 50 + behind
        if (behind == 0 or k % 3) and watch.take(k * SECOND // 50, now):
            said.append(watch.sentence)
    assert (said, watch.lost) == ([], 0)


def test_a_share_of_samples_lost_is_less_than_all_whatever_rate_is_expected_in_between() -> None:
    watch, said = LossWatch(100.0, 0.1), []
    for k in range(3000):
        watch.expect(100.0 if k % 100 < 60 else 40.0)
        if k % 10 < 3 and watch.take(k * SECOND // 100, k * SECOND // 1000):
            said.append(watch.sentence)
    assert said and all(0 < int(one.partition(" %")[0].rpartition(" ")[2]) < 100 for one in said), said
