"""The parameters of the identifier: declared once, with default, unit, range and meaning.

The node declares its ROS parameters from these dataclasses, the offline tools read the same YAML into them, and a wrong
value is refused here with a sentence that says what would be right. Names in a parameter file are ``section.field``
(``estimator.forgetting_factor``); fields of `Configuration` itself have no section.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from msls_ros.estimation.errors import EstimationError


@dataclass(frozen=True)
class Bounds:
    """What is allowed of a parameter, and what it means."""

    description: str
    unit: str
    low: float
    high: float
    choices: tuple[str, ...]
    in_flight: bool
    """May change while the estimator runs without losing what it has learnt."""


def parameter(
    default: Any,
    description: str,
    *,
    unit: str = "1",
    low: float = -math.inf,
    high: float = math.inf,
    choices: tuple[str, ...] = (),
    in_flight: bool = True,
) -> Any:
    """Declare a parameter as a dataclass field.

    Parameters
    ----------
    default
        Its value where none is given; its type is the parameter's type.
    description, unit
        For people.
    low, high
        Inclusive range of the number, or of each number of a list.
    choices
        Allowed words.
    in_flight
        Whether it may change while the estimator runs.
    """
    return field(default=default, metadata={"bounds": Bounds(description, unit, low, high, choices, in_flight)})


STATES = ("u", "v", "w", "P", "Q", "R", "Phi", "Theta", "Psi")
EFFECTORS = ("de", "dr", "ddt", "ddf", "dsf", "dte", "dtr")


@dataclass(frozen=True)
class EstimatorParameters:
    """The recursive estimator (eqs 6-14)."""

    method: str = parameter(
        "msls", "estimator: msls (the paper's) or rls (to compare)", choices=("msls", "rls"), in_flight=False
    )
    forgetting_factor: float = parameter(0.9, "lambda, per sample; R is scaled by its square root", low=0.01, high=1.0)
    time_constant: float = parameter(
        0.0,
        "instead of forgetting_factor: lambda = exp(-1/(time_constant*sample_rate)); 0: not used",
        unit="s",
        low=0.0,
        high=1e6,
    )
    penalty: float = parameter(1e-3, "w of W0 = w*scale: penalty on parameter change", low=0.0, high=1e3)
    penalty_constant: float = parameter(
        0.0, "w of the constant term, smaller lets it forget faster than the rest; 0: as penalty", low=0.0, high=1e3
    )
    penalty_retained: bool = parameter(
        True, "true: penalty rows stay in the factor (literal eq 14); false: applied at the solve only"
    )
    scale: str = parameter(
        "configured",
        "scale of each regressor: configured (reference_speed for u, v, w; 1 for the rest) or auto (slow rms)",
        choices=("configured", "auto"),
    )
    penalty_factors: tuple[float, ...] = parameter(
        (), "multiplies the penalty per regressor (states, effectors, 1); empty: all 1", low=0.0, high=1e6
    )
    rms_memory: float = parameter(
        500.0, "memory of the slow rms of regressors and outputs", unit="samples", low=1.0, high=1e9
    )


@dataclass(frozen=True)
class DetectorParameters:
    """Abrupt-change detection (eqs 18-19)."""

    mode: str = parameter(
        "normalised",
        "statistic: off; paper (|e|, eqs 18-19); normalised (|e|/sqrt(1+d)); ratio (mean of short over mean of window)",
        choices=("off", "paper", "normalised", "ratio"),
        in_flight=False,
    )
    window: int = parameter(
        10, "N: errors averaged as the nominal value", unit="samples", low=2, high=10000, in_flight=False
    )
    short: int = parameter(5, "ratio mode: newest errors averaged", unit="samples", low=1, high=1000, in_flight=False)
    threshold: float = parameter(
        7.0, "T: per-unit increase (paper, normalised) or ratio (ratio) that alarms", low=0.1, high=1e6
    )
    hold_off: int = parameter(
        20, "samples after an alarm or a start that the window does not see", unit="samples", low=0, high=100000
    )
    floor_absolute: tuple[float, ...] = parameter(
        (), "smallest error worth an alarm, per equation; empty: 0", unit="state per second", low=0.0
    )
    floor_relative: float = parameter(0.4, "the same as a share of the slow rms of the output", low=0.0, high=100.0)
    floor_model: float = parameter(0.01, "the same as a share of sum |theta_i phi_i|", low=0.0, high=100.0)


@dataclass(frozen=True)
class RecoveryParameters:
    """What an alarm does to the equations concerned."""

    penalty_factor: float = parameter(
        0.1, "multiplies W0 for 2p samples after an alarm, then ramps back", low=1e-6, high=1.0
    )
    forgetting_factor: float = parameter(
        0.0, "lambda for 2p samples after an alarm; 0: unchanged (better)", low=0.0, high=1.0
    )
    at_start: bool = parameter(True, "lower the penalty after the start too, while nothing is known")
    rejoin_tolerance: float = parameter(
        1e-9, "forgotten share at which the equation rejoins the shared factor", low=1e-15, high=0.5
    )


@dataclass(frozen=True)
class IsolationParameters:
    """When a change is attributed to one effector or state."""

    significance: float = parameter(
        4.0, "least deviation of the column that changed", unit="sigma", low=0.0, high=100.0
    )
    explained: float = parameter(0.7, "least share of the change that the changed columns explain", low=0.0, high=1.0)
    largest_error: float = parameter(0.08, "largest standard error of the effectiveness", low=0.0, high=10.0)
    least_samples: int = parameter(
        5, "samples, beyond one per regressor, before anything is said", unit="samples", low=1, high=10000
    )
    window: float = parameter(2.0, "time after the alarm in which it is tried", unit="s", low=0.0, high=3600.0)


@dataclass(frozen=True)
class ReliabilityParameters:
    """When a number is published as reliable."""

    excitation: float = parameter(
        0.8, "least excitation rho: share of the parameter that the data decide", low=0.0, high=1.0
    )
    relative_error: float = parameter(0.3, "largest standard error as a share of the estimate", low=0.0, high=100.0)
    tolerance: float = parameter(
        0.0, "standard error that is always good enough, output per scale of the regressor", low=0.0
    )
    coloured: bool = parameter(True, "correct the error bars for the autocorrelation of the residuals", in_flight=False)
    residual_memory: float = parameter(50.0, "memory of the residual variance", unit="samples", low=2.0, high=1e9)
    colour_memory: float = parameter(500.0, "memory of the residual autocorrelation", unit="samples", low=2.0, high=1e9)


@dataclass(frozen=True)
class DitherParameters:
    """Active noise injection (eqs 20-23)."""

    enabled: bool = parameter(True, "inject noise into the effectors")
    seed: int = parameter(0, "seed of the random sequences", low=0, high=2**31 - 1, in_flight=False)
    limit_nominal: float = parameter(
        0.012, "predicted rms acceleration at the pilot, every day", unit="g", low=0.0, high=0.05
    )
    limit_boosted: float = parameter(
        0.04, "the same after an alarm; MIL-F-8785C allows 0.05", unit="g", low=0.0, high=0.05
    )
    boost_duration: float = parameter(1.0, "how long after an alarm", unit="s", low=0.0, high=60.0)
    pilot_forward: float = parameter(3.6576, "l1: pilot ahead of the centre of mass", unit="m", low=-100.0, high=100.0)
    pilot_above: float = parameter(0.841248, "l2: pilot above the centre of mass", unit="m", low=-100.0, high=100.0)
    weights: tuple[float, ...] = parameter(
        (), "share of the common rms per effector; empty: all 1", low=0.0, high=100.0
    )
    bandwidth: float = parameter(
        0.0, "corner of the random sequences; 0: white at the sample rate", unit="Hz", low=0.0, high=1e4
    )
    cap: float = parameter(0.0175, "largest rms per effector, whatever B says", unit="rad", low=0.0, high=0.5)
    cap_unreliable: float = parameter(
        0.0045, "the same while an effector's column is not excited", unit="rad", low=0.0, high=0.5
    )
    actuator_bandwidth: tuple[float, ...] = parameter(
        (),
        "first-order corner per effector, to reach the rms at the surface; empty: no actuator",
        unit="rad/s",
        low=1e-3,
        high=1e6,
    )
    rate_limit: tuple[float, ...] = parameter((), "per effector; empty: none", unit="rad/s", low=0.0)
    position_low: tuple[float, ...] = parameter((), "lowest deflection per effector; empty: none", unit="rad")
    position_high: tuple[float, ...] = parameter((), "highest deflection per effector; empty: none", unit="rad")
    stale_after: float = parameter(
        0.1, "gap between samples after which the dither is zero", unit="s", low=0.0, high=60.0
    )


@dataclass(frozen=True)
class Configuration:
    """All parameters of an identifier.

    Raises
    ------
    EstimationError
        At construction, for a value out of range or lists that do not fit each other.
    """

    states: tuple[str, ...] = parameter(STATES, "names of the states, in the order of x", in_flight=False)
    effectors: tuple[str, ...] = parameter(EFFECTORS, "names of the effectors, in the order of delta", in_flight=False)
    sample_rate: float = parameter(50.0, "nominal rate of the samples", unit="Hz", low=0.01, high=1e5, in_flight=False)
    known_gravity: bool = parameter(
        True,
        "subtract gravity, fill in what is known of gravity and Euler angles (false: identify it as in the paper)",
        in_flight=False,
    )
    reference_speed: float = parameter(100.0, "scale of u, v and w", unit="m/s", low=1e-6, high=1e6, in_flight=False)
    time_jump: float = parameter(
        1.0, "a step back in time larger than this starts anew; a smaller one is refused", unit="s", low=0.0
    )
    estimator: EstimatorParameters = EstimatorParameters()
    detector: DetectorParameters = DetectorParameters()
    recovery: RecoveryParameters = RecoveryParameters()
    isolation: IsolationParameters = IsolationParameters()
    reliability: ReliabilityParameters = ReliabilityParameters()
    dither: DitherParameters = DitherParameters()

    def __post_init__(self) -> None:
        """Check every value and the lists against each other."""
        for name, value, bounds in items(self):
            _check(name, value, bounds)
        _check_names(self)
        m = len(self.effectors)
        for name in ("weights", "actuator_bandwidth", "rate_limit", "position_low", "position_high"):
            _check_length(f"dither.{name}", getattr(self.dither, name), m, "effector")
        _check_length("detector.floor_absolute", self.detector.floor_absolute, len(self.rows), "identified equation")
        _check_length("estimator.penalty_factors", self.estimator.penalty_factors, len(self.regressors), "regressor")
        if bool(self.dither.position_low) != bool(self.dither.position_high):
            message = "dither.position_low and dither.position_high go together: give both or none"
            raise EstimationError(message)

    @property
    def rows(self) -> tuple[str, ...]:
        """States whose derivative equation is identified."""
        return tuple(s for s in self.states if not (self.known_gravity and s in ("Phi", "Theta", "Psi")))

    @property
    def regressors(self) -> tuple[str, ...]:
        """What is identified in each row: states, effectors, and the constant ``1``."""
        return (*self.rows, *self.effectors, "1")

    @property
    def forgetting(self) -> float:
        """Forgetting factor per sample, from `time_constant` where it is given."""
        if self.estimator.time_constant > 0.0:
            return math.exp(-1.0 / (self.estimator.time_constant * self.sample_rate))
        return self.estimator.forgetting_factor

    def replace(self, changes: Mapping[str, Any]) -> Configuration:
        """Return a copy with some parameters changed, by their full names.

        Raises
        ------
        EstimationError
            For a name that does not exist or a value that is refused.
        """
        return from_mapping({**as_mapping(self), **changes})


def items(configuration: Configuration) -> Iterator[tuple[str, Any, Bounds]]:
    """Yield name, value and bounds of every parameter."""
    for outer in dataclasses.fields(configuration):
        value = getattr(configuration, outer.name)
        if "bounds" in outer.metadata:
            yield outer.name, value, outer.metadata["bounds"]
            continue
        for inner in dataclasses.fields(value):
            yield f"{outer.name}.{inner.name}", getattr(value, inner.name), inner.metadata["bounds"]


def as_mapping(configuration: Configuration) -> dict[str, Any]:
    """Return all parameters by full name."""
    return {name: value for name, value, _ in items(configuration)}


def from_mapping(values: Mapping[str, Any]) -> Configuration:
    """Build a configuration from parameters by full name, nested or dotted; what is absent has its default.

    Raises
    ------
    EstimationError
        For a name that does not exist, a value of the wrong type or out of range.
    """
    flat = dict(_flatten(values))
    known = {name: (value, bounds) for name, value, bounds in items(Configuration())}
    sections: dict[str, dict[str, Any]] = {}
    for name, value in flat.items():
        if name not in known:
            message = f"parameter '{name}' does not exist; there are {', '.join(sorted(known))}"
            raise EstimationError(message)
        section, _, leaf = name.rpartition(".")
        sections.setdefault(section, {})[leaf] = _convert(name, value, known[name][0])
    top = sections.pop("", {})
    types: dict[str, Any] = {f.name: f.default for f in dataclasses.fields(Configuration) if "bounds" not in f.metadata}
    return Configuration(
        **top, **{name: dataclasses.replace(types[name], **leaves) for name, leaves in sections.items()}
    )


def _flatten(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from _flatten(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


def _convert(name: str, value: Any, default: Any) -> Any:
    """Return value in the type of default: whole numbers serve as floats, lists as tuples; nothing else is bent."""
    if type(value) is type(default) and not isinstance(value, tuple):
        return value
    if isinstance(default, float) and _is_number(value):
        return float(value)
    if isinstance(default, tuple) and not isinstance(value, str) and hasattr(value, "__iter__"):
        if name in ("states", "effectors"):
            if all(isinstance(v, str) for v in value):
                return tuple(value)
        elif all(_is_number(v) for v in value):
            return tuple(float(v) for v in value)
    kinds = {bool: "true or false", str: "a word", int: "a whole number", float: "a number", tuple: "a list"}
    message = f"parameter '{name}' is {value!r}; it must be {kinds[type(default)]}"
    raise EstimationError(message)


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _check(name: str, value: Any, bounds: Bounds) -> None:
    if bounds.choices and value not in bounds.choices:
        message = f"parameter '{name}' is '{value}'; it must be one of {', '.join(bounds.choices)}"
        raise EstimationError(message)
    for number in value if isinstance(value, tuple) else (value,):
        if isinstance(number, (bool, str)):
            continue
        if not (math.isfinite(number) and bounds.low <= number <= bounds.high):
            message = f"parameter '{name}' is {number:g}; it must be in [{bounds.low:g}, {bounds.high:g}] {bounds.unit}"
            raise EstimationError(message)


def _check_names(configuration: Configuration) -> None:
    for name in ("states", "effectors"):
        names = getattr(configuration, name)
        if len(set(names)) != len(names) or "" in names:
            message = f"parameter '{name}' is {list(names)}; the names must differ and not be empty"
            raise EstimationError(message)
    both = set(configuration.states) & set(configuration.effectors) | (
        {"1"} & {*configuration.states, *configuration.effectors}
    )
    if both:
        message = (
            f"'{min(both)}' cannot be a name of both: states, effectors and the constant '1' need names of their own"
        )
        raise EstimationError(message)
    if not configuration.rows:
        message = (
            "parameter 'states' leaves no equation to identify; with known_gravity, Phi, Theta and Psi are known ones"
        )
        raise EstimationError(message)
    needs = {"u", "v", "w"} & set(configuration.states)
    if configuration.known_gravity and needs and not {"Phi", "Theta"} <= set(configuration.states):
        message = (
            f"known_gravity with the state '{min(needs)}' needs Phi and Theta among the states, or known_gravity: false"
        )
        raise EstimationError(message)


def _check_length(name: str, value: tuple[float, ...], length: int, what: str) -> None:
    if value and len(value) != length:
        message = f"parameter '{name}' has {len(value)} values; it must have one per {what}, {length}, or none"
        raise EstimationError(message)
