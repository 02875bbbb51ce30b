"""Streams of one clock: stamps of another time cost little, are counted, and stop nothing."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace as Message

import pytest

from msls_ros.inputs import InputAdapter, InputMap, Refused
from msls_ros.inputs.timeline import Timeline

STEP, SECOND = 10_000_000, 1_000_000_000
COUNT, AT, WINDOW = 600, 200, 10
NAMES = ("/a", "/b", "/c")
FIELDS = {
    "clock": "b",
    "maximum_age": 0.05,
    "topics": {name[1:]: f"{name} p/msg/A stamp=t unit=ns" for name in NAMES},
    "states": {"s": "a v", "r": "b v"},
    "effectors": {"e": "c v"},
}
AHEAD = [2 * SECOND, 12 * SECOND, 70 * SECOND, 1_795_917_000 * SECOND]
Stamp = Callable[[str, int], int]


def fly(stamp: Stamp) -> tuple[InputAdapter, list[int], int]:
    """Send the messages of three topics; return the adapter, the steps of its rows, the most instants that waited."""
    made = InputAdapter(InputMap.from_parameters(FIELDS), ("s", "r"), ("e",), sample_rate=100.0)
    rows, most = [], 0
    for k in range(COUNT):
        for name in NAMES:
            t = SECOND + k * STEP
            found = made.push(name, 0, Message(t=stamp(name, k), v=2e-9 * t))
            rows += [(row.stamp - SECOND) // STEP for row in found[::2]]
            most = max(most, len(made._aligner._instants))
    return made, rows, most


def moved(names: set[str], by: int, length: int = 1) -> Stamp:
    """Stamps of which those of some topics are off for some steps."""
    return lambda name, k: SECOND + k * STEP + by * (name in names and AT <= k < AT + length)


PAIRS = [{"/a", "/b"}, {"/a", "/c"}, {"/b", "/c"}]


@pytest.mark.parametrize("by", AHEAD)
@pytest.mark.parametrize("names", PAIRS, ids=["ab", "ac", "bc"])
def test_two_of_three_streams_once_in_the_future_cost_that_instant(names: set[str], by: int) -> None:
    made, rows, most = fly(moved(names, by))
    assert (dict(made.refused), made.restarts) == ({"stamp_rogue": 2}, 0)
    assert rows[-1] >= COUNT - WINDOW and len(rows) >= COUNT - WINDOW - 2 and most <= 3


@pytest.mark.parametrize("names", PAIRS, ids=["ab", "ac", "bc"])
def test_two_stamps_that_were_not_filled_in_begin_no_new_time(names: set[str]) -> None:
    made, rows, _ = fly(lambda name, k: 0 if name in names and k == AT else SECOND + k * STEP)
    assert (dict(made.refused), made.restarts) == ({"stamp_rogue": 2}, 0)
    assert len(rows) >= COUNT - WINDOW - 2


@pytest.mark.parametrize("length", [3, 20, 200])
@pytest.mark.parametrize("by", AHEAD)
@pytest.mark.parametrize("names", [{"/a"}, {"/b"}, {"/c"}, *PAIRS], ids=["a", "b", "c", "ab", "ac", "bc"])
def test_the_return_from_a_time_believed_in_error_is_counted_and_costs_two_windows(
    names: set[str], by: int, length: int
) -> None:
    made, rows, most = fly(moved(names, by, length))
    assert made.refused["time_returned"] >= 1 and made.restarts == 0
    assert sum(made.refused.values()) >= length
    assert rows == sorted(rows) and rows[-1] >= COUNT - WINDOW and len(rows) >= COUNT - length - 3 * WINDOW
    assert most <= 12, "what waits is bounded by the largest age"


@pytest.mark.parametrize("by", [-300 * STEP, 70 * SECOND])
def test_all_streams_in_a_new_time_lose_nothing_but_the_window(by: int) -> None:
    made, rows, _ = fly(lambda name, k: 10 * SECOND + k * STEP + by * (k >= AT))
    assert made.restarts == (by < 0) and made.refused == ({} if by < 0 else {"gap": 1})
    assert len(rows) == COUNT - 2 * WINDOW


def test_a_new_time_of_several_streams_is_confirmed_by_all_or_by_three_in_a_row() -> None:
    refused: list[Refused] = []
    line: Timeline[int] = Timeline(SECOND, refused.append)
    for name in NAMES:
        line.take(name, 100 * SECOND, 0)
    assert not line.take("/a", 1, 1).items and not line.take("/b", 2, 2).items
    assert line.take("/c", 3, 3) == ([("/a", 1, 1), ("/b", 2, 2), ("/c", 3, 3)], True, None)
    line.take("/a", 50 * SECOND, 4)
    line.take("/b", 50 * SECOND, 5)
    line.take("/a", 50 * SECOND + 1, 6)
    assert [item for _, _, item in line.take("/a", 50 * SECOND + 2, 7).items] == [4, 5, 6, 7]
    assert line.take("/a", 4, 8) == ([("/a", 4, 8)], False, 50 * SECOND + 2)
    assert line.last == {"/a": 4, "/c": 3} and not refused and not line.waiting


@pytest.mark.parametrize("every", [1, 10, 1000], ids=["quick", "slow", "dead"])
def test_in_lockstep_a_topic_that_no_sample_needs_holds_up_no_new_time(every: int) -> None:
    """The plant sends the next sample when this one is answered: it would wait for ever where this one waits."""
    entries = {
        "clock": "a",
        "topics": {name[1:]: f"{name} p/msg/A stamp=t unit=ns" for name in NAMES},
        "velocity": "b v,v,v",
        "derivatives": dict.fromkeys("uvw", "a v"),
        "effectors": {"e": "b v"},
        "airspeed": "c v",  # compared with the velocity by inspect, needed by nothing else
    }
    made = InputAdapter(InputMap.from_parameters(entries), ("u", "v", "w"), ("e",), sample_rate=100.0)
    for k in range(400):
        t = SECOND + (k % AT) * STEP  # the simulator is reset after AT samples
        names = NAMES if k == 0 or k % every == every // 2 else NAMES[:2]
        rows = [row for name in names for row in made.push(name, 0, Message(t=t, v=1.0 + k))]
        assert [row.stamp for row in rows] == [t, t], k
    assert made.restarts == 1 and not made.refused
