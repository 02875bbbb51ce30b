"""Elementary functions whose bits do not depend on the mathematics library of the machine.

Each is a fixed sequence of additions, multiplications and divisions, which IEEE 754 defines to the last bit.
"""

from __future__ import annotations

import math

from msls_ros.estimation.compiled import compiled

LOG2_E = 1.4426950408889634
LN2_HIGH, LN2_LOW = 0.6931471803691238, 1.9082149292705877e-10
"""ln 2 in two parts; the first has trailing zeros, so that its products with small integers are exact."""
TERMS = 13
"""Of the Taylor series on |r| <= ln(2)/2: the next is below 1e-16 of the sum."""


@compiled
def exponential(x: float) -> float:
    """Return e to the x: ``x = k ln 2 + r``, the Taylor series of ``e^r``, and k doublings or halvings.

    Relative error below 1e-15; 0 below -700, infinite above 700.
    """
    if not x > -700.0:
        return 0.0 if x <= -700.0 else x
    if x > 700.0:
        return math.inf
    k = math.floor(x * LOG2_E + 0.5)
    r = (x - k * LN2_HIGH) - k * LN2_LOW
    total = 1.0
    for n in range(TERMS, 0, -1):
        total = 1.0 + total * r / n
    factor = 2.0 if k > 0 else 0.5
    for _ in range(abs(int(k))):
        total *= factor
    return total
