"""The sections of the identifier's parameters: default, unit, range and meaning of each; `configuration` joins them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any


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


@dataclass(frozen=True)
class EstimatorParameters:
    """The recursive estimator (eqs 6-14)."""

    method: str = parameter(
        "bank",
        "estimator: bank (of memories, nothing to tune), msls (the paper's) or rls (to compare)",
        choices=("bank", "msls", "rls"),
        in_flight=False,
    )
    memories: tuple[float, ...] = parameter(
        (0.1, 0.4), "bank: memories that forget with time", unit="s", low=1e-3, high=1e4, in_flight=False
    )
    held_memories: tuple[float, ...] = parameter(
        (1.5, 5.0, 30.0), "bank: memories that forget with excitation", unit="s", low=1e-3, high=1e5, in_flight=False
    )
    forgetting_factor: float = parameter(
        0.9, "msls, rls: lambda, per sample; R is scaled by its square root", low=0.01, high=1.0
    )
    time_constant: float = parameter(
        0.0,
        "msls, rls: instead of forgetting_factor: lambda = exp(-1/(time_constant*sample_rate)); 0: not used",
        unit="s",
        low=0.0,
        high=1e6,
    )
    penalty: float = parameter(1e-3, "msls: w of W0 = w*scale: penalty on parameter change", low=0.0, high=1e3)
    penalty_constant: float = parameter(
        0.0,
        "msls: w of the constant term, smaller lets it forget faster than the rest; 0: as penalty",
        low=0.0,
        high=1e3,
    )
    penalty_retained: bool = parameter(
        True, "msls: true: penalty rows stay in the factor (literal eq 14); false: applied at the solve only"
    )
    scale: str = parameter(
        "configured",
        "msls: scale of each regressor: configured (reference_speed for u, v, w; 1 for the rest) or auto (slow rms)",
        choices=("configured", "auto"),
    )
    penalty_factors: tuple[float, ...] = parameter(
        (), "msls: multiplies the penalty per regressor (states, effectors, 1); empty: all 1", low=0.0, high=1e6
    )
    rms_memory: float = parameter(
        500.0, "msls: memory of the slow rms of regressors and outputs", unit="samples", low=1.0, high=1e9
    )


@dataclass(frozen=True)
class DetectorParameters:
    """Abrupt-change detection (eqs 18-19)."""

    mode: str = parameter(
        "normalised",
        "off; of msls the statistic: paper (|e|, eqs 18-19); normalised (|e|/sqrt(1+d)); ratio (mean of short over "
        "mean of window)",
        choices=("off", "paper", "normalised", "ratio"),
        in_flight=False,
    )
    window: int = parameter(
        10, "msls: N: errors averaged as the nominal value", unit="samples", low=2, high=10000, in_flight=False
    )
    short: int = parameter(
        5, "msls: ratio mode: newest errors averaged", unit="samples", low=1, high=1000, in_flight=False
    )
    threshold: float = parameter(
        7.0, "msls: T: per-unit increase (paper, normalised) or ratio (ratio) that alarms", low=0.1, high=1e6
    )
    hold_off: int = parameter(
        20, "msls: samples after an alarm or a start that the window does not see", unit="samples", low=0, high=100000
    )
    floor_absolute: tuple[float, ...] = parameter(
        (), "msls: smallest error worth an alarm, per equation; empty: 0", unit="state per second", low=0.0
    )
    floor_relative: float = parameter(
        0.4, "msls: the same as a share of the slow rms of the output", low=0.0, high=100.0
    )
    floor_model: float = parameter(0.01, "msls: the same as a share of sum |theta_i phi_i|", low=0.0, high=100.0)


@dataclass(frozen=True)
class RecoveryParameters:
    """What an alarm does to the equations concerned."""

    penalty_factor: float = parameter(
        0.1, "msls: multiplies W0 for 2p samples after an alarm, then ramps back", low=1e-6, high=1.0
    )
    forgetting_factor: float = parameter(
        0.0, "msls: lambda for 2p samples after an alarm; 0: unchanged (better)", low=0.0, high=1.0
    )
    at_start: bool = parameter(True, "msls: lower the penalty after the start too, while nothing is known")
    rejoin_tolerance: float = parameter(
        1e-9, "msls: forgotten share at which the equation rejoins the shared factor", low=1e-15, high=0.5
    )


@dataclass(frozen=True)
class IsolationParameters:
    """When a change is attributed to one effector or state."""

    significance: float = parameter(
        4.0, "least deviation of the column that changed", unit="sigma", low=0.0, high=100.0
    )
    explained: float = parameter(
        0.7, "msls: least share of the change that the changed columns explain", low=0.0, high=1.0
    )
    largest_error: float = parameter(0.08, "msls: largest standard error of the effectiveness", low=0.0, high=10.0)
    least_samples: int = parameter(
        5, "samples, beyond one per regressor, before anything is said", unit="samples", low=1, high=10000
    )
    window: float = parameter(
        8.0,
        "time after the alarm in which it is tried; bank: in which inputs show what is left of all that may be lost, "
        "within 60 s or this, if it is longer",
        unit="s",
        low=0.0,
        high=3600.0,
    )
    surfaces: str = parameter(
        "",
        "bank: position of each surface as a sum of effectors, as 'left: de + ddt; right: de - ddt'; a change is named "
        "by surface then; empty: by effector",
        in_flight=False,
    )


@dataclass(frozen=True)
class ReliabilityParameters:
    """When a number is published as reliable."""

    excitation: float = parameter(
        0.8, "msls: least excitation rho: share of the parameter that the data decide", low=0.0, high=1.0
    )
    relative_error: float = parameter(
        0.3,
        "largest standard error as a share of the estimate; bank: or of what an effect was when last known to a fifth",
        low=0.0,
        high=100.0,
    )
    tolerance: float = parameter(
        0.0, "standard error that is always good enough, output per scale of the regressor", low=0.0
    )
    coloured: bool = parameter(
        True, "msls: correct the error bars for the autocorrelation of the residuals", in_flight=False
    )
    residual_memory: float = parameter(50.0, "msls: memory of the residual variance", unit="samples", low=2.0, high=1e9)
    colour_memory: float = parameter(
        500.0, "msls: memory of the residual autocorrelation", unit="samples", low=2.0, high=1e9
    )
    confounding_states: float = parameter(
        1.0,
        "msls: in gusts: largest correlation with a state of what the model does not know; 0: gusts are not considered",
        low=0.0,
        high=1.0,
    )
    confounding_effectors: float = parameter(0.8, "the same with an effector", low=0.0, high=1.0)
    reference_memory: float = parameter(
        6.0, "msls: memory of the reference model that shows it, in memories of the estimator", low=1.0, high=1e6
    )
    air_memory: float = parameter(
        150.0, "msls: memory of the share of the motion that is the air's", unit="samples", low=2.0, high=1e9
    )


@dataclass(frozen=True)
class DitherParameters:
    """Active noise injection (eqs 20-23)."""

    enabled: bool = parameter(True, "inject noise into the effectors")
    seed: int = parameter(0, "seed of the random sequences", low=0, high=2**31 - 1, in_flight=False)
    limit_nominal: float = parameter(
        0.012, "predicted rms acceleration at the pilot, nominal level", unit="g", low=0.0, high=0.05
    )
    limit_boosted: float = parameter(
        0.04, "the same after an alarm; MIL-F-8785C allows 0.05", unit="g", low=0.0, high=0.05
    )
    acceleration: str = parameter(
        "rms",
        "what the limit is held against: rms (independent sequences add their squares) or worst_case (eq 23, literal: "
        "one common rms, three times less dither)",
        choices=("rms", "worst_case"),
    )
    allocation: str = parameter(
        "information",
        "shares of the effectors: information (equal shares of the square: most information about B) or equal (rms)",
        choices=("information", "equal"),
    )
    target_error: float = parameter(
        0.0,
        "relative standard error of its largest entry to which an effector need be known: its share goes down when it "
        "is known better; 0: all that the limit allows",
        low=0.0,
        high=10.0,
    )
    boost_duration: float = parameter(1.0, "how long after an alarm", unit="s", low=0.0, high=60.0)
    boost_budget: float = parameter(
        10.0, "boost in any minute at most, whatever alarms come", unit="s", low=0.0, high=60.0
    )
    pilot_forward: float = parameter(
        3.6576, "l1: pilot (or payload) ahead of the centre of mass", unit="m", low=-100.0, high=100.0
    )
    pilot_above: float = parameter(0.841248, "l2: above the centre of mass", unit="m", low=-100.0, high=100.0)
    pilot_right: float = parameter(0.0, "to the right of the centre of mass", unit="m", low=-100.0, high=100.0)
    activity_nominal: float = parameter(
        0.0,
        "largest rms rate of a surface by the dither, nominal level; 0: not limited. For aircraft without a pilot",
        unit="rad/s",
        low=0.0,
        high=10.0,
    )
    activity_boosted: float = parameter(0.0, "the same after an alarm", unit="rad/s", low=0.0, high=10.0)
    weights: tuple[float, ...] = parameter(
        (), "multiplies the share of each effector; empty: all 1", low=0.0, high=100.0
    )
    sequence: str = parameter(
        "white",
        "white (uniform noise, see bandwidth) or multisine (orthogonal, phases for a low peak)",
        choices=("white", "multisine"),
        in_flight=False,
    )
    bandwidth: float = parameter(
        0.0, "corner of the random sequences; 0: white at the sample rate", unit="Hz", low=0.0, high=1e4
    )
    multisine_period: float = parameter(
        10.0, "after which the multisines repeat", unit="s", low=0.1, high=1e4, in_flight=False
    )
    multisine_low: float = parameter(
        0.2, "lowest frequency of the multisines", unit="Hz", low=0.0, high=1e4, in_flight=False
    )
    multisine_high: float = parameter(
        8.0, "highest frequency of the multisines", unit="Hz", low=0.0, high=1e4, in_flight=False
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
