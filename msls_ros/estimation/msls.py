"""MSLS by itself: many rows, one shared factor, no detector (eqs 6-14). `RLS` is the peer that it is compared with.

Both have one interface: `update` takes a regressor and an output per row and returns the prediction errors; ``theta``
holds the estimates and `standard_errors` their error bars. `Identifier` is the complete thing; these are for
comparisons and for those who bring their own supervision.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from msls_ros.estimation.compiled import compiled, passed_by_reference
from msls_ros.estimation.errors import EstimationError
from msls_ros.estimation.kernel import Array, Work, msls_gain, propagate_covariance, rls_gain

RESIDUAL_FORGETTING = 0.98
PRIOR = 1e8


@passed_by_reference
class Memory(NamedTuple):
    """State and scratch by name. p regressors, r rows."""

    R: Array
    """(p, p) upper triangular factor of the data; for RLS the inverse of the weighted data matrix."""
    omega: Array
    """(p,) squared penalties."""
    w0: Array
    """(p,) penalties W0."""
    theta: Array
    """(r, p) estimates."""
    P: Array
    """(p, p) see `propagate_covariance`, as c and u."""
    c: Array
    """(p,)"""
    u: Array
    """(p,)"""
    work: Work


VECTORS = 10
MATRICES = 4


def allocate(p: int, rows: int) -> Array:
    """Allocate what `unpack` takes apart, zero: one array, for numba takes 0.05 us to accept each array of a call."""
    return np.zeros((VECTORS + MATRICES * p + 2 + rows, p))


def unpack(memory: Array) -> Memory:
    """Name the parts of a block of rows of length p: vectors, then matrices, then the estimates."""
    p = memory.shape[1]
    m = VECTORS
    S = m + 2 * p
    W = S + p + 1
    work = Work(
        phi=memory[0],
        z=memory[1],
        S=memory[S:W],
        W=memory[W : W + p + 1],
        K=memory[2],
        g=memory[3],
        variance=memory[4],
        lag=memory[5],
    )
    return Memory(
        R=memory[m : m + p],
        omega=memory[6],
        w0=memory[7],
        theta=memory[W + p + 1 :],
        P=memory[m + p : S],
        c=memory[8],
        u=memory[9],
        work=work,
    )


_unpack = compiled(unpack)


@compiled
def all_finite(x: Array) -> bool:
    """Whether no number of x is infinite or NaN."""
    bad = 0
    for i in range(x.shape[0]):
        if not math.isfinite(x[i]):
            bad += 1
    return bad == 0


@compiled
def apply_gain(m: Memory, squares: Array, phi: Array, y: Array, e: Array) -> None:
    """Correct every row with the shared gain ``m.work.K`` (eq 11), and propagate the covariance.

    Parameters
    ----------
    m
        State and scratch.
    squares
        (r + 1,) weighted sums of the normalised squared errors, and of the weights; updated.
    phi, y
        (p,) regressor and (r,) outputs.
    e
        (r,) out: prediction errors before the update.
    """
    K = m.work.K
    theta = m.theta
    variance, _, _ = propagate_covariance(m.P, m.c, m.u, 0.0, 0.0, phi, K, m.work.g)
    if variance < 1.0:  # rounding, while P is still as large as its prior
        variance = 1.0
    p = phi.shape[0]
    r = y.shape[0]
    squares[r] = RESIDUAL_FORGETTING * squares[r] + 1.0
    for q in range(r):
        error = y[q]
        for i in range(p):
            error -= theta[q, i] * phi[i]
        for i in range(p):
            theta[q, i] += K[i] * error
        e[q] = error
        squares[q] = RESIDUAL_FORGETTING * squares[q] + error * error / variance


@compiled
def msls_update(
    memory: Array, squares: Array, phi: Array, y: Array, e: Array, forgetting: float, retained: bool
) -> bool:
    """One complete MSLS update, see `msls_gain` and `apply_gain`; False, and nothing done, for numbers not finite."""
    if not (all_finite(phi) and all_finite(y)):
        return False
    m = _unpack(memory)
    msls_gain(m.R, m.omega, phi, m.w0, 1.0, forgetting, retained, m.work)
    apply_gain(m, squares, phi, y, e)
    return True


@compiled
def rls_update(memory: Array, squares: Array, phi: Array, y: Array, e: Array, forgetting: float) -> bool:
    """One complete RLS update, see `rls_gain` and `apply_gain`; False, and nothing done, for numbers not finite."""
    if not (all_finite(phi) and all_finite(y)):
        return False
    m = _unpack(memory)
    rls_gain(m.R, phi, forgetting, m.work)
    apply_gain(m, squares, phi, y, e)
    return True


class _Recursive:
    """What MSLS and RLS share: sizes, estimates, error bars, checks."""

    def __init__(self, regressors: int, rows: int, forgetting: float) -> None:
        """Allocate; see the subclasses."""
        if regressors < 1 or rows < 1:
            message = f"{regressors} regressors and {rows} rows; expected at least one of each"
            raise EstimationError(message)
        if not 0.0 < forgetting <= 1.0:
            message = f"forgetting factor {forgetting}; expected more than 0 and at most 1"
            raise EstimationError(message)
        self.forgetting = float(forgetting)
        self._memory = allocate(regressors, rows)
        self._parts = unpack(self._memory)
        self._squares = np.zeros(rows + 1)
        self._shapes = (regressors,), (rows,)
        self.theta = self._parts.theta
        """(rows, regressors) the estimates."""
        self.gain = self._parts.work.K
        """(regressors,) the gain of the last update, shared by all rows."""

    def _checked(self, phi: Array, y: Array) -> tuple[Array, Array, Array]:
        """Return regressor and outputs as the compiled update takes them, and room for the prediction errors."""
        phi, y = np.ascontiguousarray(phi, np.float64), np.ascontiguousarray(y, np.float64)
        if (phi.shape, y.shape) != self._shapes:
            (p,), (rows,) = self._shapes
            message = f"regressor of shape {phi.shape} and outputs of shape {y.shape}; expected ({p},) and ({rows},)"
            raise EstimationError(message)
        return phi, y, np.empty(self._shapes[1])

    @staticmethod
    def _not_finite() -> EstimationError:
        message = "regressor or outputs hold a number that is not finite; expected finite numbers"
        return EstimationError(message)

    def standard_errors(self) -> Array:
        """Standard errors of the estimates, for white residuals: (rows, regressors); infinite before any data."""
        rows, p = self.theta.shape
        if self._squares[rows] == 0.0:
            return np.full((rows, p), math.inf)
        variance = self._squares[:rows, None] / self._squares[rows] * np.maximum(np.diagonal(self._parts.P), 0.0)
        errors: Array = np.sqrt(variance)
        return errors


class MSLS(_Recursive):
    """Modified sequential least squares with a shared factor (eq 14).

    Parameters
    ----------
    regressors, rows
        p and r.
    forgetting
        Forgetting factor lambda, 0 < lambda <= 1 [1].
    w0
        Penalty W0 on parameter change, one value or (p,), in units of the regressors.
    retained
        Keep the penalty rows in the factor (the literal eq 14), else apply them at the solve only.

    Raises
    ------
    EstimationError
        For sizes, a forgetting factor or penalties out of range.
    """

    def __init__(
        self, regressors: int, rows: int, forgetting: float, w0: float | Array, *, retained: bool = True
    ) -> None:
        """Start with no data and zero estimates; see the class."""
        super().__init__(regressors, rows, forgetting)
        self.w0 = self._parts.w0
        """(p,) penalties W0."""
        self.w0[:] = w0
        if not (np.isfinite(self.w0).all() and (self.w0 >= 0.0).all()):
            message = f"penalty {self.w0}; expected finite numbers, 0 or more"
            raise EstimationError(message)
        self.retained = bool(retained)
        self.R = self._parts.R
        """(p, p) upper triangular factor of the data."""
        self.omega = self._parts.omega
        """(p,) squared penalties."""
        self._parts.P[:] = np.diag([1e4 / w**2 if w > 0.0 else PRIOR for w in self.w0])

    def update(self, phi: Array, y: Array) -> Array:
        """Take one sample; return the prediction errors before it (eq 11).

        Parameters
        ----------
        phi, y
            (p,) regressor and (r,) outputs.

        Raises
        ------
        EstimationError
            For wrong shapes or numbers that are not finite; nothing has changed then.
        """
        phi, y, e = self._checked(phi, y)
        if not msls_update(self._memory, self._squares, phi, y, e, self.forgetting, self.retained):
            raise self._not_finite()
        return e


class RLS(_Recursive):
    """Recursive least squares with a shared covariance, symmetric to the last bit.

    That outlasts the textbook form, but does not save it: where the memory is shorter than the regressor (forgetting
    factor 0.1, 17 regressors) it too loses positive definiteness, after some 700 samples, and ends in NaN.

    Parameters
    ----------
    regressors, rows
        p and r.
    forgetting
        Forgetting factor lambda, 0 < lambda <= 1 [1].
    prior
        Initial covariance, times the identity.

    Raises
    ------
    EstimationError
        For sizes or a forgetting factor out of range.
    """

    def __init__(self, regressors: int, rows: int, forgetting: float, prior: float = PRIOR) -> None:
        """Start with the prior and zero estimates; see the class."""
        super().__init__(regressors, rows, forgetting)
        self.C = self._parts.R
        """(p, p) inverse of the weighted data matrix."""
        self.C[:] = np.eye(regressors) * prior
        self._parts.P[:] = np.eye(regressors) * prior

    def update(self, phi: Array, y: Array) -> Array:
        """Take one sample; as `MSLS.update`."""
        phi, y, e = self._checked(phi, y)
        if not rls_update(self._memory, self._squares, phi, y, e, self.forgetting):
            raise self._not_finite()
        return e
