"""The node behind the terminal view: keeps the newest of all that an identifier says."""

from __future__ import annotations

import time
from collections import Counter, deque
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from msls_msgs.msg import DitherCommand, FaultEvent, LinearModel
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node

from msls_ros.messages import stamp_of
from msls_ros.nodes.awaiting import awaited, elsewhere
from msls_ros.nodes.message_types import type_of
from msls_ros.nodes.quality import latched, reliable
from msls_ros.nodes.refusals import TIME_JUMP

EVENTS = 6
"""Events that are remembered."""


class WatchNode(Node):
    """Listen to `model`, `dither`, `fault` and the identifier's diagnostics.

    Parameters
    ----------
    identifier
        Name of the identifier's node, in the same namespace.
    **options
        As for `rclpy.node.Node`.
    """

    def __init__(self, name: str = "watch", *, identifier: str = "identifier", **options: Any) -> None:
        """Listen; see the class."""
        super().__init__(name, **options)
        self.model: LinearModel | None = None
        self.dither: DitherCommand | None = None
        self.status: DiagnosticStatus | None = None
        self.events: deque[FaultEvent] = deque(maxlen=EVENTS)
        self._counts: Counter[str] = Counter()
        self._asked = time.monotonic(), Counter[str]()
        namespace = self.get_namespace().rstrip("/")
        self._prefix = f"{namespace}/{identifier}:"
        quality = reliable(10)
        self._models = self.create_subscription(LinearModel, "model", self._on_model, quality)
        self.create_subscription(DitherCommand, "dither", self._on_dither, quality)
        self.create_subscription(FaultEvent, "fault", self._on_fault, quality)
        self.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, quality)
        # What was found before; subscriptions of their own, as publishers that are volatile (a bag that is played)
        # match none that asks for it, which need not be warned of here.
        quiet = SubscriptionEventCallbacks(use_default_callbacks=False)
        self.create_subscription(LinearModel, "model", self._on_latched_model, latched(1), event_callbacks=quiet)
        self.create_subscription(FaultEvent, "fault", self._on_fault, latched(10), event_callbacks=quiet)

    def waiting(self) -> str:
        """Say why no model has come: what the topic lacks, and what the identifier says of itself."""
        text = f"waiting for a model: {awaited(self, 'model', self._models, self._counts['model'])}"
        if not self.count_publishers("model"):
            text += elsewhere(self, self._models.topic_name, type_of(LinearModel))
        name = self._prefix[:-1]
        own = f"no diagnostics of {name}" if self.status is None else f"{name} says: {self.status.message}"
        return f"{text}; {own}"

    def rates(self) -> dict[str, float]:
        """Return the rates of the topics since the last call [Hz]."""
        since, before = self._asked
        now, counts = time.monotonic(), self._counts.copy()
        self._asked = now, counts
        return {t: (counts[t] - before[t]) / max(now - since, 1e-3) for t in ("model", "dither")}

    def _on_model(self, message: LinearModel) -> None:
        self._counts["model"] += 1
        self._take_model(message)

    def _on_latched_model(self, message: LinearModel) -> None:
        if self.model is None:
            self._take_model(message)

    def _take_model(self, message: LinearModel) -> None:
        """Keep a model; events of a time after it are of before time began anew."""
        self.model = message
        now = stamp_of(message)
        self.events = deque((e for e in self.events if stamp_of(e) <= now + TIME_JUMP), EVENTS)

    def _on_dither(self, message: DitherCommand) -> None:
        self.dither = message
        self._counts["dither"] += 1

    def _on_fault(self, message: FaultEvent) -> None:
        if _identity(message) not in map(_identity, self.events):
            self.events.append(message)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name.startswith(self._prefix):
                self.status = status


def _identity(event: FaultEvent) -> tuple[int, int, str]:
    """Return what makes an event the same: its numbers may be NaN, which equals nothing."""
    return stamp_of(event), event.kind, event.description
