"""What each of the identifier's messages holds, field by field: one list for the node and for the bag writer.

Neither ROS nor a bag is needed here: `messages` puts these fields into `msls_msgs`, `offline.outputs` into CDR.
Arrays keep their shape; both sides write them row-major.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from msls_ros.control import PilotCommand, Status
from msls_ros.estimation import Dither, Estimate, FaultEvent

FRAME = "base_link_frd"
Fields = Mapping[str, Any]

DITHER_NUMBERS = ("delta", "rms", "predicted_acceleration", "acceleration_limit", "level")
"""Fields of a dither that are numbers; they have the same names in `Dither`, `DitherBlock` and the message."""
_MODEL_NAMES = ("states", "effectors", "regressors")
MODEL_NUMBERS = (
    "a",
    "b",
    "bias",
    "a_std",
    "b_std",
    "a_known",
    "a_reliable",
    "b_reliable",
    "a_best",
    "b_best",
    "a_best_std",
    "b_best_std",
    "a_best_time",
    "b_best_time",
    "excitation",
    "residual_std",
    "forgetting_factor",
    "delay",
    "delay_std",
    "lag",
    "state_delay",
    "samples",
)
"""Fields of a model that change from one to the next; they have the same names in `Estimate` and the message."""


def split_stamp(stamp: int) -> tuple[int, int]:
    """Return a stamp [ns] as seconds and nanoseconds."""
    return divmod(stamp, 1_000_000_000)


def header_fields(stamp: int) -> Fields:
    """Return the header of a stamp [ns]."""
    seconds, nanoseconds = split_stamp(stamp)
    return {"stamp": {"sec": seconds, "nanosec": nanoseconds}, "frame_id": FRAME}


def dither_fields(effectors: Sequence[str], dither: Dither) -> Fields:
    """Return the fields of a `DitherCommand` but its header."""
    numbers = {name: getattr(dither, name) for name in DITHER_NUMBERS}
    return {"effectors": list(effectors), **numbers, "level": int(dither.level), "reason": dither.reason}


def fault_fields(event: FaultEvent) -> Fields:
    """Return the fields of a `FaultEvent` but its header."""
    return {
        "kind": int(event.kind),
        "equations": list(event.equations),
        "statistic": np.array(event.statistic, dtype=np.float64),
        "threshold": np.array(event.threshold, dtype=np.float64),
        "suspected_effector": event.suspected_effector,
        "effectiveness": event.effectiveness,
        "effectiveness_std": event.effectiveness_std,
        "description": event.description,
    }


def model_fields(estimate: Estimate) -> Fields:
    """Return the fields of a `LinearModel` but its header."""
    names = {name: list(getattr(estimate, name)) for name in _MODEL_NAMES}
    return {**names, **{name: getattr(estimate, name) for name in MODEL_NUMBERS}}


def pilot_command_fields(effectors: Sequence[str], command: PilotCommand) -> Fields:
    """Return the fields of a `PilotCommand` but its header."""
    known = command.stack is not None
    return {
        "roll_rate": float(command.roll_rate),
        "alpha": float(command.alpha),
        "pitch_rate": float(command.pitch_rate),
        "beta": float(command.beta),
        "effectors": list(effectors) if known else [],
        "delta": np.zeros(0) if command.stack is None else command.stack,
    }


def control_status_fields(surfaces: Sequence[str], status: Status) -> Fields:
    """Return the fields of a `ControlStatus` but its header."""
    names = ("effectiveness", "effectiveness_std", "stuck", "saturated", "wanted", "unmet")
    return {
        "law": status.law,
        "reason": status.reason,
        "design_age": float(status.design_age),
        "surfaces": list(surfaces),
        **{name: getattr(status, name) for name in names},
        "gain_margin": float(status.margins.gain),
        "gain_reduction": float(status.margins.reduction),
        "phase_margin": float(status.margins.phase),
        "delay_margin": float(status.margins.delay),
        "handover": float(status.handover),
    }
