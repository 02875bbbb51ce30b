"""Quality of service of the topics: our own are reliable, with room for two seconds of samples."""

from __future__ import annotations

from rclpy.qos import QoSDurabilityPolicy, QoSHistoryPolicy, QoSProfile, QoSReliabilityPolicy

INPUT = QoSProfile(
    history=QoSHistoryPolicy.KEEP_LAST,
    depth=100,
    reliability=QoSReliabilityPolicy.RELIABLE,
    durability=QoSDurabilityPolicy.VOLATILE,
)
"""Samples in: reliable, room for two seconds at 50 Hz."""

FOREIGN_INPUT = QoSProfile(
    history=QoSHistoryPolicy.KEEP_LAST,
    depth=400,
    reliability=QoSReliabilityPolicy.BEST_EFFORT,
    durability=QoSDurabilityPolicy.VOLATILE,
)
"""Other stacks' messages: best effort, which publishers of either kind match; room for a second at 400 Hz."""

OUTPUT = INPUT
"""Models, events and dither out: the same."""
