"""What the tests of the inspection share: flights as messages, their map, and what is found in them."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from inputs import mapped_messages as made
from inputs.mapped_messages import Flight, rigid_flight

from msls_ros.estimation import Configuration
from msls_ros.inputs import InputAdapter, InputMap
from msls_ros.inputs.findings import Finding
from msls_ros.inputs.inspection import check_topics, findings_of
from msls_ros.inputs.series import Collector

Message = tuple[int, str, str, dict[str, Any]]
SECONDS = 6.0
NAMES = ("elevator", "aileron", "rudder")
LINES: dict[str, Any] = {
    "topics.odometry": "/odom nav_msgs/msg/Odometry",
    "topics.imu": "/imu/data sensor_msgs/msg/Imu",
    "topics.joints": "/joint_states sensor_msgs/msg/JointState",
    "clock": "imu",
    "velocity": "odometry twist.twist.linear frame=flu",
    "attitude": "odometry pose.pose.orientation frame=flu/enu",
    "angular_velocity": "imu angular_velocity frame=flu",
    "specific_force": "imu linear_acceleration frame=flu",
    "effectors.de": "joints position[name=elevator]",
    "effectors.da": "joints position[name=aileron]",
    "effectors.dr": "joints position[name=rudder]",
}
AIR = "my_msgs/msg/AirData"
ARM, WIND = (0.5, 0.0, 0.0), (4.0, -3.0, 0.0)
TOPICS = {
    "/air": AIR,
    "/odom": made.ODOMETRY,
    "/imu/data": made.IMU,
    "/joint_states": made.JOINTS,
    "/rc/out": made.RC_OUT,
}
RATES, FORCE = ("/imu/data", "angular_velocity"), ("/imu/data", "linear_acceleration")
VELOCITY, ATTITUDE = ("/odom", "twist", "twist", "linear"), ("/odom", "pose", "pose", "orientation")
TO_AIR = {"topics.air": f"/air {AIR}"}
VANES: dict[str, Any] = {
    **TO_AIR, "velocity": None, "airspeed": "air tas", "alpha": "air alpha", "beta": "air beta", "vane_position": ARM,
}  # fmt: skip
OVER_GROUND: dict[str, Any] = {**TO_AIR, "velocity": "air vn,ve,vd frame=ned", "wind": "air north,east"}
EULER: dict[str, Any] = {
    **TO_AIR, "attitude": None, "states.Phi": "air roll", "states.Theta": "air pitch", "states.Psi": "air yaw",
}  # fmt: skip


@cache
def flown() -> Flight:
    return replace(rigid_flight(SECONDS), effectors=NAMES)


@cache
def banking(side: float) -> Flight:
    return replace(rigid_flight(2.0 * SECONDS, side=side, bank=0.12), effectors=NAMES)


@cache
def messages() -> tuple[Message, ...]:
    return messages_of(flown())


def messages_of(flight: Flight) -> tuple[Message, ...]:
    found = list(made.standard(flight))
    for k in range(0, len(flight.x), 2):
        pulses = 1500.0 + np.array([*(flight.delta[k] / 0.00109), 0, 0, 0, 0, 0])
        values = {"header": made.header(flight.stamp(k)), "channels": np.rint(pulses).astype(np.uint16)}
        found.append((flight.stamp(k) + 400, "/rc/out", made.RC_OUT, values))
        found.append((flight.stamp(k) + 500, "/air", AIR, air_data(flight, k)))
    return tuple(sorted(found, key=lambda m: m[0]))


def air_data(flight: Flight, k: int) -> dict[str, Any]:
    """Return what vanes ahead of the centre of mass, a satellite receiver in a wind, and a gyro of Euler angles say."""
    x = flight.x[k]
    met, ground = x[:3] + np.cross(x[3:6], ARM), made.rotation(x[6:]) @ x[:3] + WIND
    speed = float(np.linalg.norm(met))
    values = {"tas": speed, "alpha": math.atan2(met[2], met[0]), "beta": math.asin(met[1] / speed)}
    values.update(zip(("vn", "ve", "vd", "north", "east"), (*ground, *WIND[:2]), strict=True))
    values.update(zip(("roll", "pitch", "yaw"), x[6:], strict=True))
    return {"header": made.header(flight.stamp(k)), **{name: float(value) for name, value in values.items()}}


class Fields:
    """A message: attributes, as any has."""

    def __init__(self, fields: dict[str, Any]) -> None:
        self.__dict__ = {k: Fields(v) if isinstance(v, dict) else v for k, v in fields.items()}


def look(
    changes: dict[str, Any],
    change: Callable[[Message], Message | None] = lambda m: m,
    sent: tuple[Message, ...] | None = None,
    **parameters: Any,
) -> list[Finding]:
    """Inspect the flight, or other messages, with a map that is changed; entries that are None are left out."""
    lines = {k: v for k, v in {**LINES, **changes}.items() if v is not None}
    inputs = InputMap.from_parameters(lines)
    effectors = tuple(n[10:] for n in lines if n.startswith("effectors."))
    given = {"effectors": effectors, "sample_rate": 100.0, "reference_speed": 18.0, **parameters}
    configuration = Configuration().replace(given)
    InputAdapter(inputs, configuration.states, configuration.effectors)
    found = list(check_topics(inputs, TOPICS))
    collector = Collector(inputs)
    for message in sent or messages():
        changed = change(copy.deepcopy(message))
        if changed is not None and TOPICS.get(changed[1]) == inputs_type(inputs, changed[1]):
            collector.take(changed[1], changed[0], Fields(changed[3]))
    missing = {f.where for f in found}
    return [*found, *(f for f in findings_of(collector.record(), configuration) if f.where not in missing)]


def inputs_type(inputs: InputMap, topic: str) -> str | None:
    return next((t.msgtype for t in inputs.topics.values() if t.topic == topic), None)


def of(topic: str, *path: str) -> Callable[[Callable[[Any], Any]], Callable[[Message], Message]]:
    """Return what changes a field of the messages of a topic."""

    def with_function(function: Callable[[Any], Any]) -> Callable[[Message], Message]:
        def change(message: Message) -> Message:
            if message[1] == topic:
                owner = message[3]
                for name in path[:-1]:
                    owner = owner[name]
                owner[path[-1]] = function(owner[path[-1]])
            return message

        return change

    return with_function


def vector(function: Callable[[float], float]) -> Callable[[dict[str, float]], dict[str, float]]:
    return lambda v: {k: function(x) for k, x in v.items()}


def later(seconds: float) -> Callable[[dict[str, Any]], dict[str, Any]]:
    """Return what moves a stamp."""

    def change(head: dict[str, Any]) -> dict[str, Any]:
        stamp = head["stamp"]["sec"] * 10**9 + head["stamp"]["nanosec"] + round(seconds * 1e9)
        return made.header(stamp)

    return change


def recorded(
    flight: Flight,
    noise: float = 0.0,
    behind: int = 0,
    speed: float = 18.0,
    surfaces: str | None = None,
    parameters: dict[str, Any] | None = None,
    **changes: str | None,
) -> list[Finding]:
    """Inspect a flight of one topic: attitude and rates with noise [rad, rad/s], surfaces of so many samples ago.

    The speed is what the parameters call `reference_speed` [m/s]. Where words of their topic are given, the surfaces
    have one of their own.
    """
    random = np.random.default_rng(5)
    n = len(flight.x) - behind
    angles, rates = (flight.x[behind:, c] + noise * random.standard_normal((n, 3)) for c in (slice(6, 9), slice(3, 6)))
    names = ("attitude", "rates", "velocity", "force")
    columns = [
        np.array([made.quaternion(made.rotation(a)) for a in angles]), rates, flight.x[behind:, :3],
        np.array([flight.force(k + behind) for k in range(n)]),
    ]  # fmt: skip
    lines: dict[str, str | None] = {
        "topics.log": "/log my/Log",
        "clock": "log",
        "attitude": "log attitude frame=frd/ned",
    }
    lines.update(
        {"velocity": "log velocity", "angular_velocity": "log rates", "specific_force": "log force", **changes}
    )
    if surfaces is not None:
        lines["topics.own"] = f"/own my/Log {surfaces}"
    alias = "log" if surfaces is None else "own"
    lines.update({f"effectors.{e}": f"{alias} surfaces[{j}]" for j, e in enumerate(flight.effectors)})
    collector = Collector(InputMap.from_parameters({k: v for k, v in lines.items() if v is not None}))
    for k in range(n):
        values = {name: column[k].tolist() for name, column in zip(names, columns, strict=True)}
        stamp = made.header(flight.stamp(k))
        message = Fields({"header": stamp, **values, "surfaces": flight.delta[k].tolist()})
        for topic in ("/log", "/own")[: 1 if surfaces is None else 2]:
            collector.take(topic, flight.stamp(k), message)
    states = ("u", "v", "w", "P", "Q", "R", "Phi", "Theta", "Psi")[0 if lines["velocity"] else 3 :]
    given = {"states": states, "effectors": flight.effectors, "sample_rate": 100.0, "reference_speed": speed}
    given |= parameters or {}
    return findings_of(collector.record(), Configuration().replace(given))
