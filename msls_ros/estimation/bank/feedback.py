"""Feedback in moving air: an effector that a law moves against gusts seems to have the effect of the gusts.

Least squares makes the residual e orthogonal to the regressors of its own time. Where a law answers what gusts do, the
deflection phi of now goes with the gusts of now, which go on, and the estimate is off by ``b = M^-1 E[phi g]``: it is
not known from such motion how much of what happens is the gust. No memory makes that less. What the pilot does, or a
dither, goes with no gust of before; what a law does, does::

    c_l = sum w phi_k e_(k-l),      b_l = M^-1 c_l,      b^2 = max over l of b_l^2, less what it is by chance

of the member of the longest memory, with its own weights w and information M. In the deflection's time the residual has
been made orthogonal to it; at lags of a law, its servos and the aircraft, `LATER`, what both have in common shows.

A transport aircraft (18 t, 25 Hz, not one of ours) in gusts of .7 to 1 m/s that roll, a law that answers roll by bank
and rate: P by da -7 to -19 of -9.5 before the pilot's first input, +-.8 to 2.4 by least squares; |b| is 3.3 to 12.4.
With the pilot's inputs it is .05 to .5.

References
----------
Soderstrom and Stoica, *System Identification*, 1989, chapter 10 (closed loop: what feedback leaves unidentified).
Durbin, "Errors in variables", Review of the International Statistical Institute 22 (1954); Hausman, "Specification
tests in econometrics", Econometrica 46 (1978) (a regressor that goes with the disturbance).
"""

from __future__ import annotations

from msls_ros.estimation.bank.loop_settings import BankSettings
from msls_ros.estimation.bank.residual import residual_variance
from msls_ros.estimation.bank.state import BankState
from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array

LATER = (0.2, 0.4, 0.8)
"""Between a residual and the regressors that may answer it [s]; the length of a window of derivatives is added."""
CHANCE = 4.0
"""Squared standard errors by which they have in common what chance makes."""


@compiled
def observe_feedback(s: BankSettings, x: BankState, q: int, phi: Array) -> None:
    """Update what the regressors (p,), constant first, have in common with row q's residuals of before."""
    g = x.group[q]
    m = s.reference[s.row_axis[q]]
    size = x.past_residuals.shape[0]
    now = x.samples[0] % size
    gate = x.axis_gate[g, s.axis[m]]
    fade = 1.0 - (1.0 - s.forgetting[m]) * (1.0 - s.held[m] * (1.0 - gate))
    weight = 1.0 - s.held[m] * (1.0 - max(gate, s.quiet))
    deviation = x.deviation[g, m]
    x.past_residuals[now, q] = x.errors[q, m] * deviation * deviation
    for n in range(s.feedback_lags.shape[0]):
        weighed = weight * x.past_residuals[(now + size - s.feedback_lags[n]) % size, q]
        common = x.followed_residuals[q, n]
        for i in range(phi.shape[0]):
            common[i] = fade * common[i] + weighed * phi[i]


@compiled
def find_feedback(s: BankSettings, x: BankState, q: int, left: Array) -> None:
    """Find by what row q's effects of effectors may be off for a law that answers gusts; (p,) scratch."""
    g = x.group[q]
    m = s.reference[s.row_axis[q]]
    R = x.R[g]
    p = left.shape[0]
    variance = residual_variance(x, q)
    for i in range(s.effectors_from + 1, s.effectors_to + 1):
        x.feedback_square[q, i] = 0.0
    for n in range(s.feedback_lags.shape[0]):
        common = x.followed_residuals[q, n]
        for j in range(p):
            total = common[j]
            for k in range(j):
                total -= R[k, j, m] * left[k]
            left[j] = total / R[j, j, m]
        for j in range(p - 1, s.effectors_from, -1):
            total = left[j]
            for k in range(j + 1, p):
                total -= R[j, k, m] * left[k]
            left[j] = total / R[j, j, m]
        for i in range(s.effectors_from + 1, s.effectors_to + 1):
            beyond = left[i] * left[i] - CHANCE * variance / x.info[g, i, m]
            x.feedback_square[q, i] = max(x.feedback_square[q, i], beyond)


@compiled
def forget_feedback(x: BankState, q: int) -> None:
    """Forget it of row q."""
    for k in range(x.past_residuals.shape[0]):
        x.past_residuals[k, q] = 0.0
    for i in range(x.feedback_square.shape[1]):
        x.feedback_square[q, i] = 0.0
        for n in range(x.followed_residuals.shape[1]):
            x.followed_residuals[q, n, i] = 0.0
