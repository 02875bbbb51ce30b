"""A simulated F-16 in closed loop: `ros2 launch msls_ros closed_loop.launch.py duration:=20.0 record:=flight`."""

from __future__ import annotations

from typing import Any

from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch_ros.actions import Node

from launch import LaunchDescription
from msls_ros.nodes import launching

ARGUMENTS = {
    **launching.ARGUMENTS,
    "condition": ("high_alpha", "flight condition: high_alpha or cruise"),
    "manoeuvre": ("roll_doublet", "what the pilot flies"),
    "noise": ("low", "sensor noise: none, low or med"),
    "mode": ("real_time", "real_time: wall clock; lockstep: as fast as the answers come"),
    "duration": ("0.0", "flight time after which everything ends [s]; 0: never"),
    "use_sim_time": ("true", "time of the identifier is the plant's clock; empty: as the file says, else false"),
    "law": ("fixed", "control law: fixed (the pilot's own), or indi, lq, auto: then a controller flies between"),
}
TOPICS = ("state", "effectors", "command", "dither", "model", "fault", "truth/state", "truth/model", "/clock")
"""What is recorded without a controller."""


def generate_launch_description() -> LaunchDescription:
    """Return the arguments and the nodes."""
    declared = [DeclareLaunchArgument(n, default_value=d, description=about) for n, (d, about) in ARGUMENTS.items()]
    return LaunchDescription([*declared, OpaqueFunction(function=nodes)])


def nodes(context: Any) -> list[Node]:
    """Return the nodes, their arguments resolved."""
    given = context.launch_configurations
    common = launching.common(given)
    files = launching.parameter_files(given)
    own = launching.switches(given, "autostart", "use_sim_time")
    own["lockstep"] = given["mode"] == "lockstep"
    asks = given["law"] != "fixed"
    plant = {name: given[name] for name in ("condition", "noise", "mode")}
    found = [
        Node(executable="identifier", name="identifier", parameters=[*files, own], **common),
        Node(
            executable="pilot",
            name="pilot",
            parameters=[{**{name: given[name] for name in ("condition", "manoeuvre")}, "ask": asks}],
            **common,
        ),
        Node(
            executable="plant",
            name="plant",
            parameters=[{**plant, "duration": float(given["duration"])}],
            on_exit=[] if common["respawn"] else [Shutdown(reason="the flight is over")],
            **common,
        ),
    ]
    if asks:
        law = {**{name: given[name] for name in ("law", "condition")}, **own}
        found.append(Node(executable="controller", name="controller", parameters=[law], **common))
    if given["record"]:
        recorded: dict[str, Any] = {"out": given["record"]}
        if asks:
            recorded["topics"] = [*TOPICS, "pilot_command", "control_status"]
        found.append(Node(executable="recorder", name="recorder", parameters=[*files, recorded], **common))
    return found
