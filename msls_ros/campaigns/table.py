"""What a campaign found: each cell's flights in numbers, medians with ranges, and as tables."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict
from itertools import groupby
from typing import Any

from msls_ros.campaigns.flight import Cell, Row, estimators
from msls_ros.flights.judging import ALARM_WINDOW, LATE, SETTLED
from msls_ros.flights.spread import Spread, spread

QUANTITIES = ("settle_s", "rms_before", "rms_after", "rms_after_now", "peak_error", "late_error", "late_error_now")
HOUR = 3600.0
WIDTH = 116
NOTES = (
    f"detected: an alarm from the fault to {ALARM_WINDOW:g} s after the end of its ramp; any other is false, and the "
    "hours are those in which one would be.",
    f"settled: when the error of the watched parameter stays below {100 * SETTLED:g} % of its true value before the "
    "fault, counted from the end of the ramp; where it never does, that is the end of the flight.",
    "before, after: rms error of the watched parameter from 1 s on, and from 1 s after the end of the ramp, in % of "
    f"its true value before the fault; late: the largest from {LATE:g} s after it, in % of the true value now.",
    "in the band: share of the coefficients flagged reliable whose 95 % band holds the truth (in brackets: how "
    "many are flagged, of all in the rigid-body equations). NaN: flights with a value that is not finite.",
)


def summarise(cell: Cell, rows: Sequence[Row]) -> dict[str, Any]:
    """Return the numbers of the flights of a cell; None where there are no data."""
    flown = [row for row in rows if row["error"] is None]
    methods = estimators(cell.configuration)
    faults = [fault for row in flown for fault in row["faults"]]
    false = sum(row["false_alarms"] for row in flown)
    hours = sum(row["exposed_s"] for row in flown) / HOUR
    return {
        "scenario": cell.scenario.name,
        "noise": cell.noise,
        "setting": dict(cell.setting),
        "watch": str(cell.scenario.watch),
        "method": methods[0],
        "flights": len(rows),
        "failed": len(rows) - len(flown),
        "faults": len(faults),
        "detected": sum(fault["detected"] for fault in faults),
        "missed": sum(not fault["detected"] for fault in faults),
        "delay_s": _spread(fault["delay_s"] for fault in faults),
        "false_alarms": false,
        "exposed_h": hours,
        "false_alarms_per_h": false / hours if hours > 0.0 else None,
        **{name: {key: _spread(row[name][key] for row in flown) for key in QUANTITIES} for name in methods},
        "coverage": {matrix: _pooled([row["coverage"][matrix] for row in flown]) for matrix in ("a", "b")},
        "reliable_share_before": _spread(row["reliable_share_before"] for row in flown),
        "dither_predicted_g_max": max((row["dither_predicted_g_max"] for row in flown), default=None),
        "not_finite": {
            "flight": sum(not row["finite"] for row in flown),
            **{name: sum(not row[name]["finite"] for row in flown) for name in methods},
        },
        "errors": sorted({row["error"] for row in rows if row["error"] is not None}),
    }


def _spread(values: Iterable[float | None]) -> dict[str, float] | None:
    found = [value for value in values if value is not None]
    return asdict(spread(found)) if found else None


def _pooled(parts: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return the share over all numbers of all flights."""
    number = sum(part["number"] for part in parts)
    inside = sum(part["share"] * part["number"] for part in parts if part["number"])
    return {"share": inside / number if number else None, "number": number, "of": sum(part["of"] for part in parts)}


Column = tuple[str, Callable[[dict[str, Any]], str]]


def render(cells: Sequence[Cell], summaries: Sequence[dict[str, Any]]) -> str:
    """Write the cells as three tables, each by scenario."""
    found = list(zip(cells, summaries, strict=True))
    tables = [
        "\n".join([title, *_table(found, columns)])
        for title, columns in (
            ("Faults and alarms", ALARMS),
            ("The watched parameter: settled [s], errors [%], median (range)", ERRORS),
            ("Error bars, non-finite values, dither", TRUST),
        )
    ]
    failures = [f"failed: {error}" for summary in summaries for error in summary["errors"]]
    notes = [textwrap.fill(note, WIDTH, subsequent_indent="  ") for note in NOTES]
    return "\n\n".join([*tables, "\n".join([*notes, *dict.fromkeys(failures)])])


def _table(found: Sequence[tuple[Cell, dict[str, Any]]], columns: Sequence[Column]) -> list[str]:
    """Return the lines of a table: a line of each scenario, below it one for each noise and setting."""
    lines = [["", *(name for name, _ in columns)]]
    lines += [
        [f"  {cell.noise:4}  {cell.label}".rstrip(), *(cell_of(one) for _, cell_of in columns)] for cell, one in found
    ]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    head, *rest = (
        "  ".join([line[0].ljust(widths[0]), *map(str.rjust, line[1:], widths[1:])]).rstrip() for line in lines
    )
    table = [head]
    for scenario, group in groupby(zip(found, rest, strict=True), key=lambda one: one[0][0].scenario):
        table.append(f"{scenario.name}: {scenario.watch.symbol}, {scenario.watch.derivative}")
        table += [line for _, line in group]
    return table


def _range(found: dict[str, float] | None, factor: float = 1.0) -> str:
    return "-" if found is None else str(Spread(*(factor * found[key] for key in ("median", "low", "high"))))


def _of(name: str, quantity: str, factor: float = 100.0) -> Callable[[dict[str, Any]], str]:
    """Return a column of the estimator that flew, for an empty name, or of a peer."""

    def column(summary: dict[str, Any]) -> str:
        shown = not name or (name in summary and name != summary["method"])
        return _range(summary[name or summary["method"]][quantity], factor) if shown else "-"

    return column


def _missing(name: str) -> Callable[[dict[str, Any]], str]:
    return lambda summary: str(summary["not_finite"].get(name, "-"))


def _coverage(matrix: str) -> Callable[[dict[str, Any]], str]:
    def share(summary: dict[str, Any]) -> str:
        found = summary["coverage"][matrix]
        return "-" if found["share"] is None else f"{found['share']:.3f} ({found['number']} of {found['of']})"

    return share


def _rate(summary: dict[str, Any]) -> str:
    rate, hours = summary["false_alarms_per_h"], summary["exposed_h"]
    return "-" if rate is None else f"{rate:.3g} ({summary['false_alarms']} in {hours:.3g} h)"


ALARMS: Sequence[Column] = (
    ("flights", lambda s: str(s["flights"])),
    ("failed", lambda s: str(s["failed"])),
    ("detected", lambda s: str(s["detected"]) if s["faults"] else "-"),
    ("missed", lambda s: str(s["missed"]) if s["faults"] else "-"),
    ("delay [s]", lambda s: _range(s["delay_s"])),
    ("false alarms per hour", _rate),
)
BESIDE = ("msls", "rls")
"""Peers in the table, where they did not fly themselves."""
ERRORS: Sequence[Column] = (
    *(("settled", _of("", "settle_s", 1.0)), *((f"{name.upper()}", _of(name, "settle_s", 1.0)) for name in BESIDE)),
    *(("before", _of("", "rms_before")), *((f"{name.upper()}", _of(name, "rms_before")) for name in BESIDE)),
    *(("after", _of("", "rms_after")), *((f"{name.upper()}", _of(name, "rms_after")) for name in BESIDE)),
)
TRUST: Sequence[Column] = (
    ("A in the band", _coverage("a")),
    ("B in the band", _coverage("b")),
    ("reliable before [%]", lambda s: _range(s["reliable_share_before"], 100.0)),
    ("late [%]", _of("", "late_error_now")),
    ("NaN", lambda s: str(s["not_finite"]["flight"])),
    ("NaN in RLS", _missing("rls")),
    ("dither [g]", lambda s: "-" if s["dither_predicted_g_max"] is None else f"{s['dither_predicted_g_max']:.3f}"),
)
