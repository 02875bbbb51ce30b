"""What a caller of the library gives: stamps, numbers and whole numbers that cannot be right are one sentence."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from msls_ros.estimation import Configuration, EstimationError, Identifier, from_mapping

RATE, COUNT = 25.0, 60
TIME = 100.0 + np.arange(COUNT) / RATE
RANDOM = np.random.default_rng(0)
X, DELTA = RANDOM.standard_normal((COUNT, 2)), 0.1 * RANDOM.standard_normal((COUNT, 2))
XDOT = -X + 3.0 * DELTA


def identifier(method: str = "msls", *, gated: bool = False) -> Identifier:
    names = {"states": ["p", "r"], "effectors": ["da", "dr"], "sample_rate": RATE}
    return Identifier(from_mapping({**names, "estimator.method": method, "detector.mode": "off"}), gated=gated)


def changed(index: int, value: float) -> np.ndarray:
    time = TIME.copy()
    time[index] = value
    return time


@pytest.mark.parametrize(
    ("time", "sentence"),
    [
        (changed(40, np.nan), "time is nan at sample 40; expected finite seconds"),
        (changed(40, np.inf), "time is inf at sample 40; expected finite"),
        (np.full(COUNT, np.nan), "time is nan at sample 0"),
        (changed(40, TIME[39]), r"time is 101\.56\d* s at sample 40, the same as the 101\.56\d* s before it; expected"),
        (changed(40, TIME[20]), r"sample 40, earlier than the 101\.56.*increase strictly"),
        (np.full(COUNT, 100.0), "sample 1, the same as"),
        (TIME[::-1], "sample 1, earlier than"),
        ((TIME + 1.7e9).astype(np.float32), "sample 1, the same as.*float32 is too coarse.*give float64"),
        (1e3 * TIME, r"by 40 s in the median, 1e\+03 times the 0.04 s of sample_rate.*in ms, give time / 1000"),
        ((1e6 * TIME).astype(np.int64), r"in us, give time / 1e\+06"),
        ((1e9 * TIME).astype(np.int64), r"in ns, give time / 1e\+09; where they are seconds, set sample_rate to"),
        (TIME / 3600.0, r"in hours, give time \* 3600"),
        (TIME / 20.0, "0.05 times the 0.04 s of sample_rate.*set sample_rate to 500 Hz"),
        ((1e9 * TIME).astype("datetime64[ns]"), r"dtype datetime64\[ns\]; .*\(time - time\[0\]\) / np\.timedelta64\(1"),
        ((1e9 * TIME).astype("timedelta64[ns]"), r"dtype timedelta64\[ns\]; .*time / np\.timedelta64\(1, 's'\)"),
        (TIME.astype(str), "time is of dtype <U.*give numbers"),
        (TIME[:, None], r"time has shape \(60, 1\); expected one dimension"),
    ],
    ids=lambda value: "" if isinstance(value, np.ndarray) else value[:30],
)
def test_times_that_are_no_increasing_seconds_are_refused_and_change_nothing(time: Any, sentence: str) -> None:
    one = identifier()
    with pytest.raises(EstimationError, match=sentence):
        one.run(time, X, XDOT, DELTA)
    assert one.samples == 0
    assert np.array_equal(one.run(TIME, X, XDOT, DELTA).estimates[-1].b, last(identifier()))


def last(one: Identifier) -> np.ndarray:
    return one.run(TIME, X, XDOT, DELTA).estimates[-1].b


@pytest.mark.parametrize(
    "time",
    [
        TIME.tolist(),
        (TIME - 100.0).astype(np.float32),
        TIME + np.where(np.arange(COUNT) > 30, 5000.0, 0.0),
        np.cumsum(np.where(np.arange(COUNT) % 3 == 0, 0.2, 0.04)),
        0.3 * np.arange(COUNT),
        -TIME[::-1],
    ],
    ids=["list", "float32", "a gap", "every third late", "the slowest pace", "before 0"],
)
def test_gaps_slow_samples_and_other_types_are_taken(time: Any) -> None:
    assert identifier().run(time, X, XDOT, DELTA).estimates[-1].samples == COUNT


@pytest.mark.parametrize("time", [np.nan, -np.inf, 101.0, 100.5, None, "now", np.datetime64(10**9, "ns"), [1.0, 2.0]])
def test_one_by_one_the_same_times_are_refused_and_change_nothing(time: Any) -> None:
    one, twin = identifier(), identifier()
    one.learn(101.0, X[0], XDOT[0], DELTA[0])
    twin.learn(101.0, X[0], XDOT[0], DELTA[0])
    with pytest.raises(EstimationError, match="time "):
        one.update(time, X[1], XDOT[1], DELTA[1])
    found, wanted = (i.update(101.04, X[1], XDOT[1], DELTA[1]) for i in (one, twin))
    assert found.samples == 2 and np.array_equal(found.b, wanted.b)


@pytest.mark.parametrize("unit", [1e3, 1e9, 1.0 / 3600.0])
def test_one_by_one_a_wrong_unit_is_refused_before_long_and_gaps_are_not(unit: float) -> None:
    one = identifier()
    taken = 0
    with pytest.raises(EstimationError, match=r"of sample_rate; expected seconds: it is probably in"):
        for k in range(COUNT):
            one.learn(unit * TIME[k], X[k], XDOT[k], DELTA[k])
            taken += 1
    assert taken <= 22
    one.reset()
    for k in range(COUNT):  # two samples, then a gap
        one.learn(TIME[k] + 100.0 * (k // 2), X[k], XDOT[k], DELTA[k])
    assert one.samples == COUNT


def test_a_reset_and_a_warm_start_may_be_followed_by_any_time_and_a_run_may_not() -> None:
    one = identifier()
    one.run(TIME, X, XDOT, DELTA)
    with pytest.raises(EstimationError, match="sample 0, earlier than the 102"):
        one.run(TIME, X, XDOT, DELTA)
    with pytest.raises(EstimationError, match="sample 0, the same as the 102"):
        one.update(TIME[-1], X[0], XDOT[0], DELTA[0])
    one.warm_start(np.zeros((2, 2)), np.zeros((2, 2)), np.zeros(2), np.eye(5))
    one.update(1.0, X[0], XDOT[0], DELTA[0])
    one.reset()
    assert np.array_equal(last(one), last(identifier()))


def test_blocks_with_gaps_between_them_are_no_wrong_unit() -> None:
    one = identifier()
    for k in range(30):
        one.run(TIME + 100.0 * k, X, XDOT, DELTA, every=COUNT)
    one.learn(TIME[0] + 3000.0, X[0], XDOT[0], DELTA[0])
    assert one.samples == 30 * COUNT + 1


@pytest.mark.parametrize("method", ["msls", "bank"])
def test_stamps_of_the_gate_may_be_the_same_in_seconds(method: str) -> None:
    """Nanoseconds since 1970 that differ are refused by nobody, though float64 has them .24 us apart."""
    stamps: Any = 1_700_000_000_000_000_000 + np.repeat(40_000_000 * np.arange(COUNT // 2), 2) + np.arange(COUNT) % 2
    time = stamps * 1e-9
    assert not np.diff(time).all()
    whole = identifier(method, gated=True).run(time, X, XDOT, DELTA).estimates[-1]
    single = identifier(method, gated=True)
    for k in range(COUNT):
        found = single.update(time[k], X[k], XDOT[k], DELTA[k])
    assert np.array_equal(found.b, whole.b) and whole.samples == COUNT


def at(array: np.ndarray, value: float) -> np.ndarray:
    found = array.copy()
    found[41, 1] = value
    return found


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: identifier().run(TIME, X, XDOT, DELTA, every=0), "every is 0; it must be a whole number, 1 or more"),
        (lambda: identifier().run(TIME, X, XDOT, DELTA, every=2.5), "every is 2.5; it must be"),  # type: ignore[arg-type]
        (lambda: Identifier(Configuration(), -1), "straddle is -1; it must be a whole number, 0 or more"),
        (lambda: Identifier(Configuration(), 2.5), "straddle is 2.5; it must be"),  # type: ignore[arg-type]
        (lambda: Identifier(Configuration(), True), "straddle is True; it must be"),
        (lambda: identifier().run(TIME, X.astype(str), XDOT, DELTA), "x is of dtype <U.*give numbers: float64"),
        (lambda: identifier().run(TIME, X, [["a", 1.0]] * COUNT, DELTA), "xdot is of dtype <U"),  # type: ignore[arg-type]
        (lambda: identifier().run(TIME, X, XDOT, [[1.0], [2.0, 3.0]]), "delta is no array of numbers"),  # type: ignore[arg-type]
        (lambda: identifier().run(TIME, X, XDOT, 1j * DELTA), "delta is of dtype complex128"),  # type: ignore[arg-type]
        (lambda: identifier().run(TIME, at(X, np.nan), XDOT, DELTA), "not finite or too large: r is nan at sample 41"),
        (lambda: identifier().run(TIME, X, at(XDOT, -np.inf), DELTA), "xdot .*: dr/dt is -inf at sample 41"),
        (lambda: identifier().run(TIME, X, XDOT, at(DELTA, 1e13)), r"delta .*: dr is 1e\+13 at sample 41"),
        (lambda: identifier().run(TIME[:-1], X, XDOT, DELTA), r"x has shape \(60, 2\); expected \(59, 2\)"),
        (lambda: identifier().update(1.0, np.array(["a", "b"]), X[0], X[0]), "x is of dtype <U1"),
        (lambda: Configuration(states="PR"), r"'states' is 'PR'; it must be a list of names, as \('P', 'R'\)"),  # type: ignore[arg-type]
        (lambda: Configuration(effectors=()), "'effectors' is empty; name at least one"),
        (lambda: Configuration(states=()), "'states' is empty"),
        (lambda: Configuration(states=("P", 1)), "'states' is .*; it must be a list of names"),  # type: ignore[arg-type]
        (lambda: Configuration(sample_rate="25"), "'sample_rate' is '25'; it must be a number"),  # type: ignore[arg-type]
        (lambda: Configuration(known_gravity="no"), "'known_gravity' is 'no'; it must be true or false"),  # type: ignore[arg-type]
        (
            lambda: Configuration(thrust_effectors=("da",)),  # type: ignore[arg-type]
            r"'thrust_effectors' is \('da',\); it must be one text, with commas between names, as 'dte, dtr'",
        ),
        (lambda: Configuration(thrust_effectors="da"), "'thrust_effectors' names 'da'.*; effectors are de, dr"),
        (
            lambda: Configuration(estimator={"method": "rls"}),  # type: ignore[arg-type]
            r"'estimator' is {'method': 'rls'}; it must be EstimatorParameters\(\.\.\.\); .*from_mapping",
        ),
    ],
)
def test_what_a_caller_gives_wrongly_is_one_sentence(call: Callable[[], object], sentence: str) -> None:
    with pytest.raises(EstimationError, match=sentence):
        call()


def test_lists_of_names_and_the_numbers_of_numpy_serve() -> None:
    c = Configuration(states=["P", "R"], effectors=np.array(["da"]), sample_rate=np.float32(25), known_gravity=False)  # type: ignore[arg-type]
    assert c == Configuration(states=("P", "R"), effectors=("da",), sample_rate=25.0, known_gravity=False)
    assert [type(v) for v in (c.states, c.effectors[0], c.sample_rate)] == [tuple, str, float]
    one = Identifier(c, np.int64(0))  # type: ignore[arg-type]
    assert one.run(TIME.astype(object), X.tolist(), XDOT, DELTA[:, :1], np.int64(20)).estimates[-1].samples == COUNT  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "xdot", [None, np.full((COUNT, 2), np.nan), np.column_stack([XDOT[:, 0], np.full(COUNT, np.nan)])]
)
def test_derivatives_that_were_not_measured_are_refused_with_what_makes_them(xdot: Any) -> None:
    with pytest.raises(EstimationError, match=r"xdot .*msls_ros\.inputs\.differentiated"):
        identifier().run(TIME, X, xdot, DELTA)
