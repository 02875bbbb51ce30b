"""Declares the identifier's parameters on a node from their one description, and reads them back."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import Parameter

from msls_ros.estimation import Configuration, EstimationError, from_mapping
from msls_ros.estimation.configuration import Bounds, items


def descriptor(bounds: Bounds, value: Any) -> ParameterDescriptor:
    """Describe a parameter: meaning, unit, range, and whether it may change in flight."""
    words = (
        f"one of {', '.join(bounds.choices)}"
        if bounds.choices
        else f"in [{bounds.low:g}, {bounds.high:g}] {bounds.unit}"
    )
    numeric = not isinstance(value, (bool, str)) and not (
        isinstance(value, tuple) and value and isinstance(value[0], str)
    )
    result = ParameterDescriptor(
        description=f"{bounds.description} [{bounds.unit}]",
        additional_constraints=words if bounds.choices or numeric else "",
        dynamic_typing=True,
    )
    finite = math.isfinite(bounds.low) and math.isfinite(bounds.high)
    if finite and isinstance(value, float):
        result.floating_point_range = [FloatingPointRange(from_value=bounds.low, to_value=bounds.high)]
    elif finite and isinstance(value, int) and not isinstance(value, bool):
        result.integer_range = [IntegerRange(from_value=int(bounds.low), to_value=int(bounds.high), step=1)]
    return result


def declare_configuration(node: Node) -> None:
    """Declare every parameter of `Configuration` on the node.

    Raises
    ------
    EstimationError
        For an override that is out of range.
    """
    for name, value, bounds in items(Configuration()):
        declare(node, name, list(value) if isinstance(value, tuple) else value, descriptor(bounds, value))


def declare(node: Node, name: str, value: Any, what: ParameterDescriptor) -> Any:
    """Declare one parameter and return its value; an override out of range raises EstimationError."""
    try:
        return node.declare_parameter(name, value, what).value
    except (InvalidParameterValueException, InvalidParameterTypeException) as error:
        message = f"parameter '{name}': {error}"
        raise EstimationError(message) from error


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


def declare_table(node: Node, table: Mapping[str, tuple[Any, str]]) -> dict[str, Any]:
    """Declare parameters given as ``name: (default, description)``; return their values by name.

    Raises
    ------
    EstimationError
        For an override of the wrong type.
    """
    return {
        name: declare(node, name, value, ParameterDescriptor(description=what, dynamic_typing=False))
        for name, (value, what) in table.items()
    }
