"""The identifier beside a flight-control stack: `ros2 launch msls_ros identifier.launch.py params_file:=mine.yaml`.

It configures and activates itself (`autostart`): no lifecycle plumbing is needed. Under a lifecycle manager
say `autostart:=false`.
"""

from __future__ import annotations

from typing import Any

from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch_ros.actions import Node

from launch import LaunchDescription
from msls_ros.nodes import launching

ARGUMENTS = {**launching.ARGUMENTS, "use_sim_time": ("", "time is that of /clock; empty: as the file says, else false")}


def generate_launch_description() -> LaunchDescription:
    """Return the arguments and the nodes."""
    declared = [DeclareLaunchArgument(n, default_value=d, description=about) for n, (d, about) in ARGUMENTS.items()]
    return LaunchDescription([*declared, OpaqueFunction(function=nodes)])


def nodes(context: Any) -> list[Node]:
    """Return the nodes, their arguments resolved."""
    given = context.launch_configurations
    common = launching.common(given)
    own = launching.switches(given, "autostart", "use_sim_time")
    files = launching.parameter_files(given)
    parameters = [*files, *([own] if own else [])]
    found = [Node(executable="identifier", name="identifier", parameters=parameters, **common)]
    if given["record"]:
        out = {"out": given["record"], **launching.switches(given, "use_sim_time")}
        found.append(Node(executable="recorder", name="recorder", parameters=[*files, out], **common))
    return found
