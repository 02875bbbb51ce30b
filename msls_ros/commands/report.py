"""`report`: one self-contained HTML page of a recorded flight, and its figures as PNG."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from msls_ros.bags import BagError
from msls_ros.commands.arguments import OneLineParser
from msls_ros.commands.progress import Progress
from msls_ros.estimation import EstimationError
from msls_ros.offline.report_data import gather
from msls_ros.report.errors import ReportError

_EPILOG = """\
The page needs no other file. It shows what the bag holds and lists what is missing: truth, models (the inputs are then
identified offline), the end of a bag that was cut off. The detector's statistic is recomputed from the inputs where the
configuration is known: --params, or identifier.yaml in the bag's folder.
"""
PAGE = "report.html"


def parser() -> argparse.ArgumentParser:
    """Return the command line."""
    result = OneLineParser(
        prog="report",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Write a report of a recorded flight: one HTML page without external files, and PNG figures.",
        epilog=_EPILOG,
    )
    result.add_argument("bag", type=Path, metavar="BAG", help="bag directory, or a .mcap, .db3 or .bag file")
    result.add_argument("--out", type=Path, metavar="DIR", help="folder for the report (default: beside the bag)")
    result.add_argument(
        "--parameter",
        action="append",
        default=[],
        metavar="ROW/COLUMN",
        help="parameter to follow over time, such as P/ddt (B) or Q/w (A); may be repeated (default: the large, "
        "well-known entries of B)",
    )
    result.add_argument(
        "--params", metavar="FILE", help="the identifier's parameter file, or the name of a shipped one"
    )
    result.add_argument("--namespace", metavar="NS", help="which aircraft, where the bag has several")
    result.add_argument("--json", action="store_true", help="print paths and summary as one JSON value on stdout")
    return result


def main(argv: Sequence[str] | None = None) -> int:
    """Write the report; return the exit code."""
    arguments = parser().parse_args(argv)
    try:
        summary = run(arguments)
    except (BagError, EstimationError, ReportError, OSError) as error:
        print(f"report: {error}", file=sys.stderr)
        return 2
    if arguments.json:
        print(json.dumps(summary, indent=2))
    else:
        print("\n".join([*summary["headline"], "", f"written: {summary['report']}"]))
        print(f"         {len(summary['figures'])} figures (PNG) beside it")
    return 0


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Read, draw, write; return what was done.

    Raises
    ------
    BagError, EstimationError, ReportError, OSError
        With one sentence.
    """
    bag: Path = arguments.bag
    out: Path = arguments.out or default_folder(bag)
    with Progress(f"report of {bag.name}", 100.0, "%") as bar:
        flight = gather(
            bag, arguments.params, arguments.namespace, lambda what, share: bar.show(_SHARE[what](share), what)
        )
        bar.show(60.0, "drawing")
        _make_folder(out)
        from msls_ros.report.flight_report import FIGURES, make_report  # matplotlib takes a second to import

        report = make_report(flight, arguments.parameter)
        bar.show(100.0, "done")
    figures = [(out / f"{drawn.name}.png", drawn.png) for drawn in report.figures]
    page = out / PAGE
    _write(out, [(page, report.html.encode("utf-8")), *figures], [out / f"{name}.png" for name in FIGURES])
    for warning in flight.warnings:
        print(f"report: warning: {warning}", file=sys.stderr)
    return {
        "report": str(page),
        "figures": [str(path) for path, _ in figures],
        "bytes": len(report.html.encode("utf-8")),
        "headline": report.headline,
        "parameters": report.parameters,
        "samples": flight.samples,
        "alarms": len(flight.alarms),
        "models": flight.models_source,
        "agreement": flight.agreement,
        "warnings": list(flight.warnings),
        "missing": list(flight.missing),
    }


_SHARE = {"reading": lambda share: 20.0 * share, "identifying": lambda share: 20.0 + 40.0 * share}


def default_folder(bag: Path) -> Path:
    """Return where a bag's report goes by default: beside the bag."""
    whole = bag.resolve()
    name = whole.name.split(".")[0] if whole.is_file() else whole.name
    return whole.parent / ("report" if name == "bag" else f"{name}_report")


def _make_folder(out: Path) -> None:
    """Make the folder before anything is drawn for it."""
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        message = f"the folder '{out}' cannot be written: {error.strerror}"
        raise OSError(message) from error


def _write(out: Path, files: Sequence[tuple[Path, bytes]], ours: Sequence[Path]) -> None:
    """Write the files, and take away figures of an earlier report that this one does not have."""
    try:
        for path, content in files:
            path.write_bytes(content)
        for path in set(ours) - {path for path, _ in files}:
            path.unlink(missing_ok=True)
    except OSError as error:
        message = f"the folder '{out}' cannot be written: {error.strerror}"
        raise OSError(message) from error


if __name__ == "__main__":
    sys.exit(main())
