"""How a flight followed what the pilot asked for: kept or departed, errors, time to recover."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
PHI = 6
ALPHA_LIMIT, BETA_LIMIT, RATE_LIMIT, BANK_LIMIT = (math.radians(one) for one in (8.0, 12.0, 75.0, 100.0))
"""Beyond any of these an aircraft has departed: error of angle of attack, sideslip, body rate, bank [rad, rad/s]."""
ALPHA_BAND, BETA_BAND, ROLL_BAND = (math.radians(one) for one in (1.0, 1.5, 2.0))
"""Within these a flight has recovered: error of angle of attack, sideslip, roll rate [rad, rad/s]."""
ROLL_LAG = 0.5
"""Of the roll rate that a flight is held against [s]."""


def departed(x: Array, alpha: float) -> str:
    """Return why an aircraft has departed; empty: it has not.

    Parameters
    ----------
    x
        (9,) true states.
    alpha
        Commanded angle of attack [rad].
    """
    speed = math.sqrt(float((x[:3] ** 2).sum()))
    error = math.degrees(math.atan2(x[2], x[0]) - alpha)
    beta, rate = math.degrees(math.asin(x[1] / max(speed, 1e-9))), math.degrees(float(np.abs(x[3:6]).max()))
    if abs(error) > math.degrees(ALPHA_LIMIT):
        return f"angle of attack {error:+.0f} deg from the command"
    if abs(beta) > math.degrees(BETA_LIMIT):
        return f"sideslip {beta:+.0f} deg"
    if rate > math.degrees(RATE_LIMIT):
        return f"body rate {rate:.0f} deg/s"
    bank = math.degrees(float(x[PHI]))
    return f"bank {bank:+.0f} deg" if abs(bank) > math.degrees(BANK_LIMIT) else ""


@dataclass(frozen=True)
class Tracking:
    """How a flight followed its commands, from the first fault on (from the start where there is none)."""

    kept: bool
    why: str
    """Why not."""
    departed_s: float | None
    """When [s]."""
    roll_rms: float
    """Error of the roll rate about the velocity vector [rad/s]."""
    alpha_rms: float
    beta_rms: float
    alpha_max: float
    beta_max: float
    """[rad]"""
    recovery_s: float
    """After the first fault, until all errors stay within the bands [s]; infinite for a flight that departed."""


class Flown(Protocol):
    """What is held against the commands: a `FlightLog`."""

    time: list[float]
    flown: list[Array]
    departed: str

    @property
    def asked_roll(self) -> Array:
        """Commanded roll rates (n,) [rad/s]."""

    @property
    def asked_alpha(self) -> Array:
        """Commanded angles of attack (n,) [rad]."""


def track(log: Flown, fault: float | None, period: float) -> Tracking:
    """Return how a flight went.

    Parameters
    ----------
    log
        What it left behind.
    fault
        When the first fault strikes [s]; None: nothing breaks.
    period
        Between samples [s].
    """
    time, x = np.array(log.time), np.array(log.flown)
    errors = tracking_errors(x, log.asked_roll, log.asked_alpha, period)
    roll, alpha, beta = errors
    after = time > (fault or 0.0) + 1e-6
    outside = after & ((np.abs(alpha) > ALPHA_BAND) | (np.abs(beta) > BETA_BAND) | (np.abs(roll) > ROLL_BAND))
    recovery = math.inf if log.departed else 0.0
    if not log.departed and outside.any():
        recovery = float(time[outside][-1] - (fault or 0.0))
    rms = [math.sqrt(float(np.mean(one[after] ** 2))) if after.any() else math.nan for one in errors]
    largest = [float(np.abs(one[after]).max()) if after.any() else math.nan for one in errors]
    return Tracking(
        kept=not log.departed,
        why=log.departed,
        departed_s=float(time[-1]) if log.departed else None,
        roll_rms=rms[0],
        alpha_rms=rms[1],
        beta_rms=rms[2],
        alpha_max=largest[1],
        beta_max=largest[2],
        recovery_s=recovery,
    )


def tracking_errors(x: Array, roll_rate: Array, alpha: Array, period: float) -> tuple[Array, Array, Array]:
    """Return the errors (n,) of roll rate, angle of attack and sideslip.

    Parameters
    ----------
    x
        (n, 9) true states.
    roll_rate, alpha
        (n,) commanded; the roll rate is held against the command behind a lag of `ROLL_LAG`.
    period
        Between samples [s].
    """
    a = np.arctan2(x[:, 2], x[:, 0])
    beta = np.arcsin(x[:, 1] / np.sqrt((x[:, :3] ** 2).sum(axis=1)))
    rolled = x[:, 3] * np.cos(a) + x[:, 5] * np.sin(a)
    return rolled - reference_of(roll_rate, period), a - alpha, beta


def reference_of(roll_rate: Array, period: float) -> Array:
    """Return commanded roll rates (n,) behind the lag of `ROLL_LAG`."""
    reference, share, now = np.zeros(len(roll_rate)), -math.expm1(-period / ROLL_LAG), 0.0
    for k, wanted in enumerate(roll_rate.tolist()):
        now += share * (wanted - now)
        reference[k] = now
    return reference
