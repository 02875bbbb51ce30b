"""The control law again on what a bag holds: the same commands, to the bit, as it gave in flight."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msls_ros.control import ControlledAircraft, Controller, ControlSettings, ModelEstimate, PilotCommand, Status
from msls_ros.offline.replay import load

Array = NDArray[np.float64]
DETECTED = 1
"""Kind of a fault event that is an alarm."""


def answer_again(
    bag: str | Path, aircraft: ControlledAircraft, settings: ControlSettings
) -> tuple[list[int], list[Array], list[Status]]:
    """Put the samples of a flight in lockstep through a controller.

    Parameters
    ----------
    bag
        With the topics state, effectors, pilot_command, model, dither and fault, names in the aircraft's order.
    aircraft, settings
        Of the controller that flew.

    Returns
    -------
    tuple
        Stamps [ns], commands (m,) [rad], and what the controller says of each.
    """
    flight = load(bag)
    topics = {name: dict(flight.topic(name)) for name in ("effectors", "pilot_command", "model", "dither")}
    alarms = {stamp for stamp, event in flight.topic("fault") if event.kind == DETECTED}
    controller = Controller(aircraft, settings)
    stamps, commands, statuses = [], [], []
    for stamp, state in flight.topic("state"):
        if any(stamp not in found for found in topics.values()):
            continue
        time = stamp * 1e-9
        effectors, asked, model, dither = (topics[name][stamp] for name in topics)
        wanted = stamp in alarms or controller.wants_model(time)
        command, status = controller.update(
            time,
            np.array(state.x),
            np.array(state.xdot) if len(state.xdot) else None,
            np.array(effectors.delta),
            _asked(asked),
            _model(time, model, stamp in alarms) if wanted else None,
            np.array(dither.delta),
        )
        stamps.append(stamp)
        commands.append(command)
        statuses.append(status)
    return stamps, commands, statuses


def _asked(message: Any) -> PilotCommand:
    stack = np.array(message.delta) if len(message.delta) else None
    return PilotCommand(message.roll_rate, message.alpha, message.pitch_rate, message.beta, stack)


def _model(time: float, message: Any, alarm: bool) -> ModelEstimate:
    n, m = len(message.states), len(message.effectors)
    a, b = (np.array(getattr(message, name)) for name in ("a", "b"))
    a_std, b_std = (np.array(getattr(message, f"{name}_std")) for name in ("a", "b"))
    return ModelEstimate(time, a.reshape(n, n), b.reshape(n, m), a_std.reshape(n, n), b_std.reshape(n, m), alarm)
