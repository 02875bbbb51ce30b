"""A moment that grows while a law meets it is no loss of the surface that meets it."""

from __future__ import annotations

import numpy as np
import pytest

from msls_ros.estimation import EventKind, FaultEvent, Identifier, from_mapping
from msls_ros.inputs import differentiated

RATE = 50
BEGINS = 24.0
"""When a moment begins to grow, or the surface is lost [s]."""


def fly(seed: int, *, moment: float, over: float, left: float = 1.0) -> list[FaultEvent]:
    """Return the events of an aircraft that rolls, and whose law holds its bank; rates differentiated.

    Parameters
    ----------
    seed
        Of the sensors, and of the pilot.
    moment, over
        Which rolling acceleration grows from `BEGINS` on [rad/s^2], and within what time [s].
    left
        What is left of the aileron's effect from then on [1].
    """
    random = np.random.default_rng(seed)
    count, steps = 32 * RATE, 4
    dt = 1.0 / (RATE * steps)
    p = phi = aileron = total = 0.0
    turns = np.cumsum(random.uniform(0.6, 1.8, 40))
    sizes = np.deg2rad(random.uniform(-1.5, 1.5, 41))
    rows = []
    for k in range(count * steps):
        t = k * dt
        grown = moment * min(max(t - BEGINS, 0.0) / over, 1.0)
        slope = -4.0 * p + 30.0 * (left if t >= BEGINS else 1.0) * aileron + grown
        if k % steps == 0:
            rows.append((p, aileron))
        total += dt * phi
        command = sizes[np.searchsorted(turns, t)] - 0.25 * phi - 0.05 * p - 0.15 * total
        p += dt * slope
        phi += dt * p
        aileron += dt * 18.0 * (command - aileron)
    data = np.array(rows) + random.normal(size=(count, 2)) * np.deg2rad([0.1, 0.02])
    c = from_mapping({"states": ("P",), "effectors": ("da",), "known_gravity": False, "sample_rate": float(RATE)})
    time = np.arange(count) / RATE
    made = differentiated(c, time, data[:, :1], np.full((count, 1), np.nan), data[:, 1:])
    run = Identifier(c, made.straddle).run(made.time, made.x, made.xdot, made.delta, every=10)
    return [event for one in run.estimates for event in one.events]


def named(events: list[FaultEvent]) -> bool:
    """Return whether a surface is named."""
    return any(event.kind == EventKind.ISOLATED for event in events)


@pytest.mark.parametrize(("over", "moment"), [(0.5, 1.2), (1.0, 2.5), (2.0, 2.5)])
def test_a_moment_that_grows_names_no_surface_that_meets_it(over: float, moment: float) -> None:
    flights = [fly(seed, moment=moment, over=over) for seed in range(1, 13)]
    assert all(any(event.kind == EventKind.DETECTED for event in events) for events in flights)
    assert sum(map(named, flights)) <= 2


def test_a_lost_surface_is_named_as_before() -> None:
    assert all(named(fly(seed, moment=0.0, over=1.0, left=0.5)) for seed in range(1, 13))
