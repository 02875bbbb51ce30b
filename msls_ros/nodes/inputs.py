"""Inputs: our own messages undecoded, or any type through the section ``inputs`` of the parameters."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from functools import partial
from typing import Any

from msls_msgs.msg import EffectorSample, StateSample
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from msls_ros.bags import BagError, SampleDecoder
from msls_ros.inputs import InputMap, PairedSample, Synchronizer
from msls_ros.nodes.message_types import message_class
from msls_ros.nodes.parameters import plain
from msls_ros.nodes.quality import Refuse, listen, overriding

PREFIX = "inputs."
STATE, EFFECTORS = "state", "effectors"


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


class OwnInputs:
    """Our own messages, decoded by their layout: a fifth of what a general deserialiser takes.

    Parameters
    ----------
    gate
        Where they go.
    """

    def __init__(self, gate: Synchronizer) -> None:
        """Know no layout yet; see the class."""
        self._gate = gate
        self._decoders = {
            STATE: SampleDecoder("msls_msgs/msg/StateSample"),
            EFFECTORS: SampleDecoder("msls_msgs/msg/EffectorSample"),
        }

    def offer(self, topic: str, data: bytes) -> PairedSample | None:
        """Put a serialised message through the gate.

        Raises
        ------
        Refused
            As `Synchronizer.add_state`; also for bytes that are no message.
        """
        try:
            stamp, names, values, rates = self._decoders[topic].decode(data)
        except BagError as error:
            raise self._gate.refuse("malformed", str(error)) from error
        if topic == EFFECTORS:
            return self._gate.add_effectors(stamp, names, values)  # type: ignore[arg-type]
        return self._gate.add_state(stamp, names, values, () if rates is None else rates)  # type: ignore[arg-type]


def subscribe_own(node: Node, quality: QoSProfile, take: Callable[[str, bytes], None]) -> list[Subscription]:
    """Subscribe to our own messages, undecoded; ``take`` gets topic and bytes.

    The two of a sample are sent at once: after one the other is looked for, without another round of the executor.
    """
    made: dict[str, Subscription] = {}

    def both(topic: str, data: bytes) -> None:
        take(topic, data)
        other = STATE if topic == EFFECTORS else EFFECTORS
        found = made[other].handle.take_message(made[other].msg_type, True)
        if found is not None:
            take(other, found[0])

    for topic, kind in ((STATE, StateSample), (EFFECTORS, EffectorSample)):
        made[topic] = node.create_subscription(
            kind, topic, partial(both, topic), copy(quality), raw=True, qos_overriding_options=overriding()
        )
    return list(made.values())


def subscribe(
    node: Node, topics: dict[str, str], quality: QoSProfile, take: Callable[[str, Any], None], refuse: Refuse
) -> list[Subscription]:
    """Subscribe to topics, types by name; ``take`` gets the name and the message, ``refuse`` what is none.

    Raises
    ------
    NodeError
        If a type is not installed here.
    """
    classes = {topic: message_class(msgtype) for topic, msgtype in topics.items()}
    return [listen(node, c, topic, quality, partial(take, topic), refuse) for topic, c in classes.items()]
