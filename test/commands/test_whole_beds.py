"""Whole flights: from rest to rest, with numbers that jump away and back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks import calibration
from benchmarks.calibration_beds import Recorded, mapped
from benchmarks.servo_beds import SMALLS, trim
from benchmarks.whole_beds import REST, Pilot, WholeBed, move, whole_beds
from msls_ros.estimation import EventKind, Identifier
from msls_ros.inputs.derivatives import usual_intervals


@pytest.fixture(scope="module")
def bed() -> WholeBed:
    return next(one for one in whole_beds((25,)) if one.small == "measured" and one.gusts == 0.0 and one.spikes)


@pytest.fixture(scope="module")
def flight(bed: WholeBed) -> Recorded:
    return bed.fly(1)


def test_on_its_wheels_it_stands_still_and_in_the_air_it_flies_as_without_them(bed: WholeBed) -> None:
    one, pilot = SMALLS["measured"], Pilot(bed, 1)
    standing = move(one, pilot.x, pilot.height, np.zeros(3), 0.0, np.zeros(3))
    assert standing.touches
    assert np.abs(standing.rates[:3]).max() < 0.5
    x, delta, thrust = trim(one)
    flying = move(one, x, 50.0, delta, thrust, np.zeros(3))
    assert not flying.touches
    np.testing.assert_allclose(flying.rates[:6], 0.0, atol=1e-8)
    assert flying.climb == pytest.approx(0.0, abs=1e-9)


def test_a_flight_goes_from_rest_to_rest_and_has_a_truth_in_the_air_alone(flight: Recorded) -> None:
    aloft = np.isfinite(flight.truth_b).all(axis=(1, 2))
    first, last = (flight.truth_time[k] for k in np.flatnonzero(aloft)[[0, -1]])
    assert REST < first < 60.0 < last < flight.time[-1] - 10.0
    speed = np.linalg.norm(flight.x[:, :3], axis=1)
    assert np.median(speed[:100]) < 1.0 > np.median(speed[-100:])
    assert np.median(speed[(flight.time > first) & (flight.time < last)]) > 20.0


def test_through_take_off_and_spikes_it_is_right_and_names_nothing(bed: WholeBed, flight: Recorded) -> None:
    """Learnt from the ground on and with spikes, Q by de was off by nine tenths of it, and P by da had a false name."""
    configuration = bed.configuration(1)
    row = calibration.judge(bed, 1, flight, "mapped", configuration)
    assert row["isolations"] == []
    assert row["false_alarms"] <= 2
    phases = [cell for phase, cell in row["phases"]["B"].items() if phase in ("manoeuvre", "quiet")]
    assert calibration.phase_numbers(phases)["coverage"] > 0.9
    identifier = Identifier(configuration, usual_intervals(configuration.sample_rate))
    found = identifier.run(*mapped(flight, configuration.sample_rate), every=5).estimates
    assert identifier.grounded > REST * configuration.sample_rate
    for time in (60.0, 110.0, 150.0):
        estimate = next(one for one in found if one.time >= time)
        state, effector = configuration.states.index("Q"), configuration.effectors.index("de")
        true = calibration.truth_at(flight, estimate.time)[1][state, effector]
        error, std = estimate.b[state, effector] - true, estimate.b_std[state, effector]
        assert abs(error) < min(0.45 * abs(true), 1.96 * std)
    assert not [e for one in found for e in one.events if e.kind == EventKind.ISOLATED]


def test_the_same_seed_is_the_same_flight_and_spikes_alone_differ_without_them(bed: WholeBed) -> None:
    short = replace(bed, spikes=False)
    one, other = Pilot(short, 3), Pilot(bed, 3)
    x, delta = np.zeros((1000, 9)), np.zeros((1000, 3))
    other.jump(x, delta)
    moved = np.flatnonzero(np.abs(np.hstack([x[:, :6], delta])).max(axis=1))
    assert 5 <= len(moved) <= 24
    assert one.x.tobytes() == other.x.tobytes()
