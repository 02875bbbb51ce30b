"""What physics knows of the equations: gravity, rotation, gyroscopic pitching, and the kinematics of the Euler angles.

Gravity is subtracted from the measured derivatives before identification, so that attitude needs no regressor; its
tangent then fills the columns Phi and Theta of A, and the kinematic equations their rows. For the bank so is what the
turning of the body's axes makes of the velocity, ``-omega x v``, a product of states: what is left is force over mass,
its estimates are the aerodynamics alone, and the tangent of now comes on top of them. And so is most of the gyroscopic
moment in pitch, ``(Izz - Ixx)/Iyy P R``: in a turn it goes with bank and yaw rate, as does the elevator that holds the
nose up, of whose effect it took a part (`GYROSCOPIC_PITCH`). Body axes forward-right-down, SI, radians. Sine and cosine
are computed here with plain arithmetic, because those of the C library differ in the last bit from one processor to
another.

References
----------
Stevens and Lewis, *Aircraft Control and Simulation*, 2nd ed., table 2.5-1 (flat-earth equations of motion). Goldstein,
*Classical Mechanics*, 3rd ed., section 5.5 (Euler's equations).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array, Integers

GRAVITY = 9.80665
"""Standard gravity [m/s^2]."""

GYROSCOPIC_PITCH = 0.8
"""``(Izz - Ixx)/Iyy`` [1]: 1 of what is flat, for there ``Izz = Ixx + Iyy``; aircraft have .5 to 1.

Twelve aircraft in 24 flights with turns: dQ/dt by the elevator errs by .17 of its size in the quiet after them when
nothing is taken off, by .10 with .8; .65 does as well. That of rolling, ``(Iyy - Izz)/Ixx``, is anything from -1 to 1
with what little is missing of flatness, and taking off .7 or nothing of it does not matter.
"""

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
def state_of(x: Array, at: Integers, which: int) -> float:
    """Return a state of flight; 0 where it is not among the states."""
    return float(x[at[which]]) if at[which] >= 0 else 0.0


@compiled
def remove_rotation(x: Array, at: Integers, forces: Integers, y: Array) -> None:
    """Take off the outputs y ``-omega x v``, and the gyroscopic pitching."""
    u, v, w = state_of(x, at, U), state_of(x, at, V), state_of(x, at, W)
    p, q, r = state_of(x, at, P), state_of(x, at, Q), state_of(x, at, R)
    if forces[0] >= 0:
        y[forces[0]] -= r * v - q * w
    if forces[1] >= 0:
        y[forces[1]] -= p * w - r * u
    if forces[2] >= 0:
        y[forces[2]] -= q * u - p * v
    if forces[3] >= 0:
        y[forces[3]] -= GYROSCOPIC_PITCH * p * r


@compiled
def build_regression(
    x: Array,
    xdot: Array,
    delta: Array,
    rows: Integers,
    forces: Integers,
    states: Integers,
    turning: bool,
    phi: Array,
    y: Array,
) -> None:
    """Fill regressors ``[x, delta, 1]`` and outputs ``xdot - known`` (eq 24 with a constant) for n samples.

    Parameters
    ----------
    x, xdot, delta
        (n, states), (n, states), (n, effectors).
    rows
        (r,) indices of the states that are identified.
    forces
        (4,) rows of u, v, w, Q among ``rows``, see `find_forces`; -1 where absent.
    states
        (9,) see `find_states`; read only where a force is given.
    turning
        Whether `remove_rotation` is called.
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
        if turning:
            remove_rotation(x[n], states, forces, y[n])
        if forces[0] < 0 and forces[1] < 0 and forces[2] < 0:
            continue
        sin_phi, cos_phi = sine_cosine(x[n, states[PHI]])
        sin_theta, cos_theta = sine_cosine(x[n, states[THETA]])
        if forces[0] >= 0:
            y[n, forces[0]] += GRAVITY * sin_theta
        if forces[1] >= 0:
            y[n, forces[1]] -= GRAVITY * sin_phi * cos_theta
        if forces[2] >= 0:
            y[n, forces[2]] -= GRAVITY * cos_phi * cos_theta


def find_states(states: tuple[str, ...]) -> Integers:
    """Return where each of u, v, w, P, Q, R, Phi, Theta, Psi stands among the states: (9,), -1 where absent."""
    return np.array([states.index(name) if name in states else -1 for name in FLIGHT_STATES], np.int64)


def find_forces(rows: tuple[str, ...], known_gravity: bool) -> Integers:
    """Return where u, v, w, Q stand among the rows: (4,), -1 where absent or where nothing is known of them.

    Of Q something is known where P and R are among them.
    """
    known = [name for name in rows if known_gravity and (name != "Q" or {"P", "R"} <= set(rows))]
    return np.array([rows.index(name) if name in known else -1 for name in "uvwQ"], np.int64)


def find_rotation(states: tuple[str, ...]) -> dict[tuple[int, int], tuple[int, float]]:
    """Return the tangent of what `remove_rotation` takes off: by equation and state which state it is, times what."""
    found = {}
    for equation, one, other, factor in (
        *(("u", "v", "R", 1.0), ("u", "w", "Q", -1.0), ("v", "w", "P", 1.0)),
        *(("v", "u", "R", -1.0), ("w", "u", "Q", 1.0), ("w", "v", "P", -1.0)),
        ("Q", "P", "R", GYROSCOPIC_PITCH),
    ):
        if {equation, one, other} <= set(states):
            row, first, second = (states.index(s) for s in (equation, one, other))
            found[row, first] = second, factor
            found[row, second] = first, factor
    return found


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
def add_rotation(x: Array, at: Integers, a: Array, bias: Array) -> None:
    """Enter the tangent at x of what `remove_rotation` takes off, as `add_known`; the bias holds what it leaves."""
    u, v, w = state_of(x, at, U), state_of(x, at, V), state_of(x, at, W)
    p, q, r = state_of(x, at, P), state_of(x, at, Q), state_of(x, at, R)
    for i, level in ((U, r * v - q * w), (V, p * w - r * u), (W, q * u - p * v)):
        if at[i] >= 0:
            bias[at[i]] += level
    if at[P] >= 0 and at[Q] >= 0 and at[R] >= 0:
        bias[at[Q]] += GYROSCOPIC_PITCH * p * r
    add_partial(x, at, a, bias, Q, P, GYROSCOPIC_PITCH * r)
    add_partial(x, at, a, bias, Q, R, GYROSCOPIC_PITCH * p)
    add_partial(x, at, a, bias, U, V, r)
    add_partial(x, at, a, bias, U, W, -q)
    add_partial(x, at, a, bias, U, Q, -w)
    add_partial(x, at, a, bias, U, R, v)
    add_partial(x, at, a, bias, V, U, -r)
    add_partial(x, at, a, bias, V, W, p)
    add_partial(x, at, a, bias, V, P, w)
    add_partial(x, at, a, bias, V, R, -u)
    add_partial(x, at, a, bias, W, U, q)
    add_partial(x, at, a, bias, W, V, -p)
    add_partial(x, at, a, bias, W, P, -v)
    add_partial(x, at, a, bias, W, Q, u)


@compiled
def add_known(x: Array, at: Integers, turning: bool, a: Array, bias: Array) -> None:
    """Enter the tangent at x of what is known: ``bias + A x`` touches gravity and the Euler angle rates.

    Parameters
    ----------
    x
        (n,) the states [m/s, rad/s, rad].
    at
        (9,) see `find_states`; what is absent counts as zero.
    turning
        Whether ``-omega x v`` is among what is known.
    a, bias
        (n, n) and (n,), zero; the known terms are entered.
    """
    sp, cp = sine_cosine(x[at[PHI]] if at[PHI] >= 0 else 0.0)
    st, ct = sine_cosine(x[at[THETA]] if at[THETA] >= 0 else 0.0)
    p, q, r = state_of(x, at, P), state_of(x, at, Q), state_of(x, at, R)
    turn = q * sp + r * cp
    slip = q * cp - r * sp
    levels = (-GRAVITY * st, GRAVITY * sp * ct, GRAVITY * cp * ct, 0.0, 0.0, 0.0, p + st / ct * turn, slip, turn / ct)
    for i in range(9):
        if at[i] >= 0:
            bias[at[i]] = levels[i]
    if turning:
        add_rotation(x, at, a, bias)
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
