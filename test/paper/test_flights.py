"""The paper's F-16 flights on few seeds: what holds there, and that the closed loop behind them is the demo's."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from msls_ros.flights.closed_loop import Flight, fly
from msls_ros.paper.flight_claims import (
    Row,
    claims_on_flights,
    exciting_errors,
    flight_acceptance,
    render_rows,
    rows_of,
)
from msls_ros.paper.flight_experiments import SCENARIO, Flights, count_flights, flights_of, run_flights
from msls_ros.paper.flight_figures import flight_figures
from msls_ros.plant import Fault, PlantError

SEEDS = 3

KNOWN_MISS = "Fig 9, low noise: RLS largest error over that of MSLS"
"""In low noise the peak of RLS is its own noise: over 50 flights 1.5 times that of MSLS, which no estimate of a number
that halves at once can bring below one half."""


@pytest.fixture(scope="module")
def flights() -> Flights:
    flown = 0

    def done() -> None:
        nonlocal flown
        flown += 1

    found = run_flights(SEEDS, done)
    assert flown == count_flights(SEEDS)
    return found


@pytest.fixture(scope="module")
def rows(flights: Flights) -> list[Row]:
    return rows_of(flights)


def row(rows: list[Row], condition: str, quantity: str) -> Row:
    return next(one for one in rows if one.condition == condition and one.quantity.startswith(quantity))


def test_msls_tells_the_roll_due_to_heave_where_rls_is_ten_times_worse(flights: Flights) -> None:
    ours, nine, rls = exciting_errors(flights.exciting)
    assert ours <= 0.30
    assert np.median(flights.exciting.correlation("msls")) >= 0.7
    assert rls >= 10.0 * nine and rls >= 10.0 * ours
    assert ours < 0.8 * np.median(flights.exciting.zero_error)


def test_elsewhere_it_is_not_told_and_nowhere_called_reliable(flights: Flights) -> None:
    assert len(flights.variations) == 4
    for one in flights.variations.values():
        assert np.median(one.correlation("msls")) < 0.7
        assert one.reliable < 0.05
    assert flights.exciting.reliable < 0.05


def test_every_bound_on_the_flights_holds_but_the_known_miss(flights: Flights) -> None:
    table = flight_acceptance(flights)
    assert len(table) == len({one.statistic for one in table}) == 18
    assert {one.statistic for one in table if not one.ok} <= {KNOWN_MISS}


def test_swapping_the_estimators_breaks_bounds_and_claims(flights: Flights) -> None:
    exciting = flights.exciting
    swapped = {"msls": "rls", "rls": "msls", "msls_nine": "rls_nine", "rls_nine": "msls_nine"}
    losses = {}
    for noise, found in flights.losses.items():
        b43 = [
            dict(one.summary["b43"], msls=one.summary["b43"]["rls"], rls=one.summary["b43"]["msls"]) for one in found
        ]
        losses[noise] = [
            dataclasses.replace(one, summary={**one.summary, "b43": numbers})
            for one, numbers in zip(found, b43, strict=True)
        ]
    worse = dataclasses.replace(
        flights,
        exciting=dataclasses.replace(exciting, estimates={n: exciting.estimates[m] for n, m in swapped.items()}),
        losses=losses,
    )
    assert sum(not one.ok for one in flight_acceptance(worse)) >= 6
    before, after = claims_on_flights(flights), claims_on_flights(worse)
    assert [one.verdict for one in before[:3]] == ["partly", "reproduced", "not"]
    assert [one.verdict for one in after[:3]] == ["not", "not", "reproduced"]


def test_detection_and_dither_do_what_the_paper_says(flights: Flights) -> None:
    assert [one.verdict for one in claims_on_flights(flights)[3:]] == ["reproduced"] * 4


def test_the_table_names_the_better_estimator_also_where_it_is_rls(rows: list[Row]) -> None:
    for noise in ("noise-free", "low noise"):
        assert row(rows, f"b43, {noise}", "rms error before").better == "rls"
        assert row(rows, f"b43, {noise}", "rms error later").better == "msls"
    text = render_rows(rows)
    assert "RLS" in {line.split()[-1] for line in text.splitlines()[1:]}
    assert all(len(line) <= 140 for line in text.splitlines())


def test_without_dither_b43_is_never_called_reliable(rows: list[Row]) -> None:
    for noise in ("noise-free", "low noise"):
        assert row(rows, f"b43, {noise}, no dither", "called reliable").msls.high <= 5.0
    assert row(rows, "b43, noise-free", "called reliable").msls.low >= 95.0


def test_ranges_enclose_medians(rows: list[Row]) -> None:
    for one in rows:
        for value in (one.msls, one.msls_no_detection, one.rls, one.bank):
            assert value is None or value.low <= value.median <= value.high


def test_captions_say_what_differs_from_the_paper(flights: Flights) -> None:
    seven, eight, nine = flight_figures(flights)
    for one in (seven, eight):
        assert "Not the two-pound doublet" in one.own_caption
        assert "noise-free" in one.own_caption
    assert nine.change == 4.0 and nine.alarms == pytest.approx((4.02,))
    assert nine.estimate.shape == nine.truth.shape == (SEEDS, 600)


def test_half_as_many_flights_as_seeds_but_no_fewer_than_three() -> None:
    assert [flights_of(seeds) for seeds in (1, 7, 8, 100)] == [3, 3, 4, 50]


def test_the_truth_changes_between_the_sample_of_the_fault_and_the_next() -> None:
    fault = Fault("left_stabilator", 0.3, 0.0)
    log = fly(SCENARIO.configuration("none", 0, True), Flight("none", 0, 0.6, faults=(fault,)))
    truth = log.truth(lambda one: one.b)[:, 3, 2]
    assert len(log.time) == len(truth) == 30
    assert truth[15] == pytest.approx(truth[0], rel=0.01)
    assert truth[16] == pytest.approx(0.5 * truth[0], rel=0.01)


def test_an_identifier_that_only_listens_gives_the_bits_of_the_one_that_flew() -> None:
    configuration = SCENARIO.configuration("low", 3, True)
    log = fly(configuration, Flight("low", 3, 1.0))
    heard = log.identify(configuration)
    again = fly(configuration, Flight("low", 3, 1.0))
    for one, other, third in zip(log.estimates, heard, again.estimates, strict=True):
        np.testing.assert_array_equal(one.b, other.b)
        np.testing.assert_array_equal(one.a, third.a)


def test_an_unknown_condition_is_refused() -> None:
    with pytest.raises(PlantError, match=r"'moon'.*high_alpha"):
        fly(SCENARIO.configuration("none", 0, True), Flight("none", 0, 1.0, condition="moon"))
