"""Inputs of any message type: the section ``inputs`` of the parameters, and subscriptions to what it names."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from functools import partial
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node
from rclpy.subscription import Subscription

from msls_ros.inputs import InputMap
from msls_ros.nodes.parameters import NodeError, plain
from msls_ros.nodes.quality import FOREIGN_INPUT

PREFIX = "inputs."


def declare_inputs(node: Node) -> InputMap | None:
    """Declare what was given under ``inputs``, fixed at the start; None: nothing was.

    Raises
    ------
    EstimationError
        For an entry that is refused.
    """
    names = [name for name in node._parameter_overrides if name.startswith(PREFIX)]
    if not names:
        return None
    about = "inputs of other message types; see config/inputs/odometry_jointstate.yaml"
    for name in names:
        node.declare_parameter(name, None, ParameterDescriptor(description=about, dynamic_typing=True))
        node.set_descriptor(name, ParameterDescriptor(description=about, dynamic_typing=True, read_only=True))
    return InputMap.from_parameters({name[len(PREFIX) :]: plain(node.get_parameter(name)) for name in names})


def subscribe(node: Node, topics: dict[str, str], take: Callable[[str, Any], None]) -> list[Subscription]:
    """Subscribe to topics, types by name; ``take`` gets the name and the message.

    Raises
    ------
    NodeError
        If a type is not installed here.
    """
    classes = {topic: _message_class(msgtype) for topic, msgtype in topics.items()}
    return [node.create_subscription(c, topic, partial(take, topic), FOREIGN_INPUT) for topic, c in classes.items()]


def _message_class(msgtype: str) -> type[Any]:
    package, _, name = msgtype.split("/")
    try:
        found: type[Any] = getattr(importlib.import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError):
        message = f"the type {msgtype} is not installed: source the workspace that builds the package {package}"
        raise NodeError(message) from None
    return found
