"""Are the numbers of an estimator still sound? If not, everything is forgotten, as by a reset, and learnt anew.

Every value below 1e12 is accepted, every parameter within its range, and some of these together no arithmetic survives:
a covariance that grows for thousands of samples, or a burst of huge values that a factor with lambda 1 never forgets.
So after each sample it is looked whether

- an estimate or a variance is not finite, or larger than any sample could have made it; the covariance of RLS is none;
- the model predicts worse than none: for 2p samples more often than not the prediction error was beyond what aircraft
  do, and ten times what was measured::

      |e| > 30 [m/s^2, rad/s^2]   and   |e| > 10 |y|

A row with such an error is not called reliable at once. Neither happens in ordinary flight; the estimates of such a
flight keep their bits.
"""

from __future__ import annotations

from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array, Integers

SOUND, NOT_FINITE, MISFIT = 0, 1, 2
"""What `Output.restart` says of a sample."""

LARGEST_ESTIMATE = 1e30
"""More than the quotient of any two numbers that matter."""

LARGEST_VARIANCE = 1e100
"""Over the residual variance; products with squared samples stay finite."""

SMALLEST_PENALTY = 1e-15
"""A penalty below this share of the scale counts as none: its inverse square would be no variance."""

FAR, WORSE = 30.0, 10.0
"""Prediction error beyond what aircraft do [m/s^2, rad/s^2]; so many times what was measured [1]."""


@compiled
def count_misfits(misfits: Integers, y: Array, e: Array) -> int:
    """Count the samples with absurd prediction errors, up, and those without, down to 0; return the largest count.

    Parameters
    ----------
    misfits
        (r,) counts; updated.
    y, e
        (r,) outputs and prediction errors.
    """
    largest = 0
    for q in range(misfits.shape[0]):
        error = abs(e[q])
        if error > FAR and error > WORSE * abs(y[q]):
            misfits[q] += 1
        elif misfits[q] > 0:
            misfits[q] -= 1
        largest = max(largest, misfits[q])
    return largest


@compiled
def all_within(values: Array, limit: float) -> bool:
    """Whether all of (n, m) are numbers no larger than the limit."""
    outside = 0
    for i in range(values.shape[0]):
        for k in range(values.shape[1]):
            if not abs(values[i, k]) <= limit:
                outside += 1
    return outside == 0


@compiled
def share(value: float) -> float:
    """Return a share, which rounding may have put outside 0 to 1."""
    if value >= 1.0:
        return 1.0
    return value if value > 0.0 else 0.0
