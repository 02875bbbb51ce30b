"""The pilot node: answers each state sample with a command. It stands in for a flight-control stack."""

from __future__ import annotations

import math
from collections import Counter
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from msls_msgs.msg import EffectorCommand, PilotCommand, StateSample
from rclpy.node import Node

from msls_ros import messages
from msls_ros.flights.aircraft_files import DEFAULT
from msls_ros.flights.closed_loop import still_air
from msls_ros.flights.steering import PHI, Stick
from msls_ros.inputs import NamedVector, Refused
from msls_ros.nodes.parameters import declare_table, fixed, warn_of_unknown
from msls_ros.nodes.plant import chosen_condition
from msls_ros.nodes.quality import INPUT, OUTPUT, listen, publish
from msls_ros.nodes.refusals import Diagnostics, Health, Refusals, StampGate
from msls_ros.plant import STATES, RollDoublet, make_pilot, parse_manoeuvre

PARAMETERS = {
    "aircraft": fixed(DEFAULT, "what is flown: a name of config/aircraft, or the path of your own .yaml"),
    "condition": fixed("", "flight condition to hold; empty: the aircraft's first (high_alpha of the F-16/MATV)"),
    "manoeuvre": fixed(
        "roll_doublet",
        "what to fly: roll_doublet, steady or strong; or segments of flight test, as in 'quiet 10; elevator_3211 8;'",
    ),
    "manoeuvre_scale": fixed(
        1.0, "multiplies the inputs of flight test, and the rate of the doublet", low=-10.0, high=10.0
    ),
    "ask": fixed(
        False, "publish pilot_command, with the own law's command in it, for a controller; false: publish command"
    ),
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
        warn_of_unknown(self, PARAMETERS)
        p = declare_table(self, PARAMETERS)
        condition = chosen_condition(p)
        self._effectors = condition.airframe.effectors
        manoeuvre = parse_manoeuvre(p["manoeuvre"], condition.airframe, p["manoeuvre_scale"])
        if isinstance(manoeuvre, RollDoublet):
            manoeuvre = RollDoublet(rate=p["manoeuvre_scale"] * p["roll_rate"])
        trim, truth = still_air(condition)
        self._pilot = make_pilot(trim, truth, manoeuvre)
        self._stick = Stick(manoeuvre, trim.alpha)
        self._states = NamedVector("state", STATES)
        self._stamps = StampGate("state sample")
        self._refusals = Refusals(self)
        self._answered = 0
        self._asks = p["ask"]
        kind, topic = (PilotCommand, "pilot_command") if self._asks else (EffectorCommand, "command")
        self.command_publisher = publish(self, kind, topic, OUTPUT)
        listen(self, StateSample, "state", INPUT, self._on_state, self._refusals.take)
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
        if self._asks:
            asked = self._stick.command(stamp * 1e-9, float(x[PHI]), delta)
            self.command_publisher.publish(messages.pilot_command_message(stamp, self._effectors, asked))
        else:
            self.command_publisher.publish(messages.command_message(stamp, self._effectors, delta))
        self._answered += 1

    def _health(self) -> Health:
        return Health(DiagnosticStatus.OK, "flying" if self._answered else "waiting", {"commands": self._answered})
