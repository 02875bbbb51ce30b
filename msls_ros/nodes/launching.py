"""What our launch files share. It imports neither launch, which may not be installed, nor any other room."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ament_index_python.packages import get_package_share_directory

ARGUMENTS = {
    "namespace": ("", "of all nodes and topics; with one, the clock is the namespace's own, NAMESPACE/clock"),
    "params_file": (
        "",
        "of the identifier: a shipped profile's name, or a path; empty: f16, or with inputs the defaults",
    ),
    "inputs": ("", "of the identifier, where it takes other messages than msls_msgs: a shipped name, or a path"),
    "autostart": (
        "",
        "configure and activate at the start; false: a lifecycle manager does it; empty: as the file says, else true",
    ),
    "respawn": ("false", "start nodes again that end unasked"),
    "log_level": ("info", "debug, info, warn, error or fatal"),
    "record": ("", "folder of a bag to record everything into; empty: none"),
}
"""Default and description of the arguments that every launch file has."""
FOLDERS = (".", "inputs")
"""Of config, in which a shipped parameter file is looked for."""


def is_true(text: str) -> bool:
    """Return whether an argument says true."""
    return text.lower() == "true"


def switches(given: Mapping[str, str], *names: str) -> dict[str, bool]:
    """Return the arguments of these names that are given; an empty one leaves what the parameter file says."""
    return {name: is_true(given[name]) for name in names if given[name]}


def common(given: Mapping[str, str]) -> dict[str, Any]:
    """Return what every node is started with, from a launch file's arguments."""
    return {
        "package": "msls_ros",
        "namespace": given["namespace"],
        "output": "screen",
        "respawn": is_true(given["respawn"]),
        "ros_arguments": ["--log-level", given["log_level"]],
        "remappings": [("/clock", "clock")] if given["namespace"] else [],
    }


def parameter_files(given: Mapping[str, str]) -> list[str]:
    """Return the paths of the identifier's parameter files; `inputs` of another aircraft do not fit the profile f16."""
    profile = given["params_file"] or ("" if given["inputs"] else "f16")
    return [parameter_file(name) for name in (profile, given["inputs"]) if name]


def parameter_file(name: str) -> str:
    """Return the path of a parameter file: shipped, by its name, or anybody's."""
    if name.endswith((".yaml", ".yml")):
        return name
    config = Path(get_package_share_directory("msls_ros")) / "config"
    found = [config / folder / f"{name}.yaml" for folder in FOLDERS]
    return str(next((path for path in found if path.is_file()), found[0]))
