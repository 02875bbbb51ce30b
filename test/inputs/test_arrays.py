"""Arrays of which some derivatives are not measured go through the window of the flight."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from msls_ros.estimation import Configuration, EstimationError, Identifier, from_mapping
from msls_ros.inputs import InputAdapter, InputMap, StateRow, adapt, differentiated
from msls_ros.inputs.derivatives import usual_intervals

RATE, COUNT = 100.0, 900
TIME = 50.0 + np.arange(COUNT) / RATE
MOTION = np.stack([np.sin(2.0 * TIME), 0.3 * np.cos(3.1 * TIME)], axis=1)  # P [rad/s], Phi [rad]
SLOPES = np.stack([2.0 * np.cos(2.0 * TIME), -0.93 * np.sin(3.1 * TIME)], axis=1)
DELTA = 0.1 * np.sin(1.7 * TIME)[:, None]


def configuration(rate: float = RATE) -> Configuration:
    return from_mapping({"states": ["P", "Phi"], "effectors": ["da"], "sample_rate": rate, "reference_speed": 20.0})


def test_the_window_is_that_of_mapped_messages() -> None:
    """With a spike in a deflection, a gap, and one measured derivative: the same bits."""

    class Log:
        def __init__(self, k: int, delta: float) -> None:
            self.p, self.phi, self.phidot, self.da = *map(float, MOTION[k]), float(SLOPES[k, 1]), delta

    delta = DELTA.copy()
    delta[300] += 0.4
    taken = np.r_[0:500, 560:COUNT]
    lines = {"P": "log p", "Phi": "log phi"}
    inputs = InputMap.from_parameters(
        {
            "topics": {"log": "/log my/msg/Log stamp=arrival"},
            "clock": "log",
            "states": lines,
            "derivatives": {"Phi": "log phidot"},
            "effectors": {"da": "log da"},
        }
    )
    adapter = InputAdapter.of(inputs, configuration(), Counter())
    stamps = np.rint(1e9 * TIME).astype(np.int64)
    rows = list(adapt((("/log", int(stamps[k]), Log(k, float(delta[k, 0]))) for k in taken), adapter))
    states = [row for row in rows if isinstance(row, StateRow)]
    xdot = SLOPES.copy()
    xdot[:, 0] = np.nan
    made = differentiated(configuration(), TIME[taken], MOTION[taken], xdot[taken], delta[taken])
    assert made.straddle == adapter.straddle == usual_intervals(RATE) == 10
    assert adapter.refused == {"spike": 1, "gap": 1}
    assert len(states) == len(made.time) == len(taken) - 20 - 1
    assert made.time.tolist() == [row.stamp * 1e-9 for row in states]
    assert np.array_equal(made.x, [row.x for row in states])
    assert np.array_equal(made.xdot, [row.xdot for row in states])
    assert np.array_equal(made.delta[:, 0], [row.delta[0] for row in rows if not isinstance(row, StateRow)])


def test_a_linear_system_stays_one_and_what_is_measured_stays_as_it_is() -> None:
    a, b = -2.0, 12.0
    x = np.zeros((COUNT, 1))
    for k in range(COUNT - 1):
        mean = 0.5 * b * (DELTA[k, 0] + DELTA[k + 1, 0]) / RATE
        x[k + 1] = ((1.0 + 0.5 * a / RATE) * x[k] + mean) / (1.0 - 0.5 * a / RATE)
    c = from_mapping({"states": ["P"], "effectors": ["da"], "sample_rate": RATE})
    made = differentiated(c, TIME, x, None, DELTA)
    off = np.abs(made.xdot - a * made.x - b * made.delta).max()
    assert off < 1e-4 * np.abs(made.xdot).max(), "by the rule that x is made by"
    measured = differentiated(c, TIME, x, a * x + b * DELTA, DELTA)
    assert measured.straddle == 0
    assert np.array_equal(measured.x, x) and np.array_equal(measured.time, TIME)
    assert Identifier(c, made.straddle).run(*made[:4]).estimates[-1].samples > 800


def test_angles_that_turn_round_and_slower_samples_have_a_window_of_their_own() -> None:
    turning = np.stack([np.full(COUNT, 0.5), np.mod(0.5 * TIME, 2.0 * np.pi)], axis=1)
    made = differentiated(configuration(), TIME, turning, None, DELTA)
    assert made.xdot[:, 1] == pytest.approx(0.5, abs=1e-9)
    slow = differentiated(configuration(), TIME[::5], MOTION[::5], None, DELTA[::5])
    assert slow.straddle == 4
    assert slow.xdot[:, 0] == pytest.approx(np.interp(slow.time, TIME, SLOPES[:, 0]), abs=0.05)
    assert differentiated(configuration(), TIME, MOTION, None, DELTA, intervals=6).straddle == 6


def some_nan() -> np.ndarray:
    found = SLOPES.copy()
    found[7, 0] = np.nan
    return found


@pytest.mark.parametrize(
    ("time", "x", "xdot", "sentence"),
    [
        (TIME, MOTION, some_nan(), "xdot holds .*: dP/dt is nan at sample 7"),
        (TIME, np.where(np.arange(COUNT)[:, None] == 3, np.nan, MOTION), None, "x holds .*: P is nan at sample 3"),
        (TIME, MOTION[:, :1], None, r"x has shape \(900, 1\); expected \(900, 2\)"),
        (TIME, MOTION, SLOPES[:, 0], r"xdot has shape \(900,\); expected \(900, 2\)"),
        (1e3 * TIME, MOTION, None, "probably in ms"),
        (TIME[::-1], MOTION, None, "sample 1, earlier than"),
        (TIME + np.arange(COUNT), MOTION, None, "set sample_rate"),
    ],
)
def test_what_cannot_be_used_is_refused(
    time: np.ndarray, x: np.ndarray, xdot: np.ndarray | None, sentence: str
) -> None:
    with pytest.raises(EstimationError, match=sentence):
        differentiated(configuration(), time, x, xdot, DELTA)


def test_too_few_samples_for_a_window_are_said() -> None:
    with pytest.raises(EstimationError, match=r"time has 10 samples, of which no 11 follow each other within 0\.1 s"):
        differentiated(configuration(), TIME[:10], MOTION[:10], None, DELTA[:10])
