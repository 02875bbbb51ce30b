"""Manoeuvres of flight test: inputs have their shape, multisines are orthogonal and flat, pilots fly them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from msls_ros.flights.aircraft_files import find_aircraft
from msls_ros.plant import (
    CONDITIONS,
    F16_MATV,
    KINDS,
    Aircraft,
    FlightTest,
    PlantError,
    Segment,
    make_pilot,
    multisines,
    parse_manoeuvre,
    peak_factor,
)

C172X = find_aircraft("c172x").airframe
PITCH, ROLL, YAW = range(3)


def stick(line: str, axis: int, times: list[float], scale: float = 1.0) -> list[float]:
    """Inputs of one segment as shares of the aircraft's amplitude."""
    test = FlightTest((Segment.parse(line),), C172X, scale)
    return [test.stick(time)[axis] / C172X.amplitudes[axis] for time in times]


def test_a_3211_holds_three_two_one_and_one_pulses_by_turns() -> None:
    times = [0.0, 2.3, 2.5, 3.9, 4.1, 4.7, 4.9, 5.5, 5.7, 9.0]
    assert stick("elevator_3211 10", PITCH, times) == pytest.approx([1, 1, -1, -1, 1, 1, -1, -1, 0, 0])
    assert stick("elevator_3211 10 width=1.0", PITCH, [2.9, 3.1]) == pytest.approx([1, -1])


def test_doublets_banks_and_rests_have_their_shape_size_and_sign() -> None:
    assert stick("rudder_doublet 6 size=0.5", YAW, [0.5, 1.5, 2.5]) == pytest.approx([0.5, -0.5, 0.0])
    assert stick("aileron_doublet 6 width=2.0", ROLL, [1.5, 3.5, 4.5]) == pytest.approx([1.0, -1.0, 0.0])
    assert stick("bank_to_bank 27", ROLL, [1.0, 4.0, 8.0, 26.0]) == pytest.approx([1.0, -1.0, 1.0, 0.0])
    assert stick("bank_to_bank 27", ROLL, [1.0, 4.0], -0.75) == pytest.approx([-0.75, 0.75])
    assert stick("quiet 10", PITCH, [0.0, 5.0]) == [0.0, 0.0]


def test_a_sweep_passes_from_the_low_to_the_high_frequency() -> None:
    times = np.arange(0.0, 40.0, 0.01)
    found = np.array(stick("elevator_sweep 40 low=0.1 high=2.0", PITCH, times.tolist()))
    crossings = times[1:][np.diff(np.sign(found)) != 0]
    assert np.abs(found).max() == pytest.approx(1.0, abs=1e-3)
    assert 0.5 / np.diff(crossings)[-3:].mean() == pytest.approx(2.0, rel=0.1)
    assert 0.5 / np.diff(crossings)[0] < 0.4


def test_segments_follow_each_other_and_then_nothing_is_done() -> None:
    test = parse_manoeuvre("quiet 2; rudder_doublet 4; elevator_doublet 4;", C172X)
    assert isinstance(test, FlightTest) and test.duration == 10.0
    axes = [tuple(np.flatnonzero(test.stick(time))) for time in (1.0, 2.5, 6.5, 9.0, 20.0)]
    assert axes == [(), (YAW,), (PITCH,), (), ()]


@pytest.mark.parametrize(("number", "duration"), [(3, 20.0), (7, 30.0)])
def test_multisines_are_orthogonal_flat_and_begin_at_zero(number: int, duration: float) -> None:
    sines = multisines(number, duration, 0.1, 1.6)
    times = np.arange(0.0, duration, 0.01)
    waves = np.array([[sine.at(time) for time in times] for sine in sines])
    gram = waves @ waves.T
    correlation = gram / np.sqrt(np.outer(np.diag(gram), np.diag(gram)))
    assert np.abs(correlation - np.eye(number)).max() < 1e-9
    assert len({k for sine in sines for k in sine.harmonics}) == sum(len(sine.harmonics) for sine in sines)
    for sine, wave in zip(sines, waves, strict=True):
        n, turn = len(sine.harmonics), 2.0 * math.pi * times / duration
        schroeder = [-math.pi * i * (i + 1) / n for i in range(n)]
        plain = sum(np.cos(k * turn + phase) for k, phase in zip(sine.harmonics, schroeder, strict=True))
        assert peak_factor(wave) <= peak_factor(np.asarray(plain)) + 1e-3
        assert peak_factor(wave) < 1.45
        assert abs(sine.at(0.0)) < 0.1 * sine.peak
        assert np.abs(wave).max() == pytest.approx(sine.peak, rel=0.02)


def test_a_multisine_moves_every_effector_within_its_amplitude() -> None:
    test = parse_manoeuvre("multisine 20 size=0.5;", F16_MATV)
    assert isinstance(test, FlightTest)
    found = np.array([test.injected(time) for time in np.arange(0.0, 20.0, 0.02)])
    assert found.shape[1] == 7 and (found.std(axis=0) > 0.0).all()
    assert np.abs(found).max() <= 0.5 * max(F16_MATV.amplitudes) * 1.01
    assert not test.injected(25.0).any()


WRONG = {
    "elevator_3212 8": "'elevator_3211'",
    "quiet": "WORD SECONDS",
    "quiet -1": "duration -1",
    "quiet ten": "expected numbers",
    "quiet 5 loud=1": "'loud=1'",
    "elevator_sweep 10 low=3 high=1": "more than low",
    "multisine 2": "expected at least two for each of 3 effectors",
}


@pytest.mark.parametrize("line", WRONG)
def test_what_is_no_segment_is_refused_in_one_sentence(line: str) -> None:
    with pytest.raises(PlantError) as caught:
        parse_manoeuvre(f"{line};", C172X)
    assert WRONG[line] in str(caught.value) and "\n" not in str(caught.value)


def test_a_segment_is_written_as_it_is_read() -> None:
    for kind in KINDS:
        segment = Segment(kind, 12.5, size=-0.75, width=0.3, low=0.2, high=1.5)
        assert Segment.parse(str(segment)) == segment


def fly(name: str, manoeuvre: str, seconds: float) -> np.ndarray:
    condition = CONDITIONS["cruise"] if name == "f16_matv" else find_aircraft(name).condition("")
    aircraft = Aircraft(condition)
    pilot = make_pilot(aircraft.trim, aircraft.truth(), parse_manoeuvre(manoeuvre, aircraft.airframe))
    states = []
    for _ in range(round(seconds * 25)):
        sample = aircraft.sample()
        states.append(sample.x)
        command = pilot.command(aircraft.time, sample.x)
        for _ in range(4):
            aircraft.step(command)
    return np.array(states)


@pytest.mark.parametrize("name", ["c172x", "A4", "T37", "J3Cub", "f16_matv"])
def test_every_aircraft_flies_the_inputs_and_comes_back(name: str) -> None:
    x = fly(name, "quiet 1; elevator_3211 9; rudder_doublet 6; bank_to_bank 36;", 52.0)
    assert np.degrees(np.abs(x[:, 4]).max()) > 1.0 and np.degrees(np.abs(x[:, 6]).max()) > 5.0
    assert np.degrees(np.abs(x[:, 6]).max()) < 80.0 and np.degrees(np.ptp(x[:, 7])) < 40.0
    assert np.degrees(np.abs(x[-1, 6])) < 20.0


def test_the_pilot_s_lag_and_time_going_back() -> None:
    aircraft = Aircraft(find_aircraft("c172x").condition(""))
    test = parse_manoeuvre("elevator_doublet 5;", aircraft.airframe)
    pilot, fresh = (make_pilot(aircraft.trim, aircraft.truth(), test) for _ in range(2))
    first = [pilot.command(0.04 * k, aircraft.trim.x) for k in range(20)]
    moved = (first[3] - aircraft.trim.delta)[0]
    assert moved == pytest.approx(C172X.amplitudes[0] * -math.expm1(-0.12 / 0.12), rel=1e-6)
    again = [pilot.command(0.04 * k, aircraft.trim.x) for k in range(20)]
    np.testing.assert_array_equal(again, [fresh.command(0.04 * k, aircraft.trim.x) for k in range(20)])
    with pytest.raises(PlantError, match="finite"):
        pilot.command(math.nan, aircraft.trim.x)
