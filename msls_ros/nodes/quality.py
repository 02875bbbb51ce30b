"""Quality of service of the topics: our own are reliable; queues hold as much time as a sample is of use.

What an identifier has found, `model` and `fault`, is latched. Those who act ask for nothing that is past: an alarm of
long ago has no place in a law that begins now, and a dither none anywhere; nor does a recorder, whose bag holds what
was published while it was recorded.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from copy import copy
from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSDurabilityPolicy, QoSHistoryPolicy, QoSProfile, QoSReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription

from msls_ros.inputs import Refused

Refuse = Callable[[Refused], object]
LEAST, MOST = 10, 10_000
"""Depth of a queue [messages]."""


def reliable(depth: int) -> QoSProfile:
    """Return reliable quality of service that keeps the newest messages, as many as that."""
    return QoSProfile(
        history=QoSHistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=QoSReliabilityPolicy.RELIABLE,
        durability=QoSDurabilityPolicy.VOLATILE,
    )


def latched(depth: int) -> QoSProfile:
    """Return reliable quality of service that gives the newest messages also to whoever asks for them and joins late.

    Of a publisher: subscriptions that are volatile match it, and get what comes from then on.
    """
    quality = reliable(depth)
    quality.durability = QoSDurabilityPolicy.TRANSIENT_LOCAL
    return quality


def best_effort(depth: int) -> QoSProfile:
    """Return best-effort quality of service, which publishers of either kind match."""
    return QoSProfile(
        history=QoSHistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=QoSReliabilityPolicy.BEST_EFFORT,
        durability=QoSDurabilityPolicy.VOLATILE,
    )


def depth_of(seconds: float, rate: float) -> int:
    """Return how many messages a queue holds.

    Parameters
    ----------
    seconds
        What it is to hold; at a backlog what is older is dropped [s].
    rate
        Of the messages [Hz].
    """
    return min(max(math.ceil(seconds * rate), LEAST), MOST)


def overriding() -> QoSOverridingOptions:
    """Return ROS's own options: parameters ``qos_overrides.TOPIC.*`` change history, depth and reliability."""
    return QoSOverridingOptions.with_default_policies()


def publish(node: Node, kind: type[Any], topic: str, quality: QoSProfile) -> Publisher:
    """Make a publisher whose quality of service a user may override."""
    return node.create_publisher(kind, topic, copy(quality), qos_overriding_options=overriding())


def decoded(data: bytes, kind: type[Any], topic: str) -> Any:
    """Return the message that bytes are.

    Raises
    ------
    Refused
        If they are none of that kind.
    """
    try:
        return deserialize_message(data, kind)
    except Exception as error:  # whatever the type support says of bytes that are none of its messages
        text = f"{topic}: {len(data)} bytes are no {kind.__name__}: {str(error).partition(', at ')[0]}"
        raise Refused("malformed", text) from error


def listen(
    node: Node, kind: type[Any], topic: str, quality: QoSProfile, take: Callable[[Any], None], refuse: Refuse
) -> Subscription:
    """Subscribe to a topic whose quality of service a user may override; what cannot be decoded is refused and counted.

    The middleware would drop such bytes without a word.

    Parameters
    ----------
    node
        Who listens.
    kind, topic
        Of the messages.
    quality
        Before a user's overriding.
    take
        Gets the messages.
    refuse
        Told of the others.
    """

    def decode(data: bytes) -> None:
        try:
            message = decoded(data, kind, topic)
        except Refused as refused:
            refuse(refused)
        else:
            take(message)

    return node.create_subscription(kind, topic, decode, copy(quality), raw=True, qos_overriding_options=overriding())


INPUT = reliable(100)
"""Room for two seconds at 50 Hz."""
EVENTS = 100
"""Fault events that are latched."""
OUTPUT = INPUT
"""Models, events and dither out: the same."""
