"""What noise in the states makes of the estimates of a short memory: no change of the aircraft.

Noise of variance ``sigma^2`` in regressor i draws least squares from the truth (Fuller). Of a member of factor R that
remembers n samples, with the constant projected out::

    R'R (theta - true) = - n sigma^2 theta_i e_i,       R (theta - true) = - n sigma^2 theta_i R'^-1 e_i

Where little but dither moves, a memory of tenths of a second holds more noise than motion of sideslip or of a rate, and
its estimates of what these do are nothing, though the best known ones, that remember a manoeuvre, are right. All of
what the members of `bank.losses` differ from them by was then taken for model error, and hid losses.

So of a row's difference that which goes along these directions, and no further than noise makes it, is taken off first.
Directions of surfaces are not touched: ``(R a)' R'^-1 e_i = a_i``, which is zero of every state.

References
----------
Fuller, *Measurement Error Models*, 1987, section 2.2.
"""

from __future__ import annotations

from msls_ros.estimation.bank.attenuation import NOTICED, noise_in, turned_part
from msls_ros.estimation.bank.effector_noise import entering_part
from msls_ros.estimation.bank.loop_settings import BankSettings
from msls_ros.estimation.bank.state import BankState
from msls_ros.estimation.bank.work import BankWork
from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array


@compiled
def find_noise_moves(s: BankSettings, x: BankState, g: int, m: int, work: BankWork) -> None:
    """Find which way noise in each state moves the estimates of member m of group g: ``work.noise_moves``.

    Row i holds ``R'^-1 e_i`` for the factor ``work.columns`` without the constant, and ``n sigma^2`` at its place; 0 of
    what is hardly noise. ``work.moved`` holds its squared length.
    """
    p = work.columns.shape[0]
    for i in range(1, s.effectors_from + 1):
        move = work.noise_moves[i]
        variance = noise_in(s, x, g, i, m, work.noise)
        move[0] = variance if variance > NOTICED * x.info[g, i, m] else 0.0
        if move[0] <= 0.0:
            continue
        size = 0.0
        for j in range(1, p):
            column = work.columns[j]
            total = 1.0 if j == i else 0.0
            for k in range(i, j):
                total -= column[k] * move[k]
            move[j] = total / column[j] if j >= i else 0.0
            size += move[j] * move[j]
        work.moved[i] = size


@compiled
def take_off_noise(s: BankSettings, x: BankState, before: Array, q: int, m: int, work: BankWork) -> int:
    """Take off ``work.w``, row q's difference in the factor, what noise in the states makes of it.

    Parameters
    ----------
    s, x
        Settings and state.
    before
        (r, p) older estimates, constant first: what noise draws from.
    q, m
        Row, and the member that differs.
    work
        ``noise_moves`` says which way; ``w`` (p,) is changed.

    Returns
    -------
    int
        How many directions were fitted, of each a part between none and all that noise makes: degrees of freedom that
        ``work.w`` has lost.
    """
    p = work.columns.shape[0]
    fitted = 0
    for i in range(1, s.effectors_from + 1):
        move = work.noise_moves[i]
        if move[0] <= 0.0:
            continue
        turned = turned_part(s, x, q, i, m)
        if turned != 0.0:
            turned = entering_part(s, x, q, i, turned)
        amount = move[0] * (before[q, i] + turned)
        along = 0.0
        for j in range(i, p):
            along += work.w[j] * move[j]
        whole = amount * amount * work.moved[i]
        if whole <= 0.0:
            continue
        share = min(max(-amount * along / whole, 0.0), 1.0)
        fitted += 1 if 0.0 < share < 1.0 else 0
        for j in range(i, p):
            work.w[j] += share * amount * move[j]
    return fitted
