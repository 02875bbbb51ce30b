"""Rows are made at the instants of the slowest stream that enters the equations, of what was measured anew."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace as Message
from typing import Any

import numpy as np
import pytest

from msls_ros.estimation import Configuration
from msls_ros.estimation.repeats import SLOWEST, STUCK
from msls_ros.estimation.screening import LASTS, SLOW_ROWS
from msls_ros.inputs import EffectorRow, InputAdapter, InputMap, StateRow
from msls_ros.inputs.check_timing import check_rates
from msls_ros.inputs.pacing import slowest_pace
from msls_ros.inputs.series import Collector

STEP = 10_000_000
"""Of the clock [ns]."""
NOISE = np.random.default_rng(1).normal(size=100_000)
Sent = tuple[int, str, Any]
MAPPED: dict[str, Any] = {
    "clock": "imu",
    "maximum_age": 0.2,
    "topics": {name: f"/{name} p/msg/{name.upper()} stamp=t unit=ns" for name in ("imu", "servo", "vane")},
    "states": {"P": "imu p", "v": "vane v"},
    "derivatives": {"P": "imu dp", "v": "imu dv"},
    "effectors": {"da": "servo da"},
}


def adapter(changes: dict[str, Any] | None = None, **options: Any) -> InputAdapter:
    return InputAdapter(
        InputMap.from_parameters({**MAPPED, **(changes or {})}), ("v", "P"), ("da",), **{"slowest": SLOWEST, **options}
    )


def stream(topic: str, field: str, every: float, until: float, first: float = 0.0, measured: int = 1) -> Iterator[Sent]:
    """Yield messages every so many steps, of noise that is measured for every so manieth."""
    for k in range(round((until - first) / every)):
        t = round((first + k * every) * STEP)
        value = float(NOISE[k // measured * measured])
        yield (
            t,
            f"/{topic}",
            Message(t=t, **({"p": value, "dp": value, "dv": value} if topic == "imu" else {field: value})),
        )


def rows(one: InputAdapter, *streams: Iterator[Sent]) -> tuple[list[int], list[float]]:
    """Return in which steps there are rows, in the order of messages, and the deflections in them."""
    made: list[Any] = []
    for t, topic, message in sorted((sent for each in streams for sent in each), key=lambda sent: (sent[0], sent[1])):
        made += one.push(topic, t, message)
    steps = [round(row.stamp / STEP) for row in made if isinstance(row, StateRow)]
    return steps, [float(row.delta[0]) for row in made if isinstance(row, EffectorRow)]


@pytest.mark.parametrize("slow", ["deflection", "derivative"])
def test_a_stream_that_may_step_and_is_slower_than_the_clock_sets_the_pace(slow: str) -> None:
    one = adapter({"derivatives": {"P": "imu dp", "v": "servo dv"}} if slow == "derivative" else {})
    servo = stream("servo", "dv" if slow == "derivative" else "da", 4, 400, 1)
    if slow == "derivative":
        servo = ((t, topic, Message(t=t, da=m.dv, dv=m.dv)) for t, topic, m in servo)
    steps, _ = rows(one, stream("imu", "p", 1, 400), servo, stream("vane", "v", 1, 400))
    known = 1 + 4 * (SLOW_ROWS + 1)
    assert [k for k in steps if k > known] == [k for k in range(1, 400, 4) if k > known]
    assert set(range(1, known - 4)) <= set(steps)
    assert one.refused["stale"] == 1  # the instant before the first sample


@pytest.mark.parametrize(("seconds", "stays"), [(2.5, True), (2.0 * LASTS, False)])
def test_a_stream_whose_messages_are_lost_for_seconds_goes_on_to_set_the_pace(seconds: float, stays: bool) -> None:
    one, until = adapter(), round(400 + 100 * seconds)
    lost = np.random.default_rng(5).uniform(size=until) < 0.9
    servo = (sent for k, sent in enumerate(stream("servo", "da", 2, until)) if 2 * k < 400 or not lost[k])
    rows(one, stream("imu", "p", 1, until), servo, stream("vane", "v", 1, until))
    assert one.pace[0] == ("effectors.da (/servo da)" if stays else "")


def test_a_state_that_is_slower_than_the_clock_is_interpolated() -> None:
    steps, _ = rows(adapter(), stream("imu", "p", 1, 400), stream("servo", "da", 1, 420), stream("vane", "v", 4, 420))
    assert steps == list(range(400))


def test_streams_as_quick_as_the_clock_and_those_that_are_held_or_too_slow_set_none() -> None:
    whole = list(range(400))
    jitter = 0.3 * np.random.default_rng(2).uniform(-1, 1, 500)
    uneven = (
        (t + round(jitter[k] * STEP), topic, m) for k, (t, topic, m) in enumerate(stream("vane", "v", 1, 420, -1))
    )
    shifted = (sent for sent in stream("servo", "da", 1, 420, -0.6))
    steps, _ = rows(adapter(), stream("imu", "p", 1, 400), uneven, shifted)
    assert steps == whole
    late = {"effectors": {"da": "servo da hold=true"}}
    steps, _ = rows(
        adapter(late), stream("imu", "p", 1, 400), stream("vane", "v", 1, 420), stream("servo", "da", 5, 420)
    )
    assert steps == whole
    steps, _ = rows(adapter(), stream("imu", "p", 1, 400), stream("vane", "v", 1, 420), stream("servo", "da", 18, 440))
    assert steps == whole


def test_what_a_message_repeats_is_no_sample_and_is_counted() -> None:
    reports: list[Any] = []
    one = adapter(report=reports.append)
    servo = stream("servo", "da", 1, 400, measured=4)
    steps, moved = rows(one, stream("imu", "p", 1, 400), stream("vane", "v", 1, 400), servo)
    assert steps[-60:] == list(range(steps[-1] - 4 * 59, 397, 4))
    assert moved[-60:] == [float(NOISE[k]) for k in steps[-60:]]
    assert one.refused["repeated"] > 250
    assert [refused.reason for refused in reports].count("repeated") == 1
    assert "effectors.da" in next(str(refused) for refused in reports if refused.reason == "repeated")


def test_a_deflection_that_rests_is_a_sample_and_a_vane_that_stops_is_none() -> None:
    rests = (
        (t, topic, Message(t=t, da=0.1 if t > 150 * STEP else m.da)) for t, topic, m in stream("servo", "da", 1, 400)
    )
    steps, moved = rows(adapter(), stream("imu", "p", 1, 400), stream("vane", "v", 1, 400), rests)
    assert steps == list(range(400)) and moved[-1] == 0.1
    stuck = (
        (t, topic, Message(t=t, v=0.1 if 250 * STEP < t <= 300 * STEP else m.v))
        for t, topic, m in stream("vane", "v", 1, 400)
    )
    one = adapter({"maximum_age": 0.03})
    steps, _ = rows(one, stream("imu", "p", 1, 400), stuck, stream("servo", "da", 1, 400))
    assert one.refused["repeated"] == 49 - STUCK + 1
    assert not set(steps) & set(range(260, 298))
    assert steps[-90:] == list(range(310, 400))


def test_the_window_of_derivatives_is_as_long_at_a_slower_pace() -> None:
    changes = {"derivatives": {"v": "imu dv"}}
    one = adapter(changes, sample_rate=100.0)
    assert one.straddle == 10
    steps, _ = rows(one, stream("imu", "p", 1, 600), stream("vane", "v", 1, 600), stream("servo", "da", 2, 600))
    paced = [k for k in steps if k > 60]
    assert np.diff(paced).tolist() == [2] * (len(paced) - 1)
    assert paced[-1] == 598 - 5  # five intervals of two steps: its middle


def test_time_that_jumps_back_forgets_the_pace() -> None:
    one = adapter()
    streams = stream("imu", "p", 1, 300), stream("vane", "v", 1, 300), stream("servo", "da", 4, 300)
    first, _ = rows(one, *streams)
    one.clear()
    again, _ = rows(one, stream("imu", "p", 1, 300), stream("vane", "v", 1, 300), stream("servo", "da", 4, 300))
    assert first == again


def test_msls_and_rls_take_every_instant_of_the_clock_and_a_dither_is_not_held_for_longer_than_it_may_be() -> None:
    one = adapter(slowest=slowest_pace(Configuration().replace({"estimator.method": "rls"})))
    servo = stream("servo", "da", 4, 400, measured=3)
    steps, _ = rows(one, stream("imu", "p", 1, 400), stream("vane", "v", 1, 420), servo)
    assert steps == list(range(397)) and not one.refused["repeated"]
    bank = Configuration().replace({"estimator.method": "bank"})
    assert slowest_pace(bank.replace({"dither.enabled": False})) == SLOWEST
    assert slowest_pace(bank.replace({"dither.enabled": True, "dither.stale_after": 0.05})) == pytest.approx(0.03)


def test_an_inspection_says_how_often_a_number_is_measured_that_messages_repeat() -> None:
    inputs = InputMap.from_parameters(MAPPED)
    collector = Collector(inputs)
    streams = stream("imu", "p", 1, 400), stream("vane", "v", 1, 400), stream("servo", "da", 1, 400, measured=4)
    for each in streams:
        for t, topic, message in each:
            collector.take(topic, t, message)
    configuration = Configuration().replace({"states": ("v", "P"), "effectors": ("da",), "known_gravity": False})
    found = [f for f in check_rates(collector.record(), configuration) if f.kind == "repeats"]
    assert [f.where for f in found] == ["inputs.effectors.da"]
    assert found[0].what.startswith("it is measured at 25 Hz: of the messages, at 100 Hz,")
