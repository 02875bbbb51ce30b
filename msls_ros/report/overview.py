"""Figures of the flight itself: what it did, and what happened when."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes

from msls_ros.report.recorded import DITHER_LEVELS, Array, Event, Recorded, Signals, TruthChange
from msls_ros.report.style import (
    AMBER,
    BLUE,
    GREEN,
    INK,
    PINK,
    Drawn,
    beside,
    derivative,
    line,
    mark,
    time_axes,
    write,
)

_KINDS = {"detected": ("^", PINK), "isolated": ("D", BLUE), "recovered": ("o", GREEN)}
_LEVELS = {"off": "#e5e9ee", "nominal": "#cfe5f3", "boosted": AMBER, "inhibited": "#9aa5b1"}
_AIR, _RATES, _ATTITUDE = ("u", "v", "w"), ("P", "Q", "R"), ("Phi", "Theta", "Psi")
Lines = Sequence[tuple[str, Array]]


def draw_overview(flight: Recorded, changes: Sequence[TruthChange]) -> Drawn | None:
    """Draw incidence, rates, attitude and deflections; None where the bag has neither states nor deflections."""
    panels: list[tuple[str, Array, Lines]] = []
    if flight.states is not None and len(flight.states.time):
        panels += _of_states(flight.states)
    deflections = flight.deflections
    if deflections is not None and len(deflections.time):
        degrees = [(name, np.degrees(deflections.values[:, i])) for i, name in enumerate(deflections.names)]
        start = [(f"{name} {round(d[0], 1) + 0.0:+.1f}°", d - d[0]) for name, d in degrees]
        panels.append(("deflections from\ntheir first value [deg]", deflections.time, start))
    if not panels:
        return None
    figure, axes = time_axes(len(panels), 1.75)
    for axis, (label, time, lines) in zip(axes, panels, strict=True):
        for name, values in lines:
            line(axis, time, values, label=name)
        axis.set_ylabel(label)
    mark(axes, [e.time for e in flight.alarms], [c.time for c in changes])
    for axis in axes:
        beside(axis, without_marks=axis is not axes[0])
    caption = (
        "Measured states and deflections, as recorded. Angles and deflections are drawn from their first value, "
        "which the legend gives."
    )
    return write(figure, "flight", "The flight", caption)


def _of_states(states: Signals) -> list[tuple[str, Array, Lines]]:
    """Return the panels of the states: of an aircraft's where the names are, otherwise all in one."""
    of = {name: states.values[:, i] for i, name in enumerate(states.names)}
    panels: list[tuple[str, Array, Lines]] = []
    if set(_AIR) <= set(of):
        u, v, w = (of[name] for name in _AIR)
        speed = np.sqrt(u * u + v * v + w * w)
        alpha = np.degrees(np.arctan2(w, u))
        beta = np.degrees(np.arcsin(np.divide(v, speed, out=np.zeros_like(v), where=speed > 0.0)))
        panels.append(("airspeed [m/s]", states.time, [("V", speed)]))
        panels.append(("incidence [deg]", states.time, [_from_first("α", alpha), ("sideslip β", beta)]))
    rest = [name for name in states.names if not (set(_AIR) <= set(of) and name in _AIR)]
    rates = [name for name in rest if name in _RATES]
    attitude = [name for name in rest if name in _ATTITUDE]
    if rates:
        panels.append(("rates [deg/s]", states.time, [(name, np.degrees(of[name])) for name in rates]))
    if attitude:
        label = {"Phi": "bank Φ", "Theta": "pitch Θ", "Psi": "heading Ψ"}
        turned = [(label[name], np.degrees(np.unwrap(of[name]))) for name in attitude]
        panels.append(("attitude [deg]", states.time, [_from_first(name, d) for name, d in turned]))
    other = [(name, of[name]) for name in rest if name not in (*_RATES, *_ATTITUDE)]
    if other:
        panels.append(("states [SI]", states.time, other))
    return panels


def _from_first(name: str, degrees: Array) -> tuple[str, Array]:
    finite = degrees[np.isfinite(degrees)]
    first = float(finite[0]) if len(finite) else 0.0
    return (name, degrees) if abs(first) < 5.0 else (f"{name} − {first:.1f}°", degrees - first)


def draw_timeline(flight: Recorded, changes: Sequence[TruthChange]) -> Drawn:
    """Draw alarms, isolations and recoveries per equation, the dither's level and the true changes over time."""
    equations = list(dict.fromkeys(name for event in flight.events for name in event.equations))
    if flight.models is not None:
        rows = [flight.models.states[i] for i in flight.models.identified]
        equations = [*rows, *(name for name in equations if name not in rows)]
    lanes: list[tuple[str, Callable[[Axes, float], None]]] = []
    if changes:
        lanes.append(("truth", lambda axis, y: _draw_changes(axis, y, changes)))
    lanes += [(derivative(name), _lane_of(name, flight)) for name in equations]
    if flight.dither is not None and len(flight.dither.time):
        lanes.append(("dither level", lambda axis, y: _draw_levels(axis, y, flight)))
    figure, axes = time_axes(1, max(1.6, 0.34 * len(lanes) + 0.5))
    axis = axes[0]
    for y, (_, draw) in enumerate(lanes):
        draw(axis, float(y))
    axis.set_yticks(range(len(lanes)), [name for name, _ in lanes])
    axis.set_ylim(len(lanes) - 0.4, -0.6)
    axis.set_xlim(*flight.span)
    axis.tick_params(axis="y", length=0)
    mark(axes, [e.time for e in flight.alarms], [c.time for c in changes])
    present = {event.kind for event in flight.events}
    for kind, (symbol, colour) in _KINDS.items():
        if kind in present:
            axis.plot([], [], symbol, color=colour, markersize=8, label=kind)
    if present or changes:
        beside(axis)
    caption = (
        "Each lane is an equation: detection, isolation (the surface or effector is named), recovery; the pale bar spans "
        "detection to recovery."
    )
    return write(figure, "events", "Events", caption if flight.events else "No event in this flight.")


def _lane_of(name: str, flight: Recorded) -> Callable[[Axes, float], None]:
    own = [event for event in flight.events if name in event.equations]

    def draw(axis: Axes, y: float) -> None:
        axis.axhline(y, color="#eef1f4", linewidth=5.0, zorder=0)
        for start, stop in _disturbed(own, flight.span[1]):
            axis.broken_barh([(start, stop - start)], (y - 0.2, 0.4), color=PINK, alpha=0.25, linewidth=0)
        for event in own:
            symbol, colour = _KINDS[event.kind]
            axis.plot([event.time], [y], symbol, color=colour, markersize=8, zorder=3)
            if event.kind == "isolated":
                axis.annotate(event.effector, (event.time, y), (7, 0), textcoords="offset points", va="center")

    return draw


def _disturbed(events: Sequence[Event], end: float) -> list[tuple[float, float]]:
    """Return the stretches between alarm and recovery."""
    found: list[tuple[float, float]] = []
    since: float | None = None
    for event in events:
        if event.kind == "detected" and since is None:
            since = event.time
        elif event.kind == "recovered" and since is not None:
            found.append((since, event.time))
            since = None
    return found if since is None else [*found, (since, end)]


def _draw_changes(axis: Axes, y: float, changes: Sequence[TruthChange]) -> None:
    for change in changes:
        text = "  ".join(f"{effector} ×{ratio:.2f}" for effector, _, ratio in change.effects)
        axis.plot([change.time], [y], "x", color=INK, markersize=7, markeredgewidth=2)
        axis.annotate(text, (change.time, y), (9, 0), textcoords="offset points", va="center")


def _draw_levels(axis: Axes, y: float, flight: Recorded) -> None:
    dither = flight.dither
    if dither is None:
        return
    edges = [0, *(np.flatnonzero(np.diff(dither.level)) + 1), len(dither.level)]
    for start, stop in pairwise(edges):
        begin, end = float(dither.time[start]), float(dither.time[min(stop, len(dither.time) - 1)])
        name = DITHER_LEVELS[int(dither.level[start])]
        axis.broken_barh([(begin, end - begin)], (y - 0.28, 0.56), color=_LEVELS[name], linewidth=0)
        if end - begin > 0.06 * (flight.span[1] - flight.span[0]):
            axis.annotate(name, (0.5 * (begin + end), y), ha="center", va="center", fontsize=8.5, color=INK)
