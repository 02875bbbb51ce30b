"""What the last seconds say against an estimate: the member of a second and a half contradicts it beyond chance.

What dither alone shows of a change counts little in the evidence, but it must not be hidden: a part of the square of
the contradiction is in the errors (`bank.uncertainty`). Noise of the deflections draws what that member knows of an
effector, and is reckoned of all of them at once where their effects are known (`find_pulled`).

References
----------
Fuller, *Measurement Error Models*, 1987, section 2.2.
"""

from __future__ import annotations

from msls_ros.estimation.bank.attenuation import LEARNT
from msls_ros.estimation.bank.changes import VAGUE
from msls_ros.estimation.bank.effector_noise import most_noise
from msls_ros.estimation.bank.loop_settings import BankSettings
from msls_ros.estimation.bank.residual import residual_variance
from msls_ros.estimation.bank.rest import KNOWN, unanswered_noise, was_answered
from msls_ros.estimation.bank.state import BankState
from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array

CHANCE = 4.0
"""Squared standard errors by which the last seconds may differ from the estimate by chance."""
CONTRADICTED, CONTRADICTED_THROUGH = 0.25, 0.5
"""Share of the square by which the last seconds contradict an estimate that counts; through windows as `REACH_THROUGH`.

With .5, 95 % of the errors are within .3 to 1.4 of a bar that this dominates (seeds 845 and 205, all beds).
"""


@compiled
def disagreement(s: BankSettings, x: BankState, q: int, i: int) -> float:
    """Square by which the member of the last seconds contradicts row q's coefficient i, beyond what chance makes.

    What it knows of an effector is less what is noise of its record (`bank.effector_noise`); of one that has moved by
    less than that it says nothing.
    """
    m, g = s.recent, x.group[q]
    info = x.info[g, i, m]
    motion = 1.0
    difference = x.members[q, i, m] - x.mixed[q, i]
    if s.effectors_from < i <= s.effectors_to:
        motion -= x.taken[g, m] * unanswered_noise(s, x, i - s.effectors_from - 1) / info
        if motion < LEARNT:
            return 0.0
        if is_known_best(x, q, i):
            difference = max(abs(difference + x.pulled[i]) - abs(x.vague[i]), 0.0) / motion
        else:
            difference = difference / motion + (1.0 - motion) / motion * x.mixed[q, i]
    chance = CHANCE * residual_variance(x, q) / (info * motion)
    share = CONTRADICTED if s.straddle == 0 else CONTRADICTED_THROUGH
    return float(share * max(difference * difference - chance, 0.0))


@compiled
def is_known_best(x: BankState, q: int, i: int) -> bool:
    """Whether row q's coefficient i has been known, so that what noise makes of it can be reckoned."""
    return bool(KNOWN * x.best_square[q, i] <= x.mixed[q, i] * x.mixed[q, i])


@compiled
def find_pulled(s: BankSettings, x: BankState, q: int) -> None:
    """Find what noise of the deflections makes of row q's last estimates, ``x.pulled``, ``x.vague`` (p,).

    With sums of products ``R'R``, of which ``n N`` is such noise, they are ``theta - (R'R)^-1 n N theta`` (Fuller). Of
    an effector by itself that is its share of the information; of two that move together it is next to nothing but
    along what they do apart, where one has what the other has lost. What may be noise and was never answered as large
    is to a half, as in `bank.changes`. Of effects that are not known nothing is found.
    """
    m, g = s.recent, x.group[q]
    for i in range(x.pulled.shape[0]):
        x.pulled[i] = 0.0
        x.vague[i] = 0.0
        if s.effectors_from < i <= s.effectors_to and is_known_best(x, q, i):
            j = i - s.effectors_from - 1
            noise = unanswered_noise(s, x, j)
            most = 0.0 if was_answered(s, x, j) else most_noise(s, x, j)
            x.vague[i] = VAGUE * max(most - noise, 0.0) * x.taken[g, m] * x.mixed[q, i]
            x.pulled[i] = noise * x.taken[g, m] * x.mixed[q, i] + x.vague[i]
    solve_factor(x.R[g], m, x.pulled)
    solve_factor(x.R[g], m, x.vague)


@compiled
def solve_factor(R: Array, m: int, w: Array) -> None:
    """Solve ``R'R y = w`` in place, (p,), R of member m of (p, p, m)."""
    p = w.shape[0]
    for i in range(p):
        for k in range(i):
            w[i] -= R[k, i, m] * w[k]
        w[i] /= R[i, i, m]
    for i in range(p - 1, -1, -1):
        for k in range(i + 1, p):
            w[i] -= R[i, k, m] * w[k]
        w[i] /= R[i, i, m]
