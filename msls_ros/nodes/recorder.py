"""The recorder node: writes the topics, as they come over the wire, to a rosbag2 MCAP bag.

Given the identifier's parameter file it records the topics that the identifier takes its inputs from, whatever their
type, and keeps the parameters beside the bag: `replay` then identifies from it what the identifier did.
"""

from __future__ import annotations

import struct
from collections import Counter
from copy import copy
from functools import partial
from pathlib import Path
from shutil import copyfile
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

from msls_ros.bags import BagWriter, Qos
from msls_ros.bags.writer import LAST_STAMP
from msls_ros.estimation import EstimationError, from_mapping
from msls_ros.inputs import InputMap, Refused
from msls_ros.inputs.input_map import TopicInput
from msls_ros.inputs.profiles import BESIDE_A_BAG, MODEL_BESIDE, OTHER, render_parameters, warm_start_of
from msls_ros.nodes.inputs import PREFIX, declare_inputs
from msls_ros.nodes.message_types import message_class, type_of
from msls_ros.nodes.parameters import configuration_table, declare_table, fixed, plain, warn_of_unknown
from msls_ros.nodes.quality import best_effort, decoded, overriding
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
INPUTS = ("state", "effectors")
"""What `inputs.*` stands in for."""
PARAMETERS = {
    "out": fixed("flight", "folder of the bag to write"),
    "overwrite": fixed(False, "replace a bag that exists"),
    "topics": fixed(list(FIXED_LAW), "topics to record; with inputs.*, state and effectors are not", choices=TOPICS),
}
LATCHED = ("model", "fault")
"""Topics that an identifier publishes for who joins later too; who plays the bag does the same."""
QUALITY = QoSProfile(depth=1000)
_SMALLEST = 12
"""Bytes of encapsulation and stamp."""


class RecorderNode(Node):
    """Record topics to a bag, stamped with the messages' own stamps.

    With parameters `inputs.*`, as the identifier has them, it records those topics instead of `state` and `effectors`.

    Parameters
    ----------
    **options
        As for `rclpy.node.Node`.

    Raises
    ------
    BagError, EstimationError, NodeError
        For a bag that cannot be written, or a parameter that is refused.
    """

    def __init__(self, name: str = "recorder", **options: Any) -> None:
        """Open the bag and subscribe to everything, undecoded."""
        super().__init__(name, **options)
        warn_of_unknown(self, PARAMETERS, {*configuration_table(), *OTHER}, (PREFIX,))
        p = declare_table(self, PARAMETERS)
        inputs = declare_inputs(self)
        kept = self._identifier_parameters(inputs)
        sources = [] if inputs is None else [(s, message_class(s.msgtype)) for s in inputs.topics.values()]
        self._writer = BagWriter(p["out"], overwrite=p["overwrite"])
        self.counts: Counter[str] = Counter()
        """Messages written, by topic."""
        self._refusals = Refusals(self)
        self.refused = self._refusals.counts
        """Messages refused, by reason."""
        if kept:
            self._keep_beside(Path(p["out"]), kept)
        mapped = {self.resolve_topic_name(source.topic) for source, _ in sources}
        for topic in p["topics"]:
            if not (mapped and topic in INPUTS) and self.resolve_topic_name(topic) not in mapped:
                self._record(topic, TOPICS[topic], copy(QUALITY))
        for source, kind in sources:
            plain_stamp = _begins_with_stamp(kind, source)
            self._record(source.topic, kind, best_effort(QUALITY.depth), None if plain_stamp else source)
        count = len(self._writer.counts)
        self.get_logger().info(f"recording {count} topics to '{p['out']}'")
        self.create_timer(0.5, self._writer.flush, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _identifier_parameters(self, inputs: InputMap | None) -> str:
        """Return the text of the identifier's parameters that were given, topics by their names in the bag."""
        given = {name: plain(p) for name, p in self._parameter_overrides.items()}
        own = {name: value for name, value in given.items() if name in configuration_table()}
        model = self._warm_start()
        if not own and inputs is None and model is None:
            return ""
        entries = {name[len(PREFIX) :]: value for name, value in given.items() if name.startswith(PREFIX)}
        for alias, source in inputs.topics.items() if inputs is not None else ():
            name = f"topics.{alias}"
            entries[name] = entries[name].replace(source.topic, self.resolve_topic_name(source.topic), 1)
        return render_parameters(
            from_mapping(own), entries, "The identifier's parameters, as the recorder was given them.", model
        )

    def _warm_start(self) -> Path | None:
        """Return the saved model that the identifier starts from, wherever `replay` runs; None: there is none."""
        given = {name: plain(p) for name, p in self._parameter_overrides.items()}
        model = warm_start_of(given, "the recorder")
        return None if model is None else model.absolute()

    def _keep_beside(self, bag: Path, parameters: str) -> None:
        """Write the identifier's parameters into the bag's folder, with a copy of the model that it starts from."""
        (bag / BESIDE_A_BAG).write_text(parameters, encoding="utf-8")
        model = self._warm_start()
        try:
            if model is not None:
                copyfile(model, bag / MODEL_BESIDE)
        except OSError as error:
            text = f"warm_start: the model '{model}' cannot be kept beside the bag: {error.strerror}"
            self.get_logger().warning(text)

    def _record(self, topic: str, kind: Any, quality: QoSProfile, source: TopicInput | None = None) -> None:
        """Subscribe to a topic; stamps are those at the beginning of the messages, or where a source says."""
        resolved, msgtype = self.resolve_topic_name(topic), type_of(kind)
        self._writer.add_topic(resolved, msgtype, qos=Qos(transient_local=topic in LATCHED))
        take = partial(self._write, topic, resolved, msgtype)
        if source is not None:
            take = partial(self._write_mapped, source, kind, resolved)
        self.create_subscription(kind, topic, take, quality, raw=True, qos_overriding_options=overriding())

    def _write_mapped(self, source: TopicInput, kind: Any, resolved: str, data: bytes) -> None:
        """Write a message under the stamp that the identifier takes: of any field, or its arrival."""
        try:
            stamp = source.instant(self.get_clock().now().nanoseconds, decoded(data, kind, source.topic))
        except EstimationError as error:
            self._refusals.take(Refused("field", str(error)))
        except Refused as refused:
            self._refusals.take(refused)
        else:
            self._keep(source.topic, resolved, source.msgtype, stamp, data)

    def _write(self, topic: str, resolved: str, msgtype: str, data: bytes) -> None:
        """Write a message under the stamp that its header (or clock) begins with."""
        if len(data) < _SMALLEST or data[0] != 0 or data[1] > 1:
            text = f"{topic}: {len(data)} bytes; expected plain CDR that begins with a stamp, {_SMALLEST} or more"
            self._refusals.take(Refused("malformed", text))
            return
        seconds, nanoseconds = struct.unpack_from("<iI" if data[1] & 1 else ">iI", data, 4)
        self._keep(topic, resolved, msgtype, seconds * 1_000_000_000 + nanoseconds, data)

    def _keep(self, topic: str, resolved: str, msgtype: str, stamp: int, data: bytes) -> None:
        if not 0 <= stamp <= LAST_STAMP:
            text = f"{topic}: stamp {stamp * 1e-9:.9g} s; a bag's stamps begin at 0 and end in 2262"
            self._refusals.take(Refused("stamp_negative" if stamp < 0 else "stamp_far", text))
            return
        self._writer.write(resolved, msgtype, stamp, data)
        self.counts[topic] += 1

    def destroy_node(self) -> None:
        """Close the bag, then the node."""
        try:
            self._writer.close()
            refused = f", {self.refused.total()} refused" if self.refused else ""
            self.get_logger().info(f"{self.counts.total()} messages written to '{self._writer.path}'{refused}")
        finally:
            super().destroy_node()


def _begins_with_stamp(kind: Any, source: TopicInput) -> bool:
    """Whether the stamp of a topic is that of the header with which its messages begin."""
    first = next(iter(kind.get_fields_and_field_types().items()), None)
    return source.stamp is not None and source.stamp.text == "header.stamp" and first == ("header", "std_msgs/Header")
