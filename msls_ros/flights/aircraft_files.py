"""Aircraft as data: ``config/aircraft/*.yaml``, and anybody's own files of that form.

``config/aircraft/c172x.yaml`` is the manual: it has every key, with meaning, unit and range.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from types import MappingProxyType

from msls_ros.flights.scenario_yaml import AIRCRAFT, ScenarioError, Section, load, shown, suggestion
from msls_ros.inputs.profiles import config_folder
from msls_ros.plant import (
    F16_MATV,
    OPEN_LOOP,
    OWN_MODEL,
    STATES,
    Actuator,
    Airframe,
    AttitudeHold,
    FlightCondition,
    PlantError,
    Surface,
)

DEFAULT = "f16_matv"
OWN_KEYS = ("description", "model", "conditions")
KEYS = (*OWN_KEYS, "rate", "surfaces", "effectors", "axes", "amplitudes", "pulse", "station", "pilot")
SURFACE = ("position", "magnitude", "unit", "sign", "low", "high", "rate_limit", "bandwidth")
CONDITION = ("description", "altitude", "airspeed", "mach", "alpha", "gamma", "ballast", "properties")
OWN_CONDITION = (*CONDITION, "leading_edge_flap")
AXES = ("pitch", "roll", "yaw")
GAINS = ("theta", "phi", "p", "q", "r", "lag", "roll_release")
UNITS: Mapping[str, float] = MappingProxyType({"rad": 1.0, "deg": math.pi / 180.0})


@dataclass(frozen=True)
class AircraftData:
    """An aircraft and where it can fly."""

    name: str
    description: str
    airframe: Airframe
    conditions: tuple[FlightCondition, ...]
    """The first is the one where nothing else is asked for."""
    file: str
    """Where it was read."""

    @property
    def condition_names(self) -> tuple[str, ...]:
        """Names of the conditions."""
        return tuple(one.name for one in self.conditions)

    def condition(self, name: str) -> FlightCondition:
        """Return a condition by name; an empty one is the first.

        Raises
        ------
        ScenarioError
            For a name that is not there.
        """
        if not name:
            return self.conditions[0]
        if name not in self.condition_names:
            message = f"condition '{name}' of {self.name}; expected {suggestion(name, self.condition_names)}"
            raise ScenarioError(message)
        return self.conditions[self.condition_names.index(name)]


def shipped_aircraft() -> tuple[str, ...]:
    """Return the names of the aircraft that ship, the F-16/MATV first."""
    found = {path.stem for path in (config_folder() / "aircraft").glob("*.yaml")}
    return (*(name for name in (DEFAULT,) if name in found), *sorted(found - {DEFAULT}))


def find_aircraft(name: str | os.PathLike[str], beside: Path | None = None) -> AircraftData:
    """Read an aircraft.

    Parameters
    ----------
    name
        Of a shipped one, or the path of a YAML file.
    beside
        Folder from which a path counts; None: the current one.

    Raises
    ------
    ScenarioError
        For a name that is not shipped, or a file that is wrong.
    """
    if Path(name).suffix in (".yaml", ".yml"):
        path = (beside or Path()) / name
        return _read(path.resolve(), path.stat().st_mtime_ns if path.is_file() else 0)
    known = shipped_aircraft()
    if str(name) not in known:
        message = f"aircraft '{name}' does not exist; expected {suggestion(str(name), known)}, or a .yaml file"
        raise ScenarioError(message)
    return _read(config_folder() / "aircraft" / f"{name}.yaml", 0)


@cache
def _read(file: Path, _changed: int) -> AircraftData:
    """Read an aircraft's file once."""
    top = Section(file, "", load(file, AIRCRAFT), KEYS, AIRCRAFT)
    description = top.text("description", "one line of text")
    model = top.text("model", "a JSBSim aircraft, or the path of your own .xml")
    if model == OWN_MODEL:
        top = Section(file, "", top.values, OWN_KEYS, AIRCRAFT)
        airframe = F16_MATV
    else:
        airframe = _airframe(top, file.stem, model)
    section = top.section("conditions")
    if not section.values:
        top.refuse("conditions", "is empty; expected at least one condition")
    known = OWN_CONDITION if model == OWN_MODEL else CONDITION
    conditions = tuple(_condition(section.section(name, known), name, airframe) for name in section.values)
    return AircraftData(file.stem, description, airframe, conditions, str(file))


def _airframe(top: Section, name: str, model: str) -> Airframe:
    folder = ""
    if model.endswith(".xml"):
        path = (top.file.parent / model).resolve()
        if not path.is_file():
            top.refuse("model", f"is {model!r}; expected the .xml of a JSBSim aircraft, '{path}' is none")
        folder, model = str(path.parent), path.stem
    surfaces = top.section("surfaces")
    parts = tuple(_surface(surfaces.section(one, SURFACE), one) for one in surfaces.values)
    if not parts:
        top.refuse("surfaces", "is empty; expected at least one surface")
    effectors, mixing = _effectors(top, [one.name for one in parts])
    axes = top.section("axes", AXES)
    amplitudes, station = top.section("amplitudes", AXES), top.section("station", ("forward", "above"), {})
    chosen = [axes.word(axis, effectors) for axis in AXES]
    sizes = [amplitudes.number(axis, 0.0, 1.0, "rad") for axis in AXES]
    try:
        return Airframe(
            name=name,
            model=model,
            folder=folder,
            surfaces=parts,
            effectors=effectors,
            mixing=mixing,
            axes=(chosen[0], chosen[1], chosen[2]),
            amplitudes=(sizes[0], sizes[1], sizes[2]),
            pulse=top.number("pulse", 0.05, 20.0, "s", 0.5),
            station=(
                station.number("forward", -100.0, 100.0, "m", 0.0),
                station.number("above", -100.0, 100.0, "m", 0.0),
            ),
            pilot=_pilot(top),
            least_rate=top.whole("rate", 50, 1000, "Hz", 50),
        )
    except PlantError as error:
        top.wrap("effectors", error)


def _surface(section: Section, name: str) -> Surface:
    unit = section.get("unit", "rad", "rad, deg, or radians per unit of the property")
    if unit in UNITS:
        unit = UNITS[str(unit)]
    elif isinstance(unit, str):
        section.refuse("unit", f"is {shown(unit)}; expected rad, deg, or radians per unit of the property")
    else:
        unit = section.number("unit", 1e-6, 1e3, "rad per unit")
    low, high = section.number("low", -3.2, 3.2, "rad"), section.number("high", -3.2, 3.2, "rad")
    if not low < high:
        section.refuse("high", f"is {high:g}; expected more than low, {low:g} rad")
    actuator = Actuator(
        section.number("bandwidth", 0.1, 1000.0, "rad/s", 20.0),
        section.number("rate_limit", 0.01, 100.0, "rad/s", 1.0),
        low,
        high,
    )
    position = section.text("position", "the JSBSim property of the position that the aerodynamics read")
    sign = section.number("sign", -1.0, 1.0, "", 1.0)
    if abs(sign) != 1.0:
        section.refuse("sign", f"is {sign:g}; expected 1 or -1")
    return Surface(name, actuator, position, sign * unit, str(section.values.get("magnitude", "")))


def _effectors(top: Section, surfaces: list[str]) -> tuple[tuple[str, ...], tuple[tuple[float, ...], ...]]:
    section = top.section("effectors")
    columns = []
    for name in section.values:
        if name in (*STATES, "1"):
            section.refuse(name, "is the name of a state; expected another")
        parts = section.section(name, surfaces)
        columns.append([parts.number(one, -10.0, 10.0, "rad per rad", 0.0) for one in surfaces])
    if not columns:
        top.refuse("effectors", "is empty; expected at least one effector")
    return tuple(section.values), tuple(zip(*columns, strict=True))


def _pilot(top: Section) -> AttitudeHold:
    if top.values.get("pilot", "open_loop") == "open_loop":
        return OPEN_LOOP
    section = top.section("pilot", GAINS)
    default = replace(OPEN_LOOP)
    numbers = {name: section.number(name, -10.0, 10.0, "", getattr(default, name)) for name in GAINS}
    return AttitudeHold(**numbers)


def _condition(section: Section, name: str, airframe: Airframe) -> FlightCondition:
    if ("airspeed" in section.values) == ("mach" in section.values):
        section.refuse("airspeed", "and mach: expected one of them")
    airspeed = section.number("airspeed", 1.0, 1000.0, "m/s") if "airspeed" in section.values else None
    properties = section.section("properties", (), {})
    return FlightCondition(
        name,
        section.number("altitude", 0.0, 30_000.0, "m"),
        section.number("mach", 0.01, 3.0, "") if airspeed is None else None,
        section.number("alpha", -1.5, 1.5, "rad") if "alpha" in section.values else None,
        section.number("ballast", 0.0, 1e6, "kg", 0.0),
        section.number("leading_edge_flap", -1.0, 1.0, "rad", 0.0),
        section.text("description", "one line of text", name),
        airframe,
        airspeed,
        section.number("gamma", -1.0, 1.0, "rad", 0.0),
        tuple((one, properties.number(one, -1e9, 1e9, "")) for one in _words(properties.values)),
    )


def _words(names: Iterable[object]) -> list[str]:
    return [str(name) for name in names]
