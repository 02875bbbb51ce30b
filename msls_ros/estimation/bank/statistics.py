"""The statistics of `bank.detection`: last prediction errors against the usual ones, by squares and by means."""

from __future__ import annotations

from msls_ros.estimation.bank.loop_settings import BankSettings
from msls_ros.estimation.bank.state import BankState
from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.elementary import exponential
from msls_ros.estimation.kernel import Array
from msls_ros.estimation.regressor_noise import OVERLAP

RESOLUTION = 1e-10
"""Square of the change that counts at least [(m/s^2)^2, (rad/s^2)^2]: of 1 micro-g, the best that a sensor resolves.

A simulated aircraft in trim has no residual but that of arithmetic, which changes.
"""
UNKNOWN = 60.0
"""Exponent beyond which a quantile of Student's t is as good as infinite: next to nothing is known of the variance."""


@compiled
def change_of(
    s: BankSettings, x: BankState, q: int, surprise: float, moved: float, unknown: float, past: Array
) -> float:
    """Return the statistic of row q, armed, with the squared error of now and what the motion of now allows of it.

    ``past`` (w,) is what it allowed in the samples before. The error of an estimate is the same in all samples of a
    window, it does not average: its quantile is that of one.
    """
    size = x.ring.shape[1]
    total = surprise
    allowed = moved
    taken = 1
    largest = 0.0
    usual = x.base[q, 2] / x.base[q, 1]
    floor = s.floor * s.floor * x.remembered[q] + RESOLUTION
    for i in range(s.windows.shape[0]):
        while taken < s.windows[i]:
            slot = (x.counted[q] - taken) % size
            total += x.surprise[q, slot]
            allowed += past[slot]
            taken += 1
        nominal = max(usual, allowed / s.windows[i]) + floor
        limit = nominal * s.quantiles[q, i] + unknown * s.quantiles[q, 0]
        if total > largest * limit * s.windows[i]:
            largest = total / s.windows[i] / limit if limit > 0.0 else 0.0
    return largest


@compiled
def mean_change_of(s: BankSettings, x: BankState, q: int, signed: float, moved: float, unknown: float) -> float:
    """Return the statistic of the mean prediction errors of row q, armed and of a rate, with the one of now."""
    size = x.ring.shape[1]
    total = signed
    allowed = moved
    taken = 1
    largest = 0.0
    floor = s.floor * s.floor * x.remembered[q] + RESOLUTION
    sums = x.mean_base[q]
    for i in range(1, s.windows.shape[0]):
        while taken < s.windows[i]:
            slot = (x.counted[q] - taken) % size
            total += x.signed[q, slot]
            allowed += x.allowed[q, slot]
            taken += 1
        mean = total / s.windows[i]
        free = OVERLAP * sums[0] * sums[0] / sums[1] / s.windows[i]
        noise = student_square(s.quantiles[q, 0], free) * sums[i + 2] / sums[0]
        model = s.quantiles[q, i] * (allowed / s.windows[i])
        nominal = max(noise, model) + s.quantiles[q, i] * floor + s.quantiles[q, 0] * unknown
        if mean * mean > largest * nominal:
            largest = mean * mean / nominal if nominal > 0.0 else 0.0
    return largest


@compiled
def student_square(square: float, free: float) -> float:
    """Return the quantile of the square of Student's t where that of a normal variable is ``square`` (Wallace)."""
    ratio = (8.0 * free + 3.0) / (8.0 * free + 1.0)
    return free * (exponential(min(square * ratio * ratio / free, UNKNOWN)) - 1.0)


@compiled
def remember_mean(s: BankSettings, x: BankState, q: int, signed: float) -> None:
    """Push a prediction error of a rate's row into its window; means that leave it enter the usual ones."""
    size = x.ring.shape[1]
    slot = x.counted[q] % size
    sums = x.mean_base[q]
    if x.counted[q] >= size:
        sums[0] = s.mean_forgetting * sums[0] + 1.0
        sums[1] = s.mean_forgetting * s.mean_forgetting * sums[1] + 1.0
        for i in range(1, s.windows.shape[0]):
            sums[i + 2] = s.mean_forgetting * sums[i + 2] + x.mean_square[q, i, slot]
    x.signed[q, slot] = signed
    total = signed
    taken = 1
    for i in range(1, s.windows.shape[0]):
        while taken < s.windows[i]:
            total += x.signed[q, (x.counted[q] - taken) % size]
            taken += 1
        mean = total / s.windows[i]
        x.mean_square[q, i, slot] = mean * mean


@compiled
def remember_square(
    s: BankSettings, x: BankState, q: int, square: float, smaller: float, surprise: float, moved: float
) -> None:
    """Push a squared error into row q's window, after the rest; what leaves it enters the nominal one."""
    if x.counted[q] < 0:
        x.counted[q] += 1
        return
    size = x.ring.shape[1]
    slot = x.counted[q] % size
    if slot == 0:
        for i in range(x.square.shape[1]):
            x.square_past[1, q, i] = x.square_past[0, q, i]
            x.square_past[0, q, i] = x.square_moved[q, i]
    if x.counted[q] >= size:
        x.base[q, 0] = s.base * x.base[q, 0] + x.ring[q, slot]
        x.base[q, 1] = s.base * x.base[q, 1] + 1.0
        x.base[q, 2] = s.base * x.base[q, 2] + x.smaller[q, slot]
    x.smaller[q, slot] = smaller
    x.ring[q, slot] = square
    x.surprise[q, slot] = surprise
    x.allowed[q, slot] = moved
    x.counted[q] += 1
