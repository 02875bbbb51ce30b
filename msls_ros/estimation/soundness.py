"""Are the numbers of an estimator still sound? If not, everything is forgotten, as by a reset, and learnt anew.

Every value below 1e12 is accepted, every parameter within its range, and some of these together no arithmetic survives:
a covariance that grows for thousands of samples, or a burst of huge values that a factor with lambda 1 never forgets.
So after each sample it is looked whether

- an estimate or a variance is not finite, or larger than any sample could have made it; the covariance of RLS is none;
- the model predicts worse than none: for 2p samples more often than not the prediction error was beyond what aircraft
  do, and ten times what was measured::

      |e| > 30 [m/s^2, rad/s^2]   and   |e| > 10 |y|

- a sample was absurd: a regressor or an output larger than 1e6 in SI units, which is of no aircraft. What such a sample
  leaves looks like knowledge (it pins what it multiplies), so after 2p samples without one all is learnt anew.

A row with such an error, and every row from an absurd sample on, is not called reliable at once. None of it happens in
ordinary flight; the estimates of such a flight keep their bits. Bursts of less widen the error bars as long as they are
remembered, see `residuals.remember_burst`.
"""

from __future__ import annotations

from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Array, Integers

SOUND, NOT_FINITE, MISFIT, ABSURD = 0, 1, 2, 3
"""What `Output.restart` says of a sample."""
PACE = 4
"""Samples come at another rate than before, see `screening`."""
RESPONSE = 5
"""Deflections act otherwise than was taken, see `bank.responses`: the estimator has begun anew by itself."""

LARGEST_ESTIMATE = 1e30
"""More than the quotient of any two numbers that matter."""

LARGEST_VARIANCE = 1e100
"""Over the residual variance; products with squared samples stay finite."""

SMALLEST_PENALTY = 1e-15
"""A penalty below this share of the scale counts as none: its inverse square would be no variance."""

FAR, WORSE = 30.0, 10.0
"""Prediction error beyond what aircraft do [m/s^2, rad/s^2]; so many times what was measured [1]."""

NO_AIRCRAFT = 1e6
"""A regressor or an output of this size is of no aircraft [SI units]."""


@compiled
def count_misfits(misfits: Integers, phi: Array, y: Array, e: Array) -> int:
    """Count the samples with absurd prediction errors, up, and those without, down to 0; judge.

    After an absurd sample the counts are negative: the samples without one that are still to come.

    Parameters
    ----------
    misfits
        (r,) counts; updated.
    phi
        (p,) regressors.
    y, e
        (r,) outputs and prediction errors.

    Returns
    -------
    int
        `SOUND`, `MISFIT` or `ABSURD`.
    """
    limit = 2 * phi.shape[0]
    if exceeds(phi, NO_AIRCRAFT) or exceeds(y, NO_AIRCRAFT):
        for q in range(misfits.shape[0]):
            misfits[q] = -limit
        return SOUND
    verdict = SOUND
    for q in range(misfits.shape[0]):
        error = abs(e[q])
        if misfits[q] < 0:
            misfits[q] += 1
            if misfits[q] == 0:
                verdict = ABSURD
        elif error > FAR and error > WORSE * abs(y[q]):
            misfits[q] += 1
            if misfits[q] >= limit:
                verdict = MISFIT
        elif misfits[q] > 0:
            misfits[q] -= 1
    return verdict


@compiled
def exceeds(values: Array, limit: float) -> bool:
    """Whether any of (n,) is larger than the limit, or no number."""
    outside = 0
    for i in range(values.shape[0]):
        if not abs(values[i]) <= limit:
            outside += 1
    return outside > 0


@compiled
def all_within(values: Array, limit: float) -> bool:
    """Whether all of (n, m) are numbers smaller in size than the limit."""
    outside = 0
    for i in range(values.shape[0]):
        for k in range(values.shape[1]):
            if not abs(values[i, k]) < limit:
                outside += 1
    return outside == 0


@compiled
def share(value: float) -> float:
    """Return a share, which rounding may have put outside 0 to 1."""
    if value >= 1.0:
        return 1.0
    return value if value > 0.0 else 0.0
