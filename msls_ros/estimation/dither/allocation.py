"""How much dither each effector gets: the largest rms of each surface that keeps the acceleration limit (eqs 20-23).

At a station ``l1`` ahead and ``l2`` above the centre of mass, ``l3`` to the right of it, one radian of effector j is
felt as ``g_j`` (the acceleration of a point of a rigid body, eq 20, with the axial terms that the paper leaves out)::

    g_j^2 = (b_uj - l2 b_Qj - l3 b_Rj)^2 + (b_vj + l1 b_Rj + l2 b_Pj)^2 + (b_wj - l1 b_Qj + l3 b_Pj)^2

Independent sequences of rms ``s_j`` add their squares, ``a_p^2 = sum_j g_j^2 s_j^2`` (``rms``); eq 23 adds magnitudes
instead, with equal signs everywhere and one common rms (``worst_case``), which independent sequences never reach: what
is felt is a third of it.

``information`` gives each effector an equal share of the square, ``s_j = limit w_j / (sqrt(sum w^2) g_j)``: it makes
the product of the ``s_j`` largest under the limit, and so the determinant of the information about B (D-optimality;
by the inequality of the means). ``equal`` gives each the same rms times its weight. What effectors leave that are
capped goes to the others (water filling).

``E[g_j^2]`` is the true square plus the variance of the estimate: an effector that is not known starts small, and grows
as it becomes known. That is what the square at the estimate is expected to be as it is: to add the variance would count
it twice. What is used is the larger of the two.
"""

from __future__ import annotations

import math

from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array, Integers


@compiled
def entry(b: Array, rows: Integers, axis: int, j: int) -> float:
    """Entry of B (r, m) in one of the rows u, v, w, P, Q, R (0 to 5) and column j; 0 where the row is absent."""
    return b[rows[axis], j] if rows[axis] >= 0 else 0.0


@compiled
def felt(b: Array, rows: Integers, station: Array, j: int, out: Array) -> None:
    """Fill in the acceleration at the station by one radian of effector j: (3,) [m/s^2/rad] (eq 20).

    Parameters
    ----------
    b
        (r, m) B-hat.
    rows
        (6,) index of the rows u, v, w, P, Q, R in ``b``; negative where absent.
    station
        (3,) l1 ahead, l2 above, l3 to the right of the centre of mass [m].
    j
        Effector.
    out
        (3,) axial, lateral, normal.
    """
    roll, pitch, yaw = entry(b, rows, 3, j), entry(b, rows, 4, j), entry(b, rows, 5, j)
    out[0] = entry(b, rows, 0, j) - station[1] * pitch - station[2] * yaw
    out[1] = entry(b, rows, 1, j) + station[0] * yaw + station[1] * roll
    out[2] = entry(b, rows, 2, j) - station[0] * pitch + station[2] * roll


@compiled
def felt_square(b: Array, rows: Integers, station: Array, j: int, out: Array) -> float:
    """Return ``g_j^2`` at the estimate [m^2/s^4/rad^2]; ``out`` as in `felt`."""
    felt(b, rows, station, j, out)
    return float(out[0] * out[0] + out[1] * out[1] + out[2] * out[2])


@compiled
def uncertain_square(variance: Array, rows: Integers, station: Array, j: int) -> float:
    """Return by how much ``g_j^2`` at the estimate is expected to exceed the true one [m^2/s^4/rad^2].

    That is the variance of ``g_j``, by the variances (r, m) of the entries.
    """
    roll, pitch, yaw = entry(variance, rows, 3, j), entry(variance, rows, 4, j), entry(variance, rows, 5, j)
    ahead, above, right = station[0] * station[0], station[1] * station[1], station[2] * station[2]
    spread = entry(variance, rows, 0, j) + entry(variance, rows, 1, j) + entry(variance, rows, 2, j)
    spread += roll * (above + right) + pitch * (ahead + above) + yaw * (ahead + right)
    return float(spread)


@compiled
def worst_case(b: Array, weights: Array, rows: Integers, station: Array) -> float:
    """Worst-case acceleration at the station per common rms of the surfaces: square root of eq 23 [m/s^2/rad].

    Parameters
    ----------
    b
        (r, m) B-hat.
    weights
        (m,) rms of each surface over the common one.
    rows, station
        As in `felt`; the paper knows no l3.
    """
    axial = lateral = normal = 0.0
    if rows[0] >= 0:
        axial = magnitude(b[rows[0]], weights)
    if rows[1] >= 0:
        lateral = magnitude(b[rows[1]], weights)
    if rows[2] >= 0:
        normal = magnitude(b[rows[2]], weights)
    if rows[3] >= 0:
        lateral += abs(station[1]) * magnitude(b[rows[3]], weights)
        normal += abs(station[2]) * magnitude(b[rows[3]], weights)
    if rows[5] >= 0:
        lateral += abs(station[0]) * magnitude(b[rows[5]], weights)
        axial += abs(station[2]) * magnitude(b[rows[5]], weights)
    if rows[4] >= 0:
        normal += abs(station[0]) * magnitude(b[rows[4]], weights)
    return math.sqrt(axial * axial + lateral * lateral + normal * normal)


@compiled
def magnitude(row: Array, weights: Array) -> float:
    """Sum of weight times absolute value over the effectors: ``S b_i`` of eq 23."""
    total = 0.0
    for j in range(row.shape[0]):
        total += weights[j] * abs(row[j])
    return total


@compiled
def allocate(square: Array, weights: Array, caps: Array, limit: float, information: bool, out: Array) -> bool:
    """Fill in the rms of each surface (m,) [rad] for ``sum_j square_j out_j^2 = limit^2``, or all at their caps.

    Parameters
    ----------
    square
        (m,) ``E[g_j^2]``, finite.
    weights
        (m,) what each effector counts for.
    caps
        (m,) largest rms of each surface [rad].
    limit
        Acceleration [m/s^2 rms].
    information
        Equal shares of the square (true), or equal rms (false), times the weights.
    out
        (m,) rms of each surface [rad].

    Returns
    -------
    bool
        Whether the limit is reached; otherwise all effectors are at their caps.
    """
    m = square.shape[0]
    for j in range(m):
        out[j] = -1.0  # not capped
    for _ in range(m + 1):
        left, total = limit * limit, 0.0
        for j in range(m):
            if out[j] >= 0.0:
                left -= square[j] * out[j] * out[j]
            else:
                total += weights[j] * weights[j] * (1.0 if information else square[j])
        if total <= 0.0:
            break
        common = math.sqrt(max(left, 0.0) / total)
        changed = False
        for j in range(m):
            if out[j] < 0.0 and share(square[j], weights[j], common, information) > caps[j]:
                out[j] = caps[j]
                changed = True
        if not changed:
            for j in range(m):
                if out[j] < 0.0:
                    out[j] = share(square[j], weights[j], common, information)
            return True
    for j in range(m):
        if out[j] < 0.0:
            out[j] = caps[j] if weights[j] > 0.0 else 0.0
    return False


@compiled
def share(square: float, weight: float, common: float, information: bool) -> float:
    """Rms of an effector that is not capped [rad]; infinite for one that nobody feels, none where none is allowed."""
    if weight <= 0.0 or common <= 0.0:
        return 0.0
    if not information:
        return weight * common
    return weight * common / math.sqrt(square) if square > 0.0 else math.inf
