"""The F-16/MATV: derived, when loaded, from the F-16 that ships with JSBSim; plus our own controls and tail.

Nothing of the bundled aircraft is stored in this package. What is done to it, and its defects:

- systems, external reactions, flight controls, landing gear and output are dropped (pushback, hook, a fly-by-wire
  whose override does not bypass the rudder); `data/controls.xml` replaces them: seven effectors, actuators, damage;
- aileron and rudder coefficients are per full deflection (20 and 30 deg) but were multiplied by radians: the controls
  feed them deflection / 0.349 and deflection / 0.5236;
- lift against stabilator has the wrong sign (the moment is right): the columns of that table are mirrored. With the
  sign left wrong the high-alpha trim is a 1.6 deg steeper descent at 0.05 less throttle;
- the stabilators have no differential aerodynamics: `data/differential_tail.xml` adds an estimate;
- the leading-edge flap switches between three positions at thresholds of alpha: here it is fixed per condition;
- the trailing-edge flaps cancelled out of their own coefficient: here the symmetric flap feeds it directly;
- the aerodynamic tables span -10 to 45 deg of alpha and +-30 deg of beta and hold their end values outside.

A ballast, if any, sits at the centre of mass and adds no inertia. Thrust vectoring turns the engine's thrust at the
nozzle, 16 ft aft of the centre of mass. A lost surface is one that no longer makes force when deflected; its drag and
weight stay. The fuel does not burn down, the throttle does not move, and there is no wind but JSBSim's turbulence.
"""

from __future__ import annotations

import math
import os
import tempfile
import xml.etree.ElementTree as ET
from functools import cache
from importlib import resources
from pathlib import Path

import jsbsim
import numpy as np

from msls_ros.plant.definition import OWN_MODEL, Airframe, Surface
from msls_ros.plant.interface import (
    EFFECTORS,
    EFFECTORS_FROM_SURFACES,
    PILOT_STATION,
    SURFACES,
    SURFACES_OF,
    Actuator,
    PlantError,
)

Node = jsbsim.FGPropertyNode
NAME = OWN_MODEL
_DROPPED = ("system", "external_reactions", "flight_control", "ground_reactions", "output", "fileheader")
_KILOGRAM_LB = 1.0 / 0.45359237

# The only silence that holds in every thread: JSBSim's loggers are one per thread, and a Python one ends the process
# when its thread ends, for it is released without the interpreter's lock.
os.environ.setdefault("JSBSIM_DEBUG", "0")


def _data(name: str) -> ET.Element:
    return ET.fromstring(resources.files("msls_ros.plant").joinpath("data", name).read_text(encoding="utf-8"))


def _mirror_columns(table: ET.Element) -> None:
    """Reflect a table about its column variable: f(a, d) becomes f(a, -d); the breakpoints are symmetric."""
    data = table.find("tableData")
    if data is None or data.text is None:
        message = "the bundled F-16's table of lift against stabilator has no data: expected JSBSim 1.3"
        raise PlantError(message)
    lines = [line.split() for line in data.text.splitlines() if line.strip()]
    columns = [float(cell) for cell in lines[0]]
    if columns != [-value for value in reversed(columns)]:
        message = f"the bundled F-16's stabilator table has columns {columns}: expected them symmetric about 0"
        raise PlantError(message)
    mirrored = [lines[0]] + [[row[0], *reversed(row[1:])] for row in lines[1:]]
    data.text = "\n" + "\n".join(" ".join(row) for row in mirrored) + "\n"


@cache
def _centre_of_mass() -> tuple[float, float]:
    """Longitudinal and vertical place of the loaded, unballasted aircraft's centre of mass [in, structural axes]."""
    fdm = load(0.0, 100)
    fdm.run_ic()
    return float(fdm.get_property_value("inertia/cg-x-in")), float(fdm.get_property_value("inertia/cg-z-in"))


def _pointmass(mass: float) -> ET.Element:
    ballast = ET.Element("pointmass", name="Ballast")
    ET.SubElement(ballast, "weight", unit="LBS").text = repr(mass * _KILOGRAM_LB)
    place = ET.SubElement(ballast, "location", unit="IN")
    x, z = _centre_of_mass()
    for axis, value in (("x", x), ("y", 0.0), ("z", z)):
        ET.SubElement(place, axis).text = repr(value)
    return ballast


def _required(element: ET.Element | None, what: str) -> ET.Element:
    if element is None:
        message = f"the F-16 that ships with JSBSim {jsbsim.__version__} has no {what}: expected the one of 1.3"
        raise PlantError(message)
    return element


def _merge_differential_tail(aerodynamics: ET.Element) -> None:
    axes = {axis.get("name"): axis for axis in aerodynamics.findall("axis")}
    for axis in _data("differential_tail.xml").findall("axis"):
        _required(axes.get(axis.get("name")), f"{axis.get('name')} axis").extend(list(axis))


def turn_air(aerodynamics: ET.Element) -> None:
    """Let the aerodynamics feel the rates less a rotation of the air that can be set: JSBSim's own cannot."""
    for axis in ("p", "q", "r"):
        rate, felt = f"velocities/{axis}-aero-rad_sec", f"aero/{axis}-felt-rad_sec"
        for element in aerodynamics.iter("property"):
            if (element.text or "").strip() == rate:
                element.text = felt
        function = ET.Element("function", name=felt)
        difference = ET.SubElement(function, "difference")
        for name in (rate, f"wind/{axis}-rad_sec"):
            ET.SubElement(difference, "property").text = name
        aerodynamics.insert(0, function)


@cache
def _bundled_text() -> str:
    path = Path(jsbsim.get_default_root_dir()) / "aircraft" / "f16" / "f16.xml"
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        message = f"{path}: cannot read the F-16 that ships with JSBSim ({error.strerror})"
        raise PlantError(message) from error


@cache
def _aircraft_xml(ballast: float) -> str:
    """Text of the derived aircraft file, with the ballast [kg] at the centre of mass."""
    root = ET.fromstring(_bundled_text())
    for tag in _DROPPED:
        for element in root.findall(tag):
            root.remove(element)
    mass = _required(root.find("mass_balance"), "mass balance")
    if ballast:
        mass.append(_pointmass(ballast))
    aerodynamics = _required(root.find("aerodynamics"), "aerodynamics")
    _mirror_columns(
        _required(aerodynamics.find(".//function[@name='aero/coefficient/CLDh']/product/table"), "stabilator lift")
    )
    _merge_differential_tail(aerodynamics)
    turn_air(aerodynamics)
    position = list(root).index(aerodynamics)
    root.insert(position, ET.Element("flight_control", file="controls"))
    propulsion = _required(root.find("propulsion"), "propulsion")
    root.insert(list(root).index(propulsion), ET.Element("ground_reactions"))
    return ET.tostring(root, encoding="unicode")


@cache
def _controls_xml(ideal: bool) -> str:
    """Text of the flight controls; `ideal` removes the actuators' lags and all limits of rate and position."""
    controls = _data("controls.xml")
    if ideal:
        for component in controls.iter():
            for tag in ("lag", "rate_limit", "clipto"):
                for element in component.findall(tag):
                    component.remove(element)
    return ET.tostring(controls, encoding="unicode")


def _surface_actuator(controls: ET.Element, surface: str) -> Actuator:
    element = _required(controls.find(f".//actuator[@name='surfaces/{surface}-pos-rad']"), f"actuator for {surface}")
    tags = ("lag", "rate_limit", "clipto/min", "clipto/max")
    lag, rate, low, high = (float(_required(element.find(tag), tag).text or "nan") for tag in tags)
    return Actuator(bandwidth=lag, rate_limit=rate, low=low, high=high)


_CONTROLS = _data("controls.xml")
SURFACE_ACTUATORS: dict[str, Actuator] = {surface: _surface_actuator(_CONTROLS, surface) for surface in SURFACES}
"""The actuators by surface, as `data/controls.xml` has them."""

ACTUATORS: tuple[Actuator, ...] = tuple(SURFACE_ACTUATORS[SURFACES_OF[effector][0]] for effector in EFFECTORS)
"""The actuators' limits by effector, in the order of `EFFECTORS`."""


F16_MATV = Airframe(
    name=NAME,
    model=OWN_MODEL,
    folder="",
    surfaces=tuple(Surface(name, SURFACE_ACTUATORS[name]) for name in SURFACES),
    effectors=EFFECTORS,
    mixing=tuple(map(tuple, (np.linalg.inv(EFFECTORS_FROM_SURFACES) + 0.0).tolist())),
    axes=("de", "ddt", "dr"),
    amplitudes=(math.radians(2.0), math.radians(3.0), math.radians(4.0)),
    pulse=0.5,
    station=PILOT_STATION,
    pilot=None,
)
"""The aircraft that this module derives, as ``config/aircraft/f16_matv.yaml`` has it."""


def load(ballast: float, rate: int, *, ideal: bool = False) -> jsbsim.FGFDMExec:
    """Build a fresh flight dynamics model of the F-16/MATV.

    Parameters
    ----------
    ballast : float
        Added mass [kg].
    rate : int
        Steps per second [Hz].
    ideal : bool
        Actuators without lag, rate limits and position limits.

    Returns
    -------
    jsbsim.FGFDMExec
        Loaded, not yet initialised; nothing is left on the disk.

    Raises
    ------
    PlantError
        If the bundled aircraft is not the expected one or JSBSim refuses the derived one.
    """
    with tempfile.TemporaryDirectory(prefix="msls_f16_") as folder:
        home = Path(folder) / NAME
        home.mkdir()
        (home / f"{NAME}.xml").write_text(_aircraft_xml(ballast), encoding="utf-8")
        (home / "controls.xml").write_text(_controls_xml(ideal), encoding="utf-8")
        fdm = jsbsim.FGFDMExec(None)
        fdm.set_debug_level(0)
        fdm.set_dt(1.0 / rate)
        engines = str(Path(jsbsim.get_default_root_dir()) / "engine")
        try:
            loaded = fdm.load_model_with_paths(NAME, folder, engines, folder)
        except jsbsim.BaseError as error:
            message = f"JSBSim refuses the derived F-16: {error}"
            raise PlantError(message) from error
    if not loaded:
        message = "JSBSim refuses the derived F-16, for the reason it gave on stderr: expected JSBSim 1.3"
        raise PlantError(message)
    fdm.disable_output()
    return fdm
