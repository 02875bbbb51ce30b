"""`replay`: identify from recorded bags, through the gate and the identifier of the flight, at the machine's pace."""

from __future__ import annotations

import argparse
import dataclasses
import glob
import json
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from msls_ros.bags import HELD, BagError, open_any
from msls_ros.commands.arguments import OneLineParser, add_fleet, count, print_text
from msls_ros.commands.compiling import DEFAULT, compile_once
from msls_ros.commands.progress import Progress
from msls_ros.estimation import EstimationError
from msls_ros.fleet import Done, FleetError, run
from msls_ros.inputs import InputMap
from msls_ros.inputs.findings import NOTE, Finding
from msls_ros.inputs.profiles import profile_path, read_inputs, read_profile
from msls_ros.offline.best import origin_of
from msls_ros.offline.inspection import check_map, inspect
from msls_ros.offline.opening import Chosen, chosen_parameters
from msls_ros.offline.replay import Replay, ReplayOptions, replay

DEFAULT_OUT = Path("out/replay")
_EPILOG = """\
The new bag holds the topics model, fault and dither as the identifier node would have published them, bit for
bit equal, beside identifier.yaml; a bag that it replaces goes when the new one is whole and has samples. Without
--params the parameters are those of identifier.yaml in the bag's folder, which the demo writes; what was changed in
flight by services or parameters is not known to a bag. A log of other topics without --params is read by a map made
from them, see inspect --suggest. What inspect finds wrong is refused, unless --anyway. Exit code: 0 also for a damaged
bag of which a part was read (with warnings), 2 for one that gave nothing.
"""


def parser() -> argparse.ArgumentParser:
    """Return the command line."""
    result = OneLineParser(
        prog="replay",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Identify from rosbag2 (MCAP, sqlite3; directory or file; compressed) and ROS 1 bags, and logs of "
        "PX4 (.ulg) and ArduPilot (.bin).",
        epilog=_EPILOG,
    )
    result.add_argument("bags", nargs="+", metavar="BAG", help="bag, log or a glob of them; several give a table")
    result.add_argument("--params", metavar="FILE", help="a parameter file, or the name of a shipped one (f16)")
    result.add_argument("--out", type=Path, help=f"folder for the new bags (default: {DEFAULT_OUT}, replaced)")
    result.add_argument("--overwrite", action="store_true", help="replace bags in the folder given with --out")
    result.add_argument("--every", type=count, default=1, metavar="N", help="samples per model (default: 1)")
    result.add_argument("--anyway", action="store_true", help="use a map that inspect finds wrong")
    result.add_argument("--merge", action="store_true", help="write the input beside the output")
    result.add_argument("--namespace", metavar="NS", help="which aircraft, where a bag has several")
    result.add_argument(
        "--memory",
        type=count,
        default=HELD >> 20,
        metavar="MIB",
        help="what reading may hold at a time: a chunk, a message, an unpacked database (default: %(default)s)",
    )
    result.add_argument(
        "--definitions",
        type=Path,
        action="append",
        default=[],
        metavar="DIR",
        help="folder of message definitions that a bag lacks (PKG/msg/NAME.msg); may be repeated",
    )
    add_fleet(result)
    result.add_argument("--json", action="store_true", help="print a JSON list, one object for each bag")
    return result


@dataclass(frozen=True)
class Job:
    """A bag to replay."""

    bag: Path
    out: Path
    parameters: Path | None
    """None: those kept in the bag's folder."""
    arguments: argparse.Namespace
    shown: bool
    """Whether its own progress is shown."""


def main(argv: Sequence[str] | None = None) -> int:
    """Replay; return the exit code."""
    arguments = parser().parse_args(argv)
    alone = arguments.jobs == 1 and arguments.scheduler is None
    try:
        jobs = _jobs(arguments, alone)
    except (BagError, EstimationError) as error:
        print(f"replay: {error}", file=sys.stderr)
        return 2
    earlier = {job.out for job in jobs if job.out.is_dir()}
    results: dict[int, dict[str, Any]] = {}
    missing = ""
    try:
        if not alone:  # here, and not in every worker
            given = jobs[0].parameters
            compile_once(read_profile(given).estimator.method if given else DEFAULT)
        for done in _ends(jobs, arguments, alone):
            results[done.index] = done.result or {"bag": str(jobs[done.index].bag), "error": done.error}
            if alone:
                _tell(results[done.index], arguments.json)
    except FleetError as error:
        missing = str(error)
    except KeyboardInterrupt:
        what, where = (jobs[len(results)].bag, jobs[len(results)].out) if alone else ("bags", jobs[0].out.parent)
        state = "is as it was" if alone and where in earlier else "holds what was done"
        print(f"replay: {what}: interrupted; {where} {state}", file=sys.stderr)
        return 130
    for index, job in enumerate(jobs):
        result = results.setdefault(index, {"bag": str(job.bag), "error": missing})
        if not alone:
            _tell(result, arguments.json)
    ordered = [results[index] for index in range(len(jobs))]
    if arguments.json:
        print(json.dumps(ordered, indent=2))
    elif len(ordered) > 1:
        print_text(table(ordered))
    return 2 if any(not result.get("samples") for result in ordered) else 0


def _jobs(arguments: argparse.Namespace, alone: bool) -> list[Job]:
    """Return what is to be done, the arguments checked."""
    bags = _expand(arguments.bags)
    out = arguments.out or DEFAULT_OUT
    given = profile_path(arguments.params) if arguments.params else None
    if arguments.scheduler is not None:  # its workers have other working directories
        bags, out, given = [bag.resolve() for bag in bags], out.resolve(), given and given.resolve()
    if given is not None:
        read_profile(given)
        read_inputs(given)
    return [Job(bag, place, given, arguments, alone) for bag, place in zip(bags, _places(bags, out), strict=True)]


def _ends(jobs: Sequence[Job], arguments: argparse.Namespace, alone: bool) -> Iterator[Done]:
    """Give the end of each job when it comes; show how many there were, unless each shows its own progress."""
    expected = (BagError, EstimationError, OSError)
    with nullcontext() if alone else Progress(f"replaying {len(jobs)} bags", len(jobs), "bags") as bar:
        ends = run(_replay, jobs, jobs=arguments.jobs, scheduler=arguments.scheduler, expected=expected)
        for number, done in enumerate(ends, 1):
            if bar is not None:
                bar.show(number)
            yield done


def _tell(result: dict[str, Any], quiet: bool) -> None:
    """Print what came of a bag; where ``quiet``, only what is wrong with it."""
    if "error" in result:
        print(f"replay: {result['error']}", file=sys.stderr)
        return
    for warning in result["warnings"]:
        print(f"replay: warning: {warning}", file=sys.stderr)
    if not quiet:
        print_text(describe(result))


def _expand(patterns: Sequence[str]) -> list[Path]:
    """Return the bags that the arguments name, each once."""
    found: dict[Path, None] = {}
    for pattern in patterns:
        names = [pattern] if Path(pattern).exists() else sorted(glob.glob(pattern))
        if not names:
            open_any(Path(pattern))  # says that it is not there, and what may be meant
        found.update(dict.fromkeys(map(Path, names)))
    return list(found)


def _places(bags: Sequence[Path], out: Path) -> list[Path]:
    """Return the folder of each new bag: the bag's name, with its folder's where two have one name."""
    names = [_name(bag) for bag in bags]
    long = [
        f"{bag.resolve().parent.name}_{name}" if names.count(name) > 1 else name
        for bag, name in zip(bags, names, strict=True)
    ]
    places = [out / (f"{name}_{i}" if long.count(name) > 1 else name) for i, name in enumerate(long)]
    for bag in bags:
        own = bag.resolve()
        for place in map(Path.resolve, places):
            if own == place or place in own.parents or own in place.parents:
                message = f"{bag}: the new bag {place} would replace it or be in it; give another folder with --out"
                raise BagError(message)
    return places


def _name(bag: Path) -> str:
    name = bag.resolve().name
    return name if bag.is_dir() else name.split(".")[0] or name


def _replay(job: Job) -> dict[str, Any]:
    arguments, bag = job.arguments, job.bag
    reader = open_any(bag, definition_paths=arguments.definitions, held=arguments.memory << 20)
    chosen = chosen_parameters(reader, str(job.parameters) if job.parameters else None, arguments.namespace)
    found = inspect(reader, chosen.configuration, chosen.inputs)
    mapped = isinstance(chosen.inputs, InputMap)
    if mapped and not arguments.anyway:
        check_map(bag, found)
    compile_once(chosen.configuration.estimator.method)
    options = ReplayOptions(
        every=arguments.every,
        merge=arguments.merge,
        namespace=arguments.namespace,
        definitions=arguments.definitions,
        overwrite=arguments.overwrite or arguments.out is None,
        held=arguments.memory << 20,
        inputs=chosen.inputs if isinstance(chosen.inputs, InputMap) else None,
        parameters=chosen.parameters,
        warm_start=chosen.warm_start,
    )
    size = _megabytes(bag)
    start = time.monotonic()
    with Progress(f"replaying {bag.name}", size, "MB") if job.shown else nullcontext() as bar:

        def show(share: float, samples: int) -> None:
            if bar is not None:
                bar.show(share * size, f"{samples / max(time.monotonic() - start, 1e-9):,.0f} samples/s")

        result = replay(bag, job.out, chosen.configuration, options, show)
        show(1.0, result.samples)
    findings = [f for f in found.findings if f.level != NOTE]
    return summary(bag, job.out, arguments.params or _source(chosen), result, findings)


def _source(chosen: Chosen) -> str:
    return str(chosen.parameters) if isinstance(chosen.parameters, Path) else chosen.source


def _megabytes(bag: Path) -> float:
    files = bag.iterdir() if bag.is_dir() else [bag]
    return max(sum(file.stat().st_size for file in files if file.is_file()), 1) / 1e6


def summary(bag: Path, out: Path, parameters: str, result: Replay, findings: Sequence[Finding] = ()) -> dict[str, Any]:
    """Return what a replay gave, for JSON; times are flight time."""
    first, last = result.span or (0, 0)
    origin = origin_of(first)
    events = [
        {
            "time_s": (stamp - origin) * 1e-9,
            "kind": event.kind.name.lower(),
            "equations": list(event.equations),
            "suspected_effector": event.suspected_effector,
            "description": event.description,
        }
        for stamp, event in result.events
    ]
    return {
        "bag": str(bag),
        "out": str(out),
        "parameters": parameters,
        "samples": result.samples,
        "models": result.models,
        "origin_s": origin * 1e-9,
        "start_s": (first - origin) * 1e-9,
        "end_s": (last - origin) * 1e-9,
        "alarms": sum(event["kind"] == "detected" for event in events),
        "events": events,
        "refused": result.refused,
        "restarts": result.restarts,
        "not_flying": result.grounded,
        "spikes": result.spikes,
        "repeated": result.repeated,
        "repeating": result.repeating,
        "wall_time_s": round(result.wall_time, 3),
        "samples_per_s": round(result.samples / result.wall_time),
        "warnings": result.warnings,
        "findings": [dataclasses.asdict(f) for f in findings],
        "reliable": [{**k._asdict(), "time": round(k.time - origin * 1e-9, 6)} for k in result.known],
    }


def describe(result: dict[str, Any]) -> str:
    """Return the summary of one bag as text."""
    refused = ", ".join(f"{count} {reason}" for reason, count in sorted(result["refused"].items())) or "none"
    lines = [
        f"{result['bag']} -> {result['out']}",
        f"  parameters  {result['parameters']}",
        f"  samples     {result['samples']}, {result['start_s']:.3f} s to {result['end_s']:.3f} s; "
        f"{result['models']} models, {result['restarts']} jumps of time",
        f"  not learnt  {result['not_flying']} samples not of flight, {result['spikes']} spikes"
        + (f", {result['repeated']} repeat {result['repeating']}" if result["repeated"] else ""),
        f"  refused     {refused}",
        f"  alarms      {result['alarms']}",
    ]
    lines += [f"    {event['time_s']:.3f} s  {event['kind']:<10}{event['description']}" for event in result["events"]]
    lines += _known(result["reliable"])
    lines += [f"  inspected   {f['level']}: {f['where']}: {f['what']}" for f in result["findings"]]
    lines.append(f"  speed       {result['samples_per_s']:,} samples/s ({result['wall_time_s']:.2f} s)")
    return "\n".join(lines)


def _known(reliable: Sequence[dict[str, Any]]) -> list[str]:
    """Return what was reliable at its best, a line for each equation."""
    lines = [f"  reliable    {len(reliable)} numbers of A and B, each at its best (*: not excited at the end)"]
    for row in dict.fromkeys(k["row"] for k in reliable):
        cells = [
            f"{k['column']} {k['value']:.3g} ± {k['std']:.2g}{'' if k['now'] else '*'} ({k['time']:.1f} s)"
            for k in reliable
            if k["row"] == row
        ]
        lines += [f"    d{row}/dt: {', '.join(cells)}"]
    return lines


def table(results: Sequence[dict[str, Any]]) -> str:
    """Return a line for each bag."""
    width = max(len(result["bag"]) for result in results)
    lines = [f"\n{'bag':<{width}}{'samples':>10}{'alarms':>8}{'refused':>9}{'samples/s':>11}{'warnings':>10}"]
    for result in results:
        if "error" in result:
            lines.append(f"{result['bag']:<{width}}  not read")
            continue
        lines.append(
            f"{result['bag']:<{width}}{result['samples']:>10}{result['alarms']:>8}{sum(result['refused'].values()):>9}"
            f"{result['samples_per_s']:>11,}{len(result['warnings']):>10}"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
