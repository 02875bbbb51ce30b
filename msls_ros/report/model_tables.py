"""A and B as tables of the page: each number with its error, marked by how well it is known and when."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from html import escape

import numpy as np

from msls_ros.report.knowledge import Knowledge
from msls_ros.report.recorded import Array
from msls_ros.report.style import GREEK, derivative, number

LEGEND = (
    "● reliable at the end; ○ known, not excited now: the best value of the flight stands, with its time; small and "
    "grey: never known; italic: from physics. Below each number its standard error. Rows are equations, columns states "
    "and effectors; [state per second per state or rad]."
)


TIMELY = 0.003
"""What comes no later than that is not written of [s]."""


def timing_text(states: Sequence[str], late: Array) -> str:
    """Say which states come late after their derivatives, (n,) [s], and what has been done about it."""
    said = ", ".join(f"{n} {1e3 * t:.0f} ms" for n, t in zip(states, late, strict=True) if abs(t) > TIMELY)
    return (
        f"Velocities were measured later than their derivatives: {said} at the end of the flight (negative: earlier). "
        f"They were put in step before they were learnt from; A and B are those of the aircraft."
    )


def servo_text(lag: float, delay: float) -> str:
    """Say what B holds for where commands to servos stand in place of deflections: their lag and delay [s]."""
    return (
        f"The deflections of this flight act like commands to servos: through a lag of {1e3 * lag:.0f} ms, "
        f"{1e3 * delay:.0f} ms late. B is the effect of what comes out of it, known to a quarter at best."
    )


def best_tables(known: Knowledge) -> str:
    """Return the tables of A and B at their best."""
    n = len(known.rows)
    return "".join(
        f"<h3>{title}</h3>{_table(known, slice(start, stop))}"
        for title, start, stop in (("B: effectors", n, len(known.columns)), ("A: states", 0, n))
    )


def _table(known: Knowledge, part: slice) -> str:
    columns = range(*part.indices(len(known.columns)))
    head = "".join(f"<th>{escape(GREEK.get(known.columns[j], known.columns[j]))}</th>" for j in columns)
    body = ""
    for i, row in enumerate(known.rows):
        if known.free[i].any():
            cells = "".join(_cell(known, i, j) for j in columns)
            body += f"<tr><th>{derivative(row)}</th>{cells}</tr>"
    table = f'<table class="map"><thead><tr><th></th>{head}</tr></thead><tbody>{body}</tbody></table>'
    return f'<div class="scroll">{table}</div>'


def _cell(known: Knowledge, i: int, j: int) -> str:
    if np.isfinite(known.fixed[i, j]):
        return f'<td class="known">{number(known.fixed[i, j])}</td>'
    if not known.free[i, j]:
        return "<td></td>"
    if known.known[i, j]:
        value, std, time = (float(field[i, j]) for field in (known.value, known.std, known.time))
        mark, kind, when = ("●", "now", "") if known.now[i, j] else ("○", "once", f" at {time:.1f} s")
        return f'<td class="{kind}">{mark} {number(value)}<small>± {number(std, 2)}{when}</small></td>'
    return f'<td class="never"><small>{number(known.last[i, j], 2)} ± {number(known.last_std[i, j], 1)}</small></td>'


def truth_table(known: Knowledge, a: Array, b: Array) -> str:
    """Return the true A and B beside the best known numbers, the worst first.

    Parameters
    ----------
    known
        What is known.
    a, b
        True at the end (n, n), (n, m).
    """
    true = np.concatenate([a, b], axis=1)
    rows = []
    for i, j in np.argwhere(known.known):
        off = (known.value[i, j] - true[i, j]) / known.std[i, j]
        rows.append((-abs(off), i, j, off))
    rows.sort()
    lines = "".join(
        f"<tr><td>{known.rows[i]}/{known.columns[j]}</td><td class=n>{number(known.value[i, j])} ± "
        f"{number(known.std[i, j], 2)}</td><td class=n>{number(true[i, j])}</td><td class=n>{number(off, 2)}</td></tr>"
        for _, i, j, off in rows
    )
    heads = "<th>number</th><th class=n>best known</th><th class=n>truth at the end</th><th class=n>off, in errors</th>"
    return f'<div class="scroll"><table><thead><tr>{heads}</tr></thead><tbody>{lines}</tbody></table></div>'


def as_csv(known: Knowledge) -> str:
    """Return every identified number as CSV."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(["row", "column", "best", "std", "time_s", "reliable_at_end", "at_end", "std_at_end"])
    for i, row in enumerate(known.rows):
        for j, column in enumerate(known.columns):
            if known.free[i, j]:
                best = [f"{v:.9g}" if np.isfinite(known.std[i, j]) else "" for v in
                        (known.value[i, j], known.std[i, j], known.time[i, j])]  # fmt: skip
                last = [f"{known.last[i, j]:.9g}", f"{known.last_std[i, j]:.9g}"]
                writer.writerow([row, column, *best, int(known.now[i, j]), *last])
    return stream.getvalue()
