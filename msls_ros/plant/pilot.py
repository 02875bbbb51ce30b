"""The pilot: a stability and command augmentation system (SCAS) that flies a manoeuvre from measured states.

It stands in for a flight-control stack. Angle of attack is held by tail and nozzle together; roll is commanded about
the velocity vector, with the turn rate that keeps sideslip down; a linear-quadratic gain spreads the lateral
correction over rudder, differential tail, differential flap and yaw vectoring::

    e = alpha - alpha0 - the manoeuvre's alpha_offset
    m = k [0.7 e + 0.7 Q + 0.35 integral(e)]                                   de += m / 2, dte += m
    rs = (g / V) sin(Phi) cos(Theta)
    [dr ddt ddf dtr] += -K [beta, P - (ps cos a - rs sin a), R - (ps sin a + rs cos a)]

The numbers belong to the high-alpha condition, where k = 1. Elsewhere `k`, and the price of deflection behind K, follow
from the control power found in the truth at trim, such that the angular acceleration asked for an error is that of the
high-alpha condition times the airspeed over the one there. When the manoeuvre leaves the roll stick alone, the wings
are levelled slowly: long flights do not drift.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from msls_ros.plant.interface import EFFECTORS, STATES, Array, LinearTruth, PlantError
from msls_ros.plant.manoeuvres import Manoeuvre
from msls_ros.plant.trim import Trim

_GRAVITY = 9.80665
_DE, _DTE = EFFECTORS.index("de"), EFFECTORS.index("dte")
_LATERAL_STATES = tuple(STATES.index(name) for name in ("v", "P", "R"))
_LATERAL_EFFECTORS = tuple(EFFECTORS.index(name) for name in ("dr", "ddt", "ddf", "dtr"))
_Q = np.diag([4.0, 1.0, 1.5])
_R = np.diag([6.0, 4.0, 4.0, 3.0])
_PITCH_POWER = 3.48
_ROLL_POWER = 1.548
_AIRSPEED = 72.7
_ALPHA_GAIN, _RATE_GAIN, _INTEGRAL_GAIN = 0.7, 0.7, 0.35
_INTEGRAL_LIMIT = 0.5
_LEVELLING_GAIN = 0.3
_LONGEST_STEP = 0.1


def riccati_gain(a: Array, b: Array, q: Array, r: Array) -> Array:
    """Gain of the linear-quadratic regulator ``u = -K x``.

    Parameters
    ----------
    a, b : ndarray, shapes (n, n), (n, m)
        ``xdot = a x + b u``.
    q, r : ndarray, shapes (n, n), (m, m)
        Cost ``x' q x + u' r u``; q positive semidefinite, r positive definite.

    Returns
    -------
    ndarray, shape (m, n)
        ``K = r^-1 b' S`` with S from the stable invariant subspace of the Hamiltonian matrix.

    Raises
    ------
    PlantError
        If there is no stabilising gain.
    """
    n = a.shape[0]
    r_inverse_bt = np.linalg.solve(r, b.T)
    values, vectors = np.linalg.eig(np.block([[a, -b @ r_inverse_bt], [-q, -a.T]]))
    stable = np.flatnonzero(values.real < 0.0)
    if stable.size != n:
        message = f"no stabilising gain: {stable.size} stable modes of the Hamiltonian, expected {n}"
        raise PlantError(message)
    basis = vectors[:, stable]
    solution = np.linalg.solve(basis[:n].T, basis[n:].T).T.real
    return np.asarray(r_inverse_bt @ solution)


class Pilot:
    """Flies a manoeuvre about a trim.

    Parameters
    ----------
    trim : Trim
        The steady flight to hold.
    truth_at_trim : LinearTruth
        The linear model there: the gains come from it.
    manoeuvre : Manoeuvre
        What to do with the roll stick.

    Raises
    ------
    PlantError
        If the lateral motion cannot be stabilised.
    """

    def __init__(self, trim: Trim, truth_at_trim: LinearTruth, manoeuvre: Manoeuvre) -> None:
        self._trim = trim
        self._manoeuvre = manoeuvre
        b = truth_at_trim.b
        pitch = STATES.index("Q")
        quicker = trim.airspeed / _AIRSPEED
        power = 0.5 * b[pitch, EFFECTORS.index("de")] + b[pitch, EFFECTORS.index("dte")]
        self._pitch_scale = -quicker * _PITCH_POWER / float(power)
        price = (float(b[STATES.index("P"), EFFECTORS.index("ddt")]) / _ROLL_POWER / quicker) ** 2
        scale = np.array([1.0 / trim.airspeed, 1.0, 1.0])
        rows = list(_LATERAL_STATES)
        a3 = truth_at_trim.a[np.ix_(rows, rows)] * scale[:, None] / scale
        b3 = b[np.ix_(rows, list(_LATERAL_EFFECTORS))] * scale[:, None]
        self._lateral_gain: list[list[float]] = riccati_gain(a3, b3, _Q, _R * price).tolist()
        self._integral = 0.0
        self._time: float | None = None

    def command(self, time: float, x: npt.ArrayLike) -> Array:
        """Effector commands for the present instant.

        Parameters
        ----------
        time : float
            Simulated time [s]; the integral of the angle of attack runs on it. Going back restarts the integral.
        x : array_like, shape (9,)
            Measured states in the order of `STATES` [m/s, rad/s, rad].

        Returns
        -------
        ndarray, shape (7,)
            Commanded deflections in the order of `EFFECTORS` [rad].

        Raises
        ------
        PlantError
            If the time or the states are not finite or the states are not nine.
        """
        state = np.asarray(x, dtype=np.float64)
        if state.shape != (len(STATES),) or not (np.isfinite(state).all() and math.isfinite(time)):
            message = f"measured states {state} at {time} s: expected {len(STATES)} finite numbers"
            raise PlantError(message)
        u, v, w, p, q, r, phi, theta, _ = state.tolist()
        airspeed = max(math.sqrt(u * u + v * v + w * w), 1.0)
        alpha = math.atan2(w, u)
        delta: list[float] = self._trim.delta.tolist()
        moment = self._pitch(time, alpha - self._trim.alpha - self._manoeuvre.alpha_offset(time), q)
        delta[_DE] += 0.5 * moment
        delta[_DTE] += moment
        roll_rate = self._manoeuvre.roll_rate(time)
        if not self._manoeuvre.active(time):
            roll_rate -= _LEVELLING_GAIN * phi
        turn_rate = _GRAVITY / airspeed * math.sin(phi) * math.cos(theta)
        p_reference = roll_rate * math.cos(alpha) - turn_rate * math.sin(alpha)
        r_reference = roll_rate * math.sin(alpha) + turn_rate * math.cos(alpha)
        sideslip = math.asin(max(-1.0, min(1.0, v / airspeed)))
        for effector, (k1, k2, k3) in zip(_LATERAL_EFFECTORS, self._lateral_gain, strict=True):
            delta[effector] -= k1 * sideslip + k2 * (p - p_reference) + k3 * (r - r_reference)
        return np.array(delta)

    def _pitch(self, time: float, alpha_error: float, q: float) -> float:
        if self._time is None or time < self._time:
            self._integral = 0.0
        else:
            self._integral += alpha_error * min(time - self._time, _LONGEST_STEP)
            self._integral = max(-_INTEGRAL_LIMIT, min(_INTEGRAL_LIMIT, self._integral))
        self._time = time
        return self._pitch_scale * (_ALPHA_GAIN * alpha_error + _RATE_GAIN * q + _INTEGRAL_GAIN * self._integral)
