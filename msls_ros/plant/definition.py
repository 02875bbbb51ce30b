"""An aircraft as data: the JSBSim model it is made of, its surfaces and effectors, and the pilot that goes with it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from msls_ros.plant.interface import Actuator, Array, PlantError

OWN_MODEL = "f16_matv"
"""The model with controls of its own; every other one is derived from a JSBSim aircraft as it stands."""


@dataclass(frozen=True)
class Surface:
    """A control surface: what can be damaged, with one actuator.

    Attributes
    ----------
    name : str
        How it is called.
    actuator : Actuator
        Its lag and limits.
    position : str
        JSBSim property of its position that the aerodynamics read; empty for surfaces of our own controls.
    unit : float
        Radians per unit of that property; negative where the property counts the other way.
    magnitude : str
        JSBSim property of the absolute value of the position; empty: there is none.
    """

    name: str
    actuator: Actuator
    position: str = ""
    unit: float = 1.0
    magnitude: str = ""


@dataclass(frozen=True)
class AttitudeHold:
    """Gains of a light rate damping and attitude hold on the pitch, roll and yaw effectors.

    Attributes
    ----------
    theta, phi : float
        Deflection per attitude error [rad/rad].
    p, q, r : float
        Deflection per body rate, for yaw per rate less that of a coordinated turn [s].
    lag : float
        First-order lag of the pilot's own inputs [s].
    roll_release : float
        Share of the roll hold that stays while a roll input is made [1].
    """

    theta: float
    phi: float
    p: float
    q: float
    r: float
    lag: float = 0.12
    roll_release: float = 0.15


OPEN_LOOP = AttitudeHold(0.0, 0.0, 0.0, 0.0, 0.0)
"""A pilot who only makes the inputs of the manoeuvre, about the trim."""


@dataclass(frozen=True)
class Airframe:
    """What does not change from flight to flight.

    Attributes
    ----------
    name : str
        How the aircraft is called.
    model : str
        Name of a JSBSim aircraft, or `OWN_MODEL`.
    folder : str
        Folder of the user's own JSBSim aircraft, with ``model``.xml in it; empty: one that ships with JSBSim.
    surfaces : tuple of Surface
        What can be damaged.
    effectors : tuple of str
        Names, in the order of delta.
    mixing : tuple of tuple of float
        Matrix (surfaces, effectors): surface positions = this @ effector deflections.
    axes : tuple of str
        The effectors of pitch, roll and yaw inputs.
    amplitudes : tuple of float
        Their amplitudes in manoeuvres of flight test [rad].
    pulse : float
        Duration of one unit of a 3-2-1-1 [s].
    station : tuple of float
        Pilot's (or sensor's) place [m]: ahead of, and above, the centre of mass.
    pilot : AttitudeHold or None
        None: the stability augmentation designed for the F-16/MATV.
    least_rate : int
        Steps per second that the model needs to be integrated stably [Hz].
    """

    name: str
    model: str
    folder: str
    surfaces: tuple[Surface, ...]
    effectors: tuple[str, ...]
    mixing: tuple[tuple[float, ...], ...]
    axes: tuple[str, str, str]
    amplitudes: tuple[float, float, float]
    pulse: float
    station: tuple[float, float]
    pilot: AttitudeHold | None
    least_rate: int = 50

    def __post_init__(self) -> None:
        """Refuse an airframe whose effectors cannot be told from its surfaces."""
        matrix = np.array(self.mixing)
        if matrix.shape != (len(self.surfaces), len(self.effectors)):
            message = f"aircraft {self.name}: mixing of shape {matrix.shape}; expected a row of each surface"
            raise PlantError(message)
        if np.linalg.matrix_rank(matrix) < len(self.effectors):
            message = f"aircraft {self.name}: two effectors move the surfaces alike; expected them independent"
            raise PlantError(message)

    @cached_property
    def surface_names(self) -> tuple[str, ...]:
        """Names of the surfaces."""
        return tuple(surface.name for surface in self.surfaces)

    @cached_property
    def surfaces_of(self) -> dict[str, tuple[str, ...]]:
        """The surfaces that each effector moves."""
        rows = tuple(zip(self.surface_names, self.mixing, strict=True))
        return {name: tuple(one for one, row in rows if row[i]) for i, name in enumerate(self.effectors)}

    @cached_property
    def effectors_from_surfaces(self) -> Array:
        """Matrix (effectors, surfaces): effector deflections = this @ surface positions."""
        return np.asarray(np.linalg.pinv(np.array(self.mixing)).round(12) + 0.0)

    @cached_property
    def actuators(self) -> tuple[Actuator, ...]:
        """Limits by effector: those of the first surface that it moves."""
        by_name = {surface.name: surface.actuator for surface in self.surfaces}
        return tuple(by_name[self.surfaces_of[name][0]] for name in self.effectors)

    def surface(self, name: str) -> Surface:
        """Return a surface by its name."""
        return self.surfaces[self.surface_names.index(name)]
