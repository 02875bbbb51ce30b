"""The mixer: within limits for any input, and the stack's own command whenever the dither is not valid."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from msls_ros.estimation import EstimationError, Level
from msls_ros.estimation.mixer import Mixer, MixerLimits

LIMITS = MixerLimits((0.05, 0.02, 0.1), (-0.4, -0.5, -0.2), (0.4, 0.5, 0.3), (1.0, 2.0, 0.5), 0.1)
LOW, HIGH, RATE, AUTHORITY = (np.array(v) for v in (LIMITS.low, LIMITS.high, LIMITS.rate, LIMITS.authority))
ANY = st.floats(width=64)
SMALL = st.floats(-0.02, 0.02)
COMMANDS = st.lists(ANY | st.floats(-0.6, 0.6), min_size=3, max_size=3)
DITHERS = st.lists(SMALL, min_size=3, max_size=3) | st.lists(ANY, max_size=4)
STEPS = st.lists(
    st.tuples(st.floats(-0.5, 0.5), COMMANDS, DITHERS, st.integers(-1, 4), st.booleans(), st.floats(0.0, 0.3)),
    min_size=1,
    max_size=8,
)
ULP = 1e-12


def same_bits(one: np.ndarray, other: np.ndarray) -> bool:
    return one.tobytes() == other.tobytes()


@given(steps=STEPS)
def test_for_any_input_the_output_is_within_limits_or_the_stack_s_own_command(
    steps: list[tuple[float, list[float], list[float], int, bool, float]],
) -> None:
    mixer = Mixer(3, LIMITS)
    now, last = 0.0, None
    for step, values, dither, level, enabled, age in steps:
        now += step
        command = np.array(values)
        mixer.enabled = enabled
        refused = mixer.take(now - age, dither, level)
        made = mixer.mix(now, command)
        valid = enabled and not refused and age <= LIMITS.stale_after and np.isfinite(command).all()
        if not made.mixed:
            assert same_bits(made.command, command) and made.reason
        else:
            assert valid
            size = np.abs(command) * 1e-15 + ULP
            assert (made.command >= np.minimum(LOW, command)).all() and (
                made.command <= np.maximum(HIGH, command)
            ).all()
            assert (np.abs(made.command - command) <= AUTHORITY + size).all()
            if last is not None and now >= last[0] and np.isfinite(last[1]).all():
                reach = np.maximum(RATE * (now - last[0]), np.abs(command - last[1]))
                assert (np.abs(made.command - last[1]) <= reach + np.abs(last[1]) * 1e-15 + ULP).all()
        last = now, made.command


@given(
    st.lists(st.floats(-0.1, 0.1), min_size=3, max_size=3), st.lists(st.floats(-0.015, 0.015), min_size=3, max_size=3)
)
def test_within_all_limits_it_is_the_plain_sum_to_the_bit(command: list[float], dither: list[float]) -> None:
    mixer = Mixer(3, LIMITS)
    assert mixer.take(0.0, dither, Level.NOMINAL) == ""
    assert same_bits(mixer.mix(0.0, np.array(command)).command, np.array(command) + np.array(dither))
    bare = Mixer(3)
    bare.take(0.0, dither, Level.NOMINAL)
    for k in range(3):
        assert same_bits(bare.mix(0.01 * k, np.array(command)).command, np.array(command) + np.array(dither))


NAN = math.nan
INVALID: dict[str, tuple[dict[str, Any], str]] = {
    "inhibited": (dict(level=Level.INHIBITED), "inhibited"),
    "off": (dict(level=Level.OFF), "off"),
    "stale": (dict(age=0.11), "0.11 s old"),
    "from the future": (dict(age=-0.01), "old"),
    "not finite": (dict(dither=[0.0, NAN, 0.0]), "not finite"),
    "short": (dict(dither=[0.01, 0.01]), "2 values; expected 3"),
    "beyond its authority": (dict(dither=[0.0, 0.03, 0.0]), "effector 1"),
    "switched off": (dict(enabled=False), "master switch"),
}


@pytest.mark.parametrize("what", INVALID)
def test_a_dither_that_is_not_valid_leaves_the_command_and_says_why(what: str) -> None:
    changes, why = INVALID[what]
    case: dict[str, Any] = {"level": Level.NOMINAL, "age": 0.0, "dither": [0.01] * 3, "enabled": True, **changes}
    mixer = Mixer(3, LIMITS)
    mixer.take(0.9, [0.01] * 3, Level.NOMINAL)
    command = np.array([0.1, -0.0, 5.0])
    assert mixer.mix(0.9, command).mixed
    mixer.enabled = case["enabled"]
    mixer.take(1.0 - case["age"], case["dither"], case["level"])
    made = mixer.mix(1.0, command)
    assert not made.mixed and same_bits(made.command, command)
    assert why in made.reason


def test_the_dither_is_scaled_into_the_units_of_the_command() -> None:
    mixer = Mixer(2, scale=(2.0, -100.0))
    mixer.take(0.0, [0.01, 0.01], Level.BOOSTED)
    assert mixer.mix(0.0, np.array([0.5, 1500.0])).command.tolist() == [0.52, 1499.0]


@pytest.mark.parametrize(
    "limits", [MixerLimits(low=(0.0,)), MixerLimits(low=(1.0, 1.0), high=(0.0, 0.0)), MixerLimits(rate=(NAN, 1.0))]
)
def test_limits_that_make_no_sense_are_refused(limits: MixerLimits) -> None:
    with pytest.raises(EstimationError, match="expected"):
        Mixer(2, limits)
