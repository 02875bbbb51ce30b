"""`report`: one self-contained HTML page of a recorded flight."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from msls_ros.bags import BagError
from msls_ros.commands.arguments import OneLineParser, print_text
from msls_ros.commands.progress import Progress
from msls_ros.estimation import EstimationError
from msls_ros.offline.report_data import gather
from msls_ros.report.errors import ReportError
from msls_ros.report.flight_report import make_report

_EPILOG = """\
The page needs no other file. Any log will do: a bag of msls_msgs, with or without models; one of other topics, or a log
of PX4 or ArduPilot, read with --params or with a map made from its topics (see inspect --suggest). What a log lacks is
identified from its inputs where the configuration is known: --params, or identifier.yaml in the bag's folder.
"""
PAGE = "report.html"
_SHIPPED = Path(__file__).resolve().parents[2] / "bags"


def parser() -> argparse.ArgumentParser:
    """Return the command line."""
    result = OneLineParser(
        prog="report",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Write a report of a recorded flight: one HTML page without external files.",
        epilog=_EPILOG,
    )
    result.add_argument("bag", type=Path, metavar="BAG", help="bag directory or file, .ulg of PX4, .bin of ArduPilot")
    result.add_argument("--out", type=Path, metavar="DIR", help="folder for the report (default: beside the bag)")
    result.add_argument("--png", type=Path, metavar="DIR", help="write the page's charts as PNG files into this folder")
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
        print_text("\n".join([*summary["verdict"], "", f"written: {summary['report']}"]))
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
        report = make_report(flight, arguments.parameter)
        images: list[Path] = []
        if arguments.png is not None:
            from msls_ros.report.page_figures import save_figures  # takes a second to import

            _make_folder(arguments.png)
            images = save_figures(report.figures, report.marks, arguments.png)
        bar.show(100.0, "done")
    page = out / PAGE
    try:
        page.write_text(report.html, encoding="utf-8")
    except OSError as error:
        message = f"the folder '{out}' cannot be written: {error.strerror}"
        raise OSError(message) from error
    for warning in flight.warnings:
        print(f"report: warning: {warning}", file=sys.stderr)
    return {
        "report": str(page),
        "figures": [drawn.name for drawn in report.figures],
        "png": [str(path) for path in images],
        "sections": report.sections,
        "bytes": len(report.html.encode("utf-8")),
        "verdict": report.verdict,
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
    """Return where a bag's report goes by default: beside the bag; of a shipped one into ``out/report``."""
    whole = bag.resolve()
    name = whole.name.split(".")[0] if whole.is_file() else whole.name
    if whole.parent == _SHIPPED:
        return Path("out") / "report" / name
    return whole.parent / ("report" if name == "bag" else f"{name}_report")


def remove_report(folder: Path) -> None:
    """Take away a report; whatever else is in the folder stays.

    Raises
    ------
    OSError
        If a file cannot be deleted.
    """
    (folder / PAGE).unlink(missing_ok=True)
    if folder.is_dir() and not any(folder.iterdir()):
        folder.rmdir()


def _make_folder(out: Path) -> None:
    """Make the folder before anything is drawn for it."""
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        message = f"the folder '{out}' cannot be written: {error.strerror}"
        raise OSError(message) from error


if __name__ == "__main__":
    sys.exit(main())
