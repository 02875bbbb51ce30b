"""The compiled core: one sample in, the gain, the estimates, their covariance and the change statistic out.

What it computes (equation numbers: Ward, Barron, Carley and Curtis). All rows (output equations) that share a history
share one factor; the right-hand sides differ only by the scalar prediction error, so one gain ``K`` serves them all::

    [ sqrt(lambda) R | 0 ]  Givens     [ R' | z ]          R: data only, p x p, upper triangular
    [     phi        | 1 ]  ------->   [ 0  | s ]          (eq 10, with the right-hand side divided by the error)

    [ R'                | z ]  Householder   [ S | zs ]    S'S = R'R + diag(omega): data and penalty
    [ diag(sqrt(omega)) | 0 ]  ----------->  [ 0 | *  ]    (eq 14)

    S K = zs                                               back-substitution (eq 9)
    theta_q += K e_q,   e_q = y_q - phi' theta_q           (eq 11), for every row q of the group

``omega`` carries both readings of eq 14: ``omega = lambda omega + w0^2`` keeps the penalty rows in the factor (the
literal eq 14), ``omega = w0^2`` applies them at the solve only. The Householder step takes one reflection per column
over ``{S_jj, penalty rows 0..j}``: p^3/3 multiply-adds. S and the penalty rows are stored by columns: its inner loops
then run over contiguous numbers, and the dot products of one reflection are chains that the processor overlaps.

Why this form: the factor never squares the condition number, a reset is ``R = 0``, and the penalty needs no second
path. The covariance of the gain sequence actually used is propagated beside it (`propagate_covariance`), because
``s^2 (R'R)^-1`` is not calibrated for a penalised estimate with forgetting.

Everything here is explicit loops over float64 with `math.sqrt`: no BLAS, no libm beyond the square root, no fastmath.

References
----------
Golub and Van Loan, *Matrix Computations*, 4th ed., sections 5.1.8 (Givens), 5.1.2 (Householder), 6.5 (updating).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msls_ros.estimation.compiled import compiled, passed_by_reference

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

FLUSH = 1e-150
"""Entries of R below this become zero: their squares would underflow."""

PIVOT = 1e-12
"""A pivot below this share of its own column's norm carries no information and is skipped."""


@passed_by_reference
class Work(NamedTuple):
    """Scratch of one update; no state. p regressors."""

    phi: Array
    """(p,) the regressor, destroyed by the rotation."""
    z: Array
    """(p,) right-hand side of R."""
    S: Array
    """(p+1, p) penalised factor by columns: ``S[k]`` is its column k, ``S[p]`` its right-hand side."""
    W: Array
    """(p+1, p) penalty rows, by columns too."""
    K: Array
    """(p,) the gain."""
    g: Array
    """(p,) P phi, then Cov(theta error, prediction error)."""
    variance: Array
    """(m,) predicted variance of the prediction error, per colour of the residual."""
    lag: Array
    """(m,) predicted covariance of it with the one before, per colour."""


def make_work(p: int, colours: int = 1) -> Work:
    """Allocate the scratch for p regressors and m colours."""
    columns = (p + 1, p)
    z, K, g = np.zeros(p), np.zeros(p), np.zeros(p)
    return Work(np.zeros(p), z, np.zeros(columns), np.zeros(columns), K, g, np.zeros(colours), np.zeros(colours))


@compiled
def rotate_in(R: Array, phi: Array, z: Array, root: float) -> None:
    """Scale R by ``root = sqrt(lambda)`` and rotate the row ``[phi | 1]`` into ``[R | 0]`` (eq 10), in place.

    Parameters
    ----------
    R
        (p, p) upper triangular factor of the data.
    phi
        (p,) regressor; destroyed.
    z
        (p,) out: right-hand side that belongs to R.
    root
        Square root of the forgetting factor.
    """
    p = R.shape[0]
    s = 1.0
    for j in range(p):
        for k in range(j, p):
            x = R[j, k] * root
            R[j, k] = x if abs(x) >= FLUSH else 0.0
        b = phi[j]
        if abs(b) < FLUSH:
            z[j] = 0.0
            continue
        a = R[j, j]
        r = math.sqrt(a * a + b * b)
        c = a / r
        t = b / r
        R[j, j] = r
        for k in range(j + 1, p):
            x = R[j, k]
            y = phi[k]
            R[j, k] = c * x + t * y
            phi[k] = c * y - t * x
        z[j] = t * s
        s = c * s


@compiled
def penalise(R: Array, z: Array, omega: Array, S: Array, W: Array) -> None:
    """Triangularise ``[R | z; diag(sqrt(omega)) | 0]`` into S by structured Householder reflections (eq 14).

    Reflection j is ``I + h v v'`` over row j of S and penalty rows 0..j. When its turn comes, penalty row j still holds
    nothing but its own entry in column j.

    Parameters
    ----------
    R, z
        (p, p) and (p,) data factor and its right-hand side.
    omega
        (p,) squared penalties.
    S
        (p+1, p) out: the penalised factor by columns, its right-hand side last.
    W
        (p+1, p) scratch: the penalty rows by columns.
    """
    p = R.shape[0]
    for j in range(p):
        for k in range(j, p):
            S[k, j] = R[j, k]
        S[p, j] = z[j]
        own = math.sqrt(omega[j])
        below = own * own
        for i in range(j):
            below += W[j, i] * W[j, i]
        if below < FLUSH * FLUSH:
            for k in range(j + 1, p + 1):
                W[k, j] = 0.0
            continue
        x = S[j, j]
        norm = math.sqrt(x * x + below)
        alpha = -norm if x >= 0.0 else norm
        v0 = x - alpha
        h = -1.0 / (alpha * v0)
        for k in range(j + 1, p + 1):
            f = v0 * S[k, j]
            for i in range(j):
                f += W[j, i] * W[k, i]
            f *= h
            S[k, j] -= v0 * f
            for i in range(j):
                W[k, i] -= W[j, i] * f
            W[k, j] = -own * f
        S[j, j] = alpha


@compiled
def solve_gain(S: Array, K: Array) -> None:
    """Back-substitute ``S K = zs`` (eq 9); a pivot without information gets a zero gain and is never divided by.

    Parameters
    ----------
    S
        (p+1, p) triangular factor by columns, right-hand side last; the right-hand side is destroyed.
    K
        (p,) out: the gain.
    """
    p = K.shape[0]
    for j in range(p - 1, -1, -1):
        square = 0.0
        for i in range(j + 1):
            square += S[j, i] * S[j, i]
        pivot = S[j, j]
        if pivot * pivot <= PIVOT * PIVOT * square:
            K[j] = 0.0
            continue
        gain = S[p, j] / pivot
        for i in range(j):
            S[p, i] -= S[j, i] * gain
        K[j] = gain


@compiled
def msls_gain(
    R: Array, omega: Array, phi: Array, w0: Array, factor: float, forgetting: float, retained: bool, work: Work
) -> None:
    """One MSLS factor update (eq 14): R, omega and ``work.K`` change.

    Parameters
    ----------
    R, omega
        (p, p) and (p,) state of the group.
    phi
        (p,) regressor; kept.
    w0
        (p,) penalties W0, in units of the regressors.
    factor
        Multiplies w0 (recovery after an alarm) [1].
    forgetting
        Forgetting factor lambda [1].
    retained
        Keep the penalty rows in the factor (the literal eq 14), else apply them at the solve only.
    work
        Scratch; ``work.K`` holds the gain afterwards, ``work.S`` the penalised factor.
    """
    for j in range(phi.shape[0]):
        work.phi[j] = phi[j]
    rotate_in(R, work.phi, work.z, math.sqrt(forgetting))
    keep = forgetting if retained else 0.0
    for j in range(phi.shape[0]):
        w = factor * w0[j]
        omega[j] = keep * omega[j] + w * w
    penalise(R, work.z, omega, work.S, work.W)
    solve_gain(work.S, work.K)


@compiled
def rls_gain(C: Array, phi: Array, forgetting: float, work: Work) -> None:
    """One RLS update in symmetric covariance form: ``C`` and ``work.K`` change.

    Both triangles come from one commutative expression, so C stays symmetric to the last bit; in the textbook form
    ``(C - k phi' C)/lambda`` the asymmetry grows by 1/lambda a sample, until it ends in NaN.

    Parameters
    ----------
    C
        (p, p) inverse of the weighted data matrix.
    phi
        (p,) regressor.
    forgetting
        Forgetting factor lambda [1].
    work
        Scratch; ``work.K`` holds the gain afterwards.
    """
    p = phi.shape[0]
    g = work.g
    K = work.K
    multiply(C, phi, g)
    d = forgetting
    for i in range(p):
        d += phi[i] * g[i]
    for i in range(p):
        K[i] = g[i] / d
    for i in range(p):
        for k in range(p):
            C[i, k] = (C[i, k] - g[i] * g[k] / d) / forgetting


@compiled
def multiply(P: Array, phi: Array, g: Array) -> None:
    """Write ``P phi`` into g. P is symmetric to the last bit, so its rows serve as its columns: the loop vectorises."""
    p = phi.shape[0]
    for k in range(p):
        g[k] = 0.0
    for i in range(p):
        x = phi[i]
        for k in range(p):
            g[k] += P[i, k] * x


@compiled
def copy_rows(of: Array, to: Array) -> None:
    """Copy a matrix: (n, k) each."""
    for i in range(of.shape[0]):
        for j in range(of.shape[1]):
            to[i, j] = of[i, j]


@compiled
def propagate_covariance(
    P: Array, c: Array, u: Array, b: float, rho: float, phi: Array, K: Array, g: Array
) -> tuple[float, float, float]:
    """Propagate the error covariance of the gain sequence for residuals that are AR(1) with coefficient ``rho``.

    With the parameter error ``t`` and the residual ``v`` of unit variance, ``e = phi' t + v`` and ``t -= K e``; the
    pair ``(t, v)`` is Markov, so ``P = E[t t']`` and ``c = E[t v]`` propagate exactly. ``rho = 0`` gives the white case
    ``P += -K g' - g K' + (1 + d) K K'``.

    Parameters
    ----------
    P
        (p, p) covariance over the residual variance; updated, symmetric to the last bit.
    c
        (p,) covariance of the parameter error and the next residual; updated.
    u
        (p,) covariance of the parameter error and the last prediction error; updated.
    b
        Covariance of this residual and the last prediction error.
    rho
        Coefficient of the residual [1].
    phi, K
        (p,) regressor and gain of this sample.
    g
        (p,) scratch.

    Returns
    -------
    tuple of float
        Variance of this prediction error, its covariance with the last one (both over the residual variance), and
        the next ``b``.
    """
    p = phi.shape[0]
    multiply(P, phi, g)
    lag = b
    variance = 1.0
    a = 0.0
    for i in range(p):
        g[i] += c[i]
        variance += phi[i] * g[i]
        a += phi[i] * c[i]
        lag += phi[i] * u[i]
    variance += a
    if variance < 0.0:
        variance = 0.0
    half = 0.5 * variance
    for i in range(p):
        u[i] = half * K[i] - g[i]
    for i in range(p):
        ui = u[i]
        ki = K[i]
        for k in range(p):
            P[i, k] += ui * K[k] + ki * u[k]
    for i in range(p):
        u[i] = g[i] - variance * K[i]
        c[i] = rho * (c[i] - (a + 1.0) * K[i])
    return variance, lag, rho * (a + 1.0)


@compiled
def inverse_diagonal(S: Array, V: Array, out: Array) -> None:
    """Diagonal of ``(S'S)^-1``; infinite where a pivot carries no information.

    Parameters
    ----------
    S
        (p+1, p) upper triangular factor by columns (the last, its right-hand side, is not used).
    V
        (p+1, p) scratch: the inverse of S, by rows; within a column of it the sums are independent.
    out
        (p,) out.
    """
    p = out.shape[0]
    for k in range(p):
        pivot = S[k, k]
        inverse = 1.0 / pivot if pivot != 0.0 else 0.0
        for i in range(k):
            total = 0.0
            for m in range(i, k):
                total += V[i, m] * S[k, m]
            v = -total * inverse
            V[i, k] = v
            out[i] += v * v
        V[k, k] = inverse
        out[k] = inverse * inverse if pivot != 0.0 else math.inf
