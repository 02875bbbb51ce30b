"""The flights that ship: condition, manoeuvre, damage, and the parameters of the identifier that go with them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from msls_ros.commands.profiles import read_profile
from msls_ros.estimation import Configuration

BY_NOISE: Mapping[str, Mapping[str, Any]] = {
    "none": {"estimator.penalty": 3e-4},
    "low": {"estimator.forgetting_factor": 0.96, "estimator.penalty": 1.3e-3, "recovery.penalty_factor": 0.2},
    "med": {
        "estimator.penalty": 1e-2,
        "detector.mode": "ratio",
        "detector.window": 50,
        "detector.threshold": 3.5,
    },
}
"""What goes with the noise of the sensors in these quiet flights; the shipped profiles serve strong manoeuvres too.

Looking back 25 samples instead of the paper's 10 halves the error that low noise leaves, where nothing moves fast."""


@dataclass(frozen=True)
class Scenario:
    """One flight."""

    name: str
    description: str
    condition: str
    profile: str
    manoeuvre: str = "roll_doublet"
    duration: float = 12.0
    """[s]"""
    fault_time: float = -1.0
    """[s]; negative: no fault."""
    fault_surface: str = "left_stabilator"
    fault_effectiveness: float = 0.0

    @property
    def has_fault(self) -> bool:
        """Whether anything breaks."""
        return self.fault_time >= 0.0

    def configuration(self, noise: str, seed: int, dither: bool) -> Configuration:
        """Return the identifier's configuration for a noise level, a seed, and with or without dither."""
        return read_profile(self.profile).replace({**BY_NOISE[noise], "dither.seed": seed, "dither.enabled": dither})


SCENARIOS: Mapping[str, Scenario] = {
    s.name: s
    for s in (
        Scenario(
            "roll_doublet_tail_fault",
            "the paper's flight: two-pound roll doublet at angle of attack 38.5 deg, left stabilator lost at 4 s",
            "high_alpha",
            "f16_high_alpha",
            fault_time=4.0,
        ),
        Scenario(
            "roll_doublet",
            "the same doublet with nothing broken",
            "high_alpha",
            "f16_high_alpha",
        ),
        Scenario(
            "cruise_tail_fault",
            "roll doublet at Mach 0.6, level, left stabilator lost at 4 s",
            "cruise",
            "f16_cruise",
            fault_time=4.0,
        ),
    )
}
