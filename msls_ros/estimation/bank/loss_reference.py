"""Errors of what a loss is looked for against: an effect that was never known has not changed.

The change D of a member against older estimates holds their errors. Those of a surface's own effect are in the variance
of its loss (`bank.losses`). Those of all else are not: a rudder that moves for the first time while the elevator hardly
does, or a velocity whose effect straight flight left open, make a change that the elevator explains. With S the squared
standard errors of the older estimates, n the variance of innovations, and c_j the j-th column of the factor::

    cov(R D) = n/2 I + sum_j S_j c_j c_j'

over the states and effectors whose effect was not known in the row. One column after the other is whitened,
``I - (1 - 1/sqrt(1 + r)) c c'/c'c`` with ``r = 2 S c'c / n`` (Sherman and Morrison's formula, its square root for one
column), and so are the directions of the losses and what states explain. Of an effect that is not known at all, r is
infinite, and its column is projected out. That takes r/(1 + r) of a degree of freedom. Correlations between errors of
the older estimates are not kept, and neglected.

Rates differentiated, members by themselves, 1,072 flights with 357 losses (F-16, 23 aircraft in flight test, made-up
linear ones), walks of .3: without it the members of .4 and 1.5 s see 263 and 254, and alarm in 5 and 4 flights before
any loss; with it 250 and 253, in 2 and 2. For effectors alone .4 s sees 256, in 2, and 1.5 s 255, in 3.

Where derivatives are measured it decides only whether a loss that is seen without it is one: by itself it leaves
mostly the noise of deflections that rest, and 14 to 30 of 471 flights alarm. A small aircraft's aileron was lost at its
first rudder input without it, in 10 flights of 10 (100 Hz, velocity noisy by .03 m/s); in none with it. There errors of
states are whitened, of effectors not: of half stabilators of the F-16, of two effectors each, 7 of 20 are named at
medium noise with these, 13 without. Instead, what the error of one effector's older effect explains of the change w,
along its column c, is a rival of the loss, as another surface is: ``(c'w)^2 / (c'c + n/(2 S)) / n``.

Names take the change as it is: an alarm has said that there is one.

References
----------
Sherman and Morrison, "Adjustment of an inverse matrix corresponding to a change in one element of a given matrix",
Ann. Math. Statist. 21 (1950). Chen and Patton, *Robust Model-Based Fault Diagnosis for Dynamic Systems*, 1999, chapter
2: unknown inputs are projected out of a residual.
"""

from __future__ import annotations

import math

from msls_ros.estimation.bank.loop_settings import BankSettings
from msls_ros.estimation.bank.work import BankWork
from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array

WHOLE = 1e12
"""r from which a column is projected out: what is left of it is next to rounding errors."""
LEAST_LEFT = 1e-9
"""Share of a direction's squared length that must be left of it for it to say anything."""


@compiled
def whiten(work: BankWork) -> None:
    """Divide the change ``work.w`` by its deviations."""
    for i in range(1, work.w.shape[0]):
        work.w[i] *= work.whitening[i]


@compiled
def whiten_directions(work: BankWork) -> None:
    """Divide the surfaces' directions and the columns of the factor by their deviations.

    Squared lengths stand at the constant's place of ``work.white_steps`` (k, p) and ``work.white_columns`` (p, p), of
    which row j is column j of the factor.
    """
    p = work.w.shape[0]
    for k in range(work.steps.shape[0]):
        size = 0.0
        for i in range(1, p):
            step = work.steps[k, i] * work.whitening[i]
            work.white_steps[k, i] = step
            size += step * step
        work.white_steps[k, 0] = size
    for j in range(1, p):
        size = 0.0
        for i in range(1, j + 1):
            step = work.columns[j, i] * work.whitening[i]
            work.white_columns[j, i] = step
            size += step * step
        for i in range(j + 1, p):
            work.white_columns[j, i] = 0.0
        work.white_columns[j, 0] = size


@compiled
def discount_reference(
    s: BankSettings, before: Array, square: Array, q: int, n: float, known: float, work: BankWork
) -> float:
    """Whiten row q's change by the errors of the older estimates, after `whiten` and `whiten_directions`.

    Parameters
    ----------
    s
        Settings.
    before, square
        (r, p) older estimates and their squared standard errors, constant first.
    q
        Row.
    n
        Variance of the whitened innovations.
    known
        Largest relative standard error of an effect that counts as known [1].
    work
        ``w``, ``white_steps`` and ``white_columns`` are changed.

    Returns
    -------
    float
        Degrees of freedom that are taken.
    """
    taken = 0.0
    p = work.w.shape[0]
    for j in range(1, p if s.straddle > 0 else s.effectors_from + 1):
        if square[q, j] < known * known * before[q, j] * before[q, j]:
            continue
        column = work.difference  # is not needed any more
        size = 0.0
        for i in range(1, p):
            column[i] = work.white_columns[j, i]
            size += column[i] * column[i]
        if size <= LEAST_LEFT * work.white_columns[j, 0]:
            continue
        ratio = 2.0 * square[q, j] * size / n
        whole = ratio > WHOLE
        taken += 1.0 if whole else ratio / (1.0 + ratio)
        part = 1.0 if whole else 1.0 - 1.0 / math.sqrt(1.0 + ratio)
        take_off(work.w, column, part / size)
        for k in range(work.white_steps.shape[0]):
            take_off(work.white_steps[k], column, part / size)
        for i in range(1, p):
            take_off(work.white_columns[i], column, part / size)
        if whole:
            for i in range(1, p):
                work.white_columns[j, i] = 0.0
    return taken


@compiled
def take_off(direction: Array, column: Array, part: float) -> None:
    """Take that part of a column (p,) times its product with a direction (p,) off the direction, but for the first."""
    along = 0.0
    for i in range(1, column.shape[0]):
        along += column[i] * direction[i]
    for i in range(1, column.shape[0]):
        direction[i] -= part * along * column[i]
