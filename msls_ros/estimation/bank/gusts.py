"""Gusts are no noise: what moves the air data and not the aircraft counts as noise as far as outputs do not answer it.

`regressor_noise` finds noise in a velocity by what it does beyond the integral of its derivative: D, over a window. A
gust does that as well as noise of a vane. But a gust acts on the aircraft, as motion does, and is excitation, while
noise is an error of the regressor. Which of both D is, is a question of whether its effect is that of the velocity
itself (Durbin, Wu and Hausman's test of a regressor that may not be exogenous, as a control function)::

    y_q = theta' phi + gamma' D + e,        gamma_j = 0 of gusts,  - theta_j / 2 of noise

for the difference of noise over a window holds it twice. So ``2 (|gamma| + 2 se)`` is the most of theta that noise, or
a gust that acts otherwise than motion does, can have to itself; and theta times the variance of the noise is at most ::

    (|gamma| + 2 se) var(D | phi) / (1 - b),      b the coefficient of D's own velocity in D's regression on phi

The former goes with the gusts, the latter stays when the air becomes calm; the larger counts, as a part of what is
found by D (`noise_part`). White noise is known otherwise (`regressor_noise`), and counts in full.

Least squares with a memory of a minute, from sums over blocks of a second, those of `bank.changes`. The standard error
is by what each block says otherwise than all of them (White's, blocks for samples). An error of the derivative itself
is in D with half a step, and in y of the velocity's own row: what the whole residual would make of gamma so is added
there.

A UAV of 13 kg, 100 Hz, gusts of .5 m/s, no noise: after five seconds .001 to .04 of D counts, and P by da, 127, has a
bar of 11 after twelve; it was 40,000. Gusts of JSBSim turn as well (Dryden's rotary gusts), which no sensor shows:
gamma is half of theta there or more, and D counts. What else was tried stands in docs/bank_history.md, "Gusts that act
are no noise".

References
----------
Hausman, "Specification tests in econometrics", Econometrica 46 (1978). Wooldridge, *Econometric Analysis of Cross
Section and Panel Data*, 2nd ed., section 6.2.1 (control function). White, "A heteroskedasticity-consistent covariance
matrix estimator", Econometrica 48 (1980).
"""

from __future__ import annotations

import math

from msls_ros.estimation.bank.changes import BLOCKS
from msls_ros.estimation.bank.lags import factorise, solve_backward, solve_forward
from msls_ros.estimation.bank.loop_settings import BankSettings
from msls_ros.estimation.bank.state import BankState
from msls_ros.estimation.compiled import compiled

KEPT = 1.0 - 1.0 / 60.0
"""Of the sums, from block to block: a memory of a minute; one of 20 s or 3 min changes nothing by .001 of A or B."""
FEWEST = 5.0
"""Blocks from which on anything is said."""


@compiled
def observe_gusts(s: BankSettings, x: BankState) -> None:
    """Learn from a block that is full what of D acts: ``x.gust_effect`` and ``x.gust_bias``, (r, v)."""
    if s.straddle > 0 or (x.samples[0] + 1) % s.window != 0 or s.velocities.shape[0] == 0:
        return
    block = x.samples[0] // s.window
    slot = block % BLOCKS
    if x.window_block[slot] != block + 1 or x.window_sums[slot, 0, 0] < 0.5 * s.window:
        return
    x.gust_blocks[0] += 1
    add_block(x, slot)
    factor_sums(x)
    for q in range(x.gust_outputs.shape[1]):
        solve_row(x, q)
        contradict(x, slot, q)
        for j in range(s.velocities.shape[0]):
            judge_gust(s, x, q, j)


@compiled
def add_block(x: BankState, slot: int) -> None:
    """Add a block's sums to those of the last minute."""
    for i in range(x.gust_sums.shape[0]):
        for k in range(i + 1):
            x.gust_sums[i, k] = KEPT * x.gust_sums[i, k] + x.window_sums[slot, i, k]
        for q in range(x.gust_outputs.shape[1]):
            x.gust_outputs[i, q] = KEPT * x.gust_outputs[i, q] + x.window_outputs[slot, i, q]


@compiled
def factor_sums(x: BankState) -> None:
    """Factor the sums without means, and find the rows of their inverse that say gamma, ``x.gust_direction``."""
    whole, sums = x.gust_sums.shape[0], x.gust_sums
    for i in range(1, whole):
        x.gust_mean[i] = sums[i, 0] / sums[0, 0]
        for k in range(1, i + 1):
            x.gust_factor[i, k] = sums[i, k] - x.gust_mean[i] * sums[k, 0]
    factorise(x.gust_factor, whole)
    velocities = x.gust_direction.shape[0]
    for j in range(velocities):
        direction = x.gust_direction[j]
        for i in range(whole):
            direction[i] = 1.0 if i == whole - velocities + j else 0.0
        solve_forward(x.gust_factor, direction, 1)
        solve_backward(x.gust_factor, direction)


@compiled
def solve_row(x: BankState, q: int) -> None:
    """Find row q's least squares, ``x.gust_theta[q]``, constant first."""
    theta = x.gust_theta[q]
    total = x.gust_outputs[0, q]
    theta[0] = 0.0
    for i in range(1, theta.shape[0]):
        theta[i] = x.gust_outputs[i, q] - x.gust_mean[i] * x.gust_outputs[0, q]
    solve_forward(x.gust_factor, theta, 1)
    solve_backward(x.gust_factor, theta)
    for i in range(1, theta.shape[0]):
        total -= theta[i] * x.gust_sums[i, 0]
    theta[0] = total / x.gust_sums[0, 0]


@compiled
def forget_gusts(x: BankState) -> None:
    """Know nothing of gusts: the regressors are others from now on."""
    x.gust_blocks[0] = 0
    for i in range(x.gust_sums.shape[0]):
        for k in range(i + 1):
            x.gust_sums[i, k] = 0.0
        for q in range(x.gust_outputs.shape[1]):
            x.gust_outputs[i, q] = 0.0
    for q in range(x.gust_effect.shape[0]):
        for j in range(x.gust_effect.shape[1]):
            x.gust_scatter[q, j] = 0.0
            x.gust_effect[q, j] = math.inf


@compiled
def contradict(x: BankState, slot: int, q: int) -> None:
    """Add up the squares by which blocks say otherwise of row q's gamma than all, in ``x.gust_scatter``."""
    theta, left, sums = x.gust_theta[q], x.gust_left, x.window_sums[slot]
    whole = theta.shape[0]
    for i in range(whole):
        total = x.window_outputs[slot, i, q]
        for k in range(whole):
            total -= (sums[i, k] if k <= i else sums[k, i]) * theta[k]
        left[i] = total
    for j in range(x.gust_direction.shape[0]):
        direction = x.gust_direction[j]
        own = direction[whole - x.gust_direction.shape[0] + j]
        score = 0.0
        for i in range(1, whole):
            score += direction[i] * (left[i] - x.gust_mean[i] * left[0])
        score = score / own if own > 0.0 else 0.0
        x.gust_scatter[q, j] = KEPT * KEPT * x.gust_scatter[q, j] + score * score


@compiled
def judge_gust(s: BankSettings, x: BankState, q: int, j: int) -> None:
    """Find the most that may be of noise in row q's effect of velocity j, and the most bias by it."""
    at = x.gust_theta.shape[1] - s.velocities.shape[0] + j
    own, blocks = x.gust_direction[j, at], float(x.gust_blocks[0])
    if blocks < FEWEST or own <= 0.0:
        x.gust_effect[q, j] = math.inf
        x.gust_bias[q, j] = math.inf
        return
    variance = 1.0 / (own * x.gust_sums[0, 0])
    number = x.gust_sums[0, 0]
    free = max(number - x.gust_sums.shape[0], 1.0)
    error = own * math.sqrt(x.gust_scatter[q, j] * blocks / (blocks - 2.0) * number / free)
    gamma = abs(x.gust_theta[q, at]) + 2.0 * error
    if s.velocities[j] == q + 1 and x.residual[q, 1] > 0.0:
        gamma += 0.5 * s.period * x.residual[q, 0] / x.residual[q, 1] / variance
    apart = 1.0 + x.gust_direction[j, s.velocities[j]] / own
    x.gust_effect[q, j] = 2.0 * gamma
    x.gust_bias[q, j] = gamma * variance / apart if apart > 0.0 else math.inf


@compiled
def noise_part(s: BankSettings, x: BankState, q: int, k: int, found: float) -> float:
    """Return which part of the variance ``found`` in state k, gusts and all but white noise, is noise to row q [1]."""
    for j in range(s.velocities.shape[0]):
        if s.velocities[j] == k + 1:
            theta = abs(x.mixed[q, k + 1])
            if theta <= x.gust_effect[q, j]:
                return 1.0
            most = max(x.gust_effect[q, j], x.gust_bias[q, j] / found if found > 0.0 else 0.0)
            return float(min(most / theta, 1.0))
    return 1.0
