"""What physics knows of the equations: gravity in the force equations, and the kinematics of the Euler angles.

Gravity is subtracted from the measured derivatives before identification, so that attitude needs no regressor; its
tangent then fills the columns Phi and Theta of A, and the kinematic equations their rows. Body axes forward-right-down,
SI, radians. Sine and cosine are computed here with plain arithmetic, because those of the C library differ in the last
bit from one processor to another.

References
----------
Stevens and Lewis, *Aircraft Control and Simulation*, 2nd ed., table 2.5-1 (flat-earth equations of motion).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array, Integers

GRAVITY = 9.80665
"""Standard gravity [m/s^2]."""

FLIGHT_STATES = ("u", "v", "w", "P", "Q", "R", "Phi", "Theta", "Psi")
U, V, W, P, Q, R, PHI, THETA, PSI = range(9)

_HALF_PI_HIGH = 1.57079632673412561417e00
_HALF_PI_LOW = 6.07710050650619224932e-11


@compiled
def sine_cosine(angle: float) -> tuple[float, float]:
    """Sine and cosine of an angle [rad], within 2 units in the last place for |angle| < 1e5, from plain arithmetic.

    Argument reduction by pi/2 in two parts, then the Taylor series to the last bit on [-pi/4, pi/4].
    """
    turns = np.floor(angle * 0.6366197723675814 + 0.5)
    r = (angle - turns * _HALF_PI_HIGH) - turns * _HALF_PI_LOW
    square = r * r
    sine = 0.0
    cosine = 0.0
    for n in range(10, 0, -1):
        sine = (sine + 1.0) * (-square / ((2.0 * n) * (2.0 * n + 1.0)))
        cosine = (cosine + 1.0) * (-square / ((2.0 * n - 1.0) * (2.0 * n)))
    sine = r + r * sine
    cosine = 1.0 + cosine
    quadrant = turns - 4.0 * np.floor(turns * 0.25)
    if quadrant == 1.0:
        return cosine, -sine
    if quadrant == 2.0:
        return -sine, -cosine
    if quadrant == 3.0:
        return -cosine, sine
    return sine, cosine


@compiled
def build_regression(
    x: Array, xdot: Array, delta: Array, rows: Integers, forces: Integers, attitude: Integers, phi: Array, y: Array
) -> None:
    """Fill regressors ``[x, delta, 1]`` and outputs ``xdot - gravity`` (eq 24 with a constant) for n samples.

    Parameters
    ----------
    x, xdot, delta
        (n, states), (n, states), (n, effectors).
    rows
        (r,) indices of the states that are identified.
    forces
        (3,) rows of u, v, w among ``rows``; -1 where absent or where gravity is not subtracted.
    attitude
        (2,) indices of Phi and Theta among the states; read only where a force is given.
    phi, y
        (n, r + effectors + 1) and (n, r), out.
    """
    r = rows.shape[0]
    m = delta.shape[1]
    for n in range(x.shape[0]):
        for i in range(r):
            phi[n, i] = x[n, rows[i]]
            y[n, i] = xdot[n, rows[i]]
        for j in range(m):
            phi[n, r + j] = delta[n, j]
        phi[n, r + m] = 1.0
        if forces[0] < 0 and forces[1] < 0 and forces[2] < 0:
            continue
        sin_phi, cos_phi = sine_cosine(x[n, attitude[0]])
        sin_theta, cos_theta = sine_cosine(x[n, attitude[1]])
        if forces[0] >= 0:
            y[n, forces[0]] += GRAVITY * sin_theta
        if forces[1] >= 0:
            y[n, forces[1]] -= GRAVITY * sin_phi * cos_theta
        if forces[2] >= 0:
            y[n, forces[2]] -= GRAVITY * cos_phi * cos_theta


def find_states(states: tuple[str, ...]) -> Integers:
    """Return where each of u, v, w, P, Q, R, Phi, Theta, Psi stands among the states: (9,), -1 where absent."""
    return np.array([states.index(name) if name in states else -1 for name in FLIGHT_STATES], np.int64)


def find_known(states: tuple[str, ...]) -> NDArray[np.bool_]:
    """Return which entries of A are known: (n, n), the rows and columns of the Euler angles."""
    angles = np.array([name in FLIGHT_STATES[PHI:] for name in states], np.bool_)
    return angles[:, None] | angles


@compiled
def add_partial(x: Array, at: Integers, a: Array, bias: Array, row: int, column: int, partial: float) -> None:
    """Enter a partial derivative in A and take its part at x off the bias, if both states are present."""
    if at[row] >= 0 and at[column] >= 0:
        a[at[row], at[column]] = partial
        bias[at[row]] -= partial * x[at[column]]


@compiled
def add_known(x: Array, at: Integers, a: Array, bias: Array) -> None:
    """Enter the tangent at x of what is known: ``bias + A x`` touches gravity and the Euler angle rates.

    Parameters
    ----------
    x
        (n,) the states [m/s, rad/s, rad].
    at
        (9,) see `find_states`; what is absent counts as zero.
    a, bias
        (n, n) and (n,), zero; the known terms are entered.
    """
    sp, cp = sine_cosine(x[at[PHI]] if at[PHI] >= 0 else 0.0)
    st, ct = sine_cosine(x[at[THETA]] if at[THETA] >= 0 else 0.0)
    p = x[at[P]] if at[P] >= 0 else 0.0
    q = x[at[Q]] if at[Q] >= 0 else 0.0
    r = x[at[R]] if at[R] >= 0 else 0.0
    turn = q * sp + r * cp
    slip = q * cp - r * sp
    levels = (-GRAVITY * st, GRAVITY * sp * ct, GRAVITY * cp * ct, 0.0, 0.0, 0.0, p + st / ct * turn, slip, turn / ct)
    for i in range(9):
        if at[i] >= 0:
            bias[at[i]] = levels[i]
    add_partial(x, at, a, bias, U, THETA, -GRAVITY * ct)
    add_partial(x, at, a, bias, V, PHI, GRAVITY * cp * ct)
    add_partial(x, at, a, bias, V, THETA, -GRAVITY * sp * st)
    add_partial(x, at, a, bias, W, PHI, -GRAVITY * sp * ct)
    add_partial(x, at, a, bias, W, THETA, -GRAVITY * cp * st)
    add_partial(x, at, a, bias, PHI, P, 1.0)
    add_partial(x, at, a, bias, PHI, Q, sp * st / ct)
    add_partial(x, at, a, bias, PHI, R, cp * st / ct)
    add_partial(x, at, a, bias, PHI, PHI, st / ct * slip)
    add_partial(x, at, a, bias, PHI, THETA, turn / (ct * ct))
    add_partial(x, at, a, bias, THETA, Q, cp)
    add_partial(x, at, a, bias, THETA, R, -sp)
    add_partial(x, at, a, bias, THETA, PHI, -turn)
    add_partial(x, at, a, bias, PSI, Q, sp / ct)
    add_partial(x, at, a, bias, PSI, R, cp / ct)
    add_partial(x, at, a, bias, PSI, PHI, slip / ct)
    add_partial(x, at, a, bias, PSI, THETA, turn * st / (ct * ct))
