"""Noise of a derivative that is made in a window, by direction: least where regressors move slowly.

A slope made of a rate holds the noise of its sensor, differenced. What it adds at one edge of the window it takes off
at the other: sums of the noise over longer than a window do not grow. A loss shows for as long as a deflection stays,
which is many windows. Taken for white, or for a first-order process by its first autocorrelation, that noise is
reckoned too large there, and for what moves quickly too small.

The factor R of a member gives regressors that are orthogonal over what it remembers, ``v = R'^-1 phi``. Its change
against older estimates, ``w = R D``, holds of innovations with autocovariance gamma the variances::

    n_i = sum_l gamma(l) r_i(l) / r_i(0),       r_i the autocorrelation of v_i

A regressor that keeps for B samples what it is has ``r(l) = 1 - |l|/B``, and the sum is the variance of sums of B
innovations, over B (Bartlett's weights: Newey and West). So these are remembered for B = 1, 2, 4 ... up to `LONGEST`
(`observe_sums`), of a member that remembers long (`bank.settings.NOISE_MEMORY`): those of ten samples and fourteen
estimates hold nothing that is slow. B is found from how far v_i goes over a window of s samples
(`observe_regressors`)::

    B_i = 2 s sum v_i(t)^2 / (sum (v_i(t) - v_i(t-s))^2 + 2 sum_s v_i(t)^2)

The last sum is over the window that ends now: what is remembered ends there, and noise that is yet to be taken off
again is in the change. For a regressor that has not moved, B is the memory.

What swings at a frequency f has the B at which such sums have the spectrum of differenced noise at f, but for a factor
near one. Regressors quicker than a window get the largest variance up to it. Correlations between the coordinates are
neglected.

Then each coordinate of the change is divided by its own deviation (`find_whitening`), which is approximately
generalised least squares; all that `bank.losses` asks of the change it asks of that.

Rates differentiated, members by themselves, 822 flights with 289 losses of the F-16, of 23 aircraft in flight test and
of made-up linear ones: that of .4 s sees 181 of them with one noise for all directions, and alarms in 5 flights before
any loss; 188 and 2 with this, 207 and 2 where its constant walks by .3; that of 1.5 s 170 and 3, 181 and 2, 195 and 2.
Of 1,072 flights with 357 losses, many of them at 25 Hz, that of .4 s sees 267 and alarms in 8 before any loss without
the last sum of B, 263 and 5 with it; that of 1.5 s 254 and 4 both.

References
----------
Newey and West, "A simple, positive semi-definite, heteroskedasticity and autocorrelation consistent covariance matrix",
Econometrica 55 (1987). Aitken, "On least squares and linear combination of observations", Proc. R. Soc. Edinb. 55
(1935).
"""

from __future__ import annotations

import math

from msls_ros.estimation.bank.loop_settings import BankSettings
from msls_ros.estimation.bank.state import BankState
from msls_ros.estimation.bank.work import BankWork
from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array

LONGEST = 1.0
"""Of the sums [s]: inputs of flight test stay for one to two, and what the longer member remembers is 1.5 s."""
OUTLIER = 9.0
"""Their squares count no more than so many times their mean: a loss is no noise."""
SETTLED, BEGUN = 20, 10
"""So many of their lengths must have been taken for that, and for their variance to be used."""


@compiled
def observe_sums(s: BankSettings, x: BankState, q: int, e: float, weight: float) -> None:
    """Update the variances of sums of row q's innovations, with one e of so much weight."""
    ring = x.innovation_sums[q]
    size = ring.shape[0]
    taken = x.sums_taken[q]
    total = ring[(taken - 1) % size] + e
    ring[taken % size] = total
    fade = 1.0 - (1.0 - s.mean_forgetting) * weight
    length = 1
    for j in range(x.sum_squares.shape[1]):
        own = x.sum_squares[q, j]
        if taken >= length:
            step = total - ring[(taken - length) % size]
            square = step * step / length
            if taken > SETTLED * length:
                square = min(square, OUTLIER * own[0] / own[1])
            own[0] = fade * own[0] + weight * square
            own[1] = fade * own[1] + weight
        length *= 2
    x.sums_taken[q] = taken + 1


@compiled
def observe_regressors(s: BankSettings, x: BankState, g: int, phi: Array, v: Array) -> None:
    """Update how quickly the orthogonal regressors of group g move; phi (p,), constant first, scratch v (p,)."""
    R = x.R[g]
    now = x.samples[0] % x.whitened.shape[2]
    for a in range(s.loss_members.shape[0]):
        m = s.loss_members[a]
        past = x.whitened[g, a, now]
        moves, squares = x.motion[g, a, 0], x.motion[g, a, 1]
        for j in range(phi.shape[0]):
            total = phi[j]
            for k in range(j):
                total -= R[k, j, m] * v[k]
            v[j] = total / R[j, j, m]
            step = v[j] - past[j] if x.age[g] > s.straddle else 0.0
            moves[j] = s.forgetting[m] * moves[j] + step * step
            squares[j] = s.forgetting[m] * squares[j] + v[j] * v[j]
            past[j] = v[j]


@compiled
def noise_over(s: BankSettings, x: BankState, q: int, samples: float) -> float:
    """Variance of sums of so many innovations in row q, over that number; 0: not known yet.

    Straight between those that are remembered, of what is shorter than a window the largest.
    """
    value = 0.0
    place = float(s.straddle)
    length = 1
    for j in range(x.sum_squares.shape[1]):
        own = x.sum_squares[q, j]
        if x.sums_taken[q] < BEGUN * length:
            break
        here = own[0] / own[1]
        if length <= s.straddle:
            value = max(value, here)
        elif samples > place:
            value += min((samples - place) / (length - place), 1.0) * (here - value)
            place = float(length)
        length *= 2
    return value


@compiled
def find_whitening(s: BankSettings, x: BankState, a: int, q: int, n: float, model: float, work: BankWork) -> None:
    """Find by what coordinates of row q's change are multiplied for all to have the noise n, ``work.whitening``.

    Parameters
    ----------
    s, x
        Settings and state.
    a, q
        Which of the members that are compared, and row.
    n
        Variance, with model error.
    model
        That of model error alone, which is taken for white.
    work
        ``whitening`` (p,) is filled in; 1 where derivatives are measured, or not enough is known of their noise yet.
    """
    motion = x.motion[x.group[q], a]
    for i in range(work.whitening.shape[0]):
        work.whitening[i] = 1.0
        if s.straddle == 0 or s.differenced[q] == 0:
            continue
        edge = 0.0
        for k in range(x.whitened.shape[2]):
            v = x.whitened[x.group[q], a, k, i]
            edge += v * v
        moved = motion[0, i] + 2.0 * edge
        stays = 2.0 * s.straddle * motion[1, i] / moved if moved > 0.0 else math.inf
        own = noise_over(s, x, q, stays)
        if own > 0.0:
            work.whitening[i] = math.sqrt(n / (own + model))
