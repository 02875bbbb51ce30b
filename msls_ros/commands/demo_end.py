"""What the demo does before and after a flight: the estimator is made ready, the page written."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from msls_ros.bags import BagError
from msls_ros.commands.report import PAGE, default_folder
from msls_ros.estimation import Configuration, EstimationError, Identifier
from msls_ros.offline.report_data import gather
from msls_ros.report.errors import ReportError
from msls_ros.report.flight_report import make_report

_QUICK = 2.0
"""A start that takes no longer is not worth a word [s]."""


def prepare(configuration: Configuration) -> None:
    """Compile the estimator, and say so: it takes a minute or two once on a machine, and is kept."""
    print("preparing the estimator (compiled once, a minute or two) ...", file=sys.stderr, flush=True)
    begin = time.monotonic()
    n, m = len(configuration.states), len(configuration.effectors)
    flying = np.array([configuration.reference_speed if s == "u" else 0.0 for s in configuration.states])
    Identifier(configuration).update(0.0, flying, np.zeros(n), np.zeros(m))
    took = time.monotonic() - begin
    if took > _QUICK:
        print(f"compiled in {took:.0f} s, kept for the next time", file=sys.stderr, flush=True)


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
