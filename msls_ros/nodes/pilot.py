"""The pilot node: answers each state sample with a command. It stands in for a flight-control stack."""

from __future__ import annotations

import math
from collections import Counter
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from msls_msgs.msg import EffectorCommand, StateSample
from rclpy.node import Node

from msls_ros import messages
from msls_ros.inputs import NamedVector, Refused
from msls_ros.nodes.parameters import declare_table, fixed, warn_of_unknown
from msls_ros.nodes.quality import INPUT, OUTPUT
from msls_ros.nodes.refusals import Diagnostics, Health, Refusals, StampGate
from msls_ros.plant import CONDITIONS, EFFECTORS, MANOEUVRES, STATES, Aircraft, Pilot, RollDoublet

PARAMETERS = {
    "condition": fixed("high_alpha", "flight condition to hold", choices=CONDITIONS),
    "manoeuvre": fixed("roll_doublet", "what to fly", choices=MANOEUVRES),
    "roll_rate": fixed(
        math.radians(6.0),
        "roll rate of the doublet; the default is the paper's two pounds of stick",
        unit="rad/s",
        low=-1.0,
        high=1.0,
    ),
}


class PilotNode(Node):
    """Fly a manoeuvre: a command for every measured state.

    Parameters
    ----------
    **options
        As for `rclpy.node.Node`.

    Raises
    ------
    NodeError
        For a parameter that is refused.
    """

    def __init__(self, name: str = "pilot", **options: Any) -> None:
        """Declare the parameters and design the gains."""
        super().__init__(name, **options)
        p = declare_table(self, PARAMETERS)
        warn_of_unknown(self)
        aircraft = Aircraft(CONDITIONS[p["condition"]])
        manoeuvre = MANOEUVRES[p["manoeuvre"]]
        if isinstance(manoeuvre, RollDoublet):
            manoeuvre = RollDoublet(rate=p["roll_rate"])
        self._pilot = Pilot(aircraft.trim, aircraft.truth(), manoeuvre)
        self._states = NamedVector("state", STATES)
        self._stamps = StampGate("state sample")
        self._refusals = Refusals(self)
        self._answered = 0
        self.command_publisher = self.create_publisher(EffectorCommand, "command", OUTPUT)
        self.create_subscription(StateSample, "state", self._on_state, INPUT)
        self._diagnostics = Diagnostics(self, self._health, self.refused)

    @property
    def refused(self) -> Counter[str]:
        """Messages refused, by reason."""
        return self._refusals.counts

    def _on_state(self, message: StateSample) -> None:
        stamp = messages.stamp_of(message)
        try:
            (x,) = self._states.arrange(message.states, x=message.x)
            self._stamps.check(stamp)
        except Refused as refused:
            self._refusals.take(refused)
            return
        delta = self._pilot.command(stamp * 1e-9, x)
        self.command_publisher.publish(messages.command_message(stamp, EFFECTORS, delta))
        self._answered += 1

    def _health(self) -> Health:
        return Health(DiagnosticStatus.OK, "flying" if self._answered else "waiting", {"commands": self._answered})
