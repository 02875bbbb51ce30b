"""A command with the known servo of its line becomes the deflection that the servo makes of it, live and offline."""

from __future__ import annotations

import math
from types import SimpleNamespace as Message
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from msls_ros.estimation import EstimationError
from msls_ros.inputs import InputAdapter, InputMap, Synchronizer
from msls_ros.inputs.series import Collector
from msls_ros.inputs.servo_lag import ServoLag, followed

SECOND = 1_000_000_000
LAG = 0.06
PLAIN: dict[str, Any] = {
    "clock": "a",
    "maximum_age": 0.05,
    "topics.a": "/a p/msg/A stamp=t unit=ns",
    "topics.b": f"/b p/msg/B stamp=t unit=ns servo={LAG}",
    "states.s": "a s",
    "derivatives.s": "a rate",
    "effectors.e": "b e",
}


def stamps(count: int = 200) -> NDArray[np.int64]:
    """Return stamps at uneven steps of 3 to 40 ms [ns]."""
    return SECOND + np.cumsum(np.random.default_rng(3).integers(3_000_000, 40_000_000, count))


def test_held_commands_at_uneven_stamps_give_the_step_responses_of_the_servo() -> None:
    times = stamps()
    steps = {20: 0.3, 61: -0.5, 62: 0.1, 150: 0.25}
    commands, expected = np.full(len(times), 0.1), np.full(len(times), 0.1)
    for k, height in steps.items():
        commands[k:] += height
        since = np.maximum(times - times[k], 0) * 1e-9
        expected += height * (1.0 - np.exp(-since / LAG))
    np.testing.assert_allclose(followed(times, commands, LAG, SECOND), expected, rtol=0.0, atol=1e-14)


def test_it_begins_at_the_first_command_and_anew_after_a_gap() -> None:
    servo = ServoLag(LAG, 50_000_000)
    assert [servo.take(0, 0.4), servo.take(40_000_000, 0.1)] == [0.4, 0.4]
    assert servo.take(90_000_000, 0.1) == pytest.approx(0.1 + 0.3 * math.exp(-0.05 / LAG))
    assert servo.take(140_000_001, 0.2) == 0.2
    servo.clear()
    assert servo.take(150_000_000, 0.7) == 0.7


def messages(gap: bool = False) -> list[tuple[str, int, Any]]:
    """Return messages of both topics at the same uneven stamps; where there is a gap, none of /b for .2 s."""
    random, found = np.random.default_rng(4), []
    for t in stamps().tolist():
        found.append(("/a", 0, Message(t=t, s=2e-9 * t, rate=2.0)))
        if not (gap and 0 < t - 2 * SECOND < 200_000_000):
            found.append(("/b", 0, Message(t=t, e=float(random.normal()))))
    return found


def adapter(**changes: str) -> InputAdapter:
    return InputAdapter(InputMap.from_parameters({**PLAIN, **changes}), ("s",), ("e",))


def deflections(made: InputAdapter, sent: list[tuple[str, int, Any]]) -> list[tuple[int, float]]:
    """Return what passes the gate of an identifier."""
    gate = Synchronizer(("s",), ("e",))
    found = [row.offer(gate) for message in sent for row in made.push(*message)]
    return [(one.stamp, float(one.delta[0])) for one in found if one is not None]


@pytest.mark.parametrize("gap", [False, True])
@pytest.mark.parametrize("where", ["topic", "line"])
def test_a_sample_has_the_deflection_that_an_inspection_sees(gap: bool, where: str) -> None:
    on_line = {"topics.b": "/b p/msg/B stamp=t unit=ns", "effectors.e": f"b e servo={LAG}"}
    changes = on_line if where == "line" else {}
    made = dict(deflections(adapter(**changes), messages(gap)))
    collector = Collector(InputMap.from_parameters({**PLAIN, **changes}))
    for topic, logged, message in messages(gap):
        collector.take(topic, logged, message)
    series = collector.record().series["effectors.e"]
    seen = dict(zip(series.stamps.tolist(), series.values[:, 0].tolist(), strict=True))
    raw = {m.t: m.e for topic, _, m in messages(gap) if topic == "/b"}
    assert len(made) > (150 if gap else 190) and all(seen[t] == value for t, value in made.items() if t in seen)
    begins = [t for k, t in enumerate(raw) if not k or t - list(raw)[k - 1] > 50_000_000]
    assert [seen[t] == raw[t] for t in raw] == [t in begins for t in raw] and len(begins) == (2 if gap else 1)


def test_a_line_may_do_without_the_servo_of_its_topic() -> None:
    made = deflections(adapter(**{"effectors.e": "b e servo=0"}), messages())
    raw = {m.t: m.e for topic, _, m in messages() if topic == "/b"}
    assert len(made) > 190 and all(raw[t] == value for t, value in made)


def test_after_a_jump_of_time_it_begins_at_the_first_command_again() -> None:
    made = adapter()
    once = deflections(made, messages())
    assert deflections(made, messages())[: len(once)] == once and made.restarts == 1


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"states.s": "a s servo=0.06"}, "'inputs.states.s': servo=0.06: a servo follows the command of an effector"),
        ({"effectors.e": "b e servo=1.5"}, "servo is '1.5'; it must be a number from 0 to 1"),
        ({"effectors.e": "b e servo=-0.1"}, "servo is '-0.1'; it must be a number from 0 to 1"),
        ({"topics.b": "/b p/msg/B servo=60"}, "servo is '60'; it must be a number from 0 to 1"),
        ({"topics.a": "/a p/msg/A servo=0.1"}, "'inputs.topics.a': servo=0.1, but it gives no effector"),
        ({"effectors.e": "b e hold=true"}, "servo=0.06 and hold=true: give one of the two"),
        ({"effectors.e": "b e lag=0.1"}, "servo=0.06 and lag=0.1: give one of the two"),
    ],
)
def test_a_servo_of_what_is_no_command_is_refused(changes: dict[str, str], says: str) -> None:
    with pytest.raises(EstimationError) as refused:
        adapter(**changes)
    assert says in str(refused.value)
