"""Jumps of velocities that no force makes stay out of their derivatives, and nothing else does."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from msls_ros.estimation import Configuration, from_mapping
from msls_ros.inputs import InputAdapter, InputMap, Refused, StateRow, Windowed, adapt, differentiated
from msls_ros.inputs.derivatives import DerivativeFilter, usual_intervals
from msls_ros.inputs.velocity_jumps import JumpFilter

SPEED = 20.0
SIZES = np.array([0.3, -0.2, 0.0])
"""Of the jump of u, w and Q [m/s, m/s, rad/s]."""
NAMES = ("u", "w", "Q")


def configuration(rate: float) -> Configuration:
    names = {"states": NAMES, "effectors": ["de"], "known_gravity": False}
    return from_mapping({**names, "sample_rate": rate, "reference_speed": SPEED})


def motion(rate: float, seconds: float = 20.0) -> tuple[np.ndarray, np.ndarray]:
    """Return times (k,) and u, w, Q (k, 3) of a flight without noise."""
    time = 5.0 + np.arange(round(seconds * rate)) / rate
    u = SPEED + 0.8 * np.sin(0.7 * time)
    return time, np.stack([u, 1.0 + 0.4 * np.sin(2.1 * time), 0.2 * np.cos(2.1 * time)], axis=1)


def jumped(time: np.ndarray, x: np.ndarray, at: float, sizes: np.ndarray = SIZES) -> np.ndarray:
    return np.asarray(x + np.where(time >= at, 1.0, 0.0)[:, None] * sizes)


def make(rate: float, time: np.ndarray, x: np.ndarray) -> Windowed:
    return differentiated(configuration(rate), time, x, None, np.zeros((len(time), 1)))


def plain(rate: float, time: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return the slopes of the window alone."""
    window = DerivativeFilter(usual_intervals(rate), x.shape[1], 10**9)
    rows = (window.push(round(1e9 * t), row) for t, row in zip(time, x, strict=True))
    return np.array([row.slope for row in rows if row is not None])


@pytest.mark.parametrize("rate", [25.0, 50.0, 100.0])
@pytest.mark.parametrize("noise", [0.0, 0.004])
def test_a_jump_leaves_the_slopes_as_without_it(rate: float, noise: float) -> None:
    """In the interval itself, whose increment is the mean of those beside it; the state has jumped."""
    time, x = motion(rate)
    x[:, :2] += noise * np.random.default_rng(1).normal(size=(len(time), 2))
    with_it, without = make(rate, time, jumped(time, x, 15.0)), make(rate, time, x)
    assert (with_it.jumps, without.jumps) == (1, 0)
    assert with_it.largest_jump == pytest.approx(0.3, abs=0.01 + 5.0 * noise)
    assert len(with_it.time) == len(without.time)
    assert np.abs(with_it.xdot - without.xdot).max() < 0.02 + 3.0 * noise * rate
    after = with_it.time > 15.2
    assert np.allclose(with_it.x[after] - without.x[after], SIZES, atol=1e-9)
    assert np.array_equal(with_it.xdot[:, 2], without.xdot[:, 2])


def test_each_of_several_jumps_is_found() -> None:
    time, x = motion(50.0, 60.0)
    for at in (15.0, 18.0, 25.0, 40.0, 55.0):
        x = jumped(time, x, at)
    assert make(50.0, time, x).jumps == 5


def test_a_jump_of_an_angular_rate_stays() -> None:
    time, x = motion(50.0)
    made = make(50.0, time, jumped(time, x, 15.0, np.array([0.0, 0.0, 0.5])))
    assert made.jumps == 0 and np.abs(made.xdot[:, 2]).max() > 3.0


def elevator_step(time: np.ndarray) -> np.ndarray:
    """Return u, w, Q (k, 3) of a short period that steps of the elevator excite, without noise or servo."""
    a, b = np.array([[-4.0, SPEED], [-0.8, -5.0]]), np.array([-12.0, -40.0])
    step = float(time[1] - time[0]) / 10
    x, delta = np.zeros((len(time), 2)), np.where((time % 4.0 < 1.0) & (time > 12.0), 0.1, 0.0)
    for k in range(len(time) - 1):
        x[k + 1] = x[k]
        for _ in range(10):
            x[k + 1] += step * (a @ x[k + 1] + b * delta[k])
    return np.column_stack([np.full(len(time), SPEED), x])


def untouched(name: str, rate: float) -> tuple[np.ndarray, np.ndarray]:
    time, x = motion(rate, 60.0)
    random = np.random.default_rng(7)
    white, noise = random.normal(size=x.shape), np.array([1.0, 1.0, 0.0])
    if name == "elevator":
        return time, elevator_step(time)
    if name.startswith("held"):
        each = round(rate / float(name.split()[1]))
        x = x + 0.02 * white * noise
        x[:, :2] = x[np.arange(len(x)) // each * each, :2]
    elif name.startswith("white"):
        x = x + float(name.split()[1]) * white * noise
    elif name == "walk":
        x = x + 0.02 * np.cumsum(white, axis=0) * noise
    elif name == "gusts":  # first order, 2 m/s, 200 m at 20 m/s
        share = 0.1 / rate
        gust = np.zeros_like(x)
        for k in range(1, len(x)):
            gust[k] = (1.0 - share) * gust[k - 1] + 2.0 * np.sqrt(2.0 * share) * white[k]
        x = x + gust * noise
    elif name.startswith("steps"):
        x[:, :2] = np.round(x[:, :2] / float(name.split()[1])) * float(name.split()[1])
    return time, x


@pytest.mark.parametrize("rate", [25.0, 50.0, 100.0])
@pytest.mark.parametrize(
    "name",
    [
        "smooth", "elevator", "held 5", "held 1", "white 1e-5", "white .01", "white .2", "walk", "gusts", "steps .01",
        "steps .1",
    ],
)  # fmt: skip
def test_what_is_no_jump_is_not_touched(name: str, rate: float) -> None:
    """To the bit: these are the slopes of the window alone."""
    time, x = untouched(name, rate)
    jumps = JumpFilter([0, 1], SPEED, 10**9)
    window = DerivativeFilter(usual_intervals(rate), 3, 10**9)
    settled = [one for t, row in zip(time, x, strict=True) for one in jumps.push(round(1e9 * t), row)]
    assert jumps.count == 0 and len(settled) >= len(time) - 1
    found = [made.slope for one in settled if (made := window.push(*one)) is not None]
    assert np.array_equal(found, plain(rate, time, x)[: len(found)])


def test_a_spike_of_one_sample_is_no_jump() -> None:
    time, x = motion(50.0)
    x[500, :2] += 0.5
    jumps = JumpFilter([0, 1], SPEED, 10**9)
    settled = [one for t, row in zip(time, x, strict=True) for one in jumps.push(round(1e9 * t), row)]
    assert jumps.count == 0 and all(one.jump is None for one in settled)


@pytest.mark.parametrize("at", [15.0, 19.98])
def test_a_sample_waits_for_the_next_only_where_it_may_be_a_jump_and_a_gap_ends_that(at: float) -> None:
    time, x = motion(50.0, 15.0)
    x = jumped(time, x, at)
    jumps = JumpFilter([0, 1], SPEED, 100_000_000)
    passed = [len(jumps.push(round(1e9 * t), row)) for t, row in zip(time, x, strict=True)]
    place = int(np.argmax(time >= at))
    assert [k for k, count in enumerate(passed) if count != 1] == ([place, place + 1] if at < 19.9 else [place])
    if at > 19.9:
        assert [one.jump for one in jumps.push(round(1e9 * (at + 0.5)), x[-1])] == [None, None]
        assert jumps.count == 0


def test_live_and_from_arrays_are_the_same_bits_and_the_jump_is_counted_with_its_size() -> None:
    rate = 50.0
    time, x = motion(rate)
    x = jumped(time, x + 0.003 * np.random.default_rng(3).normal(size=x.shape), 15.0)

    class Log:
        def __init__(self, row: np.ndarray) -> None:
            self.u, self.w, self.q = map(float, row)
            self.de = 0.0

    lines = {"u": "log u", "w": "log w", "Q": "log q"}
    inputs = InputMap.from_parameters(
        {"topics": {"log": "/log my/msg/Log stamp=arrival"}, "clock": "log", "states": lines}
        | {"derivatives": {}, "effectors": {"de": "log de"}}
    )
    told: list[Refused] = []
    adapter = InputAdapter.of(inputs, configuration(rate), Counter(), told.append)
    sent = [("/log", round(1e9 * t), Log(row)) for t, row in zip(time, x, strict=True)]
    rows = [row for row in adapt(sent, adapter) if isinstance(row, StateRow)]
    made = make(rate, time, x)
    assert adapter.refused == {"velocity_jump": 1} and made.jumps == 1
    text = "u at 15.000 s jumps by 0.299 m/s without a force, the largest 0.299 m/s"
    assert text in str(told[0])
    assert made.time.tolist() == [row.stamp * 1e-9 for row in rows]
    assert np.array_equal(made.x, [row.x for row in rows])
    assert np.array_equal(made.xdot, [row.xdot for row in rows])
