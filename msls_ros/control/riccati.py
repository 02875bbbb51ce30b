"""The continuous algebraic Riccati equation, by the structure-preserving doubling algorithm.

For ``A'X + X A - X G X + Q = 0`` the Cayley transform with a shift r > 0 gives A_0, G_0, H_0; the doubling ::

    A <- A (I + G H)^-1 A,   G <- G + A (I + G H)^-1 G A',   H <- H + A' H (I + G H)^-1 A

converges quadratically, H to the stabilising X, A to 0 (A is the Cayley transform of the closed loop to the power 2^k:
where it does not vanish, nothing stabilises). Explicit loops; order 15 takes a quarter of a millisecond.

References
----------
Chu, Fan and Lin, A structure-preserving doubling algorithm for continuous-time algebraic Riccati equations, Linear
Algebra and its Applications 396, 2005.
"""

from __future__ import annotations

import numpy as np

from msls_ros.control.compiled import compiled
from msls_ros.control.errors import ControlError
from msls_ros.control.linear import Array, multiply, multiply_transposed, solve_general

DOUBLINGS = 40
VANISHED = 1e-8
"""Largest element of A at which the doubling has converged: the next step would change X by its square."""
WORK = 8
"""Matrices of working memory."""


@compiled
def solve_riccati(a: Array, g: Array, q: Array, shift: float, x: Array, work: Array) -> int:
    """Write the stabilising solution into ``x``.

    Parameters
    ----------
    a, g, q
        (n, n); g and q symmetric positive semidefinite.
    shift
        Of the Cayley transform, about the size of the fast eigenvalues [1/s].
    x
        (n, n) becomes the solution.
    work
        (8, n, n) working memory.

    Returns
    -------
    int
        Doublings; 0: there is no stabilising solution.
    """
    n = a.shape[0]
    ak, gk, left, right = work[0], work[1], work[2], work[3]
    if not _begin(a, g, q, shift, ak, gk, x, work):
        return 0
    for doubling in range(1, DOUBLINGS + 1):
        multiply(gk, x, left)
        for i in range(n):
            left[i, i] += 1.0
            for j in range(n):
                right[i, j] = left[i, j]
                work[4][i, j] = ak[i, j]
                work[5][i, j] = gk[i, j]
        if not solve_general(left, work[4]) or not solve_general(right, work[5]):
            return 0
        multiply(x, work[4], left)  # H (I + G H)^-1 A
        multiply_transposed(ak, left, right)
        _add_symmetric(x, right)
        for i in range(n):
            for j in range(n):
                left[i, j] = ak[j, i]
        multiply(work[5], left, right)  # (I + G H)^-1 G A'
        multiply(ak, right, work[6])
        _add_symmetric(gk, work[6])
        multiply(ak, work[4], left)
        largest = 0.0
        for i in range(n):
            for j in range(n):
                ak[i, j] = left[i, j]
                largest = max(largest, abs(ak[i, j]))
        if largest < VANISHED:
            return doubling
        if not largest < 1e60:
            return 0
    return 0


@compiled
def _add_symmetric(total: Array, more: Array) -> None:
    for i in range(total.shape[0]):
        for j in range(i, total.shape[0]):
            both = 0.5 * (total[i, j] + more[i, j] + total[j, i] + more[j, i])
            total[i, j] = both
            total[j, i] = both


@compiled
def _begin(a: Array, g: Array, q: Array, shift: float, ak: Array, gk: Array, hk: Array, work: Array) -> bool:
    """Write the Cayley transform: A_0, G_0 and H_0."""
    n = a.shape[0]
    less, inverse, both, turned = work[4], work[5], work[6], work[7]
    for i in range(n):
        for j in range(n):
            unit = 1.0 if i == j else 0.0
            less[i, j] = a[i, j] - shift * unit
            inverse[i, j] = unit
    if not solve_general(less, inverse):
        return False
    multiply(inverse, g, turned)  # (A - r)^-1 G
    multiply(q, turned, both)
    for i in range(n):
        for j in range(n):
            both[i, j] += a[j, i] - (shift if i == j else 0.0)  # (A - r)' + Q (A - r)^-1 G
            less[i, j] = both[i, j]
    multiply(q, inverse, hk)
    if not solve_general(both, hk):
        return False
    for i in range(n):
        for j in range(n):
            hk[i, j] *= 2.0 * shift
            both[i, j] = less[j, i]
            ak[i, j] = 1.0 if i == j else 0.0
            gk[i, j] = turned[j, i]
    if not solve_general(both, ak):
        return False
    for i in range(n):
        for j in range(n):
            both[i, j] = less[j, i]
    if not solve_general(both, gk):
        return False
    for i in range(n):
        for j in range(n):
            ak[i, j] = 2.0 * shift * ak[i, j] + (1.0 if i == j else 0.0)
            turned[i, j] = 2.0 * shift * gk[j, i]
    for i in range(n):
        for j in range(n):
            gk[i, j] = turned[i, j]
    return True


def riccati(a: Array, g: Array, q: Array, shift: float) -> Array:
    """Return the stabilising solution of ``a'x + x a - x g x + q = 0``.

    Parameters
    ----------
    a, g, q
        (n, n); g and q symmetric positive semidefinite.
    shift
        About the size of the fast eigenvalues [1/s].

    Raises
    ------
    ControlError
        If there is none.
    """
    n = a.shape[0]
    x = np.zeros((n, n))
    a, g, q = (np.ascontiguousarray(one, np.float64) for one in (a, g, q))
    if not solve_riccati(a, g, q, shift, x, np.zeros((WORK, n, n))) or not np.isfinite(x).all():
        message = "no gain stabilises what is believed; expected a model whose unstable modes the surfaces reach"
        raise ControlError(message)
    return x
