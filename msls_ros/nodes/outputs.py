"""What the identifier publishes, in serialised messages that are made once: only numbers change from then on."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from msls_msgs.msg import DitherCommand, FaultEvent, LinearModel
from rclpy.duration import Duration
from rclpy.lifecycle import LifecycleNode
from rclpy.qos import QoSProfile

from msls_ros import messages, records
from msls_ros.bags import MessageTemplate
from msls_ros.estimation import Configuration, Dither, Estimate, EventKind, Level
from msls_ros.estimation import FaultEvent as Event
from msls_ros.estimation.dither.answer import REASONS
from msls_ros.nodes.quality import EVENTS, latched, overriding, reliable


class _Form:
    """A serialised message whose numbers are filled in."""

    def __init__(self, msgtype: str, frame: str, fields: records.Fields, numbers: tuple[str, ...]) -> None:
        flat = {name: value.ravel() if isinstance(value, np.ndarray) else value for name, value in fields.items()}
        header = {**records.header_fields(0), "frame_id": frame}
        self._row = MessageTemplate(msgtype, {"header": header, **flat}).rows(1)
        self._bytes = self._row.view(np.uint8)
        self._seconds, self._nanoseconds = self._row["header.stamp.sec"], self._row["header.stamp.nanosec"]
        names = [name for name in numbers if name in (self._row.dtype.names or ())]
        self._places = [(name, self._row[name].reshape(-1)) for name in names]

    def filled(self, stamp: int, source: Any) -> bytes:
        """Return the message with the numbers of an object."""
        self._seconds[0], self._nanoseconds[0] = records.split_stamp(stamp)
        for name, place in self._places:
            value = getattr(source, name)
            place[:] = value.reshape(-1) if isinstance(value, np.ndarray) else value
        return self._bytes.tobytes()


def asked_to_reset(configuration: Configuration, time: float) -> Event:
    """Return the event that ends an estimate on request: whoever joins later is given those before it, too."""
    text = "the estimate begins anew: ~/reset was called"
    return Event(time, EventKind.RESET, configuration.rows, (), (), description=text)


class Outputs:
    """The identifier's publishers.

    Parameters
    ----------
    node
        The identifier.
    configuration
        Names and sizes.
    frame
        Of all headers.
    depth
        Of the queues of models and dithers [messages].
    first
        An estimate, from which the form of a model is made: the first form takes a third of a second, which is had
        now and neither in flight nor when the node is told to stop.
    """

    def __init__(
        self, node: LifecycleNode, configuration: Configuration, frame: str, depth: int, first: Estimate
    ) -> None:
        """Make the publishers and the forms of what they publish; see the class."""
        self._node, self._frame = node, frame
        self._effectors = configuration.effectors

        def make(kind: type[Any], topic: str, quality: QoSProfile) -> Any:
            return node.create_lifecycle_publisher(kind, topic, quality, qos_overriding_options=overriding())

        self._model = make(LinearModel, "model", latched(depth))
        self._fault = make(FaultEvent, "fault", latched(EVENTS))
        self._dither = make(DitherCommand, "dither", reliable(depth))
        still = Dither(np.zeros(len(self._effectors)), 0.0, 0.0, 0.0, Level.INHIBITED, "")
        self._dither_forms = {reason: self._dither_form(replace(still, reason=reason)) for reason in REASONS}
        fields = records.model_fields(first)
        self._model_form = _Form("msls_msgs/msg/LinearModel", frame, fields, records.MODEL_NUMBERS)

    def _dither_form(self, dither: Dither) -> _Form:
        fields = records.dither_fields(self._effectors, dither)
        return _Form("msls_msgs/msg/DitherCommand", self._frame, fields, records.DITHER_NUMBERS)

    def destroy(self) -> None:
        """Give the topics back."""
        for publisher in (self._model, self._fault, self._dither):
            self._node.destroy_lifecycle_publisher(publisher)

    @property
    def model_wanted(self) -> bool:
        """Whether somebody listens to the model."""
        return bool(self._model.get_subscription_count())

    def dither(self, stamp: int, dither: Dither) -> None:
        """Publish a dither."""
        form = self._dither_forms.get(dither.reason) or self._dither_form(dither)
        self._dither.publish(form.filled(stamp, dither))

    def fault(self, stamp: int, event: Event) -> None:
        """Publish a fault event."""
        message = messages.fault_message(stamp, event)
        message.header.frame_id = self._frame
        self._fault.publish(message)

    def model(self, stamp: int, estimate: Estimate) -> None:
        """Publish a model."""
        self._model.publish(self._model_form.filled(stamp, estimate))

    def wait_sent(self, seconds: float) -> None:
        """Wait until everybody who listens reliably to the dither has got it."""
        self._dither.wait_for_all_acked(Duration(seconds=seconds))
