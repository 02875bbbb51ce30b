"""Effects that may have changed where nothing excites them: effectors are held against the last 8 s.

In calm flight the held members forget next to nothing, and the evidence counts little (`bank.members`, `bank.mixing`):
what large inputs have taught is kept until the next one. If a surface is lost meanwhile, dither and a control law's
small motions show it too slowly for an alarm, and yet in many seconds they do. A memory that fades does not say so
either: of what it holds, the input of ten seconds ago is most. So the last seconds are fitted by themselves, by
ordinary least squares with a constant of their own, from sums of products in blocks of a second: one estimate that is
efficient if nothing has changed, and one that is consistent if something has (Hausman). With D their difference and v
the variance of the latter, ::

    max(D^2 - 4 v, 0)

is added to the square of what is published: the square of a bias, less what chance makes of it (Claeskens and Hjort's
focussed information criterion has ``D^2 - v``). It is for effectors alone. The errors that the detector, the tests of
losses, the dither and the best that is kept go by are without it: what may have changed must not excuse its own alarm.
Noise of the deflections makes an effect smaller there. What of it is known to be noise (`bank.rest`) is taken
off the sums: ``(S - n N) D = X'(y - X theta) + n N theta`` (Fuller), and of an effector that moves by less than that
besides nothing is said. Dither that nobody answers any more looks like noise; but it has been answered when it was as
large before, and then nothing is taken off.

Noise in the states does the same to effectors that follow them, as a damper's follows its gyro: ``S^-1 n N theta`` to
first order. White noise of the states is known to about half of itself; what is white of a deflection, and was never
answered as large, may be noise of its sensor or none. So D is no smaller than ::

    |D + c| - |e|,      c = S^-1 n (N_x + 1/2 N_u) theta,      e = 1/2 S^-1 n (N_x + N_u) theta

An aircraft of 18 t (25 Hz, not one of ours) whose damper moves the elevator by .02 to .08 deg rms, of which .03 is
noise: known to .1 after a doublet, its effect was +-4.7 four seconds later, and is +-.12 with this.
Before there is a second of samples since what is known last changed nothing is said.

A simulation that was made to judge this (six nonlinear aircraft of 13 to 9,000 kg, 25 to 100 Hz, gusts in a third, half
of them without dither; 432 flights, 288 of them with losses): of coefficients of lost surfaces that were called
reliable though not covered, while motion had shown the loss to 8 standard errors to one who knows all else, there were
1,968, with this 751; alarms and names are the same. B is called reliable in .166 of manoeuvres, was .177, in .175 of
quiet flight, was .198. With ``D^2 - v`` 607, at .162 and .163. A member that fades in 8 s of clock, its constant
walking by .1, 1,374, at .174 and .192; that one in all errors, and with ``4 v``, has 152 losses alarmed for 161. The
noise of the deflections taken off as the tests of losses do, whatever has been answered before, nothing is seen.

Without what is known to be noise taken off, B of aircraft in flight test (`calibration`, seed 851) was called
reliable in .117 of quiet flight, with it in .154. Of 14 flights of a light aircraft with differentiated rates, whose
aileron rests and then keeps half of its effect (surface noise .05 deg), 11 alarm at the first input and 1 before it;
without it 5 and 2, and two of three intact ones alarmed, now none. In the simulation above .187 of quiet flight for
.185 (seeds 1 to 4), 780 lies for 775.

References
----------
Hausman, "Specification tests in econometrics", Econometrica 46 (1978). Claeskens and Hjort, "The focused information
criterion", J. American Statistical Association 98 (2003). Fuller, *Measurement Error Models*, 1987, section 2.2.
"""

from __future__ import annotations

import math

from msls_ros.estimation.bank.effector_noise import most_noise
from msls_ros.estimation.bank.lags import factorise, solve_backward, solve_forward
from msls_ros.estimation.bank.loop_settings import BankSettings
from msls_ros.estimation.bank.residual import residual_variance
from msls_ros.estimation.bank.rest import unanswered_noise, was_answered
from msls_ros.estimation.bank.state import BankState
from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array

BLOCKS = 8
"""How many blocks are remembered."""
CHANCE = 4.0
"""Squared standard errors by which they may differ by chance."""
VAGUE = 0.5
"""Share of the variance of white noise by which that may be off [1]: of none to all for deflections, the middle."""


@compiled
def observe_window(s: BankSettings, x: BankState, phi: Array, y: Array) -> None:
    """Add a sample to the sums of its block: regressors (p,), constant first, and outputs (r,)."""
    block = x.samples[0] // s.window
    slot = block % BLOCKS
    sums, outputs = x.window_sums[slot], x.window_outputs[slot]
    if x.window_block[slot] != block + 1:
        x.window_block[slot] = block + 1
        for i in range(phi.shape[0]):
            for k in range(i + 1):
                sums[i, k] = 0.0
            for q in range(y.shape[0]):
                outputs[i, q] = 0.0
    for i in range(phi.shape[0]):
        own = phi[i]
        for k in range(i + 1):
            sums[i, k] += own * phi[k]
        for q in range(y.shape[0]):
            outputs[i, q] += own * y[q]


@compiled
def find_changes(s: BankSettings, x: BankState, q: int) -> None:
    """Find the squares by which row q's coefficients may have changed, ``x.window_change`` (p,); 0 for states."""
    g = x.group[q]
    matrix, w, left, vague = x.window_matrix, x.window_row, x.window_left, x.window_vague
    p = w.shape[0]
    if x.window_key[0] != x.samples[0] or x.window_key[1] != g:
        x.window_key[0] = x.samples[0]
        x.window_key[1] = g
        add_up(s, x, g)
    number = matrix[0, 0]
    for i in range(p):
        x.window_change[i] = 0.0
    if number < max(2 * p + 1, s.window):
        return
    for i in range(p):
        w[i] = 0.0
        for slot in range(BLOCKS):
            if is_seen(s, x, g, slot):
                w[i] += x.window_outputs[slot, i, q]
    left[0] = 0.0
    vague[0] = 0.0
    for i in range(1, p):
        total = w[i] - x.window_mean[i] * w[0]
        for k in range(1, p):
            total -= (matrix[i, k] if k <= i else matrix[k, i]) * x.mixed[q, k]
        vague[i] = VAGUE * number * x.window_white[i] * x.mixed[q, i]
        left[i] = total + number * x.window_noise[i] * x.mixed[q, i]
        left[i] += vague[i] / VAGUE if i <= s.effectors_from else vague[i]
    for values in (left, vague):
        solve_forward(x.window_factor, values, 1)
        solve_backward(x.window_factor, values)
    chance = CHANCE * residual_variance(x, q)
    for i in range(s.effectors_from + 1, s.effectors_to + 1):
        beyond = max(abs(left[i]) - abs(vague[i]), 0.0)
        x.window_change[i] = max(beyond * beyond - chance * x.window_square[i], 0.0)


@compiled
def is_seen(s: BankSettings, x: BankState, g: int, slot: int) -> bool:
    """Whether a block is one of the last ones, and group g has seen all of it since what it knows of last changed."""
    block = x.window_block[slot] - 1
    oldest = (x.samples[0] - 1) // s.window - BLOCKS + 1
    begun = max(x.samples[0] - x.age[g], x.window_begun[g])
    return bool(block >= oldest and block * s.window >= begun)


@compiled
def begin_window(s: BankSettings, x: BankState, g: int) -> None:
    """Let no sample of before now be held against group g: a loss has been applied to it (`bank.forgetting`)."""
    x.window_begun[g] = x.samples[0] + s.straddle
    x.window_key[0] = -1


@compiled
def add_up(s: BankSettings, x: BankState, g: int) -> None:
    """Add up the blocks that group g has seen: matrix without means, its factor without noise, variances of effects.

    ``x.window_matrix`` (p, p), lower triangle, holds the number of samples first; the variances, ``x.window_square``
    (p,), are in units of the residual's.
    """
    matrix, factor, unit = x.window_matrix, x.window_factor, x.window_left
    p = unit.shape[0]
    for i in range(p):
        for k in range(i + 1):
            matrix[i, k] = 0.0
    for slot in range(BLOCKS):
        if is_seen(s, x, g, slot):
            for i in range(p):
                for k in range(i + 1):
                    matrix[i, k] += x.window_sums[slot, i, k]
    number = matrix[0, 0]
    if number < max(2 * p + 1, s.window):
        return
    for j in range(x.white_noise.shape[0]):
        x.window_white[j + 1] = x.white_noise[j] if s.straddle == 0 else 0.0
    for i in range(1, p):
        x.window_mean[i] = matrix[i, 0] / number
        for k in range(1, i + 1):
            matrix[i, k] -= x.window_mean[i] * matrix[k, 0]
            factor[i, k] = matrix[i, k]
    for i in range(s.effectors_from + 1, s.effectors_to + 1):
        x.window_noise[i] = unanswered_noise(s, x, i - s.effectors_from - 1)
        most = 0.0 if was_answered(s, x, i - s.effectors_from - 1) else most_noise(s, x, i - s.effectors_from - 1)
        x.window_white[i] = max(most - x.window_noise[i], 0.0)
        noise = number * x.window_noise[i]
        factor[i, i] = matrix[i, i] - noise
    factorise(factor, p)
    for i in range(s.effectors_from + 1, s.effectors_to + 1):
        for k in range(p):
            unit[k] = 1.0 if k == i else 0.0
        square = solve_forward(factor, unit, i)
        if square * number * x.window_noise[i] > 1.0:
            x.window_square[i] = math.inf
            continue
        solve_backward(factor, unit)
        for k in range(s.effectors_from + 1, s.effectors_to + 1):
            square += number * x.window_noise[k] * unit[k] * unit[k]
        x.window_square[i] = square
