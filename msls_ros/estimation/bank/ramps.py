"""A moment that grows for a while, as where a centre of gravity moves: no surface has lost what it takes away.

An alarm begins anew. If what raised it goes on, the constants go on moving, and a law moves the surfaces against them.
Least squares with constants that do not move then makes of the ramp that the surface which meets it does nothing, and
that is a loss. So what a ramp of each row's own would explain of the change is a rival of a name, for ramps that end
within `LENGTHS` after the alarm or go on. Their directions are what the members themselves make of such outputs, which
have estimates as all others have (`members`), while a name is awaited.

A made-up aircraft whose law holds its bank (`test_bank_ramps`; rates differentiated; a moment grows for .3 to 2 s):
48 of 144 intact flights named the aileron, 11 do with this; of 12 losses all are named. Light aircraft whose centre of
gravity or trim moves within .5 or 2 s (nonlinear, not ours, low noise): 12 of 48, now 3; as many losses are named. Of
`calibration` (seeds 851, 852) all 138 names of losses remain.

References
----------
Basseville and Nikiforov, *Detection of Abrupt Changes*, 1993, chapter 7 (nuisance changes).
"""

from __future__ import annotations

from msls_ros.estimation.bank.state import BankState
from msls_ros.estimation.bank.work import BankWork
from msls_ros.estimation.compiled import compiled

LENGTHS = (0.25, 0.5, 1.0, 1000.0)
"""[s]. The last one alone leaves 8 of those 48 names of light aircraft; 2 s besides, 10 of the 144 for 11."""


@compiled
def begin_ramps(x: BankState, g: int) -> None:
    """Let them begin now in group g."""
    x.ramp_samples[g] = 0
    for h in range(x.ramps.shape[1]):
        for i in range(x.ramps.shape[2]):
            for m in range(x.ramps.shape[3]):
                x.ramps[g, h, i, m] = 0.0


@compiled
def is_pending(x: BankState, g: int) -> bool:
    """Whether a name is awaited of any row of group g."""
    pending = 0
    for q in range(x.group.shape[0]):
        pending += x.pending[q] if x.group[q] == g else 0
    return pending > 0


@compiled
def find_ramps(x: BankState, g: int, m: int, work: BankWork) -> None:
    """Find the directions of ramps in the factor ``work.columns`` of member m of group g: ``work.ramps`` (h, p)."""
    for h in range(work.ramps.shape[0]):
        ramp = work.ramps[h]
        for i in range(ramp.shape[0]):
            ramp[i] = 0.0
        for j in range(1, ramp.shape[0]):
            column = work.columns[j]
            for i in range(1, j + 1):
                ramp[i] += column[i] * x.ramps[g, h, j, m]


@compiled
def explain_by_ramps(n: float, work: BankWork) -> None:
    """Add what each ramp explains of a row's change ``work.w``, of noise n, to ``work.by_ramp``."""
    for h in range(work.ramps.shape[0]):
        along = 0.0
        size = 0.0
        for i in range(1, work.w.shape[0]):
            step = work.ramps[h, i] * work.whitening[i]
            along += step * work.w[i]
            size += step * step
        if size > 0.0:
            work.by_ramp[h] += along * along / size / n
