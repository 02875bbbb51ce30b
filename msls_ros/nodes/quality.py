"""Quality of service of the topics: nothing is lost on a healthy machine, and a slow reader does not stop the flight."""

from __future__ import annotations

from rclpy.qos import QoSDurabilityPolicy, QoSHistoryPolicy, QoSProfile, QoSReliabilityPolicy

INPUT = QoSProfile(
    history=QoSHistoryPolicy.KEEP_LAST,
    depth=100,
    reliability=QoSReliabilityPolicy.RELIABLE,
    durability=QoSDurabilityPolicy.VOLATILE,
)
"""Samples in: reliable, room for two seconds at 50 Hz."""

OUTPUT = INPUT
"""Models, events and dither out: the same."""
