"""Exponential and logarithm from plain arithmetic: those of the C library differ in the last bit between processors.

Powers of two are taken out and put in by the bits of the number (IEEE 754), which is exact everywhere; between them
stand series whose terms are summed in one fixed order. There is no branch and no call, so that a loop over many numbers
becomes vector instructions: four to five times as fast as `math.frexp` and `math.ldexp`, with the same bits.
"""

from __future__ import annotations

import numpy as np

from msls_ros.estimation.compiled import compiled

_LN2_HIGH = 6.93147180369123816490e-01
_LN2_LOW = 1.90821492927058770002e-10
"""ln 2 in two parts: the product of the first and a whole number below 2^21 is exact."""
_FRACTION = np.int64(0x000FFFFFFFFFFFFF)
"""Bits of a number's fraction; above them stand those of its exponent, 1023 for 1 to 2."""
_HALF = np.int64(0x3FE0000000000000)
"""Bits of 1/2: with those of a fraction, a number from 1/2 to 1."""
_WHOLE = np.int64(0x4330000000000000)
"""Bits of 2^52: with those of a whole number n, 2^52 + n."""
_WIDTH = np.int64(52)


@compiled
def exponential(x: float) -> float:
    """e^x within 2 units in the last place; 0 below -700, e^700 above 700.

    Argument reduction by ln 2 in two parts, then the Taylor series to the last bit on [-ln(2)/2, ln(2)/2].
    """
    inside = min(max(x, -700.0), 700.0)
    turns = np.floor(inside * 1.4426950408889634 + 0.5)
    r = (inside - turns * _LN2_HIGH) - turns * _LN2_LOW
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
    bits = np.float64(turns + (4503599627370496.0 + 1023.0)).view(np.int64) << _WIDTH
    power = np.int64(bits).view(np.float64)
    return 0.0 if x < -700.0 else float((1.0 + (r + r * r * total)) * power)


@compiled
def logarithm(x: float) -> float:
    """Natural logarithm of a positive x within 2 units in the last place; of less than 2^-1022 it is that of 2^-1023.

    With ``x = m 2^k``, ``m`` in [1/sqrt 2, sqrt 2], the series of ``2 artanh((m-1)/(m+1))`` to the last bit.
    """
    bits = np.float64(x).view(np.int64)
    half = np.int64((bits & _FRACTION) | _HALF).view(np.float64)
    power = np.int64((bits >> _WIDTH) | _WHOLE).view(np.float64) - (4503599627370496.0 + 1022.0)
    low = half < 0.7071067811865476
    mantissa = half * 2.0 if low else half
    exponent = power - 1.0 if low else power
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
    not_finite = x - x  # what is no number remains none
    return float(exponent * _LN2_HIGH + (2.0 * (s + s * q * total) + exponent * _LN2_LOW) + not_finite)
