"""`inspect`: look at a log before it is used: what it holds, and whether its map reads it rightly."""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from msls_ros.bags import BagError, open_any
from msls_ros.commands.arguments import OneLineParser, print_text
from msls_ros.commands.progress import Progress
from msls_ros.estimation import EstimationError
from msls_ros.inputs.findings import DOUBTFUL, LEVELS, NOTE, OF_THE_FLIGHT, Finding
from msls_ros.offline.inspection import Inspection, inspect
from msls_ros.offline.opening import chosen_parameters
from msls_ros.offline.suggestion import suggest

_EPILOG = """\
Findings are wrong (numbers would be wrong; replay refuses them), doubtful (worse than need be) or notes. Without
--params the parameters are those beside a bag, or for a log of PX4, ArduPilot or standard ROS topics a map that is made
from its topics. --suggest writes such a map for you to check. Exit code: 0 where nothing is wrong, 1 where something
is, 2 where the log or the map cannot be read.
"""


def parser() -> argparse.ArgumentParser:
    """Return the command line."""
    result = OneLineParser(
        prog="inspect",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Look at a log: rates, gaps, units, signs, frames, delays, effectors; what to change in its map.",
        epilog=_EPILOG,
    )
    result.add_argument("log", type=Path, metavar="LOG", help="bag directory or file, .ulg of PX4, .bin of ArduPilot")
    result.add_argument("--params", metavar="FILE", help="a parameter file, or the name of a shipped one")
    result.add_argument("--namespace", metavar="NS", help="which aircraft, where the log has several")
    result.add_argument("--definitions", type=Path, action="append", default=[], metavar="DIR",
                        help="folder of message definitions that a bag lacks; may be repeated")  # fmt: skip
    result.add_argument("--suggest", nargs="?", const="-", metavar="FILE",
                        help="write a map made from its topics into a new file (or to stdout), to check")  # fmt: skip
    result.add_argument("--json", action="store_true", help="print one JSON value")
    return result


def main(argv: Sequence[str] | None = None) -> int:
    """Inspect; return the exit code."""
    arguments = parser().parse_args(argv)
    try:
        reader = open_any(arguments.log, definition_paths=arguments.definitions)
        if arguments.suggest is not None:
            _write_map(arguments, suggest(reader))
            return 0
        chosen = chosen_parameters(reader, arguments.params, arguments.namespace)
        with Progress(f"inspecting {arguments.log.name}", 100.0, "%") as bar:
            found = inspect(reader, chosen.configuration, chosen.inputs, lambda share: bar.show(100.0 * share))
    except (BagError, EstimationError, OSError) as error:
        print(f"inspect: {error}", file=sys.stderr)
        return 2
    if arguments.json:
        print(json.dumps(summary(arguments.log, chosen.source, found), indent=2))
    else:
        print_text(describe(arguments.log, chosen.source, found))
    return 1 if found.wrong else 0


def _write_map(arguments: argparse.Namespace, text: str) -> None:
    """Write a suggested map into a new file, or print it."""
    if arguments.suggest != "-":
        with Path(arguments.suggest).open("x", encoding="utf-8") as stream:
            stream.write(text)
    if arguments.json:
        print(json.dumps({"log": str(arguments.log), "map": text}, indent=2))
    elif arguments.suggest == "-":
        print(text, end="")
    else:
        print(
            f"written: {arguments.suggest}; check it, then: ./msls inspect {arguments.log} --params {arguments.suggest}"
        )


def summary(log: Path, source: str, found: Inspection) -> dict[str, Any]:
    """Return what was found, for JSON."""
    return {
        "log": str(log),
        "parameters": source,
        "messages": found.looked_at,
        "seconds": round(found.seconds, 3),
        "topics": [{"name": name, "type": kind, "count": count} for name, kind, count in found.topics],
        "findings": [dataclasses.asdict(f) for f in found.findings],
        "wrong": len(found.wrong),
    }


def describe(log: Path, source: str, found: Inspection) -> str:
    """Return what was found as text."""
    lines = [f"{log}: {found.looked_at} messages over {found.seconds:.1f} s; {source}"]
    for level in LEVELS:
        own = [f for f in found.findings if f.level == level]
        if own:
            lines += ["", f"{level} ({len(own)})" if level != NOTE else "notes", *(_finding(f) for f in own)]
    return "\n".join([*lines, "", _closing(found)])


def _closing(found: Inspection) -> str:
    """Return what to do now."""
    if found.wrong:
        return "wrong numbers would come of it: make the changes, and inspect it again"
    doubtful = [f for f in found.findings if f.level == DOUBTFUL]
    mendable = {f.kind if f.kind == f.where else f"{f.kind} ({f.where})": f for f in doubtful}
    if named := [name for name, f in mendable.items() if f.kind not in OF_THE_FLIGHT]:
        return f"doubtful: first make the changes of {', '.join(named)}, then inspect it again"
    if doubtful:
        return "nothing wrong is seen in the map; what is doubtful is of the flight or its recording: replay it"
    return "nothing is wrong: replay it"


def _finding(f: Finding) -> str:
    return f"  {f.where}: {f.what}" + (f"\n      change: {f.change}" if f.change else "")


if __name__ == "__main__":
    sys.exit(main())
