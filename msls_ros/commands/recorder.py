"""`recorder`: the recorder node as a process; `recorder --repair BAG` finishes a bag that a kill left."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from msls_ros.nodes.stopping import Stopping

REPAIR = (
    "usage: recorder --repair BAG    finish a bag that a killed recorder left, or that is damaged (MCAP);\n"
    "                                the files as they were stay beside it (.original); exit code 2 if anything in\n"
    "                                them could not be read"
)
_EXPECTED = "usage: recorder --repair BAG"


def main(argv: Sequence[str] | None = None) -> int:
    """Run the node, or repair a bag; return the exit code."""
    arguments = sys.argv[1:] if argv is None else list(argv)
    if "--repair" in arguments:
        return _repair([a for a in arguments if a != "--repair"])
    with Stopping() as stopping:
        from msls_ros.commands.node_help import run_or_help
        from msls_ros.nodes.recorder import PARAMETERS, RecorderNode

        code = stopping.end(run_or_help("recorder", RecorderNode, PARAMETERS, arguments, stopping))
    if "-h" in arguments or "--help" in arguments:
        print(f"\n{REPAIR}")
    return code


def _repair(arguments: Sequence[str]) -> int:
    if len(arguments) != 1 or arguments[0].startswith("-"):
        asked = "-h" in arguments or "--help" in arguments
        print(REPAIR if asked else f"recorder: expected one bag; {_EXPECTED}", file=sys.stdout if asked else sys.stderr)
        return 0 if asked else 2
    from msls_ros.bags import BagError, repair
    from msls_ros.commands.arguments import print_text

    try:
        done = repair(arguments[0])
    except BagError as error:
        print(f"recorder: {error}", file=sys.stderr)
        return 2
    for warning in done.warnings:
        print(f"recorder: {warning}", file=sys.stderr)
    state = "repaired" if done.changed else "was whole, nothing changed"
    kept = f"; the original is kept as {', '.join(file.name for file in done.originals)}" if done.originals else ""
    print_text(f"{arguments[0]}: {state}; {done.messages} messages{kept}")
    if done.lost:
        print(
            f"recorder: {arguments[0]}: something in it could not be read and is in the original only", file=sys.stderr
        )
    return 2 if done.lost else 0
