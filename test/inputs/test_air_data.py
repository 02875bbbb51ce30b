"""Air data: airspeed, angle of attack and sideslip at a vane, wind, biases per axis."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from inputs.mapped_messages import Flight, quaternion, rigid_flight, rotation

from msls_ros.estimation import Configuration, EstimationError
from msls_ros.inputs import InputAdapter, InputMap, StateRow

ARM = np.array([1.2, -0.4, 0.1])
WIND = np.array([3.0, -2.0, 0.0])
LINES: dict[str, Any] = {
    "topics.air": "/air a/msg/Air stamp=us unit=us",
    "clock": "air",
    "attitude": "air q frame=frd/ned",
    "angular_velocity": "air rates zero=0.01,-0.02,0.03",
    "effectors.de": "air delta[0]",
}
STATES = ("u", "v", "w", "P", "Q", "R", "Phi", "Theta", "Psi")


@pytest.fixture(scope="module")
def flight() -> Flight:
    return rigid_flight(1.0)


class Air:
    """What a small aircraft measures at an instant."""

    def __init__(self, flight: Flight, k: int) -> None:
        x, matrix = flight.x[k], rotation(flight.x[k, 6:])
        met = x[:3] + np.cross(x[3:6], ARM)
        self.us = flight.stamp(k) // 1000
        self.q = quaternion(matrix)
        self.rates = x[3:6] + np.array([0.01, -0.02, 0.03])
        self.delta = flight.delta[k]
        self.tas = self.tas_true = float(np.linalg.norm(met))
        self.alpha_deg = math.degrees(math.atan2(met[2], met[0]))
        self.beta_deg = math.degrees(math.asin(met[1] / self.tas))
        self.ground = matrix @ x[:3] + WIND
        self.north, self.east = WIND[:2]


def states_of(lines: dict[str, Any], flight: Flight) -> np.ndarray[Any, Any]:
    adapter = InputAdapter(InputMap.from_parameters(lines), STATES, ("de",))
    rows = [row for k in range(len(flight.x)) for row in adapter.push("/air", flight.stamp(k), Air(flight, k))]
    return np.array([row.x for row in rows if isinstance(row, StateRow)])


def test_vanes_off_the_centre_of_mass_give_its_velocity(flight: Flight) -> None:
    degrees = "scale=0.017453292519943295"
    lines = {**LINES, "airspeed": "air tas", "alpha": f"air alpha_deg {degrees}", "beta": f"air beta_deg {degrees}"}
    at = 2 + np.arange(len(flight.x) - 4)
    moved = states_of({**lines, "vane_position": ARM.tolist()}, flight)
    assert np.abs(moved - flight.x[at]).max() < 0.01 + 0.2 * np.abs(np.diff(flight.x, axis=0)).max()
    assert np.abs(states_of(lines, flight)[:, :3] - moved[:, :3]).max() > 0.2


def test_wind_is_taken_off_a_velocity_over_ground_and_biases_off_each_axis(flight: Flight) -> None:
    lines = {**LINES, "velocity": "air ground frame=ned", "wind": "air north,east"}
    found = states_of(lines, flight)
    at = 2 + np.arange(len(flight.x) - 4)
    assert np.abs(found - flight.x[at]).max() < 0.01 + 0.2 * np.abs(np.diff(flight.x, axis=0)).max()


@pytest.mark.parametrize("lag", [0.1, 0.3])
def test_the_lag_of_a_static_port_is_taken_back(lag: float) -> None:
    flight = rigid_flight(4.0)
    degrees = "scale=0.017453292519943295"
    lines = {**LINES, "alpha": f"air alpha_deg {degrees}", "beta": f"air beta_deg {degrees}", "vane_position": ARM}
    measured, shown = [Air(flight, k) for k in range(len(flight.x))], 0.0
    for k, one in enumerate(measured):  # a first-order lag, exact for an input that is straight between samples
        share = 1.0 - math.exp(-0.01 / lag)
        last = measured[k - 1].tas_true if k else one.tas
        slope = (one.tas - last) / 0.01
        shown = one.tas if not k else shown + share * (last - slope * lag - shown) + slope * 0.01
        one.tas_true, one.tas = one.tas, shown
    errors = []
    for more in ("", f" lag={lag}", f" delay={lag}"):
        adapter = InputAdapter(InputMap.from_parameters({**lines, "airspeed": f"air tas{more}"}), STATES, ("de",))
        pushed = [adapter.push("/air", flight.stamp(k), one) for k, one in enumerate(measured)]
        rows = [row for found in pushed for row in found if isinstance(row, StateRow)]
        places = [(row.stamp - flight.stamp(0)) // 10_000_000 for row in rows]
        errors.append(np.std(np.array([row.x[0] for row in rows]) - flight.x[places, 0]))
    assert errors[1] < 0.15 * errors[0] and errors[1] < 0.3 * errors[2], errors


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"airspeed": "air tas"}, "cannot be used without 'alpha', 'beta'"),
        ({"velocity": "air ground frame=ned", "vane_position": [1.0, 0.0, 0.0]}, "vane_position is given, but no"),
        ({"velocity": "air ground frame=ned", "wind": "air north,east", "attitude": None, "states.Phi": "air tas"},
         "'Theta' comes from nowhere|cannot be used without"),
        ({"velocity": "air ground scale=1,2"}, "scale has 2 numbers; expected 1 or 3"),
        ({"attitude": "air q frame=frd/ned lag=0.1"}, "'lag' does not exist here"),
        ({"velocity": "air ground lag=-0.1"}, "lag is '-0.1'; it must be a number from 0 to 10"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused(changes: dict[str, Any], said: str) -> None:
    lines = {k: v for k, v in {**LINES, **changes}.items() if v is not None}
    with pytest.raises(EstimationError, match=said):
        InputAdapter(InputMap.from_parameters(lines), Configuration().states, ("de",))
