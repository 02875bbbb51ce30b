"""A plant in lockstep whose samples are answered by hand, for the tests of its node."""

from __future__ import annotations

from typing import Any

import numpy as np
from msls_msgs.msg import DitherCommand, EffectorCommand, EffectorSample, StateSample

from msls_ros import messages
from msls_ros.estimation import Dither, Level
from msls_ros.nodes.plant import PlantNode
from msls_ros.plant import CONDITIONS, EFFECTORS, Aircraft
from msls_ros.testing import Bench

STEP = 20_000_000
TRIM = Aircraft(CONDITIONS["high_alpha"]).trim


class Tower:
    """A plant in lockstep whose samples are answered by hand."""

    def __init__(self, bench: Bench, **parameters: Any) -> None:
        self.bench = bench
        given = {"autostart": False, "time_out": 3600.0, "noise": "none", **parameters}
        self.plant = bench.add(PlantNode, **given)
        self.state: list[StateSample] = bench.listen(StateSample, "state")
        self.effectors: list[EffectorSample] = bench.listen(EffectorSample, "effectors")
        bench.publish("command", self.command())  # connects, and is refused: the flight has not begun
        bench.publish("dither", self.dither())
        bench.spin_until(lambda: sum(self.plant.refused.values()) == 2 or self.answered == 2, "the connection")
        bench.spin_until(lambda: self.plant.state_publisher.get_subscription_count() > 0)
        bench.spin_until(lambda: self.plant.effector_publisher.get_subscription_count() > 0)
        self.plant.start()
        bench.expect(self.effectors, 1)

    @property
    def answered(self) -> int:
        return sum(answer is not None for answer in self.plant._answers.values())

    @property
    def stamp(self) -> int:
        return messages.stamp_of(self.effectors[-1]) if self.effectors else -STEP

    def command(self, **changes: Any) -> EffectorCommand:
        message = messages.command_message(changes.pop("stamp", self.stamp), EFFECTORS, TRIM.delta)
        return filled(message, changes)

    def dither(self, **changes: Any) -> DitherCommand:
        zero = Dither(np.zeros(7), 0.0, 0.0, 0.0, Level.NOMINAL, "test")
        return filled(messages.dither_message(changes.pop("stamp", self.stamp), EFFECTORS, zero), changes)

    def step(self) -> None:
        """Answer the newest sample and wait for the next."""
        count = len(self.effectors)
        self.bench.publish("command", self.command())
        self.bench.publish("dither", self.dither())
        self.bench.expect(self.effectors, count + 1, "the next sample")
        self.bench.expect(self.state, count + 1, "the next sample")


def filled(message: Any, changes: dict[str, Any]) -> Any:
    for name, value in changes.items():
        setattr(message, name, value)
    return message
