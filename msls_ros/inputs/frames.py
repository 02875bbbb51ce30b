"""From the frames of other stacks to ours, and what kinematics gives of the derivatives.

Ours: body axes forward-right-down (FRD), earth axes north-east-down (NED), Euler angles yaw-pitch-roll. ROS (REP 103)
uses forward-left-up (FLU) and east-north-up (ENU). SI units, radians. Plain arithmetic and square roots only: the
inverse tangent, sine and cosine are ours, so that the bits do not depend on the C library.

References
----------
Stevens and Lewis, *Aircraft Control and Simulation*, 2nd ed., table 2.5-1 (flat-earth equations of motion).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from types import MappingProxyType

from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kinematics import GRAVITY, sine_cosine

BODY = MappingProxyType({"frd": (1.0, 1.0, 1.0), "flu": (1.0, -1.0, -1.0)})
"""Body frames: signs that turn their components into FRD."""
EARTH = MappingProxyType(
    {
        "ned": ((0, 1.0), (1, 1.0), (2, 1.0)),
        "enu": ((1, 1.0), (0, 1.0), (2, -1.0)),
        "nwu": ((0, 1.0), (1, -1.0), (2, -1.0)),
    }
)
"""Earth frames: for north, east, down the component to take, and its sign."""
TURN = 2.0 * math.pi

Vector = tuple[float, float, float]


@compiled
def arctangent(y: float, x: float) -> float:
    """Angle of the point (x, y) from the x axis [rad], in [-pi, pi], within 2 units in the last place of pi.

    Reduced to [0, tan(pi/8)], then the Taylor series to the last bit; 0 for (0, 0).
    """
    a, b = abs(x), abs(y)
    if a == 0.0 and b == 0.0:
        return 0.0
    t = b / a if b <= a else a / b
    base = 0.0
    if t > 0.41421356237309503:
        t = (t - 1.0) / (t + 1.0)
        base = 0.7853981633974483
    square = t * t
    total = 0.0
    for n in range(21, -1, -1):
        total = 1.0 / (2.0 * n + 1.0) - square * total
    angle = base + t * total
    if b > a:
        angle = 1.5707963267948966 - angle
    if x < 0.0:
        angle = 3.141592653589793 - angle
    return angle if y >= 0.0 else -angle


def euler_angles(quaternion: Sequence[float], body: str, earth: str) -> Vector:
    """Turn an attitude quaternion into Euler angles.

    Parameters
    ----------
    quaternion
        w, x, y, z of the rotation that takes body components to earth components; its length does not matter.
    body, earth
        The frames it is of, names of `BODY` and `EARTH`.

    Returns
    -------
    tuple of float
        Phi, Theta, Psi of FRD with respect to NED [rad]; Phi and Psi in [-pi, pi].
    """
    w, x, y, z = quaternion
    s = 2.0 / (w * w + x * x + y * y + z * z)
    rows = (
        (1.0 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)),
        (s * (x * y + w * z), 1.0 - s * (x * x + z * z), s * (y * z - w * x)),
        (s * (x * z - w * y), s * (y * z + w * x), 1.0 - s * (x * x + y * y)),
    )
    (i_n, s_n), (i_e, s_e), (i_d, s_d) = EARTH[earth]
    b_x, b_y, b_z = BODY[body]
    north, east = s_n * rows[i_n][0] * b_x, s_e * rows[i_e][0] * b_x
    down = s_d * rows[i_d][0] * b_x
    level = math.sqrt(north * north + east * east)
    phi = arctangent(s_d * rows[i_d][1] * b_y, s_d * rows[i_d][2] * b_z)
    return phi, arctangent(-down, level), arctangent(east, north)


def continued(angle: float, before: float) -> float:
    """Return the angle [rad] plus the whole turns that bring it nearest to the one before."""
    return angle + TURN * math.floor((before - angle) / TURN + 0.5)


def to_ned(vector: Sequence[float], earth: str) -> Vector:
    """Return north, east, down components of a vector given in an earth frame of `EARTH`."""
    (i_n, s_n), (i_e, s_e), (i_d, s_d) = EARTH[earth]
    return s_n * vector[i_n], s_e * vector[i_e], s_d * vector[i_d]


def to_body(ned: Vector, euler: Vector) -> Vector:
    """Return forward, right, down components of a vector given in NED, at the Euler angles Phi, Theta, Psi [rad]."""
    (sp, cp), (st, ct), (ss, cs) = (sine_cosine(angle) for angle in euler)
    north, east, down = ned
    ahead, across = cs * north + ss * east, cs * east - ss * north
    below = st * ahead + ct * down
    return ct * ahead - st * down, sp * below + cp * across, cp * below - sp * across


def cross(a: Sequence[float], b: Sequence[float]) -> Vector:
    """Return the vector product a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def velocity_derivative(force: Vector, velocity: Vector, rates: Vector, attitude: tuple[float, float]) -> Vector:
    """Derivatives of u, v, w from the accelerometer: specific force plus gravity minus omega x velocity.

    Parameters
    ----------
    force
        Specific force at the centre of mass, what an accelerometer there shows (at rest 0, 0, -g) [m/s^2], FRD.
    velocity, rates
        u, v, w [m/s] and P, Q, R [rad/s].
    attitude
        Phi, Theta [rad].

    Returns
    -------
    tuple of float
        [m/s^2].
    """
    (sp, cp), (st, ct) = (sine_cosine(angle) for angle in attitude)
    x, y, z = cross(rates, velocity)
    return force[0] - GRAVITY * st - x, force[1] + GRAVITY * sp * ct - y, force[2] + GRAVITY * cp * ct - z


def euler_rates(rates: Vector, attitude: tuple[float, float]) -> Vector:
    """Derivatives of Phi, Theta, Psi [rad/s] from P, Q, R [rad/s] at Phi, Theta [rad]; no number at Theta = 90 deg."""
    (sp, cp), (st, ct) = (sine_cosine(angle) for angle in attitude)
    turn = rates[1] * sp + rates[2] * cp
    if ct == 0.0:
        return math.nan, rates[1] * cp - rates[2] * sp, math.nan
    return rates[0] + st / ct * turn, rates[1] * cp - rates[2] * sp, turn / ct


def centripetal(rates: Vector, arm: Vector) -> Vector:
    """Acceleration omega x (omega x arm) of a point at the arm [m] from the centre of mass [m/s^2]."""
    return cross(rates, cross(rates, arm))


def air_velocity(airspeed: float, alpha: float, beta: float) -> Vector:
    """Return u, v, w [m/s] of the air that meets a vane: true airspeed [m/s], angles of attack and sideslip [rad]."""
    (sa, ca), (sb, cb) = sine_cosine(alpha), sine_cosine(beta)
    return airspeed * (ca * cb), airspeed * sb, airspeed * (sa * cb)
