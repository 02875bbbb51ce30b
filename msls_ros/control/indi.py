"""Incremental nonlinear dynamic inversion: the change of acceleration that is wanted, by the surfaces that can give it.

The angular acceleration that the pilot's command asks for, nu, less the one that is measured is given by a change of
the surfaces, with all that the model does not know already in the measurement::

    psdot* = k_roll (ps_ref - ps) + ps_ref'                       ps about the velocity vector; ps_ref lags the command
    Qdot*  = k_pitch (k_alpha (alpha* - alpha) - alpha') - g_a    or k_pitch (Q* - Q)
    rsdot* = k_yaw (beta' + k_beta (beta - beta*)) + g_b          nu = roll, pitch, yaw parts, turned by alpha

    minimise over the surfaces s within their limits
      |W (B (s - s_f) - (nu - w'_f))|^2  +  g |s - s_trim|^2  +  c sum_k (sum_i W_i^2 sigma_ik^2) (s_k - s_f,k)^2

g_a and g_b are what the turn of gravity in the body axes adds to the second derivatives of alpha and beta: known from
attitude and rates alone, so it need not show as an error first. Where surfaces are lost or stuck, k_pitch and k_alpha
fall (`pitch_gains`): what is left has to do for longer, and with latency a law that asks for the same at once drives it
past where its effect ends.

s_f and w'_f are positions and accelerations behind one filter. B with its standard errors sigma is what is believed
(`believed`): the last term, caution, moves what is not known less. A stuck surface is where it is measured.

References
----------
Sieberling, Chu and Mulder, Robust flight control using incremental nonlinear dynamic inversion and angular
acceleration prediction, Journal of Guidance, Control, and Dynamics 33, 2010.
Smeur, Hoeppener and De Wagter, Prioritized control allocation for quadrotors subject to saturation, IMAV 2017.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from msls_ros.control.aircraft import ControlledAircraft
from msls_ros.control.allocation import Whole, allocate
from msls_ros.control.believed import Believed
from msls_ros.control.compiled import compiled
from msls_ros.control.linear import Array, Flags
from msls_ros.control.motion import Filters, Motion
from msls_ros.control.settings import ControlSettings
from msls_ros.control.signals import PilotCommand

LEAST_POWER = 1e-6
"""Control power below which there is none [1/s^4]."""


class Prices(NamedTuple):
    """What counts how much in the problem of the module."""

    weights2: Array
    """(3,) W^2 [1]."""
    price: float
    """g [1/s^4]."""
    caution: float
    """c [1]."""


class Surfaces(NamedTuple):
    """Where s surfaces are and may go [rad]."""

    positions: Array
    """(s,) s_f."""
    preferred: Array
    """(s,) s_trim."""
    low: Array
    high: Array
    """(s,) limits; equal where one is stuck."""


class Scratch(NamedTuple):
    """Working memory for s surfaces, see `allocate`."""

    h: Array
    """(s, s)"""
    f: Array
    """(s,)"""
    held: Whole
    """(s,)"""
    work: Array
    """(s + 1, s)"""


class Reference:
    """The roll rate that is followed: the pilot's, behind a lag.

    Parameters
    ----------
    lag
        [s]
    """

    def __init__(self, lag: float) -> None:
        """Begin at rest."""
        self._lag = lag
        self.rate, self.acceleration = 0.0, 0.0
        """[rad/s], [rad/s^2]"""

    def update(self, wanted: float, period: float) -> None:
        """Follow for a period [s]."""
        share = 1.0 if self._lag <= 0.0 else -math.expm1(-period / self._lag)
        change = share * (wanted - self.rate)
        self.acceleration = change / period if self._lag > 0.0 else 0.0
        self.rate += change


def pitch_gains(c: ControlSettings, power_left: float) -> tuple[float, float]:
    """Return the gains of pitch and of angle of attack [1/s].

    Parameters
    ----------
    c
        The power law, and the gains with all surfaces.
    power_left
        See `Believed.pitching_power_left`.

    Notes
    -----
    Natural frequency and damping are sqrt(k_pitch k_alpha) and sqrt(k_pitch / k_alpha) / 2: the damping stays.
    """
    factor: float = power_left**c.pitch_gain_power
    return factor * c.pitch_gain, factor * c.alpha_gain


def wanted_acceleration(
    c: ControlSettings, motion: Motion, command: PilotCommand, reference: Reference, power_left: float
) -> Array:
    """Return nu (3,): angular accelerations about the body axes that the command asks for [rad/s^2]."""
    pitch_gain, alpha_gain = pitch_gains(c, power_left)
    roll = c.roll_gain * (reference.rate - motion.roll_rate) + reference.acceleration
    if math.isnan(command.alpha):
        pitch = pitch_gain * (command.pitch_rate - motion.pitch_rate)
    else:
        pitch = pitch_gain * (alpha_gain * (command.alpha - motion.alpha) - motion.alpha_rate) - motion.alpha_turn
    yaw = c.yaw_gain * (motion.beta_rate + c.beta_gain * (motion.beta - command.beta)) + motion.beta_turn
    ca, sa = math.cos(motion.alpha), math.sin(motion.alpha)
    return np.array([roll * ca - yaw * sa, pitch, roll * sa + yaw * ca])


class Indi:
    """The law.

    Parameters
    ----------
    aircraft
        Whose surfaces.
    settings
        See `ControlSettings`.
    """

    def __init__(self, aircraft: ControlledAircraft, settings: ControlSettings) -> None:
        """Allocate everything; see the class."""
        s = len(aircraft.surfaces)
        self._settings = settings
        self._low, self._high = np.array(aircraft.low), np.array(aircraft.high)
        self._preferred = aircraft.preferred
        self._weights2 = np.array(settings.weights) ** 2
        self._scratch = Scratch(np.zeros((s, s)), np.zeros(s), np.zeros(s, np.int64), np.zeros((s + 1, s)))
        self.unmet = np.zeros(3)
        """Of the acceleration wanted, what the surfaces cannot give [rad/s^2]."""
        self.iterations = 0

    def command(
        self, believed: Believed, filters: Filters, wanted: Array, stuck: Flags, measured: Array, before: Array
    ) -> Array:
        """Return the surfaces' commands (s,) [rad].

        Parameters
        ----------
        believed, filters
            The model, and the filtered measurements.
        wanted
            (3,) see `wanted_acceleration`.
        stuck, measured
            (s,) which surfaces do not follow, and where all are [rad].
        before
            (s,) the last command, where the search begins.
        """
        c = self._settings
        step = np.clip(wanted - filters.acceleration, -c.largest_step, c.largest_step)
        low, high = self._low, self._high
        if stuck.any():
            at = np.clip(measured, low, high)
            low, high = np.where(stuck, at, low), np.where(stuck, at, high)
        b = believed.b if not believed.has_prior else believed.b0_surfaces
        power = max(float((self._weights2 * (b**2).max(axis=1)).max()), LEAST_POWER)
        s = before.copy()
        prices = Prices(self._weights2, c.price * power, c.caution)
        surfaces = Surfaces(filters.positions, self._preferred, low, high)
        self.iterations = invert(believed.b, believed.variance, step, prices, surfaces, s, self.unmet, self._scratch)
        return s


@compiled
def invert(
    b: Array,
    variance: Array,
    step: Array,
    prices: Prices,
    surfaces: Surfaces,
    s: Array,
    unmet: Array,
    scratch: Scratch,
) -> int:
    """Solve the problem of the module.

    Parameters
    ----------
    b, variance
        (3, s) what is believed of B, and its variances.
    step
        (3,) nu - w'_f [rad/s^2].
    prices, surfaces
        What counts how much, and where surfaces are and may go.
    s
        (s,) start and solution [rad].
    unmet
        (3,) out: what it leaves of ``step``.
    scratch
        See there.

    Returns
    -------
    int
        Iterations, see `allocate`.
    """
    h, f, positions, weights2 = scratch.h, scratch.f, surfaces.positions, prices.weights2
    n = s.shape[0]
    for i in range(n):
        f[i] = 0.0
        for j in range(n):
            h[i, j] = 0.0
    for row in range(b.shape[0]):
        wanted = step[row]
        for j in range(n):
            wanted += b[row, j] * positions[j]
        for i in range(n):
            weighted = weights2[row] * b[row, i]
            f[i] += weighted * wanted
            for j in range(n):
                h[i, j] += weighted * b[row, j]
    for i in range(n):
        unsure = 0.0
        for row in range(b.shape[0]):
            unsure += weights2[row] * variance[row, i]
        unsure *= prices.caution
        h[i, i] += prices.price + unsure
        f[i] += prices.price * surfaces.preferred[i] + unsure * positions[i]
    iterations = allocate(h, f, surfaces.low, surfaces.high, s, scratch.held, scratch.work)
    for row in range(b.shape[0]):
        unmet[row] = step[row]
        for j in range(n):
            unmet[row] -= b[row, j] * (s[j] - positions[j])
    return iterations
