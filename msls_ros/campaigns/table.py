"""What a campaign found: each cell's flights in numbers, medians with ranges, and as tables."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict
from itertools import groupby
from typing import Any

import numpy as np

from msls_ros.campaigns.flight import ANGLES, DITHER, Cell, Row, estimators
from msls_ros.flights.judging import ALARM_WINDOW, LATE, SETTLED
from msls_ros.flights.spread import Spread, spread

QUANTITIES = ("settle_s", "rms_before", "rms_after", "rms_after_now", "peak_error", "late_error", "late_error_now")
NAMED = ("rightly", "wrongly", "not")
HOUR = 3600.0
WIDTH = 116
NOTES = (
    f"detected: an alarm from the fault to {ALARM_WINDOW:g} s after the end of its ramp; any other is false, and the "
    "hours are those in which one would be.",
    f"settled: when the error of the watched parameter stays below {100 * SETTLED:g} % of its true value before the "
    "fault, counted from the end of the ramp; where it never does, that is the end of the flight.",
    "before, after: rms error of the watched parameter from 1 s on, and from 1 s after the end of the ramp, in % of "
    f"its true value before the fault; late: the largest from {LATE:g} s after it, in % of the true value now.",
    "named: an effector, until the next fault, that has truly lost a tenth of its effect or more; "
    "wrongly: any other name. z: the share left less the true one, over its standard error.",
    "in the band: share of the coefficients flagged reliable whose 95 % band holds the truth (in brackets: how "
    "many are flagged, of all in the rigid-body equations). NaN: flights with a value that is not finite.",
    "dither: rms acceleration at the pilot's station by the dither alone, as predicted from B-hat and as felt through "
    "actuators and the true B, both at the nominal level, medians; worst second: of any flight.",
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
        "named": {key: sum(row["named"][key] for row in flown) for key in NAMED},
        "named_z": _spread(abs(z) for row in flown for z in row["named"]["z"]),
        "reliable_share_before": _spread(row["reliable_share_before"] for row in flown),
        "dither": _dither([row["dither"] for row in flown]),
        "not_finite": {
            "flight": sum(not row["finite"] for row in flown),
            **{name: sum(not row[name]["finite"] for row in flown) for name in methods},
        },
        "tracking": _tracking([row["tracking"] for row in flown if "tracking" in row]),
        "errors": sorted({row["error"] for row in rows if row["error"] is not None}),
    }


def _tracking(rows: Sequence[dict[str, Any]]) -> dict[str, Any] | None:
    """Return how the flights followed their commands; a flight that departed has recovered never."""
    if not rows:
        return None
    never = [math.inf if row["recovery_s"] is None else row["recovery_s"] for row in rows]
    median = float(np.median(never))
    return {
        "kept": sum(row["kept"] for row in rows),
        "of": len(rows),
        **{name: _spread(row[name] for row in rows) for name in (*ANGLES, "fixed_share")},
        "recovery_median_s": None if math.isinf(median) else median,
        "why": sorted({row["why"] for row in rows if row["why"]}),
    }


def _dither(rows: Sequence[dict[str, float]]) -> dict[str, float] | None:
    """Return the median of what was predicted and felt, and the largest of the rest."""
    if not rows:
        return None
    of = {name: [row[name] for row in rows] for name in DITHER}
    return {name: float(np.median(v)) if name.endswith("_rms") else float(np.max(v)) for name, v in of.items()}


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
    if any(summary["tracking"] is not None for summary in summaries):
        tracked = [one for one in found if one[1]["tracking"] is not None]
        tables.insert(
            0, "\n".join(["The law: flights kept, tracking from the fault on, median (range)", *_table(tracked, LAW)])
        )
    failures = [f"failed: {error}" for summary in summaries for error in summary["errors"]]
    notes = [textwrap.fill(note, WIDTH, subsequent_indent="  ") for note in NOTES]
    return "\n\n".join([*tables, "\n".join([*notes, *dict.fromkeys(failures)])])


def _table(found: Sequence[tuple[Cell, dict[str, Any]]], columns: Sequence[Column]) -> list[str]:
    """Return the lines of a table: a line of each scenario, below it one for each noise and setting."""
    lines = [["", *(name for name, _ in columns)]]
    lines += [
        [f"  {cell.noise:4}  {cell.label or _plain(found)}".rstrip(), *(cell_of(one) for _, cell_of in columns)]
        for cell, one in found
    ]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    head, *rest = (
        "  ".join([line[0].ljust(widths[0]), *map(str.rjust, line[1:], widths[1:])]).rstrip() for line in lines
    )
    table = [head]
    watches = {cell.scenario.name: cell.scenario.watch for cell, _ in found}
    for name, group in groupby(zip(found, rest, strict=True), key=lambda one: one[0][0].scenario.name):
        table.append(f"{name}: {watches[name].symbol}, {watches[name].derivative}")
        table += [line for _, line in group]
    return table


def _plain(found: Sequence[tuple[Cell, dict[str, Any]]]) -> str:
    """Return what a cell without a setting is called: nothing, where no other cell has one."""
    return "as configured" if any(cell.setting for cell, _ in found) else ""


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


def _tracked(name: str) -> Callable[[dict[str, Any]], str]:
    return lambda summary: _range(summary["tracking"][name])


def _recovered(summary: dict[str, Any]) -> str:
    median = summary["tracking"]["recovery_median_s"]
    return "never" if median is None else f"{median:.2f}"


def _felt(summary: dict[str, Any]) -> str:
    dither = summary["dither"]
    return "-" if dither is None else f"{dither['predicted_g_rms']:.4f} {dither['realised_g_rms']:.4f}"


def _worst(dither: dict[str, float]) -> str:
    return f"{100.0 * dither['realised_of_limit_1s_max']:.0f}"


LAW: Sequence[Column] = (
    ("kept", lambda s: f"{s['tracking']['kept']} of {s['tracking']['of']}"),
    ("roll rate rms [deg/s]", _tracked("roll_rms")),
    ("alpha max [deg]", _tracked("alpha_max")),
    ("beta max [deg]", _tracked("beta_max")),
    ("recovered [s]", _recovered),
)
ALARMS: Sequence[Column] = (
    ("flights", lambda s: str(s["flights"])),
    ("failed", lambda s: str(s["failed"])),
    ("detected", lambda s: str(s["detected"]) if s["faults"] else "-"),
    ("missed", lambda s: str(s["missed"]) if s["faults"] else "-"),
    ("delay [s]", lambda s: _range(s["delay_s"])),
    ("false alarms per hour", _rate),
    ("named rightly / wrongly / not", lambda s: " / ".join(str(s["named"][key]) for key in NAMED)),
    ("|z| of the share left", lambda s: _range(s["named_z"])),
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
    ("dither, predicted and felt [g]", _felt),
    ("worst second [% of limit]", lambda s: "-" if s["dither"] is None else _worst(s["dither"])),
)
