"""The model at one instant as heat maps: A and B, every number with its error, coloured by estimate over error."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize, to_hex
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from msls_ros.report.recorded import Array, Flags, Models, Truth
from msls_ros.report.style import DIVERGING, GREEK, INK, WIDTH, Drawn, derivative, write

LIMIT = 10.0
"""Colours end where an estimate is this many standard errors from zero."""
_KNOWN = "#eceff3"
_PALE = 0.35
"""How much of its colour an unreliable number keeps."""


@dataclass(frozen=True)
class _Map:
    """One matrix."""

    title: str
    columns: tuple[str, ...]
    value: Array
    std: Array
    known: Flags
    reliable: Flags
    score: Array
    """What is coloured: the value, or its true error, over the standard error."""


def draw_model(models: Models, at: int, name: str, title: str, truth: Truth | None = None) -> Drawn:
    """Draw A and B after one sample.

    Parameters
    ----------
    models
        All of them.
    at
        Which of them.
    name, title
        Of the figure.
    truth
        Given: the colour is the true error over the standard error, and the second number the truth.
    """
    a, b = models.a[at], models.b[at]
    true_a, true_b = _true_at(truth, float(models.time[at])) if truth is not None else (None, None)
    b_known = np.zeros(b.shape, np.bool_)
    b_known[[i for i in range(len(models.states)) if i not in models.identified]] = True
    maps = [
        _Map("A", models.states, a, models.a_std[at], models.a_known, models.a_reliable[at],
             _score(a, models.a_std[at], true_a)),
        _Map("B", models.effectors, b, models.b_std[at], b_known, models.b_reliable[at],
             _score(b, models.b_std[at], true_b)),
    ]  # fmt: skip
    figure = Figure(figsize=(WIDTH, 1.15 + 0.42 * len(models.states)), layout="constrained")
    axes = figure.subplots(1, 2, width_ratios=[len(m.columns) for m in maps])
    for axis, content, true in zip(axes, maps, (true_a, true_b), strict=True):
        _draw_matrix(axis, content, models.states, true)
    axes[1].tick_params(labelleft=False)
    scale = Normalize(-LIMIT, LIMIT)
    bar = figure.colorbar(_mappable(scale), ax=list(axes), location="bottom", fraction=0.04, aspect=60, pad=0.02)
    bar.set_label("(estimate − truth) / standard error" if truth is not None else "estimate / standard error")
    second = "truth" if truth is not None else "standard error"
    caption = (
        f"After the sample at {models.time[at]:.2f} s. Row: the equation; column: the state or effector. Upper number: "
        f"estimate [state per second per state or rad]; lower: {second}. Pale, hatched, in grey: not reliable "
        "(excited too little, or too large an error). Grey with italic numbers: known from physics, not identified."
    )
    return write(figure, name, title, caption)


def _true_at(truth: Truth, time: float) -> tuple[Array, Array]:
    k = int(np.clip(np.searchsorted(truth.time, time + 1e-6, side="right") - 1, 0, len(truth.time) - 1))
    return truth.a[k], truth.b[k]


def _score(value: Array, std: Array, true: Array | None) -> Array:
    difference = value if true is None else value - true
    good = np.isfinite(std) & (std > 0.0)
    return np.divide(difference, std, out=np.zeros_like(value), where=good)


def _mappable(scale: Normalize) -> ScalarMappable:
    return ScalarMappable(scale, DIVERGING)


def _draw_matrix(axis: Axes, content: _Map, states: tuple[str, ...], true: Array | None) -> None:
    n, m = content.value.shape
    axis.set(xlim=(-0.5, m - 0.5), ylim=(n - 0.5, -0.5))
    axis.set_title(content.title, fontsize=12, fontweight="bold")
    axis.set_xticks(range(m), [GREEK.get(name, name) for name in content.columns])
    axis.set_yticks(range(n), [derivative(name) for name in states])
    axis.tick_params(length=0, labeltop=True, labelbottom=False)
    for spine in axis.spines.values():
        spine.set_visible(False)
    for i in range(n):
        for j in range(m):
            _draw_cell(axis, content, i, j, None if true is None else float(true[i, j]))


def _draw_cell(axis: Axes, content: _Map, i: int, j: int, true: float | None) -> None:
    """Draw one number, with its error or the truth below it."""
    known, reliable = bool(content.known[i, j]), bool(content.reliable[i, j])
    score = float(np.clip(content.score[i, j], -LIMIT, LIMIT))
    colour = _KNOWN if known else to_hex(DIVERGING(0.5 + 0.5 * (1.0 if reliable else _PALE) * score / LIMIT))
    axis.add_patch(Rectangle((j - 0.5, i - 0.5), 1, 1, facecolor=colour, edgecolor="white", linewidth=1.5))
    if not known and not reliable:
        hatch: dict[str, Any] = {"hatch": "////", "edgecolor": "#c3cad2", "linewidth": 0, "fill": False}
        axis.add_patch(Rectangle((j - 0.47, i - 0.46), 0.94, 0.92, **hatch))
        axis.add_patch(Rectangle((j - 0.36, i - 0.34), 0.72, 0.7, facecolor=colour, edgecolor="none"))
    ink = "#4c5763" if known or not reliable else "white" if abs(score) > 0.75 * LIMIT else INK
    style: dict[str, Any] = {"ha": "center", "va": "center", "color": ink}
    value, std = float(content.value[i, j]), float(content.std[i, j])
    if known:
        axis.text(j, i, _number(value), fontsize=8.5, style="italic", **style)
    else:
        axis.text(j, i - 0.17, _number(value), fontsize=8.5, fontweight="bold" if reliable else "normal", **style)
        below = f"±{_number(std)}" if true is None else _number(true)
        axis.text(j, i + 0.23, below, fontsize=7.5, **style)
    for artist in (*axis.texts[-2:], *axis.patches[-3:]):
        artist.set_in_layout(False)


def _number(value: float) -> str:
    """Return a number in at most six characters."""
    if not np.isfinite(value):
        return "∞" if np.isinf(value) else "—"
    if value == 0.0:
        return "0"
    size = abs(value)
    if size >= 1e4 or size < 1e-3:
        return f"{value:.0e}".replace("e-0", "e-").replace("e+0", "e")
    digits = 3 if size < 1.0 else 2 if size < 100.0 else 0
    return f"{value:.{digits}f}".replace("-", "−")
