"""Effectors that move together as they have not lately: what is not known of it may not be called a change.

Elevons that a law has only moved together have each gone as far as they ever will when they first go apart in roll, and
the roll that they make is known to nobody: ``0 +- 43``, where nothing but the noise of their records has set them
apart. So all effectors are looked at together: the squared size of their motion h, in units of its own covariance C of
the last seconds, is chi-square of as many degrees of freedom n as they are, and as rare as the square of a normal
deviate z where::

    h' C^-1 h / n > (1 - 2/(9n) + z sqrt(2/(9n)))^3

Then errors are excused by all that the standard errors say (`bank.allowances.moved_square`), and not by `HIDDEN` times
of it at most, which shows faults behind noise in other flight. A canard jet with eight effectors (10 t, 100 Hz, made up
by others, not one of ours), a pitch doublet and three seconds later the first roll doublet, 10 intact flights at each
of two levels of noise: 10 and 10 had an alarm without dither, 2 and 10 with it, and now 0, 0, 0 and 1.

References
----------
Wilson and Hilferty, "The distribution of chi-square", Proc. Nat. Acad. Sci. 17 (1931).
"""

from __future__ import annotations

import math

from msls_ros.estimation.bank.loop_settings import BankSettings
from msls_ros.estimation.bank.state import BankState
from msls_ros.estimation.compiled import compiled

KNOWN, BEGINS, ANEW = range(3)
"""How effectors move together: as they have lately; as they may not have; as they have not."""
RARE, MAY_BE_RARE = 4.87, 2.24
"""Normal deviates exceeded as seldom as `bank.energy.FIRST`, `bank.waiting.BEGINS` by the square of one."""
ALIKE = 1e-4
"""Share of its own mean square by which an effector moves apart from others at least: a hundredth of its motion [1]."""


@compiled
def observe_together(s: BankSettings, x: BankState) -> None:
    """Fill in ``x.together``: how effectors move together, see above."""
    n = 0
    square = 0.0
    count = x.quick_samples[0]
    factor = x.together_factor
    x.together[0] = KNOWN
    if count <= 2.0 * factor.shape[0]:
        return
    for i in range(s.effectors_from + 1, s.effectors_to + 1):
        own = x.moment[i, i] / count
        if own <= 0.0:
            continue
        left = x.quick[i]
        apart = own
        column = 0
        for k in range(s.effectors_from + 1, i):
            if x.moment[k, k] <= 0.0:
                continue
            common = x.moment[i, k] / count
            for m in range(column):
                common -= factor[n, m] * factor[column, m]
            factor[n, column] = common / factor[column, column]
            left -= factor[n, column] * x.together_moves[column]
            apart -= factor[n, column] * factor[n, column]
            column += 1
        factor[n, n] = math.sqrt(max(apart, ALIKE * own))
        x.together_moves[n] = left / factor[n, n]
        square += x.together_moves[n] * x.together_moves[n]
        n += 1
    if n > 1 and square > rare_square(n, MAY_BE_RARE):
        x.together[0] = ANEW if square > rare_square(n, RARE) else BEGINS


@compiled
def rare_square(n: int, deviate: float) -> float:
    """Return chi-square of n degrees of freedom that is exceeded as seldom as a normal deviate."""
    part = 2.0 / (9.0 * n)
    root = 1.0 - part + deviate * math.sqrt(part)
    return float(n * root * root * root)
