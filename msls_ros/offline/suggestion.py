"""A first map of a log, made from its own topics and the autopilot's parameters, for its user to check.

What a log cannot say is written down as an assumption: how far a surface goes at full command, and how late it follows.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from msls_ros.bags import AnyReader, BagError
from msls_ros.inputs import InputMap
from msls_ros.inputs.check_effectors import check_effectors, speed_of_flight
from msls_ros.inputs.series import Record
from msls_ros.offline.inspection import read_record
from msls_ros.offline.servos import TRAVEL, Surface, ardupilot_surfaces, px4_surfaces

_LEAST_CLOCK = 20.0
"""Rate from which deflections give the instants of the samples [Hz]; slower ones are interpolated."""
_SLOWER = 0.8
"""They do so where they are slower than this share of the rate of the angular velocity."""
_LOOK = 40_000
"""Messages that are read to measure rates and speed."""
_ASSUMED = (
    f"full command moves a surface by {round(float(np.degrees(TRAVEL)))} deg, and it follows its command after 20 ms: "
    "put your own numbers in"
)
_DEGREES = "scale=0.01745329252"
_VECTORS = ("velocity", "wind", "airspeed", "attitude", "angular_velocity", "angular_acceleration", "specific_force")


@dataclass
class Draft:
    """A map in the making."""

    origin: str
    """What the log is of."""
    topics: dict[str, str] = field(default_factory=dict)
    """Lines by alias."""
    clock: str = ""
    lines: dict[str, str] = field(default_factory=dict)
    """Vectors, and ``states.NAME``."""
    effectors: dict[str, Surface] = field(default_factory=dict)
    assumed: list[str] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)

    def parameters(self) -> dict[str, Any]:
        """Return the section ``inputs``."""
        return {
            **{f"topics.{alias}": line for alias, line in self.topics.items()},
            "clock": self.clock,
            "maximum_age": 10.0,
            **self.lines,
            **{f"effectors.{name}": surface.line for name, surface in self.effectors.items()},
        }


def suggest(reader: AnyReader) -> str:
    """Return a parameter file for a log.

    Parameters
    ----------
    reader
        Of the log.

    Raises
    ------
    BagError
        If its topics are not enough for a map; says what is missing.
    """
    draft = _drafted(reader)
    record, _ = read_record(reader, InputMap.from_parameters(draft.parameters()), most=_LOOK)
    _drop(draft, record)
    if "airspeed" not in record.series or "velocity" not in draft.lines:
        draft.lines.pop("airspeed", None)  # no sensor, or nothing to compare it with
    return _render(draft, record)


def _drafted(reader: AnyReader) -> Draft:
    kinds = {kind.rpartition("/")[2]: name for name, kind in sorted(reader.topics.items(), reverse=True)}
    packages = {kind.partition("/")[0] for kind in reader.topics.values()}
    if "ardupilot" in packages:
        draft = _ardupilot(reader, kinds)
    elif "px4_msgs" in packages:
        draft = _px4(reader, kinds)
    else:
        draft = _standard(reader)
    missing = [
        what
        for what, there in (
            ("attitude", "attitude" in draft.lines or "states.Phi" in draft.lines),
            ("angular velocity", "angular_velocity" in draft.lines),
            ("velocity", "velocity" in draft.lines),
            ("deflections or servo commands", bool(draft.effectors)),
        )
        if not there
    ]
    if missing:
        message = (
            f"{reader.path}: no map can be suggested: nothing gives {', '.join(missing)}; it has "
            f"{', '.join(f'{n} ({k})' for n, k in sorted(reader.topics.items())) or 'no topic'}"
        )
        raise BagError(message)
    return draft


def _first(reader: AnyReader, topic: str) -> Any:
    """Return the first message of a topic; None: there is none that can be read."""
    own = reader.only([topic])
    for message in own:
        try:
            return own.decode(message)
        except BagError:
            return None
    return None


def _px4(reader: AnyReader, kinds: dict[str, str]) -> Draft:
    """Map a log of PX4, or a bag of its topics."""
    draft = Draft("PX4")
    chosen = {
        "attitude": (("VehicleAttitude", "q"), ("VehicleOdometry", "q")),
        "velocity": (("VehicleLocalPosition", "vx,vy,vz"), ("VehicleOdometry", "velocity")),
        "angular_velocity": (
            ("VehicleAngularVelocity", "xyz"), ("VehicleOdometry", "angular_velocity"), ("SensorCombined", "gyro_rad"),
        ),
        "angular_acceleration": (("VehicleAngularVelocity", "xyz_derivative"),),
        "specific_force": (("VehicleAcceleration", "xyz"), ("SensorCombined", "accelerometer_m_s2")),
        "airspeed": (("AirspeedValidated", "true_airspeed_m_s"), ("Airspeed", "true_airspeed_m_s")),
        "wind": (("Wind", "windspeed_north,windspeed_east"), ("WindEstimate", "windspeed_north,windspeed_east")),
    }  # fmt: skip
    options = {"attitude": " frame=frd/ned", "velocity": " frame=ned", "wind": " frame=ned hold=true age=10"}
    for name, sources in chosen.items():
        for kind, path in sources:
            message = _first(reader, kinds[kind]) if kind in kinds else None
            if message is not None and hasattr(message, path.split(",")[0]):
                draft.lines[name] = f"{_alias(draft, kind, kinds[kind], message)} {path}{options.get(name, '')}"
                break
    draft.clock = draft.lines.get("angular_velocity", " ").split()[0]
    for kind in ("ActuatorServos", "ActuatorOutputs"):
        message = _first(reader, kinds[kind]) if kind in kinds else None
        if message is not None:
            alias = _alias(draft, kind, kinds[kind], message, " delay=-0.02")
            draft.effectors = px4_surfaces(alias, message, _parameters(reader))
            break
    draft.assumed.append(_ASSUMED)
    if "wind" not in draft.lines:
        draft.assumed.append("velocity is over ground: in wind u, v, w are not those of the air")
    return draft


def _alias(draft: Draft, kind: str, topic: str, message: Any, more: str = "") -> str:
    """Announce a topic of PX4; return its alias."""
    alias = "".join(f"_{c.lower()}" if c.isupper() else c for c in kind).strip("_")
    stamp = "timestamp_sample" if int(getattr(message, "timestamp_sample", 0)) else "timestamp"
    draft.topics[alias] = f"{topic} px4_msgs/msg/{kind} stamp={stamp} unit=us{more}"
    return alias


def _ardupilot(reader: AnyReader, kinds: dict[str, str]) -> Draft:
    """Map a log of ArduPilot."""
    draft = Draft("ArduPilot")

    def topic(alias: str, kind: str, more: str = "") -> bool:
        name = f"/{kind}"
        if name in reader.topics:
            draft.topics[alias] = f"{name} ardupilot/msg/{kind} stamp=TimeUS unit=us{more}"
        return name in reader.topics

    if topic("imu", "IMU"):
        draft.lines["angular_velocity"] = "imu GyrX,GyrY,GyrZ"
        draft.lines["specific_force"] = "imu AccX,AccY,AccZ"
        draft.clock = "imu"
    if topic("attitude", "ATT"):
        for state, path in (("Phi", "Roll"), ("Theta", "Pitch"), ("Psi", "Yaw")):
            draft.lines[f"states.{state}"] = f"attitude {path} {_DEGREES}"
    for kind, wind in (("XKF1", "XKF2"), ("NKF1", "NKF2")):
        if topic("filter", kind):
            draft.lines["velocity"] = "filter VN,VE,VD frame=ned"
            if topic("air", wind):
                draft.lines["wind"] = "air VWN,VWE frame=ned hold=true age=10"
            break
    if "velocity" in draft.lines and topic("pitot", "ARSP"):
        draft.lines["airspeed"] = "pitot Airspeed"
    if topic("servos", "RCOU", " delay=-0.02"):
        draft.effectors = ardupilot_surfaces("servos", _first(reader, "/RCOU"), _parameters(reader))
    draft.assumed.append(_ASSUMED)
    return draft


def _parameters(reader: AnyReader) -> dict[str, float]:
    """Return the autopilot's parameters; a bag has none."""
    log = getattr(reader, "log", None)
    return dict(log.parameters) if log is not None else {}


def _standard(reader: AnyReader) -> Draft:
    """Map standard ROS types, and MAVROS's servo outputs."""
    draft = Draft("ROS")
    counts = reader.summary.counts if reader.summary is not None else {}

    def most(*kinds: str) -> str:
        """Return the topic of one of these types with the most messages."""
        found = [n for n, k in reader.topics.items() if k in kinds]
        return max(sorted(found, key=len), key=lambda n: counts.get(n, 0), default="")

    odometry, imu = most("nav_msgs/msg/Odometry"), most("sensor_msgs/msg/Imu")
    joints, pulses = most("sensor_msgs/msg/JointState"), most("mavros_msgs/msg/RCOut")
    if odometry:
        draft.topics["odometry"] = f"{odometry} nav_msgs/msg/Odometry"
        draft.lines["velocity"] = "odometry twist.twist.linear frame=flu"
        draft.lines["attitude"] = "odometry pose.pose.orientation frame=flu/enu"
        draft.lines["angular_velocity"] = "odometry twist.twist.angular frame=flu"
        draft.clock = "odometry"
    if imu:
        draft.topics["imu"] = f"{imu} sensor_msgs/msg/Imu"
        draft.lines["angular_velocity"] = "imu angular_velocity frame=flu"
        draft.lines["specific_force"] = "imu linear_acceleration frame=flu"
        draft.clock = "imu"
        turned = getattr(_first(reader, imu), "orientation", None)
        if pulses and turned is not None and turned.w**2 + turned.x**2 + turned.y**2 + turned.z**2 > 0.25:
            draft.lines["attitude"] = "imu orientation frame=flu/enu"
    first = _first(reader, joints) if joints else None
    if first is not None:
        draft.topics["joints"] = f"{joints} sensor_msgs/msg/JointState"
        draft.effectors = {
            _word(name): Surface(f"joints position[name={name}]") for name in map(str, first.name) if " " not in name
        }
    elif pulses:
        draft.topics["servos"] = f"{pulses} mavros_msgs/msg/RCOut delay=-0.02"
        first = _first(reader, pulses)
        scale = f"zero=1500 scale={TRAVEL / 400.0:.6g}"
        number = len(first.channels) if first is not None else 0
        draft.effectors = {f"servo{i + 1}": Surface(f"servos channels[{i}] {scale}") for i in range(number)}
        draft.assumed += [_ASSUMED, "all channels that move are surfaces; leave out throttle and what is none"]
    return draft


def _word(name: str) -> str:
    return "".join(c if c.isalnum() else "_" for c in name)


def _drop(draft: Draft, record: Record) -> None:
    """Leave out surfaces that do not move, cannot be read, or move with another."""
    for name in list(draft.effectors):
        if f"effectors.{name}" not in record.series:
            draft.left_out.append(f"{name}: cannot be read")
            del draft.effectors[name]
    for finding in check_effectors(record):
        name = finding.where.rpartition(".")[2]
        if finding.kind in ("constant", "collinear", "dependent") and name in draft.effectors:
            draft.left_out.append(f"{name}: {finding.what}")
            del draft.effectors[name]
    if not draft.effectors:
        message = "no map can be suggested: no surface moves (" + "; ".join(draft.left_out) + ")"
        raise BagError(message)


def _render(draft: Draft, record: Record) -> str:
    """Write the parameter file."""
    rates = {}
    for alias, times in record.topics.items():
        steps = np.diff(times.stamps)
        rates[alias] = 1e9 / float(np.median(steps[steps > 0])) if (steps > 0).any() else 1.0
    servos = {surface.line.split()[0] for surface in draft.effectors.values()}
    slow = min(servos, key=lambda alias: rates[alias])
    if _LEAST_CLOCK <= rates[slow] < _SLOWER * rates[draft.clock]:
        draft.clock = slow
        draft.assumed.append("samples are taken when a deflection was recorded: between two of them it is not known")
    used = {line.split()[0] for line in (*draft.lines.values(), *(s.line for s in draft.effectors.values()))}
    held = {line.split()[0] for name, line in draft.lines.items() if "hold=true" in line or name == "airspeed"}
    slowest = min((rates[alias] for alias in used - held), default=10.0)
    speed = record.series.get("velocity")
    reference = speed_of_flight(speed.values) if speed is not None else 20.0
    lines = [
        f"# A first map of {draft.origin} topics, made from the log: check every line. Assumed:",
        *(f"#   {text}" for text in draft.assumed or ["nothing but the frames of REP 103"]),
        *(f"# left out: {text}" for text in draft.left_out),
        "",
        "/**:",
        "  ros__parameters:",
        "    states: [u, v, w, P, Q, R, Phi, Theta, Psi]",
        f"    effectors: [{', '.join(draft.effectors)}]",
        f"    sample_rate: {float(f'{rates[draft.clock]:.4g}')}",
        f"    reference_speed: {max(float(f'{reference:.2g}'), 1.0)}",
        "",
        "    estimator:",
        "      method: bank",
        "",
        "    inputs:",
        "      topics:",
        *(f'        {alias}: "{draft.topics[alias]}"' for alias in draft.topics if alias in used),
        f"      clock: {draft.clock}",
        f"      maximum_age: {max(0.05, float(f'{2.5 / slowest:.2g}'))}",
        *(f'      {name}: "{draft.lines[name]}"' for name in _VECTORS if name in draft.lines),
    ]
    states = [name for name in draft.lines if name.startswith("states.")]
    if states:
        lines += ["      states:", *(f'        {name[7:]}: "{draft.lines[name]}"' for name in states)]
    lines.append("      effectors:")
    for name, surface in draft.effectors.items():
        lines += [f"        # {surface.about}"] if surface.about else []
        lines.append(f'        {name}: "{surface.line}"')
    return "\n".join(lines) + "\n"
