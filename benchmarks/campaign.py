"""Flights of a campaign against the clock: flown, identified, compared with peers and truth, as a row."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from time import perf_counter
from typing import Any

from msls_ros.campaigns.flight import fly_task
from msls_ros.campaigns.plan import plan, tasks_of
from msls_ros.flights.spread import spread

SCENARIO, NOISE = "roll_doublet_tail_fault", "low"


def measure(flights: int, say: Callable[[str], None]) -> dict[str, Any]:
    """Time flights in this process, one after the other.

    Parameters
    ----------
    flights
        How many are timed; one more, which compiles, is not.
    say
        Called with a line of progress.

    Returns
    -------
    dict
        Simulated over wall-clock time [1] and wall-clock time per flight [ms]: median and range.
    """
    cells = plan([SCENARIO], [NOISE], [], dither=True)
    scenario = cells[0].scenario
    first, *timed = tasks_of(cells, 0, flights + 1)
    say("a flight to compile and to warm up")
    fly_task(first)
    say(f"{flights} flights of {scenario.duration:g} s")
    times = []
    for task in timed:
        start = perf_counter()
        row = fly_task(task)
        times.append(perf_counter() - start)
        assert row["error"] is None, row
    return {
        "scenario": SCENARIO,
        "noise": NOISE,
        "flights": flights,
        "simulated_s": scenario.duration,
        "truth_hz": scenario.rates.truth,
        "x_real_time": asdict(spread(scenario.duration / wall for wall in times)),
        "flight_ms": asdict(spread(1e3 * wall for wall in times)),
    }
