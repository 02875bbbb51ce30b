"""A bare relay: the topics and messages of the identifier in plain rclpy, and nothing computed. Run by `latency`."""

from __future__ import annotations

import sys

import rclpy
from msls_msgs.msg import DitherCommand, EffectorSample, FaultEvent, LinearModel, StateSample
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node

from msls_ros import messages
from msls_ros.estimation import Configuration, Identifier
from msls_ros.nodes.quality import INPUT


class Relay(Node):
    """Answers each pair of samples with a dither and a model."""

    def __init__(self) -> None:
        """Make the messages once; only their stamps change."""
        super().__init__("relay")
        identifier = Identifier(Configuration())
        c = identifier.configuration
        estimate = identifier.estimate(0.0, messages.values([0.0] * len(c.states)))
        self._model = messages.model_message(0, estimate)
        self._dither = messages.dither_message(0, c.effectors, estimate.dither)
        self._models = self.create_publisher(LinearModel, "model", INPUT)
        self._faults = self.create_publisher(FaultEvent, "fault", INPUT)
        self._dithers = self.create_publisher(DitherCommand, "dither", INPUT)
        self._state: StateSample | None = None
        self.create_subscription(StateSample, "state", self._on_state, INPUT)
        self.create_subscription(EffectorSample, "effectors", self._on_effectors, INPUT)

    def _on_state(self, message: StateSample) -> None:
        self._state = message

    def _on_effectors(self, message: EffectorSample) -> None:
        self._dither.header.stamp = self._model.header.stamp = message.header.stamp
        self._dithers.publish(self._dither)
        self._models.publish(self._model)


def main() -> None:
    """Spin until told to stop."""
    rclpy.init(args=sys.argv)
    executor = SingleThreadedExecutor()
    executor.add_node(Relay())
    try:
        executor.spin()
    except (KeyboardInterrupt, ExternalShutdownException):
        return


if __name__ == "__main__":
    main()
