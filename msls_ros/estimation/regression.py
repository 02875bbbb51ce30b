"""A linear regression over time with everything on: factor groups, detector, recovery, residual colours. The engine.

`Identifier` puts the names and units of flight around it; the paper's linear experiments (eqs 15-17) run on it bare.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from msls_ros.estimation.compiled import Bound
from msls_ros.estimation.configuration import Configuration
from msls_ros.estimation.errors import EstimationError
from msls_ros.estimation.isolation import Difference, invert, upper_factor
from msls_ros.estimation.kernel import Array, Integers, make_work
from msls_ros.estimation.reference import moving_air
from msls_ros.estimation.rows import advance
from msls_ros.estimation.settings import loop_settings
from msls_ros.estimation.soundness import SOUND
from msls_ros.estimation.state import (
    COLOURS,
    PRIOR_MSLS,
    PRIOR_RLS,
    Output,
    Settings,
    clear,
    forget_sample,
    make_output,
    make_state,
)
from msls_ros.estimation.uncertainty import row_uncertainty


def make_settings(regressors: int, rows: int, **changes: Any) -> Settings:
    """Settings of the paper's linear experiments (lambda 0.1, W0 0.03 I, N 10, T 20), with some of them changed.

    Parameters
    ----------
    regressors, rows
        p and r.
    **changes
        Fields of `Settings`; ``threshold`` is on short/long, the paper's T plus 1.
    """
    settings = Settings(
        rls=False,
        retained=True,
        forgetting=0.1,
        penalty=np.full(regressors, 0.03),
        scale=np.ones(regressors),
        auto_scale=False,
        rms_memory=500.0,
        colours=np.array(COLOURS[:1]),
        residual_forgetting=0.98,
        colour_forgetting=0.998,
        prior=PRIOR_RLS if changes.get("rls") else PRIOR_MSLS,
        detect=False,
        normalised=False,
        window=10,
        short=1,
        threshold=21.0,
        floor_absolute=np.zeros(rows),
        floor_relative=0.0,
        floor_model=0.0,
        hold_off=0,
        ease_start=False,
        recovery_penalty=0.1,
        recovery_forgetting=0.1,
        merge_after=9,
        effectors_from=0,
        effectors_to=0,
        confounded=False,
        reference_forgetting=1.0,
        confounding=np.zeros(regressors),
        deviation_forgetting=1.0,
        watch=0,
        followed_row=-1,
        followed_column=-1,
        horizon=0.0,
    )
    return settings._replace(**changes)


class Regression:
    """Estimate ``y_q = theta_q' phi + v_q`` recursively for r rows.

    Parameters
    ----------
    settings
        See `Settings`.
    rows
        r.
    """

    def __init__(self, settings: Settings, rows: int) -> None:
        """Allocate and clear; see the class."""
        p = settings.penalty.shape[0]
        self.settings = settings
        self.state = make_state(settings, rows)
        self._work = make_work(p, len(settings.colours))
        self._w0 = np.zeros(p)
        self._advance = Bound(advance)
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        clear(self.settings, self.state)

    def values(self, row: int, column: int, x: Array, kept: Integers) -> Array:
        """Return an estimate at states (k, n), of which those in ``kept`` are regressors: the same at all of them."""
        return np.full(len(x), self.theta[row, column])

    def warm_start(
        self, theta: Array, covariance: Array, seen: Array | None = None, errors: Array | None = None
    ) -> None:
        """Start anew from given estimates.

        Parameters
        ----------
        theta
            (r, p) estimates.
        covariance
            (p, p) their covariance over the residual variance, symmetric positive definite; all rows share it.
        seen, errors
            Not asked for here; see `BankRegression.warm_start`.

        Raises
        ------
        EstimationError
            For wrong shapes, numbers that are not finite, or a covariance that is none; nothing has changed then.
        """
        r, p = self.theta.shape
        if theta.shape != (r, p) or covariance.shape != (p, p):
            message = f"estimates {theta.shape} and covariance {covariance.shape}; expected ({r}, {p}) and ({p}, {p})"
            raise EstimationError(message)
        information, factor = np.zeros((p, p)), np.zeros((p, p))
        finite = np.isfinite(theta).all() and np.isfinite(covariance).all()
        if (
            not finite
            or not (covariance == covariance.T).all()
            or not invert(covariance, information, np.zeros((2, p, p)))
        ):
            message = "estimates and covariance must be finite, and the covariance symmetric positive definite"
            raise EstimationError(message)
        upper_factor(information, factor)
        self.reset()
        self.state.theta[:] = theta
        self.state.R[0] = covariance if self.settings.rls else factor
        self.state.P[0] = covariance
        self.state.age[0] = 4 * p

    def advance(self, phi: Array, y: Array) -> tuple[int, Output]:
        """Take samples until one alarms or all are taken.

        Parameters
        ----------
        phi, y
            (n, p) regressors and (n, r) outputs, finite, C-contiguous.

        Returns
        -------
        tuple
            How many were taken, and what happened at each.
        """
        out = self.make_output(len(phi))
        return self.advance_into(out, phi, y, 0, len(phi)), out

    def make_output(self, samples: int) -> Output:
        """Allocate what `advance_into` says of that many samples."""
        return make_output(samples, len(self.theta), self.settings.effectors_to - self.settings.effectors_from)

    def advance_into(self, out: Output, phi: Array, y: Array, start: int, stop: int) -> int:
        """Take samples from ``start`` on, as `advance`; return the index after the last one taken.

        Where that one was too much, everything is forgotten; ``out.restart`` says so.

        Parameters
        ----------
        out
            Filled from ``start`` on, see `make_output`.
        phi, y
            As for `advance`.
        start, stop
            Of the samples to take.
        """
        phi, y = np.ascontiguousarray(phi, np.float64), np.ascontiguousarray(y, np.float64)
        done: int = self._advance(self.settings, self.state, phi, y, start, stop, self._work, self._w0, out)
        if out.restart[done - 1] != SOUND:
            self.reset()
            forget_sample(out, done - 1)
        return done

    def run(self, phi: Array, y: Array) -> tuple[Array, Array, Integers]:
        """Take all samples; return the estimates, their standard errors and the alarms after each.

        Parameters
        ----------
        phi, y
            (n, p) regressors and (n, r) outputs.

        Returns
        -------
        tuple of arrays
            (n, r, p), (n, r, p) and (n, r).
        """
        n, (r, p) = len(phi), self.theta.shape
        theta, errors, alarms = np.empty((n, r, p)), np.empty((n, r, p)), np.zeros((n, r), np.int64)
        for k in range(n):
            _, out = self.advance(phi[k : k + 1], y[k : k + 1])
            theta[k], alarms[k] = self.theta, out.alarm[0]
            for q in range(r):
                errors[k, q] = self.standard_errors(q)
        return theta, errors, alarms

    def configure(self, configuration: Configuration) -> None:
        """Take over changed parameters; what has been learnt stays."""
        self.settings = loop_settings(configuration)

    def follow(self, row: int, column: int) -> None:
        """Have ``Output.followed`` hold one estimate; negative: none."""
        self.settings = self.settings._replace(followed_row=row, followed_column=column)

    @property
    def covariance(self) -> Array:
        """(p, p) of the estimates over the residual variance, of the rows that share one."""
        found: Array = self.state.P[0, 0]
        return found

    @property
    def delay(self) -> tuple[float, float]:
        """Of responses after deflections [s], and its standard error, NaN: none is looked for."""
        return 0.0, math.nan

    @property
    def lag(self) -> float:
        """Of the deflections [s]: none is looked for."""
        return 0.0

    @property
    def samples(self) -> int:
        """Samples since the last reset."""
        return int(self.state.samples[0])

    @property
    def air(self) -> float:
        """Share of the motion through the air that is the air's; see `gusts`."""
        return float(self.state.air[0])

    @air.setter
    def air(self, share: float) -> None:
        self.state.air[0] = share

    @property
    def moving_air(self) -> bool:
        """Whether the air moves so much that it widens the error bars."""
        return self.settings.confounded and moving_air(self.state) > 0.0

    def age(self, row: int) -> int:
        """Samples since the row's group began."""
        return int(self.state.age[self.state.group[row]])

    def recovered(self, row: int) -> bool:
        """Whether the penalty of a row that had an alarm has ramped back to normal."""
        return bool(self.state.group[row] == 0) or self.age(row) >= 4 * self.theta.shape[1]

    def settle(self, row: int) -> None:
        """Let go of what was known of a row before its alarm."""
        self.state.pending[row] = 0

    def difference(self, row: int) -> Difference:
        """Return the estimates of a row before its alarm and since, and the covariances of both."""
        x, p = self.state, self.theta.shape[1]
        of_row = row_uncertainty(self.settings, x, row)
        before, since = np.zeros((p, p)), np.zeros((p, p))
        for m, share in enumerate(of_row.weights):
            if share > 0.0:
                before += share * of_row.variances[m] * x.P_before[row, m]
                since += share * of_row.variances[m] * x.P[x.group[row], m]
        return Difference(x.theta_before[row], before, self.theta[row], since)

    @property
    def theta(self) -> Array:
        """(r, p) the estimates; a view."""
        return self.state.theta

    def excitation(self, row: int) -> Array:
        """(p,) share of each parameter of a row that the data decide [1]."""
        excitation: Array = self.state.rho[self.state.group[row]]
        return excitation

    def standard_errors(self, row: int) -> Array:
        """(p,) standard errors of a row's estimates."""
        return row_uncertainty(self.settings, self.state, row).errors
