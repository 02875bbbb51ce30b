"""Small dense linear algebra as explicit loops: the same bits compiled and interpreted, and no memory of its own."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from msls_ros.control.compiled import compiled

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
TINY = 1e-300


@compiled
def solve_positive(a: Array, y: Array, n: int) -> None:
    """Solve ``a y = y`` in place for a symmetric positive definite matrix, by Cholesky factors.

    Parameters
    ----------
    a
        (>= n, >= n) matrix; its lower triangle becomes the factor.
    y
        (>= n,) right-hand side, becomes the solution.
    n
        Order.
    """
    for j in range(n):
        for k in range(j):
            a[j, j] -= a[j, k] * a[j, k]
        a[j, j] = math.sqrt(max(a[j, j], TINY))
        for i in range(j + 1, n):
            for k in range(j):
                a[i, j] -= a[i, k] * a[j, k]
            a[i, j] /= a[j, j]
    for i in range(n):
        for k in range(i):
            y[i] -= a[i, k] * y[k]
        y[i] /= a[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            y[i] -= a[k, i] * y[k]
        y[i] /= a[i, i]


@compiled
def multiply(a: Array, b: Array, out: Array) -> None:
    """Write the product of (n, k) and (k, m) into ``out`` (n, m)."""
    for i in range(a.shape[0]):
        for j in range(b.shape[1]):
            out[i, j] = 0.0
        for k in range(a.shape[1]):
            factor = a[i, k]
            if factor != 0.0:
                for j in range(b.shape[1]):
                    out[i, j] += factor * b[k, j]


@compiled
def multiply_transposed(a: Array, b: Array, out: Array) -> None:
    """Write ``a' b`` of (k, n) and (k, m) into ``out`` (n, m)."""
    for i in range(a.shape[1]):
        for j in range(b.shape[1]):
            out[i, j] = 0.0
    for k in range(a.shape[0]):
        for i in range(a.shape[1]):
            factor = a[k, i]
            if factor != 0.0:
                for j in range(b.shape[1]):
                    out[i, j] += factor * b[k, j]


@compiled
def solve_general(a: Array, y: Array) -> bool:
    """Solve ``a x = y`` in place with partial pivoting; ``a`` (n, n) is destroyed, ``y`` (n, m) becomes x.

    Returns
    -------
    bool
        False for a singular matrix.
    """
    n, m = y.shape
    for j in range(n):
        pivot, largest = j, abs(a[j, j])
        for i in range(j + 1, n):
            if abs(a[i, j]) > largest:
                pivot, largest = i, abs(a[i, j])
        if not largest > TINY:
            return False
        if pivot != j:
            for k in range(n):
                a[j, k], a[pivot, k] = a[pivot, k], a[j, k]
            for k in range(m):
                y[j, k], y[pivot, k] = y[pivot, k], y[j, k]
        for i in range(j + 1, n):
            factor = a[i, j] / a[j, j]
            if factor != 0.0:
                for k in range(j + 1, n):
                    a[i, k] -= factor * a[j, k]
                for k in range(m):
                    y[i, k] -= factor * y[j, k]
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            for k in range(m):
                y[i, k] -= a[i, j] * y[j, k]
        for k in range(m):
            y[i, k] /= a[i, i]
    return True
