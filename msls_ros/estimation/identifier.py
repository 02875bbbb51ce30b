"""The identifier: samples in, linear model with error bars, fault events and dither out.

One object serves flight and desk: the node calls `Identifier.update` per sample, offline tools call `Identifier.run` on
arrays, and both go through the same compiled loop (`regression.Regression`). What comes out is a function of the
configuration and the sample sequence alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from msls_ros.estimation import configuration as _configuration
from msls_ros.estimation.arguments import Stamps, as_numbers, as_stamp, as_whole
from msls_ros.estimation.bank.regression import BankRegression
from msls_ros.estimation.compiled import warn_if_interpreted
from msls_ros.estimation.configuration import Configuration
from msls_ros.estimation.dither import DitherLaw
from msls_ros.estimation.dither.answer import NOT_FLYING, Dither, DitherBlock, Level
from msls_ros.estimation.dither.inputs import Knowledge
from msls_ros.estimation.engine import make_engine
from msls_ros.estimation.errors import EstimationError
from msls_ros.estimation.estimate import Estimate, FaultEvent
from msls_ros.estimation.followed import Followed
from msls_ros.estimation.gusts import clear_air, make_air, observe_air
from msls_ros.estimation.kernel import Array
from msls_ros.estimation.model import Assembly
from msls_ros.estimation.samples import Preparation, Samples, as_block, check_samples
from msls_ros.estimation.screening import HELD, REPEATED, Screen, Screened, alike
from msls_ros.estimation.soundness import PACE, RESPONSE, SOUND
from msls_ros.estimation.state import COLOURS, Output
from msls_ros.estimation.supervision import Supervisor

CHUNK = 4096
"""Samples that `Identifier.run` has memory for at a time."""
LEARNT_FOR = 10.0
"""What has been learnt for so long is not forgotten without an event [s]."""


@dataclass(frozen=True)
class Run:
    """What many samples gave."""

    estimates: list[Estimate]
    dithers: list[DitherBlock]
    """The dithers that answer the samples, block by block."""
    followed: list[Array]
    """The estimate that is followed after each sample, block by block; see `Identifier.follow`."""
    signals: list[tuple[Array, Array]]
    """Prediction errors and change statistics (k, r) of each sample, block by block; none where nothing is learnt."""


class Identifier:
    """Recursive identification of ``xdot = A x + B delta + bias`` with change detection and dither.

    Parameters
    ----------
    configuration
        All parameters; see `Configuration`.
    straddle
        Intervals of the window in which the derivatives were made, and through which states and deflections went as
        well; 0: derivatives are measured. So many samples after a change are of both sides of it, and the bank does
        not learn from them; the noise of a window is another one than that of sensors, too. Left at 0 beside
        derivatives that were made, losses are alarmed late or not at all. `inputs.differentiated` makes them, and
        returns the number to give.
    servos
        Whether deflections are commands that have passed a model of their servo (``servo=`` of an input), which is
        never all that the servo is: the bank says less where what answers is late.
    gated
        Whether the stamps come from the gate of `inputs`, as in the node and in `replay`: they have been compared in
        nanoseconds, and are not checked here.

    Raises
    ------
    EstimationError
        For a straddle that is no whole number, or negative.
    """

    def __init__(
        self, configuration: Configuration, straddle: int = 0, *, servos: bool = False, gated: bool = False
    ) -> None:
        """Allocate everything; see the class."""
        self.configuration = configuration
        c = configuration
        self._kept = np.array([c.states.index(s) for s in c.rows], np.int64)
        self._regressors = c.regressors
        self._law = DitherLaw(c)
        self._signals: list[tuple[Array, Array]] = []
        self._supervisor = Supervisor(c)
        self.straddle = as_whole("straddle", straddle, 0)
        """As it was given."""
        self.servos = servos
        """As it was given."""
        self._stamps = Stamps(c.sample_rate, gated)
        self._screen = Screen(c)
        self._begin(c)
        self._velocities = np.array([c.states.index(s) for s in "uvw" if s in c.states], np.int64)
        self._air = make_air(len(self._velocities))
        self._enabled = True
        self._followed = Followed(c)
        warn_if_interpreted(len(c.regressors), len(c.rows), len(COLOURS) if c.reliability.coloured else 1)
        self.reset()

    def _begin(self, c: Configuration) -> None:
        """Make what learns, with nothing learnt yet; the rate in the configuration is that of what it learns from."""
        self._learns, self._period = c, self._screen.period
        self._regression = make_engine(c, self.straddle, servos=self.servos)
        self._assembly = Assembly(c, self._regression)
        self._preparation = Preparation(c, self._regression)
        self._warm: tuple[Array, Array, Array | None, Array | None] | None = None

    def _follow_pace(self) -> None:
        """Begin anew, from what was known at the start, where samples are learnt from at another rate than before."""
        rate, samples, warm = 1.0 / self._screen.period, self._regression.samples, self._warm
        if samples * self._period >= LEARNT_FOR:
            self._events.append(self._supervisor.restart(self._screen.now, PACE, self._regression))
        self._begin(self.configuration.replace({"sample_rate": rate}))
        self._passed += samples
        if warm is not None:
            self._warm = warm
            self._regression.warm_start(*warm)
        self._supervisor.configure(self._learns)
        self._supervisor.drop()
        self._follow()

    def reset(self) -> None:
        """Forget everything: estimates, factor, detector, dither sequence."""
        self._stamps.clear()
        self._screen.reset()
        if self._period != self._screen.period:
            self._begin(self.configuration)
            self._supervisor.configure(self._learns)
            self._follow()
        self._regression.reset()
        self._warm = None
        self._followed.last = 0.0
        self._law.reset()
        self._supervisor.reset()
        clear_air(self._air)
        self._preparation.reset()
        self._passed = 0
        """Samples that are not learnt from, or not yet."""
        self._learnt_x: Array | None = None
        self._held_x: Array | None = None
        """States of the last sample that was learnt from, and of the last sample where that is another one: no speed
        and no motion to hand out a model at, until it is known for none of a spike."""
        self._newest: tuple[Output, int] | None = None
        """What came of the last sample that was learnt from: where, and at which place."""
        self._events: list[FaultEvent] = []
        self._dither = Dither(np.zeros(len(self.configuration.effectors)), 0.0, 0.0, 0.0, Level.OFF, "no sample yet")
        self._error = self._statistic = np.zeros(len(self.configuration.rows))

    @property
    def enabled(self) -> bool:
        """Whether samples are learnt from; while not, the model stays as it is and the dither is zero."""
        return self._enabled

    @enabled.setter
    def enabled(self, on: bool) -> None:
        self._enabled = bool(on)

    def warm_start(
        self,
        a: Array,
        b: Array,
        bias: Array,
        covariance: Array,
        x: Array | None = None,
        delta: Array | None = None,
        errors: tuple[Array, Array] | None = None,
    ) -> None:
        """Start anew from a known model instead of from nothing; the next sample may be of any time.

        Parameters
        ----------
        a, b, bias
            (n, n), (n, m) and (n,): ``xdot = a x + b delta + bias``. Known rows and columns are not read.
        covariance
            (p, p) covariance of the estimates over the residual variance, in the order of
            ``configuration.regressors``; all rows share it.
        x
            (n,) states at which what is known from physics stands in ``a`` and ``bias``, as `estimate` enters it;
            None: they hold none of it.
        delta
            (m,) deflections there: what the speed makes of their effects stands in the derivatives by velocities
            (`bank.speed`); None: zero.
        errors
            (n, n) and (n, m) standard errors of ``a`` and ``b``, infinite where nothing is known: what the bank
            publishes is as well known as that until more is known; None: the covariance alone says what is.

        Raises
        ------
        EstimationError
            For wrong shapes, numbers that are not finite, or a covariance that is none; nothing has changed then.
        """
        theta, seen = self._assembly.take_apart(a, b, bias, x, delta)
        bars = None if errors is None else self._assembly.take_errors(*errors)
        warm = theta, np.array(covariance, dtype=np.float64), seen, bars
        self._regression.warm_start(*warm)
        self._warm = warm
        self._stamps.clear()
        self._followed.read(self._regression.theta)
        self._law.reset()
        self._supervisor.reset()
        self._events = []

    def configure(self, changes: Mapping[str, Any]) -> None:
        """Change parameters in flight, by their full names; what has been learnt stays.

        Raises
        ------
        EstimationError
            For a value that is refused, or a parameter that cannot change in flight; nothing has changed then.
        """
        configuration = self.configuration.replace(changes)
        self.check_change(configuration)
        self.configuration = configuration
        self._learns = configuration.replace({"sample_rate": self._learns.sample_rate})
        self._law.configure(self.configuration)
        self._supervisor.configure(self._learns)
        self._regression.configure(self._learns)
        self._follow()
        self._assembly = Assembly(self._learns, self._regression)

    def _follow(self) -> None:
        self._regression.follow(*self._followed.place)
        self._followed.read(self._regression.theta)

    @property
    def air(self) -> float:
        """Share of the motion through the air that gusts make, 0 to 1; see `gusts`."""
        return 0.0 if isinstance(self._regression, BankRegression) else self._regression.air

    @property
    def moving_air(self) -> bool:
        """Whether the air moves so much that it widens the error bars."""
        return not isinstance(self._regression, BankRegression) and self._regression.moving_air

    @property
    def flying(self) -> bool:
        """Whether the last sample was of flight; on the ground nothing is learnt and the dither is zero."""
        return self._screen.flying

    @property
    def grounded(self) -> int:
        """Samples that were not of flight, since the last reset; see `screening`."""
        return self._screen.grounded

    @property
    def spikes(self) -> int:
        """Samples dropped because something jumped and came back, since the last reset."""
        return self._screen.spikes

    @property
    def spike(self) -> str:
        """What jumped furthest in the last spike; empty: there was none."""
        return self._screen.spike

    @property
    def repeated(self) -> int:
        """Samples passed over because a number in them had not been measured anew, since the last reset."""
        return self._screen.repeated

    @property
    def repeating(self) -> str:
        """Which number that was last; empty: there was none."""
        return self._screen.repeating

    @property
    def held(self) -> tuple[str, ...]:
        """Which numbers are not measured in every sample; see `repeats`."""
        return self._screen.held

    @property
    def learning_rate(self) -> float:
        """Rate of the samples that are learnt from [Hz]: as configured, or slower where they have come so."""
        return self._learns.sample_rate

    @property
    def alarms(self) -> int:
        """Alarms since the last reset."""
        return self._supervisor.alarms

    @property
    def parameters(self) -> dict[str, Any]:
        """All parameters by full name."""
        return _configuration.as_mapping(self.configuration)

    def check_change(self, configuration: Configuration) -> None:
        """Raise EstimationError if the configuration differs in what cannot change in flight."""
        current = self.parameters
        for name, value, bounds in _configuration.items(configuration):
            if not bounds.in_flight and value != current[name]:
                message = f"parameter '{name}' cannot change while the estimator runs; set it before the start"
                raise EstimationError(message)

    def update(self, time: float, x: Array, xdot: Array, delta: Array) -> Estimate:
        """Take one sample.

        Parameters
        ----------
        time
            Of the sample [s], later than the last since `reset`.
        x, xdot
            (n,) states and their derivatives [m/s, rad/s, rad; per second].
        delta
            (m,) measured deflections [rad].

        Raises
        ------
        EstimationError
            For wrong shapes, what is no number or not finite, and a time that is not later than the last; for steps of
            time ten times longer than ``sample_rate`` means, and than .5 s, or ten times shorter, from the twentieth in
            a row on: another unit than seconds. Nothing has changed then.
        """
        self.learn(time, x, xdot, delta)
        return self.estimate(time, np.asarray(x, float))

    def learn(self, time: float, x: Array, xdot: Array, delta: Array) -> Dither:
        """Take one sample without putting the model together; return the dither that answers it.

        As `update` otherwise; `estimate` gives the model when it is wanted.
        """
        stamp = as_stamp(time)
        sample = np.array([stamp]), as_block("x", x), as_block("xdot", xdot), as_block("delta", delta)
        check_samples(self.configuration, 1, *sample[1:])
        self._stamps.check_one(stamp)
        self._stamps.take_one(stamp)
        screened = self._screened(*sample)
        count = 1 if screened.learnt is None else int(screened.learnt[0])
        samples = self._preparation.prepare(screened, self._enabled)
        self._step(samples, 0, count, int(screened.verdict[0]), sample[0], sample[1], sample[3])
        self._keep_pace()
        return self._dither

    def follow(self, row: str, column: str) -> None:
        """Have `run` and `followed` tell one estimate after every sample, at no cost to speak of.

        Parameters
        ----------
        row
            State whose derivative equation it stands in.
        column
            State or effector.

        Raises
        ------
        EstimationError
            For what is not identified.
        """
        self._followed.choose(row, column)
        self._follow()

    @property
    def news(self) -> bool:
        """Whether there are events that no estimate has told yet."""
        return bool(self._events)

    @property
    def last_dither(self) -> Dither:
        """The dither that answers the last sample."""
        return self._dither

    def take_events(self) -> tuple[FaultEvent, ...]:
        """Return the events since the last call; no estimate tells them again."""
        events, self._events = tuple(self._events), []
        return events

    @property
    def samples(self) -> int:
        """Samples since the last reset, but what came while nothing was learnt on demand (`enabled`)."""
        return self._regression.samples + self._passed

    @property
    def covariance(self) -> Array:
        """(p, p) of the estimates over the residual variance, as `warm_start` takes it; of the rows that share one."""
        found = self._regression.covariance
        return 0.5 * (found + found.T)

    @property
    def followed(self) -> float:
        """The estimate that is followed, after the last sample."""
        return self._followed.last

    def run(self, time: Array, x: Array, xdot: Array, delta: Array, every: int = 1) -> Run:
        """Take many samples; estimates come after every ``every``-th since the last reset and after each event.

        Samples that are not learnt from are no error: `grounded`, `spikes` and `repeated` count them. Of no sample, or
        of fewer than ``every``, there may be no estimate; `estimate` gives the model as it stands.

        Parameters
        ----------
        time
            (k,) [s], float64; they increase strictly, and are later than the last sample since `reset`.
        x, xdot, delta
            (k, n), (k, n), (k, m).
        every
            Samples per estimate, 1 or more.

        Raises
        ------
        EstimationError
            As `update`, but that a unit of time shows in the median of twenty steps or more; for dates and text, with
            what to write instead. Nothing has changed then.
        """
        every = as_whole("every", every, 1)
        dtype = getattr(time, "dtype", np.float64)
        time, x, xdot, delta = map(as_numbers, ("time", "x", "xdot", "delta"), (time, x, xdot, delta))
        self._stamps.check(time, dtype)
        check_samples(self.configuration, len(time), x, xdot, delta)
        self._stamps.take(time)
        run = Run([], [], [], [])
        begin = 0
        while begin < len(time):
            chunk = slice(begin, begin + CHUNK)
            begin += self._run_chunk(run, time[chunk], x[chunk], xdot[chunk], delta[chunk], every)
        return run

    def _run_chunk(self, run: Run, time: Array, x: Array, xdot: Array, delta: Array, every: int) -> int:
        """Take checked samples, up to `CHUNK` of them, and no more at one pace than there are; return how many."""
        screened = self._screened(time, x, xdot, delta)
        samples = self._preparation.prepare(screened, self._enabled)
        ends = np.concatenate([[0], np.cumsum([] if screened.learnt is None else screened.learnt)])
        count, start = len(screened.verdict), 0
        while start < count:
            stop = min(start + every - self.samples % every, count)
            first, last = start, stop
            said = int(screened.verdict[start])
            if screened.learnt is not None:
                stop = min(stop, start + alike(screened.learnt[start:], screened.verdict[start:]))
                first, last = int(ends[start]), int(ends[stop])
            part = slice(start, stop)
            block, followed = self._step(samples, first, last, said, time[part], x[part], delta[part])
            run.dithers.append(block)
            run.followed.append(followed)
            run.signals.extend(self._signals)
            if stop == count:
                self._keep_pace()
            if self.samples % every == 0 or self._events:
                run.estimates.append(self.estimate(float(time[stop - 1]), x[stop - 1]))
            start = stop
        return count

    def _keep_pace(self) -> None:
        if self._screen.period != self._period:
            self._follow_pace()

    def _screened(self, time: Array, x: Array, xdot: Array, delta: Array) -> Screened:
        """Say which samples are learnt from; all, where that is not asked, or nothing is learnt."""
        if self._screen.idle or not self._enabled:
            return Screened(time, x, xdot, delta, np.zeros(len(time), np.int64), None)
        return self._screen.judge(time, x, xdot, delta)

    def _step(
        self, samples: Samples, first: int, last: int, verdict: int, time: Array, x: Array, delta: Array
    ) -> tuple[DitherBlock, Array]:
        """Answer samples, of time (k,), x (k, n), delta (k, m), with what is learnt at them.

        Parameters
        ----------
        samples, first, last
            What there is to learn, and what of it at these samples: as many as they are, or any number at a single one.
        verdict
            On the first of them: whether it is learnt from, held, or not of flight.

        Returns
        -------
        tuple
            The dithers, and the estimate that is followed after each.
        """
        count = len(time)
        if last > first or not self._enabled:
            self._passed -= last - first - count
            return self._take(samples, first, last, time, delta)
        self._passed += count
        self._signals.clear()
        waits = verdict in (HELD, REPEATED)
        self._held_x = x[-1].copy() if waits else None
        if waits and self._newest is not None:
            out, place = self._newest
            k = slice(place, place + 1)
            quiet = np.zeros_like(out.alarm[k])
            nothing = np.full((len(time), quiet.shape[1], 1), np.nan)
            known = Knowledge(out.b[k], out.b_variance[k], out.excitation[k], quiet, nothing)
            block = self._law.commands(time, known, delta)
        else:
            block = self._law.silence(time, NOT_FLYING)
        self._dither = block.at(-1)
        x = np.array([self._believed(one) for one in x])
        return block, self._followed_at(x)

    def _take(
        self, samples: Samples, start: int, stop: int, answered_time: Array, answered_delta: Array
    ) -> tuple[DitherBlock, Array]:
        """Put samples through the compiled loop, and what the last ones say through the dither law.

        Parameters
        ----------
        samples, start, stop
            What to learn from.
        answered_time, answered_delta
            (k,) and (k, m) of the samples that are answered.

        Returns
        -------
        tuple
            The dithers that answer them, and the estimate that is followed after each.
        """
        time, x, xdot, _, phi, y, out = samples
        part = slice(start, stop)
        answered = slice(stop - len(answered_time), stop)
        self._signals.clear()
        if not self._enabled:
            block = self._law.silence(time[part])
            self._dither = block.at(-1)
            return block, self._followed_at(x[part])
        if not isinstance(self._regression, BankRegression):
            forgetting = 1.0 - 1.0 / self.configuration.reliability.air_memory
            self._regression.air = observe_air(self._air, time[part], x[part], xdot[part], self._velocities, forgetting)
        done = start
        while done < stop:
            done = self._regression.advance_into(out, phi, y, done, done + 1 if self._supervisor.watching else stop)
            now = float(answered_time[max(done - 1 - answered.start, 0)])  # what waited is said when it is answered
            alarm, self._statistic = out.alarm[done - 1], out.statistic[done - 1]
            why = int(out.restart[done - 1])
            if why != SOUND:
                self._passed = self._passed if why == RESPONSE else 0
                self._events.append(self._supervisor.restart(now, why, self._regression))
            if any(alarm.tolist()):
                self._events.append(self._supervisor.alarm(now, self._statistic, alarm, self._regression))
            if self._supervisor.watching:
                self._events += self._supervisor.follow(now, self._regression)
        self._error = out.e[stop - 1]
        self._newest = out, stop - 1
        self._learnt_x, self._held_x = x[stop - 1].copy(), None
        self._signals.append((out.e[part], out.statistic[part]))
        known = Knowledge(
            out.b[answered],
            out.b_variance[answered],
            out.excitation[answered],
            out.alarm[answered],
            y[answered, :, None],
        )
        block = self._law.commands(answered_time, known, answered_delta)
        self._dither = block.at(-1)
        return block, self._followed.report(out.followed[answered], x[answered])

    def _followed_at(self, x: Array) -> Array:
        """Return the estimate that is followed, (k,), as it is at states (k, n) while nothing is learnt."""
        return self._followed.report(self._regression.values(*self._followed.place, x, self._kept), x)

    def _believed(self, x: Array) -> Array:
        """Return states (n,), or those of the last sample learnt from where these are of one that is held."""
        held = self._held_x is not None and np.array_equal(x, self._held_x)
        return self._learnt_x if held and self._learnt_x is not None else x

    def estimate(self, time: float, x: Array) -> Estimate:
        """Return the model as it stands at ``x`` (n,), with the events since the last call.

        What is known of physics is that there, and what goes with airspeed. At the sample that was held last it is
        that at the last one learnt from, with the difference between the two as an error.
        """
        c = self.configuration
        x = np.ascontiguousarray(x, np.float64)
        believed = self._believed(x)
        model, best, forgetting = self._assembly.build(believed, None if believed is x else x)
        delay, delay_std = self._regression.delay
        return Estimate(
            time=time,
            states=c.states,
            effectors=c.effectors,
            a=model.a,
            b=model.b,
            bias=model.bias,
            a_std=model.a_std,
            b_std=model.b_std,
            a_known=self._assembly.a_known,
            a_reliable=model.a_reliable,
            b_reliable=model.b_reliable,
            a_best=best.a_best,
            b_best=best.b_best,
            a_best_std=best.a_best_std,
            b_best_std=best.b_best_std,
            a_best_time=best.a_best_time,
            b_best_time=best.b_best_time,
            regressors=self._regressors,
            excitation=model.excitation,
            residual_std=model.residual_std,
            forgetting_factor=forgetting,
            delay=delay,
            delay_std=delay_std,
            lag=self._regression.lag,
            state_delay=self._preparation.state_delay,
            samples=self.samples,
            prediction_error=self._error.copy(),
            statistic=self._supervisor.statistic(self._statistic),
            events=self.take_events(),
            dither=self._dither,
        )
