"""Run one node as a process: spin until it is told to stop, end cleanly, exit with 0, or 2 for bad usage."""

from __future__ import annotations

import re
import signal
import sys
from collections.abc import Callable, Sequence

import rclpy
from rclpy._rclpy_pybind11 import RCLError
from rclpy.exceptions import ROSInterruptException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.logging import LoggingSeverity, get_logger_effective_level, set_logger_level
from rclpy.node import Node

from msls_ros.bags import BagError
from msls_ros.estimation import EstimationError
from msls_ros.nodes.parameters import NodeError
from msls_ros.plant import PlantError

BAD_INPUT = (NodeError, EstimationError, PlantError, BagError)
"""What the rooms raise for bad input, each with one sentence."""


def run_node(make: Callable[[], Node], arguments: Sequence[str] | None = None) -> int:
    """Make a node and spin it until Ctrl-C, shutdown, or its future ``finished`` is done.

    Parameters
    ----------
    make
        Builds the node, after rclpy is up.
    arguments
        Command line for ROS (``--ros-args ...``); None takes the process's own.

    Returns
    -------
    int
        Exit code: 0, or 2 with one line on stderr for bad usage or bad input.
    """
    level = get_logger_effective_level("rcl")
    set_logger_level("rcl", LoggingSeverity.FATAL)  # what it says of wrong arguments is in the exception, too
    try:
        rclpy.init(args=None if arguments is None else list(arguments))
    except (RCLError, ValueError) as error:
        text = re.sub(r"failed to initialize rcl: |, at \S+:\d+", "", str(error).splitlines()[0])
        print(f"msls_ros: {text}", file=sys.stderr)
        return 2
    set_logger_level("rcl", level)
    nodes: list[Node] = []
    executor = SingleThreadedExecutor()
    problems = []
    try:
        nodes.append(make())
        executor.add_node(nodes[0])
        _spin(executor, nodes[0])
    except BAD_INPUT as error:
        problems.append(error)
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        executor.shutdown()
        try:
            for node in nodes:
                node.destroy_node()
        except BAD_INPUT as error:
            problems.append(error)
        rclpy.try_shutdown()
    for problem in problems[:1]:
        print(f"msls_ros: {problem}", file=sys.stderr)
    return 2 if problems else 0


def _spin(executor: SingleThreadedExecutor, node: Node) -> None:
    """Spin until the node is finished or told to stop."""
    try:
        if hasattr(node, "finished"):
            executor.spin_until_future_complete(node.finished)
        else:
            executor.spin()
    except (KeyboardInterrupt, ExternalShutdownException, ROSInterruptException):
        return
    except RCLError:
        if rclpy.ok():
            raise
