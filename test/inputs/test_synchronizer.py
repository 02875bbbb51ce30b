"""The gate: pairs by stamp, refuses and counts the rest, starts anew where time jumps back."""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable

import numpy as np
import pytest

from msls_ros.inputs import Refused, Synchronizer

STATES, EFFECTORS = ("u", "P"), ("de", "dr")
TICK = 20_000_000


def gate() -> Synchronizer:
    return Synchronizer(STATES, EFFECTORS)


def refused(reason: str, call: Callable[..., object], *arguments: object) -> str:
    with pytest.raises(Refused) as caught:
        call(*arguments)
    assert caught.value.reason == reason
    return str(caught.value)


def test_a_pair_makes_a_sample_in_either_order() -> None:
    g = gate()
    assert g.add_state(TICK, STATES, [1.0, 2.0], [3.0, 4.0]) is None
    sample = g.add_effectors(TICK, EFFECTORS, [5.0, 6.0])
    assert sample is not None
    assert (sample.x.tolist(), sample.xdot.tolist(), sample.delta.tolist()) == ([1, 2], [3, 4], [5, 6])
    assert g.add_effectors(2 * TICK, EFFECTORS, [5.0, 6.0]) is None
    assert g.add_state(2 * TICK, STATES, [1.0, 2.0], [3.0, 4.0]) is not None
    assert (g.paired, sum(g.refused.values())) == (2, 0)


def test_names_decide_the_order_and_more_of_them_do_no_harm() -> None:
    g = gate()
    g.add_state(TICK, ("P", "w", "u"), [2.0, 9.0, 1.0], [4.0, 9.0, 3.0])
    sample = g.add_effectors(TICK, ("dr", "de"), [6.0, 5.0])
    assert sample is not None
    assert (sample.x.tolist(), sample.xdot.tolist(), sample.delta.tolist()) == ([1, 2], [3, 4], [5, 6])


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("field", ["x", "xdot"])
def test_numbers_that_are_not_finite_are_refused_by_name(field: str, bad: float) -> None:
    g = gate()
    fields = {"x": [1.0, 2.0], "xdot": [3.0, 4.0]}
    fields[field] = [1.0, bad]
    text = refused("not_finite", g.add_state, TICK, STATES, fields["x"], fields["xdot"])
    assert f"{field} of P" in text
    assert g.refused["not_finite"] == 1
    assert "delta of dr" in refused("not_finite", g.add_effectors, TICK, EFFECTORS, [0.0, bad])


def test_numbers_each_below_the_limit_pass_though_their_sum_is_not() -> None:
    g = gate()
    g.add_state(TICK, STATES, [9e11, -9e11], [9e11, 9e11])
    assert g.add_effectors(TICK, EFFECTORS, [0.0, 0.0]) is not None


def test_a_sample_does_not_change_with_the_arrays_it_came_from() -> None:
    g = gate()
    x, xdot, delta = array("d", [1.0, 2.0]), array("d", [3.0, 4.0]), array("d", [5.0, 6.0])
    g.add_state(TICK, STATES, x, xdot)
    sample = g.add_effectors(TICK, EFFECTORS, delta)
    x[0] = xdot[0] = delta[0] = 9.0
    assert sample is not None
    assert (sample.x.tolist(), sample.xdot.tolist(), sample.delta.tolist()) == ([1, 2], [3, 4], [5, 6])


@pytest.mark.parametrize("bad", [1e12, -1e30, 1e300])
def test_numbers_too_large_for_any_aircraft_are_refused(bad: float) -> None:
    g = gate()
    assert "x of P" in refused("too_large", g.add_state, TICK, STATES, [1.0, bad], [3.0, 4.0])
    assert g.add_state(TICK, STATES, [1e11, 2.0], [3.0, 4.0]) is None


def test_wrong_lengths_unknown_and_repeated_names_are_refused() -> None:
    g = gate()
    assert "expected one per name, 2" in refused("length", g.add_state, TICK, STATES, [1.0], [1.0, 2.0])
    assert "expected one per name, 2" in refused("length", g.add_effectors, TICK, EFFECTORS, [1.0, 2.0, 3.0])
    assert "no 'dr' among" in refused("names", g.add_effectors, TICK, ("de", "dx"), [1.0, 2.0])
    assert "repeated names" in refused("names", g.add_state, TICK, ("u", "P", "P"), [1.0] * 3, [1.0] * 3)
    refused("xdot_missing", g.add_state, TICK, STATES, [1.0, 2.0], [])
    assert g.refused == {"length": 2, "names": 2, "xdot_missing": 1}
    assert g.paired == 0


def test_repeated_and_late_stamps_are_refused_and_a_jump_back_starts_anew() -> None:
    g = gate()
    for k in (100, 101):
        g.add_state(k * TICK, STATES, [1.0, 2.0], [3.0, 4.0])
        g.add_effectors(k * TICK, EFFECTORS, [5.0, 6.0])
    refused("stamp_repeated", g.add_state, 101 * TICK, STATES, [1.0, 2.0], [3.0, 4.0])
    refused("stamp_back", g.add_state, 100 * TICK, STATES, [1.0, 2.0], [3.0, 4.0])
    assert g.add_state(TICK, STATES, [1.0, 2.0], [3.0, 4.0]) is None
    sample = g.add_effectors(TICK, EFFECTORS, [5.0, 6.0])
    assert sample is not None
    assert sample.restarted
    assert g.restarts == 1
    g.add_state(2 * TICK, STATES, [1.0, 2.0], [3.0, 4.0])
    sample = g.add_effectors(2 * TICK, EFFECTORS, [5.0, 6.0])
    assert sample is not None
    assert not sample.restarted


def test_what_never_finds_its_partner_is_counted_and_forgotten() -> None:
    g = gate()
    for k in range(1, 1001):
        g.add_state(k * TICK, STATES, [1.0, 2.0], [3.0, 4.0])
    g.add_effectors(1000 * TICK, EFFECTORS, [5.0, 6.0])
    assert g.paired == 1
    assert g.refused["state_unpaired"] == 999


def test_a_refused_message_changes_nothing() -> None:
    g = gate()
    g.add_state(TICK, STATES, [1.0, 2.0], [3.0, 4.0])
    refused("not_finite", g.add_effectors, TICK, EFFECTORS, [math.nan, 0.0])
    sample = g.add_effectors(TICK, EFFECTORS, [5.0, 6.0])
    assert sample is not None
    assert np.array_equal(sample.delta, [5.0, 6.0])


def feed(g: Synchronizer, stamps: list[int], only: str = "both") -> list[tuple[int, bool]]:
    """Return stamp and restart of the samples made."""
    made = []
    for stamp in stamps:
        found = [g.add_state(stamp, STATES, [1.0, 2.0], [3.0, 4.0])] if only != "effectors" else []
        found += [g.add_effectors(stamp, EFFECTORS, [5.0, 6.0])] if only != "state" else []
        made += [(s.stamp, s.restarted) for s in found if s is not None]
    return made


SECOND = 1_000_000_000


@pytest.mark.parametrize("rogue", [0, 1_000 * SECOND], ids=["zero", "far ahead"])
@pytest.mark.parametrize("stream", ["state", "effectors"])
def test_one_rogue_stamp_on_one_stream_is_refused_and_resets_nothing(stream: str, rogue: int) -> None:
    g = gate()
    first = [100 * SECOND + k * TICK for k in range(5)]
    assert len(feed(g, first)) == 5
    assert feed(g, [rogue], stream) == []
    later = [first[-1] + k * TICK for k in range(1, 6)]
    assert feed(g, later) == [(s, False) for s in later]
    assert (g.restarts, dict(g.refused)) == (0, {"stamp_rogue": 1})


def test_a_lone_stream_that_goes_on_in_a_new_time_is_believed() -> None:
    g = gate()
    feed(g, [100 * SECOND])
    feed(g, [k * TICK for k in range(1, 4)], "state")
    assert g.restarts == 1
    assert feed(g, [k * TICK for k in range(2, 4)], "effectors") == [(2 * TICK, True), (3 * TICK, False)]


def test_a_gap_of_both_streams_loses_no_sample_whatever_their_order() -> None:
    for only in (["both"], ["state", "effectors"], ["effectors", "state"]):
        g = gate()
        feed(g, [k * TICK for k in range(1, 4)])
        after = [50 * SECOND, 50 * SECOND + TICK]
        made = [sample for stream in only for sample in feed(g, after, stream)]
        assert made == [(s, False) for s in after], only
        assert (g.restarts, sum(g.refused.values())) == (0, 0)


def test_unpaired_samples_are_reported_with_the_difference_of_the_stamps() -> None:
    told: list[Refused] = []
    g = Synchronizer(STATES, EFFECTORS, report=told.append)
    for k in range(1, 100):
        g.add_state(k * TICK, STATES, [1.0, 2.0], [3.0, 4.0])
        g.add_effectors(k * TICK + 1_500_000, EFFECTORS, [5.0, 6.0])
    assert g.paired == 0 and told
    assert {r.reason for r in told} == {"state_unpaired", "effector_unpaired"}
    assert "the nearest effector sample is stamped +1.500000 ms from it; expected within pairing_tolerance" in str(
        told[0]
    )


@pytest.mark.parametrize("offset", [-1_500_000, 0, 1_500_000])
def test_with_a_tolerance_the_nearest_are_paired_in_whatever_order_they_come(offset: int) -> None:
    made = []
    for late in (0, 1):
        g = Synchronizer(STATES, EFFECTORS, tolerance=0.002)
        arrivals = sorted(
            [(k, 0) for k in range(1, 50)] + [(k, 1) for k in range(1, 50)], key=lambda a: (a[0], a[1] ^ late)
        )
        found = [
            g.add_state(k * TICK, STATES, [k, 2.0], [3.0, 4.0])
            if which == 0
            else g.add_effectors(k * TICK + offset, EFFECTORS, [k, 6.0])
            for k, which in arrivals
        ]
        made.append([(s.stamp, s.x[0], s.delta[0]) for s in found if s is not None])
        assert (g.paired, sum(g.refused.values())) == (49, 0)
    assert made[0] == made[1] == [(k * TICK, k, k) for k in range(1, 50)]
