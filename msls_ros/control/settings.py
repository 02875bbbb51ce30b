"""The parameters of the control laws, with default, unit, range and meaning of each."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from msls_ros.control.errors import ControlError
from msls_ros.estimation.sections import Bounds, parameter

LAWS = ("fixed", "indi", "lq", "auto")
SOURCES = ("surface", "entry", "raw", "frozen")


@dataclass(frozen=True)
class ControlSettings:
    """All parameters of a `Controller`.

    Raises
    ------
    ControlError
        At construction, for a value of the wrong type or out of range.
    """

    law: str = parameter(
        "auto",
        "the law that flies: fixed (the stack's own), indi, lq, or auto (indi, and what is left of it when something "
        "is missing)",
        choices=LAWS,
    )
    stack: bool = parameter(
        True, "where a law cannot fly, the stack's own command does, if there is one; false: the last trim"
    )
    model: str = parameter(
        "surface",
        "what of the identified B is believed: surface (an effectiveness of each surface, on the prior), entry (each "
        "number for itself; always so without a prior, and of the law lq), raw (the estimate as it is), frozen (prior)",
        choices=SOURCES,
        in_flight=False,
    )
    roll_gain: float = parameter(2.5, "roll acceleration per error of the roll rate", unit="1/s", low=0.1, high=20.0)
    roll_lag: float = parameter(0.5, "lag of the roll rate's reference", unit="s", low=0.0, high=5.0)
    alpha_gain: float = parameter(1.0, "rate of angle of attack per its error", unit="1/s", low=0.05, high=10.0)
    pitch_gain: float = parameter(2.5, "pitch acceleration per error of that rate", unit="1/s", low=0.1, high=20.0)
    pitch_gain_power: float = parameter(
        0.2,
        "alpha_gain and pitch_gain are multiplied with the share of the pitching power of all surfaces that is left, "
        "to this power",
        low=0.0,
        high=1.0,
    )
    beta_gain: float = parameter(0.8, "rate of sideslip per its error", unit="1/s", low=0.0, high=10.0)
    yaw_gain: float = parameter(2.5, "yaw acceleration per error of that rate", unit="1/s", low=0.1, high=20.0)
    weights: tuple[float, ...] = parameter(
        (1.0, 2.0, 1.0), "of roll, pitch and yaw acceleration where not all can be had", low=0.01, high=100.0
    )
    filter_bandwidth: float = parameter(
        25.0, "corner of the one filter of accelerations and positions", unit="rad/s", low=1.0, high=500.0
    )
    largest_step: float = parameter(
        3.0, "largest change of acceleration asked for in a sample", unit="rad/s^2", low=0.01, high=100.0
    )
    price: float = parameter(
        5e-4, "of deflection from the trim, relative to the largest control power", low=1e-8, high=1.0
    )
    caution: float = parameter(0.1, "price of moving a surface in proportion to its variance", low=0.0, high=100.0)
    prior_std: float = parameter(0.1, "standard error of the prior's effectiveness", low=0.0, high=10.0)
    drift: float = parameter(0.2, "of the effectiveness", unit="1/sqrt(s)", low=0.0, high=10.0)
    floor: float = parameter(0.03, "least standard error of an estimate, relative to its size", low=1e-6, high=1.0)
    alarm_inflation: float = parameter(0.7, "standard error of the effectiveness after an alarm", low=0.0, high=10.0)
    alarm_watch: float = parameter(1.0, "time after an alarm with faster redesign", unit="s", low=0.0, high=60.0)
    alarm_correlation: float = parameter(
        4.0, "factor on the variance of estimates in that time, for they follow each other closely", low=1.0, high=100.0
    )
    redesign_rate: float = parameter(10.0, "redesigns", unit="Hz", low=0.1, high=1000.0)
    alarm_redesign_rate: float = parameter(25.0, "redesigns after an alarm", unit="Hz", low=0.1, high=1000.0)
    model_timeout: float = parameter(
        0.5, "age of the model after which the last believed one is said to fly", unit="s", low=0.01, high=3600.0
    )
    sample_timeout: float = parameter(
        0.2,
        "gap between samples after which the last trim flies and filters begin anew",
        unit="s",
        low=0.001,
        high=60.0,
    )
    handover_time: float = parameter(0.3, "over which a new law takes over", unit="s", low=0.0, high=10.0)
    knowledge: float = parameter(
        3.0,
        "without a prior: an axis is known when a surface's effect is this many standard errors",
        low=1.0,
        high=50.0,
    )
    stuck_monitor: bool = parameter(True, "watch for actuators that do not follow")
    stuck_offset: float = parameter(
        math.radians(1.0), "distance from the modelled actuator that is none", unit="rad", low=1e-4, high=1.0
    )
    stuck_samples: int = parameter(10, "consecutive samples beyond it", unit="samples", low=1, high=1000)
    rejection: float = parameter(
        4.0, "the believed B is dropped when it errs this much more than the prior (squares); 0: never", low=0.0
    )
    lq_rate_price: float = parameter(0.005, "lq: of surface rate, over the squared control power", low=1e-8, high=10.0)
    lq_deflection_price: float = parameter(
        0.05, "lq: of deflection that makes no moment, over the squared control power", low=0.0, high=10.0
    )
    lq_errors: tuple[float, ...] = parameter(
        (6.0, 4.0, 8.0), "lq: price of the squared errors of angle of attack, sideslip, roll rate", low=0.0, high=1e4
    )
    lq_rates: tuple[float, ...] = parameter(
        (1.0, 1.0, 1.0, 1.0, 1.0), "lq: of the squared derivatives of alpha Q beta P R", low=0.0, high=1e4
    )

    def __post_init__(self) -> None:
        """Refuse what is out of range."""
        for name, value, bounds in items(self):
            _check(name, value, bounds)
        for name, length in (("weights", 3), ("lq_errors", 3), ("lq_rates", 5)):
            if len(getattr(self, name)) != length:
                message = f"control parameter '{name}' has {len(getattr(self, name))} values; expected {length}"
                raise ControlError(message)

    def changed(self, changes: Mapping[str, Any]) -> ControlSettings:
        """Return a copy with other values by name.

        Raises
        ------
        ControlError
            For a name that does not exist, or a value that is refused.
        """
        known = {field.name: field.default for field in dataclasses.fields(self)}
        fitted = {}
        for name, value in changes.items():
            if name not in known:
                message = f"control parameter '{name}' does not exist; expected one of {', '.join(known)}"
                raise ControlError(message)
            fitted[name] = _fit(value, known[name])
        return dataclasses.replace(self, **fitted)


def items(settings: ControlSettings) -> Iterator[tuple[str, Any, Bounds]]:
    """Yield name, value and bounds of each parameter."""
    for field in dataclasses.fields(settings):
        yield field.name, getattr(settings, field.name), field.metadata["bounds"]


def _fit(value: Any, like: Any) -> Any:
    if isinstance(like, float) and type(value) is int:
        return float(value)
    if isinstance(like, tuple) and isinstance(value, (list, tuple)):
        return tuple(float(one) if type(one) is int else one for one in value)
    return value


def _check(name: str, value: Any, bounds: Bounds) -> None:
    default = next(one for one in dataclasses.fields(ControlSettings) if one.name == name).default
    if type(value) is not type(default):
        message = f"control parameter '{name}' is {value!r}; expected a value such as {default!r}"
        raise ControlError(message)
    if isinstance(value, str):
        if value not in bounds.choices:
            message = f"control parameter '{name}' is {value!r}; expected one of {', '.join(bounds.choices)}"
            raise ControlError(message)
        return
    for one in value if isinstance(value, tuple) else (value,):
        number = isinstance(one, (int, float)) and math.isfinite(one)
        if not number or not bounds.low <= one <= bounds.high:
            unit = "" if bounds.unit == "1" else f" {bounds.unit}"
            message = f"control parameter '{name}' is {value!r}; expected {bounds.low:g} to {bounds.high:g}{unit}"
            raise ControlError(message)
