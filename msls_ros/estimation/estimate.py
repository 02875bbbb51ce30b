"""What the identifier says: the linear model with error bars, fault events, the dither."""

from __future__ import annotations

import enum
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from msls_ros.estimation.dither.answer import Dither
from msls_ros.estimation.kernel import Array

Flags = NDArray[np.bool_]


class EventKind(enum.IntEnum):
    """Kind of a fault event; the numbers are those of the message."""

    DETECTED = 1
    ISOLATED = 2
    RECOVERED = 3
    RESET = 4


@dataclass(frozen=True)
class FaultEvent:
    """An abrupt change: found, attributed, or over; or numbers that ended the estimate, which begins anew."""

    time: float
    """Of the sample at which it was found [s]."""
    kind: EventKind
    equations: tuple[str, ...]
    """Names of the states whose derivative equation it concerns."""
    statistic: tuple[float, ...]
    threshold: tuple[float, ...]
    suspected_effector: str = ""
    effectiveness: float = float("nan")
    """Now over before [1]."""
    effectiveness_std: float = float("nan")
    description: str = ""


@dataclass(frozen=True)
class Estimate:
    """The model ``xdot = A x + B delta + bias`` after a sample (eq 24); n states, m effectors, p regressors, r rows."""

    time: float
    """Of the last sample used [s]."""
    states: tuple[str, ...]
    effectors: tuple[str, ...]
    a: Array
    """(n, n) [state per second per state]."""
    b: Array
    """(n, m) [state per second per rad]."""
    bias: Array
    """(n,) [state per second]."""
    a_std: Array
    """(n, n) standard errors; 0 where known."""
    b_std: Array
    """(n, m) standard errors; 0 where known to be zero (kinematic rows)."""
    a_known: Flags
    """(n, n) filled in from physics."""
    a_reliable: Flags
    b_reliable: Flags
    a_best: Array
    """(n, n) the best that was known of A, of the bank: it may not be excited now; NaN where nothing is kept."""
    b_best: Array
    """(n, m)"""
    a_best_std: Array
    """(n, n) their standard errors then."""
    b_best_std: Array
    a_best_time: Array
    """(n, n) and when that was [s]."""
    b_best_time: Array
    regressors: tuple[str, ...]
    excitation: Array
    """(p,) least over the groups of rows: share of the parameter that the data decide [1]."""
    residual_std: Array
    """(n,) [state per second]; NaN where the equation is known."""
    forgetting_factor: Array
    """(n,) lambda per equation [1]; NaN where the equation is known."""
    delay: float
    """By how much responses come after deflections, as found in flight: A and B hold for the deflections of so long
    ago; negative: deflections are recorded late, and states and outputs held back [s]."""
    delay_std: float
    """Its standard error [s]; NaN where none is looked for (msls, rls)."""
    lag: float
    """Time constant of the first-order lag between recorded deflections and those that act, as found in flight: A and B
    hold for what comes out of it; 0: none [s]."""
    state_delay: Array
    """(n,) by how much velocities come after their derivatives, as found in flight and put right; 0: none is certain
    [s]."""
    samples: int
    """Samples since the last reset, those that were not learnt from too (see `screening`)."""
    prediction_error: Array
    """(r,) of the last sample, before its update [state per second]."""
    statistic: Array
    """(r,) change statistic of the last sample; 0 while the detector is not armed."""
    events: tuple[FaultEvent, ...]
    """Events since the last estimate."""
    dither: Dither
    """The dither that answers the last sample."""
