"""The compiled loop over samples: groups of rows, alarms and recovery around the factor.

Rows (output equations) that share a history share one factor. An alarm (eqs 18-19) takes the alarmed rows out of their
group into a fresh one with ``R = 0``, ``omega = 0``, the estimate kept, the penalty lowered for ``2p`` samples and
ramped back over ``2p`` more. When what the two factors remember differently has been forgotten, the rows rejoin group
0::

    group 0  ----------o---------------------------------------o----------->
                 alarm |  low penalty   ramp      merge_after  | rejoin
    group g            o--------------|---------|--------------o
    age                0             2p        4p        4p + merge_after
"""

from __future__ import annotations

import math

from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.detection import sense_change
from msls_ros.estimation.kernel import Array, Integers, Work, inverse_diagonal, msls_gain, rls_gain
from msls_ros.estimation.reference import follow_reference
from msls_ros.estimation.residuals import observe_residual, propagate_autocorrelated, remember_burst
from msls_ros.estimation.soundness import (
    LARGEST_ESTIMATE,
    LARGEST_VARIANCE,
    NOT_FINITE,
    SOUND,
    all_within,
    count_misfits,
    share,
)
from msls_ros.estimation.state import Output, Settings, State, clear_group


@compiled
def advance(
    s: Settings,
    x: State,
    phi: Array,
    y: Array,
    start: int,
    stop: int,
    work: Work,
    w0: Array,
    out: Output,
) -> int:
    """Take samples until one alarms or all are taken; return the index after the last one taken.

    Parameters
    ----------
    s, x
        Settings and state.
    phi, y
        (n, p) regressors and (n, r) outputs, finite.
    start, stop
        Which samples to take.
    work, w0
        Scratch.
    out
        What happened, per sample.
    """
    for n in range(start, stop):
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
        if s.confounded:
            follow_reference(s, x, phi[n], y[n], w0, work)
        merge(s, x)
        x.samples[0] += 1
        report_effectors(s, x, out.b[n], out.b_variance[n], out.excitation[n])
        if s.followed_row >= 0:
            out.followed[n] = x.theta[s.followed_row, s.followed_column]
        out.restart[n] = judge_soundness(s, x, phi[n], y[n], out.e[n])
        if any_alarm or out.restart[n] != SOUND:
            return n + 1
    return stop


@compiled
def judge_soundness(s: Settings, x: State, phi: Array, y: Array, e: Array) -> int:
    """Say whether, and why, everything is to be forgotten after a sample; see `soundness`."""
    p = x.theta.shape[1]
    verdict = count_misfits(x.misfits, phi, y, e)
    if verdict != SOUND:
        return verdict
    if not all_within(x.theta, LARGEST_ESTIMATE):
        return NOT_FINITE
    if s.confounded and not all_within(x.reference_theta, LARGEST_ESTIMATE):
        return NOT_FINITE
    for q in range(x.group.shape[0]):
        g = x.group[q]
        if q > 0 and g == x.group[q - 1]:
            continue
        for i in range(p):
            if s.rls and not 0.0 < x.R[g, i, i] <= LARGEST_VARIANCE:
                return NOT_FINITE
            for m in range(s.colours.shape[0]):
                if not abs(x.P[g, m, i, i]) <= LARGEST_VARIANCE:
                    return NOT_FINITE
    return SOUND


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
def update_group(s: Settings, x: State, g: int, phi: Array, y: Array, e: Array, w0: Array, work: Work) -> None:
    """Update the factor of group g, then estimate, residual statistics and covariance of its rows."""
    p = phi.shape[0]
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
            x.rho[g, i] = share(1.0 - x.omega[g, i] * work.z[i]) if x.omega[g, i] > 0.0 else 1.0
    x.age[g] += 1
    propagate_autocorrelated(s, x, g, phi, work)
    for q in range(y.shape[0]):
        if x.group[q] != g:
            continue
        theta = x.theta[q]
        for i in range(p):
            theta[i] += work.K[i] * e[q]
        remember_burst(s, x, q, g, e[q], work.variance[0])
        observe_residual(s, x, q, g, e[q], work.variance, work.lag)
        x.e[q] = e[q]
    for m in range(s.colours.shape[0]):
        x.last[g, m] = math.sqrt(work.variance[m])


@compiled
def recovery_factor(s: Settings, age: int, p: int, g: int) -> float:
    """Multiplier of the penalty, ``age`` samples after a reset: low for 2p samples, ramped back over 2p more."""
    if (g == 0 and not s.ease_start) or age >= 4 * p:
        return 1.0
    if age < 2 * p:
        return s.recovery_penalty
    return s.recovery_penalty + (1.0 - s.recovery_penalty) * (age - 2 * p) / (2 * p)


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
            x.burst[q] = 0.0
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
def report_effectors(s: Settings, x: State, b: Array, variance: Array, excitation: Array) -> None:
    """Fill in the effectors' columns for the dither: estimates and variances (r, m), least excitation (m,).

    A row that recovers from an alarm keeps the estimate from before; what a fault may have done to it counts as one
    standard error of its own size at most, for a fault takes effect away and hardly ever adds any.
    """
    for j in range(excitation.shape[0]):
        excitation[j] = 1.0
    for q in range(x.theta.shape[0]):
        g = x.group[q]
        residual = x.residual[q, 0] / x.weight[q, 0] if x.weight[q, 0] > 0.0 else math.inf
        for j in range(excitation.shape[0]):
            i = s.effectors_from + j
            b[q, j] = x.theta[q, i]
            square = (residual + x.burst[q]) * x.P[g, 0, i, i]
            if g > 0 and square > b[q, j] * b[q, j]:
                square = b[q, j] * b[q, j]
            variance[q, j] = square
            if x.rho[g, i] < excitation[j]:
                excitation[j] = x.rho[g, i]
