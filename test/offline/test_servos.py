"""Which servo drives which surface, from the parameters in a log."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from msls_ros.offline.servos import ardupilot_surfaces, px4_surfaces

SURFACES = {"CA_SV_CS0_TYPE": 15.0, "CA_SV_CS1_TYPE": 3.0}


@pytest.mark.parametrize("pins", ["PWM_MAIN", "PWM_AUX"])
def test_pulses_of_px4_get_function_range_and_direction_of_their_output(pins: str) -> None:
    outputs = {"FUNC1": 101.0, "FUNC2": 202.0, "FUNC3": 201.0, "REV": 2.0, "MIN2": 1100.0, "MAX2": 1900.0}
    parameters = {**SURFACES, **{f"{pins}_{name}": value for name, value in outputs.items()}}
    found = px4_surfaces("servos", SimpleNamespace(output=[0.0] * 8), parameters)
    assert {name: surface.line for name, surface in found.items()} == {
        "de": "servos output[1] zero=1500 scale=-0.00109083",
        "da": "servos output[2] zero=1500 scale=0.000872665",
    }
    assert "reversed" in found["de"].about and f"{pins}_FUNC2" in found["de"].about


def test_outputs_of_ardupilot_get_function_trim_range_and_direction() -> None:
    parameters = {"SERVO1_FUNCTION": 4.0, "SERVO1_REVERSED": 1.0, "SERVO1_MIN": 900.0, "SERVO1_MAX": 2100.0}
    parameters |= {"SERVO1_TRIM": 1480.0, "SERVO2_FUNCTION": 70.0, "SERVO3_FUNCTION": 19.0}
    found = ardupilot_surfaces("rcou", SimpleNamespace(C1=0, C2=0, C3=0), parameters)
    assert {name: surface.line for name, surface in found.items()} == {
        "da": "rcou C1 zero=1480 scale=-0.000727221",
        "de": "rcou C3 zero=1500 scale=0.00109083",
    }
