"""The controller: samples, a pilot's command and the identified model in; deflections and a status out.

One object serves flight and desk, as `estimation.Identifier` does. What comes out is a function of the settings and of
the sequence of calls alone.
"""

from __future__ import annotations

import math

import numpy as np

from msls_ros.control.actuators import StuckMonitor
from msls_ros.control.aircraft import STATES, ControlledAircraft
from msls_ros.control.believed import Believed
from msls_ros.control.errors import ControlError
from msls_ros.control.indi import Indi, Reference, wanted_acceleration
from msls_ros.control.linear import Array, Flags
from msls_ros.control.lq_servo import LqServo
from msls_ros.control.margins import indi_margins, lq_margins
from msls_ros.control.motion import Filters, Motion, motion_of
from msls_ros.control.settings import ControlSettings
from msls_ros.control.signals import Margins, ModelEstimate, PilotCommand, Status
from msls_ros.control.supervisor import FIXED, HOLD, INDI, LQ, Choice, Situation, choose

TRIM_MEMORY = 1.0
"""Of the mean command that counts as the last trim [s]."""
MARGINS_EVERY = 1.0
"""[s]"""
RETURN = 4.0
"""After a gap, derived accelerations are used again after so many time constants of their filter [1]."""
EDGE = 1e-9
"""A command this close to a limit is at it [rad]."""


class Controller:
    """Fly an aircraft by a law that is designed anew from what is identified.

    Parameters
    ----------
    aircraft
        Its surfaces, trim and prior.
    settings
        See `ControlSettings`.
    """

    def __init__(self, aircraft: ControlledAircraft, settings: ControlSettings | None = None) -> None:
        """Allocate everything; see the class."""
        self.aircraft = aircraft
        self.settings = settings or ControlSettings()
        self._mixing = np.ascontiguousarray(aircraft.mixing, np.float64)
        self._back = aircraft.effectors_from_surfaces
        self._low, self._high = np.array(aircraft.low), np.array(aircraft.high)
        self.believed = Believed(aircraft, self.settings)
        self._indi, self._lq = Indi(aircraft, self.settings), LqServo(aircraft, self.settings)
        self._monitor = StuckMonitor(aircraft, self.settings)
        self._filters = Filters(self.settings.filter_bandwidth, len(aircraft.surfaces))
        self.reset()

    def reset(self) -> None:
        """Begin anew, with the prior."""
        self.believed.reset()
        self._monitor.reset()
        self._filters.restart()
        self._reference = Reference(self.settings.roll_lag)
        self._time = -math.inf
        self._paused_until, self._gap = -math.inf, 0.0
        self._model_time = -math.inf
        self._designed, self._margins_at = -math.inf, -math.inf
        self._stuck_before = np.zeros(len(self._low), np.bool_)
        self._command: Array = self.aircraft.preferred.copy()
        self._dither: Array = np.zeros_like(self._command)
        self._trim: Array = np.asarray(self.aircraft.trim_delta, np.float64).copy()
        self._fade: Array = np.zeros_like(self._trim)
        self._law, self._output = "", self._trim
        self._margins = Margins()
        self._dropped = -math.inf
        self._lq.gain = None
        self._indi.unmet[:] = 0.0

    def wants_model(self, time: float) -> bool:
        """Whether an estimate is wanted with the sample of this time [s]."""
        return self.settings.law != FIXED and (time <= self._time or self.believed.due(time))

    def configure(self, settings: ControlSettings) -> None:
        """Change the law that is asked for, in flight.

        Raises
        ------
        ControlError
            For a change of anything else.
        """
        if settings.changed({"law": self.settings.law}) != self.settings:
            message = "only the law can change in flight; expected the other control parameters as they were"
            raise ControlError(message)
        self.settings = settings

    def update(
        self,
        time: float,
        x: Array,
        xdot: Array | None,
        delta: Array,
        command: PilotCommand,
        estimate: ModelEstimate | None = None,
        dither: Array | None = None,
    ) -> tuple[Array, Status]:
        """Answer a sample.

        Parameters
        ----------
        time
            Of the sample [s], later than the last; earlier: everything begins anew.
        x, xdot
            (9,) states and derivatives [m/s, rad/s, rad; per second]; xdot None, or with a NaN among the first six:
            they are derived.
        delta
            (m,) measured deflections [rad].
        command
            What the pilot asks for.
        estimate
            A new one, when there is one; see `wants_model`.
        dither
            (m,) that is added to the answer downstream [rad]: the watch of the actuators counts with it.

        Returns
        -------
        tuple
            (m,) commanded deflections [rad], and what is to be said of them.

        Raises
        ------
        ControlError
            For wrong shapes, or states and deflections that are not finite; nothing has changed then.
        """
        x, xdot, delta = self._checked(time, x, xdot, delta)
        if time <= self._time:
            self.reset()
        period = self._begin(time, xdot is not None)
        measured = self._mixing @ delta
        stuck = self._monitor.update(measured, self._command + self._mixing @ self._dither, period)
        self.added(dither)
        self._filters.update(x, xdot, measured, period)
        self._learn(time, estimate, period)
        motion = motion_of(x, self._filters.velocity_rates)
        if command.usable:
            self._reference.update(command.roll_rate, period)
        power_left = self.believed.pitching_power_left(stuck)
        wanted = wanted_acceleration(self.settings, motion, command, self._reference, power_left)
        choice = self._choose(time, command, xdot is not None, motion)
        surfaces = self._fly(choice.law, time, motion, command, wanted, measured, period)
        output, fade = self._hand_over(choice.law, surfaces, command, period)
        return output, self._tell(time, choice, motion, wanted, fade, period, stuck.copy())

    def added(self, dither: Array | None) -> None:
        """Say, before the next sample, which dither (m,) was added to the last answer [rad]: when it came later."""
        good = dither is not None and np.isfinite(dither).all()
        self._dither = np.asarray(dither) if good else np.zeros(len(self._output))

    def hold(self, time: float, reason: str) -> tuple[Array, Status]:
        """Return the last trim, for when no samples come.

        Parameters
        ----------
        time
            [s]
        reason
            What is missing; a sentence.
        """
        self._law, self._output = HOLD, self._trim.copy()
        self._command = self._mixing @ self._output
        effect, std = self.believed.effectiveness
        status = Status(
            time=time,
            law=HOLD,
            reason=reason,
            design_age=time - self.believed.updated,
            effectiveness=effect,
            effectiveness_std=std,
            stuck=self._monitor.stuck.copy(),
            saturated=np.zeros(len(self._low), np.bool_),
            wanted=np.zeros(3),
            unmet=np.zeros(3),
            margins=self._margins,
        )
        return self._output.copy(), status

    def _checked(self, time: float, x: Array, xdot: Array | None, delta: Array) -> tuple[Array, Array | None, Array]:
        m = len(self.aircraft.effectors)
        x, delta = np.asarray(x, np.float64), np.asarray(delta, np.float64)
        if x.shape != (len(STATES),) or delta.shape != (m,):
            message = f"x and delta of shapes {x.shape} and {delta.shape}; expected ({len(STATES)},) and ({m},)"
            raise ControlError(message)
        if not (math.isfinite(time) and np.isfinite(x).all() and np.isfinite(delta).all()):
            message = f"states {x.tolist()}, deflections {delta.tolist()} at {time} s; expected finite numbers"
            raise ControlError(message)
        if xdot is None or np.shape(xdot) != (len(STATES),) or not np.isfinite(np.asarray(xdot)[:6]).all():
            return x, None, delta
        return x, np.asarray(xdot, np.float64), delta

    def _begin(self, time: float, accelerations: bool) -> float:
        """Return the period; after a gap, or at the start, filters and laws begin with this sample."""
        gap = time - self._time
        self._time = time
        if math.isfinite(gap) and gap <= self.settings.sample_timeout:
            return gap
        self._filters.restart()
        self._monitor.reset()
        if math.isfinite(gap) and not accelerations:
            self._gap, self._paused_until = gap, time + RETURN / self.settings.filter_bandwidth
        return min(gap, self.settings.sample_timeout)

    def _learn(self, time: float, estimate: ModelEstimate | None, period: float) -> None:
        believed = self.believed
        if believed.judge(time, self._filters.response, self._filters.moved, period):
            self._dropped = time
        if estimate is None:
            return
        if estimate.alarm:
            believed.alarm(time)
            self._designed = -math.inf
        if believed.take(time, estimate):
            self._model_time = time

    def _choose(self, time: float, command: PilotCommand, accelerations: bool, motion: Motion) -> Choice:
        asked = self.settings.law
        if asked == LQ:
            self._design(time, motion)
        stack = command.stack
        return choose(
            Situation(
                asked=asked,
                regular=time >= self._paused_until,
                gap=self._gap,
                command=command.usable,
                fixed=self.settings.stack
                and stack is not None
                and np.shape(stack) == self._trim.shape
                and bool(np.isfinite(stack).all()),
                accelerations=accelerations,
                model_age=time - self._model_time,
                model_timeout=self.settings.model_timeout,
                frozen=self.settings.model == "frozen",
                unknown=tuple(self.believed.knows()),
                dropped=time - self._dropped < 1.0,
                lq_problem=self._lq.problem if self._lq.gain is None else "",
            )
        )

    def _design(self, time: float, motion: Motion) -> None:
        """Design the servo where it is due: at its rate, at an alarm, and when a surface gets stuck or free."""
        c, stuck = self.settings, self._monitor.stuck
        rate = c.alarm_redesign_rate if self.believed.fast(time) else c.redesign_rate
        changed = bool((stuck != self._stuck_before).any())
        if self._lq.gain is None or changed or time - self._designed >= 1.0 / rate - 1e-9:
            self._lq.design(self.believed, motion, stuck)
            self._designed, self._stuck_before = time, stuck.copy()

    def _fly(
        self,
        law: str,
        time: float,
        motion: Motion,
        command: PilotCommand,
        wanted: Array,
        measured: Array,
        period: float,
    ) -> Array | None:
        """Return the surfaces' commands of a law of this room (s,); None: it is none of this room's."""
        stuck = self._monitor.stuck
        before = self._command if self._law == law else np.clip(measured, self._low, self._high)
        if law == INDI:
            return self._indi.command(self.believed, self._filters, wanted, stuck, measured, before)
        if law == LQ:
            acceleration = self._filters.unfiltered
            return self._lq.command(motion, acceleration, command, self._reference, stuck, measured, before, period)
        return None

    def _hand_over(self, law: str, surfaces: Array | None, command: PilotCommand, period: float) -> tuple[Array, float]:
        """Return the deflections (m,), faded over from what flew before, and the largest part of the fade."""
        if surfaces is not None:
            alone = self._back @ surfaces
        elif law == FIXED and command.stack is not None:
            alone = np.asarray(command.stack, np.float64)
        else:
            alone = self._trim
        if self._law and law != self._law:
            self._fade = self._output - alone
        else:
            time = self.settings.handover_time
            self._fade = self._fade * (math.exp(-period / time) if time > 0.0 else 0.0)
        output = alone + self._fade
        self._law, self._output = law, output
        self._command = self._mixing @ output if surfaces is None else surfaces + self._mixing @ self._fade
        if law != HOLD:
            self._trim = self._trim - math.expm1(-period / TRIM_MEMORY) * (output - self._trim)
        return output.copy(), float(np.abs(self._fade).max())

    def _tell(
        self, time: float, choice: Choice, motion: Motion, wanted: Array, fade: float, period: float, stuck: Flags
    ) -> Status:
        indi = choice.law == INDI
        if choice.law in (INDI, LQ) and time - self._margins_at >= MARGINS_EVERY - 1e-9:
            self._margins_at = time
            if indi:
                self._margins = indi_margins(self.believed, motion, self.settings, self.aircraft, period, stuck)
            else:
                self._margins = lq_margins(self._lq, self.aircraft, period)
        effect, std = self.believed.effectiveness
        saturated = (self._command <= self._low + EDGE) | (self._command >= self._high - EDGE)
        return Status(
            time=time,
            law=choice.law,
            reason=choice.reason,
            design_age=time - self.believed.updated,
            effectiveness=effect,
            effectiveness_std=std,
            stuck=stuck,
            saturated=saturated & ~stuck,
            wanted=wanted,
            unmet=self._indi.unmet.copy() if indi else np.zeros(3),
            margins=self._margins,
            handover=fade,
        )
