"""The allocation finds the one minimum within the bounds, whatever the problem."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from msls_ros.control.allocation import solve_box
from msls_ros.control.errors import ControlError
from msls_ros.control.linear import Array


def problem(random: np.random.Generator) -> tuple[Array, Array, Array, Array]:
    """A problem as a flight has them: three rows, more surfaces, one or two stuck, prices far apart."""
    n = int(random.integers(1, 9))
    rows = random.standard_normal((3, n)) * 10.0 ** random.uniform(-2, 2)
    h = rows.T @ rows + np.diag(10.0 ** random.uniform(-6, 0, n)) * max(float((rows**2).max()), 1e-9)
    low, high = -random.uniform(0.0, 0.5, n), random.uniform(0.0, 0.5, n)
    stuck = random.random(n) < 0.2
    low[stuck] = high[stuck] = random.uniform(-0.4, 0.4, int(stuck.sum()))
    return h, h @ random.uniform(-1.5, 1.5, n) * random.choice([0.1, 1.0]), low, high


def test_the_conditions_of_karush_kuhn_and_tucker_hold_at_every_solution() -> None:
    random = np.random.default_rng(5)
    for _ in range(2000):
        h, f, low, high = problem(random)
        start = random.uniform(-1.0, 1.0, f.size)
        s = solve_box(h, f, low, high, start)
        assert (s >= low).all() and (s <= high).all()
        gradient = h @ s - f
        small = 1e-7 * max(float(np.abs(f).max()), float(np.abs(h).max()), 1e-9)
        inside = (s > low + 1e-12) & (s < high - 1e-12)
        assert (np.abs(gradient[inside]) <= small).all()
        assert (gradient[(s <= low + 1e-12) & (low < high)] >= -small).all()
        assert (gradient[(s >= high - 1e-12) & (low < high)] <= small).all()


def test_it_agrees_with_trying_every_set_of_bounds() -> None:
    random = np.random.default_rng(6)
    for _ in range(40):
        h, f, low, high = problem(random)
        h, f, low, high = h[:5, :5], f[:5], low[:5], high[:5]
        best = np.inf
        for sides in itertools.product((-1, 0, 1), repeat=f.size):
            held = np.array(sides) != 0
            s = np.where(np.array(sides) < 0, low, high)
            free = ~held
            if free.any():
                s[free] = np.linalg.solve(h[np.ix_(free, free)], f[free] - h[np.ix_(free, held)] @ s[held])
            if (s >= low - 1e-12).all() and (s <= high + 1e-12).all():
                best = min(best, float(0.5 * s @ h @ s - f @ s))
        s = solve_box(h, f, low, high)
        assert 0.5 * s @ h @ s - f @ s <= best + 1e-9 * max(1.0, abs(best))


def test_bounds_that_cross_or_numbers_that_are_none_are_refused() -> None:
    one = np.eye(2)
    with pytest.raises(ControlError, match="low <= high"):
        solve_box(one, np.zeros(2), np.ones(2), np.zeros(2))
    with pytest.raises(ControlError, match="finite"):
        solve_box(one, np.array([np.nan, 0.0]), -np.ones(2), np.ones(2))
    with pytest.raises(ControlError, match="shapes"):
        solve_box(one, np.zeros(3), -np.ones(3), np.ones(3))
