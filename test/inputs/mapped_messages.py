"""Flights as the messages of other stacks: standard ROS types, MAVROS, PX4."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msls_ros.bags import BagWriter

Array = NDArray[np.float64]
GRAVITY = 9.80665
START = 1_000_000_000
"""Stamp of the first sample [ns]."""
RATE = 100
NED_OF_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
FRD_OF_FLU = np.diag([1.0, -1.0, -1.0])
ODOMETRY, IMU, JOINTS = "nav_msgs/msg/Odometry", "sensor_msgs/msg/Imu", "sensor_msgs/msg/JointState"
RC_OUT = "mavros_msgs/msg/RCOut"
VEHICLE, SENSORS, SERVOS = (f"px4_msgs/msg/{n}" for n in ("VehicleOdometry", "SensorCombined", "ActuatorServos"))
TRIM = np.array([18.0, 0.0, 0.9, 0.0, 0.0, 0.0, 0.0, 0.05, 0.4])
"""Of `rigid_flight`."""
DEFINITIONS = {
    RC_OUT: "std_msgs/Header header\nuint16[] channels\n",
    VEHICLE: "uint64 timestamp\nuint64 timestamp_sample\nuint8 pose_frame\nfloat32[3] position\nfloat32[4] q\n"
    "uint8 velocity_frame\nfloat32[3] velocity\nfloat32[3] angular_velocity\nuint8 reset_counter\n",
    SENSORS: "uint64 timestamp\nfloat32[3] gyro_rad\nuint32 gyro_integral_dt\nint32 accelerometer_timestamp_relative\n"
    "float32[3] accelerometer_m_s2\nuint32 accelerometer_integral_dt\n",
    SERVOS: "uint64 timestamp\nuint64 timestamp_sample\nfloat32[8] control\n",
}
Sent = tuple[int, str, str, dict[str, Any]]
"""Log time [ns], topic, type, fields."""


@dataclass
class Flight:
    """Samples at `RATE`; n samples."""

    effectors: tuple[str, ...]
    x: Array
    xdot: Array
    delta: Array
    start: int = START

    def stamp(self, k: int) -> int:
        return self.start + k * (1_000_000_000 // RATE)

    def force(self, k: int) -> Array:
        """Specific force at the centre of mass (3,), FRD [m/s^2]."""
        x = self.x[k]
        down = rotation(x[6:]).T @ np.array([0.0, 0.0, GRAVITY])
        return np.asarray(self.xdot[k, :3] - down + np.cross(x[3:6], x[:3]))


def rotation(euler: Array) -> Array:
    """Matrix (3, 3) from FRD to NED."""
    (sp, ss, sy), (cp, cs, cy) = np.sin(euler), np.cos(euler)
    roll = np.array([[1.0, 0.0, 0.0], [0.0, cp, -sp], [0.0, sp, cp]])
    pitch = np.array([[cs, 0.0, ss], [0.0, 1.0, 0.0], [-ss, 0.0, cs]])
    yaw = np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(yaw @ pitch @ roll)


def quaternion(matrix: Array) -> Array:
    """w, x, y, z (4,) of a rotation matrix, w not negative."""
    m = matrix
    w = 0.5 * math.sqrt(max(1.0 + m[0, 0] + m[1, 1] + m[2, 2], 0.0))
    if w > 0.1:
        return np.array([w, (m[2, 1] - m[1, 2]) / 4 / w, (m[0, 2] - m[2, 0]) / 4 / w, (m[1, 0] - m[0, 1]) / 4 / w])
    i = int(np.argmax(np.diag(m)))
    j, k = (i + 1) % 3, (i + 2) % 3
    q = np.zeros(4)
    q[1 + i] = 0.5 * math.sqrt(1.0 + m[i, i] - m[j, j] - m[k, k])
    q[0] = (m[k, j] - m[j, k]) / 4 / q[1 + i]
    q[1 + j], q[1 + k] = (m[j, i] + m[i, j]) / 4 / q[1 + i], (m[k, i] + m[i, k]) / 4 / q[1 + i]
    return q if q[0] >= 0.0 else -q


def header(stamp: int) -> dict[str, Any]:
    return {"stamp": {"sec": stamp // 1_000_000_000, "nanosec": stamp % 1_000_000_000}, "frame_id": ""}


def flu(vector: Array) -> dict[str, float]:
    return dict(zip("xyz", (FRD_OF_FLU @ vector).tolist(), strict=True))


def ros_attitude(euler: Array) -> dict[str, float]:
    return dict(zip("wxyz", quaternion(NED_OF_ENU @ rotation(euler) @ FRD_OF_FLU).tolist(), strict=True))


def odometry(flight: Flight, k: int) -> dict[str, Any]:
    x = flight.x[k]
    twist = {"twist": {"linear": flu(x[:3]), "angular": flu(x[3:6])}}
    return {"header": header(flight.stamp(k)), "pose": {"pose": {"orientation": ros_attitude(x[6:])}}, "twist": twist}


def imu(flight: Flight, k: int, arm: Array | None = None) -> dict[str, Any]:
    force, omega = flight.force(k), flight.x[k, 3:6]
    if arm is not None:
        force = force + np.cross(flight.xdot[k, 3:6], arm) + np.cross(omega, np.cross(omega, arm))
    vectors = {"angular_velocity": flu(omega), "linear_acceleration": flu(force)}
    return {"header": header(flight.stamp(k)), "orientation": ros_attitude(flight.x[k, 6:]), **vectors}


def standard(flight: Flight, *, slow: int = 2, arm: Array | None = None) -> Iterator[Sent]:
    """Odometry and joints at a slower rate than the IMU; the joints in an order that changes."""
    names = list(flight.effectors)
    for k in range(len(flight.x)):
        stamp = flight.stamp(k)
        yield stamp + 300, "/imu/data", IMU, imu(flight, k, arm)
        if k % slow == 0:
            turn = k // 100 % len(names)
            order = names[turn:] + names[:turn]
            position = [float(flight.delta[k, names.index(n)]) for n in order]
            yield stamp + 100, "/odom", ODOMETRY, odometry(flight, k)
            joints = {"header": header(stamp), "name": ["gear", *order], "position": np.array([0.5, *position])}
            yield stamp + 200, "/joint_states", JOINTS, joints


def mavros(flight: Flight) -> Iterator[Sent]:
    """Pulses of 0.00109083 rad/us about 1500 us, 20 ms before the surfaces get there."""
    de, da, dr = (flight.delta[:, flight.effectors.index(n)] / 0.00109083 for n in ("de", "da", "dr"))
    channels = np.full((len(de), 8), 1500.0)
    channels[:, 0] += da
    channels[:, 1] -= de
    channels[:, 3] += dr
    for k in range(0, len(flight.x), 2):
        stamp, pulse = flight.stamp(k), flight.stamp(k) - 20_000_000
        yield stamp + 100, "/mavros/local_position/odom", ODOMETRY, odometry(flight, k)
        yield stamp + 200, "/mavros/imu/data", IMU, imu(flight, k)
        values = {"header": header(pulse), "channels": np.rint(channels[k]).astype(np.uint16)}
        yield stamp + 300, "/mavros/rc/out", RC_OUT, values


def px4(flight: Flight) -> Iterator[Sent]:
    """Stamps in microseconds, NED velocities, controls of 25 deg at 1, 20 ms before the surfaces get there."""
    de, da, dr = (flight.delta[:, flight.effectors.index(n)] / 0.436332 for n in ("de", "da", "dr"))
    control = np.zeros((len(de), 8))
    control[:, 0], control[:, 1], control[:, 2] = da, -de, dr
    for k in range(len(flight.x)):
        stamp, x = flight.stamp(k), flight.x[k]
        matrix, us = rotation(x[6:]), stamp // 1000
        values = {"q": quaternion(matrix), "velocity_frame": 1, "velocity": matrix @ x[:3], "angular_velocity": x[3:6]}
        yield (
            stamp + 100,
            "/fmu/out/vehicle_odometry",
            VEHICLE,
            {"timestamp": us + 50, "timestamp_sample": us, **values},
        )
        sensors = {"timestamp": us, "gyro_rad": x[3:6], "accelerometer_m_s2": flight.force(k)}
        yield stamp + 200, "/fmu/out/sensor_combined", SENSORS, sensors
        if k % 2 == 0:
            servos = {"timestamp": us, "timestamp_sample": us - 20_000, "control": control[k]}
            yield stamp + 300, "/fmu/out/actuator_servos", SERVOS, servos


def write_bag(path: Path, sent: Iterator[Sent], definitions: Path) -> Path:
    """Write messages into a bag; texts of the types that nobody ships go into the folder ``definitions`` first."""
    for msgtype, text in DEFINITIONS.items():
        package, kind, name = msgtype.split("/")
        folder = definitions / package / kind
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f"{name}.msg").write_text(text)
    with BagWriter(path, definition_paths=[definitions]) as writer:
        for log, topic, msgtype, fields in sent:
            writer.write_message(topic, msgtype, log, fields)
    return path


def rigid_flight(
    seconds: float,
    seed: int = 1,
    pace: Callable[[float], float] = lambda t: 1.0,
    side: float = 1.0,
    bank: float = 0.0,
    along: bool = False,
) -> Flight:
    """Fly a made-up rigid aircraft of 18 m/s, forces and moments linear and with airspeed, by Runge and Kutta.

    Its side force is ``side`` times that of an aircraft with fuselage and fin; a slow aileron of ``bank`` [rad] rolls
    it to and fro. ``along``: it flies straight on, from no yaw and by the elevator alone.
    """
    random = np.random.default_rng(seed)
    rates = random.uniform(0.3, 3.0, (3, 6)) * 2.0 * math.pi
    phases = random.uniform(0.0, 2.0 * math.pi, (3, 6))
    trim = TRIM * (np.arange(9) < 8) if along else TRIM
    rest = -rotation(trim[6:]).T @ np.array([0.0, 0.0, GRAVITY])
    forces = np.diag([-0.1, -0.5 * side, -4.0, 0.0, 0.0, 0.0])[:3]
    moments = np.array([[0, -0.5, 0, -8.0, 0, 1.5], [0, 0, -1.0, 0, -5.0, 0], [0, 0.6, 0, -0.3, 0, -1.5]])
    by_force = np.array([[0, 0, 0], [0, 0, 3.0 * side], [-6.0, 0, 0]])
    by_moment = np.array([[0, 40.0, 2.0], [-30.0, 0, 0], [0, -2.0, -12.0]])

    def deflections(t: float) -> Array:
        slow = np.array([0.0, bank * math.cos(0.4 * math.pi * t), 0.0])
        quick = 0.02 * np.sin(rates * t + phases).sum(axis=1) * pace(t)
        return np.asarray((quick + slow) * [1.0, 0.0, 0.0] if along else quick + slow)

    def derivative(t: float, x: Array) -> Array:
        fast = float(np.linalg.norm(x[:3]) / np.linalg.norm(trim[:3]))
        delta, off = fast * fast * deflections(t), fast * (x[:6] - trim[:6])
        force = rest + forces @ off + by_force @ delta
        p, q, r, phi, theta = x[3:8]
        down = rotation(x[6:]).T @ np.array([0.0, 0.0, GRAVITY])
        turn = q * math.sin(phi) + r * math.cos(phi)
        euler = [p + math.tan(theta) * turn, q * math.cos(phi) - r * math.sin(phi), turn / math.cos(theta)]
        return np.concatenate([force + down - np.cross(x[3:6], x[:3]), moments @ off + by_moment @ delta, euler])

    n, h = round(seconds * RATE), 0.25 / RATE
    x, states = trim.copy(), np.empty((n, 9))
    for k in range(n):
        states[k] = x
        for part in range(4):
            t = k / RATE + part * h
            a = derivative(t, x)
            b = derivative(t + h / 2, x + h / 2 * a)
            c = derivative(t + h / 2, x + h / 2 * b)
            x = x + h / 6 * (a + 2 * b + 2 * c + derivative(t + h, x + h * c))
    times = np.arange(n) / RATE
    xdot = np.array([derivative(t, s) for t, s in zip(times, states, strict=True)])
    return Flight(("de", "da", "dr"), states, xdot, np.array([deflections(t) for t in times]))
