"""Rows of a table of many flights: each flight judged once, alone or beside others, and kept where a run can go on."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path
from typing import Any

from benchmarks.calibration_beds import Bed, keep_row, kept_rows
from msls_ros.fleet import FleetError, run

Row = dict[str, Any]
ONE_PATH = ("",)


@dataclass(frozen=True)
class Flight:
    """What is flown and judged in one go."""

    bed: Bed
    seed: int
    paths: tuple[str, ...] = ONE_PATH
    """Of the samples to the identifier: a row each, which names its path where there are several."""


Judge = Callable[[Flight], list[Row]]
"""Flies, and returns a row for each path."""


def judge_flights(
    judge: Judge,
    flights: Sequence[Flight],
    folder: Path | None,
    name: str,
    say: Callable[[str], None],
    *,
    jobs: int = 1,
    stopped: Callable[[], bool] = lambda: False,
) -> list[Row]:
    """Return the rows of flights, in the order of the flights; what an earlier call has kept is not judged again.

    Parameters
    ----------
    judge
        For several jobs: a function of a module that worker processes can import, or a partial one.
    flights
        All that are wanted.
    folder, name
        Where rows are kept (None: nowhere), and the name of their file there, which this process alone writes.
    say
        Called with a line about every flight: when it begins, with several jobs when it has ended.
    jobs
        Flights at a time: 1 in this process, more in as many worker processes.
    stopped
        Whether to end now; see `msls_ros.fleet.run`.

    Raises
    ------
    FleetError
        As `msls_ros.fleet.run` does; when all others are done, of flights that kill their workers again and again.
    KeyboardInterrupt
        If it was stopped.
    """
    file, earlier = kept_rows(folder, name)
    rows = {(row["bed"], row["seed"], row.get("path", "")): row for row in earlier}
    number = count(1)

    def tell(flight: Flight) -> None:
        say(f"{next(number)} of {len(flights)}: {flight.bed.name}, seed {flight.seed}")

    todo = []
    for flight in flights:
        missing = tuple(path for path in flight.paths if (flight.bed.name, flight.seed, path) not in rows)
        if missing:
            todo.append(replace(flight, paths=missing))
        else:
            tell(flight)
    with closing(_ends(judge, todo, tell, jobs, stopped)) as ends:
        for flight, found in ends:
            for path, row in zip(flight.paths, found, strict=True):
                keep_row(file, row)
                rows[flight.bed.name, flight.seed, path] = row
    return [rows[flight.bed.name, flight.seed, path] for flight in flights for path in flight.paths]


def _ends(
    judge: Judge,
    todo: Sequence[Flight],
    tell: Callable[[Flight], None],
    jobs: int,
    stopped: Callable[[], bool],
) -> Generator[tuple[Flight, list[Row]], None, None]:
    """Give each flight with its rows when it has ended."""

    def tell_and_judge(flight: Flight) -> list[Row]:
        tell(flight)
        return judge(flight)

    lost = []
    with closing(run(tell_and_judge if jobs == 1 else judge, todo, jobs=jobs, stopped=stopped)) as ends:
        for end in ends:
            if stopped():  # and the exception was swallowed: what has come may be wrong
                break
            flight = todo[end.index]
            if jobs > 1:
                tell(flight)
            if end.result is None:
                lost.append(f"{flight.bed.name}, seed {flight.seed}: {end.error}")
            else:
                yield flight, end.result
    if stopped():
        raise KeyboardInterrupt
    if lost:
        raise FleetError("; ".join(lost))
