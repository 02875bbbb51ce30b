"""The parameters of the identifier: declared once, with default, unit, range and meaning.

The node declares its ROS parameters from these dataclasses, the offline tools read the same YAML into them, and a wrong
value is refused here with a sentence that says what would be right. Names in a parameter file are ``section.field``
(``estimator.forgetting_factor``); fields of `Configuration` itself have no section.
"""

from __future__ import annotations

import dataclasses
import math
import numbers
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from msls_ros.estimation.errors import EstimationError, nearest
from msls_ros.estimation.kinematics import FLIGHT_STATES
from msls_ros.estimation.sections import (
    Bounds,
    DetectorParameters,
    DitherParameters,
    EstimatorParameters,
    IsolationParameters,
    RecoveryParameters,
    ReliabilityParameters,
    parameter,
)
from msls_ros.estimation.surfaces import read_surfaces

STATES = ("u", "v", "w", "P", "Q", "R", "Phi", "Theta", "Psi")
EFFECTORS = ("de", "dr", "ddt", "ddf", "dsf", "dte", "dtr")


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
        "subtract gravity (bank: and omega x v), fill in what is known of them and of Euler angles (false: as in the "
        "paper)",
        in_flight=False,
    )
    reference_speed: float = parameter(
        100.0, "speed of flight, scale of u, v and w", unit="m/s", low=1e-6, high=1e6, in_flight=False
    )
    flying_speed: float = parameter(
        0.25,
        "bank, with known_gravity: below this share of reference_speed it does not fly, nothing is learnt; 0: always",
        unit="1",
        low=0.0,
        high=1.0,
        in_flight=False,
    )
    dynamic_pressure: bool = parameter(
        True,
        "bank, with known_gravity: effects of surfaces go with the square of airspeed, those of states with it; false: "
        "none does",
        in_flight=False,
    )
    thrust_effectors: str = parameter(
        "",
        "bank: effectors that thrust makes, nozzles and the like: their effects do not go with airspeed, as 'dte, dtr'",
        in_flight=False,
    )
    time_jump: float = parameter(
        1.0, "a step back in time larger than this starts anew; a smaller one is refused", unit="s", low=0.0
    )
    pairing_tolerance: float = parameter(
        0.0,
        "largest difference between the stamps of a pair, less than half a sample period; 0: equal stamps",
        unit="s",
        low=0.0,
        in_flight=False,
    )
    estimator: EstimatorParameters = field(default_factory=EstimatorParameters)
    detector: DetectorParameters = field(default_factory=DetectorParameters)
    recovery: RecoveryParameters = field(default_factory=RecoveryParameters)
    isolation: IsolationParameters = field(default_factory=IsolationParameters)
    reliability: ReliabilityParameters = field(default_factory=ReliabilityParameters)
    dither: DitherParameters = field(default_factory=DitherParameters)

    def __post_init__(self) -> None:
        """Check every value and the lists against each other; lists become tuples, whole numbers floats."""
        _convert_all(self)
        for name, value, bounds in items(self):
            _check(name, value, bounds)
        _check_names(self)
        m = len(self.effectors)
        for name in ("weights", "actuator_bandwidth", "rate_limit", "position_low", "position_high"):
            _check_length(f"dither.{name}", getattr(self.dither, name), m, "effector")
        _check_length("detector.floor_absolute", self.detector.floor_absolute, len(self.rows), "identified equation")
        _check_length("estimator.penalty_factors", self.estimator.penalty_factors, len(self.regressors), "regressor")
        harmonics = math.floor(self.dither.multisine_high * self.dither.multisine_period) - max(
            math.ceil(self.dither.multisine_low * self.dither.multisine_period), 1
        )
        if self.dither.sequence == "multisine" and harmonics + 1 < m:
            message = (
                f"parameters 'dither.multisine_*' leave {max(harmonics + 1, 0)} harmonics for {m} effectors; a longer "
                "period or a wider band gives more"
            )
            raise EstimationError(message)
        if self.pairing_tolerance * self.sample_rate >= 0.5:
            message = (
                f"parameter 'pairing_tolerance' is {self.pairing_tolerance:g}; it must be less than half a sample "
            )
            message += f"period, {0.5 / self.sample_rate:g} s"
            raise EstimationError(message)
        read_surfaces(self.isolation.surfaces, self.effectors)
        _check_thrust(self)
        if bool(self.dither.position_low) != bool(self.dither.position_high):
            message = "dither.position_low and dither.position_high go together: give both or none"
            raise EstimationError(message)

    @property
    def known_rotation(self) -> bool:
        """Whether `kinematics.remove_rotation` is known too: for the bank; the paper's method identifies it."""
        return self.known_gravity and self.estimator.method == "bank"

    @property
    def effectors_of_thrust(self) -> tuple[str, ...]:
        """Those of `thrust_effectors`."""
        return tuple(name.strip() for name in self.thrust_effectors.split(",") if name.strip())

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

    def with_seed(self, seed: int) -> Configuration:
        """Return a copy with another seed of the dither.

        Raises
        ------
        EstimationError
            For a seed out of range.
        """
        return dataclasses.replace(self, dither=dataclasses.replace(self.dither, seed=seed))

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
    flat = flatten(values)
    known = {name: (value, bounds) for name, value, bounds in items(Configuration())}
    sections: dict[str, dict[str, Any]] = {}
    for name, value in flat.items():
        if name not in known:
            message = f"parameter '{name}' does not exist{nearest(name, known)}; there are {', '.join(sorted(known))}"
            raise EstimationError(message)
        section, _, leaf = name.rpartition(".")
        sections.setdefault(section, {})[leaf] = _convert(name, value, known[name][0])
    top = sections.pop("", {})
    whole = Configuration()
    changed = {name: dataclasses.replace(getattr(whole, name), **leaves) for name, leaves in sections.items()}
    return dataclasses.replace(whole, **top, **changed)


def flatten(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return parameters, nested or dotted, by full name."""
    flat: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, Mapping):
            flat |= {f"{name}.{inner}": one for inner, one in flatten(value).items()}
        else:
            flat[f"{name}"] = value
    return flat


def _convert_all(configuration: Configuration) -> None:
    """Bring every value into the type of its default.

    Raises
    ------
    EstimationError
        For one that has another type, and a section that is none.
    """
    for outer in dataclasses.fields(configuration):
        value = getattr(configuration, outer.name)
        if "bounds" in outer.metadata:
            found = _convert(outer.name, value, outer.default)
        else:
            section: Any = outer.default_factory  # the class itself
            if not isinstance(value, section):
                message = f"parameter '{outer.name}' is {value!r}; it must be {section.__name__}(...); nested and "
                message += "dotted names are for from_mapping({...})"
                raise EstimationError(message)
            given = {inner.name: (getattr(value, inner.name), inner.default) for inner in dataclasses.fields(value)}
            made = {name: _convert(f"{outer.name}.{name}", *pair) for name, pair in given.items()}
            found = dataclasses.replace(value, **made)
        object.__setattr__(configuration, outer.name, found)


def _convert(name: str, value: Any, default: Any) -> Any:
    """Return value in the type of default: whole numbers serve as floats, lists as tuples, numpy's types as Python's.

    Raises
    ------
    EstimationError
        For all else.
    """
    if type(value) is type(default) and not isinstance(value, tuple):
        return value
    if isinstance(default, bool) and isinstance(value, np.bool_):
        return bool(value)
    if isinstance(default, str) and isinstance(value, str):
        return str(value)
    if type(default) is int and isinstance(value, numbers.Integral) and not isinstance(value, bool):
        return int(value)
    if isinstance(default, float) and _is_number(value):
        return float(value)
    if isinstance(default, tuple) and not isinstance(value, str) and hasattr(value, "__iter__"):
        if name in ("states", "effectors"):
            if all(isinstance(v, str) for v in value):
                return tuple(str(v) for v in value)
        elif all(_is_number(v) for v in value):
            return tuple(float(v) for v in value)
    kinds = {bool: "true or false", str: "a word", int: "a whole number", float: "a number", tuple: "a list"}
    kind = kinds[type(default)]
    if name in ("states", "effectors"):
        kind = "a list of names, as ('P', 'R')"
    elif name in ("thrust_effectors", "isolation.surfaces"):
        kind = "one text, with commas between names, as 'dte, dtr'" if name[0] == "t" else "one text"
    message = f"parameter '{name}' is {value!r}; it must be {kind}"
    raise EstimationError(message)


def _is_number(value: Any) -> bool:
    return isinstance(value, numbers.Real) and not isinstance(value, bool)


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
        if not names:
            message = f"parameter '{name}' is empty; name at least one"
            raise EstimationError(message)
        if len(set(names)) != len(names) or "" in names:
            message = f"parameter '{name}' is {list(names)}; the names must differ and not be empty"
            raise EstimationError(message)
    flying = configuration.known_gravity and {"u", "v", "w"} & set(configuration.states)
    flight = {name.lower(): name for name in FLIGHT_STATES}
    for state in configuration.states if flying else ():
        name = flight.get(state.lower(), state)
        if name != state:
            message = (
                f"parameter 'states' names '{state}' beside a velocity, and nothing is known of a state of that name: "
                f"write '{name}' if it is that one, or known_gravity: false if it is another"
            )
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
            f"known_gravity with the state '{min(needs)}' needs Phi and Theta among the states (Phi may be zero in "
            "level flight), or known_gravity: false"
        )
        raise EstimationError(message)


def _check_thrust(configuration: Configuration) -> None:
    for name in configuration.effectors_of_thrust:
        if name not in configuration.effectors:
            message = f"parameter 'thrust_effectors' names '{name}'{nearest(name, configuration.effectors)}; effectors "
            raise EstimationError(message + f"are {', '.join(configuration.effectors)}")


def _check_length(name: str, value: tuple[float, ...], length: int, what: str) -> None:
    if value and len(value) != length:
        message = f"parameter '{name}' has {len(value)} values; it must have one per {what}, {length}, or none"
        raise EstimationError(message)
