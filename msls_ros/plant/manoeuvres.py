"""What the pilot does with the stick: roll rates, and angles of attack about that of the trim."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Protocol


class Manoeuvre(Protocol):
    """Roll and angle-of-attack commands over time."""

    def roll_rate(self, time: float) -> float:
        """Commanded roll rate about the velocity vector [rad/s] at a time [s]."""

    def active(self, time: float) -> bool:
        """Whether the roll stick is in use at a time [s]; otherwise the pilot levels the wings."""

    def alpha_offset(self, time: float) -> float:
        """Angle of attack wanted at a time [s], less that of the trim [rad]."""


@dataclass(frozen=True)
class RollDoublet:
    """A roll stick doublet: one way, the other way, back to trim. The default is the paper's two-pound doublet.

    Attributes
    ----------
    rate : float
        Commanded roll rate [rad/s].
    start, middle, end : float
        When the stick goes right, left and back [s].
    """

    rate: float = math.radians(6.0)
    start: float = 1.0
    middle: float = 5.0
    end: float = 9.0

    def roll_rate(self, time: float) -> float:
        """Commanded roll rate about the velocity vector [rad/s] at a time [s]."""
        if not self.active(time):
            return 0.0
        return self.rate if time < self.middle else -self.rate

    def active(self, time: float) -> bool:
        """Whether the stick is in use at a time [s]."""
        return self.start <= time < self.end

    def alpha_offset(self, time: float) -> float:
        """Angle of attack wanted at a time [s], less that of the trim [rad]: none."""
        return 0.0


@dataclass(frozen=True)
class Steady:
    """No manoeuvre: the pilot holds the trim."""

    def roll_rate(self, time: float) -> float:
        """Commanded roll rate about the velocity vector [rad/s] at a time [s]: none."""
        return 0.0

    def active(self, time: float) -> bool:
        """Whether the stick is in use at a time [s]: never."""
        return False

    def alpha_offset(self, time: float) -> float:
        """Angle of attack wanted at a time [s], less that of the trim [rad]: none."""
        return 0.0


@dataclass(frozen=True)
class StrongManoeuvre:
    """Roll doublets without end over a slow sine of the angle of attack: it takes a linear model out of its range.

    A doublet is half a period one way, half the other; then the wings are levelled. Every second doublet begins to the
    left, so that the heading stays.

    Attributes
    ----------
    rate : float
        Commanded roll rate [rad/s].
    start : float
        When the first doublet and the sine begin [s].
    half : float
        Duration of each half of a doublet [s].
    pause : float
        From the end of a doublet to the start of the next [s].
    alpha : float
        Amplitude of the commanded sine of the angle of attack [rad].
    alpha_mean : float
        Its mean, less the trim [rad]: below it, for the aerodynamic tables end 6.5 deg above the high-alpha trim.
    alpha_period : float
        Its period [s].
    """

    rate: float = math.radians(20.0)
    start: float = 1.0
    half: float = 2.0
    pause: float = 4.0
    alpha: float = math.radians(3.0)
    alpha_mean: float = math.radians(-0.5)
    alpha_period: float = 5.0

    def roll_rate(self, time: float) -> float:
        """Commanded roll rate about the velocity vector [rad/s] at a time [s]."""
        if not self.active(time):
            return 0.0
        number, since = divmod(time - self.start, 2.0 * self.half + self.pause)
        first = since < self.half
        return self.rate if first == (number % 2.0 == 0.0) else -self.rate

    def active(self, time: float) -> bool:
        """Whether the roll stick is in use at a time [s]."""
        return time >= self.start and (time - self.start) % (2.0 * self.half + self.pause) < 2.0 * self.half

    def alpha_offset(self, time: float) -> float:
        """Angle of attack wanted at a time [s], less that of the trim [rad]."""
        if time < self.start:
            return 0.0
        return self.alpha_mean + self.alpha * math.sin(2.0 * math.pi * (time - self.start) / self.alpha_period)


MANOEUVRES: Mapping[str, Manoeuvre] = MappingProxyType(
    {"roll_doublet": RollDoublet(), "steady": Steady(), "strong": StrongManoeuvre()}
)
"""The manoeuvres that ship, by name."""
