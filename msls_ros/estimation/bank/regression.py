"""The bank as an engine: what `regression.Regression` is for MSLS and RLS, with the same interface."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from msls_ros.estimation.bank.forgetting import spread_loss
from msls_ros.estimation.bank.isolation import UNCERTAIN, Losses
from msls_ros.estimation.bank.lags import MOMENTS
from msls_ros.estimation.bank.loop_settings import BankSettings
from msls_ros.estimation.bank.losses import KNOWN, combine_rows, compare_surfaces, is_known
from msls_ros.estimation.bank.responses import lateness
from msls_ros.estimation.bank.restoring import restore_effectors
from msls_ros.estimation.bank.rows import advance_bank, excitation_of
from msls_ros.estimation.bank.settings import bank_settings
from msls_ros.estimation.bank.speed import SLOWEST, fill_values, power_of, ratio_of, speed_of
from msls_ros.estimation.bank.start import clear_bank, make_bank_state
from msls_ros.estimation.bank.unalarmed import Alarm, is_denied, keep_alarm
from msls_ros.estimation.bank.uncertainty import bank_errors, factor_covariance, leading_member
from msls_ros.estimation.bank.work import make_bank_work
from msls_ros.estimation.compiled import Bound
from msls_ros.estimation.configuration import Configuration
from msls_ros.estimation.elementary import exponential
from msls_ros.estimation.errors import EstimationError
from msls_ros.estimation.isolation import invert, upper_factor
from msls_ros.estimation.kernel import Array, Integers
from msls_ros.estimation.regressor_noise import RegressorNoise, make_noise
from msls_ros.estimation.soundness import RESPONSE, SOUND
from msls_ros.estimation.state import Output, forget_sample, make_output

GROUPS = 4
"""Most groups of rows with a history of their own."""


class BankRegression:
    """Estimate ``y_q = theta_q' phi + v_q`` recursively for r rows with a bank of memories.

    Parameters
    ----------
    settings
        See `BankSettings`.
    rows
        r.
    """

    def __init__(self, settings: BankSettings, rows: int) -> None:
        """Allocate and clear; see the class."""
        self.settings = settings
        self.state = make_bank_state(settings, rows, min(rows + 1, GROUPS))
        self.noise = np.zeros(rows)
        """(r,) variance of the noise in the states, the first regressors, as these; 0 where it is not known."""
        self._work = make_bank_work(settings, rows)
        self._observed = np.zeros(0), make_noise(0, rows)
        self._advance, self._lateness = Bound(advance_bank), Bound(lateness)
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        clear_bank(self.settings, self.state)
        self.noise[:] = 0.0
        self._alarm: Alarm | None = None

    def configure(self, configuration: Configuration) -> None:
        """Take over changed parameters; what has been learnt stays."""
        self.settings = bank_settings(configuration, self.settings.straddle, servos=self.settings.servos)

    def follow(self, row: int, column: int) -> None:
        """Have ``Output.followed`` hold one estimate; negative: none."""
        self.settings = self.settings._replace(followed_row=row, followed_column=column)

    def values(self, row: int, column: int, x: Array, kept: Integers) -> Array:
        """Return an estimate at states (k, n), of which those in ``kept`` are regressors."""
        found = np.empty(len(x))
        fill_values(self.settings, self.state, row, (column + 1) % self.theta.shape[1], x, kept, self._work.w, found)
        return found

    def warm_start(
        self, theta: Array, covariance: Array, seen: Array | None = None, errors: Array | None = None
    ) -> None:
        """Start anew from given estimates; as `Regression.warm_start`.

        Parameters
        ----------
        theta, covariance
            (r, p) and (p, p), constant last.
        seen
            (p,) regressor at which they are the tangent, constant last; None: they hold as they are at the speed of the
            first sample, see `bank.speed`.
        errors
            (r, p) their standard errors there, infinite where nothing is known, constant last: the estimates are the
            best that is known (`bank.uncertainty`), and members learn from there with their priors. None: the
            covariance is what they know, in units of a residual that is taken to be as it was.

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
        where, seen = seen, seen if self.settings.scaled else None
        if (
            not finite
            or not (covariance == covariance.T).all()
            or not invert(np.roll(covariance, 1, axis=(0, 1)), information, np.zeros((2, p, p)))
        ):
            message = "estimates and covariance must be finite, and the covariance symmetric positive definite"
            raise EstimationError(message)
        if errors is not None and (errors.shape != (r, p) or not (errors >= 0.0).all()):
            message = f"standard errors {errors.shape}; expected ({r}, {p}), none negative"
            raise EstimationError(message)
        upper_factor(information, factor)
        if seen is not None:
            theta = self._from_tangent(theta, seen)
        self.reset()
        x, first = self.state, np.roll(theta, 1, axis=1)
        x.theta[:] = theta
        x.mixed[:] = first
        x.origin[:] = first
        x.members[:] = first[:, :, None]
        x.past[:] = first[None, :, :, None]
        x.answered[:] = 1
        if where is None or errors is None:
            x.R[0] = factor[:, :, None]
            x.info[0] = 1.0 / np.roll(np.diagonal(covariance), 1)[:, None]
            x.known[:] = x.info[0, :, 0]
            x.taken[0] = 4.0 * p
            x.age[0] = 4 * p
        if seen is not None:
            x.seen[:] = np.roll(seen, 1)
            x.speed[:] = max(speed_of(self.settings, x.seen), SLOWEST * float(self.settings.speed[0])), 1.0
        if where is not None and errors is not None:
            self._know_best(first, np.roll(errors, 1, axis=1), np.roll(where, 1))

    def _know_best(self, theta: Array, errors: Array, where: Array) -> None:
        """Keep estimates with standard errors, (r, p), at a regressor, (p,), as best known; all constant first."""
        s, x = self.settings, self.state
        number = len(s.velocities)
        scales = np.full(number, x.speed[0]) if s.scaled else s.speed[:number]
        place = np.concatenate([where[s.velocities] / scales, where[s.rates], [1.0]])
        x.best[:] = theta
        x.best_place[:] = place
        x.best_square[:] = np.square(errors)
        x.best_square[:, 0] = math.inf

    def _from_tangent(self, theta: Array, seen: Array) -> Array:
        """Return the estimates, (r, p), of which the tangent at a regressor, (p,), is given; constant last.

        Of the velocities i ``sum x_i A_i = sum x_i theta_i + S``, and what all others give of S is known.
        """
        s, found = self.settings, np.array(theta)
        velocities = s.velocities - 1
        for row in found:
            others = math.fsum(
                float(s.exponent[i + 1] * row[i] * seen[i]) for i in range(len(seen) - 1) if i not in velocities
            )
            total = 0.5 * (math.fsum(float(row[i] * seen[i]) for i in velocities) + others)
            square = max(math.fsum(float(seen[i]) ** 2 for i in velocities), 1e-12)
            row[-1] += total
            for i in velocities:
                row[i] -= float(seen[i]) / square * total
        return found

    def advance(self, phi: Array, y: Array) -> tuple[int, Output]:
        """Take samples until one alarms or all are taken; return how many, and what happened at each."""
        out = self.make_output(len(phi))
        return self.advance_into(out, phi, y, 0, len(phi)), out

    def make_output(self, samples: int) -> Output:
        """Allocate what `advance_into` says of that many samples."""
        return make_output(samples, len(self.theta), self.settings.effectors_to - self.settings.effectors_from)

    def advance_into(self, out: Output, phi: Array, y: Array, start: int, stop: int) -> int:
        """Take samples from ``start`` on; return the index after the last one taken; as `Regression.advance_into`."""
        if len(self._observed[0]) != len(phi):
            self._observed = np.zeros(len(phi)), make_noise(len(phi), y.shape[1])
        phi, y = np.ascontiguousarray(phi, np.float64), np.ascontiguousarray(y, np.float64)
        done = int(self._advance(self.settings, self.state, phi, y, start, stop, self._work, out, *self._observed))
        self.noise[:] = self._work.noise
        if out.restart[done - 1] not in (SOUND, RESPONSE):
            self.reset()
            forget_sample(out, done - 1)
        return done

    def observe(self, time: Array, noise: RegressorNoise) -> None:
        """Take time, (n,) [s], and what is known of the noise in the states, of the samples that come next."""
        self._observed = time, noise

    @property
    def theta(self) -> Array:
        """(r, p) the estimates; a view."""
        return self.state.theta

    @property
    def covariance(self) -> Array:
        """(p, p) of the estimates over the residual variance, of the first row: that of the member that leads there.

        At the speed of the last sample, but without what speed makes of derivatives by velocities (`bank.speed`).
        """
        found = self._covariance(self.state.R[self.state.group[0]], leading_member(self.state, 0, self._work.e), 1.0)
        p = len(found)
        power = np.array([power_of(self.settings, (i + 1) % p, ratio_of(self.state)) for i in range(p)])
        scaled: Array = found * (power[:, None] * power[None, :])
        return scaled

    @property
    def delay(self) -> tuple[float, float]:
        """Of responses after deflections, that was found and taken out, and its standard error [s].

        With what another response that is likelier, but not decisively, would make of it.
        """
        s, x = self.settings, self.state
        share = s.late_part if x.delay[MOMENTS, 1] == 0.0 else math.sqrt(x.delay[MOMENTS, 1])
        back = float(x.delay[MOMENTS, 0]) + float(s.responses[x.response[0], 1] * s.late)
        best = int(np.argmax(x.response_evidence))
        lead = float(x.response_evidence[best])
        apart = self._lateness(s, x, best) - back * s.period - self.lag
        doubt = 0.0 if lead <= 0.0 else (1.0 - exponential(-lead)) * apart
        own = share * s.late * s.period
        return back * s.period, math.sqrt(own * own + doubt * doubt)

    @property
    def smoothed(self) -> Array:
        """(r,) squares by which the states may differ from what the window that made them has left of them.

        A mean over a window of length T is off by no more than where something begins within it, by what it has moved
        from half a window before: half of ``x(t) - 2 x(t - T/2) + x(t - T)`` is taken for the standard deviation.
        Without windows nothing. [square of the state]
        """
        s, ring, now = self.settings, self.state.last_phi, self.samples
        half, rows = min((s.straddle + 1) // 2, (len(ring) - 1) // 2), self.theta.shape[0]
        if s.straddle == 0 or now <= 2 * half:
            return np.zeros(rows)
        one, two, three = (ring[(now - 1 - k * half) % len(ring), 1 : rows + 1] for k in range(3))
        return np.asarray((0.5 * (one - 2.0 * two + three)) ** 2)

    @property
    def lag(self) -> float:
        """Of the deflections, that was found: their time constant, 0 for none [s]."""
        return float(self.settings.lag_times[self.settings.responses[self.state.response[0], 0]])

    @property
    def samples(self) -> int:
        """Samples since the last reset."""
        return int(self.state.samples[0])

    def excitation(self, row: int) -> Array:
        """(p,) how far the last seconds excite each parameter of a row [1]."""
        s, x = self.settings, self.state
        info = x.info[x.group[row], :, s.recent]
        p = len(info)
        return np.array([excitation_of(s, float(info[(i + 1) % p]), (i + 1) % p) for i in range(p)])

    def standard_errors(self, row: int) -> Array:
        """(p,) standard errors of a row's estimates."""
        return self.uncertainty(row)[0]

    def uncertainty(self, row: int) -> tuple[Array, float]:
        """Standard errors of a row's estimates, (p,), and the standard deviation of its residual."""
        p = self.theta.shape[1]
        errors, s, x = np.empty(p), self.settings, self.state
        residual = bank_errors(
            s, x, row, self.noise, self.smoothed, x.seen, ratio_of(x), self._work.e, self._work.w, errors
        )
        return errors, residual

    def age(self, row: int) -> int:
        """Samples since the row's group began."""
        return int(self.state.age[self.state.group[row]])

    def recovered(self, row: int) -> bool:
        """Whether a row that had an alarm is long back at its normal settings."""
        return bool(self.age(row) >= 4 * self.theta.shape[1])

    def restore(self, rows: Sequence[int], surface: int) -> None:
        """Let rows that have begun anew take back what they knew of all surfaces but the one that is named."""
        self._work.concerned[:] = 0
        self._work.concerned[list(rows)] = 1
        restore_effectors(self.settings, self.state, surface, self._work)

    def spread(self, rows: Sequence[int], surface: int, change: float, error: float, since: float) -> None:
        """Let all but these rows know what is left of a surface that is named.

        Parameters
        ----------
        rows
            Those that alarmed.
        surface, change, error
            Which, change of its effect and standard error of that, as shares of the effect [1].
        since
            Time since the first of the alarms [s].
        """
        self._work.concerned[:] = 0
        self._work.concerned[list(rows)] = 1
        back = math.ceil(since / (self.settings.period * self.settings.stride)) + 1
        spread_loss(self.settings, self.state, surface, change, error, back, self._work)

    def settle(self, row: int) -> None:
        """Let go of what was known of a row before its alarm."""
        self.state.pending[row] = 0

    def losses(self, rows: Sequence[int]) -> Losses:
        """Say what the rows, since their alarm, know of the loss of each surface.

        It is what the member of the last second and a half says; by how much the quick one contradicts it, beyond
        what chance makes, is part of the error: samples from before the fault fade from the one before the other.
        """
        x, work = self.state, self._work
        work.concerned[:] = 0
        work.concerned[list(rows)] = 1
        s = self.settings
        compare_surfaces(s, x, 0, x.theta_before, x.square_before, KNOWN, False, False, work)
        quick, chance = work.change.copy(), work.variance.copy()
        excess = float(
            compare_surfaces(s, x, len(s.loss_members) - 1, x.theta_before, x.square_before, KNOWN, False, False, work)
        )
        apart = np.maximum(np.square(work.change - quick) - chance, 0.0)  # none where the quick one knows nothing
        for k in range(len(work.change)):
            combine_rows(work, work.lone_against, work.lone_information, k)
        return Losses(
            work.change.tolist(),
            np.sqrt(work.variance + apart).tolist(),
            work.explained.tolist(),
            float(work.by_state[0]),
            excess,
        )

    def undecided(self, rows: Sequence[int], found: Losses) -> bool:
        """Whether what is left of a surface that may be lost has not shown yet in the rows that alarmed.

        Parameters
        ----------
        rows
            That alarmed.
        found
            What they say (`losses`).
        """
        s, x = self.settings, self.state
        for k, error in enumerate(found.error):
            suspected = any(x.suspected[j] != 0 for j in range(s.gains.shape[1]) if s.gains[k, j] != 0.0)
            if suspected and not error <= UNCERTAIN and any(is_known(s, x, q, k) for q in rows):
                return True
        return False

    def mark(self, watched: bool) -> None:
        """Keep what is known at an alarm, of which the rows that go on are asked later.

        Parameters
        ----------
        watched
            Whether an alarm before it is not yet named.
        """
        self._alarm = keep_alarm(self.settings, self.state, self._work, self._alarm if watched else None)

    def denies(self, rows: Sequence[int], surface: int, change: float) -> bool:
        """Whether the rows but these, which alarmed, exclude that a surface's effect has changed by that share."""
        if self._alarm is None:
            return False
        return is_denied(self.settings, self.state, self._work, self._alarm, rows, surface, change)

    def _covariance(self, R: Array, member: int, variance: float) -> Array:
        p = self.theta.shape[1]
        covariance = np.empty((p, p))
        factor_covariance(R, member, variance, np.zeros((p, p)), covariance)
        return np.roll(covariance, -1, axis=(0, 1))
