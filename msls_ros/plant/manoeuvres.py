"""What the pilot does with the roll stick."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol


class Manoeuvre(Protocol):
    """A roll command over time."""

    def roll_rate(self, time: float) -> float:
        """Commanded roll rate about the velocity vector [rad/s] at a time [s]."""

    def active(self, time: float) -> bool:
        """Whether the stick is in use at a time [s]; otherwise the pilot levels the wings."""


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


@dataclass(frozen=True)
class Steady:
    """No manoeuvre: the pilot holds the trim."""

    def roll_rate(self, time: float) -> float:
        """Commanded roll rate about the velocity vector [rad/s] at a time [s]: none."""
        return 0.0

    def active(self, time: float) -> bool:
        """Whether the stick is in use at a time [s]: never."""
        return False
