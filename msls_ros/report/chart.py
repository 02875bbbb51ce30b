"""Charts over time as inline SVG: static as they stand, with a cursor, values and zoom where there is script.

The drawing is stretched to the width of the page (``preserveAspectRatio="none"``), its lines are not; ticks and names
are text of the page, so they are as large on a phone as on a screen. Lines differ in colour and in dashes. Paths are
relative and in whole numbers, x of `SPAN` over the flight and y of `HEIGHT` over a panel: small, and the script reads
the values that it shows from them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from msls_ros.report.recorded import Array, Flags

SPAN, HEIGHT = 100_000, 1000
POINTS = 1500
"""Most points of a line; a longer one is drawn as the extremes of its parts."""
_TICKS = 6


@dataclass(frozen=True)
class Line:
    """One line, with a band about it where there is one; k points."""

    name: str
    time: Array
    value: Array
    style: int = -1
    """Of the page's line styles, from 0; -1: the next one. Truth and limits have styles of their own, 8 and 9."""
    half: Array | None = None
    """(k,) half the width of the band; not finite: none there."""


@dataclass(frozen=True)
class Panel:
    """One drawing of a chart."""

    label: str
    """What is drawn, and its unit."""
    lines: Sequence[Line]
    strip: tuple[Array, Flags] | None = None
    """Times, and whether the number is reliable there: shown at the foot."""
    low: float | None = None
    high: float | None = None
    """Of the range; None: from the lines."""


@dataclass(frozen=True)
class Marks:
    """What happened when."""

    span: tuple[float, float]
    alarms: Sequence[float] = ()
    changes: Sequence[float] = ()
    """Of the truth."""
    details: Sequence[float] = field(default_factory=tuple)
    """Times about which every point is kept."""


def chart(name: str, title: str, caption: str, panels: Sequence[Panel], marks: Marks, columns: int = 1) -> str:
    """Return a figure.

    Parameters
    ----------
    name
        Of the figure, for links.
    title, caption
        In words.
    panels
        At least one.
    marks
        The span, and what to mark.
    columns
        Panels side by side, where the page is wide enough.
    """
    begin, end = marks.span
    drawn = "".join(_panel(panel, marks) for panel in panels)
    kinds = [("alarm", "alarm", marks.alarms), ("change", "true change", marks.changes)]
    key = "".join(f'<span><i class="key {kind}"></i>{word}</span>' for kind, word, times in kinds if len(times))
    return (
        f'<figure class="chart" id="figure-{name}" tabindex="0" data-t0="{begin:.9g}" data-t1="{end:.9g}" '
        f'aria-label="{escape(title)}"><figcaption><strong>{escape(title)}.</strong> {escape(caption)} {key}'
        "</figcaption>"
        f'<div class="panels c{columns}">{drawn}</div></figure>\n'
    )


def _panel(panel: Panel, marks: Marks) -> str:
    low, high = _range(panel)
    ticks = _round_ticks(low, high, 4)
    step = ticks[1] - ticks[0] if len(ticks) > 1 else 1.0
    texts = "".join(
        f'<span style="top:{100.0 * (1.0 - (y - low) / (high - low)):.1f}%">{_tick(y, step)}</span>' for y in ticks
    )
    rules = "".join(f'<path class="rule" d="M0 {_y(y, low, high)}h{SPAN}"/>' for y in ticks)
    begin, end = marks.span
    lines, key = [], []
    for number, line in enumerate(panel.lines):
        style = line.style if line.style >= 0 else number % 8
        lines.append(_line(line, style, (low, high), marks))
        if not line.name:  # the other side of a band: its first side stands in the key
            continue
        key.append(
            f'<span><svg class="key" viewBox="0 0 26 6"><path class="line s{style}" d="M0 3h26"/></svg>'
            f'{escape(line.name)} <b data-line="{number}"></b></span>'
        )
    events = "".join(
        f'<path class="{kind}" d="M{_x(t, marks.span)} 0v{HEIGHT}"/>'
        for kind, times in (("change", marks.changes), ("alarm", marks.alarms))
        for t in times
        if begin <= t <= end
    )
    times = _round_ticks(begin, end, _TICKS)
    wide = times[1] - times[0] if len(times) > 1 else 1.0
    axis = "".join(
        f'<span style="left:{100.0 * (t - begin) / (end - begin):.2f}%">{_tick(t, wide)}</span>' for t in times
    )
    return (
        f'<div class="panel" data-y0="{low:.9g}" data-y1="{high:.9g}"><div class="head"><em>{escape(panel.label)}</em>'
        f'{"".join(key)}</div><div class="frame"><div class="ys">{texts}</div><div class="plot">'
        f'<svg viewBox="0 0 {SPAN} {HEIGHT}" preserveAspectRatio="none" aria-hidden="true">{rules}'
        f'<g class="zoom">{_strip(panel, marks)}{events}{"".join(lines)}</g></svg><i class="cursor"></i></div></div>'
        f'<div class="xs">{axis}<span class="unit">s</span></div></div>'
    )


def _line(line: Line, style: int, limits: tuple[float, float], marks: Marks) -> str:
    chosen = thinned(line.time, line.value, marks.details)
    time, value = line.time[chosen], line.value[chosen]
    band = ""
    if line.half is not None:
        half = line.half[chosen]
        good = np.isfinite(half) & np.isfinite(value)
        for start, stop in _runs(good):
            part = slice(start, stop)
            upper = _path(time[part], value[part] + half[part], limits, marks.span)
            lower = _path(time[part][::-1], value[part][::-1] - half[part][::-1], limits, marks.span)
            band += f'<path class="band s{style}" d="{upper}L{lower[1:]}z"/>'
    path = "".join(_path(time[a:b], value[a:b], limits, marks.span) for a, b in _runs(np.isfinite(value)))
    return f'{band}<path class="line s{style}" d="{path}"/>'


def thinned(time: Array, value: Array, details: Sequence[float] = ()) -> NDArray[np.intp]:
    """Return the places of at most about `POINTS` points of a line: extremes of each part, and all about the details.

    Parameters
    ----------
    time, value
        (k,)
    details
        Times [s].
    """
    k = len(time)
    if k <= POINTS:
        return np.arange(k)
    size = -(-2 * k // POINTS)
    whole = k // size * size
    filled = np.where(np.isfinite(value[:whole]), value[:whole], 0.0).reshape(-1, size)
    starts = np.arange(0, whole, size)
    keep = [starts + filled.argmin(axis=1), starts + filled.argmax(axis=1), np.array([0, k - 1])]
    for t in list(details)[:5]:
        a, b = np.searchsorted(time, [t - 0.6, t + 1.5])
        keep.append(np.arange(a, b, max(1, (b - a) // 300)))
    return np.unique(np.concatenate(keep))


def _runs(good: Flags) -> list[tuple[int, int]]:
    """Return the stretches of true."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], good, [False])).astype(np.int8)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _path(time: Array, value: Array, limits: tuple[float, float], span: tuple[float, float]) -> str:
    x = np.rint((time - span[0]) / (span[1] - span[0]) * SPAN).astype(np.int64)
    low, high = limits
    y = np.rint(np.clip((high - value) / (high - low), -3.0, 4.0) * HEIGHT).astype(np.int64)
    if len(x) == 0:
        return ""
    steps = np.stack([np.diff(x), np.diff(y)], axis=1).ravel().tolist()
    relative = " ".join(map(str, steps)).replace(" -", "-")
    return f"M{x[0]} {y[0]}" + (f"l{relative}" if relative else "h1")


def _strip(panel: Panel, marks: Marks) -> str:
    """Return the strip at the foot: filled where the number is reliable."""
    if panel.strip is None or not len(panel.strip[0]):
        return ""
    time, reliable = panel.strip
    edges = [0, *(np.flatnonzero(np.diff(reliable)) + 1).tolist(), len(reliable)]
    parts = []
    for a, b in pairwise(edges):
        if reliable[a]:
            left, right = _x(float(time[a]), marks.span), _x(float(time[min(b, len(time) - 1)]), marks.span)
            parts.append(f'<path class="sure" d="M{left} {HEIGHT - 30}H{max(right, left + 1)}V{HEIGHT}H{left}z"/>')
    return "".join(parts)


def _range(panel: Panel) -> tuple[float, float]:
    """Return the range to show: all of the lines but the worst hundredth, and the middle of a band."""
    parts = []
    for line in panel.lines:
        good = line.value[np.isfinite(line.value)]
        if len(good):
            parts.append(np.quantile(good, [0.005, 0.995]) if len(good) > 200 else np.array([good.min(), good.max()]))
        if line.half is not None:
            both = line.value[np.isfinite(line.half)], line.half[np.isfinite(line.half)]
            if len(both[1]):
                half = float(np.median(both[1]))
                parts.append(np.quantile(both[0], [0.1, 0.9]) + np.array([-half, half]))
    low = min((float(p[0]) for p in parts), default=-1.0) if panel.low is None else panel.low
    high = max((float(p[1]) for p in parts), default=1.0) if panel.high is None else panel.high
    if not high - low > 1e-12 * max(abs(high), abs(low), 1e-9):
        margin = 0.1 * abs(high) or 1.0
        return low - margin, high + margin
    margin = 0.08 * (high - low)
    return low - (margin if panel.low is None else 0.0), high + (margin if panel.high is None else 0.0)


def _round_ticks(low: float, high: float, most: int) -> list[float]:
    """Return round numbers within a range, three or more, about so many."""
    width = (high - low) / most
    power = 10.0 ** math.floor(math.log10(width))
    found: list[float] = []
    for step in (power * f for f in (10.0, 5.0, 2.0, 1.0)):
        first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
        found = [k * step for k in range(first, last + 1)]
        if len(found) > 2:
            break
    return found


def _tick(value: float, step: float) -> str:
    digits = max(0, -math.floor(math.log10(step) + 1e-9))
    if abs(value) >= 1e5 or digits > 4:
        return f"{value:.3g}".replace("-", "−")
    return f"{value + 0.0:.{digits}f}".replace("-", "−")


def _x(time: float, span: tuple[float, float]) -> int:
    return round((time - span[0]) / (span[1] - span[0]) * SPAN)


def _y(value: float, low: float, high: float) -> int:
    return round((high - value) / (high - low) * HEIGHT)
