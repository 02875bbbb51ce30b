"""Exponential and logarithm from plain arithmetic: those of the C library differ in the last bit between processors.

Scaling by powers of two (`math.frexp`, `math.ldexp`) is exact everywhere; between them stand series whose terms are
summed in one fixed order.
"""

from __future__ import annotations

import math

import numpy as np

from msls_ros.estimation.compiled import compiled

_LN2_HIGH = 6.93147180369123816490e-01
_LN2_LOW = 1.90821492927058770002e-10
"""ln 2 in two parts: the product of the first and a whole number below 2^21 is exact."""


@compiled
def exponential(x: float) -> float:
    """e^x within 2 units in the last place; 0 below -700, e^700 above 700.

    Argument reduction by ln 2 in two parts, then the Taylor series to the last bit on [-ln(2)/2, ln(2)/2].
    """
    if x < -700.0:
        return 0.0
    if x > 700.0:
        x = 700.0
    turns = np.floor(x * 1.4426950408889634 + 0.5)
    r = (x - turns * _LN2_HIGH) - turns * _LN2_LOW
    total = 1.0 / 6227020800.0
    total = total * r + 1.0 / 479001600.0
    total = total * r + 1.0 / 39916800.0
    total = total * r + 1.0 / 3628800.0
    total = total * r + 1.0 / 362880.0
    total = total * r + 1.0 / 40320.0
    total = total * r + 1.0 / 5040.0
    total = total * r + 1.0 / 720.0
    total = total * r + 1.0 / 120.0
    total = total * r + 1.0 / 24.0
    total = total * r + 1.0 / 6.0
    total = total * r + 0.5
    return math.ldexp(1.0 + (r + r * r * total), int(turns))


@compiled
def logarithm(x: float) -> float:
    """Natural logarithm of a positive x within 2 units in the last place.

    With ``x = m 2^k``, ``m`` in [1/sqrt 2, sqrt 2], the series of ``2 artanh((m-1)/(m+1))`` to the last bit.
    """
    mantissa, exponent = math.frexp(x)
    if mantissa < 0.7071067811865476:
        mantissa *= 2.0
        exponent -= 1
    s = (mantissa - 1.0) / (mantissa + 1.0)
    q = s * s
    total = 1.0 / 21.0
    total = total * q + 1.0 / 19.0
    total = total * q + 1.0 / 17.0
    total = total * q + 1.0 / 15.0
    total = total * q + 1.0 / 13.0
    total = total * q + 1.0 / 11.0
    total = total * q + 1.0 / 9.0
    total = total * q + 1.0 / 7.0
    total = total * q + 0.2
    total = total * q + 1.0 / 3.0
    return exponent * _LN2_HIGH + (2.0 * (s + s * q * total) + exponent * _LN2_LOW)
