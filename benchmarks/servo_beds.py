"""Small aircraft on autopilot as their logs have them: commands to servos, velocity over ground, gyroscopes, wind.

Nonlinear six degrees of freedom with the aerodynamics of the Aerosonde (Beard and McLain, *Small Unmanned Aircraft*,
2012, appendix E), and of an aircraft of a tenth of its mass. Every flight is closed loop: attitude is held, and another
one is wanted every few seconds; in half of them steps are added to elevator and aileron. What is recorded of the
surfaces are the commands; the servos follow them late and through a lag.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.calibration_beds import Bed, Recorded, flight_test
from msls_ros.inputs import frames

Array = NDArray[np.float64]
GRAVITY, DENSITY, STEP = 9.80665, 1.225, 0.005
LIFT, DRAG, SIDE = (0.28, 3.45, -0.36), (0.03, 0.30), (-0.98, -0.17)
PITCH = (-0.02338, -0.38, -3.6, -0.5)
ROLL, YAW = (-0.12, -0.26, 0.14, 0.08, 0.105), (0.25, 0.022, -0.35, 0.06, -0.032)
"""Coefficients: of angles of attack or sideslip, rates, elevator or aileron and rudder [1/rad]."""
QUANTUM = 0.0007
"""Of a command, a microsecond of its pulse [rad]."""
NOISE = {"velocity": 0.05, "rate": 0.004, "attitude": 0.003, "acceleration": 0.15}
"""[m/s, rad/s, rad, m/s^2]"""


@dataclass(frozen=True)
class Small:
    """A small aircraft."""

    mass: float
    inertia: tuple[float, float, float, float]
    """x, y, z and xz [kg m^2]."""
    area: float
    span: float
    chord: float
    speed: float
    servo: float
    """Corner of the servos [rad/s]; infinite: what is commanded acts."""
    delay: float
    """Before that [s]."""


AEROSONDE = Small(13.5, (0.8244, 1.135, 1.759, 0.1204), 0.55, 2.8956, 0.18994, 25.0, 20.0, 0.02)
SMALLS = {
    "measured": replace(AEROSONDE, servo=math.inf, delay=0.0),
    "late": replace(AEROSONDE, servo=math.inf, delay=0.04),
    "aerosonde": AEROSONDE,
    "tenth": Small(1.6, (0.045, 0.05, 0.09, 0.002), 0.30, 1.4, 0.22, 14.0, 15.0, 0.03),
}


@dataclass(frozen=True)
class ServoBed(Bed):
    """A flight of one of them; its scenario is one without faults, for what it says of names and times."""

    small: str = "aerosonde"
    rate: int = 50
    gusts: float = 0.0
    """Their standard deviation, as that of light turbulence near the ground [m/s]."""
    steps: bool = False
    duration: float = 100.0

    def fly(self, seed: int) -> Recorded:
        """Fly it; the seed is that of attitudes, sensors and air."""
        return fly(self, seed)


def servo_beds(rates: tuple[int, ...] = (25, 50)) -> Iterator[ServoBed]:
    """Yield the beds: every aircraft, rate, still and moving air, with steps and without."""
    for small, one in SMALLS.items():
        for rate in rates:
            for gusts in (0.0, 1.0):
                for steps in (False, True):
                    name = f"{small} {rate} Hz {'gusts' if gusts else 'still'} {'steps' if steps else 'attitude'}"
                    scenario = flight_test("A4", rate, "smooth")
                    speed = (("reference_speed", one.speed),)
                    yield ServoBed(name, "servo commands", scenario, "none", speed, small, rate, gusts, steps)


def forces(one: Small, x: Array, delta: Array, thrust: float, wind: Array) -> tuple[Array, Array]:
    """Return force [N] and moment [N m] in body axes; x (9,), deflections (3,), wind in body axes (3,)."""
    air = x[:3] - wind
    speed = float(np.sqrt(air @ air))
    alpha, beta = math.atan2(air[2], air[0]), math.asin(air[1] / speed)
    load = 0.5 * DENSITY * speed * speed * one.area
    lift = load * (LIFT[0] + LIFT[1] * alpha + LIFT[2] * delta[0])
    drag = load * (DRAG[0] + DRAG[1] * alpha * alpha)
    c, s = math.cos(alpha), math.sin(alpha)
    force = (thrust - drag * c + lift * s, load * (SIDE[0] * beta + SIDE[1] * delta[2]), -drag * s - lift * c)
    turn, nod = one.span / (2.0 * speed), one.chord / (2.0 * speed)
    lateral = np.array([beta, turn * x[3], turn * x[5], delta[1], delta[2]])
    pitching = np.array([1.0, alpha, nod * x[4], delta[0]])
    moment = (
        load * one.span * float(lateral @ ROLL),
        load * one.chord * float(pitching @ PITCH),
        load * one.span * float(lateral @ YAW),
    )
    return np.array(force), np.array(moment)


def derivative(one: Small, x: Array, delta: Array, thrust: float, wind: Array) -> tuple[Array, Array]:
    """Return the derivative of the states (9,), and the specific force (3,) [m/s^2]."""
    return accelerate(one, x, *forces(one, x, delta, thrust, wind))


def accelerate(one: Small, x: Array, force: Array, moment: Array) -> tuple[Array, Array]:
    """Return the derivative of the states (9,) and the specific force (3,) [m/s^2] by force and moment [N, N m]."""
    felt = force / one.mass
    p, q, r, phi, theta = x[3:8]
    rates = x[3:6]
    ix, iy, iz, ixz = one.inertia
    inertia = np.array([[ix, 0.0, -ixz], [0.0, iy, 0.0], [-ixz, 0.0, iz]])
    turning = np.linalg.solve(inertia, moment - cross(rates, inertia @ rates))
    yawing = q * math.sin(phi) + r * math.cos(phi)
    angles = (p + math.tan(theta) * yawing, q * math.cos(phi) - r * math.sin(phi), yawing / math.cos(theta))
    return np.concatenate([felt + gravity(x) - cross(rates, x[:3]), turning, angles]), felt


def cross(a: Array, b: Array) -> Array:
    """Return a x b of (3,) each, as `numpy.cross`, which takes thirty times as long for three numbers."""
    return np.array(frames.cross(a.tolist(), b.tolist()))


def gravity(x: Array) -> Array:
    """Return it in body axes (3,) [m/s^2]."""
    phi, theta = x[6], x[7]
    down = (-math.sin(theta), math.cos(theta) * math.sin(phi), math.cos(theta) * math.cos(phi))
    return GRAVITY * np.array(down)


def trim(one: Small) -> tuple[Array, Array, float]:
    """Return states, deflections and thrust of straight flight, by Newton's method."""
    z = np.array([0.05, -0.05, 0.1 * one.mass * GRAVITY])

    def left(z: Array) -> Array:
        x = np.zeros(9)
        x[0], x[2], x[7] = one.speed * math.cos(z[0]), one.speed * math.sin(z[0]), z[0]
        return derivative(one, x, np.array([z[1], 0.0, 0.0]), float(z[2]), np.zeros(3))[0][[0, 2, 4]]

    for _ in range(20):
        slope = np.column_stack([(left(z + 1e-6 * e) - left(z - 1e-6 * e)) / 2e-6 for e in np.eye(3)])
        z = z - np.linalg.solve(slope, left(z))
    x = np.zeros(9)
    x[0], x[2], x[7] = one.speed * math.cos(z[0]), one.speed * math.sin(z[0]), z[0]
    return x, np.array([z[1], 0.0, 0.0]), float(z[2])


def truth(one: Small, x: Array, delta: Array, thrust: float, wind: Array) -> tuple[Array, Array]:
    """Return A (9, 9) and B (9, 3) by central differences."""

    def slope(change: Array, part: Array) -> Array:
        up, _ = derivative(one, x + change, delta + part, thrust, wind)
        down, _ = derivative(one, x - change, delta - part, thrust, wind)
        return (up - down) / 2e-5

    a = np.column_stack([slope(1e-5 * e, np.zeros(3)) for e in np.eye(9)])
    return a, np.column_stack([slope(np.zeros(9), 1e-5 * e) for e in np.eye(3)])


def fly(bed: ServoBed, seed: int) -> Recorded:
    """Return what is recorded of a bed."""
    one, random = SMALLS[bed.small], np.random.default_rng(seed)
    x, neutral, trimmed = trim(one)
    level, speed = float(x[7]), one.speed
    scale, size = np.array([200.0, 200.0, 50.0]), bed.gusts * np.array([1.0, 1.0, 0.7])
    fade = np.exp(-speed * STEP / scale)
    wind, act, command = np.zeros(3), neutral.copy(), neutral.copy()
    late = [neutral] * (round(one.delay / STEP) + 1)
    follow = 1.0 - math.exp(-one.servo * STEP)
    bias = random.normal(0.0, 0.003, 3)
    wanted, due, integral = np.array([0.0, level]), 15.0, 0.0
    every = round(1.0 / (bed.rate * STEP))
    taken: list[tuple[float, Array, Array, Array]] = []
    truths: list[tuple[float, Array, Array]] = []
    for k in range(round(bed.duration / STEP)):
        time = k * STEP
        if time >= due:
            due = time + random.uniform(4.0, 12.0)
            wanted = np.array([random.choice([-0.5, -0.3, 0.0, 0.3, 0.5]), level + random.choice([-0.1, 0.0, 0.1])])
        wind = fade * wind + np.sqrt(1.0 - fade * fade) * size * random.normal(size=3)
        if k % 4 == 0:
            error = wanted - x[6:8]
            integral = min(max(integral + 0.002 * error[1], -0.1), 0.1)
            de = neutral[0] - 0.6 * error[1] + 0.12 * x[4] - integral
            da = 0.45 * error[0] - 0.06 * x[3]
            dr = 0.25 * (x[5] - GRAVITY / speed * math.tan(x[6])) + 0.2 * da
            if bed.steps:
                de += 0.03 * np.sign(math.sin(8.2 * time)) * (int(time) % 7 == 3)
                da += 0.05 * np.sign(math.sin(6.9 * time)) * (int(time) % 7 == 5)
            command = np.round(np.clip([de, da, dr], -0.45, 0.45) / QUANTUM) * QUANTUM
        late = [*late[1:], command]
        act = act + follow * (late[0] - act)
        thrust = trimmed * (2.0 - float(np.linalg.norm(x[:3] - wind)) / speed)
        rates, felt = derivative(one, x, act, thrust, wind)
        if k % every == 0:
            read = x.copy()
            read[:3] += random.normal(0.0, NOISE["velocity"], 3)
            read[3:6] += random.normal(0.0, NOISE["rate"], 3) + bias
            read[6:] += random.normal(0.0, NOISE["attitude"], 3)
            known = rates.copy()
            noisy = felt + random.normal(0.0, NOISE["acceleration"], 3)
            known[:3] = noisy + gravity(read) - cross(read[3:6], read[:3])
            if len(taken) % 5 == 0:
                truths.append((time, *truth(one, x, act, thrust, wind)))
            taken.append((time, read, known, command.copy()))
        middle, _ = derivative(one, x + 0.5 * STEP * rates, act, thrust, wind)
        x = x + STEP * middle
    samples = (np.array(column) for column in zip(*taken, strict=True))
    return Recorded(*samples, *(np.array(column) for column in zip(*truths, strict=True)))
