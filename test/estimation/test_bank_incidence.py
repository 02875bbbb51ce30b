"""A lost surface that may take its effect through incidence with it, and losses that show at the next input only."""

from __future__ import annotations

import math

import numpy as np
import pytest
from estimation.test_bank_losses import Flight, engine_of, events_of

from msls_ros.estimation import EventKind, FaultEvent, Identifier, from_mapping
from msls_ros.estimation.bank.losses import KNOWN, compare_surfaces, noise_of
from msls_ros.estimation.kinematics import GRAVITY

RATE, FINE = 50.0, 10
SPEED = 40.0
LONGITUDINAL = {
    "states": ("u", "w", "Q", "Phi", "Theta"),
    "effectors": ("de",),
    "sample_rate": RATE,
    "reference_speed": SPEED,
    "estimator.method": "bank",
}
A = np.array([[-0.05, 0.1, 0.0], [-0.2, -2.0, -2.0], [0.0, -0.5, -3.0]])
"""Of the air; what gravity and the turning of the axes do comes on top."""
B = np.array([0.0, -4.0, -20.0])
Q, DE = 2, 4
FAULT, RESTING = 30.3, 32.0
"""In the middle of an input, and between two [s]."""
TRIM = -0.1
"""Where the elevator rests [rad]."""


def fly(
    seed: int, left: float, floats: float = 0.0, fault: float = FAULT, quiet: float = 0.0, seconds: float = 60.0
) -> Flight:
    """Return a flight in which an elevator keeps a share of its effect, by default from the middle of an input on.

    It floats by ``floats`` of the angle of attack besides. Inputs rest for ``quiet`` [s] from then on.
    """
    random = np.random.default_rng(seed)
    dt = 1.0 / RATE / FINE
    n = round(seconds * RATE) * FINE
    time = dt * np.arange(n, dtype=np.float64)
    delta = np.zeros(n)
    for start in np.arange(3.0, seconds - 3.0, 3.0):
        size = random.uniform(0.03, 0.06)
        for begin, end, sign in ((0.0, 0.6, 1.0), (0.6, 1.0, -1.0), (1.0, 1.2, 1.0)):
            delta[(time >= start + begin) & (time < start + end)] = sign * size
    delta[(time > fault) & (time < fault + quiet)] = 0.0
    x, slopes, own = np.zeros((n, 5)), np.zeros((n, 5)), np.array([SPEED, 0.0, 0.0, 0.0, 0.0])
    trim = own[:3].copy()
    for k in range(n):
        u, w, q, _, pitch = own
        delta[k] += 0.3 * pitch + 0.1 * q  # an attitude hold
        acts = delta[k] + TRIM if time[k] < fault else left * (delta[k] + TRIM) - floats * w / SPEED
        faster = u / SPEED
        air = faster * (A @ (own[:3] - trim)) + B * (faster * faster * acts - TRIM)
        turn = [-q * w - GRAVITY * math.sin(pitch), q * u + GRAVITY * (math.cos(pitch) - 1.0), 0.0]
        x[k], slopes[k] = own, [*(air + turn), 0.0, q]
        own = own + dt * slopes[k]
    kept = slice(None, None, FINE)
    seen = x[kept] + random.normal(size=(n // FINE, 5)) * [0.02, 0.02, 0.001, 0.001, 0.001]
    moves = slopes[kept] + random.normal(size=(n // FINE, 5)) * [0.05, 0.05, 0.03, 0.0, 0.0]
    return time[kept], seen, moves, delta[kept, None] + TRIM + random.normal(size=(n // FINE, 1)) * 1e-4


def named_in(flight: Flight) -> list[FaultEvent]:
    return [e for e in events_of(Identifier(from_mapping(LONGITUDINAL)), flight) if e.kind == EventKind.ISOLATED]


@pytest.mark.parametrize("floats", [0.0, 0.5])
def test_what_is_left_of_a_surface_that_floats_is_nothing_within_its_error(floats: float) -> None:
    """Without incidence it is -.06 in the mean of these flights."""
    named = [named_in(fly(seed, 0.0, floats)) for seed in range(8)]
    assert sum(bool(one) for one in named) >= 7
    assert all(one[0].suspected_effector == "de" for one in named if one)
    assert max(abs(one[0].effectiveness) / one[0].effectiveness_std for one in named if one) < 1.96
    assert abs(np.mean([one[0].effectiveness for one in named if one])) < 0.03


def test_half_of_a_surface_is_half_of_it() -> None:
    named = [named_in(fly(seed, 0.5)) for seed in range(8)]
    assert all(len(one) == 1 and abs(one[0].effectiveness - 0.5) < 1.96 * one[0].effectiveness_std for one in named)


def test_a_change_through_incidence_counts_as_noise_along_its_column() -> None:
    """Generalised least squares with the covariance ``1 + (2/n) (B/V)^2 r r'``."""
    identifier = Identifier(from_mapping(LONGITUDINAL))
    identifier.run(*fly(1, 1.0, seconds=25.2))
    engine = engine_of(identifier)
    s, x, work = engine.settings, engine.state, engine._work
    which = len(s.loss_members) - 1
    before = x.mixed.copy()
    before[Q, DE] *= 1.3
    before[Q, 2] *= 1.5
    work.concerned[:] = [0, 0, 1]
    work.noise[:] = 0.0
    x.noisy[:] = 0.0
    compare_surfaces(s, x, which, before, 1e-12 * np.ones_like(before), KNOWN, False, False, work)
    n = noise_of(s, x, Q, which)
    R = x.R[x.group[Q], 1:, 1:, s.loss_members[which]]
    column = R[:, 1]
    N = np.eye(4) + 2.0 / n * (before[Q, DE] / x.speed[0]) ** 2 * np.outer(column, column)
    direction, change = R[:, 3], R @ (x.members[Q, 1:, s.loss_members[which]] - before[Q, 1:])
    along, size = (float(direction @ np.linalg.solve(N, v)) for v in (change, direction))
    plain, whole = float(direction @ change), float(direction @ direction)
    effect = before[Q, DE]
    assert size < 0.97 * whole, "input and incidence move together"
    assert work.lone_against[Q, 0] - work.against[Q, 0] == pytest.approx(effect * (along - plain) / n, rel=1e-6)
    assert work.lone_information[Q, 0] == pytest.approx(work.information[Q, 0] * size / whole, rel=1e-6)


def test_what_shows_again_only_at_the_next_input_is_named_then() -> None:
    """At rest the loss is a moment that comes from nowhere; inputs rest for twice as long as `isolation.window`."""
    for seed in range(4):
        events = events_of(Identifier(from_mapping(LONGITUDINAL)), fly(seed, 0.5, fault=RESTING, quiet=16.0))
        first = next(e for e in events if e.kind == EventKind.DETECTED)
        assert 0.0 <= first.time - RESTING < 0.5
        (named,) = [e for e in events if e.kind == EventKind.ISOLATED]
        assert named.suspected_effector == "de" and named.time > RESTING + 16.0
        assert abs(named.effectiveness - 0.5) < 1.96 * named.effectiveness_std


def test_an_alarm_that_nothing_explains_is_given_up_after_the_window_of_inputs() -> None:
    time, x, moves, delta = fly(3, 1.0)
    moves[time > FAULT, 2] += 0.5  # a moment from nowhere, that stays
    identifier = Identifier(from_mapping(LONGITUDINAL))
    supervisor = identifier._supervisor
    watched = 0
    for k in range(len(time)):
        identifier.update(float(time[k]), x[k], moves[k], delta[k])
        watched += int(supervisor.watching and bool(supervisor._isolating))
    assert 0 < watched / RATE < 8.0 + 12.0 and not math.isnan(watched)
