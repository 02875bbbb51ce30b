"""Complete arrays of which some derivatives are not measured: the window of the flight, for a library's user.

What `adapter.InputAdapter` does with messages is done here with arrays: spikes are dropped first, and velocities that
jump without a force are found (`velocity_jumps`); then states, deflections and measured derivatives are smoothed by the
window in which the other derivatives are made, so that ``xdot = A x + B delta`` stays true between them (see
`derivatives`). Over how many intervals that was the identifier
must know (`Identifier`'s ``straddle``).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from msls_ros.estimation import Configuration, EstimationError
from msls_ros.estimation.arguments import Stamps, as_numbers, as_whole
from msls_ros.estimation.kernel import Array
from msls_ros.estimation.samples import check_samples
from msls_ros.estimation.screening import GAP
from msls_ros.estimation.spikes import SpikeFilter, spike_settings
from msls_ros.inputs.derivatives import DerivativeFilter, usual_intervals
from msls_ros.inputs.velocity_jumps import JumpFilter, velocities_made

LONGEST_GAP = 0.1
"""Samples further apart [s] are not of one window, nor those further apart than `GAP` periods."""


class Windowed(NamedTuple):
    """Samples as the identifier takes them: k of n states and m effectors."""

    time: Array
    """(k,) middle of each window [s]."""
    x: Array
    xdot: Array
    delta: Array
    """(k, n), (k, n), (k, m): means over the window."""
    straddle: int
    """Intervals of the window, for `Identifier`; 0: all derivatives were measured, and nothing is changed."""
    jumps: int = 0
    """Jumps of velocities that were left out of their derivatives, see `velocity_jumps`."""
    largest_jump: float = 0.0
    """Largest of them [m/s]."""


def differentiated(
    configuration: Configuration, time: Any, x: Any, xdot: Any, delta: Any, *, intervals: int = 0
) -> Windowed:
    """Make the derivatives that nobody measures, in a window that all else goes through as well.

    Parameters
    ----------
    configuration
        Of the identifier: names, ``sample_rate``, ``reference_speed``.
    time
        (k,) [s], increasing.
    x
        (k, n) states [m/s, rad/s, rad].
    xdot
        (k, n) their derivatives; a column of NaN is made. None: all are.
    delta
        (k, m) measured deflections [rad].
    intervals
        Of the window, 2 or more; 0: as many as .1 s has, and four at least.

    Returns
    -------
    Windowed
        Fewer samples than were given: a window shorter at the beginning and after each gap, and without spikes.

    Raises
    ------
    EstimationError
        For what `Identifier.run` refuses, a column of derivatives of which some are NaN, and too few samples for one
        window.

    Examples
    --------
    >>> made = differentiated(configuration, time, x, None, delta)  # doctest: +SKIP
    >>> Identifier(configuration, made.straddle).run(*made[:4])  # doctest: +SKIP
    """
    c, n, m = configuration, len(configuration.states), len(configuration.effectors)
    intervals = as_whole("intervals", intervals, 0)
    measured, made = _checked(c, time, x, xdot, delta)
    if not made.any():
        return measured
    stamps = measured.time
    period = max(float(np.median(np.diff(stamps))) if len(stamps) > 1 else 0.0, 1.0 / c.sample_rate)
    intervals, longest = intervals or usual_intervals(1.0 / period), max(LONGEST_GAP, GAP * period)
    window, spikes = DerivativeFilter(intervals, 2 * n + m, round(1e9 * longest)), _spikes(c, longest)
    methods = zip(c.states, made.tolist(), strict=True)
    leaps = JumpFilter(velocities_made(methods), c.reference_speed, round(1e9 * longest))
    whole = np.hstack([_continued(c, measured.x), measured.delta, measured.xdot])
    rows = []
    for stamp, row in zip(np.rint(1e9 * stamps).astype(np.int64).tolist(), whole, strict=True):
        for settled in (one for used in spikes.push(stamp, row) for one in leaps.push(*used)):
            filtered = window.push(*settled)
            if filtered is not None:
                derivative = np.where(made, filtered.slope[:n], filtered.smooth[n + m :])
                rows.append((filtered.stamp * 1e-9, filtered.smooth[:n], derivative, filtered.smooth[n : n + m]))
    if not rows:
        message = (
            f"time has {len(stamps)} samples, of which no {intervals + 1} follow each other within {longest:g} s: "
        )
        message += "too few for the window of the derivatives"
        raise EstimationError(message)
    columns = [np.array(column) for column in zip(*rows, strict=True)]
    return Windowed(columns[0], columns[1], columns[2], columns[3], intervals, leaps.count, leaps.largest)


def _checked(c: Configuration, time: Any, x: Any, xdot: Any, delta: Any) -> tuple[Windowed, NDArray[np.bool_]]:
    """Return the arrays as they are, zero where a derivative is to be made, and (n,) which are."""
    stamps = as_numbers("time", time)
    Stamps(c.sample_rate, gated=False).check(stamps, getattr(time, "dtype", np.float64))
    states, deflections = as_numbers("x", x), as_numbers("delta", delta)
    known = np.full_like(states, np.nan) if xdot is None else as_numbers("xdot", xdot).copy()
    made: NDArray[np.bool_] = np.zeros(len(c.states), np.bool_)
    if len(stamps) and known.ndim == 2 and known.shape[1] == len(c.states):
        made = np.asarray(np.isnan(known).all(axis=0))
        known[:, made] = 0.0
    check_samples(c, len(stamps), states, known, deflections)
    return Windowed(stamps, states, known, deflections, 0), made


def _continued(c: Configuration, x: Array) -> Array:
    """Return states whose angles do not jump by a turn."""
    found = x.copy()
    for i, name in enumerate(c.states):
        if name in ("Phi", "Theta", "Psi"):
            found[:, i] = np.unwrap(x[:, i])
    return found


def _spikes(c: Configuration, gap: float) -> SpikeFilter:
    n, m = len(c.states), len(c.effectors)
    velocity = [name in ("u", "v", "w") for name in c.states]
    kinds = [*velocity, *[False] * m, *velocity], [*[False] * (n + m), *[True] * n]
    effector = [*[False] * n, *[True] * m, *[False] * n]
    return SpikeFilter(spike_settings(*kinds, c.reference_speed, gap, effector=effector))
