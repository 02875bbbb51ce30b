"""`replay`: identify from recorded bags, through the gate and the identifier of the flight, at the machine's pace."""

from __future__ import annotations

import argparse
import glob
import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from msls_ros.bags import BagError
from msls_ros.commands.arguments import OneLineParser, count
from msls_ros.commands.offline import Replay, ReplayOptions, kept_parameters, replay
from msls_ros.commands.profiles import profile_path, read_inputs, read_profile
from msls_ros.commands.progress import Progress
from msls_ros.estimation import EstimationError

DEFAULT_OUT = Path("out/replay")
_EPILOG = """\
The new bag holds the topics model, fault and dither as the identifier node would have published them, equal to the
last bit, beside identifier.yaml. Without --params the parameters are those of identifier.yaml in the bag's folder,
which the demo writes; what was changed in flight by services or parameters is not known to a bag. Exit code: 0 also
for a damaged bag of which a part was read (with warnings), 2 for one that gave nothing.
"""


def parser() -> argparse.ArgumentParser:
    """Return the command line."""
    result = OneLineParser(
        prog="replay",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Identify from rosbag2 (MCAP, sqlite3; directory or file; compressed) and ROS 1 bags.",
        epilog=_EPILOG,
    )
    result.add_argument("bags", nargs="+", metavar="BAG", help="bag directory or file, or a glob; several give a table")
    result.add_argument("--params", metavar="FILE", help="a parameter file, or the name of a shipped one (f16_cruise)")
    result.add_argument("--out", type=Path, help=f"folder for the new bags (default: {DEFAULT_OUT}, replaced)")
    result.add_argument("--overwrite", action="store_true", help="replace bags in the folder given with --out")
    result.add_argument("--every", type=count, default=1, metavar="N", help="samples per model (default: 1)")
    result.add_argument("--merge", action="store_true", help="write the input beside the output")
    result.add_argument("--namespace", metavar="NS", help="which aircraft, where a bag has several")
    result.add_argument(
        "--definitions",
        type=Path,
        action="append",
        default=[],
        metavar="DIR",
        help="folder of message definitions that a bag lacks (PKG/msg/NAME.msg); may be repeated",
    )
    result.add_argument("--json", action="store_true", help="print a JSON list, one object for each bag")
    return result


def main(argv: Sequence[str] | None = None) -> int:
    """Replay; return the exit code."""
    arguments = parser().parse_args(argv)
    try:
        bags = _expand(arguments.bags)
        given = profile_path(arguments.params) if arguments.params else None
        if given is not None:
            read_profile(given)
            read_inputs(given)
        places = _places(bags, arguments.out or DEFAULT_OUT)
    except (BagError, EstimationError) as error:
        print(f"replay: {error}", file=sys.stderr)
        return 2
    results = []
    for bag, place in zip(bags, places, strict=True):
        try:
            results.append(_replay(bag, place, given or kept_parameters(bag), arguments))
        except (BagError, EstimationError, OSError) as error:
            print(f"replay: {error}", file=sys.stderr)
            results.append({"bag": str(bag), "error": str(error)})
        except KeyboardInterrupt:
            print(f"replay: {bag}: interrupted; {place} holds what was done", file=sys.stderr)
            return 130
        else:
            for warning in results[-1]["warnings"]:
                print(f"replay: warning: {warning}", file=sys.stderr)
            if not arguments.json:
                print(describe(results[-1]))
    if arguments.json:
        print(json.dumps(results, indent=2))
    elif len(results) > 1:
        print(table(results))
    return 2 if any(not result.get("samples") for result in results) else 0


def _expand(patterns: Sequence[str]) -> list[Path]:
    """Return the bags that the arguments name, each once."""
    found: dict[Path, None] = {}
    for pattern in patterns:
        names = [pattern] if Path(pattern).exists() else sorted(glob.glob(pattern))
        if not names:
            message = f"{pattern}: no such file or directory; expected a bag directory, or a .mcap, .db3 or .bag file"
            raise BagError(message)
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


def _replay(bag: Path, out: Path, parameters: Path, arguments: argparse.Namespace) -> dict[str, Any]:
    configuration = read_profile(parameters)
    options = ReplayOptions(
        every=arguments.every,
        merge=arguments.merge,
        namespace=arguments.namespace,
        definitions=arguments.definitions,
        overwrite=arguments.overwrite or arguments.out is None,
        inputs=read_inputs(parameters),
        parameters=parameters,
    )
    size = _megabytes(bag)
    start = time.monotonic()
    with Progress(f"replaying {bag.name}", size, "MB") as bar:

        def show(share: float, samples: int) -> None:
            bar.show(share * size, f"{samples / max(time.monotonic() - start, 1e-9):,.0f} samples/s")

        result = replay(bag, out, configuration, options, show)
        show(1.0, result.samples)
    return summary(bag, out, arguments.params or str(parameters), result)


def _megabytes(bag: Path) -> float:
    files = bag.iterdir() if bag.is_dir() else [bag]
    return max(sum(file.stat().st_size for file in files if file.is_file()), 1) / 1e6


def summary(bag: Path, out: Path, parameters: str, result: Replay) -> dict[str, Any]:
    """Return what a replay gave, for JSON."""
    first, last = result.span or (0, 0)
    events = [
        {
            "time_s": stamp * 1e-9,
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
        "start_s": first * 1e-9,
        "end_s": last * 1e-9,
        "alarms": sum(event["kind"] == "detected" for event in events),
        "events": events,
        "refused": result.refused,
        "restarts": result.restarts,
        "wall_time_s": round(result.wall_time, 3),
        "samples_per_s": round(result.samples / result.wall_time),
        "warnings": result.warnings,
    }


def describe(result: dict[str, Any]) -> str:
    """Return the summary of one bag for people."""
    refused = ", ".join(f"{count} {reason}" for reason, count in sorted(result["refused"].items())) or "none"
    lines = [
        f"{result['bag']} -> {result['out']}",
        f"  parameters  {result['parameters']}",
        f"  samples     {result['samples']}, {result['start_s']:.3f} s to {result['end_s']:.3f} s; "
        f"{result['models']} models, {result['restarts']} jumps of time",
        f"  refused     {refused}",
        f"  alarms      {result['alarms']}",
    ]
    lines += [f"    {event['time_s']:.3f} s  {event['kind']:<10}{event['description']}" for event in result["events"]]
    lines.append(f"  speed       {result['samples_per_s']:,} samples/s ({result['wall_time_s']:.2f} s)")
    return "\n".join(lines)


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
