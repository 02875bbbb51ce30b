"""What the page says is known and what changed slowly, on made-up models."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from msls_ros.report.flight_report import make_report
from msls_ros.report.knowledge import gather_knowledge, slow_changes
from msls_ros.report.recorded import Array, Event, Models, Recorded
from msls_ros.report.style import causal_rms, number
from msls_ros.report.verdict import what_changed


def models(value: Array, std: Array, reliable: Array) -> Models:
    """Return models of P with one effector da; k of them, ten a second."""
    k = len(value)
    flags = np.zeros((k, 1, 1), np.bool_)
    return Models(
        time=0.1 * np.arange(k, dtype=np.float64), states=("P",), effectors=("da",), regressors=("P", "da", "1"),
        a=np.full((k, 1, 1), -8.0), b=value[:, None, None], a_std=np.ones((k, 1, 1)), b_std=std[:, None, None],
        a_known=np.zeros((1, 1), np.bool_), a_reliable=flags, b_reliable=reliable[:, None, None].astype(np.bool_),
        excitation=np.zeros((k, 3)), residual_std=np.ones((k, 1)),
    )  # fmt: skip


TIME: Array = 0.1 * np.arange(300, dtype=np.float64)
SURE: Array = np.ones(300, dtype=np.float64)


def alarm(time: float) -> Event:
    return Event(time, "detected", ("P",), (9.0,), (7.0,), "", np.nan, np.nan, "")


def test_the_section_of_what_changed_says_the_name_that_the_verdict_gives() -> None:
    """Where nothing was reliable before the alarm no number can be said to be another one."""
    named = replace(alarm(4.2), kind="isolated", effector="da", effectiveness=0.48, effectiveness_std=0.23)
    unsure = models(83.0 * SURE, SURE, 0.0 * SURE)
    made = make_report(Recorded("made/up", "", [], models=unsure, events=[alarm(4.0), named]))
    assert "da 48 ± 23 %, named 0.20 s" in made.verdict[0]
    assert made.html.count(made.verdict[0]) == 2 and "Nothing that is sure" not in made.html
    quiet = make_report(Recorded("made/up", "", [], models=unsure))
    assert "Nothing that is sure" in quiet.html


def test_a_slow_change_is_found_with_its_beginning_and_end() -> None:
    value = np.interp(TIME, [15.0, 18.0], [20.0, 10.0])
    (found,) = slow_changes(models(value, 0.3 * SURE, SURE), [])
    assert found.name == "P/da"
    assert (found.before, found.after) == pytest.approx((20.0, 10.0), abs=0.2)
    assert (found.begin, found.end) == pytest.approx((15.0, 18.0), abs=0.7)


@pytest.mark.parametrize(
    ("value", "std", "reliable", "alarms"),
    [
        (20.0 + 0.0 * TIME, 0.3, SURE, []),
        (np.interp(TIME, [15.0, 18.0], [20.0, 10.0]), 3.0, SURE, []),
        (np.interp(TIME, [15.0, 18.0], [20.0, 17.0]), 0.1, SURE, []),
        (np.interp(TIME, [0.0, 2.0], [0.0, 20.0]), 0.1, SURE, []),
        (np.where(TIME > 15.0, 10.0, 20.0), 0.1, SURE, [alarm(15.05)]),
        (np.interp(TIME, [15.0, 18.0], [20.0, 10.0]), 0.1, (TIME < 15.0).astype(float), []),
    ],
    ids=["nothing", "not sure", "small", "settling", "alarmed", "not reliable"],
)
def test_what_is_no_slow_change_is_not_called_one(
    value: Array, std: float, reliable: Array, alarms: list[Event]
) -> None:
    assert slow_changes(models(value, std * SURE, reliable), alarms) == []


def test_the_best_value_stays_known_when_it_is_not_excited_any_more() -> None:
    std = np.where(TIME < 10.0, 0.5, 40.0)
    known = gather_knowledge(models(20.0 + 0.0 * TIME, std, (TIME < 10.0).astype(float)), [])
    assert known.known[0, 1] and not known.now[0, 1]
    assert (known.value[0, 1], known.std[0, 1]) == (20.0, 0.5) and known.time[0, 1] < 10.0
    assert known.well == 1 and known.free.sum() == 2


def test_what_was_known_before_an_alarm_or_is_contradicted_is_not_known() -> None:
    one = models(20.0 + 0.0 * TIME, 0.5 * SURE, (TIME < 10.0).astype(float))
    assert not gather_knowledge(one, [alarm(12.0)]).known.any()
    value = np.where(TIME < 10.0, 20.0, 5.0)
    assert not gather_knowledge(replace(one, b=value[:, None, None]), []).known.any()


@pytest.mark.parametrize("until", [0.5, 2.0])
def test_what_was_reliable_for_a_moment_only_is_not_known(until: float) -> None:
    reliable = (np.abs(TIME - 10.0) < 0.5 * until).astype(float)
    known = gather_knowledge(models(20.0 + 0.0 * TIME, np.where(reliable, 0.5, 40.0), reliable), [])
    assert known.known.any() == (until > 1.0)


def test_several_alarms_make_one_sentence() -> None:
    said = what_changed([alarm(4.0), alarm(8.0)], [])
    assert said.startswith("Abrupt change of dP/dt at 4.00 s") and "; abrupt change of dP/dt at 8.00 s" in said


def test_the_rms_looks_back_only() -> None:
    step = np.zeros((20, 1))
    step[10:] = 2.0
    found = causal_rms(step, 5)
    assert (found[:10] == 0.0).all() and found[14] == 2.0 and found[10] == pytest.approx(np.sqrt(4.0 / 5.0))


@pytest.mark.parametrize(
    ("value", "text"),
    [(12345.678, "12346"), (-0.0123456, "−0.0123"), (0.0, "0"), (float("inf"), "∞"), (1.5e-9, "1.5e−09")],
)
def test_numbers_are_written_as_people_write_them(value: float, text: str) -> None:
    assert number(value) == text
