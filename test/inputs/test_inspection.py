"""Ways to get a map wrong: each is refused, or found with a sentence that names the mend; a right map has none."""

from __future__ import annotations

import copy
import math
import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from inputs import mapped_messages as made
from inputs.mapped_messages import Flight, rigid_flight

from msls_ros.estimation import Configuration, EstimationError
from msls_ros.inputs import InputAdapter, InputMap
from msls_ros.inputs.check_effectors import speed_of_flight
from msls_ros.inputs.findings import NOTE, WRONG, Finding
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


def no_gravity(message: Message) -> Message:
    if message[1] == "/imu/data":
        k = (message[0] - made.START) // 10**7
        force = flown().force(k) + made.rotation(flown().x[k, 6:]).T @ [0.0, 0.0, made.GRAVITY]
        message[3]["linear_acceleration"] = made.flu(force)
    return message


def every(topic: str, number: int) -> Callable[[Message], Message | None]:
    """Return what keeps every so many messages of a topic."""
    seen = [0]

    def change(message: Message) -> Message | None:
        seen[0] += message[1] == topic
        return None if message[1] == topic and seen[0] % number else message

    return change


PULSES = {"topics.servos": "/rc/out mavros_msgs/msg/RCOut", "topics.joints": None}


def channels(*numbers: int, more: str = "zero=1500 scale=0.00109") -> dict[str, Any]:
    names = ("de", "da", "dr")
    lines = {f"effectors.{n}": f"servos channels[{i}] {more}" for n, i in zip(names, numbers, strict=True)}
    return {**PULSES, **lines}


TO_AIR = {"topics.air": f"/air {AIR}"}
VANES: dict[str, Any] = {
    **TO_AIR, "velocity": None, "airspeed": "air tas", "alpha": "air alpha", "beta": "air beta", "vane_position": ARM,
}  # fmt: skip
OVER_GROUND: dict[str, Any] = {**TO_AIR, "velocity": "air vn,ve,vd frame=ned", "wind": "air north,east"}
EULER: dict[str, Any] = {
    **TO_AIR, "attitude": None, "states.Phi": "air roll", "states.Theta": "air pitch", "states.Psi": "air yaw",
}  # fmt: skip


def joints(*names: str, more: str = "") -> dict[str, str]:
    return {
        f"effectors.{e}": f"joints position[name={n}]{more}" for e, n in zip(("de", "da", "dr"), names, strict=True)
    }


RATES, FORCE = ("/imu/data", "angular_velocity"), ("/imu/data", "linear_acceleration")
VELOCITY, ATTITUDE = ("/odom", "twist", "twist", "linear"), ("/odom", "pose", "pose", "orientation")
WAYS: dict[str, tuple[Callable[[], list[Finding]], str]] = {
    "topic misspelt": (lambda: look({"topics.imu": "/imu/dta sensor_msgs/msg/Imu"}), "did you mean '/imu/data'"),
    "wrong type": (lambda: look({"topics.imu": "/imu/data nav_msgs/msg/Odometry"}), "has type sensor_msgs/msg/Imu"),
    "field misspelt": (
        lambda: look({"angular_velocity": "imu angular_velocty frame=flu"}), "did you mean 'angular_velocity'",
    ),
    "field of another depth": (lambda: look({"velocity": "odometry twist.linear frame=flu"}), "its fields are twist"),
    "joint misspelt": (lambda: look({"effectors.de": "joints position[name=elevater]"}), "did you mean 'elevator'"),
    "channel out of range": (lambda: look(channels(0, 1, 12)), "'channels' has 8 elements"),
    "alias unknown": (lambda: look({"velocity": "odom twist.twist.linear"}), "did you mean 'odometry'"),
    "option unknown": (lambda: look({"velocity": "odometry twist.twist.linear fame=flu"}), "did you mean 'frame'"),
    "frame unknown": (lambda: look({"velocity": "odometry twist.twist.linear frame=fru"}), "must be one of frd, flu"),
    "clock unknown": (lambda: look({"clock": "imus"}), "did you mean 'imu'"),
    "entry unknown": (lambda: look({"velocty": "odometry twist.twist.linear"}), "did you mean 'velocity'"),
    "effector not mapped": (lambda: look({"effectors.dr": None}, effectors=("de", "da", "dr")), "comes from nowhere"),
    "quaternion never filled in": (
        lambda: look({}, of(*ATTITUDE)(vector(lambda x: 0.0))), "length of 0; expected 1.*map the field that holds",
    ),
    "quaternion with w last": (
        lambda: look({"attitude": "odometry " + ",".join(f"pose.pose.orientation.{c}" for c in "xyzw")
                      + " frame=flu/enu"}),
        "give w first",
    ),
    "attitude not turned": (
        lambda: look({"attitude": "odometry pose.pose.orientation"}), "inputs.attitude: frame=flu/enu",
    ),
    "rates in degrees": (lambda: look({}, of(*RATES)(vector(math.degrees))), "scale=0.0174533"),
    "rates of a slow flight in degrees": (
        lambda: look({}, of(*RATES)(vector(lambda x: 8.0 * x))), "no single frame|scale=",
    ),
    "roll rate with the wrong sign": (
        lambda: look({"angular_velocity": "imu angular_velocity frame=flu scale=-1,1,1"}), "sign of P is wrong",
    ),
    "yaw rate with the wrong sign": (
        lambda: look({"angular_velocity": "imu angular_velocity frame=flu scale=1,1,-1"}), "sign of R is wrong",
    ),
    "rates not turned": (lambda: look({"angular_velocity": "imu angular_velocity"}), "angular_velocity: frame=flu"),
    "axes exchanged": (
        lambda: look({"angular_velocity": "imu " + ",".join(f"angular_velocity.{c}" for c in "yxz") + " frame=flu"}),
        "axes are exchanged",
    ),
    "velocity not turned": (lambda: look({"velocity": "odometry twist.twist.linear"}), "velocity: frame=flu"),
    "velocity of the body taken for that of the earth": (
        lambda: look({"velocity": "odometry twist.twist.linear frame=enu"}), "velocity: frame=flu",
    ),
    "velocity in knots": (lambda: look({}, of(*VELOCITY)(vector(lambda x: x / 0.514444))), "in knots"),
    "velocity in centimetres": (lambda: look({}, of(*VELOCITY)(vector(lambda x: 100.0 * x))), "in cm/s"),
    "velocity backwards": (lambda: look({}, of(*VELOCITY)(vector(lambda x: -x))), "velocity: scale=-1"),
    "nothing turned": (
        lambda: look({
            "velocity": "odometry twist.twist.linear", "attitude": "odometry pose.pose.orientation",
            "angular_velocity": "imu angular_velocity", "specific_force": "imu linear_acceleration",
        }),
        "frame=flu for body vectors, frame=flu/enu for the attitude",
    ),
    "force in g": (lambda: look({}, of(*FORCE)(vector(lambda x: x / 9.80665))), "scale=9.80665"),
    "force not turned": (lambda: look({"specific_force": "imu linear_acceleration"}), "specific_force: frame=flu"),
    "force with the sign of gravity": (lambda: look({}, of(*FORCE)(vector(lambda x: -x))), "specific_force: scale=-1"),
    "gravity taken off": (lambda: look({}, no_gravity), "gravity has been taken off"),
    "surfaces in degrees": (
        lambda: look({}, of("/joint_states", "position")(np.degrees)), r"degrees.*scale=0\.0174533",
    ),
    "pulses taken for radians": (lambda: look(channels(0, 1, 2, more="scale=1")), "pulses in microseconds"),
    "command of -1 to 1 taken for radians": (
        lambda: look({}, of("/joint_states", "position")(lambda x: x / 0.12)), "command from -1 to 1|no surface does",
    ),
    "channel of no surface": (lambda: look(channels(0, 1, 5)), "constant at 0"),
    "two effectors of one channel": (lambda: look(channels(0, 1, 1)), r"dr moves \+1 times as da does"),
    "two effectors of one servo, in a ratio": (
        lambda: look({"effectors.dr": "joints position[name=aileron] scale=-2"}), r"dr moves -2 times as da does",
    ),
    "servos recorded too slowly": (
        lambda: look({"maximum_age": 1.0}, every("/joint_states", 20)), "2.5 Hz is too slow for a surface",
    ),
    "maximum_age shorter than a period": (lambda: look({"maximum_age": 0.015}), "maximum_age: 0.03"),
    "sample_rate of another clock": (lambda: look({}, sample_rate=50.0), "sample_rate: 100"),
    "window of derivatives of another rate": (lambda: look({"intervals": 4}), r"0.04 s: .* 4 times .* intervals: 0"),
    "speed of another aircraft": (lambda: look({}, reference_speed=180.0), "reference_speed: 18"),
    "servos late": (lambda: look({}, of("/joint_states", "header")(later(0.15))), "before the surfaces|after the surf"),
    "delay with the wrong sign": (
        lambda: look({"topics.joints": "/joint_states sensor_msgs/msg/JointState delay=-0.1"}),
        r"delay larger by 0\.(09|10|11). s in the topic.s line: delay=-?0\.0[01]",
    ),
    "rates late": (lambda: look({}, of("/imu/data", "header")(later(0.2))), "200 ms later"),
    "two clocks": (lambda: look({}, of("/joint_states", "header")(later(1.7e9))), "share no time with those of"),
    "stamps in another unit": (
        lambda: look({"topics.joints": "/joint_states sensor_msgs/msg/JointState stamp=header.stamp.nanosec unit=s"}),
        "stamps go on|share no time|go back",
    ),
    "angle of attack in degrees": (
        lambda: look(VANES, of("/air", "alpha")(math.degrees)), r"inputs.alpha: reaches .*scale=0\.0174533",
    ),
    "sideslip in degrees": (lambda: look(VANES, of("/air", "beta")(math.degrees)), r"beta: .*scale=0\.0174533"),
    "angle of attack with the wrong sign": (
        lambda: look({**VANES, "alpha": "air alpha scale=-1"}), "alpha: the sign is wrong: scale=-1",
    ),
    "sideslip with the wrong sign": (
        lambda: look({**VANES, "beta": "air beta scale=-1"}), "beta: the sign is wrong: scale=-1",
    ),
    "vanes exchanged": (
        lambda: look({**VANES, "alpha": "air beta", "beta": "air alpha"}), "alpha, beta: the two are exchanged",
    ),
    "airspeed in knots": (lambda: look({**VANES, "airspeed": "air tas scale=1.94384"}), "airspeed: .*in knots"),
    "vanes behind": (lambda: look({**VANES, "vane_position": [-0.5, 0.0, 0.0]}), "vane_position: the sign"),
    "place of the vanes in millimetres": (lambda: look({**VANES, "vane_position": [500.0, 0.0, 0.0]}), "in metres"),
    "vanes late": (
        lambda: look({**VANES, "topics.air": f"/air {AIR} delay=-0.15"}), r"delay larger by 0\.1[3-7]. s",
    ),
    "wind not taken off": (
        lambda: look({**OVER_GROUND, "wind": None, "airspeed": "air tas"}), "the airspeed is .*map the wind",
    ),
    "airspeed beside a velocity in knots": (
        lambda: look({**OVER_GROUND, "airspeed": "air tas scale=1.94384"}), "airspeed: .*in knots",
    ),
    "wind from where it comes": (
        lambda: look({**OVER_GROUND, "wind": "air north,east scale=-1"}), "inputs.wind: .*scale=-1",
    ),
    "wind in knots": (lambda: look({**OVER_GROUND, "wind": "air north,east scale=1.94384"}), "wind: .*in knots"),
    "wind exchanged": (lambda: look({**OVER_GROUND, "wind": "air east,north"}), "wind: .*exchanged"),
    "velocity in another earth frame": (
        lambda: look({**OVER_GROUND, "velocity": "air vn,ve,vd frame=enu"}), "velocity: frame=ned",
    ),
    "bank and pitch exchanged": (
        lambda: look({**EULER, "states.Phi": "air pitch", "states.Theta": "air roll"}), "angles are exchanged",
    ),
    "pitch with the wrong sign": (
        lambda: look({**EULER, "states.Theta": "air pitch scale=-1"}), "Theta: its sign is wrong",
    ),
    "bank in degrees": (
        lambda: look(EULER, of("/air", "roll")(math.degrees)), r"Phi: (reaches|scale=|.*scale=)",
    ),
    "axes of the accelerometer exchanged": (
        lambda: look({"specific_force": "imu " + ",".join(f"linear_acceleration.{c}" for c in "yxz") + " frame=flu"}),
        "specific_force: three paths in the order y,x,z",
    ),
    "force of half the size": (
        lambda: look({"specific_force": "imu linear_acceleration frame=flu scale=0.5"}), "2 times the scale",
    ),
    "elevator and aileron exchanged": (
        lambda: look(joints("aileron", "elevator", "rudder")), "de: turns the aircraft in roll, hardly in pitch",
    ),
    "elevator and rudder exchanged": (
        lambda: look(joints("rudder", "aileron", "elevator")), "dr: turns the aircraft in pitch, hardly in yaw",
    ),
    "aileron and rudder exchanged": (
        lambda: look(joints("elevator", "rudder", "aileron")), "da, dr: by da the aircraft yaws.* exchanged",
    ),
    "radians scaled once more": (
        lambda: look(joints(*NAMES, more=" scale=0.0174533")), "moves further than the map says.*57.3 times",
    ),
    "acceleration taken for angular acceleration": (
        lambda: look({"angular_acceleration": "imu linear_acceleration frame=flu"}), "leave it out",
    ),
    "rates taken for their derivatives": (
        lambda: look({"angular_acceleration": "imu angular_velocity frame=flu"}), "leave it out",
    ),
    "delay in milliseconds": (
        lambda: look({"topics.joints": "/joint_states sensor_msgs/msg/JointState delay=20"}), "number from -10 to 10",
    ),
    "place of the accelerometer in millimetres": (lambda: look({"imu_position": [300.0, 0.0, 0.0]}), "in metres"),
}  # fmt: skip


DOUBTED = (
    "window of derivatives of another rate",
    "speed of another aircraft",
    "wind not taken off",
    "airspeed beside a velocity in knots",
)
"""Of these the numbers are right, or right but for their unit."""


@pytest.mark.parametrize("way", WAYS)
def test_a_wrong_map_is_found_and_the_mend_is_named(way: str) -> None:
    make, said = WAYS[way]
    try:
        found = [f for f in make() if f.level != NOTE]
    except EstimationError as error:
        assert re.search(said, str(error)), error
        return
    sentences = [f.sentence() for f in found]
    assert any(re.search(said, s) for s in sentences), sentences
    assert any(f.level == WRONG for f in found) or way in DOUBTED, sentences
    assert all(f.change for f in found)


def test_there_are_many_ways() -> None:
    assert len(WAYS) >= 30


@pytest.mark.parametrize(
    "lines", [{}, channels(0, 1, 2), VANES, OVER_GROUND, {**OVER_GROUND, "airspeed": "air tas"}, EULER]
)
def test_a_right_map_has_notes_only(lines: dict[str, Any]) -> None:
    found = look(lines)
    assert [f for f in found if f.level != NOTE] == []
    assert any("agree with the motion" in f.what for f in found)


def with_noise() -> Callable[[Message], Message]:
    """Return what adds the noise of real sensors to messages."""
    random = np.random.default_rng(3)

    def noisy(message: Message) -> Message:
        for path, size in ((RATES, 0.02), (FORCE, 0.5), (VELOCITY, 0.15)):
            message = of(*path)(vector(lambda x, size=size: x + size * random.standard_normal()))(message)  # type: ignore[misc]
        for name, size in (("tas", 0.3), ("alpha", 0.01), ("beta", 0.01), ("vn", 0.15), ("ve", 0.15), ("vd", 0.15)):
            message = of("/air", name)(lambda x, size=size: x + size * random.standard_normal())(message)  # type: ignore[misc]
        return message

    return noisy


@pytest.mark.parametrize("lines", [{}, VANES, OVER_GROUND, EULER])
def test_noise_of_real_sensors_is_no_finding(lines: dict[str, Any]) -> None:
    assert [f for f in look(lines, with_noise()) if f.level == WRONG] == []


@pytest.mark.parametrize("side", [1.0, 0.1, 0.0])
@pytest.mark.parametrize("noise", [False, True])
def test_gravity_that_turns_with_a_banking_aircraft_is_no_side_force(side: float, noise: bool) -> None:
    """An aircraft without a fin, whose accelerometer feels hardly anything to the side, banks all the same."""
    flight = banking(side)
    assert np.ptp(flight.x[:, 6]) > 1.0
    change = with_noise() if noise else lambda message: message
    assert [f for f in look({}, change, messages_of(flight)) if f.kind == "motion" and f.level != NOTE] == []


def test_a_side_force_of_the_wrong_sign_is_found_in_banks_too() -> None:
    wrong = {"specific_force": "imu linear_acceleration frame=flu scale=1,-1,1"}
    found = [f for f in look(wrong, sent=messages_of(banking(1.0))) if f.kind == "motion"]
    assert [f.level for f in found] == [WRONG] and "scale=1,-1,1" in found[0].change


def test_the_speed_of_flight_is_that_in_the_air_where_a_log_begins_and_ends_at_rest() -> None:
    flown = np.random.default_rng(0).normal(20.0, 1.0, (300, 1))
    log = np.vstack([np.zeros((500, 1)), np.linspace(0.0, 20.0, 50)[:, None], flown, np.zeros((400, 1))])
    assert speed_of_flight(log) == pytest.approx(20.0, abs=0.5)
    assert speed_of_flight(np.hstack([log, 0.0 * log, 0.0 * log])) == pytest.approx(20.0, abs=0.5)


def recorded(flight: Flight, noise: float = 0.0, behind: int = 0, **changes: str | None) -> list[Finding]:
    """Inspect a flight of one topic: attitude and rates with noise [rad, rad/s], surfaces of so many samples ago."""
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
    lines.update({f"effectors.{e}": f"log surfaces[{j}]" for j, e in enumerate(flight.effectors)})
    collector = Collector(InputMap.from_parameters({k: v for k, v in lines.items() if v is not None}))
    for k in range(n):
        values = {name: column[k].tolist() for name, column in zip(names, columns, strict=True)}
        stamp = made.header(flight.stamp(k))
        collector.take(
            "/log", flight.stamp(k), Fields({"header": stamp, **values, "surfaces": flight.delta[k].tolist()})
        )
    states = ("u", "v", "w", "P", "Q", "R", "Phi", "Theta", "Psi")[0 if lines["velocity"] else 3 :]
    given = {"states": states, "effectors": flight.effectors, "sample_rate": 100.0, "reference_speed": 18.0}
    return findings_of(collector.record(), Configuration().replace(given))


@cache
def fed_back() -> Flight:
    """Return a flight of a wing with two elevons, roll damping 20 1/s, whose law feeds bank, pitch and rates back."""
    n, step, parts = 3000, 0.01, 5
    random = np.random.default_rng(2)
    x, states, rates, delta = made.TRIM.copy(), np.empty((n, 9)), np.empty((n, 9)), np.empty((n, 2))
    rest = -made.rotation(made.TRIM[6:]).T @ np.array([0.0, 0.0, made.GRAVITY])
    moments = np.array([[0, -2.0, 0, -20.0, 0, 3.0], [0, 0, -4.0, 0, -4.0, 0], [0, 0.6, 0, -0.3, 0, -0.6]])
    wanted = np.repeat(random.uniform(-1.0, 1.0, (n // 60, 2)), 60, axis=0) * [0.5, 0.1]
    servo = np.zeros(2)
    for k in range(n):
        for part in range(parts):
            off = x - made.TRIM
            roll = 0.06 * (4.0 * (wanted[k, 0] - x[6]) - x[3])
            pitch = 0.12 * (3.5 * (wanted[k, 1] - off[7]) - x[4])
            turn = x[4] * math.sin(x[6]) + x[5] * math.cos(x[6])
            euler = [x[3] + math.tan(x[7]) * turn, x[4] * math.cos(x[6]) - x[5] * math.sin(x[6]), turn / math.cos(x[7])]
            force = rest + np.diag([-0.1, -0.5, -5.0]) @ off[:3] + [0.0, 0.0, -8.0 * servo.sum()]
            down = made.rotation(x[6:]).T @ np.array([0.0, 0.0, made.GRAVITY])
            effect = [90.0 * (servo[0] - servo[1]), -50.0 * servo.sum(), 0.0]
            slope = np.concatenate([force + down - np.cross(x[3:6], x[:3]), moments @ off[:6] + effect, euler])
            if part == 0:
                states[k], rates[k], delta[k] = x, slope, servo
            x = x + step / parts * slope
            servo = servo + step / parts * 25.0 * (np.array([roll - pitch, -roll - pitch]) - servo)
    return Flight(effectors=("left", "right"), x=states, xdot=rates, delta=delta)


def delays(found: list[Finding]) -> list[Finding]:
    return [f for f in found if f.kind == "delay" and f.level != NOTE]


def test_damping_and_a_law_that_feeds_back_are_no_delay() -> None:
    assert delays(recorded(fed_back())) == []
    assert delays(recorded(fed_back(), noise=0.002)) == []


@pytest.mark.parametrize("noise", [0.0, 0.002])
def test_surfaces_that_are_really_late_are_found_in_that_flight(noise: float) -> None:
    found = delays(recorded(fed_back(), noise, behind=10))
    assert [f.level for f in found] == [WRONG] and re.search(r"larger by 0\.(09|10)", found[0].change), found


def test_without_a_velocity_no_change_of_a_delay_is_advised() -> None:
    found = [f for f in recorded(fed_back(), velocity=None, specific_force=None) if f.kind == "delay"]
    assert [(f.level, f.change) for f in found] == [(NOTE, "")]


@pytest.mark.parametrize("noise", [0.006, 0.015])
def test_noise_of_attitude_and_rates_is_no_wrong_frame(noise: float) -> None:
    found = recorded(banking(1.0), noise)
    assert [f for f in found if f.kind == "motion" and f.level != NOTE] == []


@pytest.mark.parametrize("signs", ["-1,1,1", "1,-1,1", "1,1,-1"])
def test_a_wrong_sign_of_a_rate_is_found_in_that_noise(signs: str) -> None:
    found = recorded(banking(1.0), 0.006, angular_velocity=f"log rates scale={signs}")
    assert [f.level for f in found if f.kind == "motion"] == [WRONG], found


TIME = 0.01 * np.arange(3000)
STEPS = np.array([0.0, 1.0, -1.0, 1.0, -1.0, 0.0])[
    np.searchsorted([2.0, 5.0, 7.0, 8.0, 9.0], TIME % 15.0, side="right")
]


def through_servo(values: Any, rate: float = 25.0) -> Any:
    """Return what a servo of first order [1/s] makes of a command at `RATE`."""
    out, keep = np.array(values), math.exp(-0.01 * rate)
    for k in range(1, len(out)):
        out[k] = keep * out[k - 1] + (1.0 - keep) * values[k - 1]
    return out


BINARY = np.repeat(np.random.default_rng(4).choice([-1.0, 1.0], 100), 30)
STICK = np.sin(0.8 * np.pi * TIME)
RESTED = np.where(TIME < 8.0, 0.0, np.clip(2.0 * STICK, -1.0, 1.0))


def saturations(command: Any) -> list[str]:
    """Inspect a flight with this elevator, one at most; return what is said of saturation."""
    flight = replace(fed_back(), delta=np.column_stack([0.1 * command, fed_back().delta[:, 1]]))
    return [f.what for f in recorded(flight) if f.kind == "saturation"]


@pytest.mark.parametrize("command", [STEPS, through_servo(STEPS), np.rint(500.0 * through_servo(STEPS)), BINARY])
def test_a_deflection_that_rests_at_the_levels_of_an_input_is_not_saturated(command: Any) -> None:
    assert saturations(command / np.abs(command).max()) == []


@pytest.mark.parametrize(
    "command", [np.clip(1.2 * STICK, -1.0, 1.0), np.clip(4.0 * STICK, -1.0, 1.0), RESTED, np.minimum(STICK, 0.5)]
)
def test_a_command_that_goes_beyond_a_limit_is_saturated(command: Any) -> None:
    assert saturations(command)
