"""Which servo drives which surface: from the parameters of PX4 and ArduPilot that stand in their logs.

References
----------
PX4, parameters CA_SV_CSn_TYPE, CA_SV_CSn_TRIM (control surfaces), PWM_MAIN_FUNCn, _MINn, _MAXn, _REV (outputs; PWM_AUX
where those carry the servos).
ArduPilot, parameters SERVOn_FUNCTION, _TRIM, _MIN, _MAX, _REVERSED.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

TRAVEL = float(np.radians(25.0))
"""What a surface is assumed to move by at full command [rad]."""
_PX4_SURFACES = {
    1: "da_left", 2: "da_right", 3: "de", 4: "dr", 5: "elevon_left", 6: "elevon_right", 7: "vtail_left",
    8: "vtail_right", 9: "flap_left", 10: "flap_right", 11: "airbrake", 12: "surface", 13: "atail_left",
    14: "atail_right", 15: "da", 17: "spoiler_left", 18: "spoiler_right",
}  # fmt: skip
_PX4_SERVO_1 = 201
"""Function of an output that carries servo 1."""
_ARDUPILOT_SURFACES = {
    2: "flap", 3: "flap_auto", 4: "da", 16: "dspoiler_left1", 17: "dspoiler_right1", 19: "de", 21: "dr",
    24: "flaperon_left", 25: "flaperon_right", 77: "elevon_left", 78: "elevon_right", 79: "vtail_left",
    80: "vtail_right", 86: "dspoiler_left2", 87: "dspoiler_right2", 110: "airbrake",
}  # fmt: skip


class Surface(NamedTuple):
    """A surface of a map."""

    line: str
    """Of the section ``inputs.effectors``."""
    about: str = ""
    """Where its numbers are from, in words."""


def px4_surfaces(alias: str, message: Any, parameters: Mapping[str, float]) -> dict[str, Surface]:
    """Return the surfaces of PX4 by name.

    Parameters
    ----------
    alias
        Of the topic of `ActuatorServos` (commands of -1 to 1), or of `ActuatorOutputs` (pulses).
    message
        One of it.
    parameters
        Of the autopilot; without them the servos are numbered.
    """
    if hasattr(message, "output"):
        return _px4_outputs(alias, len(message.output), parameters)
    found: dict[str, Surface] = {}
    count = int(parameters.get("CA_SV_CS_COUNT", len(message.control)))
    for i in range(min(count, len(message.control))):
        kind = int(parameters.get(f"CA_SV_CS{i}_TYPE", -1))
        trim = parameters.get(f"CA_SV_CS{i}_TRIM", 0.0)
        name = _free(_PX4_SURFACES.get(kind, f"servo{i + 1}"), found)
        zero = f" zero={trim:.6g}" if trim else ""
        about = f"CA_SV_CS{i}_TYPE {kind}" + (f", CA_SV_CS{i}_TRIM {trim:g}" if trim else "") if kind >= 0 else ""
        found[name] = Surface(f"{alias} control[{i}]{zero} scale={TRAVEL:.6f}", about)
    return found


def _px4_outputs(alias: str, outputs: int, parameters: Mapping[str, float]) -> dict[str, Surface]:
    found: dict[str, Surface] = {}
    carried = [n for n, value in parameters.items() if "_FUNC" in n and 0 <= int(value) - _PX4_SERVO_1 < 8]
    pins = "PWM_MAIN" if any(n.startswith("PWM_MAIN_") for n in carried) else "PWM_AUX"
    reversed_bits = int(parameters.get(f"{pins}_REV", 0))
    for i in range(outputs):
        servo = int(parameters.get(f"{pins}_FUNC{i + 1}", 0)) - _PX4_SERVO_1
        if not 0 <= servo < 8:
            continue
        low, high = (parameters.get(f"{pins}_{end}{i + 1}", value) for end, value in (("MIN", 1000.0), ("MAX", 2000.0)))
        turned = bool(reversed_bits >> i & 1)
        kind = int(parameters.get(f"CA_SV_CS{servo}_TYPE", -1))
        name = _free(_PX4_SURFACES.get(kind, f"servo{servo + 1}"), found)
        about = f"{pins}_FUNC{i + 1} {servo + _PX4_SERVO_1}, {low:g} to {high:g} us{', reversed' if turned else ''}"
        found[name] = Surface(f"{alias} output[{i}] {_pulse(0.5 * (low + high), low, high, turned)}", about)
    return found


def ardupilot_surfaces(alias: str, message: Any, parameters: Mapping[str, float]) -> dict[str, Surface]:
    """Return the surfaces of ArduPilot by name.

    Parameters
    ----------
    alias
        Of the topic of `RCOU`.
    message
        One of it.
    parameters
        Of the autopilot.
    """
    found: dict[str, Surface] = {}
    for n in range(1, 33):
        function = int(parameters.get(f"SERVO{n}_FUNCTION", 0))
        if function not in _ARDUPILOT_SURFACES or not hasattr(message, f"C{n}"):
            continue
        low, high = parameters.get(f"SERVO{n}_MIN", 1100.0), parameters.get(f"SERVO{n}_MAX", 1900.0)
        trim = parameters.get(f"SERVO{n}_TRIM", 1500.0)
        turned = bool(parameters.get(f"SERVO{n}_REVERSED", 0.0))
        name = _free(_ARDUPILOT_SURFACES[function], found)
        about = f"SERVO{n}_FUNCTION {function}, {low:g} to {high:g} us, trim {trim:g}{', reversed' if turned else ''}"
        found[name] = Surface(f"{alias} C{n} {_pulse(trim, low, high, turned)}", about)
    return found


def _pulse(trim: float, low: float, high: float, turned: bool) -> str:
    """Return the options that turn a pulse [us] into radians."""
    scale = TRAVEL / (0.5 * (high - low) or 500.0)
    return f"zero={trim:g} scale={-scale if turned else scale:.6g}"


def _free(name: str, taken: Mapping[str, Any]) -> str:
    """Return a name that is not taken yet."""
    number, found = 2, name
    while found in taken:
        found, number = f"{name}{number}", number + 1
    return found
