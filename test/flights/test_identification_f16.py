"""MSLS on the simulated F-16 with the dither of eq 23: what it must find, leave alone, and how honest its bars are."""

from __future__ import annotations

import numpy as np
import pytest
from flights.flown import FlightLog, fly

from msls_ros.estimation import Configuration, EventKind, Identifier
from msls_ros.inputs.profiles import read_profile
from msls_ros.paper.flight_experiments import LITERAL_DITHER, MSLS, MSLS_BY_NOISE
from msls_ros.plant import EFFECTORS, MANOEUVRES, STATES

ROWS = 6


RATIO = {"detector.mode": "ratio", "detector.window": 50, "detector.threshold": 3.5}
SETTINGS = {**MSLS_BY_NOISE, "med": {"estimator.penalty": 1e-2, **RATIO}}


def configuration(noise: str, seed: int) -> Configuration:
    """Return MSLS with the shipped parameters as they are for low noise, adapted for the others."""
    if noise != "low":
        return quiet_flight(noise, seed)
    return read_profile("f16").replace({**MSLS, **LITERAL_DITHER, "dither.seed": seed})


def quiet_flight(noise: str, seed: int) -> Configuration:
    """Return MSLS as it suits a flight in which nothing moves fast."""
    return read_profile("f16").replace({**MSLS, **LITERAL_DITHER, **SETTINGS[noise], "dither.seed": seed})


def loss(noise: str, seed: int, left: float, duration: float = 5.2) -> FlightLog:
    return fly(
        configuration(noise, seed), noise=noise, seed=seed, duration=duration, fault=("left_stabilator", 4.0, left)
    )


@pytest.mark.parametrize(
    ("noise", "left", "within"), [("none", 0.5, 0.04), ("low", 0.0, 0.04), ("low", 0.5, 0.5), ("med", 0.0, 0.2)]
)
def test_a_loss_is_seen_in_time_in_ten_of_ten_flights(noise: str, left: float, within: float) -> None:
    seen, false = 0, 0
    for seed in range(10):
        alarms = loss(noise, seed, left).alarms()
        seen += any(4.0 < t <= 4.0 + within + 1e-9 for t in alarms)
        false += sum(t <= 4.0 for t in alarms)
    assert (seen, false) == (10, 0)


def test_half_a_stabilator_in_medium_noise_is_seen_in_nine_of_ten() -> None:
    assert sum(any(4.0 < t <= 4.5 for t in loss("med", seed, 0.5).alarms()) for seed in range(10)) >= 9


def test_an_intact_aircraft_in_medium_noise_alarms_at_most_once_in_200_s() -> None:
    assert len(fly(configuration("med", 77), noise="med", seed=77, duration=200.0).alarms()) <= 1


def test_isolation_names_both_effectors_with_half_of_their_effect_left_within_a_second() -> None:
    for seed in range(6):
        named = {}
        for event in loss("low", seed, 0.0).events:
            if event.kind == EventKind.ISOLATED and event.time <= 5.0:
                named[event.suspected_effector] = event.effectiveness
        assert abs(named["ddt"] - 0.5) <= 0.1, (seed, named)
        assert abs(named["de"] - 0.5) <= 0.1, (seed, named)
        assert set(named) == {"de", "ddt"}


def test_recovery_is_announced_once_the_penalty_is_back() -> None:
    events = loss("low", 0, 0.0, 6.0).events
    recovered = [e for e in events if e.kind == EventKind.RECOVERED]
    detected = [e for e in events if e.kind == EventKind.DETECTED]
    assert len(recovered) == len(detected) == 1
    assert recovered[0].equations == detected[0].equations
    assert recovered[0].time == pytest.approx(4.02 + 4 * 14 * 0.02 - 0.02)


@pytest.mark.parametrize("turbulence", ["none", "moderate"])
def test_a_strong_manoeuvre_of_an_intact_aircraft_alarms_at_most_three_times(turbulence: str) -> None:
    for seed in (0, 1):
        log = fly(
            configuration("low", seed),
            noise="low",
            seed=seed,
            duration=170.0,
            manoeuvre=MANOEUVRES["strong"],
            turbulence=turbulence,
        )
        assert len(log.alarms("PQR")) <= 3
        assert all(np.isfinite(e.a).all() and np.isfinite(e.b).all() for e in log.estimates)


@pytest.mark.parametrize(("turbulence", "least"), [("none", 18), ("moderate", 12)])
def test_half_of_ddt_lost_in_use_is_seen_in_the_strong_manoeuvre(turbulence: str, least: int) -> None:
    manoeuvre, seen = MANOEUVRES["strong"], 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        at = 0.0
        while not (manoeuvre.active(at) and manoeuvre.active(at + 0.3)):
            at = round(rng.uniform(12.0, 22.0) * 50.0) / 50.0
        log = fly(
            configuration("low", seed),
            noise="low",
            seed=seed,
            duration=at + 0.6,
            manoeuvre=manoeuvre,
            fault=("ddt", at, 0.5),
            turbulence=turbulence,
        )
        seen += any(at < t <= at + 0.5 + 1e-9 for t in log.alarms())
    assert seen >= least


def coverage(log: FlightLog, *, reliable_only: bool) -> tuple[float, int]:
    """Share of the true values inside the 95 % band, over rows u..R of A and B after the first second."""
    hits: list[np.ndarray] = []
    for k, truth in log.truths.items():
        e = log.estimates[k]
        if k < 50:
            continue
        error = np.concatenate([np.abs(e.a - truth.a)[:ROWS, :ROWS], np.abs(e.b - truth.b)[:ROWS]], axis=1)
        std = np.concatenate([e.a_std[:ROWS, :ROWS], e.b_std[:ROWS]], axis=1)
        use = np.concatenate([e.a_reliable[:ROWS, :ROWS], e.b_reliable[:ROWS]], axis=1)
        hits.append((error <= 1.96 * std)[use if reliable_only else np.ones_like(use)])
    every = np.concatenate(hits)
    return float(every.mean()), len(every)


@pytest.mark.parametrize("colour", [0.0, 0.95])
def test_error_bars_cover_the_truth_with_dither(colour: float) -> None:
    shares = [
        coverage(fly(configuration("low", s), noise="low", seed=s, duration=12.0, colour=colour), reliable_only=False)[
            0
        ]
        for s in range(6)
    ]
    assert 0.88 <= float(np.mean(shares)) <= 0.99


def pooled_coverage(noise: str, turbulence: str, *, quiet: bool) -> tuple[float, int]:
    """Share of what is called reliable that is right, over four flights of 25 s, and its number."""
    hits = 0.0
    total = 0
    for seed in range(4):
        chosen = quiet_flight(noise, seed) if quiet else configuration(noise, seed)
        log = fly(chosen, noise=noise, seed=seed, duration=25.0, turbulence=turbulence)
        assert all(np.isfinite(e.a).all() and np.isfinite(e.b).all() for e in log.estimates)
        share, number = coverage(log, reliable_only=True)
        hits, total = hits + (share * number if number else 0.0), total + number
    return hits / max(total, 1), total


@pytest.mark.parametrize(
    ("noise", "quiet", "turbulence"),
    [
        ("none", True, "light"),
        ("none", True, "moderate"),
        ("none", True, "severe"),
        ("low", True, "light"),
        ("low", True, "moderate"),
        ("low", True, "severe"),
        ("low", False, "moderate"),
        ("low", False, "severe"),
    ],
)
def test_what_is_called_reliable_in_turbulence_is(noise: str, quiet: bool, turbulence: str) -> None:
    share, number = pooled_coverage(noise, turbulence, quiet=quiet)
    assert number >= 50
    assert share >= 0.85


@pytest.fixture(scope="module")
def minutes_of_turbulence() -> list[FlightLog]:
    return [fly(configuration("low", s), noise="low", seed=s, duration=120.0, turbulence="moderate") for s in range(4)]


@pytest.mark.parametrize("part", ["a", "b"])
def test_of_a_and_of_b_each_what_is_called_reliable_in_minutes_of_turbulence_is(
    part: str, minutes_of_turbulence: list[FlightLog]
) -> None:
    hits: list[np.ndarray] = []
    columns = ROWS if part == "a" else len(EFFECTORS)
    for log in minutes_of_turbulence:
        for k, truth in log.truths.items():
            e, true = log.estimates[k], getattr(truth, part)[:ROWS, :columns]
            error = np.abs(getattr(e, part)[:ROWS, :columns] - true)
            inside = error <= 1.96 * getattr(e, f"{part}_std")[:ROWS, :columns]
            hits.append(inside[getattr(e, f"{part}_reliable")[:ROWS, :columns]] if k >= 50 else inside[:0, 0])
    every = np.concatenate(hits)
    assert len(every) >= 50
    assert every.mean() >= 0.85


@pytest.mark.parametrize(("noise", "least"), [("none", 0.93), ("low", 0.7)])
def test_what_is_called_reliable_in_a_strong_manoeuvre_mostly_is(noise: str, least: float) -> None:
    hits, total = 0.0, 0
    for seed in range(2):
        chosen = quiet_flight("none", seed) if noise == "none" else configuration("low", seed)
        log = fly(chosen, noise=noise, seed=seed, duration=40.0, manoeuvre=MANOEUVRES["strong"])
        share, number = coverage(log, reliable_only=True)
        hits, total = hits + share * number, total + number
    assert total >= 500
    assert hits / total >= least


@pytest.mark.parametrize(("turbulence", "moves"), [("none", False), ("light", True)])
def test_the_identifier_knows_whether_the_air_moves(turbulence: str, moves: bool) -> None:
    identifier = Identifier(configuration("low", 0))
    log = fly(configuration("low", 0), noise="low", seed=0, duration=10.0, turbulence=turbulence)
    identifier.run(np.array(log.time), np.array(log.x), np.array(log.xdot), np.array(log.delta))
    assert identifier.moving_air == moves
    assert (identifier.air > 0.1) == moves


def test_in_still_air_the_roll_power_stays_reliable() -> None:
    log = fly(quiet_flight("low", 0), noise="low", seed=0, duration=12.0)
    p, ddt = STATES.index("P"), EFFECTORS.index("ddt")
    assert np.mean([e.b_reliable[p, ddt] for e in log.estimates[50:]]) >= 0.8
