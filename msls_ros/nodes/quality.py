"""Quality of service of the topics: our own are reliable; queues hold as much time as a sample is of use."""

from __future__ import annotations

import math

from rclpy.qos import QoSDurabilityPolicy, QoSHistoryPolicy, QoSProfile, QoSReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions

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


INPUT = reliable(100)
"""Room for two seconds at 50 Hz."""
OUTPUT = INPUT
"""Models, events and dither out: the same."""
