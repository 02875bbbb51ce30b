"""The command line of a node: ``--help`` prints what it does and its parameters; everything else goes to ROS."""

from __future__ import annotations

import sys
import textwrap
from collections.abc import Sequence

import msls_ros.messages  # noqa: F401  first of what needs msls_msgs: says what to do where that is not built

# isort: split
from rclpy.node import Node

from msls_ros.nodes.parameters import Table, descriptor
from msls_ros.nodes.running import run_node
from msls_ros.nodes.stopping import Stopping

WIDTH = 110


def run_or_help(
    name: str, kind: type[Node], table: Table, arguments: Sequence[str], stopping: Stopping | None = None
) -> int:
    """Run a node, or print its help; return the exit code.

    Parameters
    ----------
    name
        Of the executable.
    kind
        The node's class.
    table
        Its parameters.
    arguments
        Of the command line, without the program's name.
    stopping
        Where the signals have been taken already.
    """
    if any(a in ("-h", "--help") for a in arguments):
        print(_help(name, kind, table))
        return 0
    if arguments and arguments[0] != "--ros-args":
        print(f"{name}: unknown argument '{arguments[0]}'; expected --ros-args ... or --help", file=sys.stderr)
        return 2
    return run_node(kind, [name, *arguments], stopping)


def _help(name: str, kind: type[Node], table: Table) -> str:
    lines = [
        f"usage: {name} [--ros-args [-p NAME:=VALUE] [--params-file FILE] [-r FROM:=TO] ...]",
        "",
        (kind.__doc__ or "").split("\n\n")[0],
        "",
        "parameters (default):",
    ]
    for parameter, (default, bounds) in table.items():
        value = list(default) if isinstance(default, tuple) else default
        what = descriptor(bounds, default, read_only=False)
        limits = f" ({what.additional_constraints})" if what.additional_constraints else ""
        lines.append(f"  {parameter}: {value!r}")
        lines += textwrap.wrap(f"{what.description}{limits}", WIDTH, initial_indent=" " * 6, subsequent_indent=" " * 6)
    return "\n".join(lines)
