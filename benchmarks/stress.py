"""The stream on which recursive estimators fail: two regressors that are almost one, and next to no memory.

``phi ~ N(0, 1)`` but ``phi2 = phi1 + N(0, 0.01^2)``; ``y = phi1 - phi2 + N(0, 0.004^2)``: constant parameters
(1, -1, 0, ..., 0) in the direction that the data hardly show. The estimates start at zero, so a peak error (the largest
of any parameter after any sample) of about 1 is the start itself; what lies above it is noise that the estimator has
amplified.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers import PEERS, Peer

Array = NDArray[np.float64]
CASES = ((0.1, 2), (0.1, 17), (0.9, 2), (0.9, 17))
"""Forgetting factor lambda and number of regressors."""
W0 = 1e-2
SEPARATION, NOISE = 0.01, 0.004


def stream(p: int, samples: int) -> tuple[Array, Array, Array]:
    """Return regressors (n, p), outputs (n, 1) and the true parameters (1, p)."""
    rng = np.random.default_rng(0)
    phi = rng.normal(size=(samples, p))
    phi[:, 1] = phi[:, 0] + SEPARATION * rng.normal(size=samples)
    true = np.zeros((1, p))
    true[0, :2] = 1.0, -1.0
    return phi, phi @ true.T + NOISE * rng.normal(size=(samples, 1)), true


def survive(peer: Peer, forgetting: float, p: int, samples: int) -> tuple[int | None, float]:
    """Run one estimator over the stream.

    Parameters
    ----------
    peer
        What to run.
    forgetting, p
        The case.
    samples
        Length of the stream.

    Returns
    -------
    tuple
        The first sample (from 0) after which an estimate is not finite (None: never), and the peak error until then.
    """
    phi, y, true = stream(p, samples)
    estimator = peer.make(p, 1, forgetting, W0)
    peak = 0.0
    with np.errstate(all="ignore"):
        for k in range(samples):
            try:
                estimator.update(phi[k], y[k])
            except (ArithmeticError, ValueError, np.linalg.LinAlgError):
                return k, peak
            error = float(np.abs(estimator.theta - true).max())
            if not math.isfinite(error):
                return k, peak
            peak = max(peak, error)
    return None, peak


def measure(samples: int, say: Callable[[str], None]) -> list[dict[str, Any]]:
    """Run all estimators over all cases.

    Parameters
    ----------
    samples
        Length of the stream.
    say
        Takes one line of progress.

    Returns
    -------
    list of dict
        Per estimator and case: name, forgetting, p, first_not_finite, peak_error, note.
    """
    rows = []
    for name, peer in PEERS.items():
        for forgetting, p in CASES:
            say(f"{name}, lambda {forgetting}, {p} regressors")
            row: dict[str, Any] = {"name": name, "forgetting": forgetting, "p": p, "note": ""}
            try:
                row["first_not_finite"], row["peak_error"] = survive(peer, forgetting, p, samples)
            except ImportError as error:
                row.update(first_not_finite=None, peak_error=None, note=f"cannot be imported: {error}")
            rows.append(row)
    return rows
