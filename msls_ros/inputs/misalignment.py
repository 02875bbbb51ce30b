"""By how much the axes of the rates are turned against those of the attitude: an IMU that is mounted askew.

Over windows of a fifth of a second the attitude shows mean rates a (rad/s, FRD), the gyroscopes measure b. A gyroscope
that is turned by small angles theta, has errors of scale, a bias and a delay measures::

    a_i = c_i + sum_j M_ij b_j + tau_i db_i/dt,        M = 1 + diag(scale) + [theta x]

M, c and tau are found by least squares, one equation per axis, with what white noise of the gyroscopes adds to their
squares taken off; noise of the attitude is in a alone and biases nothing. Standard errors are those of residuals that
are correlated over a second (Newey and West), for windows overlap and attitude filters are slow. An error of scale, a
delay or a bias is thus no rotation. Each angle stands in two equations, ``theta_y = M_xz = -M_zx``: a rotation shows in
both, one of an attitude that follows badly (a heading that a magnetometer pulls in banks) in one. A rotation of the
mounting is the same throughout: where pieces of the flight differ by more than their errors (an attitude that follows
the accelerometer in turns), the error is that by which they differ (Birge's ratio).

References
----------
Newey and West, "A simple, positive semi-definite, heteroskedasticity and autocorrelation consistent covariance matrix",
Econometrica 55 (1987). Birge, "The calculation of errors by the method of least squares", Physical Review 40 (1932).
Klein and Morelli, *Aircraft System Identification*, 2006, section 10.3 (data compatibility).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from msls_ros.estimation.kernel import Array
from msls_ros.inputs.error_regression import regress
from msls_ros.inputs.findings import DOUBTFUL, WRONG, Finding
from msls_ros.inputs.motion import Motion, Reading

_LEAST, _WRONG = 3.0, 8.0
"""Angle worth naming, and from which numbers are wrong: boards are mounted to one or two degrees [deg]."""
_SURE, _BOTH = 5.0, 2.5
"""Standard errors of the angle, and of each of the two coefficients that show it."""
_ALIKE = 0.4
"""Share of the larger of the two that the smaller must be."""
_MEMORY = 1.0
"""Over which residuals are correlated [s]."""
_PIECE, _PIECES = 8.0, 6
"""Least length of a piece [s], and pieces at most."""
_TURNING = 0.003
"""Rates below this rms show nothing [rad/s]."""
_AXES = "xyz"


@dataclass(frozen=True)
class Misalignment:
    """Rotation vector that turns the axes of the rates into those of the attitude, FRD, for angles that are small."""

    angle: Array
    """(3,) about x, y, z [rad]."""
    std: Array
    """(3,) [rad]; infinite where the flight does not show it."""
    shown: tuple[bool, bool, bool]
    """Whether both coefficients show it."""


def misalignment(motion: Motion, reading: Reading) -> Misalignment | None:
    """Return the rotation between rates and attitude.

    Parameters
    ----------
    motion
        Of a log.
    reading
        How its numbers are read.

    Returns
    -------
    Misalignment or None
        None without attitude or rates, or in less than sixteen seconds.
    """
    found = motion.turns(reading)
    if found is None:
        return None
    seen, measured, noise, width = found
    if (len(seen) - 2 * width) * motion.step < 2.0 * _PIECE:
        return None
    matrix, variance = _coefficients(seen, measured, noise, width, motion.step)
    angle, std, shown = np.zeros(3), np.full(3, np.inf), [False] * 3
    for k in range(3):
        pair, spread = _pair(matrix, variance, k)
        angle[k], std[k] = _mean(pair, spread)
        clear = bool((np.abs(pair) > _BOTH * np.sqrt(spread)).all()) and pair[0] * pair[1] > 0.0
        shown[k] = clear and min(np.abs(pair)) > _ALIKE * max(np.abs(pair))
    if any(shown):
        count = min(_PIECES, int((len(seen) - 2 * width) * motion.step / _PIECE))
        cuts = [slice(k * len(seen) // count, (k + 1) * len(seen) // count) for k in range(count)]
        pieces = [_coefficients(seen[one], measured[one], noise, width, motion.step) for one in cuts]
        for k in range(3):
            parts = np.array([_mean(*_pair(*piece, k)) for piece in pieces])
            std[k] *= np.sqrt(max(1.0, float(np.square((parts[:, 0] - angle[k]) / parts[:, 1]).sum()) / (count - 1)))
    return Misalignment(angle, std, (shown[0], shown[1], shown[2]))


def _pair(matrix: Array, variance: Array, k: int) -> tuple[Array, Array]:
    """Return the two coefficients that show the angle about an axis, and their variances."""
    i, j = (k + 1) % 3, (k + 2) % 3
    return np.array([-matrix[i, j], matrix[j, i]]), np.array([variance[i, j], variance[j, i]])


def _mean(pair: Array, spread: Array) -> tuple[float, float]:
    """Return the mean of two numbers, weighted by their variances, and its standard deviation."""
    weights = 1.0 / spread
    total = float(weights.sum())
    return (float(weights @ pair) / total, total**-0.5) if total > 0.0 else (0.0, np.inf)


def _coefficients(seen: Array, measured: Array, noise: Array, width: int, step: float) -> tuple[Array, Array]:
    """Return M (3, 3) and the variances of its elements; infinite those of axes that hardly turn."""
    inner = slice(width, len(seen) - width)
    slope = (measured[2 * width :] - measured[: -2 * width]) / (2 * width * step)
    rates, lags = measured[inner], round(_MEMORY / step)
    matrix, variance = np.eye(3), np.full((3, 3), np.inf)
    moves = rates.var(axis=0) - noise > _TURNING**2
    if not moves.any():
        return matrix, variance
    for i in range(3):
        x = np.column_stack([rates[:, moves], slope[:, i]])
        known = np.append(noise[moves], 2.0 * noise[i] / (2 * width * step) ** 2)
        weights, spread = regress(x, seen[inner, i], known, lags)
        matrix[i, moves], variance[i, moves] = weights[:-1], spread[:-1]
    return matrix, variance


def check_misalignment(motion: Motion, reading: Reading, entry: str) -> Iterator[Finding]:
    """Yield that the rates are turned against the attitude.

    Parameters
    ----------
    motion, reading
        As `misalignment`.
    entry
        Of the map, of the rates.
    """
    found = misalignment(motion, reading)
    if found is None:
        return
    size, std = np.degrees(found.angle), np.degrees(found.std)
    clear = [abs(size[k]) > max(_LEAST, _SURE * std[k]) and found.shown[k] for k in range(3)]
    if not any(clear):
        return
    named = [k for k in range(3) if clear[k]]
    turned = ", ".join(f"{size[k]:+.1f} +- {std[k]:.1f} deg about {_AXES[k]}" for k in named)
    what = f"the rates look turned against the attitude: turned by {turned} (forward, right, down) they agree with it"
    mend = "the IMU is mounted askew, or the attitude is of other axes: turn rates and accelerations into the axes of "
    mend += "the attitude before they are recorded, or map rates and attitude of one estimator"
    level = WRONG if max(abs(size[k]) for k in named) > _WRONG else DOUBTFUL
    yield Finding(level, "misalignment", entry, what, mend)
