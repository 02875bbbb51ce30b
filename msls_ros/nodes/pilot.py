"""The pilot node: answers each state sample with a command. It stands in for a flight-control stack."""

from __future__ import annotations

from collections import Counter
from typing import Any

from msls_msgs.msg import EffectorCommand, StateSample
from rclpy.node import Node

from msls_ros import messages
from msls_ros.estimation import NamedVector, Refused
from msls_ros.nodes.parameters import declare_table
from msls_ros.nodes.quality import INPUT, OUTPUT
from msls_ros.plant import CONDITIONS, EFFECTORS, STATES, Aircraft, Manoeuvre, Pilot, PlantError, RollDoublet, Steady

MANOEUVRES = ("roll_doublet", "steady")
PARAMETERS = {
    "condition": ("high_alpha", f"flight condition to hold: one of {', '.join(CONDITIONS)}"),
    "manoeuvre": ("roll_doublet", f"what to fly: one of {', '.join(MANOEUVRES)}"),
    "roll_rate": (
        0.10471975511965977,
        "roll rate of the doublet [rad/s]; the default is the paper's two pounds of stick",
    ),
}


class PilotNode(Node):
    """Fly a manoeuvre from measured states.

    Parameters
    ----------
    **options
        As for `rclpy.node.Node`.

    Raises
    ------
    PlantError, EstimationError
        For a parameter that is refused.
    """

    def __init__(self, name: str = "pilot", **options: Any) -> None:
        """Declare the parameters and design the gains."""
        super().__init__(name, **options)
        p = declare_table(self, PARAMETERS)
        for key, allowed in (("condition", tuple(CONDITIONS)), ("manoeuvre", MANOEUVRES)):
            if p[key] not in allowed:
                message = f"parameter '{key}' is '{p[key]}'; it must be one of {', '.join(allowed)}"
                raise PlantError(message)
        aircraft = Aircraft(CONDITIONS[p["condition"]])
        manoeuvre: Manoeuvre = RollDoublet(rate=p["roll_rate"]) if p["manoeuvre"] == "roll_doublet" else Steady()
        self._pilot = Pilot(aircraft.trim, aircraft.truth(), manoeuvre)
        self._states = NamedVector("state", STATES)
        self.refused: Counter[str] = Counter()
        """Messages refused, by reason."""
        self.command_publisher = self.create_publisher(EffectorCommand, "command", OUTPUT)
        self.create_subscription(StateSample, "state", self._on_state, INPUT)

    def _on_state(self, message: StateSample) -> None:
        stamp = messages.stamp_of(message)
        try:
            (x,) = self._states.arrange(message.states, x=message.x)
        except Refused as refused:
            self.refused[refused.reason] += 1
            self.get_logger().warning(f"refused ({refused.reason}): {refused}", throttle_duration_sec=1.0)
            return
        delta = self._pilot.command(stamp * 1e-9, x)
        self.command_publisher.publish(messages.command_message(stamp, EFFECTORS, delta))
