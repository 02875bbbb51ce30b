"""The compiled loop over samples: groups of rows, change detection, recovery and residual statistics around the factor.

Rows (output equations) that share a history share one factor. An alarm (eqs 18-19) takes the alarmed rows out of their
group into a fresh one with ``R = 0``, ``omega = 0``, the estimate kept, the penalty lowered for ``2p`` samples and
ramped back over ``2p`` more. When what the two factors remember differently has been forgotten, the rows rejoin group
0.

The change statistic of row q is ``short/long``, where ``long`` is the mean of N past values of ``nu`` and ``short`` the
mean of the last ``m`` values including this one (m = 1 in eqs 18-19), ``nu = |e|`` or, normalised, ``|e|/sqrt(1 + d)``.
``long`` never counts as less than ``floor/threshold``, where the floor is the smallest prediction error worth a reset.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import (
    Array,
    Integers,
    Work,
    inverse_diagonal,
    make_work,
    msls_gain,
    propagate_covariance,
    rls_gain,
)

COLOURS = (0.0, 0.7, 0.9, 0.97, 0.995)
"""Coefficients of the AR(1) residuals for which the covariance is propagated; estimates in between are interpolated."""


class Settings(NamedTuple):
    """What the loop needs to know; p regressors, r rows, m colours."""

    rls: bool
    retained: bool
    forgetting: float
    penalty: Array
    """(p,) dimensionless penalty w."""
    scale: Array
    """(p,) configured scale of each regressor, in its units; W0 = w * scale."""
    auto_scale: bool
    rms_memory: float
    """Samples over which the slow rms of regressors and outputs is taken."""
    colours: Array
    """(m,) AR(1) coefficients; the first is 0."""
    residual_forgetting: float
    colour_forgetting: float
    prior: float
    """Initial parameter variance over residual variance, in units of 1/W0^2; for RLS in units of 1/scale^2."""
    detect: bool
    normalised: bool
    window: int
    short: int
    threshold: float
    """On short/long."""
    floor_absolute: Array
    """(r,) in units of the outputs."""
    floor_relative: float
    floor_model: float
    hold_off: int
    ease_start: bool
    """Treat the start like an alarm: lower the penalty while nothing is known."""
    recovery_penalty: float
    recovery_forgetting: float
    merge_after: int
    """Samples after the ramp until the rows rejoin group 0; negative: never."""
    effectors_from: int
    """Index of the first effector among the regressors."""
    effectors_to: int


class State(NamedTuple):
    """Everything that changes; g groups (group 0 always lives), p regressors, r rows, m colours."""

    R: Array
    """(g, p, p) data factors; for RLS the covariance."""
    omega: Array
    """(g, p) squared penalties."""
    P: Array
    """(g, m, p, p) parameter covariance over residual variance."""
    c: Array
    """(g, m, p) its covariance with the next residual."""
    u: Array
    """(g, m, p) its covariance with the last prediction error."""
    b: Array
    """(g, m) covariance of the residual and the last prediction error."""
    rho: Array
    """(g, p) excitation."""
    age: Integers
    """(g,) samples since the group began."""
    group: Integers
    """(r,) group of each row."""
    theta: Array
    """(r, p) the estimates."""
    ring: Array
    """(r, N+m-1) past values of nu."""
    filled: Integers
    """(r,) how many of them are valid."""
    hold: Integers
    """(r,) samples left of the hold-off."""
    e: Array
    """(r,) last prediction errors; NaN: none."""
    residual: Array
    """(r, m) weighted sum of e^2 over its predicted variance."""
    weight: Array
    """(r, 2) sum of the weights of residual; of colour."""
    colour: Array
    """(r, m, 3) weighted sums: normalised e^2, e e_last, predicted e e_last."""
    last: Array
    """(g, m) square root of the last predicted variance."""
    pending: Integers
    """(r,) 1 from an alarm of the row until it is settled what changed."""
    theta_before: Array
    """(r, p) the estimates before that alarm."""
    P_before: Array
    """(r, m, p, p) their covariance over residual variance."""
    y_ms: Array
    """(r,) slow mean square of the outputs."""
    phi_ms: Array
    """(p,) slow mean square of the regressors."""
    samples: Integers
    """(1,) samples since the last reset."""


class Output(NamedTuple):
    """What the loop says of each sample; n samples, r rows."""

    e: Array
    """(n, r) prediction errors before the update."""
    statistic: Array
    """(n, r) short/long; 0 where the detector is not armed."""
    alarm: Integers
    """(n, r) 1 where an abrupt change is declared."""
    effect: Array
    """(n, r) sum over the effectors of weight * |estimate| (eq 23)."""
    excitation: Array
    """(n,) least excitation of an effector in any group."""


def make_state(settings: Settings, rows: int) -> State:
    """Allocate a state for the settings; `clear` makes it valid."""
    p = settings.penalty.shape[0]
    m = settings.colours.shape[0]
    g = rows + 1
    return State(
        R=np.zeros((g, p, p)),
        omega=np.zeros((g, p)),
        P=np.zeros((g, m, p, p)),
        c=np.zeros((g, m, p)),
        u=np.zeros((g, m, p)),
        b=np.zeros((g, m)),
        rho=np.zeros((g, p)),
        age=np.zeros(g, np.int64),
        group=np.zeros(rows, np.int64),
        theta=np.zeros((rows, p)),
        ring=np.zeros((rows, settings.window + settings.short - 1)),
        filled=np.zeros(rows, np.int64),
        hold=np.zeros(rows, np.int64),
        e=np.zeros(rows),
        residual=np.zeros((rows, m)),
        weight=np.zeros((rows, 2)),
        colour=np.zeros((rows, m, 3)),
        last=np.zeros((g, m)),
        pending=np.zeros(rows, np.int64),
        theta_before=np.zeros((rows, p)),
        P_before=np.zeros((rows, m, p, p)),
        y_ms=np.zeros(rows),
        phi_ms=np.zeros(p),
        samples=np.zeros(1, np.int64),
    )


@compiled
def clear_group(s: Settings, x: State, g: int) -> None:
    """Forget all that group g knows: ``R = 0``, ``omega = 0``, the prior covariance."""
    p = x.theta.shape[1]
    x.age[g] = 0
    for i in range(p):
        w0 = s.penalty[i] * s.scale[i]
        variance = s.prior / (s.scale[i] * s.scale[i] if s.rls or w0 == 0.0 else w0 * w0)
        x.omega[g, i] = 0.0
        x.rho[g, i] = 0.0
        for k in range(p):
            x.R[g, i, k] = 0.0
        if s.rls:
            x.R[g, i, i] = s.prior / (s.scale[i] * s.scale[i])
        for m in range(s.colours.shape[0]):
            x.c[g, m, i] = 0.0
            x.u[g, m, i] = 0.0
            for k in range(p):
                x.P[g, m, i, k] = 0.0
            x.P[g, m, i, i] = variance
    for m in range(s.colours.shape[0]):
        x.b[g, m] = 0.0
        x.last[g, m] = 1.0


@compiled
def clear(s: Settings, x: State) -> None:
    """Start anew: no data, estimates zero, all rows in group 0."""
    for g in range(x.age.shape[0]):
        clear_group(s, x, g)
    for q in range(x.theta.shape[0]):
        x.group[q] = 0
        x.filled[q] = 0
        x.pending[q] = 0
        x.hold[q] = s.hold_off
        x.e[q] = math.nan
        x.y_ms[q] = 0.0
        x.weight[q, 0] = 0.0
        x.weight[q, 1] = 0.0
        for i in range(x.theta.shape[1]):
            x.theta[q, i] = 0.0
        for m in range(s.colours.shape[0]):
            x.residual[q, m] = 0.0
            for k in range(3):
                x.colour[q, m, k] = 0.0
    for i in range(x.phi_ms.shape[0]):
        x.phi_ms[i] = 0.0
    x.samples[0] = 0


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
def split(s: Settings, x: State, alarm: Integers) -> None:
    """Take the alarmed rows out of their groups into one empty group that knows nothing (recovery after eq 19).

    What was known before the first alarm of a row is kept for `isolation`.
    """
    p = x.theta.shape[1]
    target = 0
    for q in range(alarm.shape[0]):
        if alarm[q] != 0 and x.pending[q] == 0:
            x.pending[q] = 1
            for i in range(p):
                x.theta_before[q, i] = x.theta[q, i]
                for m in range(s.colours.shape[0]):
                    for k in range(p):
                        x.P_before[q, m, i, k] = x.P[x.group[q], m, i, k]
    for g in range(1, x.age.shape[0]):
        members = 0
        for q in range(alarm.shape[0]):
            if x.group[q] == g and alarm[q] == 0:
                members += 1
        if members == 0:
            target = g
            break
    clear_group(s, x, target)
    for q in range(alarm.shape[0]):
        if alarm[q] != 0:
            x.group[q] = target
            x.filled[q] = 0
            x.hold[q] = s.hold_off
            x.e[q] = math.nan


@compiled
def merge(s: Settings, x: State) -> None:
    """Let the rows of groups that differ from group 0 by nothing but forgotten data rejoin it."""
    if s.merge_after < 0:
        return
    p = x.theta.shape[1]
    for q in range(x.group.shape[0]):
        g = x.group[q]
        if g > 0 and x.age[g] >= 4 * p + s.merge_after:
            x.group[q] = 0
            x.e[q] = math.nan


@compiled
def recovery_factor(s: Settings, age: int, p: int, g: int) -> float:
    """Multiplier of the penalty, ``age`` samples after a reset: low for 2p samples, ramped back over 2p more."""
    if (g == 0 and not s.ease_start) or age >= 4 * p:
        return 1.0
    if age < 2 * p:
        return s.recovery_penalty
    return s.recovery_penalty + (1.0 - s.recovery_penalty) * (age - 2 * p) / (2 * p)


@compiled
def observe_residual(s: Settings, x: State, q: int, g: int, e: float, variance: Array, lag: Array) -> None:
    """Update the residual variance of row q under each colour, and what tells the colours apart.

    ``colour`` compares the measured product of successive prediction errors with the one each colour predicts.
    """
    if x.age[g] <= x.theta.shape[1]:
        return
    f = s.residual_forgetting
    x.weight[q, 0] = f * x.weight[q, 0] + 1.0
    for m in range(variance.shape[0]):
        x.residual[q, m] = f * x.residual[q, m] + (e * e / variance[m] if variance[m] > 0.0 else 0.0)
    if variance.shape[0] == 1 or math.isnan(x.e[q]):
        return
    f = s.colour_forgetting
    x.weight[q, 1] = f * x.weight[q, 1] + 1.0
    for m in range(variance.shape[0]):
        norm = math.sqrt(variance[m]) * x.last[g, m]
        if norm > 0.0:
            x.colour[q, m, 0] = f * x.colour[q, m, 0] + e * e / variance[m]
            x.colour[q, m, 1] = f * x.colour[q, m, 1] + e * x.e[q] / norm
            x.colour[q, m, 2] = f * x.colour[q, m, 2] + lag[m] / norm


@compiled
def update_group(s: Settings, x: State, g: int, phi: Array, y: Array, e: Array, w0: Array, work: Work) -> None:
    """Update the factor of group g, then estimate, residual statistics and covariance of its rows."""
    p = phi.shape[0]
    m = s.colours.shape[0]
    if s.rls:
        rls_gain(x.R[g], phi, s.forgetting, work)
        for i in range(p):
            x.rho[g, i] = 1.0
    else:
        factor = recovery_factor(s, x.age[g], p, g)
        forgetting = s.recovery_forgetting if g > 0 and x.age[g] < 2 * p else s.forgetting
        msls_gain(x.R[g], x.omega[g], phi, w0, factor, forgetting, s.retained, work)
        inverse_diagonal(work.S, work.W, work.z)
        for i in range(p):
            x.rho[g, i] = 1.0 - x.omega[g, i] * work.z[i] if x.omega[g, i] > 0.0 else 1.0
    x.age[g] += 1
    variance = work.variance
    lag = work.lag
    for i in range(m):
        variance[i], lag[i], x.b[g, i] = propagate_covariance(
            x.P[g, i], x.c[g, i], x.u[g, i], x.b[g, i], s.colours[i], phi, work.K, work.g
        )
    for q in range(y.shape[0]):
        if x.group[q] != g:
            continue
        theta = x.theta[q]
        for i in range(p):
            theta[i] += work.K[i] * e[q]
        observe_residual(s, x, q, g, e[q], variance, lag)
        x.e[q] = e[q]
    for i in range(m):
        x.last[g, i] = math.sqrt(variance[i])


@compiled
def update_slow_rms(s: Settings, x: State, phi: Array, y: Array, w0: Array) -> None:
    """Update the slow mean squares and, where the scale is automatic, the penalties W0 that follow from them."""
    count = x.samples[0] + 1.0
    gain = 1.0 / count if count < s.rms_memory else 1.0 / s.rms_memory
    for i in range(phi.shape[0]):
        x.phi_ms[i] += gain * (phi[i] * phi[i] - x.phi_ms[i])
        scale = s.scale[i]
        if s.auto_scale:
            scale = max(math.sqrt(x.phi_ms[i]), 1e-6 * scale)
        w0[i] = s.penalty[i] * scale
    for q in range(y.shape[0]):
        x.y_ms[q] += gain * (y[q] * y[q] - x.y_ms[q])


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
def summarise(s: Settings, x: State, weights: Array, effect: Array) -> float:
    """Sum ``weight * |estimate|`` over the effectors of each row (eq 23); return their least excitation."""
    least = 1.0
    for q in range(x.theta.shape[0]):
        total = 0.0
        for i in range(s.effectors_from, s.effectors_to):
            total += weights[i - s.effectors_from] * abs(x.theta[q, i])
            if x.rho[x.group[q], i] < least:
                least = x.rho[x.group[q], i]
        effect[q] = total
    return least


@compiled
def advance(s: Settings, x: State, phi: Array, y: Array, weights: Array, work: Work, w0: Array, out: Output) -> int:
    """Take samples until one alarms or all are taken; return how many were taken.

    Parameters
    ----------
    s, x
        Settings and state.
    phi, y
        (n, p) regressors and (n, r) outputs, finite.
    weights
        Dither weight of each effector.
    work, w0
        Scratch.
    out
        What happened, per sample.
    """
    for n in range(phi.shape[0]):
        any_alarm = sense_change(s, x, phi[n], y[n], out.e[n], out.statistic[n], out.alarm[n])
        if any_alarm:
            split(s, x, out.alarm[n])
        update_slow_rms(s, x, phi[n], y[n], w0)
        for g in range(x.age.shape[0]):
            used = g == 0
            for q in range(y.shape[1]):
                if x.group[q] == g:
                    used = True
            if used:
                update_group(s, x, g, phi[n], y[n], out.e[n], w0, work)
        merge(s, x)
        x.samples[0] += 1
        out.excitation[n] = summarise(s, x, weights, out.effect[n])
        if any_alarm:
            return n + 1
    return int(phi.shape[0])


def make_output(samples: int, rows: int) -> Output:
    """Allocate what `advance` says of that many samples."""
    shape = (samples, rows)
    return Output(np.zeros(shape), np.zeros(shape), np.zeros(shape, np.int64), np.zeros(shape), np.zeros(samples))


__all__ = ["COLOURS", "Output", "Settings", "State", "advance", "clear", "make_output", "make_state", "make_work"]
