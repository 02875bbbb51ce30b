"""Failures drawn at random: of a flight's own seed, so that a campaign meets another one with each."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from msls_ros.plant import Airframe, Fault

KINDS = ("lost", "offset", "stuck", "hard_over")
"""What a surface may suffer: see `RandomFailures.draw`."""
_STREAM = 0xFA11
PARTIAL = 0.5
"""Largest effectiveness that a lost surface keeps; every second one keeps nothing."""
TRAVEL = 0.5
"""Largest offset, and largest distance of a hard-over from the middle, as a share of the travel to the limit."""


@dataclass(frozen=True)
class RandomFailures:
    """Which failures are drawn.

    Attributes
    ----------
    surfaces : tuple of int
        Fewest and most surfaces that fail at once.
    kinds : tuple of str
        Of `KINDS`, each as likely as the others.
    seed : int
        With another one the flights' seeds meet other failures.
    time : float
        When they strike [s].
    """

    surfaces: tuple[int, int] = (1, 3)
    kinds: tuple[str, ...] = ("lost", "offset", "stuck")
    seed: int = 0
    time: float = 4.0

    def draw(self, flight: int, airframe: Airframe) -> tuple[Fault, ...]:
        """Return the failures of a flight by its seed.

        A surface is *lost* (every second time wholly, else up to half of its effect is left), lost with an unmeasured
        *offset* of up to half its travel, *stuck* where it is, or driven *hard over*, measured, up to half its travel.
        """
        random = np.random.default_rng([_STREAM, self.seed, flight])
        count = int(random.integers(self.surfaces[0], min(self.surfaces[1], len(airframe.surfaces)) + 1))
        chosen = sorted(random.choice(len(airframe.surfaces), count, replace=False).tolist())
        faults = []
        for index in chosen:
            surface = airframe.surfaces[index]
            kind = self.kinds[int(random.integers(len(self.kinds)))]
            size, whole = float(random.uniform(-TRAVEL, TRAVEL)), bool(random.integers(2))
            place = size * (surface.actuator.high if size > 0.0 else -surface.actuator.low)
            left = 0.0 if whole else PARTIAL * float(random.uniform())
            if kind == "stuck":
                faults.append(Fault(surface.name, self.time, 1.0, stuck=True, airframe=airframe))
            elif kind == "hard_over":
                faults.append(Fault(surface.name, self.time, 1.0, hard_over=place, airframe=airframe))
            else:
                bias = place if kind == "offset" else 0.0
                left = 0.0 if kind == "offset" else left
                faults.append(Fault(surface.name, self.time, left, bias=bias, airframe=airframe))
        return tuple(faults)


def describe(faults: tuple[Fault, ...]) -> str:
    """Return failures in a few words, for tables."""
    words = []
    for fault in faults:
        what = f"{fault.effectiveness:.0%}" if fault.effectiveness < 1.0 else ""
        if fault.bias:
            what += f" {math.degrees(fault.bias):+.0f} deg"
        if fault.stuck:
            what += " stuck"
        if fault.hard_over is not None:
            what += f" to {math.degrees(fault.hard_over):+.0f} deg"
        words.append(f"{fault.effector} {what.strip()}")
    return ", ".join(words)
