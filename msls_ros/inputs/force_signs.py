"""Wrong signs of the small forces, ahead and to the side, which the weight hides.

Over windows of a fifth of a second the velocity shows the mean specific force a along the axes of the aircraft, the
accelerometer measures f (m/s^2, FRD). With the angular accelerations, for it may be far from the centre of mass::

    a_i = c + m_i f_i + sum_(j not i) m_ij f_j + tau df_i/dt + sum_j r_ij domega_j/dt

m_i is 1, or -1 where the sign is wrong. Gusts make anything of it where the velocity is that of the air, and no less of
that of the other axes: a sign is called wrong only where another axis agrees.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from msls_ros.estimation.kernel import Array
from msls_ros.inputs.error_regression import regress
from msls_ros.inputs.findings import WRONG, Finding
from msls_ros.inputs.motion import Motion, Reading

_OPPOSITE, _ERROR = 0.5, 0.15
"""By which the slope may differ from -1, and its standard error at most."""
_AGREES, _WELL = 0.2, 0.1
"""The same, of the slope of another axis from 1."""
_MEMORY = 1.0
"""Over which residuals are correlated [s]."""
_SHORTEST = 8.0
"""Record from which something is said [s]."""


def force_slopes(motion: Motion, reading: Reading) -> tuple[Array, Array] | None:
    """Return the slopes m (3,) and their standard errors (3,), infinite of what the flight does not show.

    Returns
    -------
    tuple or None
        None without attitude, rates, velocity or accelerometer, or in less than eight seconds.
    """
    found = motion.pulls(reading)
    if found is None:
        return None
    shown, felt, spins, noise, width = found
    if (len(felt) - 2 * width) * motion.step < _SHORTEST:
        return None
    change = (felt[2 * width :] - felt[: -2 * width]) / (2 * width * motion.step)
    inner = slice(width, len(felt) - width)
    slopes, errors = np.zeros(3), np.full(3, np.inf)
    for i in range(3):
        x = np.column_stack([felt[inner], change[:, i], spins[inner]])
        weights, variance = regress(x, shown[inner, i], np.append(noise, np.zeros(4)), round(_MEMORY / motion.step))
        slopes[i], errors[i] = weights[i], np.sqrt(variance[i])
    return slopes, errors


def check_force_signs(motion: Motion, reading: Reading, entry: str) -> Iterator[Finding]:
    """Yield that the sign of the accelerometer is wrong along an axis.

    Parameters
    ----------
    motion, reading
        As `force_slopes`.
    entry
        Of the map, of the accelerometer.
    """
    found = force_slopes(motion, reading)
    if found is None:
        return
    slopes, errors = found
    wrong = (np.abs(slopes + 1.0) < _OPPOSITE) & (errors < _ERROR)
    if not wrong.any() or not ((np.abs(slopes - 1.0) < _AGREES) & (errors < _WELL)).any():
        return
    named = "; ".join(f"{'XYZ'[i]} {slopes[i]:.2f} +- {errors[i]:.2f}" for i in np.flatnonzero(wrong))
    what = "along an axis of the aircraft the velocity does not change as the accelerometer says "
    what += f"(slope {named}; 1 agrees, -1 opposite)"
    yield Finding(WRONG, "motion", entry, what, "scale=" + ",".join("-1" if one else "1" for one in wrong))
