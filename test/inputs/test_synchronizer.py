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
