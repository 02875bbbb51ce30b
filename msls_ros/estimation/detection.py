"""Detection of abrupt changes: the prediction error of each row against its own recent past (eqs 18-19).

The change statistic of row q is ``short/long``, where ``long`` is the mean of N past values of ``nu`` and ``short`` the
mean of the last ``m`` values including this one (m = 1 in eqs 18-19), ``nu = |e|`` or, normalised, ``|e|/sqrt(1 + d)``
with ``d = phi' P phi``. ``long`` never counts as less than ``floor/threshold``, where the floor is the smallest
prediction error worth a reset: the largest of an absolute one, a share of the slow rms of the output, and a share of
what the model's terms add up to::

    floor = max( floor_absolute, floor_relative rms(y), floor_model sum_i |theta_i phi_i| )

After an alarm the window is emptied, and refilled after the hold-off; until it is full no alarm can come.
"""

from __future__ import annotations

import math

from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array, Integers
from msls_ros.estimation.state import Settings, State


@compiled
def sense_change(s: Settings, x: State, phi: Array, y: Array, e: Array, statistic: Array, alarm: Integers) -> bool:
    """Prediction errors (eq 11) and change statistics (eqs 18-19) of all rows; True where any row alarms."""
    any_alarm = False
    group = -1
    deviation = 1.0
    for q in range(y.shape[0]):
        theta = x.theta[q]
        predicted = 0.0
        for i in range(phi.shape[0]):
            predicted += theta[i] * phi[i]
        e[q] = y[q] - predicted
        statistic[q] = 0.0
        alarm[q] = 0
        if not s.detect:
            continue
        nu = abs(e[q])
        floor = error_floor(s, x, q, phi)
        if s.normalised:
            if x.group[q] != group:
                group = x.group[q]
                deviation = prior_deviation(s, x, group, phi)
            nu /= deviation
            floor /= deviation
        statistic[q] = change_statistic(s, x, q, nu, floor)
        if statistic[q] > s.threshold:
            alarm[q] = 1
            any_alarm = True
        else:
            remember_error(x, q, nu)
    return any_alarm


@compiled
def error_floor(s: Settings, x: State, q: int, phi: Array) -> float:
    """Smallest prediction error of row q worth a reset: the largest of three terms.

    An absolute one, a share of the slow rms of the output, and a share of what the model's terms add up to.
    """
    floor = float(s.floor_absolute[q])
    relative = s.floor_relative * math.sqrt(x.y_ms[q])
    if relative > floor:
        floor = relative
    if s.floor_model > 0.0:
        total = 0.0
        for i in range(phi.shape[0]):
            total += abs(x.theta[q, i] * phi[i])
        if s.floor_model * total > floor:
            floor = s.floor_model * total
    return floor


@compiled
def prior_deviation(s: Settings, x: State, g: int, phi: Array) -> float:
    """Return ``sqrt(1 + d)``, ``d = phi' P phi``: the predicted deviation of a prediction error over the residual's."""
    d = 1.0
    for i in range(phi.shape[0]):
        row = x.P[g, 0, i]
        total = 0.0
        for k in range(phi.shape[0]):
            total += row[k] * phi[k]
        d += phi[i] * total
    return math.sqrt(d) if d > 1.0 else 1.0


@compiled
def change_statistic(s: Settings, x: State, q: int, nu: float, floor: float) -> float:
    """Return the change statistic of row q (eqs 18-19): short/long, or 0 while the detector is not armed.

    Parameters
    ----------
    s, x
        Settings and state.
    q
        Row.
    nu
        This sample's (normalised) absolute prediction error.
    floor
        Smallest value of ``short`` worth an alarm.
    """
    size = x.ring.shape[1]
    if x.hold[q] > 0 or x.filled[q] < size:
        return 0.0
    ring = x.ring[q]
    long = 0.0
    for i in range(s.window):
        long += ring[i]
    long /= s.window
    short = nu
    for i in range(s.window, size):
        short += ring[i]
    short /= s.short
    least = floor / s.threshold
    if long < least:
        long = least
    return short / long if long > 0.0 else 0.0


@compiled
def remember_error(x: State, q: int, nu: float) -> None:
    """Push this sample's nu into row q's window, after the hold-off."""
    if x.hold[q] > 0:
        x.hold[q] -= 1
        return
    ring = x.ring[q]
    size = ring.shape[0]
    if x.filled[q] < size:
        ring[x.filled[q]] = nu
        x.filled[q] += 1
        return
    for i in range(size - 1):
        ring[i] = ring[i + 1]
    ring[size - 1] = nu
