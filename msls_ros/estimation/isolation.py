"""Isolation: which effector's (or state's) column changed at an alarm, and to what fraction of its old effect.

After an alarm the row starts again from nothing, so its new estimate and the one before the alarm are two measurements
with known covariances. Under the hypothesis that only the columns of a set F changed, by c, their difference ``D`` is
``N(E_F c, S)`` with ``S = s^2 (P_before + P_since)``; with ``W = S^-1``::

    c = (W_FF)^-1 (W D)_F        covariance (W_FF)^-1        explained: (W D)_F' c  of  D' W D

The set grows one column at a time from the constant alone, which always changes with the trim, until it explains most
of the difference: a lost stabilator changes two columns of the rolling moment. That the other columns stayed as they
were makes this far sharper than the difference of two numbers. An effector is named when its change is significant, its
old effect was known, and what is left of it is plausible and known well enough.

References
----------
Basseville and Nikiforov, *Detection of Abrupt Changes*, 1993, section 7.2.5 (generalised likelihood ratio, isolation).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array

LARGEST_SET = 3
"""Columns, beside the constant, that one change may touch in one row."""
ALL_OF_IT = 0.97
"""Share of the difference at which nothing more is looked for [1]."""
PLAUSIBLE = (-0.3, 1.3)
"""Range of what damage may leave of an effect [1]."""


class Difference(NamedTuple):
    """The estimates of one row before an alarm and since, (p,) each, and their covariances, (p, p)."""

    before: Array
    before_covariance: Array
    since: Array
    since_covariance: Array


@dataclass(frozen=True)
class Suspect:
    """A column that changed in one row."""

    column: int
    statistic: float
    """Change over its standard error [1]."""
    effectiveness: float
    """Now over before [1]."""
    effectiveness_std: float


@compiled
def invert(matrix: Array, inverse: Array, work: Array) -> bool:
    """Invert a symmetric positive definite matrix by Cholesky; False where it is not positive definite.

    Parameters
    ----------
    matrix
        (p, p); its lower triangle is read.
    inverse
        (p, p) out.
    work
        (2, p, p) scratch.
    """
    p = matrix.shape[0]
    L = work[0]
    V = work[1]
    for i in range(p):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= L[i, k] * L[j, k]
            if j < i:
                L[i, j] = total / L[j, j]
            elif total > 0.0:
                L[i, i] = math.sqrt(total)
            else:
                return False
    for j in range(p):
        for i in range(j, p):
            total = 1.0 if i == j else 0.0
            for k in range(j, i):
                total -= L[i, k] * V[k, j]
            V[i, j] = total / L[i, i]
    for i in range(p):
        for j in range(i + 1):
            total = 0.0
            for k in range(i, p):
                total += V[k, i] * V[k, j]
            inverse[i, j] = total
            inverse[j, i] = total
    return True


@compiled
def upper_factor(matrix: Array, R: Array) -> None:
    """Upper triangular R with ``R'R`` the given symmetric positive definite matrix (Cholesky): (p, p) out."""
    p = matrix.shape[0]
    for i in range(p):
        for j in range(i, p):
            total = matrix[i, j]
            for k in range(i):
                total -= R[k, i] * R[k, j]
            R[i, j] = math.sqrt(total) if i == j else total / R[i, i]


@compiled
def joint_change(W: Array, WD: Array, chosen: Array, change: Array, covariance: Array, work: Array) -> float:
    """Joint change of the chosen columns, the others unchanged; return how much of ``D' W D`` it explains, or -1.

    Parameters
    ----------
    W, WD
        (p, p) inverse covariance of the difference and (p,) its product with the difference.
    chosen
        (f,) columns, as floats.
    change, covariance
        (f,) and (f, f) out.
    work
        (3, f, f) scratch.
    """
    f = chosen.shape[0]
    block = work[2]
    for i in range(f):
        for j in range(f):
            block[i, j] = W[int(chosen[i]), int(chosen[j])]
    if not invert(block, covariance, work):
        return -1.0
    explained = 0.0
    for i in range(f):
        total = 0.0
        for j in range(f):
            total += covariance[i, j] * WD[int(chosen[j])]
        change[i] = total
        explained += total * WD[int(chosen[i])]
    return explained


@compiled
def best_addition(
    W: Array, WD: Array, chosen: Array, trial: Array, change: Array, covariance: Array, work: Array
) -> int:
    """Return the column, not yet chosen and not the constant, that explains most together with the chosen; -1: none.

    Parameters
    ----------
    W, WD
        As `joint_change` takes them.
    chosen
        (f,) columns.
    trial, change, covariance, work
        (f+1,), (f+1,), (f+1, f+1) and (3, f+1, f+1) scratch.
    """
    f = chosen.shape[0]
    for i in range(f):
        trial[i] = chosen[i]
    best = -1
    most = -math.inf
    for j in range(WD.shape[0] - 1):
        fresh = True
        for i in range(f):
            if int(chosen[i]) == j:
                fresh = False
        if not fresh:
            continue
        trial[f] = j
        value = joint_change(W, WD, trial, change, covariance, work)
        if value > most:
            most = value
            best = j
    return best


def suspects(
    covariance: Array,
    before: Array,
    before_std: Array,
    since: Array,
    candidates: Sequence[int],
    *,
    significance: float,
    explained: float,
    largest_error: float,
) -> list[Suspect]:
    """Return the columns of one row that changed for certain, the most significant first; none: an empty list.

    Parameters
    ----------
    covariance
        (p, p) of ``since - before``.
    before, before_std, since
        (p,) estimates of one row before and since the alarm, and the standard errors before it.
    candidates
        Columns that may be named; the last column is the constant.
    significance
        Least change over its standard error [1].
    explained
        Least share of the whole difference that the changed columns explain [1].
    largest_error
        Largest standard error of the effectiveness [1].
    """
    p = len(before)
    scale = np.sqrt(np.maximum(np.diagonal(covariance), 0.0))
    if not (np.isfinite(covariance).all() and (scale > 0.0).all()):
        return []
    W = np.zeros((p, p))
    difference = (since - before) / scale
    if not invert(covariance / scale[:, None] / scale, W, np.zeros((2, p, p))):
        return []
    WD = np.array([_dot(row, difference) for row in W])
    chosen, change, errors, share = _grow(W, WD, _dot(WD, difference), significance)
    if share < explained:
        return []
    found = []
    for j, c, error in zip(chosen[1:], change[1:], errors[1:], strict=True):
        known = abs(before[j]) >= significance * before_std[j] and before[j] != 0.0
        if j not in candidates or not known or abs(c) < significance * error:
            continue
        ratio = 1.0 + c * scale[j] / before[j]
        ratio_std = math.sqrt((error * scale[j]) ** 2 + ((ratio - 1.0) * before_std[j]) ** 2) / abs(before[j])
        if PLAUSIBLE[0] <= ratio <= PLAUSIBLE[1] and ratio_std <= largest_error:
            found.append(Suspect(j, abs(c) / error, float(ratio), float(ratio_std)))
    return sorted(found, key=lambda s: -s.statistic)


def _grow(W: Array, WD: Array, total: float, significance: float) -> tuple[list[int], list[float], list[float], float]:
    """Add the column that explains most, one at a time; return columns, changes, their errors, the share explained."""
    p = len(WD)
    chosen = [p - 1]
    share, change, errors = 0.0, [0.0], [1.0]
    base, _, _ = _explained(W, WD, chosen)
    for _ in range(LARGEST_SET):
        f = len(chosen) + 1
        taken, trial = np.array(chosen, dtype=np.float64), np.zeros(f)
        j = best_addition(W, WD, taken, trial, np.zeros(f), np.zeros((f, f)), np.zeros((3, f, f)))
        if j < 0:
            break
        best, c, e = _explained(W, WD, [*chosen, j])
        if best - base < significance**2:
            break
        chosen, change, errors, share = [*chosen, j], c, e, best / total if total > 0.0 else 0.0
        base = best
        if share >= ALL_OF_IT:
            break
    return chosen, change, errors, share


def _explained(W: Array, WD: Array, chosen: list[int]) -> tuple[float, list[float], list[float]]:
    f = len(chosen)
    change, covariance = np.zeros(f), np.zeros((f, f))
    value = joint_change(W, WD, np.array(chosen, dtype=np.float64), change, covariance, np.zeros((3, f, f)))
    return value, change.tolist(), [math.sqrt(max(v, 0.0)) or math.inf for v in np.diagonal(covariance).tolist()]


def _dot(a: Array, b: Array) -> float:
    total = 0.0
    for x, y in zip(a.tolist(), b.tolist(), strict=True):
        total += x * y
    return total
