"""Drag of surfaces: what a surface does to the axial velocity changes in flight, and is no loss of it."""

from __future__ import annotations

import numpy as np
import pytest
from estimation.test_bank import PERIOD, SMALL, uniform
from estimation.test_bank_losses import Flight, events_of

from msls_ros.estimation import EventKind, Identifier, from_mapping

AXIAL = SMALL | {"states": ("u", "P", "Q", "R"), "effectors": ("de", "dt")}
CHANGE = 250
MOVES = 0.02
"""By which an elevator moves about its trim [rad]."""


def drags(seed: int, trim: float = -0.03, left: float = 1.0, n: int = 450) -> Flight:
    """Return a flight in which an elevator's drag goes with its size; its trim, and the thrust left, after a change.

    Where the trim changes its sign, what the elevator makes of du/dt does; what it makes of dQ/dt stays.
    """
    x, delta = 0.25 * uniform(n, 4, seed), np.column_stack([MOVES * uniform(n, 1, seed + 1), uniform(n, 1, seed + 3)])
    delta[:, 0] += np.where(np.arange(n) < CHANGE, 0.03, trim)
    xdot = uniform(n, 4, seed + 2) * np.array([0.01, 0.02, 0.02, 0.02])
    thrust = np.where(np.arange(n) < CHANGE, 1.0, left)
    xdot[:, 0] += -0.1 * x[:, 0] - 13.0 * np.abs(delta[:, 0]) + thrust * delta[:, 1]
    xdot[:, 1] -= 2.0 * x[:, 1]
    xdot[:, 2] += -2.0 * x[:, 2] - 20.0 * delta[:, 0]
    xdot[:, 3] -= x[:, 3]
    return PERIOD * np.arange(n, dtype=np.float64), x, xdot, delta


def said_of(flight: Flight) -> tuple[set[str], list[str]]:
    """Return the equations that alarmed, and what was named."""
    events = events_of(Identifier(from_mapping(AXIAL)), flight)
    alarmed = {row for e in events if e.kind == EventKind.DETECTED for row in e.equations}
    return alarmed, [e.suspected_effector for e in events if e.kind == EventKind.ISOLATED]


@pytest.mark.parametrize("seed", [400, 410, 420, 430])
def test_drag_that_changes_its_sign_with_the_trim_is_no_alarm(seed: int) -> None:
    assert said_of(drags(seed)) == (set(), [])


@pytest.mark.parametrize("seed", [400, 410, 420, 430])
def test_what_makes_no_moment_is_no_surface_and_its_loss_alarms(seed: int) -> None:
    assert said_of(drags(seed, trim=0.03, left=0.3)) == ({"u"}, ["dt"])
