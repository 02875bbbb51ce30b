"""Sensors as they are on real aircraft: vanes, delays, biases, coloured noise, slow records, lost samples.

Each is off by default. Order of events for a sample: responses are taken late against the deflections; accelerometer
and vanes see the motion where they are; scale errors, biases, white and coloured noise; quantisation; then states and
derivatives are put together from what the instruments say, as an air data and inertial system would.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from types import MappingProxyType

import numpy as np

from msls_ros.plant.interface import Array, PlantError, Sample
from msls_ros.plant.sensors import Sensors

_GRAVITY = 9.80665
_STREAM = 0x1257
CHANNELS = (
    *("airspeed", "alpha", "beta", "P", "Q", "R", "Phi", "Theta", "Psi"),
    *("ax", "ay", "az", "Pdot", "Qdot", "Rdot", "deflection"),
)
"""What is measured; all deflections have the same instruments, with noise of their own."""
_SCALARS = len(CHANNELS) - 1
_INDEX = {name: i for i, name in enumerate(CHANNELS)}
Numbers = tuple[tuple[str, float], ...]


@dataclass(frozen=True)
class Instruments:
    """A suite of instruments; numbers by channel in SI units and radians.

    Attributes
    ----------
    vanes : bool
        u, v, w from airspeed, angle of attack and sideslip, instead of measured velocities.
    vane_position : float
        The vanes ahead of the centre of mass [m]; what the rotation adds there is taken off with measured rates.
    delay : float
        Responses (states and derivatives) behind the deflections [s].
    accelerometer_position : tuple of float
        Place forward, right, down of the centre of mass [m], not corrected for.
    white, coloured : tuple of (str, float)
        Standard deviations of white and of AR(1) noise by channel.
    correlation : tuple of (str, float)
        AR(1) coefficient by channel, per sample [1].
    bias, scale : tuple of (str, float)
        Constant error, and error as a share of the value [1].
    resolution : tuple of (str, float)
        Smallest step by channel.
    servo_rate : float
        Records of the deflections per second [Hz]; 0: one with each sample.
    differentiated : bool
        Angular accelerations are differences of measured rates over one sample.
    dropped : float
        Share of the samples that never arrive [1].

    Raises
    ------
    PlantError
        At construction, for an unknown channel or a number out of range; the sentence begins with the field.
    """

    vanes: bool = False
    vane_position: float = 0.0
    delay: float = 0.0
    accelerometer_position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    white: Numbers = ()
    coloured: Numbers = ()
    correlation: Numbers = ()
    bias: Numbers = ()
    scale: Numbers = ()
    resolution: Numbers = ()
    servo_rate: float = 0.0
    differentiated: bool = False
    dropped: float = 0.0

    def __post_init__(self) -> None:
        """Refuse what is no instrument."""
        for name, (low, high) in LIMITS.items():
            value = getattr(self, name)
            for one in value if isinstance(value, tuple) else (value,):
                number = one[1] if isinstance(one, tuple) else one
                if isinstance(one, tuple) and one[0] not in CHANNELS:
                    message = f"{name} of '{one[0]}': expected one of {', '.join(CHANNELS)}"
                    raise PlantError(message)
                if not low <= number <= high:
                    message = f"{name} {number:g}: expected {low:g} to {high:g}"
                    raise PlantError(message)

    def changed(self, changes: Mapping[str, object]) -> Instruments:
        """Return a copy with other fields; numbers by channel are added to those there are."""
        merged = {}
        for name, value in changes.items():
            if isinstance(value, tuple) and name in BY_CHANNEL:
                value = tuple({**dict(getattr(self, name)), **dict(value)}.items())
            merged[name] = value
        return replace(self, **merged)  # type: ignore[arg-type]


BY_CHANNEL = ("white", "coloured", "correlation", "bias", "scale", "resolution")
LIMITS: Mapping[str, tuple[float, float]] = MappingProxyType(
    {
        "vane_position": (-50.0, 50.0),
        "delay": (0.0, 0.5),
        "accelerometer_position": (-50.0, 50.0),
        "white": (0.0, 100.0),
        "coloured": (0.0, 100.0),
        "correlation": (0.0, 0.9999),
        "bias": (-100.0, 100.0),
        "scale": (-0.5, 0.5),
        "resolution": (0.0, 100.0),
        "servo_rate": (0.0, 1000.0),
        "dropped": (0.0, 0.9),
    }
)
"""Ranges of the numbers."""


def _degrees(**values: float) -> Numbers:
    return tuple((name, math.radians(value)) for name, value in values.items())


FLIGHT_TEST = Instruments(
    vanes=True,
    delay=0.014,
    white=_degrees(P=0.09, Q=0.06, R=0.07, deflection=0.011),
    coloured=(
        ("airspeed", 0.1),
        *_degrees(alpha=0.02, beta=0.025, Q=0.06, Phi=0.03, Theta=0.03, Psi=0.03, Pdot=0.24, Qdot=0.6, Rdot=0.22),
        *_degrees(deflection=0.006),
        *(("ax", 0.02), ("ay", 0.02), ("az", 0.03)),
    ),
    correlation=(
        *(("airspeed", 0.9), ("alpha", 0.8), ("beta", 0.8), ("Q", 0.9), ("Phi", 0.9), ("Theta", 0.9), ("Psi", 0.9)),
        *(("Pdot", 0.8), ("Qdot", 0.93), ("Rdot", 0.8), ("deflection", 0.9), ("ax", 0.9), ("ay", 0.9), ("az", 0.9)),
    ),
    bias=(("ax", 0.03), ("ay", 0.03), ("az", 0.06)),
    resolution=_degrees(
        **dict.fromkeys(("alpha", "beta", "P", "Q", "R", "deflection"), 0.01),
        **dict.fromkeys(("Phi", "Theta", "Psi", "Pdot", "Qdot", "Rdot"), 0.02),
    ),
)
"""Sizes and colours of a real aircraft's instruments at rest in the air, sampled at 25 Hz."""
SUITES: Mapping[str, Instruments] = MappingProxyType({"plain": Instruments(), "flight_test": FLIGHT_TEST})
"""Suites by name."""


@dataclass
class _Memory:
    """What the instruments remember."""

    colour: Array | None = None
    rates: Array | None = None
    time: float = 0.0
    servo: tuple[int, Array] | None = None
    history: deque[tuple[float, Array]] = field(default_factory=deque)


class RealSensors:
    """Instruments behind the noise of `Sensors`.

    Parameters
    ----------
    instruments : Instruments
        The suite.
    level : str
        A name of `NOISE_LEVELS`, on top; "none" where the suite says it all.
    seed : int
        From 0; the same seed gives the same errors.
    """

    def __init__(self, instruments: Instruments, level: str, seed: int) -> None:
        self._base = Sensors(level, seed)
        self._of = instruments
        self._random = np.random.default_rng([_STREAM, seed])
        self._drops = np.random.default_rng([_STREAM + 1, seed])
        self._memory = _Memory()
        self._numbers: list[Array] | None = None

    @property
    def follows(self) -> bool:
        """Whether `follow` wants every step of the flight dynamics."""
        return self._of.delay > 0.0

    def follow(self, sample: Sample) -> None:
        """Take a step of the flight dynamics, of which a late response is made."""
        history = self._memory.history
        history.append((sample.time, np.concatenate((sample.x, sample.xdot))))
        while len(history) > 2 and history[1][0] <= sample.time - self._of.delay:
            history.popleft()

    def lost(self) -> bool:
        """Whether the next sample never arrives; to be asked once for each."""
        return self._of.dropped > 0.0 and bool(self._drops.random() < self._of.dropped)

    def measure(self, sample: Sample) -> Sample:
        """Return the sample as measured."""
        late = self._late(self._base.measure(sample))
        read = self._read(late)
        delta = self._quantised(read[_SCALARS:], "deflection")
        return Sample(sample.time, *self._assembled(late, read), self._servo(sample.time, delta))

    def _late(self, sample: Sample) -> Sample:
        history = self._memory.history
        if not self.follows:
            return sample
        if not history or history[-1][0] < sample.time:
            self.follow(sample)
        at = sample.time - self._of.delay
        (t0, before), (t1, after) = history[0], history[min(1, len(history) - 1)]
        part = min(max((at - t0) / (t1 - t0), 0.0), 1.0) if t1 > t0 else 0.0
        values = before + part * (after - before)
        return Sample(sample.time, values[:9], values[9:], sample.delta)

    def _read(self, s: Sample) -> Array:
        """Return what the instruments say, the deflections last, before these are quantised."""
        u, v, w, _, q, r, phi, theta, _ = s.x.tolist()
        ahead = self._of.vane_position
        air = [math.sqrt(u * u + v * v + w * w), math.atan2(w - ahead * q, u)]
        air.append(math.asin(max(-1.0, min(1.0, (v + ahead * r) / max(air[0], 1e-3)))))
        rates, turning, place = s.x[3:6], s.xdot[3:6], np.array(self._of.accelerometer_position)
        force = s.xdot[:3] + _cross(rates, s.x[:3]) - _gravity(phi, theta)
        force = force + _cross(turning, place) + _cross(rates, _cross(rates, place))
        true = np.concatenate((air, s.x[3:], force, turning, s.delta))
        if self._numbers is None:
            self._numbers = [self._by_channel(name, len(s.delta)) for name in (*BY_CHANNEL[:5], "resolution")]
        white, coloured, correlation, bias, scale, step = self._numbers
        fresh = self._random.standard_normal((2, true.size))
        before = self._memory.colour
        colour = fresh[1] if before is None else correlation * before + np.sqrt(1.0 - correlation**2) * fresh[1]
        self._memory.colour = colour
        read: Array = true * (1.0 + scale) + bias + white * fresh[0] + coloured * colour
        stepped = np.flatnonzero(step[:_SCALARS])
        read[stepped] = np.round(read[stepped] / step[stepped]) * step[stepped]
        return read

    def _by_channel(self, name: str, effectors: int) -> Array:
        values = dict(getattr(self._of, name))
        scalars = [values.get(channel, 0.0) for channel in CHANNELS[:_SCALARS]]
        return np.array(scalars + [values.get("deflection", 0.0)] * effectors)

    def _quantised(self, values: Array, channel: str) -> Array:
        step = dict(self._of.resolution).get(channel, 0.0)
        return np.round(values / step) * step if step else values

    def _assembled(self, s: Sample, read: Array) -> tuple[Array, Array]:
        """Return states and derivatives made of readings."""
        airspeed, alpha, beta = read[:3].tolist()
        p, q, r = rates = read[3:6]
        velocity = s.x[:3] + 0.0
        if self._of.vanes:
            ahead = self._of.vane_position
            velocity[0] = airspeed * math.cos(beta) * math.cos(alpha)
            velocity[1] = airspeed * math.sin(beta) - ahead * r
            velocity[2] = airspeed * math.cos(beta) * math.sin(alpha) + ahead * q
        x = np.concatenate((velocity, read[3:9]))
        phi, theta = float(read[6]), float(read[7])
        linear = read[9:12] - _cross(rates, velocity) + _gravity(phi, theta)
        turn = q * math.sin(phi) + r * math.cos(phi)
        euler = [p + math.tan(theta) * turn, q * math.cos(phi) - r * math.sin(phi), turn / math.cos(theta)]
        return x, np.concatenate((linear, self._angular(s.time, rates, read[12:15]), euler))

    def _angular(self, time: float, rates: Array, measured: Array) -> Array:
        if not self._of.differentiated:
            return measured
        before, self._memory.rates = self._memory.rates, rates
        step, self._memory.time = time - self._memory.time, time
        return np.zeros(3) if before is None or step <= 0.0 else (rates - before) / step

    def _servo(self, time: float, delta: Array) -> Array:
        if not self._of.servo_rate:
            return delta
        number = math.floor(time * self._of.servo_rate + 1e-9)
        if self._memory.servo is None or self._memory.servo[0] != number:
            self._memory.servo = number, delta
        return self._memory.servo[1]


def _cross(a: Array, b: Array) -> Array:
    """Return a x b of (3,) each, as `numpy.cross`, which takes thirty times as long for three numbers."""
    (a0, a1, a2), (b0, b1, b2) = a.tolist(), b.tolist()
    return np.array([a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0])


def _gravity(phi: float, theta: float) -> Array:
    across = math.cos(theta)
    return _GRAVITY * np.array([-math.sin(theta), across * math.sin(phi), across * math.cos(phi)])


FIELDS = tuple(one.name for one in fields(Instruments))
"""Names of the fields, for those who read a suite from a file."""


def instrument_lines(instruments: Instruments) -> list[str]:
    """Return what `parse_instruments` reads: ``delay=0.014``, ``white.P=0.0016``."""
    lines = []
    for name in FIELDS:
        value = getattr(instruments, name)
        if name in BY_CHANNEL:
            lines += [f"{name}.{channel}={number!r}" for channel, number in value]
        elif name == "accelerometer_position":
            lines.append(f"{name}={','.join(map(repr, value))}")
        else:
            lines.append(f"{name}={str(value).lower()}")
    return lines


def parse_instruments(lines: Sequence[str]) -> Instruments:
    """Read a suite from lines, each a field: ``suite=flight_test``, ``delay=0.02``, ``white.P=0.001``.

    Raises
    ------
    PlantError
        For a line that is none; the sentence has the line.
    """
    found = Instruments()
    for line in lines:
        name, _, text = line.partition("=")
        field_name, _, channel = name.partition(".")
        if name == "suite" and text in SUITES:
            found = SUITES[text]
            continue
        if field_name not in FIELDS or bool(channel) != (field_name in BY_CHANNEL):
            message = f"sensors: '{line}': expected suite={'|'.join(SUITES)}, or FIELD=VALUE of {', '.join(FIELDS)}"
            raise PlantError(message)
        try:
            found = found.changed({field_name: _value(field_name, channel, text)})
        except ValueError as error:
            if isinstance(error, PlantError):
                raise
            message = f"sensors: '{line}': expected a number, true or false"
            raise PlantError(message) from error
    return found


def _value(name: str, channel: str, text: str) -> object:
    if channel:
        return ((channel, float(text)),)
    if name == "accelerometer_position":
        x, y, z = map(float, text.split(","))
        return x, y, z
    if name in ("vanes", "differentiated"):
        if text not in ("true", "false"):
            raise ValueError(text)
        return text == "true"
    return float(text)


def make_sensors(instruments: Instruments | None, level: str, seed: int) -> RealSensors:
    """Return the sensors of a flight; without instruments those of the noise level alone.

    Raises
    ------
    PlantError
        If the level is unknown or the seed is not a whole number of at least 0.
    """
    return PlainSensors(level, seed) if instruments is None else RealSensors(instruments, level, seed)


class PlainSensors(RealSensors):
    """The noise of a level alone, through the same face."""

    def __init__(self, level: str, seed: int) -> None:
        super().__init__(Instruments(), level, seed)

    def measure(self, sample: Sample) -> Sample:
        """Return the sample with the noise of the level."""
        return self._base.measure(sample)
