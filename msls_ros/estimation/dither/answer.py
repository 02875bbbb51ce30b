"""What the dither law answers a sample with: commands, their level, and why."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import NamedTuple

from msls_ros.estimation.compiled import passed_by_reference
from msls_ros.estimation.kernel import Array, Integers


class Level(enum.IntEnum):
    """Level of the dither; the numbers are those of the message."""

    OFF = 0
    NOMINAL = 1
    BOOSTED = 2
    INHIBITED = 3


@dataclass(frozen=True)
class Dither:
    """The dither that answers one sample."""

    delta: Array
    """(m,) what to add to the commands [rad]."""
    rms: float
    """Wanted at the surfaces: common, before weights (``equal``), or the rms over the effectors (``information``)."""
    predicted_acceleration: float
    """At the station, by B-hat, what the actuators take away considered [g rms]; eq 23 for ``worst_case``."""
    acceleration_limit: float
    """Its limit at this level [g rms]."""
    level: Level
    reason: str


REASONS = (
    "dither is disabled",
    "no sample for longer than dither.stale_after",
    "B is not finite",
    "capped while B is not excited",
    "capped by dither.cap",
    "eq 23",
    "the estimator is frozen",
    "acceleration limit",
    "known to dither.target_error",
    "not flying",
    "held at zero, as the last second was felt as all that the acceleration limit allows",
)
DISABLED, GAP, NOT_FINITE, NOT_EXCITED, CAPPED, EQUATION_23, FROZEN, ACCELERATION, KNOWN, NOT_FLYING, HELD_AT_ZERO = (
    range(len(REASONS))
)


@passed_by_reference
class DitherBlock(NamedTuple):
    """The dithers that answer n samples, m effectors."""

    delta: Array
    """(n, m) what to add to the commands [rad]."""
    rms: Array
    predicted_acceleration: Array
    acceleration_limit: Array
    level: Integers
    reason: Integers
    """(n,) index into `REASONS`."""

    def at(self, k: int) -> Dither:
        """Return the dither that answers sample k."""
        return Dither(
            self.delta[k],
            self.rms.item(k),
            self.predicted_acceleration.item(k),
            self.acceleration_limit.item(k),
            Level(self.level.item(k)),
            REASONS[self.reason.item(k)],
        )
