"""What the demo does after a flight: the page is written."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from msls_ros.bags import BagError
from msls_ros.commands.report import PAGE, default_folder
from msls_ros.estimation import EstimationError
from msls_ros.offline.report_data import gather
from msls_ros.report.errors import ReportError
from msls_ros.report.flight_report import make_report


def write_page(bag: Path) -> dict[str, Any]:
    """Write the page of a flight; return its path and the verdict.

    Parameters
    ----------
    bag
        Of the flight.
    """
    page = default_folder(bag) / PAGE
    try:
        flight = gather(bag)
        report = make_report(flight)
        page.parent.mkdir(parents=True, exist_ok=True)
        page.write_text(report.html, encoding="utf-8")
    except (BagError, EstimationError, ReportError, OSError) as error:
        return {"verdict": [f"no page: {error}"], "report": ""}
    return {"verdict": report.verdict, "report": str(page)}
