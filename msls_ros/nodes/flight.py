"""Fly a scenario: plant, pilot, identifier and recorder in one process, over DDS, in lockstep, into a bag."""

from __future__ import annotations

import os
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter

from msls_ros.control.settings import items
from msls_ros.estimation import Configuration
from msls_ros.estimation.configuration import as_mapping
from msls_ros.flights.scenarios import Scenario
from msls_ros.nodes.controller import ControllerNode
from msls_ros.nodes.identifier import IdentifierNode
from msls_ros.nodes.loopback import RANGE
from msls_ros.nodes.pilot import PilotNode
from msls_ros.nodes.plant import PlantNode
from msls_ros.nodes.recorder import FIXED_LAW, TOPICS, RecorderNode
from msls_ros.offline.replay import keep_parameters
from msls_ros.plant import instrument_lines

CONNECT_TIME_OUT = 30.0
"""Wall-clock wait for the nodes to find each other [s]."""
SETTLING_TIME = 0.1
"""Wall-clock wait for whoever else is in the domain to be seen [s]."""
LOCKSTEP = {"use_sim_time": True, "lockstep": True, "queue": 2.0}
"""Of an identifier whose every answer is waited for."""
DRAIN_TIME_OUT = 10.0
"""Wall-clock wait for the recorder to write the last messages [s]."""


class FlightError(RuntimeError):
    """The flight could not be flown: one sentence."""


@dataclass(frozen=True)
class FlightRecord:
    """What a flight left behind."""

    bag: Path
    samples: int
    wall_time: float
    """From the first sample to the last [s]."""
    time_outs: int
    refused: Mapping[str, int]
    """Messages refused by any node, by reason."""


def overrides(values: Mapping[str, Any]) -> list[Parameter]:
    """Return parameters for `Node(parameter_overrides=...)`; empty lists stay at their (empty) default."""
    plain = {k: list(v) if isinstance(v, tuple) else v for k, v in values.items()}
    return [Parameter(name, value=value) for name, value in plain.items() if value != []]


def fly(
    scenario: Scenario,
    configuration: Configuration,
    bag: Path,
    *,
    noise: str,
    seed: int,
    overwrite: bool = False,
    progress: Callable[[float], None] = lambda _: None,
) -> FlightRecord:
    """Fly a scenario and record it.

    Parameters
    ----------
    scenario, configuration
        What to fly and how to identify.
    bag
        Folder of the bag to write.
    noise, seed
        Of the sensors.
    overwrite
        Replace a bag that exists.
    progress
        Called with the flight time [s].

    Raises
    ------
    FlightError
        If the nodes do not find each other, are not alone, or messages are lost.
    BagError, PlantError, EstimationError, NodeError
        For bad input.
    """
    with ExitStack() as stack:
        os.environ.setdefault(RANGE, "LOCALHOST")
        context = Context()
        rclpy.init(context=context, domain_id=domain())
        stack.callback(context.try_shutdown)
        executor = SingleThreadedExecutor(context=context)
        stack.callback(executor.shutdown)

        def add(make: Callable[..., Node], values: Mapping[str, Any]) -> Any:
            node = make(context=context, parameter_overrides=overrides(values))
            stack.callback(node.destroy_node)
            executor.add_node(node)
            return node

        topics = FIXED_LAW if scenario.law.plan is None else tuple(TOPICS)
        recorder: RecorderNode = add(RecorderNode, {"out": str(bag), "overwrite": overwrite, "topics": topics})
        keep_parameters(bag, configuration)
        pilot: PilotNode = add(PilotNode, _pilot_parameters(scenario))
        identifier: IdentifierNode = add(IdentifierNode, {**as_mapping(configuration), **LOCKSTEP})
        plant: PlantNode = add(PlantNode, _plant_parameters(scenario, noise, seed))
        nodes: list[Node] = [recorder, pilot, identifier, plant]
        if scenario.law.plan is not None:
            nodes.append(add(ControllerNode, _controller_parameters(scenario)))
        stack.callback(executor.shutdown)  # before the nodes go
        _connect(executor, nodes)
        wall_time = _spin_flight(executor, plant, progress)
        _drain(executor, recorder, identifier, plant)
        _refuse_strangers(nodes)
        refused = Counter(identifier.synchronizer.refused) + pilot.refused + plant.refused
        refused += sum((node.refused for node in nodes if isinstance(node, ControllerNode)), Counter())
        return FlightRecord(bag, plant.samples, wall_time, plant.time_outs, dict(refused))


def _spin_flight(executor: SingleThreadedExecutor, plant: PlantNode, progress: Callable[[float], None]) -> float:
    """Spin from the first sample to the last; return how long it took [s]."""
    start = time.monotonic()
    plant.start()
    shown = 0
    while not plant.finished.done():
        executor.spin_once(timeout_sec=1.0)
        if plant.samples > shown:
            shown = plant.samples
            progress(shown * plant.sample_period)
    return time.monotonic() - start


def domain() -> int:
    """Return the DDS domain: ROS_DOMAIN_ID where it is set, else one that parallel flights do not share."""
    given = os.environ.get("ROS_DOMAIN_ID", "")
    return int(given) if given.isdigit() else 1 + os.getpid() % 100


def _pilot_parameters(scenario: Scenario) -> dict[str, Any]:
    return {
        "aircraft": scenario.aircraft.file,
        "condition": scenario.condition,
        "manoeuvre": scenario.manoeuvre,
        "manoeuvre_scale": scenario.manoeuvre_scale,
        "ask": scenario.law.plan is not None,
    }


def _controller_parameters(scenario: Scenario) -> dict[str, Any]:
    assert scenario.law.plan is not None
    settings = {name: value for name, value, _ in items(scenario.law.plan.settings)}
    return {
        **settings,
        "lockstep": True,
        "aircraft": scenario.aircraft.file,
        "condition": scenario.condition,
        "prior": "truth" if scenario.law.prior else "none",
        "sample_rate": float(scenario.rates.sensors),
    }


def _plant_parameters(scenario: Scenario, noise: str, seed: int) -> dict[str, Any]:
    return {
        "aircraft": scenario.aircraft.file,
        "condition": scenario.condition,
        "gusts": scenario.gusts,
        "sensors": [] if scenario.instruments is None else instrument_lines(scenario.instruments),
        "noise": noise,
        "seed": seed,
        "duration": scenario.duration,
        "autostart": False,
        "time_out": 10.0,
        "turbulence": scenario.turbulence,
        "fdm_rate": scenario.rates.flight_dynamics,
        "steps_per_sample": scenario.rates.steps,
        "truth_every": scenario.rates.truth_every,
        "faults": [str(fault) for fault in scenario.faults_of(seed)],
        "latency": scenario.law.latency,
    }


def _connect(executor: SingleThreadedExecutor, nodes: Sequence[Node]) -> None:
    """Wait until every publisher knows every subscription of its topic among the nodes."""
    expected = Counter(s.topic_name for node in nodes for s in node.subscriptions)
    start = time.monotonic()
    while True:
        _refuse_strangers(nodes)
        waited = time.monotonic() - start
        short = {
            p.topic_name
            for node in nodes
            for p in node.publishers
            if p.get_subscription_count() < expected[p.topic_name]
            and not p.topic_name.startswith(("/rosout", "/parameter"))
        }
        if not short and waited > SETTLING_TIME:
            return
        if short and waited > CONNECT_TIME_OUT:
            message = f"the nodes do not find each other on {', '.join(sorted(short))}; is DDS blocked on this machine?"
            raise FlightError(message)
        executor.spin_once(timeout_sec=0.02)


def _refuse_strangers(nodes: Sequence[Node]) -> None:
    """Raise FlightError if somebody else publishes what the nodes listen to."""
    own = Counter(p.topic_name for node in nodes for p in node.publishers)
    for topic in sorted({s.topic_name for node in nodes for s in node.subscriptions}):
        if nodes[0].count_publishers(topic) > own[topic]:
            message = f"somebody else publishes {topic} in ROS domain {domain()}: set ROS_DOMAIN_ID to a free one"
            raise FlightError(message)


def _drain(
    executor: SingleThreadedExecutor, recorder: RecorderNode, identifier: IdentifierNode, plant: PlantNode
) -> None:
    """Spin until the recorder has all that was published, the answers to the last sample too."""
    deadline = time.monotonic() + DRAIN_TIME_OUT
    wanted = Counter(dict.fromkeys(("state", "effectors", "dither", "command", "model"), plant.samples))
    wanted += Counter({"truth/state": plant.samples, "/clock": plant.samples, "truth/model": plant.truths})
    wanted += Counter({"fault": identifier.events})
    while not wanted <= recorder.counts:
        if time.monotonic() > deadline:
            message = f"the recorder has {dict(recorder.counts)}; expected {dict(wanted)}: messages were lost"
            raise FlightError(message)
        executor.spin_once(timeout_sec=0.1)
