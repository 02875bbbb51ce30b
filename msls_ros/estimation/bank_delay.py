"""The delay of all responses after the deflections, found in flight and taken out.

Records of real aircraft are out of step: filters and buses put the responses 10 to 25 ms behind the deflections. Least
squares then finds effects too small, by up to a third where the input moves from sample to sample. How late an output
is, is seen in it without any model of what is remembered: its quick part y (above its mean of the last tenth of a
second) is regressed on the quick regressors h of now and on ``u_j = h_j(k-l) - h_j(k)`` of each effector in turn, the
linear part of a delay, with what `bank_lags` has of M, d, w::

    late_j = sum y (u_j - w_j' h) / (sum u_j^2 - d_j' w_j),      effect_j = (M^-1 sum h y)_j - w_jj late_j

The first is the delay in units of l samples times the second. What all rows and effectors have in common is found by
weighted least squares, over half a minute, with what is plausible before anything is known (`BankSettings.late_part`)::

    delay = l sum v late effect / (sum v effect^2 + 1/part^2),      v = (sum u_j^2 - d_j' w_j) / (variance of y, c)

c corrects for autocorrelation. The regressors are the deflections of that long ago, linear between samples. A delay of
far more than l (20 ms) is found in part only; responses before deflections are not looked for.

References
----------
Klein and Morelli, *Aircraft System Identification*, 2006, chapter 10 (data compatibility).
"""

from __future__ import annotations

from msls_ros.estimation.bank_lags import KEEP, solve_backward, solve_forward
from msls_ros.estimation.bank_state import BankSettings, BankState
from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array

SLOW = 0.1
"""Memory of the autocorrelation over that of the delay, which does not change in flight [1]."""
LARGEST_COLOUR = 0.98
"""As in `bank_uncertainty`."""


@compiled
def observe_output(s: BankSettings, x: BankState, q: int, output: float) -> None:
    """Update what row q's output has in common with the regressors and the last effectors, all of them quick."""
    x.output_mean[q] += max(1.0 / (x.samples[0] + 1.0), s.quick) * (output - x.output_mean[q])
    quick = output - x.output_mean[q]
    fade = s.colour_forgetting
    x.early[q, 0] = fade * x.early[q, 0] + quick * quick
    for i in range(1, x.early.shape[1]):
        x.early[q, i] = fade * x.early[q, i] + quick * x.quick[i]
    for j in range(x.cross.shape[1]):
        x.answer[q, j] = fade * x.answer[q, j] + quick * x.quick_late[j]


@compiled
def take_back(s: BankSettings, x: BankState, phi: Array) -> None:
    """Put the deflections of as long ago as responses are late into the regressor (p,), constant first."""
    size = x.recent.shape[0]
    slot = x.samples[0] % size
    first = s.effectors_from + 1
    whole = int(x.delay[0])
    part = x.delay[0] - whole
    for j in range(x.cross.shape[1]):
        x.recent[slot, j] = phi[first + j]
        if x.samples[0] >= size:
            newer = x.recent[(slot - whole) % size, j]
            phi[first + j] = newer + part * (x.recent[(slot - whole - 1) % size, j] - newer)


@compiled
def late_effect(s: BankSettings, x: BankState, q: int, j: int) -> float:
    """Return what part of effector j's effect on row q comes late [output/rad], where ``x.unexplained[j]`` > 0."""
    total = x.answer[q, j] - x.early[q, s.effectors_from + 1 + j]
    for i in range(1, x.late.shape[1]):
        total -= x.late[j, i] * x.early[q, i]
    return float(total / x.unexplained[j])


@compiled
def find_delay(s: BankSettings, x: BankState, factor: Array, w: Array) -> None:
    """Find the delay that all responses have in common, after `regress_steps`.

    Parameters
    ----------
    s, x
        Settings and state; ``x.delay`` is updated.
    factor
        (p, p) that `regress_steps` has left.
    w
        (p,) scratch.
    """
    total = 0.0
    weight = 0.0
    free = x.quick_samples[0] - w.shape[0] - x.cross.shape[1] - 2.0
    for q in range(x.cross.shape[0] if free > 0.0 else 0):
        if x.residual[q, 1] <= 0.0:
            continue
        rho = min(max(x.colour[q, 0] / x.colour[q, 1], 0.0), LARGEST_COLOUR) if x.colour[q, 1] > 0.0 else 0.0
        w[0] = 0.0
        for i in range(1, w.shape[0]):
            w[i] = x.early[q, i]
        left = x.early[q, 0] - solve_forward(factor, w, 0)
        solve_backward(factor, w)
        numerator = 0.0
        denominator = 0.0
        for j in range(x.cross.shape[1]):
            if x.unexplained[j] <= 0.0:
                continue
            late = late_effect(s, x, q, j)
            i = s.effectors_from + 1 + j
            effect = w[i] - x.late[j, i] * late
            numerator += effect * late * x.unexplained[j]
            denominator += effect * effect * x.unexplained[j]
            left -= late * late * x.unexplained[j]
        variance = max(x.residual[q, 0] / x.residual[q, 1], left / free) * (1.0 + rho) / (1.0 - rho)
        if variance > 0.0:
            total += numerator / variance
            weight += denominator / variance
    gain = min(KEEP * (1.0 - s.colour_forgetting), 1.0)
    x.delay[2] += gain * (total - SLOW * x.delay[2])
    x.delay[3] += gain * (weight - SLOW * x.delay[3])
    x.delay[1] = 1.0 / (x.delay[3] + 1.0 / (s.late_part * s.late_part))
    x.delay[0] = min(max(x.delay[1] * x.delay[2] * s.late, 0.0), float(s.latest))
    x.delay[4] += gain * (x.delay[0] - x.delay[4])
