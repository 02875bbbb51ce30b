"""The command line of a node: ``--help`` tells what it does and its parameters; all else goes to ROS."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from typing import Any

import rclpy
from rclpy.node import Node

from msls_ros.nodes.running import run_node


def run_or_help(name: str, kind: type[Node], arguments: Sequence[str]) -> int:
    """Run a node, or print its help; return the exit code.

    Parameters
    ----------
    name
        Of the executable.
    kind
        The node's class.
    arguments
        Of the command line, without the program's name.
    """
    if any(a in ("-h", "--help") for a in arguments):
        print(_help(name, kind))
        return 0
    if arguments and arguments[0] != "--ros-args":
        print(f"{name}: unknown argument '{arguments[0]}'; expected --ros-args ... or --help", file=sys.stderr)
        return 2
    return run_node(kind, [name, *arguments])


def _help(name: str, kind: Callable[..., Node]) -> str:
    about = (kind.__doc__ or "").split("\n\n")[0]
    lines = [
        f"usage: {name} [--ros-args [-p NAME:=VALUE] [--params-file FILE] [-r FROM:=TO] ...]",
        "",
        about,
        "",
        "parameters (default):",
    ]
    rclpy.init(args=[])
    options: dict[str, Any] = {"parameter_overrides": [rclpy.parameter.Parameter("autostart", value=False)]}
    try:
        node = kind(**options) if name in ("identifier", "plant") else kind()
        described = sorted((p for p in node._parameters if "." in p or p not in HIDDEN), key=lambda p: ("." in p, p))
        for parameter in described:
            what = node.describe_parameter(parameter)
            limits = f" ({what.additional_constraints})" if what.additional_constraints else ""
            lines.append(f"  {parameter}: {node.get_parameter(parameter).value!r}\n      {what.description}{limits}")
        node.destroy_node()
    finally:
        rclpy.try_shutdown()
    return "\n".join(lines)


HIDDEN = ("use_sim_time", "start_type_description_service")
