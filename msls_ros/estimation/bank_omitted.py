"""What is not known of a noisy state's effect is in the effects of all that moves with it.

The bias by noise in regressor k (`bank_attenuation`) goes with the true effect of it, which noise has drawn to nothing::

    b_j = - n sigma_k^2 V_jk theta_k,        E theta_k^2 = est_k^2 + square_k

Where noise is most of an angle of attack that hardly moves, its effect is estimated as next to none; what it does is in
the effect of the elevator that makes it move, which is then certain, several times too large, and wrong (omitted
variable bias, Greene). So the squared error of the estimate, as `widen` leaves it, counts in full: the larger of what
noise says and of the estimate by its reliability ratio, no more than by the best that was known, or by what a fault
leaves of a state's effect (`bank_forgetting`). ``V_jk`` itself is of n samples; of two regressors that have nothing to
do with each other its square is ``V_jj V_kk / n`` by chance, and twice that does not count.

It is an error of the estimate and of the best that is kept. In a comparison of estimates it is in both of them.

References
----------
Greene, *Econometric Analysis*, 7th ed., section 4.3.2 (bias caused by omission of relevant variables). Fuller,
*Measurement Error Models*, 1987, section 2.2.
"""

from __future__ import annotations

from msls_ros.estimation.bank_attenuation import NOTICED, noise_in, solve_column
from msls_ros.estimation.bank_state import BankSettings, BankState
from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array

CHANCE = 2.0
"""Squared partial correlation over its mean by chance that does not count [1].

Made-up linear aircraft at 200 Hz, seeds 4120 to 4159, and others 206, as measured: with 1, B of v by dr covered .99, B
1 to 4 s after an alarm called reliable .15; with 2, .98 and .27; with 4, .76 and .25; without all of this .56 and .27.
"""


@compiled
def add_omitted(s: BankSettings, x: BankState, q: int, m: int, noise: Array, w: Array, squares: Array) -> None:
    """Add to row q's squared errors what is not known of the effects of noisy regressors.

    Parameters
    ----------
    s, x
        Settings and state; ``x.widened`` is that of these errors.
    q, m
        Row, and the member that leads there.
    noise
        (r,) variance of the noise in the states, that are the first regressors.
    w
        (p,) scratch.
    squares
        (p,) squared standard errors, constant first.
    """
    p = squares.shape[0]
    g = x.group[q]
    omitted = x.omitted
    for j in range(p):
        omitted[j] = 0.0
    for n in range(1, p):
        variance = noise_in(s, x, g, n, m, noise)
        if variance <= NOTICED * x.info[g, n, m]:
            continue
        solve_column(x.R[g], m, n, w)
        amount = variance * variance * unknown_square(s, x, q, n, squares[n])
        for j in range(p):
            beyond = w[j] * w[j] - CHANCE * w[n] / (x.info[g, j, m] * x.taken[g, m])
            if j != n and beyond > 0.0:
                omitted[j] += amount * beyond
    for j in range(p):
        squares[j] += omitted[j]


@compiled
def unknown_square(s: BankSettings, x: BankState, q: int, n: int, square: float) -> float:
    """Return the mean square of what the true effect n of row q differs by from its estimate, of that squared error."""
    g = x.group[q]
    unknown = min(square + (x.widened[q, n] - 1.0) * x.mixed[q, n] * x.mixed[q, n], x.carried[q, n])
    if n <= s.effectors_from and x.kept_info[g, n] > 0.0 and x.residual[q, 1] > 0.0:
        unknown = min(unknown, x.residual[q, 0] / (x.residual[q, 1] * x.kept_info[g, n]))
    return float(unknown)
