"""What the compiled dither law is given: its parameters, samples and what is known of B, multisines, scratch."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msls_ros.estimation.compiled import passed_by_reference
from msls_ros.estimation.kernel import Array, Integers


@passed_by_reference
class Law(NamedTuple):
    """What the compiled law needs to know; m effectors."""

    enabled: bool
    limit_nominal: float
    limit_boosted: float
    """[g]"""
    boost_duration: float
    boost_budget: float
    stale_after: float
    period: float
    """[s]"""
    cap_unreliable: float
    """Rms of a surface while its column is not excited, for a weight of 1 [rad]."""
    excitation: float
    """Least excitation of a column that counts as excited [1]."""
    known_error: float
    """Relative error of what counts as known [1]."""
    target_error: float
    """Relative error to which an effector need be known; 0: as well as the limit allows [1]."""
    worst_case: bool
    information: bool
    rest: float
    """Square of an acceleration, integrated while the slowest actuator comes to rest, over the square at once [s]."""
    activity_nominal: float
    activity_boosted: float
    """Largest rms rate of a surface by the dither; 0: not limited [rad/s]."""
    station: Array
    """(3,) l1, l2, l3 [m]."""
    rows: Integers
    """(6,) index of u, v, w, P, Q, R among the rows; negative where absent."""


@passed_by_reference
class Knowledge(NamedTuple):
    """What the estimator says of B at each of n samples; r rows, m effectors."""

    b: Array
    """(n, r, m) estimates."""
    variance: Array
    """(n, r, m) their variances; infinite where nothing is known."""
    excitation: Array
    """(n, m) least excitation of each column in any row [1]."""
    alarm: Integers
    """(n, r) 1 where an abrupt change was declared."""
    output: Array
    """(n, r, 1) what the rows' states do as measured, less what is known of it; NaN where that is not there."""


class Instant(NamedTuple):
    """A sample to answer, and what is known at it; r rows, m effectors."""

    time: float
    """[s]"""
    dt: float
    """Since the last sample [s]."""
    held: float
    """For how long of that the last commands were held: no longer than `Law.stale_after` [s]."""
    b: Array
    variance: Array
    excitation: Array
    output: Array
    """(r, m), (r, m), (m,), (r, 1): see `Knowledge`."""
    alarmed: bool
    """Whether any row has an alarm."""
    delta: Array
    """(m,) measured deflections [rad]."""
    noise: Array
    """(m,) independent, zero mean, unit rms; not read where there are multisines."""


class Budget(NamedTuple):
    """What the window (`dither.window`) allows."""

    unit: float
    """One over the square of the limit, by which the window is filled; 0: there is no window [s^4/m^2]."""
    least: float
    """One over the square of what is aimed at, by which commands are held back; 0: they are not [s^4/m^2]."""
    together: float
    """What holding back leaves of the sum of the squares, 0 to 1."""


@passed_by_reference
class Comb(NamedTuple):
    """Multisines, one for each of m effectors."""

    period: float
    """[s]; 0: none."""
    frequencies: Array
    """(m, h) [Hz]."""
    phases: Array
    """(m, h) [cycles]."""
    origin: Array
    """(1,) time at which they began [s]."""


@passed_by_reference
class DitherWork(NamedTuple):
    """Scratch of one sample; m effectors."""

    square: Array
    """(m,) what the square of each effect at the station may be, see `dither.rms.weigh_entries` [m^2/s^4/rad^2]."""
    unsure: Array
    """(m,) what errors of B-hat may add to it in the window."""
    caps: Array
    """(m,) largest rms of each surface [rad]."""
    wave: Array
    """(m,) multisines now."""
    axes: Array
    """(3,) by the body's axes."""


def make_dither_work(m: int) -> DitherWork:
    """Allocate it."""
    return DitherWork(np.zeros(m), np.zeros(m), np.zeros(m), np.zeros(m), np.zeros(3))
