"""How the members of the bank are judged and mixed: predictive evidence now and delayed, and covariance intersection.

**Evidence.** Member m is judged by the squares of its prediction errors, one step ahead and with the estimate that it
had ``delay`` samples ago, each scaled by the member's own predicted deviation; weights ``w_k`` fade exponentially and
count a sample by what it can teach (`bank.energy`), and by the square of it where the output is noise: there the best
prediction is no effect at all, with a constant that follows what noise has in common with itself. What the mixture's
delayed predictions err by, over half a second, separates noise from the motion that follows an input, `NOISY`::

    w = g (c + (1 - c) g),   c = max(1 - mean e(delayed)^2 / (NOISY now), 0)

    N = sum w_k,   J0 = sum w_k e_k^2 / (1 + d_k),   J1 = sum w_k e_k(delayed)^2 / (1 + d_k),   L = sum w_k ln(1 + d_k)
    W_m  ~  exp( -a/2 [ N ln J0 + N ln J1 + 2 L ] )

That is the prequential likelihood with the noise level integrated out (so that no noise level enters), raised to a
power below one because successive errors are not independent. The delayed term is cross-validation for dependent data:
what is predicted lies beyond the reach of what disturbed the estimate. One step ahead alone rewards extrapolation of
coloured residuals, delayed alone is slow to follow a change.

A free member that has predicted best in an input would lead on in the quiet after it, having forgotten the input: it
was judged by estimates that it has no more. Where what it remembers has less than a tenth of the energy that an input
has, `TAUGHT`, its weight goes with the square of that as well.

**Mixture.** Per coefficient, members count by what they know of it (the diagonal of covariance intersection, or the
logarithmic pool of normal opinions)::

    theta_i = sum W_m I_mi theta_mi / sum W_m I_mi,     I_mi = 1/((R_m'R_m)^-1)_ii

The constants of the members belong to their own coefficients: a mean of them, zero regressors away from where the
aircraft flies, belongs to none. So what is mixed is the prediction for the regressor of now, by the shares alone, and
the constant follows from it: ``theta_0 = sum W_m phi'theta_m - sum_{i>0} theta_i phi_i``.

References
----------
Dawid, "Statistical theory: the prequential approach", J. R. Stat. Soc. A 147 (1984). Burman, Chow and Nolan, "A
cross-validatory method for dependent data", Biometrika 81 (1994). Grunwald, "The safe Bayesian", 2012 (powers below
one). Julier and Uhlmann, "A non-divergent estimation algorithm in the presence of unknown correlations", 1997. Genest
and Zidek, "Combining probability distributions", Statistical Science 1 (1986).
"""

from __future__ import annotations

import math

from msls_ros.estimation.bank.loop_settings import BankSettings
from msls_ros.estimation.bank.state import BankState
from msls_ros.estimation.bank.work import BankWork
from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.elementary import exponential, logarithm
from msls_ros.estimation.kernel import Array

TINY = 1e-150
"""Added to sums of squares before the logarithm of a product of two of them is taken."""

NOISY = 0.1
"""Share of the present energy that an output's predictions err by, from which on it counts as noise alone [1].

Evidence by g^2 everywhere, .2 and .1: R2 of Q lost by .02 on the repeat 17, 16 and 16 of 117 flights of thirteen
aircraft; Q by Q off by a quarter at the end 21, 22 and 22; noise-free, 14 s, Q by Q off by 1.4 %, below 1 % with both.
"""

TAUGHT = 0.1
"""Share of the energy below which a free member remembers noise rather than motion [1].

An input in coloured noise (`test_bank`), 43 s of quiet after it: 1.01, .89, .83 and .83 of an estimate are left;
without, .22 of the second. F-16, seeds 813 and 814: .627 of the better peer with and without; by the share itself .631,
and A is covered in .83 in the second after an alarm (seed 811; .89).
"""
NOTHING = -30.0
"""A member whose exponent is so far below the best gets weight 0."""


@compiled
def judge(s: BankSettings, x: BankState, q: int, y: float, work: BankWork) -> None:
    """Update the evidence of row q's members with a sample, and remember their estimates for the delayed one.

    Parameters
    ----------
    s, x
        Settings and state; the members have taken the sample.
    q
        Row.
    y
        Its output.
    work
        Holds the regressor.
    """
    gate = x.gate[q]
    share = x.energy_share[q]
    for m in range(share.shape[0]):
        if s.held[m] == 0:
            share[m] += (1.0 - s.forgetting[m]) * (gate - share[m])
    size = x.past.shape[0]
    age = x.age[x.group[q]] - 1
    delay = s.delay if age >= s.delay else max(1, age // 2)
    slot = x.samples[0] % size
    back = (x.samples[0] - delay) % size
    members = work.e.shape[0]
    e = work.e
    for m in range(members):
        e[m] = y
    for i in range(work.phi.shape[0]):
        old = x.past[back, q, i]
        for m in range(members):
            e[m] -= old[m] * work.phi[i]
    for m in range(members):
        work.c[m] = x.weight[q, m] * e[m]
    error = sum_members(work.c)
    x.output_error[q] += max(1.0 / (x.samples[0] + 1.0), s.energy[1]) * (error * error - x.output_error[q])
    clear = max(1.0 - x.output_error[q] / (NOISY * max(x.now[q], x.foreseen[q]) + TINY), 0.0)
    weight = max(gate * (clear + (1.0 - clear) * gate), s.quiet)
    fade = 1.0 - (1.0 - s.judging) * weight
    for i in range(work.phi.shape[0]):
        keep = x.past[slot, q, i]
        now = x.members[q, i]
        for m in range(members):
            keep[m] = now[m]
    x.judged[q] = fade * x.judged[q] + weight
    add_squares(x.evidence[q, 0], x.errors[q], x.deviation[x.group[q]], fade, weight)
    add_squares(x.evidence[q, 1], e, x.deviation[x.group[q]], fade, weight)
    log = x.log[x.group[q]]
    logs = x.evidence[q, 2]
    for m in range(members):
        logs[m] = fade * logs[m] + weight * log[m]


@compiled
def add_squares(total: Array, e: Array, deviation: Array, fade: float, weight: float) -> None:
    """``total <- fade total + weight (e deviation)^2`` for all members: (m,) each."""
    for m in range(total.shape[0]):
        scaled = e[m] * deviation[m]
        total[m] = fade * total[m] + weight * scaled * scaled


@compiled
def weigh(s: BankSettings, x: BankState, q: int, exponent: Array) -> None:
    """Turn the evidence of row q into shares of its members.

    Parameters
    ----------
    s, x
        Settings and state.
    q
        Row.
    exponent
        (m,) scratch.
    """
    judged, half_power = x.judged[q], -0.5 * s.power
    now, delayed, logs = x.evidence[q, 0], x.evidence[q, 1], x.evidence[q, 2]
    mixes, energy_share, weight = s.mixes[q], x.energy_share[q], x.weight[q]
    for m in range(s.members):
        squares = (now[m] + TINY) * (delayed[m] + TINY)
        exponent[m] = half_power * (judged * logarithm(squares) + 2.0 * logs[m])
    best = -math.inf
    for m in range(s.members):
        if mixes[m] != 0.0:
            best = max(best, exponent[m])
    for m in range(s.members):
        lag = exponent[m] - best if mixes[m] > 0.0 else NOTHING
        taught = min(energy_share[m] / TAUGHT, 1.0)
        share = exponential(lag) * taught * taught
        weight[m] = share if lag > NOTHING else 0.0
    total = 0.0
    for m in range(s.members):
        total += weight[m]
    for m in range(s.members):
        weight[m] /= total


@compiled
def find_sharpest(s: BankSettings, x: BankState, q: int, surprise: Array) -> None:
    """Find the member of row q with the most evidence from one-step predictions alone; (m,) scratch."""
    judged, squares, logs = x.judged[q], x.evidence[q, 0], x.evidence[q, 2]
    for m in range(s.members):
        surprise[m] = judged * logarithm(squares[m] + TINY) + logs[m]
    least = math.inf
    for m in range(s.members):
        if s.mixes[q, m] != 0.0 and surprise[m] < least:
            least = surprise[m]
            x.sharpest[q] = m


@compiled
def mix(x: BankState, q: int, y: float, phi: Array, products: Array) -> None:
    """Mix the members of row q into its estimate, per coefficient, and the constant where the aircraft is now.

    Parameters
    ----------
    x
        State.
    q
        Row.
    y, phi
        Its output, and (p,) regressor, constant first, of the sample that the members have taken.
    products
        (m,) scratch.
    """
    p = x.mixed.shape[1]
    members = products.shape[0]
    weight = x.weight[q]
    for i in range(p):
        total, product = weigh_members(weight, x.info[x.group[q], i], x.members[q, i])
        x.mixed[q, i] = product / total
        x.known[q, i] = total
    deviation = x.deviation[x.group[q]]
    for m in range(members):
        products[m] = weight[m] * (y - x.errors[q, m] * deviation[m] * deviation[m])
    constant = sum_members(products)
    for i in range(1, p):
        constant -= x.mixed[q, i] * phi[i]
    x.mixed[q, 0] = constant
    for i in range(p - 1):
        x.theta[q, i] = x.mixed[q, i + 1]
    x.theta[q, p - 1] = x.mixed[q, 0]


@compiled
def weigh_members(weight: Array, info: Array, theta: Array) -> tuple[float, float]:
    """Sums of ``weight info`` and ``weight info theta``, (m,) each, as `sum_members` makes them, both in one go."""
    a = b = c = d = 0.0
    e = f = g = h = 0.0
    quarters = (weight.shape[0] - 1) // 4
    for k in range(quarters):
        one, two = weight[4 * k] * info[4 * k], weight[4 * k + 1] * info[4 * k + 1]
        three, four = weight[4 * k + 2] * info[4 * k + 2], weight[4 * k + 3] * info[4 * k + 3]
        a += one
        b += two
        c += three
        d += four
        e += one * theta[4 * k]
        f += two * theta[4 * k + 1]
        g += three * theta[4 * k + 2]
        h += four * theta[4 * k + 3]
    for k in range(4 * quarters, weight.shape[0]):
        one = weight[k] * info[k]
        a += one
        e += one * theta[k]
    return (a + b) + (c + d), (e + f) + (g + h)


@compiled
def sum_members(values: Array) -> float:
    """Sum (m,) numbers in one fixed order, four chains at a time: additions wait for each other only within a chain.

    Zeros at the end, up to the next multiple of four, change no bit.
    """
    a = 0.0
    b = 0.0
    c = 0.0
    d = 0.0
    quarters = (values.shape[0] - 1) // 4
    for k in range(quarters):
        a += values[4 * k]
        b += values[4 * k + 1]
        c += values[4 * k + 2]
        d += values[4 * k + 3]
    for k in range(4 * quarters, values.shape[0]):
        a += values[k]
    return (a + b) + (c + d)
