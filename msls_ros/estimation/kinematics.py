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


def known_terms(states: tuple[str, ...], x: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Tangent of what is known, at x: what to add to A and to the bias, and which entries of A are known.

    Parameters
    ----------
    states
        n names; those of u, v, w, P, Q, R, Phi, Theta, Psi that are among them are used.
    x
        (n,) the states [m/s, rad/s, rad].

    Returns
    -------
    tuple of arrays
        (n, n) added to A, (n,) added to the bias, (n, n) True where A is known.
    """
    n = len(states)
    a = np.zeros((n, n))
    f = np.zeros(n)
    at = {name: i for i, name in enumerate(states)}
    value = {name: float(x[i]) for name, i in at.items()}
    sp, cp = sine_cosine(value.get("Phi", 0.0))
    st, ct = sine_cosine(value.get("Theta", 0.0))
    q, r = value.get("Q", 0.0), value.get("R", 0.0)
    turn = q * sp + r * cp
    slip = q * cp - r * sp
    terms = {
        "u": (-GRAVITY * st, {"Phi": 0.0, "Theta": -GRAVITY * ct}),
        "v": (GRAVITY * sp * ct, {"Phi": GRAVITY * cp * ct, "Theta": -GRAVITY * sp * st}),
        "w": (GRAVITY * cp * ct, {"Phi": -GRAVITY * sp * ct, "Theta": -GRAVITY * cp * st}),
        "Phi": (
            value.get("P", 0.0) + st / ct * turn,
            {"P": 1.0, "Q": sp * st / ct, "R": cp * st / ct, "Phi": st / ct * slip, "Theta": turn / (ct * ct)},
        ),
        "Theta": (slip, {"Q": cp, "R": -sp, "Phi": -turn}),
        "Psi": (turn / ct, {"Q": sp / ct, "R": cp / ct, "Phi": slip / ct, "Theta": turn * st / (ct * ct)}),
    }
    known = np.zeros((n, n), np.bool_)
    for name, (level, partials) in terms.items():
        if name not in at:
            continue
        row = at[name]
        f[row] = level
        for other, partial in partials.items():
            if other in at:
                a[row, at[other]] = partial
                f[row] -= partial * value[other]
    for name in ("Phi", "Theta", "Psi"):
        if name in at:
            known[at[name], :] = True
            known[:, at[name]] = True
    return a, f, known
