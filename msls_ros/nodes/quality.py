"""Quality of service of the topics: reliable, with room for two seconds of samples."""

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
