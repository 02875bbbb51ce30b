"""Parameters of the controller node: the law's own, and the aircraft that it flies."""

from __future__ import annotations

import dataclasses
import math
import sys
import textwrap
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from msls_ros.control import ControlError, ControlledAircraft, ControlSettings, Prior
from msls_ros.control.aircraft import STATES
from msls_ros.control.settings import items
from msls_ros.estimation import EstimationError
from msls_ros.flights.aircraft_files import DEFAULT
from msls_ros.flights.closed_loop import still_air
from msls_ros.flights.steering import controlled
from msls_ros.inputs.model_file import read_model
from msls_ros.nodes.parameters import NodeError, Table, constraint, fixed
from msls_ros.nodes.plant import chosen_condition
from msls_ros.records import FRAME

OWN = {
    "autostart": fixed(True, "configure and activate at the start"),
    "frame_id": fixed(FRAME, "frame of all that is published"),
    "sample_rate": fixed(50.0, "nominal rate of the samples", unit="Hz", low=1.0, high=1e4),
    "lockstep": fixed(
        False, "wait for state, effectors, pilot_command, model and dither of one stamp; false: for the first two"
    ),
    "command_timeout": fixed(
        0.5, "age of a pilot_command after which it counts no more", unit="s", low=0.01, high=3600.0
    ),
    "aircraft": fixed(
        DEFAULT,
        "simulated aircraft whose surfaces, trim and prior are used: a name of config/aircraft, or the path of your "
        "own .yaml; empty: what own.* says",
    ),
    "condition": fixed("", "its flight condition; empty: its first"),
    "prior": fixed(
        "truth",
        "what is known of A and B at the start: truth (of the simulated aircraft at trim), file, none",
        choices=("truth", "file", "none"),
    ),
    "prior_file": fixed("", "prior file: what the identifier's ~/save_model has written"),
    "own.effectors": fixed([], "names of the effectors"),
    "own.surfaces": fixed([], "names of the surfaces, as many; empty: they are the effectors"),
    "own.mixing": fixed((), "surface positions per effector deflection, row by row; empty: one each", unit="rad/rad"),
    "own.low": fixed((), "lowest position of each surface", unit="rad", low=-math.pi, high=math.pi),
    "own.high": fixed((), "highest position of each surface", unit="rad", low=-math.pi, high=math.pi),
    "own.rate_limit": fixed((), "largest speed of each surface", unit="rad/s", low=0.0, high=100.0),
    "own.bandwidth": fixed((), "corner frequency of each actuator", unit="rad/s", low=0.1, high=1e4),
    "own.trim_delta": fixed((), "deflection of each effector in trim", unit="rad", low=-math.pi, high=math.pi),
    "own.trim_alpha": fixed(0.0, "angle of attack in trim", unit="rad", low=-math.pi, high=math.pi),
}
IN_FLIGHT = ("law",)
"""What may change while the node runs."""
PARAMETERS: Table = {
    **OWN,
    **{
        name: (value, dataclasses.replace(bounds, in_flight=name in IN_FLIGHT))
        for name, value, bounds in items(ControlSettings())
    },
}
PROFILE = """\
# The controller of the simulated F-16/MATV at high alpha. Every parameter of the node stands here with its meaning,
# unit and range: this file is the manual. `./msls python -m msls_ros.nodes.control_parameters FILE` writes it again.

/**:
  ros__parameters:
"""


def profile() -> str:
    """Return the shipped parameter file: every parameter at its default."""
    lines, section = [PROFILE.rstrip("\n")], ""
    for name, (default, bounds) in PARAMETERS.items():
        head, _, leaf = name.rpartition(".")
        if head != section:
            section = head
            lines += [f"    {head}:"] if head else []
        indent = " " * (6 if head else 4)
        unit = f" [{bounds.unit}]" if bounds.unit not in ("", "1") and not isinstance(default, (str, list)) else ""
        limits = constraint(bounds, default)
        when = "" if bounds.in_flight else " (fixed at the start)"
        text = f"{bounds.description}{unit}{f', {limits}' if limits else ''}{when}"
        lines += textwrap.wrap(text, 116, initial_indent=f"{indent}# ", subsequent_indent=f"{indent}#   ")
        value = list(default) if isinstance(default, tuple) else default
        lines.append(f"{indent}{leaf}: {yaml_of(value)}")
    return "\n".join(lines) + "\n"


def yaml_of(value: Any) -> str:
    """Return a value as YAML has it; numbers with a point, as ROS asks for."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list):
        return f"[{', '.join(map(yaml_of, value))}]"
    if isinstance(value, float):
        text = repr(value)
        return text if "." in text else text.replace("e", ".0e")
    return '""' if value == "" else str(value)


def settings_of(p: Mapping[str, Any]) -> ControlSettings:
    """Return the law's parameters.

    Raises
    ------
    NodeError
        For a value that is refused.
    """
    try:
        return ControlSettings().changed({name: p[name] for name, _, _ in items(ControlSettings())})
    except ControlError as error:
        raise NodeError(str(error)) from error


def aircraft_of(p: Mapping[str, Any]) -> ControlledAircraft:
    """Return the aircraft that is flown, with its prior.

    Raises
    ------
    NodeError
        For a file that cannot be used, or lists that do not fit.
    """
    try:
        aircraft, truth = (_own(p), None) if not p["aircraft"] else _simulated(dict(p))
        if p["prior"] == "none":
            prior = None
        elif p["prior"] == "truth":
            prior = truth
        else:
            prior = _saved(Path(p["prior_file"]), aircraft.effectors)
        if p["prior"] == "truth" and prior is None:
            message = "parameter 'prior' is 'truth', which only a simulated aircraft has; expected file or none"
            raise NodeError(message)
        return ControlledAircraft(**{**vars_of(aircraft), "prior": prior})
    except (ControlError, EstimationError) as error:
        message = f"the aircraft of the controller: {error}"
        raise NodeError(message) from error


def vars_of(aircraft: ControlledAircraft) -> dict[str, Any]:
    """Return the fields of an aircraft."""
    return {name: getattr(aircraft, name) for name in ControlledAircraft.__dataclass_fields__}


def _simulated(p: dict[str, Any]) -> tuple[ControlledAircraft, Prior]:
    trim, truth = still_air(chosen_condition(p))
    return controlled(trim, None), Prior(truth.a, truth.b)


def _own(p: Mapping[str, Any]) -> ControlledAircraft:
    effectors = tuple(p["own.effectors"])
    if not effectors:
        message = "parameter 'aircraft' is empty; expected own.effectors and the lists beside it"
        raise NodeError(message)
    m = len(effectors)
    mixing = np.array(p["own.mixing"] or np.eye(m).ravel())
    if mixing.size != m * m:
        message = f"parameter 'own.mixing' has {mixing.size} values; expected {m * m}"
        raise NodeError(message)
    return ControlledAircraft(
        effectors=effectors,
        surfaces=tuple(p["own.surfaces"]) or effectors,
        mixing=mixing.reshape(m, m),
        low=tuple(p["own.low"]),
        high=tuple(p["own.high"]),
        rate_limit=tuple(p["own.rate_limit"]),
        bandwidth=tuple(p["own.bandwidth"]),
        trim_delta=np.array(p["own.trim_delta"] or [0.0] * m),
        trim_alpha=p["own.trim_alpha"],
    )


def _saved(path: Path, effectors: tuple[str, ...]) -> Prior:
    model = read_model(path)
    if set(effectors) - set(model.effectors) or set(STATES) - set(model.states):
        message = f"the model '{path}' has states {list(model.states)}, effectors {list(model.effectors)}; expected "
        raise NodeError(message + f"{list(STATES)}, {list(effectors)}")
    rows = [model.states.index(name) for name in STATES]
    columns = [model.effectors.index(name) for name in effectors]
    return Prior(model.a[np.ix_(rows, rows)], model.b[np.ix_(rows, columns)])


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(profile(), encoding="utf-8")
