"""What goes into a control law and what it says beside its command."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from msls_ros.control.linear import Array, Flags
from msls_ros.estimation import Estimate, EventKind


@dataclass(frozen=True)
class PilotCommand:
    """What the pilot, or an outer loop, asks for."""

    roll_rate: float
    """About the velocity vector [rad/s]."""
    alpha: float = math.nan
    """Angle of attack [rad]; NaN: `pitch_rate` counts instead."""
    pitch_rate: float = 0.0
    """[rad/s]"""
    beta: float = 0.0
    """Sideslip [rad]."""
    stack: Array | None = None
    """(m,) deflections that the stack's own, fixed law commands for this sample [rad]; None: there is none."""

    @property
    def usable(self) -> bool:
        """Whether a law can follow it."""
        return all(map(math.isfinite, (self.roll_rate, self.pitch_rate, self.beta))) and not math.isinf(self.alpha)


@dataclass(frozen=True)
class ModelEstimate:
    """The identified model, as far as control needs it; rows and columns in the order of the states and effectors."""

    time: float
    """Of the sample after which it stood [s]."""
    a: Array
    b: Array
    a_std: Array
    b_std: Array
    """Standard errors; infinite or NaN where nothing is known."""
    alarm: bool = False
    """Whether an abrupt change was found since the last one."""

    @classmethod
    def of(cls, estimate: Estimate) -> ModelEstimate:
        """Take what is needed from an estimate."""
        alarm = any(event.kind == EventKind.DETECTED for event in estimate.events)
        return cls(estimate.time, estimate.a, estimate.b, estimate.a_std, estimate.b_std, alarm)


@dataclass(frozen=True)
class Margins:
    """Stability margins predicted of the believed model; what the model does not know is not in them.

    The smallest over the loops, each opened with the others closed.
    """

    gain: float = math.nan
    """Factor on the effectiveness, above 1, at which the loop becomes unstable; infinite: none does."""
    reduction: float = math.nan
    """The same below 1; 0: none does."""
    phase: float = math.nan
    """[rad]"""
    delay: float = math.nan
    """Additional delay at which the loop becomes unstable [s]."""


@dataclass(frozen=True)
class Status:
    """What a law did with a sample; s surfaces."""

    time: float
    """[s]"""
    law: str
    """The law that flew: fixed, indi, lq or hold."""
    reason: str
    """Why this one, and what it did without; a sentence for people."""
    design_age: float
    """Since the model that is flown was taken from an estimate [s]; infinite: it is the prior's."""
    effectiveness: Array
    """(s,) believed effect of each surface over that of the prior [1]; without a prior over its own largest so far."""
    effectiveness_std: Array
    """(s,) its standard error."""
    stuck: Flags
    """(s,) whether the surface's actuator does not follow."""
    saturated: Flags
    """(s,) whether the surface is commanded to a limit."""
    wanted: Array
    """(3,) angular acceleration asked for [rad/s^2], roll, pitch, yaw."""
    unmet: Array
    """(3,) of it what the surfaces cannot give."""
    margins: Margins = field(default_factory=Margins)
    handover: float = 0.0
    """Largest difference between what flies and what the law in use alone would command [rad]: a hand-over's fade."""
