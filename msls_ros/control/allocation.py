"""Control allocation: box-constrained least squares over the surfaces, by a primal active-set method.

The problem, in the n deflections s of the surfaces::

    minimise  1/2 s' H s - f' s    where  low <= s <= high                       H symmetric positive definite

An iterate is always within its bounds. On the surfaces that are free the minimiser is found by Cholesky factors; the
way there ends at the first bound that is met, which then holds its surface. At the minimiser of the free ones the
surface whose bound pushes back most wrongly is freed; where none does, the conditions of Karush, Kuhn and Tucker hold
and s is the only minimum. A surface with ``low = high`` (one that is stuck) never moves.

Seven surfaces take 1 to 5 factorisations of at most seven columns: some microseconds, compiled.

References
----------
Haerkegaard, Efficient active set algorithms for solving constrained least squares problems in aircraft control
allocation, 41st IEEE Conference on Decision and Control, 2002.
Nocedal and Wright, Numerical Optimization, 2nd edition, section 16.5.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from msls_ros.control.compiled import compiled
from msls_ros.control.errors import ControlError
from msls_ros.control.linear import Array, solve_positive

Whole = NDArray[np.int64]
LIMIT = 20
"""Iterations at most, per surface; what stands then is within its bounds and no worse than the start."""
TOLERANCE = 1e-10
"""Of a gradient that pushes back, relative to the largest element of the right-hand side."""
FREE, AT_LOW, AT_HIGH, FIXED = 0, -1, 1, 2


@compiled
def allocate(h: Array, f: Array, low: Array, high: Array, s: Array, held: Whole, work: Array) -> int:
    """Solve the problem of the module in place.

    Parameters
    ----------
    h, f
        (n, n) symmetric positive definite; (n,).
    low, high
        (n,) bounds; equal ones hold a surface.
    s
        (n,) start; becomes the solution.
    held
        (n,) becomes what holds each surface: 0 nothing, -1 its lower bound, 1 its upper bound, 2 both.
    work
        (n + 1, n) working memory.

    Returns
    -------
    int
        Iterations; ``LIMIT n`` where they ended before the solution.
    """
    n = f.shape[0]
    largest = 0.0
    for i in range(n):
        s[i] = min(max(s[i], low[i]), high[i])
        held[i] = FIXED if high[i] <= low[i] else FREE
        largest = max(largest, abs(f[i]))
    for iteration in range(LIMIT * n):
        _solve_free(h, f, s, held, work)
        if _move(s, held, low, high, work):
            continue
        if not _release(h, f, s, held, TOLERANCE * (largest + 1e-12)):
            return int(iteration + 1)
    return int(LIMIT * n)


@compiled
def _solve_free(h: Array, f: Array, s: Array, held: Whole, work: Array) -> int:
    """Write the minimiser over the free surfaces, the others as they are, into row n of ``work``."""
    n, free = f.shape[0], 0
    for i in range(n):
        if held[i] != FREE:
            continue
        work[n, free] = f[i]
        column = 0
        for j in range(n):
            if held[j] != FREE:
                work[n, free] -= h[i, j] * s[j]
            else:
                work[free, column] = h[i, j]
                column += 1
        free += 1
    solve_positive(work, work[n], free)
    return free


@compiled
def _move(s: Array, held: Whole, low: Array, high: Array, work: Array) -> bool:
    """Go towards the minimiser as far as the bounds let; return whether one was met."""
    n, at, step, hit, side = s.shape[0], 0, 1.0, -1, 0
    for i in range(n):
        if held[i] != FREE:
            continue
        way = work[n, at] - s[i]
        if way < 0.0 and work[n, at] < low[i]:
            if (low[i] - s[i]) / way < step:
                step, hit, side = (low[i] - s[i]) / way, i, AT_LOW
        elif way > 0.0 and work[n, at] > high[i] and (high[i] - s[i]) / way < step:
            step, hit, side = (high[i] - s[i]) / way, i, AT_HIGH
        at += 1
    at = 0
    for i in range(n):
        if held[i] == FREE:
            s[i] = min(max(s[i] + step * (work[n, at] - s[i]), low[i]), high[i])
            at += 1
    if hit < 0:
        return False
    held[hit] = side
    s[hit] = low[hit] if side == AT_LOW else high[hit]
    return True


@compiled
def _release(h: Array, f: Array, s: Array, held: Whole, tolerance: float) -> bool:
    """Free the surface whose bound pushes back most wrongly; return whether there was one."""
    worst, found = tolerance, -1
    for i in range(s.shape[0]):
        if held[i] == AT_LOW or held[i] == AT_HIGH:
            gradient = -f[i]
            for j in range(s.shape[0]):
                gradient += h[i, j] * s[j]
            if gradient * held[i] > worst:
                worst, found = gradient * held[i], i
    if found < 0:
        return False
    held[found] = FREE
    return True


def solve_box(h: Array, f: Array, low: Array, high: Array, start: Array | None = None) -> Array:
    """Return the minimum of ``1/2 s' h s - f' s`` within bounds.

    Parameters
    ----------
    h, f
        (n, n) symmetric positive definite; (n,).
    low, high
        (n,) bounds.
    start
        (n,) where to begin; None: the middle.

    Raises
    ------
    ControlError
        For shapes that do not fit, numbers that are not finite, or bounds that cross.
    """
    h, f, low, high = (np.ascontiguousarray(one, np.float64) for one in (h, f, low, high))
    n = f.size
    if h.shape != (n, n) or low.shape != (n,) or high.shape != (n,):
        message = f"allocation: h, f, low, high of shapes {h.shape}, {f.shape}, {low.shape}, {high.shape}"
        raise ControlError(f"{message}; expected (n, n) and three times (n,)")
    if not all(np.isfinite(one).all() for one in (h, f, low, high)) or (low > high).any():
        message = "allocation: expected finite numbers, and low <= high for every surface"
        raise ControlError(message)
    s = np.array(0.5 * (low + high) if start is None else start, dtype=np.float64)
    allocate(h, f, low, high, s, np.zeros(n, np.int64), np.zeros((n + 1, n)))
    return s
