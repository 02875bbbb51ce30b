"""The mixer between flight-control stack and actuators: the stack's command, with dither added while that is safe.

For every effector, with command c, dither d, and the output y' of the command before::

    y = clip(c + scale d,  min(c, max(low, y' - rate dt)),  max(c, min(high, y' + rate dt)))

so the dither never takes an actuator past its position limits nor moves it faster than its rate limit, unless the
stack's own command does; and then never further. Whenever the dither is not valid the output is the stack's command,
bit for bit:

==========================  ==================================================================
master switch off           `Mixer.enabled` is False
no dither, or too old       none taken within ``stale_after`` of the command
level off or inhibited      the identifier says so
not finite, wrong length    refused by `Mixer.take`; the one before counts no more
beyond its authority        the same
command not finite          passed on as it is
==========================  ==================================================================
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from msls_ros.estimation.dither.answer import Level
from msls_ros.estimation.errors import EstimationError
from msls_ros.estimation.kernel import Array


@dataclass(frozen=True)
class MixerLimits:
    """What the dither may do, per effector; empty: no limit. In the units of the command."""

    authority: Sequence[float] = ()
    """Largest size of the dither."""
    low: Sequence[float] = ()
    high: Sequence[float] = ()
    """Positions."""
    rate: Sequence[float] = ()
    """[per second]"""
    stale_after: float = 0.1
    """Age of a dither after which it is not added [s]."""


class Mixed(NamedTuple):
    """An output."""

    command: Array
    """(m,) for the actuators, in the units of the command."""
    mixed: bool
    """Whether dither was considered; False: ``command`` is the stack's own, bit for bit."""
    reason: str
    """Why not; empty where it was."""


class Mixer:
    """Add dither to commands; see the module.

    Parameters
    ----------
    effectors
        How many.
    limits
        See `MixerLimits`.
    scale
        Units of the command per radian of dither, per effector, with its sign; empty: all 1.

    Raises
    ------
    EstimationError
        For limits that are not one per effector, not finite where given, or contradict each other.
    """

    def __init__(self, effectors: int, limits: MixerLimits | None = None, scale: Sequence[float] = ()) -> None:
        """Hold no dither yet; see the class."""
        limits = limits or MixerLimits()
        self.enabled = True
        """The master switch."""
        self._count = effectors
        self._scale = _each("scale", scale, effectors, 1.0)
        self._authority = _each("authority", limits.authority, effectors, math.inf)
        self._low = _each("low", limits.low, effectors, -math.inf)
        self._high = _each("high", limits.high, effectors, math.inf)
        self._rate = _each("rate", limits.rate, effectors, math.inf)
        if (self._low > self._high).any() or (self._authority < 0.0).any() or (self._rate < 0.0).any():
            message = "mixer: expected low <= high, and authority and rate of 0 or more, for every effector"
            raise EstimationError(message)
        self._stale_after = limits.stale_after
        self._reason = "no dither yet"
        self._dither: Array | None = None
        self._taken = -math.inf
        self._last: tuple[float, Array] | None = None

    def take(self, now: float, delta: Sequence[float] | Array, level: int) -> str:
        """Take a dither.

        Parameters
        ----------
        now
            When it became valid, on the clock of `mix` [s].
        delta
            (m,) what to add [rad].
        level
            See `Level`.

        Returns
        -------
        str
            Why it is not to be added; empty where it is.
        """
        self._dither, self._taken = None, now
        dither = np.asarray(delta, dtype=np.float64)
        if level in (Level.OFF, Level.INHIBITED):
            self._reason = f"the dither is {Level(level).name.lower()}"
        elif dither.shape != (self._count,):
            self._reason = f"the dither has {dither.size} values; expected {self._count}"
        elif not np.isfinite(dither).all():
            self._reason = "the dither is not finite"
        else:
            scaled = self._scale * dither
            if (np.abs(scaled) > self._authority).any():
                j = int(np.argmax(np.abs(scaled) - self._authority))
                self._reason = f"the dither of effector {j} is {scaled[j]:g}; its authority is {self._authority[j]:g}"
            else:
                self._reason, self._dither = "", scaled
        return self._reason

    def drop(self, reason: str) -> None:
        """Add nothing until the next dither is taken."""
        self._dither, self._reason = None, reason

    def age(self, now: float) -> float:
        """Return how old the last dither is [s]; infinite before the first."""
        return now - self._taken

    def mix(self, now: float, command: Array) -> Mixed:
        """Return the output for a command.

        Parameters
        ----------
        now
            [s]
        command
            (m,) of the stack.
        """
        reason = self._why_not(now, command)
        before, self._last = self._last, (now, command)
        if reason or self._dither is None:
            return Mixed(command, False, reason)
        low, high = self._low, self._high
        if before is not None:
            reach = np.full(self._count, math.inf)  # where there is no limit: infinite times no time is not a number
            np.multiply(self._rate, max(now - before[0], 0.0), out=reach, where=np.isfinite(self._rate))
            low, high = np.maximum(low, before[1] - reach), np.minimum(high, before[1] + reach)
        output = np.minimum(np.maximum(command + self._dither, np.minimum(command, low)), np.maximum(command, high))
        self._last = now, output
        return Mixed(output, True, "")

    def _why_not(self, now: float, command: Array) -> str:
        if not self.enabled:
            return "the master switch is off"
        if self._dither is None:
            return self._reason
        if not 0.0 <= self.age(now) <= self._stale_after:
            return f"the dither is {self.age(now):.2f} s old, more than {self._stale_after:g} s"
        if command.shape != (self._count,) or not np.isfinite(command).all():
            return "the command is not finite, or of the wrong length"
        if self._last is not None and not (
            self._last[1].shape == command.shape and np.isfinite(self._last[1]).all() and now >= self._last[0]
        ):
            self._last = None
        return ""


def _each(name: str, given: Sequence[float], count: int, default: float) -> Array:
    """Return a value per effector."""
    values = np.array(list(given) or [default] * count, dtype=np.float64)
    if values.shape != (count,) or (len(given) > 0 and not np.isfinite(values).all()):
        message = f"mixer: {name} is {list(given)}; expected {count} finite numbers, one per effector, or none"
        raise EstimationError(message)
    return values
