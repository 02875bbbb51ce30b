"""The identifier beside a flight-control stack: `ros2 launch msls_ros identifier.launch.py params_file:=mine.yaml`.

It configures and activates itself (`autostart`): no lifecycle plumbing is needed. Under a lifecycle manager
say `autostart:=false`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch_ros.actions import Node

from launch import LaunchDescription

ARGUMENTS = {
    "namespace": ("", "of all nodes and topics; with one, the clock is the namespace's own, NAMESPACE/clock"),
    "params_file": ("f16", "parameters: a shipped profile's name, or the path of a YAML file"),
    "inputs": ("", "parameters of other message types: a shipped name, as px4_odometry, or a path; empty: msls_msgs"),
    "autostart": ("true", "configure and activate at the start; false: a lifecycle manager does it"),
    "respawn": ("false", "start again when it ends unasked"),
    "log_level": ("info", "debug, info, warn, error or fatal"),
    "use_sim_time": ("false", "time is that of /clock"),
    "record": ("", "folder of a bag to record everything into; empty: none"),
}


def generate_launch_description() -> LaunchDescription:
    """Return the arguments and the nodes."""
    declared = [DeclareLaunchArgument(n, default_value=d, description=about) for n, (d, about) in ARGUMENTS.items()]
    return LaunchDescription([*declared, OpaqueFunction(function=nodes)])


def nodes(context: Any) -> list[Node]:
    """Return the nodes, their arguments resolved."""
    given = context.launch_configurations
    sim_time = given["use_sim_time"].lower() == "true"
    common: dict[str, Any] = {
        "package": "msls_ros",
        "namespace": given["namespace"],
        "output": "screen",
        "respawn": given["respawn"].lower() == "true",
        "ros_arguments": ["--log-level", given["log_level"]],
        "remappings": [("/clock", "clock")] if given["namespace"] else [],
    }
    files = [parameter_file(given["params_file"])]
    if given["inputs"]:
        files.append(parameter_file(given["inputs"]))
    own = {"autostart": given["autostart"].lower() == "true", "use_sim_time": sim_time}
    found = [Node(executable="identifier", name="identifier", parameters=[*files, own], **common)]
    if given["record"]:
        found.append(Node(executable="recorder", name="recorder", parameters=[{"out": given["record"]}], **common))
    return found


def parameter_file(name: str) -> str:
    """Return the path of a parameter file: shipped, by its name, or anybody's."""
    if name.endswith((".yaml", ".yml")):
        return name
    config = Path(get_package_share_directory("msls_ros")) / "config"
    found = [config / f"{name}.yaml", config / "inputs" / f"{name}.yaml"]
    return str(next((path for path in found if path.is_file()), found[0]))
