"""Run one node as a process: spin until it is told to stop, end cleanly, exit with 0, or 2 for bad usage."""

from __future__ import annotations

import gc
import re
import sys
from collections.abc import Callable, Sequence
from contextlib import ExitStack

import rclpy
from rclpy._rclpy_pybind11 import RCLError, UnknownROSArgsError
from rclpy.exceptions import ROSInterruptException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.logging import LoggingSeverity, get_logger_effective_level, set_logger_level
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from msls_ros.estimation import EstimationError
from msls_ros.nodes.parameters import NodeError, check_files
from msls_ros.nodes.stopping import Stopping

ERRORS = {"msls_ros.plant": "PlantError", "msls_ros.bags": "BagError"}
"""What rooms raise for bad input that not every node imports."""


def bad_input() -> tuple[type[Exception], ...]:
    """Return what may be raised for bad input, each with one sentence: of the rooms that have been imported."""
    rooms = [getattr(sys.modules[room], error) for room, error in ERRORS.items() if room in sys.modules]
    return (NodeError, EstimationError, *rooms)


def run_node(make: Callable[[], Node], arguments: Sequence[str], stopping: Stopping | None = None) -> int:
    """Make a node and spin it until Ctrl-C, SIGTERM, shutdown, or its future ``finished`` is done.

    Parameters
    ----------
    make
        Builds the node, after rclpy is up. Where it has a method ``say_goodbye`` that is called before the end.
    arguments
        Command line for ROS (``--ros-args ...``).
    stopping
        Where the signals have been taken already; None: here.

    Returns
    -------
    int
        Exit code: 0, or 2 with one line on stderr for bad usage or bad input.
    """
    with ExitStack() as stack:
        stopping = stopping or stack.enter_context(Stopping())
        return _run(make, arguments, stopping)


def _run(make: Callable[[], Node], arguments: Sequence[str], stopping: Stopping) -> int:
    level = get_logger_effective_level("rcl")
    set_logger_level("rcl", LoggingSeverity.FATAL)  # what it says of wrong arguments is in the exception, too
    try:
        rclpy.init(args=list(arguments), signal_handler_options=SignalHandlerOptions.NO)
    except UnknownROSArgsError as error:
        unknown = " ".join(re.findall(r"'([^']*)'", str(error))) or str(error)
        print(
            f"msls_ros: ROS does not know '{unknown}'; expected options after --ros-args as in --help", file=sys.stderr
        )
        return 2
    except (RCLError, ValueError) as error:
        text = re.sub(r"failed to initialize rcl: |, at \S+:\d+", "", str(error).splitlines()[0])
        print(f"msls_ros: {text}", file=sys.stderr)
        return 2
    set_logger_level("rcl", level)
    nodes: list[Node] = []
    executor = SingleThreadedExecutor()
    problems: list[Exception] = []
    try:
        nodes.append(make())
        check_files(nodes[0], arguments)
        gc.collect()
        gc.freeze()  # what is here now stays: looking through it again would take 100 ms in flight
        executor.add_node(nodes[0])
        _spin(executor, nodes[0], stopping)
    except bad_input() as error:
        problems.append(error)
    finally:
        stopping.wake_with(lambda: None)
        executor.shutdown()
        try:
            for node in nodes:
                node.destroy_node()
        except bad_input() as error:
            problems.append(error)
        rclpy.try_shutdown()
    for problem in problems[:1]:
        print(f"msls_ros: {problem}", file=sys.stderr)
    return 2 if problems else 0


def _spin(executor: SingleThreadedExecutor, node: Node, stopping: Stopping) -> None:
    """Spin until the node is finished or told to stop; let it say goodbye."""
    guard = node.create_guard_condition(lambda: None)  # the wake of an executor alone does not end its wait
    stopping.wake_with(guard.trigger)
    finished = getattr(node, "finished", None)
    if finished is not None:
        finished.add_done_callback(lambda _: guard.trigger())
    try:
        while not stopping.asked and not (finished is not None and finished.done()) and rclpy.ok():
            executor.spin_once()
        if rclpy.ok() and hasattr(node, "say_goodbye"):
            node.say_goodbye()
    except (KeyboardInterrupt, ExternalShutdownException, ROSInterruptException):
        return
    except RCLError:
        if rclpy.ok():
            raise
