"""What the compiled loop over samples is told (`Settings`), what it keeps (`State`) and what it says (`Output`).

The three are named tuples of numbers and arrays, because those are what compiled functions take. Groups are slots of
the first axis: group 0 always lives, the others are filled by `clear_group` when an alarm takes rows out of it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from msls_ros.estimation.compiled import compiled, passed_by_reference
from msls_ros.estimation.kernel import Array, Integers
from msls_ros.estimation.soundness import SMALLEST_PENALTY

COLOURS = (0.0, 0.7, 0.9, 0.97, 0.995)
"""Coefficients of the AR(1) residuals for which the covariance is propagated; estimates in between are interpolated."""


PRIOR_MSLS = 1e2
PRIOR_RLS = 1e8


@passed_by_reference
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
    confounded: bool
    """Whether a reference model runs beside, to see what the model does not know."""
    reference_forgetting: float
    """Forgetting factor of the reference model, closer to 1 than the estimator's [1]."""
    confounding: Array
    """(p,) squared correlation of what the model does not know with each regressor [1]."""
    deviation_forgetting: float
    """Of `State.deviation`, per look at a row [1]."""
    watch: int
    """Samples before the reference model vouches for anything in moving air."""
    followed_row: int
    followed_column: int
    """Of the estimate that `Output.followed` holds; negative: none."""
    horizon: float
    """Samples that the estimate looks back, ``(1 + lambda)/(1 - lambda)``."""


@passed_by_reference
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
    reference: Array
    """(p, p) data factor of the reference model."""
    reference_theta: Array
    """(r, p) its estimates."""
    reference_last: Array
    """(r,) its last prediction errors; NaN: none."""
    lag_one: Array
    """(r, 2) weighted sum of its products of successive prediction errors, and of the weights."""
    deviation: Array
    """(2,) weighted sum of the squared deviations of the estimates from it over their variances, and of the weights."""
    air: Array
    """(1,) share of the motion through the air that is the air's (`gusts`) [1]."""
    burst: Array
    """(r,) squared residuals of bursts that the estimates remember [output^2]."""
    misfits: Integers
    """(r,) samples with an absurd prediction error, less those without; see `soundness`."""
    samples: Integers
    """(1,) samples since the last reset."""


@passed_by_reference
class Output(NamedTuple):
    """What the loop says of each sample; n samples, r rows."""

    e: Array
    """(n, r) prediction errors before the update."""
    statistic: Array
    """(n, r) short/long; 0 where the detector is not armed."""
    alarm: Integers
    """(n, r) 1 where an abrupt change is declared."""
    b: Array
    """(n, r, m) estimates of the effectors' columns."""
    b_variance: Array
    """(n, r, m) their variances for white residuals; infinite before there is any data."""
    excitation: Array
    """(n, m) least excitation of each effector in any group."""
    followed: Array
    """(n,) one estimate after each sample; NaN where none is followed."""
    restart: Integers
    """(n,) why everything is to be forgotten after a sample; see `soundness`."""


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
        reference=np.zeros((p, p)),
        reference_theta=np.zeros((rows, p)),
        reference_last=np.zeros(rows),
        lag_one=np.zeros((rows, 2)),
        deviation=np.zeros(2),
        air=np.zeros(1),
        burst=np.zeros(rows),
        misfits=np.zeros(rows, np.int64),
        samples=np.zeros(1, np.int64),
    )


def make_output(samples: int, rows: int, effectors: int) -> Output:
    """Allocate what `advance` says of that many samples."""
    shape, columns = (samples, rows), (samples, rows, effectors)
    followed = np.empty(samples)
    followed.fill(math.nan)
    e, statistic, alarm = np.zeros(shape), np.zeros(shape), np.zeros(shape, np.int64)
    b, variance, excitation = np.zeros(columns), np.zeros(columns), np.zeros((samples, effectors))
    return Output(e, statistic, alarm, b, variance, excitation, followed, np.zeros(samples, np.int64))


def forget_sample(out: Output, n: int) -> None:
    """Say of sample n what is known once everything is forgotten: nothing."""
    for array in (out.e, out.statistic, out.alarm, out.b, out.excitation):
        array[n] = 0
    out.b_variance[n] = math.inf
    if not math.isnan(out.followed[n]):
        out.followed[n] = 0.0


@compiled
def clear_group(s: Settings, x: State, g: int) -> None:
    """Forget all that group g knows: ``R = 0``, ``omega = 0``, the prior covariance."""
    p = x.theta.shape[1]
    x.age[g] = 0
    for i in range(p):
        w0 = s.penalty[i] * s.scale[i]
        variance = s.prior / (s.scale[i] * s.scale[i] if s.rls or w0 < SMALLEST_PENALTY * s.scale[i] else w0 * w0)
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
        x.misfits[q] = 0
        x.burst[q] = 0.0
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
        x.reference_last[q] = math.nan
        x.lag_one[q, 0] = 0.0
        x.lag_one[q, 1] = 0.0
    for i in range(x.phi_ms.shape[0]):
        x.phi_ms[i] = 0.0
        for k in range(x.phi_ms.shape[0]):
            x.reference[i, k] = 0.0
        x.reference[i, i] = s.penalty[i] * s.scale[i]
    x.deviation[0] = 0.0
    x.deviation[1] = 0.0
    x.air[0] = 0.0
    x.samples[0] = 0
