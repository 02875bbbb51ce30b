"""A law of the room `control` in the closed loop: what it is told of the aircraft, and what the pilot asks it for."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from msls_ros.control import ControlledAircraft, Controller, ControlSettings, ModelEstimate, PilotCommand, Prior, Status
from msls_ros.estimation import Estimate
from msls_ros.plant import Airframe, LinearTruth, Manoeuvre, Sample, Trim

Array = NDArray[np.float64]
LEVELLING_GAIN = 0.3
"""Roll rate per bank angle while the stick is free, as the pilot's [1/s]."""
PHI = 6


@dataclass(frozen=True)
class LawPlan:
    """Which law flies."""

    settings: ControlSettings = field(default_factory=ControlSettings)
    prior: bool = True
    """Whether the truth at trim is known at the start; False: nothing is known of the effectors."""
    told_truth: bool = False
    """Whether the true model is believed instead of the identified one: what perfect identification would give."""


@dataclass(frozen=True)
class Stick:
    """What the pilot asks a law for: the manoeuvre, and level wings while the stick is free."""

    manoeuvre: Manoeuvre
    alpha: float
    """Of the trim [rad]."""

    def command(self, time: float, bank: float, stack: Array | None = None) -> PilotCommand:
        """Return the command at a time [s] and a bank angle [rad]."""
        roll_rate = self.manoeuvre.roll_rate(time)
        if not self.manoeuvre.active(time):
            roll_rate -= LEVELLING_GAIN * bank
        return PilotCommand(roll_rate, self.alpha + self.manoeuvre.alpha_offset(time), stack=stack)


def controlled(trim: Trim, truth: LinearTruth | None) -> ControlledAircraft:
    """Return an aircraft as the laws see it.

    Parameters
    ----------
    trim
        Where it flies.
    truth
        The prior; None: nothing is known.
    """
    airframe = trim.condition.airframe
    prior = None if truth is None else Prior(truth.a, truth.b)
    mixing = np.array(airframe.mixing)
    own = mixing.shape[0] == mixing.shape[1]
    actuators = [one.actuator for one in airframe.surfaces] if own else list(airframe.actuators)
    return ControlledAircraft(
        effectors=airframe.effectors,
        surfaces=airframe.surface_names if own else airframe.effectors,
        mixing=mixing if own else np.eye(len(airframe.effectors)),
        low=tuple(one.low for one in actuators),
        high=tuple(one.high for one in actuators),
        rate_limit=tuple(one.rate_limit for one in actuators),
        bandwidth=tuple(one.bandwidth for one in actuators),
        trim_delta=trim.delta,
        trim_alpha=trim.alpha,
        prior=prior,
    )


class Steering:
    """A controller in the loop.

    Parameters
    ----------
    plan
        Which law.
    trim, truth
        Steady flight, and the model there.
    manoeuvre
        What the pilot does.
    """

    def __init__(self, plan: LawPlan, trim: Trim, truth: LinearTruth, manoeuvre: Manoeuvre) -> None:
        """Make the controller; see the class."""
        self._plan = plan
        self._stick = Stick(manoeuvre, trim.alpha)
        settings = plan.settings.changed({"model": "raw", "caution": 0.0}) if plan.told_truth else plan.settings
        self.controller = Controller(controlled(trim, truth if plan.prior else None), settings)

    def wants_model(self, time: float) -> bool:
        """Whether the identified model is wanted with the sample of this time [s]."""
        return not self._plan.told_truth and self.controller.wants_model(time)

    def wants_truth(self, time: float) -> bool:
        """Whether the true one is."""
        return self._plan.told_truth and self.controller.wants_model(time)

    def answer(
        self,
        measured: Sample,
        time: float,
        stack: Array,
        dither: Array,
        estimate: Estimate | None,
        truth: LinearTruth | None,
    ) -> tuple[Array, Status]:
        """Return the deflections (m,) that answer a sample, and the status.

        Parameters
        ----------
        measured, time
            The sample, and its stamp [s].
        stack
            (m,) what the fixed law answers.
        dither
            (m,) that is added to the answer.
        estimate, truth
            Where one is wanted.
        """
        command = self._stick.command(time, float(measured.x[PHI]), stack)
        model = None
        if truth is not None:
            none = np.zeros_like(truth.a), np.zeros_like(truth.b)
            model = ModelEstimate(time, truth.a, truth.b, *none)
        elif estimate is not None:
            model = ModelEstimate.of(estimate)
        return self.controller.update(time, measured.x, measured.xdot, measured.delta, command, model, dither)


def surface_names(airframe: Airframe) -> tuple[str, ...]:
    """Return what a law calls surfaces of an aircraft."""
    return airframe.surface_names if len(airframe.surfaces) == len(airframe.effectors) else airframe.effectors
