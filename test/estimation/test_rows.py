"""What the loop over samples promises: the same bits compiled or not and however cut up; known terms that touch."""

from __future__ import annotations

import contextlib
import hashlib
import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from msls_ros.estimation import Configuration, Estimate, EventKind, Identifier, Regression, from_mapping
from msls_ros.estimation.compiled import HAVE_NUMBA, compiled
from msls_ros.estimation.kernel import Array
from msls_ros.estimation.kinematics import (
    FLIGHT_STATES,
    GRAVITY,
    GYROSCOPIC_PITCH,
    add_known,
    find_known,
    find_states,
)
from msls_ros.estimation.uncertainty import row_uncertainty

SMALL: dict[str, Any] = {
    "estimator.method": "msls",
    "states": ("P", "Q", "R"),
    "effectors": ("da", "de"),
    "known_gravity": False,
    "estimator.forgetting_factor": 0.9,
    "estimator.penalty": 0.01,
    "detector.threshold": 20.0,
    "detector.window": 10,
    "detector.hold_off": 10,
    "recovery.rejoin_tolerance": 1e-6,
    "detector.floor_relative": 0.02,
    "detector.floor_model": 0.0,
}
MODES: dict[str, dict[str, Any]] = {
    "normalised": {"detector.mode": "normalised"},
    "paper": {"detector.mode": "paper", "reliability.coloured": False, "dither.bandwidth": 2.0},
    "ratio": {
        "detector.mode": "ratio",
        "detector.threshold": 5.0,
        "estimator.penalty_retained": False,
        "estimator.scale": "auto",
    },
    "rls": {"estimator.method": "rls"},
}
SAMPLES, FAULT = 300, 100

BITS = """
import sys
sys.path.insert(0, sys.argv[1])
from msls_ros.estimation.compiled import HAVE_NUMBA
from estimation.test_rows import MODES, digest
print(HAVE_NUMBA, [digest(mode) for mode in MODES])
"""


def configuration(mode: str) -> Configuration:
    return from_mapping({**SMALL, **MODES[mode]})


def flight() -> tuple[Array, Array, Array, Array]:
    """Return a flight whose first effector loses its effect on P."""
    rng = np.random.default_rng(11)
    x, delta = rng.normal(size=(SAMPLES, 3)), rng.normal(size=(SAMPLES, 2)) * 0.3
    a, b = rng.normal(size=(3, 3)), 5.0 * rng.normal(size=(3, 2))
    b[0, 0] = 8.0
    xdot = x @ a.T + delta @ b.T + rng.normal(size=(SAMPLES, 3)) * 0.01
    xdot[FAULT:, 0] -= b[0, 0] * delta[FAULT:, 0]
    return 0.02 * np.arange(SAMPLES, dtype=np.float64), x, xdot, delta


def numbers(estimate: Estimate) -> bytes:
    """Return every number of an estimate."""
    arrays = (v for v in vars(estimate).values() if isinstance(v, np.ndarray))
    others = (estimate.events, estimate.samples, estimate.dither.rms, estimate.dither.level, estimate.dither.reason)
    return b"".join(v.tobytes() for v in arrays) + estimate.dither.delta.tobytes() + repr(others).encode()


def digest(mode: str) -> str:
    """Return a hash of every number that a flight gives."""
    total = hashlib.sha256()
    for estimate in Identifier(configuration(mode)).run(*flight()).estimates:
        total.update(numbers(estimate))
    return total.hexdigest()


def run_bits(disable: str) -> tuple[str, str]:
    environment = {**os.environ, "NUMBA_DISABLE_JIT": disable}
    command = [sys.executable, "-W", "default", "-c", BITS, str(Path(__file__).parents[1])]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return done.stdout, done.stderr


def test_compiled_and_interpreted_give_the_same_bits_and_interpreted_says_its_rate() -> None:
    (fast, _), (slow, warning) = run_bits("0"), run_bits("1")
    assert slow.split(maxsplit=1)[0] == "False"
    assert fast.split(maxsplit=1)[1] == slow.split(maxsplit=1)[1]
    assert "samples per second for 6 regressors and 3 rows" in warning


@pytest.mark.parametrize("mode", ["normalised", "paper", "ratio"])
def test_the_flight_of_the_bits_has_an_alarm_a_split_and_a_merge(mode: str) -> None:
    identifier = Identifier(configuration(mode))
    state = identifier._regression.state
    groups, kinds = [], []
    for sample in zip(*flight(), strict=True):
        kinds += [event.kind for event in identifier.update(*sample).events]
        groups.append(state.group.tolist())
    assert kinds[0] == EventKind.DETECTED
    assert max(map(max, groups[:FAULT])) == 0
    assert max(map(max, groups[FAULT:])) > 0
    assert groups[-1] == [0, 0, 0]


@pytest.mark.parametrize("mode", list(MODES))
def test_one_by_one_and_in_one_piece_give_the_same_bits(mode: str) -> None:
    one, whole = Identifier(configuration(mode)), Identifier(configuration(mode))
    single = [one.update(*sample) for sample in zip(*flight(), strict=True)]
    pieces = whole.run(*flight(), every=25).estimates
    at = {estimate.samples: numbers_without_events(estimate) for estimate in single}
    assert len(pieces) >= SAMPLES / 25
    for estimate in pieces:
        assert at[estimate.samples] == numbers_without_events(estimate)


def numbers_without_events(estimate: Estimate) -> bytes:
    return b"".join(v.tobytes() for v in vars(estimate).values() if isinstance(v, np.ndarray))


def test_arrays_of_any_layout_give_the_same_bits() -> None:
    time, x, xdot, delta = flight()
    plain = Identifier(configuration("normalised")).run(time, x, xdot, delta, every=50).estimates
    x, xdot, delta = np.asfortranarray(x), np.asfortranarray(xdot), np.repeat(delta, 2, axis=0)[::2]
    other = Identifier(configuration("normalised")).run(time, x, xdot, delta, every=50).estimates
    assert [numbers(e) for e in plain] == [numbers(e) for e in other]


@pytest.mark.parametrize("mode", list(MODES))
def test_colours_weigh_one_and_errors_are_infinite_before_data(mode: str) -> None:
    identifier = Identifier(configuration(mode))
    engine = identifier._regression
    assert isinstance(engine, Regression)
    assert np.isinf(row_uncertainty(engine.settings, engine.state, 0).errors).all()
    identifier.run(*flight(), every=SAMPLES)
    for row in range(3):
        found = row_uncertainty(engine.settings, engine.state, row)
        assert found.weights.sum() == pytest.approx(1.0)
        assert (found.weights >= 0.0).all()
        assert np.count_nonzero(found.weights) <= 2
        assert np.isfinite(found.errors).all()
        assert found.residual > 0.0


def rates(x: Array, turning: bool) -> Array:
    """Return what is known of the derivatives of the states of flight: gravity, rotation, pitching, Euler angles."""
    _, _, _, p, q, r, phi, theta, _ = x
    turned = -np.cross(x[3:6], x[:3]) if turning else np.zeros(3)
    turn = q * math.sin(phi) + r * math.cos(phi)
    return np.array(
        [
            turned[0] - GRAVITY * math.sin(theta),
            turned[1] + GRAVITY * math.sin(phi) * math.cos(theta),
            turned[2] + GRAVITY * math.cos(phi) * math.cos(theta),
            0.0,
            GYROSCOPIC_PITCH * p * r if turning else 0.0,
            0.0,
            p + math.tan(theta) * turn,
            q * math.cos(phi) - r * math.sin(phi),
            turn / math.cos(theta),
        ]
    )


@pytest.mark.parametrize("turning", [False, True])
@pytest.mark.parametrize("seed", range(5))
def test_the_known_tangent_touches_gravity_rotation_and_kinematics(seed: int, turning: bool) -> None:
    x = np.random.default_rng(seed).uniform(-1.0, 1.0, 9)
    a, bias = np.zeros((9, 9)), np.zeros(9)
    add_known(x, find_states(FLIGHT_STATES), turning, a, bias)
    np.testing.assert_allclose(a @ x + bias, rates(x, turning), atol=1e-14)
    step = 1e-6
    for j in range(9):
        e = step * np.eye(9)[j]
        np.testing.assert_allclose(a[:, j], (rates(x + e, turning) - rates(x - e, turning)) / (2.0 * step), atol=1e-8)


def test_known_are_the_rows_and_columns_of_the_angles_that_are_there() -> None:
    known = find_known(("P", "Theta", "Q"))
    assert known.tolist() == [[False, True, False], [True, True, True], [False, True, False]]
    a, bias = np.zeros((3, 3)), np.zeros(3)
    add_known(np.array([0.1, 0.2, 0.3]), find_states(("P", "Theta", "Q")), True, a, bias)
    assert a.tolist() == [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]]
    assert bias.tolist() == [0.0, 0.0, 0.0]


def test_a_kernel_that_allocates_does_not_compile() -> None:
    def allocate(n: int) -> Array:
        return np.zeros(n)

    with pytest.raises(Exception, match="zeros") if HAVE_NUMBA else contextlib.nullcontext():
        compiled(allocate)(3)
