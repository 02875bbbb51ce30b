"""Flight conditions at which the aircraft is trimmed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from msls_ros.plant.airframe import F16_MATV
from msls_ros.plant.definition import Airframe

_POUND = 0.45359237
_FOOT = 0.3048


@dataclass(frozen=True)
class FlightCondition:
    """A steady flight: the trim is found for it.

    Attributes
    ----------
    name : str
        How it is called.
    altitude : float
        Above sea level [m].
    mach : float or None
        Mach number; None: the airspeed is given.
    alpha : float or None
        Angle of attack [rad]; the flight path then follows from the trim. None: level flight, alpha follows.
    ballast : float
        Mass added at the centre of mass [kg]: at high alpha the bundled aircraft alone is too light to fly steadily.
    leading_edge_flap : float
        Fixed deflection [rad]; the bundled aircraft switches it on and off.
    description : str
        One sentence for people.
    airframe : Airframe
        What flies there.
    airspeed : float or None
        Calibrated airspeed [m/s], instead of the Mach number.
    gamma : float
        Climb angle [rad]; the F-16/MATV's follows from its trim.
    properties : tuple of (str, float)
        JSBSim properties set before the trim: flaps, gear, mixture.
    """

    name: str
    altitude: float
    mach: float | None
    alpha: float | None
    ballast: float
    leading_edge_flap: float
    description: str
    airframe: Airframe = F16_MATV
    airspeed: float | None = None
    gamma: float = 0.0
    properties: tuple[tuple[str, float], ...] = ()


CONDITIONS: Mapping[str, FlightCondition] = MappingProxyType(
    {
        "high_alpha": FlightCondition(
            name="high_alpha",
            altitude=20_000.0 * _FOOT,
            mach=0.23,
            alpha=math.radians(38.5),
            ballast=6_000.0 * _POUND,
            leading_edge_flap=math.radians(25.0),
            description="20,000 ft, Mach 0.23, angle of attack 38.5 deg, descending: the paper's condition",
        ),
        "cruise": FlightCondition(
            name="cruise",
            altitude=20_000.0 * _FOOT,
            mach=0.6,
            alpha=None,
            ballast=0.0,
            leading_edge_flap=0.0,
            description="20,000 ft, Mach 0.6, level",
        ),
    }
)
"""The conditions that ship, by name."""
