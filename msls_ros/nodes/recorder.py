"""The recorder node: writes the topics, as they come over the wire, to a rosbag2 MCAP bag."""

from __future__ import annotations

import struct
from collections import Counter
from functools import partial
from typing import Any

from msls_msgs.msg import DitherCommand, EffectorCommand, EffectorSample, FaultEvent, LinearModel, StateSample
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock as ClockMessage

from msls_ros.bags import BagError, BagWriter
from msls_ros.nodes.parameters import declare_table

TOPICS: dict[str, Any] = {
    "state": StateSample,
    "effectors": EffectorSample,
    "command": EffectorCommand,
    "dither": DitherCommand,
    "model": LinearModel,
    "fault": FaultEvent,
    "truth/state": StateSample,
    "truth/model": LinearModel,
    "/clock": ClockMessage,
}
PARAMETERS = {
    "out": ("flight", "folder of the bag to write; it must not exist"),
    "overwrite": (False, "replace a bag that exists"),
    "topics": (list(TOPICS), "topics to record"),
}
QUALITY = QoSProfile(depth=1000)


class RecorderNode(Node):
    """Record topics to a bag, stamped with the messages' own stamps.

    Parameters
    ----------
    **options
        As for `rclpy.node.Node`.

    Raises
    ------
    BagError, EstimationError
        For a bag that cannot be written, or a parameter that is refused.
    """

    def __init__(self, name: str = "recorder", **options: Any) -> None:
        """Open the bag and subscribe to everything, undecoded."""
        super().__init__(name, **options)
        p = declare_table(self, PARAMETERS)
        unknown = [t for t in p["topics"] if t not in TOPICS]
        if unknown:
            message = f"parameter 'topics' has '{unknown[0]}'; it must be among {', '.join(TOPICS)}"
            raise BagError(message)
        self._writer = BagWriter(p["out"], overwrite=p["overwrite"])
        self.counts: Counter[str] = Counter()
        """Messages written, by topic."""
        for topic in p["topics"]:
            resolved = self.resolve_topic_name(topic)
            kind = TOPICS[topic]
            msgtype = f"{kind.__module__.split('.')[0]}/msg/{kind.__name__}"
            self._writer.add_topic(resolved, msgtype)
            self.create_subscription(kind, topic, partial(self._write, topic, resolved, msgtype), QUALITY, raw=True)
        self.create_timer(0.5, self._writer.flush, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _write(self, topic: str, resolved: str, msgtype: str, data: bytes) -> None:
        """Write a message under the stamp that its header (or clock) begins with."""
        seconds, nanoseconds = struct.unpack_from("<iI" if data[1] & 1 else ">iI", data, 4)
        self._writer.write(resolved, msgtype, seconds * 1_000_000_000 + nanoseconds, data)
        self.counts[topic] += 1

    def destroy_node(self) -> None:
        """Close the bag, then the node."""
        self._writer.close()
        super().destroy_node()
