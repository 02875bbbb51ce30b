"""The estimators compared, each behind one interface: `update` takes a sample, ``theta`` holds the estimates.

Each is set to the same problem (r rows, p regressors, forgetting factor lambda, estimates zero at the start, a prior
that counts for nothing) and called in its fastest sensible way. MSLS has the penalty W0 besides, the others have none.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from msls_ros.estimation import MSLS, RLS

Array = NDArray[np.float64]
PRIOR = 1e8


class Estimator(Protocol):
    """What is timed."""

    @property
    def theta(self) -> Array:
        """(r, p) estimates."""

    def update(self, phi: Array, y: Array) -> Any:
        """Take a (p,) regressor and (r,) outputs."""


class CovarianceRLS:
    """What most engineers write with numpy, and the symmetrisation without which it ends in NaN."""

    def __init__(self, p: int, rows: int, forgetting: float) -> None:
        self.P, self.theta, self.forgetting = PRIOR * np.eye(p), np.zeros((rows, p)), forgetting

    def update(self, phi: Array, y: Array) -> None:
        """One sample."""
        g = self.P @ phi
        K = g / (self.forgetting + phi @ g)
        self.theta += (y - self.theta @ phi)[:, None] * K
        P = (self.P - K[:, None] * g) / self.forgetting
        self.P = 0.5 * (P + P.T)


class TriangularPentagonal:
    """LAPACK dtpqrt on ``[sqrt(lambda) R; phi; W0]`` (eq 14), W0 its triangular part; without W0: square-root RLS."""

    def __init__(self, p: int, rows: int, forgetting: float, w0: float = 0.0) -> None:
        lapack: Any = importlib.import_module("scipy.linalg.lapack")
        self._factorise, self._solve = lapack.dtpqrt, lapack.dtrtrs
        self._triangular = p if w0 > 0.0 else 0
        self._rows = np.zeros((self._triangular + 1, p + 1), order="F")
        self._penalty = self._rows.copy(order="F")
        if w0 > 0.0:
            self._penalty[1:, :p] = w0 * np.eye(p)
        self._penalty[0, p] = 1.0
        self._factor = np.zeros((p + 1, p + 1), order="F")
        if w0 == 0.0:
            self._factor[:p, :p] = np.eye(p) / math.sqrt(PRIOR)
        self._root, self._p, self.theta = math.sqrt(forgetting), p, np.zeros((rows, p))

    def update(self, phi: Array, y: Array) -> None:
        """One sample."""
        p, factor, below = self._p, self._factor, self._rows
        factor *= self._root
        factor[:, p] = 0.0
        below[:] = self._penalty
        below[0, :p] = phi
        self._factorise(self._triangular, p + 1, factor, below, 1, 1)
        K, _ = self._solve(factor[:, :p], factor[:, p])
        self.theta += (y - self.theta @ phi)[:, None] * K[:p]


class Padasip:
    """padasip's FilterRLS, one for each row."""

    def __init__(self, p: int, rows: int, forgetting: float) -> None:
        filters: Any = importlib.import_module("padasip.filters")
        self._filters = [filters.FilterRLS(n=p, mu=forgetting, eps=1.0 / PRIOR, w="zeros") for _ in range(rows)]

    @property
    def theta(self) -> Array:
        """(r, p) estimates."""
        return np.array([one.w for one in self._filters])

    def update(self, phi: Array, y: Array) -> None:
        """One sample."""
        for one, output in zip(self._filters, y, strict=True):
            one.adapt(output, phi)


class Filterpy:
    """filterpy's KalmanFilter, one for each row: constant parameters, fading memory ``alpha = 1/sqrt(lambda)``."""

    def __init__(self, p: int, rows: int, forgetting: float) -> None:
        kalman: Any = importlib.import_module("filterpy.kalman")
        self._filters = [kalman.KalmanFilter(dim_x=p, dim_z=1) for _ in range(rows)]
        for one in self._filters:
            one.P = PRIOR * np.eye(p)
            one.Q = np.zeros((p, p))
            one.alpha = forgetting**-0.5

    @property
    def theta(self) -> Array:
        """(r, p) estimates."""
        return np.array([one.x[:, 0] for one in self._filters])

    def update(self, phi: Array, y: Array) -> None:
        """One sample."""
        H = phi[None, :]
        for one, output in zip(self._filters, y, strict=True):
            one.predict()
            one.update(output, H=H)


class OnlineDMD:
    """odmd's OnlineDMD: a square system of p outputs, of which r are used; its random start is set to zero."""

    def __init__(self, p: int, rows: int, forgetting: float) -> None:
        package: Any = importlib.import_module("odmd")
        self._system = package.OnlineDMD(p, forgetting)
        self._system.A = np.zeros((p, p))
        self._outputs, self._r = np.zeros(p), rows

    @property
    def theta(self) -> Array:
        """(r, p) estimates."""
        theta: Array = self._system.A[: self._r]
        return theta

    def update(self, phi: Array, y: Array) -> None:
        """One sample."""
        self._outputs[: self._r] = y
        self._system.update(phi, self._outputs)


@dataclass(frozen=True)
class Peer:
    """How to make an estimator, and what it does per update."""

    does: str
    make: Callable[[int, int, float, float], Estimator]
    """Of p, r, lambda, w0."""


OURS = "msls_ros MSLS"
PEERS: Mapping[str, Peer] = {
    OURS: Peer("MSLS, rows, error bars, checks", lambda p, r, forgetting, w0: MSLS(p, r, forgetting, w0)),
    "msls_ros RLS": Peer("RLS, rows, error bars, checks", lambda p, r, forgetting, w0: RLS(p, r, forgetting, PRIOR)),
    "numpy covariance RLS": Peer("symmetrised RLS, rows", lambda p, r, forgetting, w0: CovarianceRLS(p, r, forgetting)),
    "scipy dtpqrt MSLS": Peer("MSLS, rows", lambda p, r, forgetting, w0: TriangularPentagonal(p, r, forgetting, w0)),
    "scipy dtpqrt RLS": Peer(
        "square-root RLS, rows", lambda p, r, forgetting, w0: TriangularPentagonal(p, r, forgetting)
    ),
    "odmd OnlineDMD": Peer("symmetrised RLS, p rows", lambda p, r, forgetting, w0: OnlineDMD(p, r, forgetting)),
    "padasip FilterRLS": Peer("RLS, one for each row", lambda p, r, forgetting, w0: Padasip(p, r, forgetting)),
    "filterpy KalmanFilter": Peer(
        "Joseph form, one for each row", lambda p, r, forgetting, w0: Filterpy(p, r, forgetting)
    ),
}
