"""Noise in the regressors, taken out of what is published as far as it is known, and into the bars as far as not.

Least squares with noise of variance ``sigma_k^2`` in regressor k, V the inverse of the information of n samples, is off
by (`bank.attenuation`)::

    b_j = - n sigma_k^2 V_jk theta_k,        theta_k the true effect

A derivative by an angle of attack that a vane measures is too small, whatever there is of data, and what it lacks is in
the effect of the elevator that makes the angle of attack, which is then certain, too large, and wrong (omitted variable
bias). With ``n sigma^2`` known it is none of the information, ``V' = (R'R - d e_k e_k')^-1``, and the estimate is::

    theta' = theta + V_k d theta_k / (1 - d V_kk),        d = rho n white_k

one noisy regressor after the other (Sherman and Morrison). White noise is the least of what a step of the state beyond
its derivative takes back in the next (`regressor_noise`), of what its third differences hold, and of what makes the
residual of the row, ``s^2/theta_k^2``: steps of inputs make the first, dither and gusts, which are no error of the
regressor, the second, but not all three. Known to a relative error ``e`` it says the bias to ``x = e/(1 - lambda_k)``
of itself, so ``rho = 1/(1 + x^2)`` of it errs least in the mean square, and leaves ``1 - rho`` of the square. Of what
is not white a fifth counts, as in `bank.attenuation`. Through windows nothing is corrected: derivatives are made of the
noise in the states there, of which is only known that it is no more than so much (with it the errors of JSBSim's
aircraft were 1.13 times as large).

What is left of it is an error of every effect, as in `bank.attenuation`. The error of a state's ``theta_k`` itself is
one of all others, in full, and no more than by the best that was known, or by what a fault leaves of a state's effect
(`bank.forgetting`). Nor can it be more than shows: what it makes of the noise is in the residual, ``theta_k^2 sigma_k^2
<= SHOWN s^2``, be it by the noise itself, or by an elevator that follows it through a servo and seems to do what the
angle of attack does. In the first seconds of a flight next to nothing is known of a sideslip that nothing has moved,
and the bars were made of what an effector has in common with it by chance: the standard error of b43 in the paper's
flight, low noise, seed 0, was above 1 until 1.5 s and stepped between .05 and .9 until 2.2 s; it is .14 at 1.5 s and
.11 at 1.8 s.

Where nothing but its noise is left of an angle of attack beside the elevator that follows it (feedback without dither),
the elevator may do all that the angle of attack does, and next to nothing shows it in the residual. ``V_jk`` is of n
samples; of two regressors that have nothing to do with each other its square is ``V_jj V_kk / n`` by chance, which does
not count. A canard fighter that is unstable, vane .6 m/s, twelve flights without dither: B is called reliable in .021,
covered in 1.0; where twice of it does not count .026, .93, and as if a tenth of the angle of attack were motion at
least .11, .30. What it costs: with dither .49 for .50 (six flights), F-16 at medium noise .204 for .207.

It is a matter of what is published and of the best that is kept. Members, detector and names compare estimates with
each other, and have the bias in both.

References
----------
Fuller, *Measurement Error Models*, 1987, sections 1.2 and 2.2 (attenuation, its correction by a known error variance).
Greene, *Econometric Analysis*, 7th ed., section 4.3.2 (omitted variables). Sherman and Morrison, Ann. Math. Stat. 21
(1950).
"""

from __future__ import annotations

import math

from msls_ros.estimation.bank.answers import MEDIAN
from msls_ros.estimation.bank.attenuation import ATTENUATED, LEAST, NOTICED, noise_in, noise_of_row, turned_part
from msls_ros.estimation.bank.effector_noise import entering_part
from msls_ros.estimation.bank.loop_settings import BankSettings
from msls_ros.estimation.bank.state import BankState
from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array

VAGUE = 0.25
"""e: relative error of the variance of white noise [1]. In flights of `test_bank_correction` it is off by .1 to .2."""
SHOWN = 10.0
"""By how much less of white noise, squared, is in what follows it: a servo of 20 rad/s at 100 Hz, ``2/.2`` [1].

Through windows noise is in the residual as it is in the states: F-16, differentiated, seed 851, A from 1 to 4 s
reliable .08 -> .09, median |z| .25 -> .27, covered alike. A transport model, ten seconds after a cold start: Q by de
+-355 -> +-15.
"""
DETERMINED = 0.2
"""Share of a regressor's information that must be left without its noise: one alone leaves .56 and more."""


@compiled
def correct(s: BankSettings, x: BankState, q: int, m: int, noise: Array, bias: Array, squares: Array) -> None:
    """Fill in ``x.correction[q]``, what noise in the regressors has taken from row q's estimates; widen their errors.

    Parameters
    ----------
    s, x
        Settings and state; ``x.widened`` is that of these errors, ``x.columns`` as `attenuation` left it.
    q, m
        Row, and the member that leads there.
    noise
        (r,) variance of the noise in the states, that are the first regressors.
    bias
        (p,) what the squared errors hold of the bias, which is replaced.
    squares
        (p,) squared standard errors, constant first.
    """
    p = squares.shape[0]
    left, theta = x.uncorrected, x.corrected
    for j in range(p):
        left[j] = 0.0
        theta[j] = x.mixed[q, j]
    for n in range(1, p):
        variance = noise_of_row(s, x, q, n, m, noise_in(s, x, x.group[q], n, m, noise))
        x.removed[n] = 0.0
        if variance <= NOTICED * x.info[x.group[q], n, m]:
            continue
        doubtful = VAGUE / max(1.0 - variance * x.columns[n, n], LEAST)
        vague = doubtful * doubtful / (1.0 + doubtful * doubtful)
        white = white_share(s, x, q, m, n, variance)
        missing = vague * white * white + ATTENUATED * (1.0 - white) * (1.0 - white)
        add_uncorrected(s, x, q, m, n, variance, missing, squares[n] - bias[n])
        remove_noise(x, n, (1.0 - vague) * white * variance)
    for j in range(p):
        x.correction[q, j] = theta[j] - x.mixed[q, j]
        squares[j] += left[j] - bias[j]


@compiled
def hidden_share(x: BankState, q: int, n: int) -> float:
    """Return ``lambda/(1 - lambda)`` of regressor n of row q, of which `bank.attenuation.widen` has kept the square."""
    return math.sqrt(max(x.widened[q, n] - 1.0, 0.0))


@compiled
def white_share(s: BankSettings, x: BankState, q: int, m: int, n: int, variance: float) -> float:
    """Return the share of ``variance``, of the noise in regressor n that member m remembers, that is white for row q.

    Of deflections none: until an output has answered it, dither is noise (`bank.effector_noise`).
    """
    if s.straddle > 0 or n > s.effectors_from:
        return 0.0
    share = x.measured[n - 1] if x.measured[n - 1] > 0.0 else 1.0
    white = min(x.state_median[n - 1] / (MEDIAN * share), x.white_states[n - 1])
    effect = x.mixed[q, n]
    if x.residual[q, 1] > 0.0 and effect != 0.0:
        white = min(white, x.residual[q, 0] / (x.residual[q, 1] * effect * effect))
    return float(min(1.0, x.taken[x.group[q], m] * white / variance))


@compiled
def add_uncorrected(
    s: BankSettings, x: BankState, q: int, m: int, n: int, variance: float, missing: float, square: float
) -> None:
    """Add to ``x.uncorrected`` what noise in regressor n leaves of bias in row q's effects.

    ``missing``: share of its square; ``square``: the squared error of effect n without bias.
    """
    g = x.group[q]
    column, theta = x.columns[n], x.mixed[q, n]
    part = 1.0 + hidden_share(x, q, n)
    unknown = min(square + missing * theta * theta * part * part, x.carried[q, n])
    most = min(variance, 1.0 / column[n])
    if n > s.effectors_from:
        unknown = 0.0
    elif x.kept_info[g, n] > 0.0 and x.residual[q, 1] > 0.0:
        unknown = min(unknown, x.residual[q, 0] / (x.residual[q, 1] * x.kept_info[g, n]))
    if x.residual[q, 1] > 0.0:
        unknown = min(unknown, SHOWN * x.residual[q, 0] / x.residual[q, 1] * x.taken[g, m] / variance)
    turned = turned_part(s, x, q, n, m)
    if turned != 0.0:
        turned = entering_part(s, x, q, n, turned)
    known = missing * theta * theta + ATTENUATED * turned * turned
    for j in range(column.shape[0]):
        part = 1.0 + hidden_share(x, q, j)
        x.uncorrected[j] += variance * variance * column[j] * column[j] * known * part * part
        beyond = column[j] * column[j] - column[n] / (x.info[g, j, m] * x.taken[g, m])
        if j != n and beyond > 0.0:
            x.uncorrected[j] += most * most * beyond * unknown


@compiled
def remove_noise(x: BankState, n: int, amount: float) -> None:
    """Take ``amount`` of the information about regressor n for noise, after those before it, in ``x.corrected``."""
    column, theta = x.columns[n], x.corrected
    for k in range(1, n):
        if x.removed[k] > 0.0:
            part = x.removed[k] * x.columns[k, n]
            for j in range(theta.shape[0]):
                column[j] += part * x.columns[k, j]
    left = 1.0 - amount * column[n]
    if left < DETERMINED:
        return
    x.removed[n] = amount / left
    part = x.removed[n] * theta[n]
    for j in range(theta.shape[0]):
        theta[j] += part * column[j]
