"""Whole flights of the small aircraft of `servo_beds`, from rest to rest, as their logs have them.

Surfaces are moved before the flight, as before every flight; then take-off on three wheels, climb, attitudes at three
speeds from .85 to 1.3 of cruise, landing and roll. In two fifths of the flights numbers jump away and back for one to
three samples, once in five seconds; in one fifth a wind blows all the while that nobody measures, for velocities are
over ground. There is no truth while wheels touch the ground (numbers that are none).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.calibration_beds import Bed, Recorded, flight_test
from benchmarks.servo_beds import (
    AEROSONDE,
    GRAVITY,
    NOISE,
    QUANTUM,
    SMALLS,
    STEP,
    Small,
    accelerate,
    cross,
    forces,
    gravity,
    trim,
    truth,
)

Array = NDArray[np.float64]
PLACES = np.array([(-0.12, 0.4, 0.3), (-0.12, -0.4, 0.3), (0.7, 0.0, 0.3)])
"""Of the wheels of an Aerosonde, from its centre of mass [m]."""
STIFFNESS, DAMPING = 15.0, 0.4
"""Of all wheels together: natural frequency [rad/s] and damping ratio [1]."""
ROLLING, SIDEWAYS = 0.03, 0.6
"""Coefficients of friction."""
STEERING = 0.5
"""Of the nose wheel, over the rudder [1]."""
STALL = 1.0
"""Slower than this no aerodynamic force is reckoned with [m/s]."""
REST, CHECK, ATTITUDES = 20.0, 5.0, 25.0
"""On the ground, in it before the surfaces are moved, and at each speed [s]."""
SPEEDS = (1.0, 1.3, 0.85, 1.0)
"""Over that of cruise [1]."""
HEIGHT, FLARE = 60.0, 3.0
"""[m]"""
SPIKES = {"velocity": 5.0, "rate": 2.0, "deflection": 0.4}
"""[m/s, rad/s, rad]"""
SPIKES_EVERY = 5.0
"""[s]"""
WIND = 0.25
"""Of the speed of cruise, from the north [1]."""
LONGEST = 400.0


@dataclass(frozen=True)
class WholeBed(Bed):
    """A whole flight of one of them; its scenario is one without faults, for what it says of names and times."""

    small: str = "aerosonde"
    rate: int = 50
    gusts: float = 0.0
    """Their standard deviation [m/s]."""
    spikes: bool = False
    wind: float = 0.0
    """A steady one, from the north [m/s]."""

    def fly(self, seed: int) -> Recorded:
        """Fly it; the seed is that of attitudes, sensors, air and spikes."""
        return Pilot(self, seed).fly()


def whole_beds(rates: tuple[int, ...] = (25, 50)) -> Iterator[WholeBed]:
    """Yield the beds: every aircraft, rate, still and moving air, with spikes and without; and wind."""
    for small, one in SMALLS.items():
        for rate in rates:
            for gusts in (0.0, 1.0):
                for spikes in (False, True):
                    name = f"{small} {rate} Hz {'gusts' if gusts else 'still'}{' spikes' if spikes else ''} whole"
                    scenario = flight_test("A4", rate, "smooth")
                    speed = (("reference_speed", one.speed),)
                    yield WholeBed(name, "whole flights", scenario, "none", speed, small, rate, gusts, spikes)
            name = f"{small} {rate} Hz wind whole"
            blows = WIND * one.speed
            yield WholeBed(name, "whole flights", scenario, "none", speed, small, rate, 0.5, wind=blows)


def wheel_forces(one: Small, x: Array, height: float, steering: float) -> tuple[Array, Array, bool]:
    """Return force [N] and moment [N m] of the wheels in body axes, and whether any touches the ground."""
    force, moment, touches = np.zeros(3), np.zeros(3), False
    if height > one.span:  # no wheel reaches that far
        return force, moment, touches
    down = gravity(x) / GRAVITY
    share = one.mass / len(PLACES)
    for i, arm in enumerate(PLACES * (one.span / AEROSONDE.span)):
        depth = float(arm @ down) - height
        if depth <= 0.0:
            continue
        touches = True
        moving = x[:3] + cross(x[3:6], arm)
        load = share * max(STIFFNESS**2 * depth + 2.0 * DAMPING * STIFFNESS * float(moving @ down), 0.0)
        angle = steering if i == len(PLACES) - 1 else 0.0
        along, side = (
            np.array([math.cos(angle), math.sin(angle), 0.0]),
            np.array([-math.sin(angle), math.cos(angle), 0]),
        )
        along, side = along - (along @ down) * down, side - (side @ down) * down
        rolling = ROLLING * math.tanh(float(moving @ along) / 0.2) * along
        sliding = SIDEWAYS * math.tanh(float(moving @ side) / 0.3) * side
        push = -load * (down + rolling + sliding)
        force, moment = force + push, moment + cross(arm, push)
    return force, moment, touches


def steady_wind(x: Array, speed: float) -> Array:
    """Return the wind from the north in body axes, (3,) [m/s]."""
    sp, cp, st, ct = math.sin(x[6]), math.cos(x[6]), math.sin(x[7]), math.cos(x[7])
    ss, cs = math.sin(x[8]), math.cos(x[8])
    return -speed * np.array([ct * cs, sp * st * cs - cp * ss, cp * st * cs + sp * ss])


@dataclass
class Motion:
    """What an instant does."""

    rates: Array
    """(9,) derivatives of the states."""
    felt: Array
    """(3,) specific force [m/s^2]."""
    climb: float
    """[m/s]"""
    touches: bool


def move(one: Small, x: Array, height: float, delta: Array, thrust: float, wind: Array) -> Motion:
    """Return what the aircraft does, in the air or on its wheels."""
    air = x[:3] - wind
    fast = float(air @ air) > STALL**2
    force, moment = forces(one, x, delta, thrust, wind) if fast else (np.array([thrust, 0.0, 0.0]), np.zeros(3))
    pushed, turned, touches = wheel_forces(one, x, height, STEERING * float(delta[2]))
    rates, felt = accelerate(one, x, force + pushed, moment + turned)
    return Motion(rates, felt, -float(gravity(x) @ x[:3]) / GRAVITY, touches)


class Pilot:
    """Flies one.

    Parameters
    ----------
    bed, seed
        What, and of all that is random.
    """

    def __init__(self, bed: WholeBed, seed: int) -> None:
        """Stand still; see the class."""
        self.bed, self.one = bed, SMALLS[bed.small]
        self.random = np.random.default_rng(seed)
        trimmed, self.neutral, self.cruising = trim(self.one)
        self.level = float(trimmed[7])
        self.rest = float(PLACES[0, 2]) * self.one.span / AEROSONDE.span
        self.x, self.height = np.zeros(9), self.rest - GRAVITY / STIFFNESS**2
        self.phase, self.throttle, self.integral, self.slow = "rest", 0.0, 0.0, 0.5
        self.wanted, self.due, self.cruise = np.array([0.0, self.level]), 0.0, 0.0

    def fly(self) -> Recorded:
        """Return what is recorded."""
        one, random = self.one, self.random
        scale, size = np.array([200.0, 200.0, 50.0]), self.bed.gusts * np.array([1.0, 1.0, 0.7])
        wind, act, command = steady_wind(self.x, self.bed.wind), self.neutral.copy(), self.neutral.copy()
        gust = np.zeros(3)
        late = [self.neutral] * (round(one.delay / STEP) + 1)
        follow, most = 1.0 - math.exp(-one.servo * STEP), 0.35 * one.mass * GRAVITY
        bias, every = random.normal(0.0, 0.003, 3), round(1.0 / (self.bed.rate * STEP))
        taken: list[tuple[float, Array, Array, Array]] = []
        truths: list[tuple[float, Array, Array]] = []
        moving = move(one, self.x, self.height, act, 0.0, wind)
        stopped = LONGEST
        for k in range(round(LONGEST / STEP)):
            time, speed = k * STEP, float(np.linalg.norm(self.x[:3] - wind))
            fade = np.exp(-max(speed, STALL) * STEP / scale)
            gust = fade * gust + np.sqrt(1.0 - fade * fade) * size * random.normal(size=3)
            wind = gust + steady_wind(self.x, self.bed.wind)
            self.go_on(time, speed, moving.touches)
            stopped = min(stopped, time) if self.phase == "end" else stopped
            if time > stopped + 10.0:
                break
            if k % 4 == 0:
                command = np.round(np.clip(self.steer(time, speed), -0.45, 0.45) / QUANTUM) * QUANTUM
            late = [*late[1:], command]
            act = act + follow * (late[0] - act)
            thrust = self.throttle * most * max(0.0, 1.0 - speed / (2.2 * one.speed))
            moving = move(one, self.x, self.height, act, thrust, wind)
            if k % every == 0:
                if len(taken) % 5 == 0:
                    none = np.full((9, 9), np.nan), np.full((9, 3), np.nan)
                    truths.append((time, *(none if moving.touches else truth(one, self.x, act, thrust, wind))))
                taken.append((time, *self.read(moving, bias), command.copy()))
            half = self.x + 0.5 * STEP * moving.rates
            middle = move(one, half, self.height + 0.5 * STEP * moving.climb, act, thrust, wind)
            self.x, self.height = self.x + STEP * middle.rates, self.height + STEP * middle.climb
        samples = [np.array(column) for column in zip(*taken, strict=True)]
        if self.bed.spikes:
            self.jump(samples[1], samples[3])
        return Recorded(*samples, *(np.array(column) for column in zip(*truths, strict=True)))

    def go_on(self, time: float, speed: float, touches: bool) -> None:
        """Begin the next part of the flight when it is time."""
        after = {
            "rest": ("roll", time > REST),
            "roll": ("climb", self.height > self.rest + 2.0),
            "climb": ("cruise", self.height > HEIGHT),
            "cruise": ("descent", time - self.cruise > ATTITUDES * len(SPEEDS)),
            "descent": ("flare", self.height < FLARE),
            "flare": ("stop", touches),
            "stop": ("end", speed < 1.0 + 3.0 * self.bed.gusts + self.bed.wind),
            "end": ("end", False),
        }
        phase, due = after[self.phase]
        if due:
            self.phase = phase
            self.cruise = time if phase == "cruise" else self.cruise

    def steer(self, time: float, speed: float) -> Array:
        """Set the throttle and return the commands to the surfaces [rad]."""
        x, phase = self.x, self.phase
        self.power(time, speed)
        if phase == "rest":
            which, since = divmod(time - CHECK, 2.0)
            moved = 0.4 * math.sin(2.0 * math.pi * since) if 0 <= which < 3 else 0.0
            return np.array([moved * (which == i) for i in range(3)])
        if phase == "cruise" and time >= self.due:
            self.due = time + self.random.uniform(4.0, 12.0)
            self.wanted[0] = self.random.choice([-0.5, -0.3, 0.0, 0.3, 0.5])
        bank = self.wanted[0] if phase == "cruise" else 0.0
        pitch = {
            "roll": 0.02 if speed < 0.8 * self.one.speed else 0.2,
            "climb": 0.2,
            "cruise": self.level + min(max(0.01 * (HEIGHT - self.height), -0.12), 0.12) + 0.1 * (int(time) % 13 == 4),
            "descent": self.level - 0.12,
            "flare": self.level + 0.04,
        }.get(phase, 0.0)
        error = np.array([bank, pitch]) - x[6:8]
        if phase in ("climb", "cruise", "descent", "flare"):
            self.integral = min(max(self.integral + 0.002 * error[1], -0.1), 0.1)
        de = self.neutral[0] - 0.6 * error[1] + 0.12 * x[4] - self.integral
        da = 0.45 * error[0] - 0.06 * x[3]
        return np.array([de, da, 0.25 * (x[5] - GRAVITY / max(speed, 5.0) * math.tan(x[6])) + 0.2 * da])

    def power(self, time: float, speed: float) -> None:
        """Set the throttle [1]."""
        if self.phase in ("roll", "climb"):
            self.throttle = 1.0
        elif self.phase == "descent":
            self.throttle = min(max(0.3 + 0.1 * (0.95 * self.one.speed - speed), 0.0), 1.0)
        elif self.phase == "cruise":
            which = min(int((time - self.cruise) / ATTITUDES), len(SPEEDS) - 1)
            error = self.one.speed * SPEEDS[which] - speed
            self.slow = min(max(self.slow + 0.0005 * error, 0.0), 1.0)
            self.throttle = min(max(self.slow + 0.08 * error, 0.0), 1.0)
        else:
            self.throttle = 0.0

    def read(self, moving: Motion, bias: Array) -> tuple[Array, Array]:
        """Return states and derivatives as they are measured; those of rates are not."""
        random, read, known = self.random, self.x.copy(), moving.rates.copy()
        read[:3] += random.normal(0.0, NOISE["velocity"], 3)
        read[3:6] += random.normal(0.0, NOISE["rate"], 3) + bias
        read[6:] += random.normal(0.0, NOISE["attitude"], 3)
        noisy = moving.felt + random.normal(0.0, NOISE["acceleration"], 3)
        known[:3] = noisy + gravity(read) - cross(read[3:6], read[:3])
        return read, known

    def jump(self, x: Array, delta: Array) -> None:
        """Let a velocity, a rate or a deflection jump away and back, now and then."""
        random, number = self.random, round(SPIKES_EVERY * self.bed.rate)
        for start in range(number, len(x) - number, number):
            at = start + int(random.integers(number))
            length, which = int(random.integers(1, 4)), int(random.integers(9))
            kind, column = (list(SPIKES)[which // 3], which % 3)
            into = delta[:, column] if kind == "deflection" else x[:, column + (3 if kind == "rate" else 0)]
            into[at : at + length] += random.choice([-1.0, 1.0]) * SPIKES[kind]
