"""The controller in closed loop with a made-up linear aircraft: what flies when something is missing."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import pytest
from control.made_up import PERIOD, A, B, Plant, aircraft

from msls_ros.control import ControlError, Controller, ControlSettings, ModelEstimate, PilotCommand, Status
from msls_ros.control.linear import Array

TURN = math.radians(5.0)


@dataclass
class Flown:
    """What a flight left behind."""

    commands: list[Array] = field(default_factory=list)
    statuses: list[Status] = field(default_factory=list)
    rolls: list[float] = field(default_factory=list)
    alphas: list[float] = field(default_factory=list)
    betas: list[float] = field(default_factory=list)


def model(time: float, effect: Array, alarm: bool = False) -> ModelEstimate:
    return ModelEstimate(time, A, B * effect, np.full((9, 9), 0.01), np.full((9, 4), 0.05), alarm)


def fly(
    controller: Controller,
    seconds: float = 6.0,
    *,
    events: Callable[[float, Plant, Controller], None] = lambda *_: None,
    accelerations: Callable[[float], bool] = lambda _: True,
    models: Callable[[float], bool] = lambda _: True,
    skip: Callable[[float], bool] = lambda _: False,
    stack: bool = True,
) -> Flown:
    """Fly a turn; the fixed law damps and holds, and the identified model is the truth with error bars."""
    plant, flown, command = Plant(), Flown(), np.zeros(4)
    for k in range(round(seconds / PERIOD)):
        time = k * PERIOD
        events(time, plant, controller)
        if not skip(time):
            wanted = TURN if time > 0.5 else 0.0
            gains = 0.5 * (plant.x[3] - wanted), -0.8 * plant.x[4] - 0.01 * plant.x[2], -0.5 * plant.x[5]
            fixed = np.array([-gains[0], -gains[1], -gains[2], 0.0]) if stack else None
            estimate = model(time, plant.effect) if models(time) and controller.wants_model(time) else None
            asked = PilotCommand(wanted, 0.0, stack=fixed)
            xdot = plant.xdot if accelerations(time) else None
            command, status = controller.update(time, plant.x, xdot, plant.delta, asked, estimate)
            flown.statuses.append(status)
            flown.commands.append(command)
        plant.step(command)
        flown.rolls.append(float(plant.x[3]))
        flown.alphas.append(float(plant.x[2] / plant.x[0]))
        flown.betas.append(float(plant.x[1] / plant.x[0]))
    return flown


@pytest.mark.parametrize("law", ["indi", "lq", "auto"])
def test_the_laws_follow_the_roll_command_and_hold_the_rest(law: str) -> None:
    flown = fly(Controller(aircraft(), ControlSettings(law=law)))
    assert abs(flown.rolls[-1] - TURN) < math.radians(0.5)
    assert max(map(abs, flown.alphas)) < math.radians(0.5)
    assert {one.law for one in flown.statuses} == {"lq" if law == "lq" else "indi"}
    margins = flown.statuses[-1].margins
    assert margins.gain > 1.5 and margins.phase > 0.5 and margins.delay > PERIOD


def test_the_turn_of_gravity_in_a_roll_makes_no_sideslip() -> None:
    flown = fly(Controller(aircraft()))  # 27 deg of bank at the end; answered as an error alone it is 0.4 deg
    assert max(map(abs, flown.betas)) < math.radians(0.1)


@pytest.mark.parametrize("law", ["indi", "lq"])
def test_the_same_calls_give_the_same_bits(law: str) -> None:
    one, other = (fly(Controller(aircraft(), ControlSettings(law=law)), 2.0) for _ in range(2))
    assert np.array_equal(one.commands, other.commands)
    controller = Controller(aircraft(), ControlSettings(law=law))
    fly(controller, 2.0)
    again = fly(controller, 2.0)  # time jumps back: everything begins anew
    assert np.array_equal(one.commands, again.commands)


def test_without_accelerations_they_are_derived_and_the_status_says_so() -> None:
    flown = fly(Controller(aircraft()), accelerations=lambda _: False)
    assert abs(flown.rolls[-1] - TURN) < math.radians(0.7)
    assert "accelerations are derived" in flown.statuses[-1].reason


def test_a_model_that_stops_or_is_no_number_leaves_the_last_believed_one() -> None:
    flown = fly(Controller(aircraft()), models=lambda time: time < 2.0)
    assert flown.statuses[-1].reason.startswith("the last believed model: none for 4.1 s")
    assert flown.statuses[-1].design_age == pytest.approx(4.0, abs=0.1)
    assert abs(flown.rolls[-1] - TURN) < math.radians(0.5)
    controller = Controller(aircraft())
    bad = ModelEstimate(0.0, A * math.nan, B * math.nan, A, B)
    answer, status = controller.update(0.0, Plant().x, Plant().xdot, np.zeros(4), PilotCommand(0.0, 0.0), bad)
    assert np.isfinite(answer).all() and status.reason == "no model yet"


@pytest.mark.parametrize("stack", [True, False])
def test_a_gap_in_the_samples_hands_over_until_accelerations_are_known_and_back(stack: bool) -> None:
    flown = fly(
        Controller(aircraft()), 8.0, skip=lambda time: 4.0 < time < 4.5, accelerations=lambda _: False, stack=stack
    )
    laws = [one.law for one in flown.statuses]
    other = "fixed" if stack else "hold"
    assert laws[0] == laws[-1] == "indi" and other in laws
    pause = [one for one in flown.statuses if one.law == other]
    assert "samples were 0.5" in pause[0].reason and pause[-1].time - pause[0].time == pytest.approx(0.14, abs=0.03)
    assert abs(flown.rolls[-1] - TURN) < math.radians(0.7)
    measured = fly(Controller(aircraft()), 8.0, skip=lambda time: 4.0 < time < 4.5, stack=stack)
    assert {one.law for one in measured.statuses} == {"indi"} and abs(measured.rolls[-1] - TURN) < math.radians(0.5)


def test_laws_change_in_flight_without_a_bump() -> None:
    def switch(time: float, _: Plant, controller: Controller) -> None:
        law = {3.0: "fixed", 5.0: "indi", 7.0: "lq", 9.0: "indi"}.get(round(time, 3))
        if law is not None:
            controller.configure(controller.settings.changed({"law": law}))

    flown = fly(Controller(aircraft(), ControlSettings(law="indi")), 11.0, events=switch)
    laws = [one.law for one in flown.statuses]
    for k in range(1, len(laws)):
        if laws[k] != laws[k - 1]:
            assert np.abs(flown.commands[k] - flown.commands[k - 1]).max() < math.radians(0.2)
    assert {"fixed", "indi", "lq"} == set(laws)
    with pytest.raises(ControlError, match="only the law can change"):
        controller = Controller(aircraft())
        controller.configure(controller.settings.changed({"caution": 1.0}))


def test_a_lost_surface_is_learnt_and_the_turn_kept() -> None:
    def lose(time: float, plant: Plant, _: Controller) -> None:
        if time >= 2.0:
            plant.effect[0], plant.offset[0] = 0.0, math.radians(3.0)

    flown = fly(Controller(aircraft()), 8.0, events=lose)
    assert abs(flown.rolls[-1] - TURN) < math.radians(0.5)
    assert flown.statuses[-1].effectiveness[0] < 0.2


def test_without_a_prior_the_last_trim_flies_until_each_axis_is_known() -> None:
    controller = Controller(aircraft(prior=False))
    flown = fly(controller, 4.0, models=lambda time: time > 1.0, stack=False)
    first = flown.statuses[0]
    assert first.law == "hold" and "no surface is known yet to move roll and pitch and yaw" in first.reason
    assert flown.statuses[-1].law == "indi"
    assert abs(flown.rolls[-1] - TURN) < math.radians(0.7)


@pytest.mark.parametrize(
    ("x", "delta"), [(np.zeros(8), np.zeros(4)), (np.full(9, math.nan), np.zeros(4)), (np.zeros(9), np.zeros(3))]
)
def test_a_sample_that_is_none_is_refused(x: Array, delta: Array) -> None:
    controller = Controller(aircraft())
    with pytest.raises(ControlError, match="expected"):
        controller.update(0.0, x, None, delta, PilotCommand(0.0, 0.0))
