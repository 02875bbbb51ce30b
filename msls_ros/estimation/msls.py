"""MSLS by itself: many rows, one shared factor, no detector (eqs 6-14). `RLS` is the peer that it is compared with.

Both have one interface: `update` takes a regressor and an output per row and returns the prediction errors; ``theta``
holds the estimates and `standard_errors` their error bars. `Identifier` is the complete thing; these are for
comparisons and for those who bring their own supervision.
"""

from __future__ import annotations

import math

import numpy as np

from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.errors import EstimationError
from msls_ros.estimation.kernel import Array, Work, make_work, msls_gain, propagate_covariance, rls_gain

RESIDUAL_FORGETTING = 0.98
PRIOR = 1e8


@compiled
def apply_gain(
    theta: Array, phi: Array, y: Array, e: Array, squares: Array, P: Array, c: Array, u: Array, work: Work
) -> None:
    """Correct every row with the shared gain ``work.K`` (eq 11), and propagate the covariance.

    Parameters
    ----------
    theta
        (r, p) estimates; updated.
    phi, y
        (p,) regressor and (r,) outputs.
    e
        (r,) out: prediction errors before the update.
    squares
        (r + 1,) weighted sums of the normalised squared errors, and of the weights; updated.
    P, c, u
        (p, p), (p,), (p,) see `propagate_covariance`.
    work
        Holds the gain; scratch.
    """
    variance, _, _ = propagate_covariance(P, c, u, 0.0, 0.0, phi, work.K, work.g)
    r = y.shape[0]
    squares[r] = RESIDUAL_FORGETTING * squares[r] + 1.0
    for q in range(r):
        row = theta[q]
        error = y[q]
        for i in range(phi.shape[0]):
            error -= row[i] * phi[i]
        for i in range(phi.shape[0]):
            row[i] += work.K[i] * error
        e[q] = error
        squares[q] = RESIDUAL_FORGETTING * squares[q] + error * error / variance


@compiled
def msls_update(
    R: Array,
    omega: Array,
    theta: Array,
    phi: Array,
    y: Array,
    w0: Array,
    forgetting: float,
    retained: bool,
    e: Array,
    squares: Array,
    P: Array,
    c: Array,
    u: Array,
    work: Work,
) -> None:
    """One complete MSLS update; see `msls_gain` and `apply_gain`."""
    msls_gain(R, omega, phi, w0, 1.0, forgetting, retained, work)
    apply_gain(theta, phi, y, e, squares, P, c, u, work)


@compiled
def rls_update(
    C: Array,
    theta: Array,
    phi: Array,
    y: Array,
    forgetting: float,
    e: Array,
    squares: Array,
    P: Array,
    c: Array,
    u: Array,
    work: Work,
) -> None:
    """One complete RLS update; see `rls_gain` and `apply_gain`."""
    rls_gain(C, phi, forgetting, work)
    apply_gain(theta, phi, y, e, squares, P, c, u, work)


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
        self.theta = np.zeros((rows, regressors))
        """(rows, regressors) the estimates."""
        self._P = np.zeros((regressors, regressors))
        self._c, self._u = np.zeros(regressors), np.zeros(regressors)
        self._squares = np.zeros(rows + 1)
        self._work = make_work(regressors)

    def _checked(self, phi: Array, y: Array) -> tuple[Array, Array]:
        phi, y = np.ascontiguousarray(phi, dtype=np.float64), np.ascontiguousarray(y, dtype=np.float64)
        rows, p = self.theta.shape
        if phi.shape != (p,) or y.shape != (rows,):
            message = f"regressor of shape {phi.shape} and outputs of shape {y.shape}; expected ({p},) and ({rows},)"
            raise EstimationError(message)
        if not (math.isfinite(phi.sum()) and math.isfinite(y.sum())):
            message = "regressor or outputs hold a number that is not finite; expected finite numbers"
            raise EstimationError(message)
        return phi, y

    def standard_errors(self) -> Array:
        """Standard errors of the estimates, for white residuals: (rows, regressors); infinite before any data."""
        rows, p = self.theta.shape
        if self._squares[rows] == 0.0:
            return np.full((rows, p), math.inf)
        variance = self._squares[:rows, None] / self._squares[rows] * np.maximum(np.diagonal(self._P), 0.0)
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
        self.w0 = np.array(np.broadcast_to(np.asarray(w0, dtype=np.float64), (regressors,)))
        if not (np.isfinite(self.w0).all() and (self.w0 >= 0.0).all()):
            message = f"penalty {self.w0}; expected finite numbers, 0 or more"
            raise EstimationError(message)
        self.retained = bool(retained)
        self.R = np.zeros((regressors, regressors))
        """(p, p) upper triangular factor of the data."""
        self.omega = np.zeros(regressors)
        """(p,) squared penalties."""
        self._P += np.diag([1e4 / w**2 if w > 0.0 else PRIOR for w in self.w0])

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
        phi, y = self._checked(phi, y)
        e = np.empty(len(y))
        msls_update(
            self.R, self.omega, self.theta, phi, y, self.w0, self.forgetting, self.retained, e,
            self._squares, self._P, self._c, self._u, self._work,
        )  # fmt: skip
        return e


class RLS(_Recursive):
    """Recursive least squares with a shared covariance, in the symmetric form that does not end in NaN.

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
        self.C = np.eye(regressors) * prior
        """(p, p) inverse of the weighted data matrix."""
        self._P += np.eye(regressors) * prior

    def update(self, phi: Array, y: Array) -> Array:
        """Take one sample; as `MSLS.update`."""
        phi, y = self._checked(phi, y)
        e = np.empty(len(y))
        rls_update(self.C, self.theta, phi, y, self.forgetting, e, self._squares, self._P, self._c, self._u, self._work)
        return e
