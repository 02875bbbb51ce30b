"""`campaign`: fly scenarios over many seeds, noises and settings, without ROS; medians and ranges in one table."""

from __future__ import annotations

import argparse
import json
import shlex
import sys
import time
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import Any

from msls_ros.campaigns.flight import Cell, Row, Task, failed, fly_task, versions
from msls_ros.campaigns.plan import PlanError, comparison, explain, name_of, noise_list, plan, tasks_of
from msls_ros.campaigns.store import SUMMARY, TABLE, Store, StoreError, csv_of
from msls_ros.campaigns.table import render, summarise
from msls_ros.commands.arguments import OneLineParser, add_fleet, count, seed
from msls_ros.commands.compiling import compile_once
from msls_ros.commands.interrupted import Interrupted
from msls_ros.commands.progress import Progress
from msls_ros.estimation import EstimationError
from msls_ros.fleet import FleetError, run
from msls_ros.flights.scenarios import ScenarioError, listing

DEFAULT_OUT = Path("out/campaign")
INTERRUPTED = "interrupted"
MINUTE = 60.0


def parser() -> argparse.ArgumentParser:
    """Return the command line."""
    result = OneLineParser(
        prog="campaign",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Fly scenarios over many seeds, noises and settings of the identifier, in closed loop without ROS.",
        epilog=lambda: f"Killed or interrupted, the same command goes on where it was. Scenarios:\n{listing()}",
    )
    result.add_argument("scenarios", nargs="+", metavar="SCENARIO", help="one of those below, or your own .yaml file")
    result.add_argument("--seeds", type=count, required=True, metavar="N", help="flights of each combination")
    result.add_argument("--first-seed", type=seed, default=0, metavar="K", help="seeds K to K+N-1 (default: 0)")
    result.add_argument(
        "--noise", type=noise_list, metavar="LIST", help="none,low,med or some of them (default: each scenario's own)"
    )
    result.add_argument(
        "--compare",
        type=comparison,
        action="append",
        default=[],
        metavar="NAME=V1,V2",
        help="fly with each value of lambda, penalty, T (the threshold), or a parameter of the identifier by its full "
        "name; repeated, with all combinations",
    )
    add_fleet(result)
    result.add_argument("--out", type=Path, metavar="DIR", help=f"folder (default: {DEFAULT_OUT}/NAME)")
    result.add_argument("--no-dither", action="store_true", help="fly without active noise injection")
    result.add_argument("--fresh", action="store_true", help="discard the flights that are kept in the folder")
    result.add_argument("--json", action="store_true", help="print one JSON value on stdout and nothing else")
    return result


def main(argv: Sequence[str] | None = None) -> int:
    """Fly a campaign; return the exit code."""
    arguments = parser().parse_args(argv)
    arguments.argv = sys.argv[1:] if argv is None else argv
    try:
        cells = plan(arguments.scenarios, arguments.noise, arguments.compare, not arguments.no_dither)
        tasks = tasks_of(cells, arguments.first_seed, arguments.seeds)
        store = Store(arguments.out or DEFAULT_OUT / name_of(cells), arguments.fresh)
    except (PlanError, ScenarioError, EstimationError, StoreError) as error:
        print(f"campaign: {explain(error)}", file=sys.stderr)
        return 2
    interrupted = Interrupted()
    with store, interrupted.watched():
        for note in store.notes:
            print(f"campaign: {note}", file=sys.stderr)
        try:
            compile_once("bank", "msls", "rls")
            rows, lost = _fly(tasks, store, arguments, interrupted)
            return _conclude(cells, tasks, rows, lost, store, arguments)
        except OSError as error:
            if interrupted:
                return 130
            print(f"campaign: '{store.folder}': {error.strerror or error}", file=sys.stderr)
            return 2
        except (Exception, KeyboardInterrupt):
            if not interrupted:
                raise
    return 130


def _fly(
    tasks: Sequence[Task], store: Store, arguments: argparse.Namespace, interrupted: Interrupted
) -> tuple[dict[str, Row], str]:
    """Fly what is not kept; return the flights by key, and why some are missing (empty: none is)."""
    wanted = {task.key for task in tasks}
    rows = {key: row for key, row in store.rows.items() if key in wanted}
    todo = [task for task in tasks if task.key not in rows]
    if rows:
        print(f"campaign: {len(rows)} of {len(tasks)} flights are in '{store.folder}'", file=sys.stderr, flush=True)
    start, simulated = time.monotonic(), 0.0
    alone = arguments.jobs == 1 and arguments.scheduler is None
    ends = run(fly_task, todo, jobs=arguments.jobs, scheduler=arguments.scheduler, stopped=lambda: bool(interrupted))
    try:
        with (
            nullcontext() if alone else interrupted.held(),
            Progress(f"flying {len(todo)} flights", len(todo), "flights") as bar,
        ):
            for number, end in enumerate(ends, 1):
                if interrupted:  # and swallowed: what has come may be wrong
                    raise KeyboardInterrupt
                task = todo[end.index]
                if end.result is None:  # its worker died again and again: it is tried again next time
                    rows[task.key] = failed(task, str(end.error))
                else:
                    with interrupted.held():
                        store.add(end.result)
                        rows[task.key] = end.result
                simulated += task.cell.scenario.duration
                spent = max(time.monotonic() - start, 1e-9)
                bar.show(number, f"{MINUTE * number / spent:.0f} flights/min, {simulated / spent:.0f} x real time")
    except FleetError as error:
        return rows, str(error)
    except (Exception, KeyboardInterrupt):
        if not interrupted:
            raise
        return rows, INTERRUPTED
    finally:
        ends.close()
    return rows, ""


def _conclude(
    cells: Sequence[Cell],
    tasks: Sequence[Task],
    rows: dict[str, Row],
    lost: str,
    store: Store,
    arguments: argparse.Namespace,
) -> int:
    """Write the tables of what was flown, print them, and return the exit code."""
    ordered = [rows[task.key] for task in tasks if task.key in rows]
    found = [[rows[task.key] for task in tasks if task.cell is cell and task.key in rows] for cell in cells]
    summaries = [summarise(cell, own) for cell, own in zip(cells, found, strict=True)]
    summary = {
        "asked": _asked(cells, arguments),
        "versions": versions(),
        "out": str(store.folder),
        "flights_asked": len(tasks),
        "flights_flown": len(ordered),
        "complete": len(ordered) == len(tasks),
        "x_real_time_per_core": _speed(ordered),
        "cells": summaries,
    }
    store.write(TABLE, csv_of(ordered))
    text = json.dumps({**summary, "flights": ordered}, indent=1, allow_nan=False)
    store.write(SUMMARY, text + "\n")
    if lost:
        again = shlex.join(["campaign", *(one for one in arguments.argv if one != "--fresh")])
        kept = f"{len(ordered)} of {len(tasks)} flights are kept in '{store.folder}'"
        print(f"campaign: {lost}; {kept}, to go on: {again}", file=sys.stderr)
    if arguments.json:
        print(json.dumps(summary, indent=2, allow_nan=False))
    elif ordered:
        print(f"{render(cells, summaries)}\n\nwritten: {store.folder}: {TABLE}, {SUMMARY}")
    if lost:
        return 130 if lost == INTERRUPTED else 2
    return 0 if any(row["error"] is None for row in ordered) else 2


def _asked(cells: Sequence[Cell], arguments: argparse.Namespace) -> dict[str, Any]:
    """Return what was asked for, as JSON."""
    scenarios = {cell.scenario.name: cell.scenario for cell in cells}
    return {
        "scenarios": [asdict(scenario) for scenario in scenarios.values()],
        "noises": list(dict.fromkeys(cell.noise for cell in cells)),
        "settings": [dict(setting) for setting in dict.fromkeys(cell.setting for cell in cells)],
        "first_seed": arguments.first_seed,
        "seeds": arguments.seeds,
        "dither": not arguments.no_dither,
    }


def _speed(rows: Sequence[Row]) -> float | None:
    """Return simulated over wall-clock time of the flights that ended, each in one process."""
    ended = [row for row in rows if row["error"] is None]
    wall = sum(row["wall_time_s"] for row in ended)
    return round(sum(row["simulated_s"] for row in ended) / wall, 1) if wall > 0.0 else None


if __name__ == "__main__":
    sys.exit(main())
