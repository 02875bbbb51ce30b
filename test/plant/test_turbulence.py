"""Turbulence: the published gusts, decided by the seed, known to the truth, absent from still air."""

from __future__ import annotations

import hashlib
import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from msls_ros.plant import CONDITIONS, MANOEUVRES, TURBULENCE, Aircraft, Pilot, PlantError, Steady
from msls_ros.plant import airframe as airframe_module
from msls_ros.plant.stock import make_model
from msls_ros.plant.trim import find_trim

HIGH_ALPHA = CONDITIONS["high_alpha"]
CRUISE = CONDITIONS["cruise"]
FOOT = 0.3048


def record(aircraft: Aircraft, steps: int, *, ask: bool = False) -> np.ndarray:
    random = np.random.default_rng(11)
    rows = []
    for _ in range(steps):
        if ask:
            aircraft.truth()
        aircraft.step(aircraft.trim.delta + random.standard_normal(7) * 0.003)
        sample = aircraft.sample()
        rows.append(np.concatenate((sample.x, sample.xdot, sample.delta)))
    return np.array(rows)


def gusts(name: str, turbulence: str, seed: int, seconds: float) -> np.ndarray:
    """Return the air's velocities and rates in body axes (n, 6), at 50 Hz, of a flight that holds its trim."""
    aircraft = Aircraft(CONDITIONS[name], turbulence=turbulence, seed=seed, velocities="inertial")
    pilot = Pilot(aircraft.trim, aircraft.truth(), Steady())
    rows = []
    for _ in range(round(seconds * 50)):
        x = aircraft.sample().x
        rows.append(x[:6] - aircraft.air_relative())
        command = pilot.command(aircraft.time, x)
        aircraft.step(command)
        aircraft.step(command)
    return np.array(rows)


def rotation(x: np.ndarray) -> np.ndarray:
    """Body to north-east-down."""
    (cf, ct, cp), (sf, st, sp) = np.cos(x[6:9]), np.sin(x[6:9])
    return np.array(
        [
            [ct * cp, sf * st * cp - cf * sp, cf * st * cp + sf * sp],
            [ct * sp, sf * st * sp + cf * cp, cf * st * sp - sf * cp],
            [-st, sf * ct, cf * ct],
        ]
    )


def test_the_seed_decides_the_flight_in_this_process_and_in_another() -> None:
    def fresh() -> Aircraft:
        return Aircraft(HIGH_ALPHA, turbulence="moderate", seed=4)

    first = record(fresh(), 300)
    record(Aircraft(CRUISE, turbulence="severe", seed=9), 50)
    np.testing.assert_array_equal(first, record(fresh(), 300))
    np.testing.assert_array_equal(first, record(fresh(), 300, ask=True))
    program = (
        "import sys; sys.path.insert(0, sys.argv[1])\n"
        "import hashlib\n"
        "from plant.test_turbulence import HIGH_ALPHA, Aircraft, record\n"
        "flight = record(Aircraft(HIGH_ALPHA, turbulence='moderate', seed=4), 300)\n"
        "print(hashlib.sha256(flight.tobytes()).hexdigest())\n"
    )
    root = str(Path(airframe_module.__file__).parents[2])
    done = subprocess.run(
        [sys.executable, "-c", program, str(Path(__file__).parents[1])],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": root, "PYTHONDONTWRITEBYTECODE": "1"},
        timeout=60,
        check=True,
    )
    assert done.stdout.strip() == hashlib.sha256(first.tobytes()).hexdigest()


def test_the_rounding_of_the_trim_does_not_choose_the_gusts() -> None:
    def fly(north: float) -> np.ndarray:
        trim = find_trim(CRUISE)
        model = make_model(CRUISE, 100)
        model.begin(trim.x, trim.delta, trim.throttle, trim.place)
        model._fdm.set_property_value("atmosphere/wind-north-fps", north)  # as another BLAS leaves it
        model.stir(TURBULENCE["moderate"], 4)
        for _ in range(50):
            model.run()
        return np.array(model.surroundings().wind)

    wind = fly(1e-13)
    assert np.abs(wind[:2]).min() > 0.1
    np.testing.assert_allclose(fly(-1e-13), wind, rtol=1e-9)


def test_two_flights_side_by_side_keep_their_own_gusts() -> None:
    alone = record(Aircraft(CRUISE, turbulence="light", seed=1), 100)
    first, second = (Aircraft(CRUISE, turbulence="light", seed=seed) for seed in (1, 2))
    random = np.random.default_rng(11)
    for row in alone:
        command = first.trim.delta + random.standard_normal(7) * 0.003
        first.step(command)
        second.step(command)
        np.testing.assert_array_equal(first.sample().x, row[:9])


def test_neighbouring_seeds_meet_unlike_gusts() -> None:
    runs = np.array([gusts("cruise", "moderate", seed, 20.0)[:, 2] for seed in range(6)])
    correlation = np.corrcoef(runs)
    assert np.abs(correlation - np.eye(6)).max() < 0.8
    assert abs(np.mean(correlation[~np.eye(6, dtype=bool)])) < 0.2


@pytest.mark.parametrize("velocities", ["air", "inertial"])
def test_still_air_is_still_whatever_seed_and_velocities(velocities: str) -> None:
    np.testing.assert_array_equal(
        record(Aircraft(HIGH_ALPHA, seed=7, velocities=velocities), 200), record(Aircraft(HIGH_ALPHA), 200)
    )


@pytest.mark.parametrize(("turbulence", "published"), [("light", 3.65), ("moderate", 7.3), ("severe", 21.05)])
def test_gusts_at_20000_ft_are_those_of_mil_f_8785c(turbulence: str, published: float) -> None:
    flights = np.array([gusts("cruise", turbulence, seed, 45.0)[500:] for seed in range(5)])
    rms = np.sqrt(np.mean(flights**2, axis=(0, 1)))
    np.testing.assert_allclose(rms[:3], published * FOOT, rtol=0.25)
    assert rms[3] == pytest.approx(1.9 * published / math.sqrt(1750.0 * 30.0), rel=0.15), "Yeager (1998), eq 8"
    assert (rms[4:] < rms[3]).all() and (rms[4:] > 0.3 * rms[3]).all()


def test_gusts_are_coloured_as_dryden_has_them() -> None:
    flights = np.array([gusts("cruise", "moderate", seed, 100.0)[500:, :3] for seed in range(4)])
    tau = 1750.0 * FOOT / 189.6
    variance = np.mean(flights**2, axis=(0, 1))
    after_half_a_second = np.mean(flights[:, 25:] * flights[:, :-25], axis=(0, 1)) / variance
    decay = math.exp(-0.5 / tau)
    np.testing.assert_allclose(after_half_a_second, [decay, *[decay * (1.0 - 0.25 / tau)] * 2], atol=0.08)


@pytest.mark.parametrize(("velocities", "tolerance"), [("air", 2e-3), ("inertial", 1e-7)])
@pytest.mark.parametrize("name", CONDITIONS)
def test_twin_computes_the_derivatives_of_the_flight_in_turbulence(
    name: str, velocities: str, tolerance: float
) -> None:
    aircraft = Aircraft(CONDITIONS[name], turbulence="moderate", seed=2, velocities=velocities)
    pilot = Pilot(aircraft.trim, aircraft.truth(), MANOEUVRES["strong"])
    for k in range(700):
        sample = aircraft.sample()
        difference = np.abs(aircraft.twin_derivative() - sample.xdot)
        assert difference[:3].max() < tolerance, "air: the earth turns and curves under the moving air, 1e-3 m/s^2"
        assert difference[3:].max() < 1e-7
        if k % 50 == 0:
            truth = aircraft.truth()
            np.testing.assert_allclose(truth.a @ sample.x + truth.b @ sample.delta + truth.bias, sample.xdot, atol=1e-3)
        if k == 400:
            aircraft.damage("left_stabilator", 0.3, bias=0.02)
        command = pilot.command(aircraft.time, sample.x)
        aircraft.step(command)
        aircraft.step(command)


def test_the_truth_of_the_gusts_is_that_of_the_air_they_make() -> None:
    aircraft = Aircraft(CRUISE, turbulence="severe", seed=3)
    record(aircraft, 1500)
    sample, truth = aircraft.sample(), aircraft.truth()
    air_rates = sample.x[3:6] - aircraft.air_relative()[3:6]
    still = Aircraft(CRUISE).truth()
    assert np.linalg.norm(air_rates) > 0.05
    assert truth.a[3, 3] == pytest.approx(still.a[3, 3], rel=0.3)
    felt = truth.a[3, 3:6] @ air_rates
    assert abs(felt) > 0.01, "the roll rate of the air is in the bias, for no state has it"


def test_both_velocities_accelerate_alike_over_the_ground() -> None:
    air, inertial = (Aircraft(HIGH_ALPHA, turbulence="moderate", seed=5, velocities=v) for v in ("air", "inertial"))
    furthest = 0.0
    for _ in range(300):
        for aircraft in (air, inertial):
            aircraft.step(aircraft.trim.delta)
        a, b = air.sample(), inertial.sample()
        np.testing.assert_array_equal(a.x[:3], air.air_relative()[:3])
        np.testing.assert_array_equal(a.x[3:], b.x[3:])
        over_ground = [rotation(s.x) @ (s.xdot[:3] + np.cross(s.x[3:6], s.x[:3])) for s in (a, b)]
        np.testing.assert_allclose(over_ground[0], over_ground[1], atol=1e-9)
        furthest = max(furthest, float(np.abs(a.x[:3] - b.x[:3]).max()))
    assert furthest > 1.0


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("turbulence", "strong"),
        ("turbulence", ""),
        ("seed", -1),
        ("seed", 1.5),
        ("seed", True),
        ("seed", "x"),
        ("velocities", "ground"),
        ("velocities", ""),
    ],
)
def test_unknown_turbulence_is_refused(key: str, value: object) -> None:
    with pytest.raises(PlantError, match="expected"):
        Aircraft(CRUISE, **{key: value})  # type: ignore[arg-type]


def test_any_seed_will_do() -> None:
    assert list(TURBULENCE) == ["none", "light", "moderate", "severe"]
    flights = [
        record(Aircraft(CRUISE, turbulence="light", seed=seed), 5).tobytes() for seed in (0, 1, 2**31, 2**32, 10**30)
    ]
    assert len(set(flights)) == len(flights)
