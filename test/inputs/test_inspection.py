"""Ways to get a map wrong: each is refused, or found with a sentence that names the mend; a right map has none."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from inputs import mapped_messages as made
from inputs.inspected import (
    AIR,
    ATTITUDE,
    EULER,
    FORCE,
    NAMES,
    OVER_GROUND,
    RATES,
    VANES,
    VELOCITY,
    Message,
    flown,
    later,
    look,
    of,
    vector,
)

from msls_ros.estimation import EstimationError
from msls_ros.inputs.check_timing import check_fields
from msls_ros.inputs.findings import DOUBTFUL, NOTE, OF_THE_FLIGHT, WRONG, Finding

PULSES = {"topics.servos": "/rc/out mavros_msgs/msg/RCOut", "topics.joints": None}


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


def channels(*numbers: int, more: str = "zero=1500 scale=0.00109") -> dict[str, Any]:
    names = ("de", "da", "dr")
    lines = {f"effectors.{n}": f"servos channels[{i}] {more}" for n, i in zip(names, numbers, strict=True)}
    return {**PULSES, **lines}


def joints(*names: str, more: str = "") -> dict[str, str]:
    return {
        f"effectors.{e}": f"joints position[name={n}]{more}" for e, n in zip(("de", "da", "dr"), names, strict=True)
    }


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


def mixed(message: Message) -> Message:
    """A law that moves the rudder with the two others."""
    if message[1] == "/joint_states":
        joints = message[3]
        at = {name: joints["name"].index(name) for name in ("elevator", "aileron", "rudder")}
        position = joints["position"]
        position[at["rudder"]] = 0.6 * position[at["elevator"]] - 0.4 * position[at["aileron"]]
    return message


def test_a_law_that_moves_surfaces_together_is_of_the_flight() -> None:
    found = [f for f in look({}, mixed) if "cannot be separated" in f.what]
    assert [(f.level, f.kind) for f in found] == [(DOUBTFUL, "dependent")]
    assert found[0].kind in OF_THE_FLIGHT


def test_surfaces_that_move_together_but_for_little_are_noted() -> None:
    def nearly(message: Message) -> Message:
        changed = mixed(message)
        if message[1] == "/joint_states":
            changed[3]["position"][changed[3]["name"].index("rudder")] += math.radians(0.05) * math.sin(
                message[0] * 1e-3
            )
        return changed

    (found,) = [f for f in look({}, nearly) if f.kind == "together"]
    assert found.level == NOTE and re.search(r"= .* but for 0\.0\d+ deg rms: .*its loss", found.what), found.what
    assert not [f for f in look({}) if f.kind == "together"]


@pytest.mark.parametrize(
    ("count", "reason", "level"),
    [(2, "not_finite", NOTE), (8, "field_missing", NOTE), (9, "not_finite", DOUBTFUL), (1, "field", WRONG)],
)
def test_what_is_missing_in_less_than_one_message_of_a_thousand_is_a_note(count: int, reason: str, level: str) -> None:
    where = "specific_force"
    good = {where: SimpleNamespace(stamps=np.arange(8599))}
    record: Any = SimpleNamespace(
        failures={where: {reason: (count, "z is nan")}},
        series=good,
        topics={},
        inputs=SimpleNamespace(compared=(), topics={}),
    )
    (found,) = check_fields(record)
    assert (found.level, found.where) == (level, f"inputs.{where}") and f"in {count} messages" in found.what
