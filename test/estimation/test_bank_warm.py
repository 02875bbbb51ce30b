"""A start from a saved model: known as well as the file says, and not sure of what was lost between the flights."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.linear_beds import configure, differentiate, draw, fly
from msls_ros.estimation import Estimate, Identifier
from msls_ros.estimation.kernel import Array
from msls_ros.inputs.derivatives import usual_intervals

SEEDS = (4424, 4425, 4428, 4434, 4442)
MOVES = 3.0
"""When the first input comes [s]."""
LONG = 12
"""How much of the second flight is looked at [s]."""


def pair(seed: int, through: bool, left: float) -> tuple[Estimate, list[Estimate], list[Estimate], Array]:
    """Return what was saved, estimates that start from it and from nothing, and B, of which a column is lost."""
    one = replace(draw(np.random.default_rng(seed)), lost=-1, commands=False)
    b = one.b.copy()
    b[:, 0] *= left
    straddle = usual_intervals(one.rate) if through else 0
    flights = [fly(one, np.random.default_rng(seed + 1000)), fly(replace(one, b=b), np.random.default_rng(seed + 2000))]
    before, now = (differentiate(one, flight) if through else flight for flight in flights)
    first, warm, cold = (Identifier(configure(one), straddle) for _ in range(3))
    saved = first.run(*before, every=len(before[0])).estimates[-1]
    errors = saved.a_std, saved.b_std
    warm.warm_start(saved.a, saved.b, saved.bias, first.covariance, before[1][-1], before[3][-1], errors)
    time, x, xdot, delta = (array[: LONG * one.rate] for array in now)
    return saved, warm.run(time, x, xdot, delta).estimates, cold.run(time, x, xdot, delta).estimates, b


def covered(estimates: list[Estimate], b: Array) -> tuple[int, int]:
    """Return how many effects are called reliable and covered, and how many are called reliable."""
    inside = [(np.abs(e.b - b) <= 1.96 * e.b_std) & e.b_reliable for e in estimates]
    return int(np.sum(inside)), int(np.sum([e.b_reliable for e in estimates]))


@pytest.mark.parametrize("through", [False, True], ids=["as measured", "through windows"])
def test_what_was_saved_is_known_and_no_more_than_that(through: bool) -> None:
    """As information of the members it made bars of a third of the file's: covered in .96; through windows in .84."""
    inside = count = others = 0
    for seed in SEEDS:
        saved, warm, cold, b = pair(seed, through, 1.0)
        assert np.median(warm[0].b_std[saved.b_reliable] / saved.b_std[saved.b_reliable]) < 2.0, seed
        known, reliable = covered(warm, b)
        inside, count = inside + known, count + reliable
        others += covered(cold, b)[1]
    assert inside >= 0.98 * count and count > 1.3 * others


@pytest.mark.parametrize("through", [False, True], ids=["as measured", "through windows"])
def test_half_an_effector_lost_between_the_flights_shows_when_it_moves(through: bool) -> None:
    inside = count = 0
    for seed in SEEDS:
        _, warm, _, b = pair(seed, through, 0.5)
        known, reliable = covered([e for e in warm if e.time >= MOVES + 1.5], b)
        inside, count = inside + known, count + reliable
    assert inside >= 0.9 * count > 0
