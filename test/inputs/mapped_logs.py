"""Flights as logs of PX4 (ULog) and ArduPilot (DataFlash), written with the formats' own structure."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from inputs.mapped_messages import Flight, quaternion, rotation

TRAVEL = float(np.radians(25.0))
DELAY_US = 20_000
PX4 = {"CA_SV_CS_COUNT": 3, "CA_SV_CS0_TYPE": 15, "CA_SV_CS1_TYPE": 3, "CA_SV_CS2_TYPE": 4, "CA_SV_CS2_TRIM": 0.05}
ARDUPILOT = {
    "SERVO1_FUNCTION": 4.0, "SERVO1_MIN": 1000.0, "SERVO1_MAX": 2000.0, "SERVO1_TRIM": 1510.0, "SERVO1_REVERSED": 1.0,
    "SERVO2_FUNCTION": 19.0, "SERVO2_MIN": 1000.0, "SERVO2_MAX": 2000.0, "SERVO2_TRIM": 1500.0,
    "SERVO3_FUNCTION": 70.0, "SERVO4_FUNCTION": 21.0, "SERVO4_MIN": 1100.0, "SERVO4_MAX": 1900.0, "SERVO4_TRIM": 1500.0,
}  # fmt: skip
_ULOG_FORMATS = {
    "vehicle_attitude": "uint64_t timestamp;uint64_t timestamp_sample;float[4] q;",
    "vehicle_angular_velocity": "uint64_t timestamp;uint64_t timestamp_sample;float[3] xyz;float[3] xyz_derivative;",
    "vehicle_local_position": "uint64_t timestamp;uint64_t timestamp_sample;float vx;float vy;float vz;bool valid;",
    "sensor_combined": "uint64_t timestamp;float[3] gyro_rad;float[3] accelerometer_m_s2;",
    "actuator_servos": "uint64_t timestamp;uint64_t timestamp_sample;float[8] control;",
    "wind": "uint64_t timestamp;uint64_t timestamp_sample;float windspeed_north;float windspeed_east;",
    "airspeed_validated": "uint64_t timestamp;float true_airspeed_m_s;",
}


def _ulog(kind: str, body: bytes) -> bytes:
    return struct.pack("<HB", len(body), ord(kind)) + body


def write_ulog(
    path: Path, flight: Flight, parameters: Mapping[str, float] = PX4, wind: tuple[float, float] = (0.0, 0.0)
) -> Path:
    """Write a log of PX4: header, flag bits, formats, parameters, subscriptions, data."""
    parts = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", flight.stamp(0) // 1000), _ulog("B", bytes(40))]
    for name, text in _ULOG_FORMATS.items():
        parts.append(_ulog("F", f"{name}:{text}".encode()))
    for name, value in parameters.items():
        kind, packed = ("int32_t", "<i") if isinstance(value, int) else ("float", "<f")
        key = f"{kind} {name}".encode()
        parts.append(_ulog("P", bytes([len(key)]) + key + struct.pack(packed, value)))
    numbers = {name: i for i, name in enumerate(_ULOG_FORMATS)}
    parts += [_ulog("A", struct.pack("<BH", 0, i) + name.encode()) for name, i in numbers.items()]

    def put(name: str, packed: str, *values: Any) -> None:
        parts.append(_ulog("D", struct.pack(f"<H{packed}", numbers[name], *values)))

    de, da, dr = (flight.delta[:, flight.effectors.index(n)] / TRAVEL for n in ("de", "da", "dr"))
    trim = parameters.get("CA_SV_CS2_TRIM", 0.0)
    for k in range(len(flight.x)):
        us, x, matrix = flight.stamp(k) // 1000, flight.x[k], rotation(flight.x[k, 6:])
        put("vehicle_angular_velocity", "QQ6f", us + 40, us, *x[3:6], *flight.xdot[k, 3:6])
        put("sensor_combined", "Q6f", us, *x[3:6], *flight.force(k))
        if k % 2 == 0:
            put("vehicle_attitude", "QQ4f", us + 50, us, *quaternion(matrix))
            north, east, down = matrix @ x[:3] + [*wind, 0.0]
            put("vehicle_local_position", "QQ3f?", us + 60, us, north, east, down, True)
            control = [da[k], de[k], dr[k] + trim, *[float("nan")] * 5]
            put("actuator_servos", "QQ8f", us - DELAY_US + 10, us - DELAY_US, *control)
        if k % 100 == 0:
            put("wind", "QQ2f", us, us, *wind)
        if k % 10 == 0:
            put("airspeed_validated", "Qf", us, float(np.linalg.norm(x[:3])) if k > 50 else float("nan"))
    path.write_bytes(b"".join(parts))
    return path


_UNITS = {"IMU": "s#------"}
_DATAFLASH = {
    "PARM": (64, "QNff", "TimeUS,Name,Value,Default"),
    "FMTU": (65, "QBNN", "TimeUS,FmtType,UnitIds,MultIds"),
    "IMU": (129, "QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"),
    "ATT": (130, "Qccccccc", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,Err"),
    "XKF1": (131, "QBfff", "TimeUS,C,VN,VE,VD"),
    "XKF2": (132, "QBff", "TimeUS,C,VWN,VWE"),
    "RCOU": (133, "QHHHH", "TimeUS,C1,C2,C3,C4"),
    "ARSP": (134, "QBf", "TimeUS,I,Airspeed"),
}
_SIZES = {"Q": "Q", "N": "16s", "f": "f", "B": "B", "c": "h", "H": "H"}


def _record(name: str, *values: Any) -> bytes:
    kind, fields, _ = _DATAFLASH[name]
    return b"\xa3\x95" + struct.pack("<B" + "".join(_SIZES[f] for f in fields), kind, *values)


def _format(kind: int, length: int, name: str, fields: str, columns: str) -> bytes:
    return b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", kind, length, name.encode(), fields.encode(), columns.encode())


def write_dataflash(path: Path, flight: Flight, parameters: Mapping[str, float] = ARDUPILOT) -> Path:
    """Write a log of ArduPilot: formats, units of instances, parameters, records. A second IMU measures rubbish."""
    parts = [_format(128, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")]
    for name, (kind, fields, columns) in _DATAFLASH.items():
        length = 3 + struct.calcsize("<" + "".join(_SIZES[f] for f in fields))
        parts.append(_format(kind, length, name, fields, columns))
    start = flight.stamp(0) // 1000
    for name, units in _UNITS.items():
        parts.append(_record("FMTU", start, _DATAFLASH[name][0], units.encode(), b"F-------"))
    parts += [_record("PARM", start, name.encode(), value, 0.0) for name, value in parameters.items()]

    def pulses(name: str, values: Any) -> Sequence[int]:
        low, high = parameters[f"{name}_MIN"], parameters[f"{name}_MAX"]
        sign = -1.0 if parameters.get(f"{name}_REVERSED") else 1.0
        scaled = parameters[f"{name}_TRIM"] + sign * values / TRAVEL * 0.5 * (high - low)
        return [int(v) for v in np.rint(scaled)]

    de, da, dr = (flight.delta[:, flight.effectors.index(n)] for n in ("de", "da", "dr"))
    outputs = pulses("SERVO1", da), pulses("SERVO2", de), pulses("SERVO4", dr)
    for k in range(len(flight.x)):
        us, x = flight.stamp(k) // 1000, flight.x[k]
        parts.append(_record("IMU", us, 0, *x[3:6], *flight.force(k)))
        parts.append(_record("IMU", us, 1, 9.0, 9.0, 9.0, 1.0, 2.0, 3.0))
        if k % 2 == 0:
            phi, theta, psi = (round(100.0 * float(np.degrees(a))) for a in x[6:])
            parts.append(_record("ATT", us, 0, phi, 0, theta, 0, psi % 36000 if psi % 36000 < 32768 else 0, 0))
            velocity = rotation(x[6:]) @ x[:3]
            parts.append(_record("XKF1", us, 0, *velocity))
            one, two, four = (o[k] for o in outputs)
            parts.append(_record("RCOU", us - DELAY_US, one, two, 1500, four))
        if k % 100 == 0:
            parts.append(_record("XKF2", us, 0, 0.0, 0.0))
            parts.append(_record("ARSP", us, 0, float(np.linalg.norm(x[:3]))))
    path.write_bytes(b"".join(parts))
    return path
