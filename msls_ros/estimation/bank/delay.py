"""The delay of all responses after the deflections, found in flight and taken out.

Records of real aircraft are out of step: filters and buses put the responses 10 to 25 ms behind the deflections. Least
squares then finds effects too small, by up to a third where the input moves from sample to sample. How late an output
is, is seen in it without any model of what is remembered: its quick part y (above its mean of the last tenth of a
second) is regressed on the quick regressors h, of which those of the effectors are taken d l samples back, by linear
interpolation: ``g_j = h_j + d u_j``, ``u_j = h_j(k-l) - h_j(k)``. One step of Gauss and Newton from the last d, with
the sums over seconds of `bank.lags`, per row::

    theta = (sum g g')^-1 sum g y,      z = sum_j theta_j u_j,  of effects that are 3 standard errors from none
    N = n (1 - r) sum_j theta_j^2 sigma_j^2,                    E = sum z~^2 - 2 N
    d_q = d + (sum y z~ + (2d - 1) N) / E,                      v_q = s^2 c sum z~^2 / E^2

s^2 is the mean square of what is left of y, c corrects for autocorrelation, z~ is z with the regressors g partialled
out. Interpolation averages the noise in deflections, most so at l/2, to which d is drawn where noise is what moves:
``(1 - 2d (1-d)(1-r)) sigma_j^2`` is left of its variance (`bank.effector_noise`), and what d changes of that is
no evidence; r is the autocorrelation of noise, l samples on, in the window of derivatives.

Rates and velocities have sensors of their own, whose filters differ, and rates may be differentiated, velocities not:
the rows of angular rates (moments) are one kind, all others (forces) the other. What the rows of a kind have in common
is found by weighted least squares over half a minute, ``d_kind = sum w d_q / sum w`` of variance
``v_kind = 1 / sum w``, and drawn to what both kinds have in common (random effects), with what is plausible before
anything is known: ``part``, of both, and ``apart``, between them (`BankSettings.late_part`, ``late_apart``)::

    w = 1 / (v_q + (KNOWN N/E)^2/SLOW + DIFFER^2),      share = apart^2 / (apart^2 + v_kind)
    common = sum d_kind/(v_kind + apart^2) / (sum 1/(v_kind + apart^2) + 1/part^2),   V_common = 1/(same sum)
    delay = l (common + share (d_kind - common)),      V/l^2 = apart^2 (1-share) + (1-share)^2 V_common

What is not beyond a standard error is none: of the estimate D with variance V, ``max(D - V/D, 0)`` is used (James and
Stein). To its variance comes the square of ``4 d (1-d) DIFFER``, by which rows differ: interpolation makes that, none
at no delay and at l, and no averaging takes it away.

The regressors are the deflections of as long ago as moments are late; of what forces do, what the difference to their
own delay makes is taken off the outputs (`put_in_step`). What has been learnt before is corrected
(`bank.lags.shift_estimates`). Of a delay of far more than l (20 ms) the rest is not found; responses before deflections
are found by `bank.responses`. Derivatives that are made from the states by a window are looked at like all others: one
window for values and slopes delays neither against the other.

References
----------
Klein and Morelli, *Aircraft System Identification*, 2006, chapter 10 (data compatibility). Seber and Wild, *Nonlinear
Regression*, section 2.1.3 (Gauss-Newton). Söderström, "Errors-in-variables methods in system identification",
Automatica 43 (2007) (least squares without what noise adds to it). DerSimonian and Laird, "Meta-analysis in clinical
trials", Controlled Clinical Trials 7 (1986) (random effects).
"""

from __future__ import annotations

from msls_ros.estimation.bank.lags import (
    APART,
    KEEP,
    MOMENTS,
    factorise,
    known_effect,
    shift_estimates,
    solve_backward,
    solve_forward,
)
from msls_ros.estimation.bank.loop_settings import BankSettings
from msls_ros.estimation.bank.residual import autocorrelation
from msls_ros.estimation.bank.state import BankState
from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array

SLOW = 0.1
"""Memory of the autocorrelation over that of the delay, which does not change in flight [1]."""
SEEN = 9.0
"""Squared standard errors by which an effect must differ from none to say how late it is."""
DIFFER = 0.05
"""By how much rows differ in their delay, over l [1]: 1 ms.

Measured on beds with dither and delays of 0, 7, 14 and 22 ms: rows of angular accelerations differ by .1 to .6 ms, all
of them are up to 1.8 ms off by the linear interpolation, and 2 ms where 22 ms are more than l.
"""
KNOWN = 0.5
"""Relative error of the variance of the noise in deflections; it is the same in all of the sums that are added up [1].

A median by third differences is right to a tenth or two where noise is white; slow noise is not seen by them.
"""


@compiled
def observe_output(s: BankSettings, x: BankState, q: int, output: float) -> None:
    """Update what row q's output has in common with the regressors and the last effectors, all of them quick."""
    x.output_mean[q] += max(1.0 / (x.samples[0] + 1.0), s.quick) * (output - x.output_mean[q])
    quick = output - x.output_mean[q]
    fade = s.colour_forgetting
    x.early[q, 0] = fade * x.early[q, 0] + quick * quick
    for i in range(1, x.early.shape[1]):
        x.early[q, i] = fade * x.early[q, i] + quick * x.quick[i]
    for j in range(x.answer.shape[1]):
        x.answer[q, j] = fade * x.answer[q, j] + quick * (x.quick_late[j] - x.quick[s.effectors_from + 1 + j])


@compiled
def forget_delays(s: BankSettings, x: BankState, phi: Array) -> None:
    """Forget what the effectors of before were like; they are those in phi (p,), constant first, from now on."""
    first = s.effectors_from + 1
    count = x.answer.shape[1]
    x.quick_samples[0] = 0.0
    x.delay[:, :] = 0.0
    for i in range(1, phi.shape[0]):
        for k in range(1, i + 1):
            x.moment[i, k] = 0.0
        for j in range(count):
            x.quick_moment[j, i] = 0.0
        for q in range(x.early.shape[0]):
            x.early[q, i] = 0.0
    for q in range(x.early.shape[0]):
        x.early[q, 0] = 0.0
    x.past_outputs[:] = 0.0
    for j in range(count):
        now = phi[first + j]
        x.quick_mean[first + j] = now
        x.phi_last[first + j] = now
        x.unexplained[j] = 0.0
        x.third_floor[j] = 0.0
        x.unanswered[j] = 0.0
        x.rest_energy[j] = 0.0
        x.rest_evidence[:, j] = 0.0
        x.dithered[j] = 0.0
        x.rested[j] = 0.0
        for k in range(x.quick_past.shape[0]):
            x.quick_past[k, j] = 0.0
        for k in range(x.recent.shape[0]):
            x.recent[k, j] = now
        for k in range(x.deflections.shape[0]):
            x.deflections[k, j] = now
            x.white_past[k, j] = now
        x.whites[:, j] = 0.0
        for k in range(count):
            x.steps[j, k] = 0.0
        for q in range(x.answer.shape[0]):
            x.answer[q, j] = 0.0
            x.cross[q, j] = 0.0
            x.white_cross[q, j, :] = 0.0
            x.white_power[q, j] = 0.0
            x.white_answered[q, j] = 0.0
            x.rest_cross[q, j, :] = 0.0
            x.rest_power[q, j] = 0.0
            x.rest_square[q, j] = 0.0


@compiled
def take_back(s: BankSettings, x: BankState, phi: Array) -> None:
    """Put the deflections of as long ago as responses are late into the regressor (p,), constant first."""
    size = x.recent.shape[0]
    slot = x.samples[0] % size
    first = s.effectors_from + 1
    whole = int(x.delay[MOMENTS, 0])
    part = x.delay[MOMENTS, 0] - whole
    for j in range(x.answer.shape[1]):
        x.recent[slot, j] = phi[first + j]
        if x.samples[0] >= size:
            phi[first + j] = deflection_of(s, x, slot - whole, part, j)
            x.step_back[j] = deflection_of(s, x, slot - whole - s.late, part, j) - phi[first + j]


@compiled
def put_in_step(s: BankSettings, x: BankState, y: Array, phi: Array, to: Array) -> None:
    """Put the outputs (r,) as they would be if all were as late as moments into ``to``; phi (p,), constant first.

    Parameters
    ----------
    s, x
        Settings and state, after `take_back`.
    y
        Outputs.
    phi
        Regressors, constant first, deflections taken back.
    to
        (r,) out.
    """
    size = x.recent.shape[0]
    slot = x.samples[0] % size
    first = s.effectors_from + 1
    for q in range(y.shape[0]):
        to[q] = y[q]
        late = x.delay[s.kind[q], 0]
        if late == x.delay[MOMENTS, 0] or x.samples[0] < size:
            continue
        whole = int(late)
        for j in range(x.answer.shape[1]):
            to[q] -= known_effect(x, q, first + j) * (
                deflection_of(s, x, slot - whole, late - whole, j) - phi[first + j]
            )


@compiled
def deflection_of(s: BankSettings, x: BankState, slot: int, part: float, j: int) -> float:
    """Return effector j's deflection of so long ago: a slot of the ring, and which part of a sample before it.

    On a straight line between two samples, for a command that is held moves an actuator in one of them; through a
    window of derivatives all is smooth, and a parabola through three (Lagrange) takes nothing from what is quick.
    """
    size = x.recent.shape[0]
    newer = x.recent[slot % size, j]
    middle = x.recent[(slot - 1) % size, j]
    found = newer + part * (middle - newer)
    if s.straddle > 0:
        found -= 0.5 * part * (1.0 - part) * (newer - 2.0 * middle + x.recent[(slot - 2) % size, j])
    return float(found)


@compiled
def factor_moments(s: BankSettings, x: BankState, d: float, factor: Array) -> None:
    """Put the factor of ``sum g g'`` into (p, p), see `factorise`."""
    p = factor.shape[0]
    first = s.effectors_from + 1
    for i in range(1, p):
        for k in range(1, i + 1):
            total = x.moment[i, k]
            if i >= first:
                total += d * x.quick_moment[i - first, k]
                if k >= first:
                    total += d * (x.quick_moment[k - first, i] + d * x.steps[i - first, k - first])
            factor[i, k] = total
    factorise(factor, p)


@compiled
def find_unexplained(s: BankSettings, x: BankState, d: float, factor: Array, w: Array, information: Array) -> None:
    """Find the quick information about every effect, and ``x.unexplained``: what the regressors leave of the steps."""
    first = s.effectors_from + 1
    count = x.answer.shape[1]
    for j in range(count):
        for i in range(w.shape[0]):
            w[i] = 0.0
        w[first + j] = 1.0
        information[j] = 1.0 / max(solve_forward(factor, w, first + j), 1e-300)
        w[0] = 0.0
        for i in range(1, w.shape[0]):
            w[i] = x.quick_moment[j, i]
        for k in range(count):
            w[first + k] += d * x.steps[max(j, k), min(j, k)]
        left = x.steps[j, j] - solve_forward(factor, w, 0)
        x.unexplained[j] = left if left > APART * x.steps[j, j] else 0.0


@compiled
def find_delay(s: BankSettings, x: BankState, factor: Array, w: Array, z: Array, information: Array) -> None:
    """Find the delays that the rows of each kind have in common, and what `bank.lags` needs to know of them.

    Parameters
    ----------
    s, x
        Settings and state; ``x.delay`` and ``x.unexplained`` are updated.
    factor
        (p, p) scratch.
    w, z, information
        (p,) scratch.
    """
    if x.quick_samples[0] - factor.shape[0] - 3.0 <= 0.0 or x.answer.shape[1] == 0:
        for kind in range(x.delay.shape[0]):
            x.delay[kind, 1] = s.late_part * s.late_part
        return
    moving = 0.0
    for q in range(x.gate.shape[0]):
        moving += x.gate[q] / x.gate.shape[0]
    gain = min(KEEP * (1.0 - s.colour_forgetting), 1.0) * moving
    for kind in range(x.delay.shape[0] - 1, -1, -1):  # moments last: what is unexplained at their delay stays
        factor_moments(s, x, x.delay[kind, 4], factor)
        find_unexplained(s, x, x.delay[kind, 4], factor, w, information)
        x.delay[kind, 2] -= gain * SLOW * x.delay[kind, 2]
        x.delay[kind, 3] -= gain * SLOW * x.delay[kind, 3]
        for q in range(x.answer.shape[0]):
            if s.kind[q] == kind:
                observe_lateness(s, x, q, gain, factor, w, z, information)
    weigh_kinds(s, x)


@compiled
def observe_lateness(
    s: BankSettings, x: BankState, q: int, gain: float, factor: Array, w: Array, z: Array, information: Array
) -> None:
    """Add what row q says now, with a gain, to the sums of its kind of rows; the others as `find_delay` has them."""
    p = factor.shape[0]
    first = s.effectors_from + 1
    count = x.answer.shape[1]
    kind = s.kind[q]
    d = x.delay[kind, 4]
    w[0] = 0.0
    for i in range(1, p):
        w[i] = x.early[q, i]
    for j in range(count):
        w[first + j] += d * x.answer[q, j]
    left = x.early[q, 0] - solve_forward(factor, w, 0)
    solve_backward(factor, w)
    if left <= 0.0:
        return
    variance = left / (x.quick_samples[0] - p - 3.0)
    for i in range(p):
        z[i] = 0.0
    size = 0.0
    product = 0.0
    noise = 0.0
    for j in range(count):
        effect = w[first + j]
        if effect * effect * information[j] <= SEEN * variance:
            continue
        for i in range(1, p):
            z[i] += effect * x.quick_moment[j, i]
        product += effect * x.answer[q, j]
        noise += effect * effect * x.third_noise[j]
        for k in range(count):
            z[first + k] += effect * d * x.steps[max(j, k), min(j, k)]
            other = w[first + k]
            if other * other * information[k] > SEEN * variance:
                size += effect * other * x.steps[max(j, k), min(j, k)]
    for i in range(1, p):
        product -= z[i] * w[i]
    own = size - solve_forward(factor, z, 0)
    noise *= s.late_noise * x.quick_samples[0]
    moves = own - 2.0 * noise
    if moves <= APART * size:
        return
    rho = autocorrelation(x, q)
    square = variance * (1.0 + rho) / (1.0 - rho) * own / (moves * moves)
    drawn = KNOWN * noise / moves
    one = 1.0 / (square + drawn * drawn / SLOW + DIFFER * DIFFER)
    x.delay[kind, 2] += gain * one * (d + (product + (2.0 * d - 1.0) * noise) / moves)
    x.delay[kind, 3] += gain * one


@compiled
def weigh_kinds(s: BankSettings, x: BankState) -> None:
    """Find the delay of each kind of rows from their sums, and correct what has been learnt by what is new in it."""
    apart = s.late_apart * s.late_apart
    total = 0.0
    weight = 1.0 / (s.late_part * s.late_part)
    for kind in range(x.delay.shape[0]):
        if x.delay[kind, 3] > 0.0:
            one = 1.0 / (1.0 / x.delay[kind, 3] + apart)
            weight += one
            total += one * x.delay[kind, 2] / x.delay[kind, 3]
    common = total / weight
    for kind in range(x.delay.shape[0]):
        own = apart * x.delay[kind, 3] / (apart * x.delay[kind, 3] + 1.0)
        part = common
        if own > 0.0:
            part += own * (x.delay[kind, 2] / x.delay[kind, 3] - common)
        variance = apart * (1.0 - own) + (1.0 - own) * (1.0 - own) / weight
        bent = 4.0 * part * (1.0 - part) * DIFFER
        x.delay[kind, 1] = variance + bent * bent
        x.delay[kind, 4] = part
        part = part - variance / part if part > 0.0 else 0.0
        before = x.delay[kind, 0]
        x.delay[kind, 0] = min(max(part * s.late, 0.0), float(s.latest))
        if x.delay[kind, 0] != before:
            shift_estimates(s, x, kind, (x.delay[kind, 0] - before) / s.late)
