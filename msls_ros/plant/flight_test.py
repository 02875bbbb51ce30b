"""Manoeuvres of flight test: inputs on the effectors of pitch, roll and yaw, one after the other.

A segment is written as a word, its duration in seconds, and where wanted options: ``elevator_3211 13 size=0.75``. The
amplitudes are those of the aircraft; ``size`` multiplies them, and a negative one reverses the input.

References
----------
Klein, V., Morelli, E. A.: Aircraft System Identification, AIAA, 2006: chapter 9, 3-2-1-1 and multisines.
Schroeder, M. R.: Synthesis of low-peak-factor signals, IEEE Transactions on Information Theory, 1970.
Van der Ouderaa, E., Schoukens, J., Renneboog, J.: Peak factor minimization, IEEE Transactions on Instrumentation and
Measurement, 1988.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cache

import numpy as np

from msls_ros.plant.definition import Airframe
from msls_ros.plant.interface import Array, PlantError
from msls_ros.plant.manoeuvres import MANOEUVRES, Manoeuvre, RollDoublet

PITCH, ROLL, YAW = range(3)
_AXES = {"elevator": PITCH, "aileron": ROLL, "rudder": YAW}
KINDS = (
    *("quiet", "elevator_3211", "elevator_doublet", "aileron_doublet", "rudder_doublet", "bank_to_bank"),
    *("elevator_sweep", "aileron_sweep", "rudder_sweep", "multisine"),
)
"""Words of the segments."""
BANKS = (2.0, 4.0, 4.0, 2.0, 1.5, 3.0, 3.0, 1.5, 1.0, 2.0, 1.0)
"""Durations of the roll inputs of a bank-to-bank, by turns to either side [s]."""
_PULSES = ((3.0, 1.0), (2.0, -1.0), (1.0, 1.0), (1.0, -1.0))
_CLIPS, _CLIP = 300, 0.95
_FORM = "WORD SECONDS and where wanted size=... width=... low=... high=..."
LONGEST = 36_000.0


@dataclass(frozen=True)
class Segment:
    """One input, and the rest until the next begins.

    Attributes
    ----------
    kind : str
        A word of `KINDS`.
    duration : float
        Until the next segment begins [s]; after the input nothing is done.
    size : float
        Multiplies the aircraft's amplitude; negative: reversed [1].
    width : float
        Of one pulse [s]; 0: the aircraft's for a 3-2-1-1, else 1 s.
    low, high : float
        Frequencies of sweeps and multisines [Hz].

    Raises
    ------
    PlantError
        At construction, for an unknown word or a number out of range.
    """

    kind: str
    duration: float
    size: float = 1.0
    width: float = 0.0
    low: float = 0.1
    high: float = 2.0

    def __post_init__(self) -> None:
        """Refuse what is no input."""
        if self.kind not in KINDS:
            close = difflib.get_close_matches(self.kind, KINDS, 1)
            hint = f"'{close[0]}', or another of " if close else "one of "
            message = f"manoeuvre '{self.kind}': expected {hint}{', '.join(KINDS)}"
            raise PlantError(message)
        ranges = {"duration": (0.1, LONGEST), "size": (-10.0, 10.0), "width": (0.0, 60.0), "low": (1e-3, 50.0)}
        for name, (least, most) in ranges.items():
            if not least <= getattr(self, name) <= most:
                message = f"manoeuvre {self.kind}: {name} {getattr(self, name):g}: expected {least:g} to {most:g}"
                raise PlantError(message)
        if not self.low < self.high <= 50.0:
            message = f"manoeuvre {self.kind}: high {self.high:g} Hz: expected more than low, {self.low:g}, up to 50"
            raise PlantError(message)

    @classmethod
    def parse(cls, text: str) -> Segment:
        """Read ``elevator_doublet 12 size=0.7 width=1.0``.

        Raises
        ------
        PlantError
            For a line that is none.
        """
        words = text.split()
        names = [one.name for one in fields(cls)][2:]
        if len(words) < 2:
            message = f"manoeuvre '{text}': expected {_FORM}"
            raise PlantError(message)
        numbers = {"duration": words[1]}
        for word in words[2:]:
            name, equals, value = word.partition("=")
            if not equals or name not in names or name in numbers:
                message = f"manoeuvre '{text}': '{word}': expected {_FORM}"
                raise PlantError(message)
            numbers[name] = value
        try:
            return cls(words[0], **{name: float(value) for name, value in numbers.items()})
        except ValueError as error:
            if isinstance(error, PlantError):
                raise
            message = f"manoeuvre '{text}': expected numbers: {_FORM}"
            raise PlantError(message) from error

    def __str__(self) -> str:
        """Write the line that `parse` reads."""
        rest = (f"{one.name}={getattr(self, one.name)!r}" for one in fields(self)[2:])
        return f"{self.kind} {self.duration!r} {' '.join(rest)}"


@dataclass(frozen=True)
class FlightTest:
    """A sequence of segments, as a manoeuvre of a pilot.

    Attributes
    ----------
    segments : tuple of Segment
        In order; afterwards nothing is done.
    airframe : Airframe
        Gives axes, amplitudes and the width of a pulse.
    scale : float
        Multiplies every size.
    """

    segments: tuple[Segment, ...]
    airframe: Airframe
    scale: float = 1.0

    @property
    def duration(self) -> float:
        """Of all segments [s]."""
        return sum(segment.duration for segment in self.segments)

    def roll_rate(self, time: float) -> float:
        """Commanded roll rate [rad/s]: none, the inputs go to the effectors."""
        return 0.0

    def active(self, time: float) -> bool:
        """Whether a roll input is being made at a time [s]."""
        return self.stick(time)[ROLL] != 0.0

    def alpha_offset(self, time: float) -> float:
        """Angle of attack wanted, less that of the trim [rad]: none."""
        return 0.0

    def stick(self, time: float) -> tuple[float, float, float]:
        """Return the pilot's own inputs on pitch, roll and yaw effector [rad] at a time [s]."""
        segment, since = self._at(time)
        result = [0.0, 0.0, 0.0]
        if segment is not None and segment.kind != "multisine":
            axis = ROLL if segment.kind == "bank_to_bank" else _AXES.get(segment.kind.split("_")[0], PITCH)
            shape = _shape(segment, since, self.airframe.pulse)
            result[axis] = self.scale * segment.size * shape * self.airframe.amplitudes[axis]
        return result[0], result[1], result[2]

    @property
    def injects(self) -> bool:
        """Whether a computer adds to the effectors in any segment."""
        return any(segment.kind == "multisine" for segment in self.segments)

    def injected(self, time: float) -> Array:
        """Return what a computer adds to the effectors (m,) [rad] at a time [s]: the multisines."""
        segment, since = self._at(time)
        airframe = self.airframe
        m = len(airframe.effectors)
        if segment is None or segment.kind != "multisine":
            return np.zeros(m)
        sines = multisines(m, segment.duration, segment.low, segment.high)
        smallest = min(airframe.amplitudes)
        by_axis = dict(zip(airframe.axes, airframe.amplitudes, strict=True))
        sizes = np.array([by_axis.get(name, smallest) for name in airframe.effectors])
        values = np.array([sine.at(since) / sine.peak for sine in sines])
        return np.asarray(self.scale * segment.size * sizes * values)

    def _at(self, time: float) -> tuple[Segment | None, float]:
        since = time
        for segment in self.segments:
            if since < segment.duration - 1e-9:
                return (segment if since >= 0.0 else None), since
            since -= segment.duration
        return None, 0.0


def parse_manoeuvre(text: str, airframe: Airframe, scale: float = 1.0) -> Manoeuvre:
    """Read a manoeuvre: a name of `MANOEUVRES`, or segments separated by semicolons; a doublet's rate is scaled, too.

    Raises
    ------
    PlantError
        For a text that is neither.
    """
    if text in MANOEUVRES:
        named = MANOEUVRES[text]
        return replace(named, rate=scale * named.rate) if isinstance(named, RollDoublet) and scale != 1.0 else named
    parts = [part for part in text.split(";") if part.strip()]
    if len(parts) == 1 and len(parts[0].split()) == 1:
        close = difflib.get_close_matches(text, (*MANOEUVRES, *KINDS), 1)
        hint = f"'{close[0]}', or " if close else ""
        message = f"manoeuvre '{text}': expected {hint}one of {', '.join(MANOEUVRES)}, or segments: {_FORM}"
        raise PlantError(message)
    test = FlightTest(tuple(Segment.parse(part) for part in parts), airframe, scale)
    for segment in test.segments:
        if segment.kind == "multisine":
            multisines(len(airframe.effectors), segment.duration, segment.low, segment.high)
    return test


def _shape(segment: Segment, since: float, pulse: float) -> float:
    """Return an input of size 1 at a time since its beginning [s]."""
    kind = segment.kind.rpartition("_")[2]
    if kind == "quiet":
        return 0.0
    if kind == "sweep":
        rate = (segment.high - segment.low) / segment.duration
        return math.sin(2.0 * math.pi * (segment.low + 0.5 * rate * since) * since)
    width = segment.width or (pulse if kind == "3211" else 1.0)
    pulses = {"3211": _PULSES, "doublet": ((1.0, 1.0), (1.0, -1.0))}.get(kind)
    if pulses is None:
        pulses, width = tuple((length, (-1.0) ** i) for i, length in enumerate(BANKS)), segment.width or 1.0
    for length, sign in pulses:
        if since < length * width - 1e-9:
            return sign
        since -= length * width
    return 0.0


@dataclass(frozen=True)
class Multisine:
    """A sum of harmonics of one duration, of equal power.

    Attributes
    ----------
    duration : float
        Of one period of the lowest possible harmonic [s].
    harmonics : tuple of int
        Which, of 1 / duration.
    phases : tuple of float
        One of each [rad].
    peak : float
        Largest absolute value.
    """

    duration: float
    harmonics: tuple[int, ...]
    phases: tuple[float, ...]
    peak: float

    def at(self, time: float) -> float:
        """Return the sum at a time [s]."""
        turn = 2.0 * math.pi * time / self.duration
        return math.fsum(math.cos(k * turn + phase) for k, phase in zip(self.harmonics, self.phases, strict=True))


@cache
def multisines(number: int, duration: float, low: float, high: float) -> tuple[Multisine, ...]:
    """Return orthogonal multisines: harmonics dealt out by turns, phases of Schroeder, then of least peak factor.

    Parameters
    ----------
    number : int
        How many.
    duration : float
        Of the segment [s].
    low, high : float
        Frequencies [Hz].

    Raises
    ------
    PlantError
        If the duration has too few harmonics between the frequencies.
    """
    first, last = math.ceil(low * duration), math.floor(high * duration)
    if last - first + 1 < 2 * number:
        message = (
            f"multisine of {duration:g} s from {low:g} to {high:g} Hz: {max(last - first + 1, 0)} harmonics; expected "
            f"at least two for each of {number} effectors: a longer segment or a wider band"
        )
        raise PlantError(message)
    return tuple(_optimised(duration, tuple(range(first + i, last + 1, number))) for i in range(number))


def _optimised(duration: float, harmonics: tuple[int, ...]) -> Multisine:
    """Return the multisine of least peak factor that clipping finds, moved so that it begins at a zero."""
    n = len(harmonics)
    phases = -math.pi * np.arange(n) * np.arange(1, n + 1) / n
    size = 16 * (harmonics[-1] + 1)
    best, lowest = phases, math.inf
    for _ in range(_CLIPS):
        wave = _wave(harmonics, phases, size)
        factor = peak_factor(wave)
        if factor < lowest:
            best, lowest = phases, factor
        limit = _CLIP * np.abs(wave).max()
        spectrum = np.fft.rfft(np.clip(wave, -limit, limit))
        phases = np.angle(spectrum[list(harmonics)])
    wave = _wave(harmonics, best, size)
    zero = int(np.flatnonzero((wave[:-1] <= 0.0) & (wave[1:] > 0.0))[0])
    part = -wave[zero] / (wave[zero + 1] - wave[zero])
    turned = best + 2.0 * math.pi * np.array(harmonics) * (zero + part) / size
    return Multisine(duration, harmonics, tuple(turned.tolist()), float(np.abs(wave).max()))


def _wave(harmonics: Sequence[int], phases: Array, size: int) -> Array:
    spectrum = np.zeros(size // 2 + 1, complex)
    spectrum[list(harmonics)] = 0.5 * size * np.exp(1j * phases)
    return np.fft.irfft(spectrum, size)


def peak_factor(wave: Array) -> float:
    """Return the relative peak factor, 1 for a single sine: half the range over the root of two times the rms."""
    return float((wave.max() - wave.min()) / (2.0 * math.sqrt(2.0) * np.sqrt(np.mean(wave**2))))
