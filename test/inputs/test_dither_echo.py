"""Dither that nobody adds is noticed within seconds; dither that is added is never missed, whatever becomes of it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from msls_ros.inputs.derivatives import DerivativeFilter
from msls_ros.inputs.dither_echo import SHORTEST as LEAST_TIME
from msls_ros.inputs.dither_echo import DitherEcho

STEP = 0.002
"""Of the simulated actuators [s]."""


class Stack:
    """Actuators and a roll axis, flown by a pilot, with noise, gusts and feedback; two effectors in one record.

    Dither of the first is added where ``added``, that of the second always.
    """

    def __init__(self, seed: int, **given: Any) -> None:
        self.rng = np.random.default_rng(seed)
        self.p: dict[str, Any] = {
            "added": True, "rate": 50.0, "rms": 0.003, "corner": 20.0, "delay": 0.05, "fastest": math.inf,
            "feedback": 0.0, "noise": 2e-4, "pilot": 0.02, "wander": 0.002, "lost": 0.0, "record": 0.0,
            "jitter": 0, "dropped": 0.0, "straddle": 0,
        } | given  # fmt: skip
        self.late = np.random.default_rng([seed, 1])
        self.echo = DitherEcho(("one", "two"), self.p["rate"], self.p["straddle"])
        self.window = DerivativeFilter(self.p["straddle"], 2, 10**9) if self.p["straddle"] else None
        self.found: list[tuple[str, float]] = []

    def take(self, time: float, delta: Any, command: Any) -> None:
        """Hold deflections, of the window that they complete where there is one, against the dither in answer."""
        if self.window is None:
            self.echo.take(time, delta, command)
        elif (row := self.window.push(round(time * 1e9), delta)) is not None:
            self.echo.take(row.stamp * 1e-9, row.smooth, command)

    def fly(self, seconds: float) -> Stack:
        p, rng = self.p, self.rng
        every, late = round(1.0 / p["rate"] / STEP), round(p["delay"] / STEP)
        sent, arrival = np.zeros((round(seconds / STEP) + 1, 2)), 0
        surface, command, roll, wander = np.zeros(2), np.zeros(2), np.zeros(2), np.zeros(2)
        for k in range(len(sent) - 1):
            time = k * STEP
            roll += STEP * (20.0 * surface - 2.0 * roll) + 0.02 * math.sqrt(STEP) * rng.standard_normal(2)
            if k % every == 0:
                wander += -0.3 * wander / p["rate"] + p["wander"] * rng.standard_normal(2) / math.sqrt(p["rate"])
                delta = surface + p["noise"] * rng.standard_normal(2)
                if p["record"]:
                    delta = np.round(delta / p["record"]) * p["record"]
                if rng.random() >= p["lost"]:
                    command = p["rms"] * rng.standard_normal(2)
                    self.take(time, delta, command)
                    if self.late.random() >= p["dropped"]:
                        arrival = max(arrival, k + late + every * int(self.late.integers(0, p["jitter"] + 1)))
                        sent[arrival:] = command
            dither = sent[k] * [p["added"], 1.0]
            stick = 2.0 * p["pilot"] * (1 if time % 8 < 1 else -1 if time % 8 < 2 else 0)
            wanted = stick + wander - p["feedback"] * roll + dither
            surface += STEP * np.clip(p["corner"] * (wanted - surface), -p["fastest"], p["fastest"])
            if k % 250 == 249:
                name = self.echo.judge()
                self.found += [(name, time)] if name else []
        return self


JITTER = {"delay": 0.06, "jitter": 5, "dropped": 0.2}
"""3 to 8 samples late at 50 Hz, another delay for each, commands held, one in five not added."""
ADDED: dict[str, dict[str, Any]] = {
    "as a rule": {},
    "late by .2 s": {"delay": 0.2},
    "a slow actuator": {"corner": 8.0, "delay": 0.1},
    "a damped oscillation": {"corner": 8.0, "feedback": 2.0, "wander": 0.02, "pilot": 0.0, "delay": 0.1, "lost": 0.2},
    "steps of 11 deg": {"pilot": 0.1, "feedback": 1.0, "delay": 0.19, "wander": 0.0, "lost": 0.1, "rate": 100.0},
    "a rate limit that steps reach": {"pilot": 0.1, "fastest": 0.1, "feedback": 0.5, "rate": 25.0, "delay": 0.19},
    "a rate limit": {"fastest": 0.02},
    "feedback": {"feedback": 1.5},
    "lost samples": {"lost": 0.2},
    "all of it": {"delay": 0.2, "fastest": 0.1, "feedback": 0.5, "lost": 0.2},
    "all of it, without noise": {"delay": 0.2, "fastest": 0.1, "feedback": 0.5, "lost": 0.2, "noise": 0.0, "pilot": 0},
    "noise": {"noise": 2e-3},
    "a coarse record": {"record": 0.004},
    "no pilot, no noise": {"noise": 0.0, "pilot": 0.0, "wander": 0.0},
    "10 Hz": {"rate": 10.0},
    "100 Hz": {"rate": 100.0},
    "250 Hz": {"rate": 250.0},
    "tiny": {"rms": 2e-5},
    "latency that jitters": JITTER,
    "latency that jitters, no pilot, no noise": JITTER | {"noise": 0.0, "pilot": 0.0},
    "a window of derivatives": {"straddle": 5},
    "a window of derivatives, a slow actuator": {"straddle": 5, "corner": 8.0, "delay": 0.1},
    "a window of derivatives, 250 Hz": {"straddle": 25, "rate": 250.0},
    "a window of derivatives, latency that jitters": JITTER | {"straddle": 5},
    "as a user flew": JITTER | {"straddle": 5, "rms": 0.02, "fastest": 1.5, "corner": 25.0, "noise": 1e-3},
}


@pytest.mark.parametrize("what", ADDED)
def test_dither_that_is_added_is_never_missed(what: str) -> None:
    assert Stack(len(what), **ADDED[what]).fly(25.0).found == []


@pytest.mark.parametrize(
    "given",
    [{}, {"feedback": 0.5}, {"lost": 0.2}, {"rate": 250.0}, {"rate": 10.0, "wander": 0.0}, {"straddle": 5}, JITTER],
)
def test_dither_that_nobody_adds_is_noticed_and_the_other_is_not(given: dict[str, Any]) -> None:
    stack = Stack(0, added=False, **given).fly(30.0)
    (name, when) = stack.found[0]
    assert (name, len(stack.found), stack.echo.missing, stack.echo.times) == ("one", 1, ("one",), 1)
    assert when < (20.0 if given.get("feedback") or given is JITTER else 12.0)
    assert "the dither commanded for one does not come back in its deflection" in stack.echo.sentence


def test_what_nobody_can_tell_is_not_said() -> None:
    """Noise of the record hides the dither, or there is none, or too little time with any."""
    for given in ({"noise": 0.01}, {"rms": 0.0}, {"rms": 2e-5}, {"pilot": 0.3, "wander": 0.3}):
        assert Stack(0, added=False, **given).fly(25.0).found == []
    assert Stack(0, added=False).fly(LEAST_TIME - 0.5).found == []


def test_the_verdict_ends_when_dither_comes_back_or_when_there_is_none() -> None:
    for ending in ("added", "none"):
        rng = np.random.default_rng(0)
        echo = DitherEcho(("one",), 50.0)
        last = 0.0
        for k in range(2500):
            if k in (490, 500):
                assert echo.judge() == ("one" if k == 500 else "") and bool(echo.sentence) == (k == 500)
            given = rng.standard_normal() if k < 500 or ending == "added" else 0.0
            delta = 1e-4 * rng.standard_normal() + (last if k > 500 else 0.0)
            last = 0.003 * given
            echo.take(0.02 * k, np.array([delta]), np.array([last]) if given else None)
        echo.judge()
        assert (echo.missing, echo.sentence, echo.times) == ((), "", 1)


def test_a_gap_or_a_time_that_goes_back_begins_anew() -> None:
    rng = np.random.default_rng(0)
    for jump in (0.6, -30.0):
        echo = DitherEcho(("one",), 50.0)
        for k in range(300):
            time = 0.02 * k + (jump if k >= 100 else 0.0)
            echo.take(time, np.array([1e-4 * rng.standard_normal()]), np.array([0.003 * rng.standard_normal()]))
            assert k % 10 or echo.judge() == "" or k > 100 + LEAST_TIME / 0.02 - 2
