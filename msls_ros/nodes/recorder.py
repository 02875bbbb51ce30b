"""The recorder node: writes the topics, as they come over the wire, to a rosbag2 MCAP bag."""

from __future__ import annotations

import struct
from collections import Counter
from copy import copy
from functools import partial
from typing import Any

from msls_msgs.msg import (
    ControlStatus,
    DitherCommand,
    EffectorCommand,
    EffectorSample,
    FaultEvent,
    LinearModel,
    PilotCommand,
    StateSample,
)
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock as ClockMessage

from msls_ros.bags import BagWriter
from msls_ros.inputs import Refused
from msls_ros.nodes.parameters import declare_table, fixed, warn_of_unknown
from msls_ros.nodes.quality import overriding
from msls_ros.nodes.refusals import Refusals

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
    "pilot_command": PilotCommand,
    "control_status": ControlStatus,
}
FIXED_LAW = tuple(TOPICS)[:-2]
"""What there is without a controller."""
PARAMETERS = {
    "out": fixed("flight", "folder of the bag to write"),
    "overwrite": fixed(False, "replace a bag that exists"),
    "topics": fixed(list(FIXED_LAW), "topics to record", choices=TOPICS),
}
QUALITY = QoSProfile(depth=1000)
_SMALLEST = 12
"""Bytes of encapsulation and stamp."""


class RecorderNode(Node):
    """Record topics to a bag, stamped with the messages' own stamps.

    Parameters
    ----------
    **options
        As for `rclpy.node.Node`.

    Raises
    ------
    BagError, NodeError
        For a bag that cannot be written, or a parameter that is refused.
    """

    def __init__(self, name: str = "recorder", **options: Any) -> None:
        """Open the bag and subscribe to everything, undecoded."""
        super().__init__(name, **options)
        p = declare_table(self, PARAMETERS)
        warn_of_unknown(self)
        self._writer = BagWriter(p["out"], overwrite=p["overwrite"])
        self.counts: Counter[str] = Counter()
        """Messages written, by topic."""
        self._refusals = Refusals(self)
        self.refused = self._refusals.counts
        """Messages refused, by reason."""
        for topic in p["topics"]:
            resolved = self.resolve_topic_name(topic)
            kind = TOPICS[topic]
            msgtype = f"{kind.__module__.split('.')[0]}/msg/{kind.__name__}"
            self._writer.add_topic(resolved, msgtype)
            self.create_subscription(
                kind,
                topic,
                partial(self._write, topic, resolved, msgtype),
                copy(QUALITY),
                raw=True,
                qos_overriding_options=overriding(),
            )
        self.create_timer(0.5, self._writer.flush, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _write(self, topic: str, resolved: str, msgtype: str, data: bytes) -> None:
        """Write a message under the stamp that its header (or clock) begins with."""
        if len(data) < _SMALLEST or data[0] != 0 or data[1] > 1:
            text = f"{topic}: {len(data)} bytes; expected plain CDR that begins with a stamp, {_SMALLEST} or more"
            self._refusals.take(Refused("malformed", text))
            return
        seconds, nanoseconds = struct.unpack_from("<iI" if data[1] & 1 else ">iI", data, 4)
        if seconds < 0:
            self._refusals.take(Refused("stamp_negative", f"{topic}: stamp {seconds} s; a bag's stamps begin at 0"))
            return
        self._writer.write(resolved, msgtype, seconds * 1_000_000_000 + nanoseconds, data)
        self.counts[topic] += 1

    def destroy_node(self) -> None:
        """Close the bag, then the node."""
        try:
            self._writer.close()
        finally:
            super().destroy_node()
