"""What is believed of the effectors: the prior, corrected by what is identified, as far as its error bars go.

By surface (``model: surface``): the effect of surface k is its effect in the prior times an effectiveness e_k. The
estimates of the roll, pitch and yaw rows are then 3 m measurements of the s numbers e_k, weighted by their variances::

    bhat_ij = sum_k e_k b0_ik mixing_kj + noise of variance  c sigma_ij^2 + (floor scale_ij)^2

and the least-squares e is mixed with what was believed before, whose variance grows with time. By entry (``model:
entry``, and always without a prior): a scalar Kalman filter of each number of B. After an alarm the variance is raised
at once, and for a while estimates, which then follow each other closely, count less (c).

Whether an estimate is flagged reliable is not asked: a dead effector's effect is 0, of which no error is a small share.
The error bars say what is needed. Rows of forces come from the prior.
"""

from __future__ import annotations

import math

import numpy as np

from msls_ros.control.aircraft import AXES, STATES, ControlledAircraft
from msls_ros.control.compiled import compiled
from msls_ros.control.linear import Array, Flags, solve_general
from msls_ros.control.settings import ControlSettings
from msls_ros.control.signals import ModelEstimate

ROWS = [STATES.index(axis) for axis in AXES]
PITCH = AXES.index("Q")
LEAST_LEFT = 0.05
"""Share of the pitching power below which gains fall no further."""
UNKNOWN = 1e6
"""Standard error of what is not known at all."""
LOWEST, HIGHEST = -0.1, 1.3
"""Effectiveness that is believed; below 0 it counts as 0."""
SMALL = 0.1
"""Numbers of B below this share of the largest of their row have the scale of this share."""
FOLLOW_A, RETURN_A = 0.3, 0.1
"""Share of the way to an estimate of A in a redesign, and of the way back to the prior."""
PRIOR_A, LEAST_A = 0.2, 0.05
"""Standard error of the prior's A relative to its size, and least size relative to the largest of the row."""


class Believed:
    """The model that a law is designed from.

    Parameters
    ----------
    aircraft
        With its prior.
    settings
        See `ControlSettings`.
    """

    def __init__(self, aircraft: ControlledAircraft, settings: ControlSettings) -> None:
        """Believe the prior; see the class."""
        self._aircraft, self._settings = aircraft, settings
        self._mixing = np.ascontiguousarray(aircraft.mixing, np.float64)
        self._back = np.ascontiguousarray(aircraft.effectors_from_surfaces)
        self._back2 = self._back**2
        self._range = np.array(aircraft.high) - np.array(aircraft.low)
        self._mode = settings.model if aircraft.prior is not None else "entry"
        if settings.law == "lq" and self._mode == "surface":
            self._mode = (
                "entry"  # where a surface pitches less and rolls as before, one number for it misleads the servo
            )
        self.reset()

    def reset(self) -> None:
        """Believe the prior again."""
        s, m, c = len(self._aircraft.surfaces), len(self._aircraft.effectors), self._settings
        prior = self._aircraft.prior
        self._a0 = np.zeros((len(STATES), len(STATES))) if prior is None else np.array(prior.a, np.float64)
        b0 = np.zeros((len(STATES), m)) if prior is None else np.array(prior.b, np.float64)
        self._b0 = b0[ROWS]
        self.a = self._a0.copy()
        """(9, 9)"""
        self.b0_surfaces = self._b0 @ self._back
        """(3, s) of the prior."""
        self.b_forces = b0[:3] @ self._back
        """(3, s) rows u, v, w, of the prior."""
        self.b = self.b0_surfaces.copy()
        """(3, s) angular acceleration per surface [1/s^2]."""
        self._entry = self._b0.copy()
        self._scale = np.maximum(np.abs(self._b0), SMALL * np.abs(self._b0).max(axis=1, keepdims=True))
        known = prior is not None
        self._entry_variance = (c.prior_std * self._scale) ** 2 if known else np.full((3, m), UNKNOWN**2)
        self._e, self._e_variance = np.ones(s), np.full(s, c.prior_std**2)
        self.variance = self._e_variance * self.b**2 if known else np.full((3, s), UNKNOWN**2)
        """(3, s) of ``b``."""
        self._largest = np.zeros(s)
        self._h, self._y = np.zeros((s, s)), np.zeros((s, s + 1))
        self.updated = -math.inf
        """Time of the estimate that was last believed [s]."""
        self._last, self._alarm, self._ignored_until = -math.inf, -math.inf, -math.inf
        self._misfit = np.zeros(2)
        self._distrust = IGNORED

    @property
    def has_prior(self) -> bool:
        """Whether anything was known at the start."""
        return self._aircraft.prior is not None

    def fast(self, time: float) -> bool:
        """Whether an alarm was a short time ago."""
        return time - self._alarm < self._settings.alarm_watch

    def due(self, time: float) -> bool:
        """Whether a new estimate is wanted."""
        if self._settings.model == "frozen":
            return False
        rate = self._settings.alarm_redesign_rate if self.fast(time) else self._settings.redesign_rate
        return time - self._last >= 1.0 / rate - 1e-9

    def alarm(self, time: float) -> None:
        """Trust what is believed less: something has changed."""
        self._alarm = time
        if self._mode in ("frozen", "raw"):
            return
        wide = self._settings.alarm_inflation**2
        self._e_variance = np.maximum(self._e_variance, wide)
        self._entry_variance = np.maximum(self._entry_variance, wide * self._scale**2)
        self._show()

    def take(self, time: float, estimate: ModelEstimate) -> bool:
        """Believe an estimate as far as it goes; return whether it could be used."""
        b, sigma = np.asarray(estimate.b, np.float64)[ROWS], np.asarray(estimate.b_std, np.float64)[ROWS]
        good = b.shape == self._b0.shape and sigma.shape == b.shape and bool(np.isfinite(b).all())
        if not good or time < self._ignored_until or self._settings.model == "frozen":
            return False
        elapsed = max(time - self._last, 0.0) if math.isfinite(self._last) else 1.0 / self._settings.redesign_rate
        self._last = self.updated = time
        sigma = np.where(np.isfinite(sigma), np.abs(sigma), UNKNOWN)
        if self._mode == "raw":
            self._entry, self._entry_variance = b.copy(), sigma**2
        else:
            correlation = self._settings.alarm_correlation if self.fast(time) else 1.0
            if not self.has_prior:
                self._scale = np.maximum(np.abs(self._entry).max(axis=1, keepdims=True), 1e-6) * np.ones_like(b)
            variance = correlation * sigma**2 + (self._settings.floor * self._scale) ** 2
            (self._take_surfaces if self._mode == "surface" else self._take_entries)(b, variance, elapsed)
            self._take_a(estimate, correlation)
        self._show()
        return True

    def _take_surfaces(self, b: Array, variance: Array, elapsed: float) -> None:
        self._e_variance += self._settings.drift**2 * elapsed
        update_effectiveness(self.b0_surfaces, self._mixing, b, variance, self._e, self._e_variance, self._h, self._y)

    def _take_entries(self, b: Array, variance: Array, elapsed: float) -> None:
        self._entry_variance += (self._settings.drift * self._scale) ** 2 * elapsed
        share = self._entry_variance / (self._entry_variance + variance)
        self._entry += share * (b - self._entry)
        self._entry_variance *= 1.0 - share

    def _take_a(self, estimate: ModelEstimate, correlation: float) -> None:
        """Move the moment rows of A towards the estimate by its error bars, and back to the prior."""
        rows = slice(3, 6)
        a, sigma = np.asarray(estimate.a, np.float64)[rows], np.asarray(estimate.a_std, np.float64)[rows]
        if a.shape != (3, len(STATES)) or not np.isfinite(a).all():
            return
        sigma = np.where(np.isfinite(sigma), sigma, UNKNOWN)
        size = np.abs(self._a0[rows])
        prior = (PRIOR_A * np.maximum(size, LEAST_A * size.max(axis=1, keepdims=True)) + 1e-6) ** 2
        share = prior / (prior + correlation * sigma**2)
        now = self.a[rows]
        self.a[rows] = now + FOLLOW_A * (share * (a - now) + RETURN_A * (self._a0[rows] - now))

    def _show(self) -> None:
        """Put b and its variance together."""
        if self._mode in ("surface", "frozen"):
            self.b = self.b0_surfaces * np.clip(self._e, 0.0, HIGHEST)
            self.variance = self.b0_surfaces**2 * self._e_variance
        else:
            self.b = self._entry @ self._back
            self.variance = self._entry_variance @ self._back2
        self._largest = np.maximum(self._largest, np.sqrt((self.b**2).sum(axis=0)))

    @property
    def effectiveness(self) -> tuple[Array, Array]:
        """Believed effect of each surface over the prior's (s,), and its standard error."""
        if self._mode in ("surface", "frozen"):
            return self._e.copy(), np.sqrt(self._e_variance)
        if self.has_prior:
            size = np.maximum((self.b0_surfaces**2).sum(axis=0), 1e-12)
            now = (self.b * self.b0_surfaces).sum(axis=0) / size
            return now, np.sqrt((self.variance * self.b0_surfaces**2).sum(axis=0)) / size
        size = np.maximum(self._largest, 1e-9)
        return np.sqrt((self.b**2).sum(axis=0)) / size, np.sqrt(self.variance.max(axis=0)) / size

    def knows(self) -> list[str]:
        """Return the axes that no surface is known to move."""
        if self.has_prior:
            return []
        known = (np.abs(self.b) > self._settings.knowledge * np.sqrt(self.variance)).any(axis=1)
        return [name for name, one in zip(("roll", "pitch", "yaw"), known, strict=True) if not one]

    def pitching_power_left(self, stuck: Flags) -> float:
        """Return the share of the prior's pitching power that surfaces which follow still have, over their ranges.

        Parameters
        ----------
        stuck
            (s,) those that do not follow.
        """
        if not self.has_prior:
            return 1.0
        whole = float((np.abs(self.b0_surfaces[PITCH]) * self._range).sum())
        left = float((np.abs(self.b[PITCH]) * self._range)[~stuck].sum())
        return min(max(left, LEAST_LEFT * whole) / whole, 1.0) if whole > 0.0 else 1.0

    def judge(self, time: float, response: Array, moved: Array, period: float) -> bool:
        """Hold the believed and the prior's B against a measured response; drop the believed where it is far worse.

        Parameters
        ----------
        time
            [s]
        response
            (3,) change of the angular acceleration since the last sample, filtered [rad/s^2].
        moved
            (s,) change of the surfaces' positions, through the same filter [rad].
        period
            Since the last sample [s].

        Returns
        -------
        bool
            Whether the believed model was dropped.

        Notes
        -----
        A sample counts by how far the two predict apart, and says which errs more: 0 to 1 for its share of the squared
        errors. The jump of a failure, which neither foresees, says nothing so.
        """
        limit = self._settings.rejection
        if not self.has_prior or limit == 0.0 or self._mode in ("frozen", "raw"):
            return False
        own, first = (self.b * moved).sum(axis=1), (self.b0_surfaces * moved).sum(axis=1)
        misfit, misfit0 = float(((response - own) ** 2).sum()), float(((response - first) ** 2).sum())
        apart = float(((own - first) ** 2).sum())
        self._misfit *= math.exp(-period / JUDGED)
        self._misfit += apart * misfit / max(misfit + misfit0, 1e-12), apart
        if self._misfit[1] < LEAST_APART or self._misfit[0] <= limit / (1.0 + limit) * self._misfit[1]:
            return False
        updated, distrust = self.updated, 2.0 * self._distrust
        self.reset()
        self._distrust = distrust
        self._e_variance[:] = self._settings.alarm_inflation**2
        self._last, self.updated, self._ignored_until = time, updated, time + 0.5 * distrust
        self._show()
        return True


JUDGED = 0.5
"""Memory of the comparison with the measured response [s]."""
IGNORED = 2.0
"""So long no estimate is believed after one that the response has disproved, and twice as long the next time [s]."""
LEAST_APART = math.radians(1.5) ** 2
"""Sum of squared differences of the two predictions below which nothing is disproved [rad^2/s^4]."""


@compiled
def update_effectiveness(
    b0: Array, mixing: Array, b: Array, variance: Array, e: Array, e_variance: Array, h: Array, y: Array
) -> None:
    """Mix the effectiveness with what an estimate says of it, by least squares.

    Parameters
    ----------
    b0
        (3, s) of the prior.
    mixing
        (s, m).
    b, variance
        (3, m) the estimate.
    e, e_variance
        (s,) become what is believed now.
    h, y
        (s, s), (s, s + 1) working memory.
    """
    s, m = mixing.shape
    for k in range(s):
        for j in range(s):
            h[k, j] = 0.0
            y[k, j] = 0.0
        h[k, k] = 1.0 / e_variance[k]
        y[k, k] = 1.0
        y[k, s] = e[k] / e_variance[k]
    for i in range(b0.shape[0]):
        for j in range(m):
            weight = 1.0 / variance[i, j]
            for k in range(s):
                slope = b0[i, k] * mixing[k, j]
                if slope != 0.0:
                    y[k, s] += slope * weight * b[i, j]
                    for other in range(s):
                        h[k, other] += slope * weight * b0[i, other] * mixing[other, j]
    if solve_general(h, y):
        for k in range(s):
            e[k] = min(max(y[k, s], LOWEST), HIGHEST)
            e_variance[k] = y[k, k]
