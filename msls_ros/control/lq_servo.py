"""A linear-quadratic servo in velocity form, designed anew from the identified A and B: the rival of the inversion.

State, input and cost, with x5 = [alpha Q beta P R], e the errors of angle of attack, sideslip and roll rate::

    z = [x5' | e | s - s_trim],  u = ds/dt,   z' = F z + G u,   J = integral z' Q z + u' R u

In velocity form the trim need not be known. Q prices deflections that make no moment, R the rates of surfaces; R of a
surface that is stuck is a million times as high, and of one whose effect is uncertain it grows with the variance of
its column, priced as in `indi`. The gain comes from the Riccati equation (`riccati`) at the rate of redesign.
"""

from __future__ import annotations

import math

import numpy as np

from msls_ros.control.aircraft import ControlledAircraft
from msls_ros.control.believed import Believed
from msls_ros.control.errors import ControlError
from msls_ros.control.indi import LEAST_POWER, Reference
from msls_ros.control.linear import Array, Flags, multiply
from msls_ros.control.motion import Motion
from msls_ros.control.riccati import WORK, solve_riccati
from msls_ros.control.settings import ControlSettings
from msls_ros.control.signals import PilotCommand

MOTION, ERRORS = 5, 3
LEAK = 1e-3
"""Return of the positions to the trim, which makes the problem stabilisable where surfaces are redundant [1/s]."""
HELD = 1e6
"""Factor on the price of moving a stuck surface."""
RANK = 0.03
"""Moments below this share of the largest count as none."""
SHIFT = 8.0
"""Of the Cayley transform [1/s]."""


class LqServo:
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
        self._settings = settings
        s = self._s = len(aircraft.surfaces)
        n = self._n = MOTION + ERRORS + s
        self._low, self._high, self._preferred = np.array(aircraft.low), np.array(aircraft.high), aircraft.preferred
        self._f, self._g, self._q = np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n))
        self._x, self._work = np.zeros((n, n)), np.zeros((WORK, n, n))
        self.gain: Array | None = None
        """(s, n); None: nothing is designed yet."""
        self.problem = ""
        """Why the last design failed; empty: it did not."""
        self.loop: tuple[Array, Array] = np.zeros((0, 0)), np.zeros((0, s))
        """F (n, n) and G (n, s) of the last design."""

    def design(self, believed: Believed, motion: Motion, stuck: Flags) -> None:
        """Design the gain from what is believed; where nothing stabilises that, the last gain stays.

        Parameters
        ----------
        believed
            A and B.
        motion
            Speed and angle of attack at which incidence angles are made of velocities.
        stuck
            (s,)
        """
        c, s = self._settings, self._s
        turn = _incidence(motion)
        back = np.linalg.pinv(turn)
        moments = np.vstack([believed.b_forces, believed.b])
        a5, b5 = turn @ believed.a[:6, :6] @ back, turn @ moments
        power = max(float(np.abs(believed.b0_surfaces if believed.has_prior else believed.b).max()) ** 2, LEAST_POWER)
        f = self._f
        f[:] = 0.0
        f[:MOTION, :MOTION] = a5
        f[5, 0], f[6, 2], f[7, 3], f[7, 4] = 1.0, 1.0, math.cos(motion.alpha), math.sin(motion.alpha)
        f[8:, 8:] = -LEAK * np.eye(s)
        inputs = np.vstack([b5, np.zeros((ERRORS, s)), np.eye(s)])
        null = np.eye(s) - np.linalg.pinv(believed.b, rcond=RANK) @ believed.b
        self._q[:] = np.diag([*c.lq_rates, *c.lq_errors, *[0.0] * s])
        self._q[8:, 8:] = c.lq_deflection_price * power * null @ null.T + 1e-6 * np.eye(s)
        weights2 = np.array(c.weights)[:, None] ** 2
        price = c.lq_rate_price * power + c.caution * c.lq_rate_price * (weights2 * believed.variance).sum(axis=0)
        price = np.where(stuck, HELD * price, price)
        self._g[:] = (inputs / price) @ inputs.T
        if not solve_riccati(self._f, self._g, self._q, SHIFT, self._x, self._work) or not np.isfinite(self._x).all():
            self.problem = "no gain stabilises what is believed"
            return
        gain = np.zeros((s, self._n))
        multiply(np.ascontiguousarray((inputs / price).T), self._x, gain)
        self.gain, self.problem, self.loop = gain, "", (f.copy(), inputs)

    def command(
        self,
        motion: Motion,
        accelerations: Array,
        command: PilotCommand,
        reference: Reference,
        stuck: Flags,
        measured: Array,
        before: Array,
        period: float,
    ) -> Array:
        """Return the surfaces' commands (s,) [rad].

        Parameters
        ----------
        motion, accelerations
            What is measured; (3,) angular accelerations [rad/s^2].
        command, reference
            What is asked for.
        stuck, measured, before
            (s,) which surfaces do not follow, where all are, and the last command [rad].
        period
            Since the last sample [s].

        Raises
        ------
        ControlError
            If nothing is designed yet.
        """
        if self.gain is None:
            message = "the linear-quadratic servo flies before it is designed; expected a design first"
            raise ControlError(message)
        p_dot, q_dot, r_dot = accelerations.tolist()
        ca, sa = math.cos(motion.alpha), math.sin(motion.alpha)
        alpha_error = 0.0 if math.isnan(command.alpha) else motion.alpha - command.alpha
        pitch_error = command.pitch_rate if math.isnan(command.alpha) else 0.0
        z = np.array(
            [
                *(motion.alpha_rate - pitch_error, q_dot, motion.beta_rate),
                *(p_dot - reference.acceleration * ca, r_dot - reference.acceleration * sa),
                *(alpha_error, motion.beta - command.beta, motion.roll_rate - reference.rate),
                *(before - self._preferred).tolist(),
            ]
        )
        s = before - period * (self.gain * z).sum(axis=1)
        s = np.clip(s, self._low, self._high)
        return np.where(stuck, np.clip(measured, self._low, self._high), s)


def _incidence(motion: Motion) -> Array:
    """Return the matrix (5, 6) that makes rates of alpha Q beta P R of those of u v w P Q R."""
    ca, sa = math.cos(motion.alpha), math.sin(motion.alpha)
    turn = np.zeros((MOTION, 6))
    turn[0, 0], turn[0, 2] = -sa / motion.speed, ca / motion.speed
    turn[2, 1] = 1.0 / motion.speed
    turn[1, 4] = turn[3, 3] = turn[4, 5] = 1.0
    return turn
