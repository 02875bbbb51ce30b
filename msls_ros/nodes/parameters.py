"""Parameters of the nodes: a table says default, meaning, unit and range; nodes declare from it, the help prints it."""

from __future__ import annotations

import math
from collections.abc import Container, Iterable, Mapping, Sequence
from itertools import pairwise
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter

from msls_ros.estimation import Configuration, from_mapping
from msls_ros.estimation.configuration import items
from msls_ros.estimation.errors import nearest
from msls_ros.estimation.sections import Bounds
from msls_ros.inputs.profiles import matches_node

Table = Mapping[str, tuple[Any, Bounds]]
"""Default and bounds by name."""
KINDS: Mapping[type, str] = {
    bool: "true or false",
    str: "a word",
    int: "a whole number",
    float: "a number",
    list: "a list of words",
    tuple: "a list of numbers",
}
"""What a parameter must be, by the type of its default."""
QUALITY = "qos_overrides."
"""What ROS's own parameters of a topic's quality of service begin with."""
LOOK = 0.1
"""How often it is looked whether the topics are made, where their quality of service is given [s]."""


class NodeError(ValueError):
    """A node was given a parameter that it cannot use: one sentence, what was found and what was expected."""


def fixed(
    default: Any,
    description: str,
    unit: str = "1",
    low: float = -math.inf,
    high: float = math.inf,
    choices: Iterable[str] = (),
) -> tuple[Any, Bounds]:
    """Return an entry of a `Table` for a parameter that is set at the start only."""
    return default, Bounds(description, unit, low, high, tuple(choices), in_flight=False)


def configuration_table() -> Table:
    """Return the parameters of `Configuration` as a table."""
    return {name: (value, bounds) for name, value, bounds in items(Configuration())}


def constraint(bounds: Bounds, default: Any) -> str:
    """Say what is allowed; empty where there is no limit."""
    if bounds.choices:
        return f"one of {', '.join(bounds.choices)}"
    first = default[0] if isinstance(default, (tuple, list)) and default else default
    limited = math.isfinite(bounds.low) or math.isfinite(bounds.high)
    if isinstance(first, (bool, str)) or not limited:
        return ""
    return f"{bounds.low:g} to {bounds.high:g}"


def descriptor(bounds: Bounds, default: Any, read_only: bool) -> ParameterDescriptor:
    """Describe a parameter: meaning, unit, range, and whether it may change in flight."""
    number = isinstance(default, (int, float)) and not isinstance(default, bool)
    listed = isinstance(default, (tuple, list)) and not any(isinstance(v, str) for v in default)
    result = ParameterDescriptor(
        description=bounds.description + (f" [{bounds.unit}]" if bounds.unit and (number or listed) else ""),
        additional_constraints="; ".join(
            t for t in (constraint(bounds, default), "" if bounds.in_flight else "fixed at the start") if t
        ),
        dynamic_typing=True,
        read_only=read_only,
    )
    if number and math.isfinite(bounds.low) and math.isfinite(bounds.high):
        if isinstance(default, float):
            result.floating_point_range = [FloatingPointRange(from_value=bounds.low, to_value=bounds.high)]
        else:
            result.integer_range = [IntegerRange(from_value=int(bounds.low), to_value=int(bounds.high), step=1)]
    return result


def declare_configuration(node: Node) -> Configuration:
    """Declare every parameter of `Configuration` on the node; return what they say.

    Raises
    ------
    EstimationError
        For a value that is refused.
    """
    table = configuration_table()
    _declare(node, table)
    configuration = read_configuration(node)
    for name, (value, bounds) in table.items():
        node.set_descriptor(name, descriptor(bounds, value, read_only=False))
    node.add_pre_set_parameters_callback(lambda changes: [_in_type_of(p, table) for p in changes])
    return configuration


def read_configuration(node: Node, changes: Iterable[Parameter] = ()) -> Configuration:
    """Build the configuration from the node's parameters, with some of them changed.

    Raises
    ------
    EstimationError
        For a value that is refused.
    """
    names = [name for name, _, _ in items(Configuration())]
    found = {p.name: plain(p) for p in node.get_parameters(names)}
    found.update({p.name: plain(p) for p in changes if p.name in found})
    return from_mapping(found)


def plain(parameter: Parameter) -> Any:
    """Return a parameter's value as Python's own type; a list without elements as ``[]``."""
    value = parameter.value
    if isinstance(value, (str, bool, int, float)):
        return value
    return [] if value is None or len(value) == 0 else list(value)


def declare_table(node: Node, table: Table) -> dict[str, Any]:
    """Declare parameters, read-only where they are fixed at the start; return their values by name.

    Raises
    ------
    NodeError
        For a value of the wrong type or out of range.
    """
    _declare(node, table)
    values = {}
    for name, (default, bounds) in table.items():
        values[name] = checked(name, plain(node.get_parameter(name)), default, bounds)
        node.set_descriptor(name, descriptor(bounds, default, read_only=not bounds.in_flight))
    return values


def warn_of_unknown(node: Node, table: Table, others: Container[str] = (), groups: tuple[str, ...] = ()) -> None:
    """Log the parameters that were given at the start but that the node does not have: ROS ignores them silently.

    Called before any is declared: a value that is refused as another parameter's name is misspelt comes after that.

    Parameters
    ----------
    node
        Its own parameters are those of ROS, and of quality of service: these exist once the topics do, in a managed
        node only when it has been configured, and are looked at then, once.
    table
        What it is going to declare.
    others
        Names of another node's parameters in the same file, which are not missed.
    groups
        What names begin with that are looked at elsewhere.
    """
    qualities = [name for name in node._parameter_overrides if name.startswith(QUALITY)]
    known = [*(name for name in node._parameters if not name.startswith(QUALITY)), *table]
    for name in node._parameter_overrides:
        if name not in known and name not in qualities and name not in others and not name.startswith(groups):
            near = nearest(name, known)
            text = f"parameter '{name}' does not exist and is ignored{near}{' ' if near else '; '}--help lists all"
            node.get_logger().warning(text)
    if not qualities:
        return

    def look() -> None:
        known = [name for name in node._parameters if name.startswith(QUALITY)]
        if known:
            node.destroy_timer(timer)
            _warn_of_quality(node, qualities, known)

    timer = node.create_timer(LOOK, look, clock=Clock(clock_type=ClockType.STEADY_TIME))


def _warn_of_quality(node: Node, given: Iterable[str], known: Sequence[str]) -> None:
    """Log what is given for topics that the node does not have; a topic's name is the resolved one, with namespace."""
    ends = ", ".join(sorted({name[len(QUALITY) :].rpartition(".")[0] for name in known}))
    policies = ", ".join(sorted({name.rpartition(".")[2] for name in known}))
    for name in given:
        if name not in known:
            near = nearest(name, known)
            there = f"{near} There are" if near else "; there are"
            text = f"parameter '{name}' does not exist and is ignored{there} {policies} of {ends}"
            node.get_logger().warning(text)


def check_files(node: Node, arguments: Sequence[str]) -> None:
    """Log each parameter file of a command line in which nothing is meant for the node: ROS ignores it silently."""
    name = node.get_fully_qualified_name()
    for flag, path in pairwise(arguments):
        if flag == "--params-file" and not matches_node(path, name):
            text = f"parameter file '{path}' has nothing for this node, {name}, and is ignored; expected a section "
            node.get_logger().warning(f"{text}'/**:' or '{name}:' with 'ros__parameters:'")


def checked(name: str, value: Any, default: Any, bounds: Bounds) -> Any:
    """Return a value in the type of its default.

    Raises
    ------
    NodeError
        For a value of the wrong type or out of range.
    """
    if isinstance(default, float) and type(value) is int:
        value = float(value)
    if isinstance(default, tuple) and isinstance(value, list) and all(type(v) in (int, float) for v in value):
        value = tuple(float(v) for v in value)
    same = type(value) is type(default)
    if not same or (isinstance(value, list) and not all(isinstance(v, str) for v in value)):
        message = f"parameter '{name}' is {value!r}; it must be {KINDS[type(default)]}"
        raise NodeError(message)
    if isinstance(value, (int, float, tuple)) and not isinstance(value, bool):
        numbers = value if isinstance(value, tuple) else (value,)
        good = all(math.isfinite(v) and bounds.low <= v <= bounds.high for v in numbers)
    else:
        good = not bounds.choices or all(v in bounds.choices for v in (value if isinstance(value, list) else [value]))
    if not good:
        unit = "" if bounds.choices or bounds.unit == "1" else f" {bounds.unit}"
        expected = f"{constraint(bounds, default) or 'a finite number'}{unit}"
        message = f"parameter '{name}' is {value!r}; it must be {expected}"
        raise NodeError(message)
    return value


def _declare(node: Node, table: Table) -> None:
    """Declare with any type and range, so that what is wrong is refused by us, in one sentence."""
    for name, (value, _) in table.items():
        default = list(value) if isinstance(value, tuple) else value
        node.declare_parameter(name, default, ParameterDescriptor(dynamic_typing=True))
    given = node.get_parameters(list(table))
    node.set_parameters([p for before in given if (p := _in_type_of(before, table)) is not before])


def _in_type_of(parameter: Parameter, table: Table) -> Parameter:
    """Return a parameter in the type of its default: 1 for a number is 1.0, and an empty list has its type too."""
    if parameter.name not in table:
        return parameter
    default, value = table[parameter.name][0], plain(parameter)
    if isinstance(default, float) and type(value) is int:
        return Parameter(parameter.name, Parameter.Type.DOUBLE, float(value))
    if isinstance(default, (tuple, list)) and isinstance(value, list):
        words = isinstance(default, list) or any(isinstance(v, str) for v in default)
        if words and not value:
            return Parameter(parameter.name, Parameter.Type.STRING_ARRAY, [])
        if not words and all(type(v) in (int, float) for v in value) and parameter.type_ != Parameter.Type.DOUBLE_ARRAY:
            return Parameter(parameter.name, Parameter.Type.DOUBLE_ARRAY, [float(v) for v in value])
    return parameter
