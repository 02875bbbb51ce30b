"""The bank of memories: what it promises as an estimator, and the same bits as everything else."""

from __future__ import annotations

import hashlib
import math
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from msls_ros.estimation import EstimationError, EventKind, Identifier, from_mapping
from msls_ros.estimation.bank.regression import BankRegression
from msls_ros.estimation.bank.settings import bank_grid, make_bank_settings
from msls_ros.estimation.compiled import HAVE_NUMBA, compiled
from msls_ros.estimation.elementary import exponential, logarithm
from msls_ros.estimation.kernel import Array

SMALL: dict[str, Any] = {
    "states": ("P", "Q", "R"),
    "effectors": ("da", "de"),
    "known_gravity": False,
    "estimator.method": "bank",
    "dither.bandwidth": 2.0,
}
PINNED = "e3feaae612f5376ec42f86a54f66138d"
SAMPLES, FAULT, PERIOD = 240, 150, 0.02

BITS = """
import sys
sys.path.insert(0, sys.argv[1])
from msls_ros.estimation.compiled import HAVE_NUMBA
from estimation.test_bank import digest
print(HAVE_NUMBA, digest())
"""


def uniform(n: int, width: int, seed: int) -> Array:
    """Numbers in [-1, 1) from the raw stream of a generator: exact, so equal on every machine."""
    raw = np.random.PCG64(seed).random_raw(n * width) >> np.uint64(11)
    return (raw.astype(np.float64) * 2.0**-52 - 1.0).reshape(n, width)


def flight(n: int = SAMPLES, fault: int = FAULT) -> tuple[Array, Array, Array, Array]:
    """Return a flight whose first effector loses its effect on P."""
    x, delta = 0.25 * uniform(n, 3, 1), 0.125 * uniform(n, 2, 2)
    xdot = 0.0078125 * uniform(n, 3, 3)
    xdot[:, 0] += -2.0 * x[:, 0] + 8.0 * delta[:, 0]
    xdot[:, 1] += -1.0 * x[:, 1] + 0.5 * x[:, 2] - 4.0 * delta[:, 1]
    xdot[:, 2] += -0.5 * x[:, 2] + 1.0 * delta[:, 0]
    xdot[fault:, 0] -= 8.0 * delta[fault:, 0]
    return PERIOD * np.arange(n, dtype=np.float64), x, xdot, delta


def digest() -> str:
    """Return a hash of every number that a flight gives."""
    total = hashlib.sha256()
    for estimate in Identifier(from_mapping(SMALL)).run(*flight()).estimates:
        fields = (estimate.a, estimate.b, estimate.bias, estimate.a_std, estimate.b_std, estimate.excitation)
        for array in (*fields, estimate.statistic, estimate.forgetting_factor, estimate.dither.delta):
            total.update(np.ascontiguousarray(array + 0.0).tobytes())
    return total.hexdigest()[:32]


def test_the_bits_are_the_pinned_ones() -> None:
    assert digest() == PINNED


def test_compiled_and_interpreted_give_the_same_bits() -> None:
    said = []
    for disable in ("0", "1"):
        environment = {**os.environ, "NUMBA_DISABLE_JIT": disable}
        command = [sys.executable, "-W", "ignore", "-c", BITS, str(Path(__file__).parents[1])]
        said.append(subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout.split())
    assert said[1][0] == "False"
    assert said[0][1] == said[1][1]


def test_one_by_one_and_in_one_piece_give_the_same_bits() -> None:
    one, whole = Identifier(from_mapping(SMALL)), Identifier(from_mapping(SMALL))
    single = {e.samples: e for e in (one.update(*sample) for sample in zip(*flight(), strict=True))}
    pieces = whole.run(*flight(), every=25).estimates
    assert len(pieces) >= SAMPLES // 25
    for estimate in pieces:
        for name, value in vars(estimate).items():
            if isinstance(value, np.ndarray):
                assert value.tobytes() == vars(single[estimate.samples])[name].tobytes(), name


@compiled
def _both(x: float) -> tuple[float, float]:
    return exponential(x), logarithm(x)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_exponential_and_logarithm_hold_to_two_units_in_the_last_place(sign: float) -> None:
    for exponent in np.linspace(-8.0, 2.8, 2001):
        x = 10.0**exponent
        assert exponential(sign * x) == pytest.approx(math.exp(sign * x), rel=4.5e-16, abs=0.0)
        assert logarithm(x) == pytest.approx(math.log(x), rel=4.5e-16, abs=1e-300)
    assert logarithm(1.0) == 0.0
    assert exponential(0.0) == 1.0
    assert exponential(-1e4) == 0.0
    assert math.isfinite(exponential(1e4))
    assert _both(1.5) == (exponential(1.5), logarithm(1.5))


def engine(p: int, rows: int, grid: list[tuple[float, float, float, int]]) -> BankRegression:
    return BankRegression(make_bank_settings(np.ones(p), PERIOD, grid, detect=False), rows)


def test_a_bank_of_one_is_exponentially_weighted_least_squares() -> None:
    n, p, tau = 400, 4, 1.0
    phi, theta = uniform(n, p, 5), uniform(2, p, 6)
    phi[:, -1] = 1.0
    y = phi @ theta.T + 0.0625 * uniform(n, 2, 7)
    bank = engine(p, 2, [(tau, 1e5, 0.0, 0)])
    bank.advance(phi, y)
    weights = np.exp(-0.5 * PERIOD / tau * np.arange(n)[::-1])[:, None]
    expected, *_ = np.linalg.lstsq(weights * phi, weights * y, rcond=None)
    assert bank.theta == pytest.approx(expected.T, rel=1e-6)
    bank.advance(phi[:1], y[:1])
    factor = np.roll(bank.state.R[0, :, :, 0], -1, axis=1)
    total = math.exp(-PERIOD / tau) * (weights * phi).T @ (weights * phi) + np.outer(phi[0], phi[0])
    assert factor.T @ factor == pytest.approx(total, rel=1e-5, abs=1e-6)


def test_an_effect_is_kept_through_a_minute_of_quiet() -> None:
    n, quiet = 3600, 600
    phi = 0.25 * uniform(n, 3, 8)
    phi[quiet:] *= 1e-3
    phi[:, -1] = 1.0
    y = phi @ np.array([[2.0, -5.0, 0.3]]).T + 0.001 * uniform(n, 1, 9)
    bank = BankRegression(make_bank_settings(np.ones(3), PERIOD, bank_grid((0.1, 1.5), (5.0, 30.0))), 1)
    bank.advance(phi, y)
    assert bank.theta[0, :2] == pytest.approx([2.0, -5.0], rel=0.01)
    assert (bank.standard_errors(0)[:2] < 0.05).all()
    assert (bank.excitation(0)[:2] < 0.2).all()


@pytest.mark.parametrize("seed", range(4))
def test_what_an_input_taught_is_kept_where_quiet_flight_is_coloured_noise(seed: int) -> None:
    """Members whose constant follows noise predict it best; weighed by the energy itself, they left .01 to .67."""
    n, tau = 3000, 0.6
    random = np.random.default_rng(seed)
    fade = math.exp(-PERIOD / tau)
    steps = 0.007 * math.sqrt(1.0 - fade * fade) * random.normal(size=(n, 3))
    time = PERIOD * np.arange(n, dtype=np.float64)
    delta = np.zeros((n, 2))
    delta[:, 0] = np.where((time > 5.0) & (time < 17.0), 0.05 * np.sign(np.sin(2.0 * np.pi * time / 3.0)), 0.0)
    x, xdot, colour = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros(3)
    for k in range(n):
        colour = fade * colour + steps[k]
        acceleration = 1.5 * delta[k, 0] - x[k, 0]
        xdot[k] = colour
        xdot[k, 0] += acceleration
        if k + 1 < n:
            x[k + 1, 0] = x[k, 0] + PERIOD * acceleration
    x += 1.5e-3 * random.normal(size=x.shape)
    estimates = Identifier(from_mapping(SMALL)).run(time, x, xdot, delta).estimates
    then, now = (estimates[round(t / PERIOD)].a[0, 0] for t in (17.0, 59.9))
    assert -1.2 < then < -0.8
    assert now / then > 0.7


def test_a_lost_effector_is_found_restarts_its_row_alone_and_nothing_is_claimed_before_it_can_be_known() -> None:
    identifier = Identifier(from_mapping(SMALL))
    estimates = [identifier.update(*sample) for sample in zip(*flight(), strict=True)]
    events = [event for estimate in estimates for event in estimate.events]
    assert events[0].kind == EventKind.DETECTED
    assert events[0].equations == ("P",)
    assert events[0].time <= PERIOD * (FAULT + 5)
    found = next(e for e in events if e.kind == EventKind.ISOLATED)
    assert found.suspected_effector == "da"
    assert abs(found.effectiveness) <= 3.0 * found.effectiveness_std + 0.02
    struck = round(events[0].time / PERIOD)
    p = len(identifier.configuration.regressors)
    for estimate in (*estimates[:p], *estimates[struck : struck + 2 * p]):
        assert not estimate.b_reliable[0].any()
    assert estimates[FAULT - 1].b_reliable[0, 0]
    assert abs(estimates[-1].b[0, 0]) < 0.1
    assert np.isfinite(estimates[struck + 1].b_std[1]).all()


def test_what_is_learnt_survives_a_change_in_flight_and_memories_do_not_change() -> None:
    identifier = Identifier(from_mapping(SMALL))
    time, x, xdot, delta = (array[:100] for array in flight())
    identifier.run(time, x, xdot, delta)
    before = identifier._regression.theta.copy()
    identifier.configure({"isolation.significance": 5.0})
    assert (identifier._regression.theta == before).all()
    with pytest.raises(EstimationError, match="cannot change"):
        identifier.configure({"estimator.memories": (0.2,)})


def test_a_warm_start_begins_where_it_is_told() -> None:
    identifier = Identifier(from_mapping(SMALL))
    a, b = np.diag([-2.0, -1.0, -0.5]), np.array([[8.0, 0.0], [0.0, -4.0], [1.0, 0.0]])
    identifier.warm_start(a, b, np.zeros(3), 1e-4 * np.eye(6))
    time, x, xdot, delta = flight()
    last = identifier.run(time[:5], x[:5], xdot[:5], delta[:5]).estimates[-1]
    assert last.b == pytest.approx(b, abs=0.05)
    with pytest.raises(EstimationError, match="positive definite"):
        identifier.warm_start(a, b, np.zeros(3), -np.eye(6))


def test_long_unexcited_flight_stays_finite() -> None:
    bank = engine(3, 1, bank_grid((0.1, 1.5), (5.0,)))
    phi = np.zeros((20_000 if HAVE_NUMBA else 500, 3))
    phi[:, -1] = 1.0
    bank.advance(phi, np.zeros((len(phi), 1)))
    assert np.isfinite(bank.theta).all()
    assert not np.isnan(bank.standard_errors(0)).any()


def quiet_then_input(noise: float = 1e-3) -> tuple[Array, Array, Array, Array]:
    """Return 12 s of noise about nothing, and then for the first time an input of the first effector."""
    n, start = 750, 600
    x, moved = 0.002 * uniform(n, 3, 11), np.zeros((n, 2))
    moved[start : start + 40, 0] += 0.1
    moved[start + 40 : start + 80, 0] -= 0.1
    xdot = noise * uniform(n, 3, 13)
    late = np.concatenate([moved[:1, 0], moved[:1, 0], moved[:-2, 0]])  # most of the effect comes two samples late
    xdot[:, 0] += -2.0 * x[:, 0] + 2.0 * moved[:, 0] + 6.0 * late
    xdot[:, 1] += -1.0 * x[:, 1]
    xdot[:, 2] += -0.5 * x[:, 2]
    delta = moved + 2e-4 * uniform(n, 2, 12)  # the noise of their sensors: what acts does not move
    return PERIOD * np.arange(n, dtype=np.float64), x, xdot, delta


def count_alarms(identifier: Identifier) -> int:
    estimates = identifier.run(*quiet_then_input()).estimates
    return sum(event.kind == EventKind.DETECTED for estimate in estimates for event in estimate.events)


def test_an_effector_that_moves_for_the_first_time_is_learnt_and_not_alarmed() -> None:
    identifier, hasty = Identifier(from_mapping(SMALL)), Identifier(from_mapping(SMALL))
    hasty._regression.settings = hasty._regression.settings._replace(learning=0)  # type: ignore[call-arg]
    assert count_alarms(identifier) == 0
    assert count_alarms(hasty) > 0


def held_input(kept: float) -> tuple[Array, Array, Array, Array]:
    """Return 26 s of doublets, then one input that is held; at 30 s the effector keeps that share of its effect."""
    time = PERIOD * np.arange(1700, dtype=np.float64)
    noise = 2e-3 * uniform(len(time), 6, 11)
    x, xdot, delta = noise[:, :3].copy(), noise[:, 3:].copy(), np.zeros((len(time), 2))
    delta[:, 0] = np.where(time < 26.0, 0.05 * np.sign(np.sin(np.pi * time / 2.0)), 0.05)
    rate = 0.0
    for k in range(len(time)):
        acceleration = -rate + 8.0 * delta[k, 0] * (kept if time[k] >= 30.0 else 1.0)
        x[k, 0] += rate
        xdot[k, 0] += acceleration
        rate += PERIOD * acceleration
    return time, x, xdot, delta


def test_a_part_of_an_effect_lost_while_the_input_is_held_is_seen_at_once() -> None:
    """The error is a third of what manoeuvres made of the output; but nothing moves that could explain it."""
    times = []
    for kept in (0.7, 1.0):
        estimates = Identifier(from_mapping(SMALL)).run(*held_input(kept)).estimates
        events = [event for estimate in estimates for event in estimate.events]
        times.append([event.time for event in events if event.kind == EventKind.DETECTED])
    assert 30.0 <= times[0][0] <= 30.1
    assert not times[1]


def test_the_best_that_was_known_is_kept_with_its_time_and_the_bars_stay_what_they_were() -> None:
    n, quiet = 1800, 600
    x, delta = 0.25 * uniform(n, 3, 14), 0.125 * uniform(n, 2, 15)
    x[quiet:], delta[quiet:] = 1e-3 * x[quiet:], 1e-3 * delta[quiet:]
    xdot = 0.01 * uniform(n, 3, 16) + delta @ np.array([[8.0, 0.0, 1.0], [0.0, -4.0, 2.0]])
    estimates = Identifier(from_mapping(SMALL)).run(PERIOD * np.arange(n, dtype=np.float64), x, xdot, delta).estimates
    then, now = estimates[quiet - 1], estimates[-1]
    assert now.b_best[0, 0] == pytest.approx(8.0, rel=0.02)
    assert 1.0 < now.b_best_time[0, 0] <= PERIOD * quiet + 2.5, (
        "what is known of delays counts until the energy has faded"
    )
    assert now.b_best_std[0, 0] <= then.b_std[0, 0] * 1.01
    assert now.b_std[0, 0] <= 2.0 * then.b_std[0, 0]
    assert now.b_reliable[0, 0] and now.excitation[3] < 0.5
    assert np.isnan(estimates[2].b_best).all()


def test_the_bar_of_an_inertial_coupling_allows_for_the_rate_that_it_goes_with() -> None:
    """With dQ/dt = .9 P R the derivative by R is .9 P, which a roll sweeps through while the estimate is a mean."""
    n = 1500
    time = PERIOD * np.arange(n, dtype=np.float64)
    x, delta = np.zeros((n, 3)), 0.125 * uniform(n, 2, 18)
    xdot = 0.01 * uniform(n, 3, 19) + delta @ np.array([[8.0, 0.0, 0.0], [0.0, -4.0, 0.0]])
    x[:, 0] = 0.3 * np.sin(2.0 * math.pi * time)
    xdot[:, 0] = 0.3 * 2.0 * math.pi * np.cos(2.0 * math.pi * time)
    xdot[:, 2] = 8.0 * uniform(n, 1, 17)[:, 0]
    for k in range(n):
        xdot[k, 1] += -2.0 * x[k, 1] + 0.9 * x[k, 0] * x[k, 2]
        xdot[k, 2] += -2.0 * x[k, 2]
        if k + 1 < n:
            x[k + 1, 1:] = x[k, 1:] + PERIOD * xdot[k, 1:]

    def covered(names: tuple[str, ...]) -> float:
        configuration = from_mapping({**SMALL, "states": names})
        estimates = Identifier(configuration).run(time, x, xdot, delta).estimates[250:]
        off = [e.a[1, 2] - 0.9 * p for e, p in zip(estimates, x[250:, 0], strict=True)]
        return float(np.mean(np.abs(off) <= 1.96 * np.array([e.a_std[1, 2] for e in estimates])))

    assert covered(("P", "Q", "R")) >= 0.95
    assert covered(("p", "q", "r")) < 0.5, "of states that are no rates the estimator cannot know it"


def test_samples_whose_window_straddles_a_change_do_not_enter_the_restarted_rows() -> None:
    straddle = 4
    identifier = Identifier(from_mapping(SMALL), straddle)
    ages = []
    for sample in zip(*flight(), strict=True):
        events = identifier.update(*sample).events
        ages.append(identifier._regression.age(0))
        if ages and any(e.kind == EventKind.DETECTED for e in events):
            break
    struck = round(float(sample[0]) / PERIOD)
    for more in zip(*(array[struck + 1 : struck + 7] for array in flight()), strict=True):
        identifier.update(*more)
        ages.append(identifier._regression.age(0))
    assert ages[-7:] == [0, 0, 0, 0, 1, 2, 3]


TWO = {**SMALL, "effectors": ("de", "dt"), "isolation.surfaces": "left: de + dt; right: de - dt"}


def lose(left: float) -> list[tuple[str, float]]:
    """Return the names given where a share of the left of two surfaces is left."""
    n, fault = 300, 150
    x, delta = 0.25 * uniform(n, 3, 1), 0.125 * uniform(n, 2, 2)
    surfaces = delta @ np.array([[1.0, 1.0], [1.0, -1.0]])
    effect = np.array([[4.0, 3.0, 0.5], [-4.0, 3.0, -0.5]])
    broken = surfaces * np.where(np.arange(n)[:, None] < fault, 1.0, [left, 1.0])
    xdot = 0.0078125 * uniform(n, 3, 3) + broken @ effect - x
    estimates = Identifier(from_mapping(TWO)).run(PERIOD * np.arange(n, dtype=np.float64), x, xdot, delta).estimates
    events = [event for estimate in estimates for event in estimate.events]
    return [(e.suspected_effector, e.effectiveness) for e in events if e.kind == EventKind.ISOLATED]


@pytest.mark.parametrize("left", [0.0, 0.5])
def test_a_surface_is_named_where_the_profile_tells_which_effectors_it_makes(left: float) -> None:
    (named, *again) = lose(left)
    assert again == []
    assert named[0] == "left"
    assert named[1] == pytest.approx(left, abs=0.03)


def test_what_has_practically_not_changed_is_not_named() -> None:
    assert lose(0.95) == []


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("left: de + da", "a sum of de, dt"),
        ("left de + dt", "expected a surface and its effectors"),
        ("left: de + dt; right: 2*de + 2*dt", "each moved in a way of its own"),
        ("left: de dt", "a sum of de, dt"),
    ],
)
def test_surfaces_that_are_none_are_refused_with_a_sentence(text: str, sentence: str) -> None:
    with pytest.raises(EstimationError, match=re.escape(sentence)):
        from_mapping({**TWO, "isolation.surfaces": text})
