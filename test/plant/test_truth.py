"""The true A(t), B(t): a tangent of the flight itself, damage included, that leaves the flight alone."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from msls_ros.plant import CONDITIONS, EFFECTORS, STATES, SURFACES_OF, Aircraft, Pilot, RollDoublet

HIGH_ALPHA = CONDITIONS["high_alpha"]
FOOT = 0.3048


def entry(matrix: np.ndarray, row: str, column: str) -> float:
    columns = STATES if column in STATES else EFFECTORS
    return float(matrix[STATES.index(row), columns.index(column)])


def fly(name: str, seconds: float, look: Callable[[Aircraft], None], *, excite: float = 0.003) -> None:
    aircraft = Aircraft(CONDITIONS[name])
    pilot = Pilot(aircraft.trim, aircraft.truth(), RollDoublet())
    random = np.random.default_rng(5)
    for _ in range(round(seconds * 50)):
        look(aircraft)
        command = pilot.command(aircraft.time, aircraft.sample().x) + random.standard_normal(7) * excite
        aircraft.step(command)
        aircraft.step(command)


@pytest.mark.parametrize("name", CONDITIONS)
def test_twin_computes_the_derivatives_of_the_flight(name: str) -> None:
    worst = np.zeros(9)

    def look(aircraft: Aircraft) -> None:
        difference = aircraft.twin_derivative() - aircraft.sample().xdot
        worst[:] = np.maximum(worst, np.abs(difference))
        if aircraft.time == 4.0:
            aircraft.damage("left_stabilator", 0.3, bias=0.02)

    fly(name, 8.0, look)
    assert worst.max() < 1e-7


@pytest.mark.parametrize("name", CONDITIONS)
def test_truth_predicts_the_next_derivatives(name: str) -> None:
    errors, changes = [], []
    previous: list[tuple[np.ndarray, np.ndarray]] = []

    def look(aircraft: Aircraft) -> None:
        sample, truth = aircraft.sample(), aircraft.truth()
        np.testing.assert_allclose(truth.a @ sample.x + truth.b @ sample.delta + truth.bias, sample.xdot, atol=1e-7)
        if previous:
            prediction, before = previous.pop()
            errors.append(prediction @ np.concatenate((sample.x, sample.delta, [1.0])) - sample.xdot)
            changes.append(sample.xdot - before)
        previous.append((np.column_stack((truth.a, truth.b, truth.bias)), sample.xdot))

    fly(name, 6.0, look)
    ratio = np.sqrt(np.mean(np.square(errors), axis=0) / np.mean(np.square(changes), axis=0))
    force = [STATES.index(name) for name in ("u", "w")]
    assert (ratio[force] < 0.1).all(), "what is left: the air gets denser in the descent, and height is no state"
    assert (np.delete(ratio, force) < 0.01).all()


def test_truth_at_the_papers_condition() -> None:
    truth = Aircraft(HIGH_ALPHA).truth()
    assert entry(truth.a, "P", "v") * FOOT == pytest.approx(-0.0205, abs=2e-4)
    assert entry(truth.a, "P", "P") == pytest.approx(-0.237, abs=0.002)
    assert entry(truth.a, "P", "R") == pytest.approx(0.547, abs=0.002)
    for effector, value in {"dr": 0.44, "ddt": 1.548, "ddf": 1.449, "dtr": 0.039}.items():
        assert entry(truth.b, "P", effector) == pytest.approx(value, abs=0.003)
    assert entry(truth.b, "R", "dr") == pytest.approx(-0.336, abs=0.002)
    assert entry(truth.b, "Q", "dte") == pytest.approx(-2.97, abs=0.02)
    assert entry(truth.b, "w", "de") < 0.0, "tail down lifts"
    lateral = [STATES.index(name) for name in ("v", "P", "R", "Phi")]
    modes = np.linalg.eigvals(truth.a[np.ix_(lateral, lateral)])
    dutch_roll = modes[np.argmax(modes.imag)]
    assert dutch_roll.real == pytest.approx(0.056, abs=0.02), "unstable"
    assert dutch_roll.imag == pytest.approx(1.59, abs=0.03)


def test_truth_in_cruise() -> None:
    assert entry(Aircraft(CONDITIONS["cruise"]).truth().b, "P", "ddt") == pytest.approx(15.67, abs=0.02)


def test_kinematic_rows_are_the_textbook_ones() -> None:
    aircraft = Aircraft(HIGH_ALPHA)
    a = aircraft.truth().a
    theta = aircraft.trim.x[7]
    assert entry(a, "Phi", "P") == pytest.approx(1.0, abs=1e-9)
    assert entry(a, "Phi", "R") == pytest.approx(math.tan(theta), abs=1e-6)
    assert entry(a, "Theta", "Q") == pytest.approx(1.0, abs=1e-6)
    assert entry(a, "Psi", "R") == pytest.approx(1.0 / math.cos(theta), abs=1e-6)
    assert np.abs(a[:, STATES.index("Psi")]).max() < 0.02, "heading matters only through the earth's rotation"
    assert np.abs(aircraft.truth().b[6:]).max() < 1e-9


def test_a_lost_left_stabilator_halves_b43() -> None:
    aircraft = Aircraft(HIGH_ALPHA)
    before = aircraft.truth().b
    sentence = aircraft.damage("left_stabilator", 0.0)
    after = aircraft.truth().b
    assert "left_stabilator lost" in sentence and "0.00 s" in sentence
    assert entry(before, "P", "ddt") == pytest.approx(1.55, abs=0.02)
    assert entry(after, "P", "ddt") == pytest.approx(0.5 * entry(before, "P", "ddt"), rel=1e-6)
    assert entry(after, "Q", "de") == pytest.approx(0.5 * entry(before, "Q", "de"), rel=0.05)
    assert entry(after, "P", "de") == pytest.approx(-0.5 * entry(before, "P", "ddt"), rel=1e-3), "it now rolls"
    untouched = [EFFECTORS.index(name) for name in ("dr", "ddf", "dsf", "dte", "dtr")]
    np.testing.assert_allclose(after[:, untouched], before[:, untouched], atol=0.05)


@pytest.mark.parametrize("effector", EFFECTORS)
def test_damage_of_an_effector_scales_its_column(effector: str) -> None:
    aircraft = Aircraft(CONDITIONS["cruise"])
    before = aircraft.truth().b
    sentence = aircraft.damage(effector, 0.25)
    assert all(surface in sentence for surface in SURFACES_OF[effector]) and "25% effective" in sentence
    after = aircraft.truth().b
    column = EFFECTORS.index(effector)
    scale = np.abs(before[:, column]).max()
    np.testing.assert_allclose(after[:, column], 0.25 * before[:, column], atol=0.08 * scale)


def test_bias_moves_the_air_but_not_the_measurement() -> None:
    aircraft = Aircraft(HIGH_ALPHA)
    b = aircraft.truth().b
    aircraft.damage("ddt", 1.0, bias=0.01)
    aircraft.step(aircraft.trim.delta)
    sample = aircraft.sample()
    np.testing.assert_allclose(sample.delta, aircraft.trim.delta, atol=1e-9)
    assert sample.xdot[3] == pytest.approx(0.01 * entry(b, "P", "ddt"), rel=1e-3)


def test_asking_for_the_truth_does_not_disturb_the_flight() -> None:
    flights = []
    for asks in (False, True):
        rows: list[np.ndarray] = []

        def look(aircraft: Aircraft, asks: bool = asks, rows: list[np.ndarray] = rows) -> None:
            if asks:
                aircraft.truth()
            sample = aircraft.sample()
            rows.append(np.concatenate((sample.x, sample.xdot, sample.delta)))

        fly("high_alpha", 4.0, look)
        flights.append(np.array(rows))
    np.testing.assert_array_equal(flights[0], flights[1])
