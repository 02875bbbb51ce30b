"""Any JSBSim aircraft, derived when loaded so that its surfaces can be driven, measured and damaged.

The aerodynamics read each surface through what is ours; the aircraft's own flight controls stay as they are::

    surfaces/X-own-rad = actuator(sum of the effectors' commands - trim, or where a fault drives it)
    surfaces/X-pos-rad = unit * fcs/X + surfaces/X-own-rad                   (measured; holds when stuck)
    surfaces/X-felt    = (damage/X-effectiveness * surfaces/X-pos-rad + damage/X-bias-rad) / unit      (by the air)

With nothing commanded and nothing damaged that is the original aircraft. A stability augmentation of its own (the
yaw damper of the A-4) so moves what is measured. The ideal form, of which the truth is made, has no flight controls:
surfaces are where they are told to be, and what else the aerodynamics read of them (flaps, gear) is set from outside.
Nothing of the aircraft is stored in this package.
"""

from __future__ import annotations

import hashlib
import re
import shutil
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import jsbsim

from msls_ros.plant.airframe import turn_air
from msls_ros.plant.definition import Airframe, Surface
from msls_ros.plant.interface import PlantError

NATIVE = (
    *("aero", "velocities", "attitude", "position", "metrics", "inertia", "propulsion", "atmosphere"),
    *("accelerations", "forces", "moments", "simulation", "ic", "environment", "wind", "surfaces"),
)
"""First words of the properties that the ideal form has by itself."""
IMPLICIT = ("aero/alphadot-rad_sec", "aero/betadot-rad_sec")
"""What the aerodynamics may read of the accelerations that they cause."""
_PROPERTY = re.compile(r"[A-Za-z][\w-]*(/[\w.\[\]-]+)+")
_UNWANTED = ("output", "input")
_CONTROLS = ("system", "autopilot", "flight_control", "external_reactions", "ground_reactions")


@dataclass(frozen=True)
class Derived:
    """A derived aircraft file, and the properties through which its ideal form is told about its surroundings."""

    text: str
    held: tuple[tuple[str, str], ...]
    """Property of the flying form, and that of the ideal form that takes its value."""
    implicit: tuple[tuple[str, str], ...]
    """The same of `IMPLICIT`."""


def folder_of(airframe: Airframe) -> Path:
    """Return the folder with the aircraft's file."""
    if airframe.folder:
        return Path(airframe.folder)
    return Path(jsbsim.get_default_root_dir()) / "aircraft" / airframe.model


def load(airframe: Airframe, ballast: float, rate: int, *, ideal: bool = False) -> tuple[jsbsim.FGFDMExec, Derived]:
    """Build a fresh flight dynamics model of a derived aircraft.

    Parameters
    ----------
    airframe : Airframe
        Which.
    ballast : float
        Mass added at the centre of mass [kg].
    rate : int
        Steps per second [Hz].
    ideal : bool
        Surfaces are where they are told to be; no flight controls, gear or systems.

    Returns
    -------
    tuple
        The model, loaded and not yet initialised, and what it was made of.

    Raises
    ------
    PlantError
        If there is no such aircraft, or JSBSim refuses the derived one.
    """
    derived = derive(airframe, ballast, ideal)
    source, name = folder_of(airframe), airframe.model
    root = Path(jsbsim.get_default_root_dir())
    with tempfile.TemporaryDirectory(prefix="msls_aircraft_") as folder:
        home = Path(folder) / name
        home.mkdir()
        for entry in source.iterdir():
            if entry.name != f"{name}.xml":
                (home / entry.name).symlink_to(entry)
        (home / f"{name}.xml").write_text(derived.text, encoding="utf-8")
        fdm = jsbsim.FGFDMExec(None)
        fdm.set_debug_level(0)
        fdm.set_dt(1.0 / rate)
        places = [_beside(source, kind) or root / kind for kind in ("engine", "systems")]
        try:
            loaded = fdm.load_model_with_paths(name, folder, str(places[0]), str(places[1]))
        except jsbsim.BaseError as error:
            message = f"aircraft {airframe.name}: JSBSim refuses the model {name}: {' '.join(str(error).split())}"
            raise PlantError(message) from error
        finally:
            shutil.rmtree(home / "output", ignore_errors=True)
    if not loaded:
        message = f"aircraft {airframe.name}: JSBSim refuses the model {name}, for the reason it gave on stderr"
        raise PlantError(message)
    fdm.disable_output()
    return fdm, derived


def digest_of(airframe: Airframe) -> str:
    """Return a digest of the files that a user's own model is made of; empty for one that ships with JSBSim or with us.

    Parameters
    ----------
    airframe
        The aircraft.
    """
    if not airframe.folder:
        return ""
    source, total = Path(airframe.folder), hashlib.sha256()
    for folder in (source, _beside(source, "engine"), _beside(source, "systems")):
        for path in sorted(folder.rglob("*.xml")) if folder else ():
            total.update(f"{path.name}\n".encode() + path.read_bytes())
    return total.hexdigest()[:16]


def _beside(source: Path, kind: str) -> Path | None:
    """Return the folder of engines or systems that a user's aircraft brings, in its folder or two above it."""
    for place in (source / kind, source / kind.capitalize(), source.parent.parent / kind):
        if place.is_dir():
            return place
    return None


@cache
def derive(airframe: Airframe, ballast: float, ideal: bool) -> Derived:
    """Return the text of the derived aircraft file; once per process."""
    root = _read(airframe)
    aerodynamics, controls = root.find("aerodynamics"), root.find("flight_control")
    if aerodynamics is None:
        message = f"aircraft {airframe.name}: the model {airframe.model} has no aerodynamics; expected some"
        raise PlantError(message)
    for tag in (*_UNWANTED, *(_CONTROLS if ideal else ())):
        for element in root.findall(tag):
            root.remove(element)
    if ideal or controls is None:
        controls = ET.Element("flight_control", name="effectors")
        root.insert(list(root).index(aerodynamics), controls)
    if root.find("ground_reactions") is None:
        root.insert(0, ET.Element("ground_reactions"))
    for surface in airframe.surfaces:
        _divert(airframe, surface, aerodynamics)
    held, implicit = _hold(aerodynamics, ideal)
    turn_air(aerodynamics)
    declared = [name for _, name in (*held, *implicit)] if ideal else []
    _add_controls(controls, airframe, ideal, declared)
    if ballast:
        _add_ballast(root, airframe, ballast)
    return Derived(ET.tostring(root, encoding="unicode"), held, implicit)


def _read(airframe: Airframe) -> ET.Element:
    """Return the aircraft's file, with what it has in files of their own put in where surfaces are read or made."""
    folder = folder_of(airframe)
    root = _parse(airframe, folder / f"{airframe.model}.xml")
    for tag in ("aerodynamics", "flight_control"):
        found = root.find(tag)
        name = None if found is None else found.get("file")
        if found is None or name is None:
            continue
        path = folder / (name if name.endswith(".xml") else f"{name}.xml")
        inner = _parse(airframe, path)
        root.insert(list(root).index(found), inner)
        root.remove(found)
    return root


def _parse(airframe: Airframe, path: Path) -> ET.Element:
    try:
        return ET.parse(path).getroot()
    except OSError as error:
        where = "your folder" if airframe.folder else "those that ship with JSBSim"
        message = f"aircraft {airframe.name}: model '{airframe.model}' is not among {where}: '{path}' cannot be read"
        raise PlantError(message) from error
    except ET.ParseError as error:
        message = f"aircraft {airframe.name}: '{path}' is not XML: {error}"
        raise PlantError(message) from error


def _divert(airframe: Airframe, surface: Surface, aerodynamics: ET.Element) -> None:
    """Let the aerodynamics read a surface from what the air feels."""
    found = 0
    for element in aerodynamics.iter():
        name = (element.text or "").strip()
        if name == surface.position:
            element.text = f"surfaces/{surface.name}-felt"
            found += 1
        elif surface.magnitude and name == surface.magnitude:
            element.text = f"surfaces/{surface.name}-felt-mag"
    if not found:
        read = sorted({name for name in _read_names(aerodynamics) if name.startswith("fcs/")})
        message = (
            f"aircraft {airframe.name}: surface {surface.name}: the aerodynamics of {airframe.model} do not read "
            f"'{surface.position}'; expected one of {', '.join(read) or 'their properties'}"
        )
        raise PlantError(message)


def _read_names(aerodynamics: ET.Element) -> Iterator[str]:
    for element in aerodynamics.iter():
        name = (element.text or "").strip()
        if _PROPERTY.fullmatch(name):
            yield name


def _hold(aerodynamics: ET.Element, replace: bool) -> tuple[tuple[tuple[str, str], ...], tuple[tuple[str, str], ...]]:
    """Let the aerodynamics read what flight controls make, and rates of the incidence angles, from outside."""
    made = {element.get("name", "") for element in aerodynamics.iter("function")}
    names = sorted(set(_read_names(aerodynamics)) - made)
    held = {name: f"held/value-{i}" for i, name in enumerate(names) if name.split("/")[0] not in NATIVE}
    implicit = {name: f"held/implicit-{i}" for i, name in enumerate(IMPLICIT) if name in names}
    for element in aerodynamics.iter() if replace else ():
        name = (element.text or "").strip()
        if name in held or name in implicit:
            element.text = held.get(name) or implicit[name]
    return tuple(held.items()), tuple(implicit.items())


def _add_controls(controls: ET.Element, airframe: Airframe, ideal: bool, declared: list[str]) -> None:
    properties = [(f"fcs/{name}-cmd-rad", 0.0) for name in airframe.effectors]
    for name in airframe.surface_names:
        properties += [(f"damage/{name}-effectiveness", 1.0), (f"damage/{name}-bias-rad", 0.0)]
        properties += [(f"damage/{name}-driven", 0.0), (f"damage/{name}-position-rad", 0.0)]
        properties += [(f"surfaces/{name}-trim-rad", 0.0)]
    properties += [(f"wind/{axis}-rad_sec", 0.0) for axis in "pqr"] + [(name, 0.0) for name in declared]
    for i, (name, value) in enumerate(properties):  # before the first channel, or JSBSim mis-loads the file
        element = ET.Element("property", value=repr(value))
        element.text = name
        controls.insert(i, element)
    channel = ET.SubElement(controls, "channel", name="Surfaces of msls_ros")
    for surface, row in zip(airframe.surfaces, airframe.mixing, strict=True):
        channel.extend(_components(surface, dict(zip(airframe.effectors, row, strict=True)), ideal))


def _components(surface: Surface, row: dict[str, float], ideal: bool) -> Iterator[ET.Element]:
    """Yield the chain of one surface: command, actuator, sum with the flight controls, what the air feels."""
    name, actuator = surface.name, surface.actuator
    place, bounds = f"surfaces/{name}", f"<clipto><min>{actuator.low!r}</min><max>{actuator.high!r}</max></clipto>"
    asked = "".join(_product(f"fcs/{effector}-cmd-rad", share) for effector, share in row.items() if share)
    yield _function(f"{place}-cmd-rad", f"<sum>{asked}{_product(f'{place}-trim-rad', -1.0)}<value>0</value></sum>")
    if ideal:
        yield ET.fromstring(f"<actuator name='{place}-pos-rad'><input>{place}-cmd-rad</input></actuator>")
    else:
        limits = f"<lag>{actuator.bandwidth!r}</lag><rate_limit>{actuator.rate_limit!r}</rate_limit>"
        driven = f"<property>damage/{name}-position-rad</property>{_product(f'{place}-trim-rad', -1.0)}"
        yield _function(f"{place}-driven-rad", f"<sum>{driven}</sum>")
        test = f"<test value='{place}-driven-rad'>damage/{name}-driven gt 0.5</test>"
        yield ET.fromstring(f"<switch name='{place}-asked-rad'><default value='{place}-cmd-rad'/>{test}</switch>")
        yield ET.fromstring(f"<actuator name='{place}-own-rad'><input>{place}-asked-rad</input>{limits}</actuator>")
        both = f"{_product(surface.position, surface.unit)}<property>{place}-own-rad</property>"
        yield _function(f"{place}-sum-rad", f"<sum>{both}</sum>", bounds)
        yield ET.fromstring(f"<actuator name='{place}-pos-rad'><input>{place}-sum-rad</input></actuator>")
    effect = f"<product><property>damage/{name}-effectiveness</property><property>{place}-pos-rad</property></product>"
    sum_ = f"<sum>{effect}<property>damage/{name}-bias-rad</property></sum>"
    yield _function(f"{place}-felt", f"<quotient>{sum_}<value>{surface.unit!r}</value></quotient>")
    yield _function(f"{place}-felt-mag", f"<abs><property>{place}-felt</property></abs>")


def _product(name: str, factor: float) -> str:
    return f"<product><value>{factor!r}</value><property>{name}</property></product>"


def _function(name: str, body: str, more: str = "") -> ET.Element:
    return ET.fromstring(f"<fcs_function name='{name}'><function>{body}</function>{more}</fcs_function>")


def _add_ballast(root: ET.Element, airframe: Airframe, ballast: float) -> None:
    mass = root.find("mass_balance")
    if mass is None:
        message = f"aircraft {airframe.name}: the model {airframe.model} has no mass balance; expected one"
        raise PlantError(message)
    x, z = _centre_of_mass(airframe)
    place = f"<location unit='IN'><x>{x!r}</x><y>0.0</y><z>{z!r}</z></location>"
    weight = f"<weight unit='LBS'>{ballast / 0.45359237!r}</weight>"
    mass.append(ET.fromstring(f"<pointmass name='Ballast'>{weight}{place}</pointmass>"))


@cache
def _centre_of_mass(airframe: Airframe) -> tuple[float, float]:
    fdm, _ = load(airframe, 0.0, 100)
    fdm.run_ic()
    return float(fdm.get_property_value("inertia/cg-x-in")), float(fdm.get_property_value("inertia/cg-z-in"))
