"""The one place that turns `msls_msgs` into the rooms' dataclasses and back.

Stamps are whole nanoseconds on our side. Arrays go into messages through `array.array`, the cheapest way in.
"""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

try:
    from msls_msgs.msg import (
        ControlStatus,
        DitherCommand,
        EffectorCommand,
        EffectorSample,
        FaultEvent,
        LinearModel,
        PilotCommand,
        StateSample,
    )
except ImportError as error:
    text = (
        "the message package msls_msgs is not built or not sourced: run './msls setup', or build both packages with "
        "'colcon build --base-paths . msg_defs' and source install/setup.bash"
    )
    raise ImportError(text) from error
from builtin_interfaces.msg import Time

from msls_ros import control, estimation, records

Array = NDArray[np.float64]


def stamp_of(message: Any) -> int:
    """Return the stamp of a message's header [ns]."""
    return int(message.header.stamp.sec) * 1_000_000_000 + int(message.header.stamp.nanosec)


def time_message(stamp: int) -> Time:
    """Return a stamp [ns] as a message."""
    seconds, nanoseconds = records.split_stamp(stamp)
    return Time(sec=seconds, nanosec=nanoseconds)


def doubles(values: NDArray[Any]) -> array[float]:
    """Return an array of any shape as the row-major field ``float64[]``."""
    return array("d", np.ascontiguousarray(values, dtype=np.float64).tobytes())


def _fill(message: Any, stamp: int, **fields: Any) -> Any:
    message.header.stamp = time_message(stamp)
    message.header.frame_id = records.FRAME
    for name, value in fields.items():
        setattr(message, name, _plain(value))
    return message


def _plain(value: Any) -> Any:
    """Return a field in the form that rclpy takes."""
    if not isinstance(value, np.ndarray):
        return value
    return value.ravel().tolist() if value.dtype == np.bool_ else doubles(value)


def state_message(stamp: int, states: Sequence[str], x: Array, xdot: Array) -> StateSample:
    """Return states and derivatives of one instant as a message; an empty ``xdot`` means not measured."""
    return _fill(StateSample(), stamp, states=list(states), x=x, xdot=xdot)


def effector_message(stamp: int, effectors: Sequence[str], delta: Array) -> EffectorSample:
    """Return measured deflections [rad] as a message."""
    return _fill(EffectorSample(), stamp, effectors=list(effectors), delta=delta)


def command_message(stamp: int, effectors: Sequence[str], delta: Array) -> EffectorCommand:
    """Return commanded deflections [rad] as a message."""
    return _fill(EffectorCommand(), stamp, effectors=list(effectors), delta=delta)


def dither_message(stamp: int, effectors: Sequence[str], dither: estimation.Dither) -> DitherCommand:
    """Return a dither as a message."""
    return _fill(DitherCommand(), stamp, **records.dither_fields(effectors, dither))


def fault_message(stamp: int, event: estimation.FaultEvent) -> FaultEvent:
    """Return a fault event as a message."""
    return _fill(FaultEvent(), stamp, **records.fault_fields(event))


def model_message(stamp: int, estimate: estimation.Estimate) -> LinearModel:
    """Return an estimate as a message."""
    return _fill(LinearModel(), stamp, **records.model_fields(estimate))


def pilot_command_message(stamp: int, effectors: Sequence[str], command: control.PilotCommand) -> PilotCommand:
    """Return what a pilot asks for as a message."""
    return _fill(PilotCommand(), stamp, **records.pilot_command_fields(effectors, command))


def control_status_message(stamp: int, surfaces: Sequence[str], status: control.Status) -> ControlStatus:
    """Return what a law did with a sample as a message."""
    return _fill(ControlStatus(), stamp, **records.control_status_fields(surfaces, status))


def truth_message(
    stamp: int, states: Sequence[str], effectors: Sequence[str], a: Array, b: Array, bias: Array
) -> LinearModel:
    """Return a model that is known exactly (the simulator's own) as a message."""
    n, m = len(states), len(effectors)
    return _fill(
        LinearModel(),
        stamp,
        states=list(states),
        effectors=list(effectors),
        a=a,
        b=b,
        bias=bias,
        a_std=array("d", bytes(8 * n * n)),
        b_std=array("d", bytes(8 * n * m)),
        a_known=[True] * (n * n),
        a_reliable=[True] * (n * n),
        b_reliable=[True] * (n * m),
    )


def values(field: Any) -> Array:
    """Return a ``float64[]`` field as an array (a view)."""
    return np.asarray(field, dtype=np.float64)
