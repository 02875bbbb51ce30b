"""How figures look and how they are written: one style, colours for all eyes, the same bytes every time."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import matplotlib.style
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.rcsetup import cycler
from numpy.typing import NDArray

Array = NDArray[np.float64]

BLACK, BLUE, ORANGE, GREEN, PINK, SKY, AMBER = (
    "#000000", "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00",
)  # fmt: skip
"""Colour-blind safe (Okabe and Ito)."""
CYCLE = (BLUE, ORANGE, GREEN, PINK, AMBER, SKY, BLACK)
INK, MUTED, RULE = "#1d2733", "#6b7785", "#dfe4ea"
DIVERGING = LinearSegmentedColormap.from_list("orange_white_blue", ["#c8560a", "#f3b27c", "#ffffff", "#8cc0e2", BLUE])
"""Negative orange, nothing white, positive blue."""
WIDTH = 11.5
"""Of a figure [inch]; the page shows it at 96 px per inch."""
DPI = 130
POINTS = 2000
"""Most points of a line; a longer one is drawn as the extremes of its parts."""
_STYLE = {
    "font.family": "DejaVu Sans",
    "font.size": 9.5,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": "#9aa5b1",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 10,
    "axes.titlelocation": "left",
    "axes.axisbelow": True,
    "axes.prop_cycle": cycler(color=CYCLE),
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "grid.color": RULE,
    "grid.linewidth": 0.7,
    "lines.linewidth": 1.2,
    "legend.frameon": False,
    "legend.fontsize": 9,
    "hatch.color": "#8a94a0",
    "hatch.linewidth": 0.5,
    "svg.hashsalt": "msls_ros",
    "svg.fonttype": "path",
}
_MARKS = ("true change", "alarm")
_NO_METADATA = {"Date": None, "Creator": None, "Format": None, "Type": None}


@dataclass(frozen=True)
class Drawn:
    """A figure, written."""

    name: str
    title: str
    caption: str
    svg: bytes
    png: bytes
    width: int
    height: int
    """Of the drawing [px at 96 px per inch]."""


@contextmanager
def house_style() -> Iterator[None]:
    """Draw in our style, whatever the user's own is."""
    with matplotlib.style.context(["default", _STYLE]):
        yield


def write(figure: Figure, name: str, title: str, caption: str) -> Drawn:
    """Return a figure as SVG and PNG; the same figure gives the same bytes."""
    svg, png = io.BytesIO(), io.BytesIO()
    figure.savefig(png, format="png", dpi=DPI, metadata={"Software": None})
    figure.set_layout_engine("none")
    figure.savefig(svg, format="svg", metadata=_NO_METADATA)
    width, height = (round(96 * float(inches)) for inches in figure.get_size_inches())
    return Drawn(name, title, caption, _compact(svg.getvalue()), png.getvalue(), width, height)


def _compact(svg: bytes) -> bytes:
    """Round the coordinates of paths to a hundredth of a point; leave out the document type."""
    text = svg.decode("utf-8")
    text = re.sub(r"<!DOCTYPE.*?>\s*", "", text, count=1, flags=re.DOTALL)
    text = re.sub(r' d="[^"]*"', lambda m: re.sub(r"(\.\d\d)\d+", r"\1", m.group()), text)
    return text.encode("utf-8")


def time_axes(rows: int, height: float, columns: int = 1) -> tuple[Figure, list[Axes]]:
    """Return a figure of axes that share the time; ``height`` is that of a row [inch]."""
    figure = Figure(figsize=(WIDTH, 0.5 + height * rows), layout="constrained")
    axes = figure.subplots(rows, columns, sharex=True, squeeze=False)
    for axis in axes[-1]:
        axis.set_xlabel("time [s]")
    for axis in axes.flat:
        axis.grid(True)
        axis.margins(x=0.0)
    return figure, list(axes.flat)


def line(axis: Axes, time: Array, values: Array, **style: Any) -> None:
    """Plot a line; a long one by the extremes of its parts, so that no peak is lost."""
    t, v = thin(time, values)
    axis.plot(t, v, **style)


def thin(time: Array, values: Array) -> tuple[Array, Array]:
    """Return at most `POINTS` points of a line: the least and the largest of each part, in their order.

    Parameters
    ----------
    time, values
        (k,)
    """
    k = len(time)
    if k <= POINTS:
        return time, values
    size = -(-k // (POINTS // 2))
    keep: list[int] = []
    for start in range(0, k, size):
        part = values[start : start + size]
        if np.isnan(part).all():
            keep.append(start)
            continue
        keep += sorted({start + int(np.nanargmin(part)), start + int(np.nanargmax(part))})
    chosen = np.array(keep, dtype=np.intp)
    return time[chosen], values[chosen]


def every(k: int) -> slice:
    """Return the slice that leaves at most `POINTS` of k."""
    return slice(None, None, max(1, -(-k // POINTS)))


def mark(axes: Sequence[Axes], alarms: Sequence[float], changes: Sequence[float]) -> None:
    """Mark alarms and abrupt changes of the truth in every axis."""
    for axis in axes:
        for i, time in enumerate(changes):
            axis.axvline(time, color=INK, linestyle=":", linewidth=1.2, label=_MARKS[0] if i == 0 else None)
        for i, time in enumerate(alarms):
            axis.axvline(time, color=PINK, linewidth=1.2, label=_MARKS[1] if i == 0 else None)


def beside(axis: Axes, *, without_marks: bool = False) -> None:
    """Put the legend to the right of an axis; without what `mark` drew where another axis names that."""
    handles, labels = axis.get_legend_handles_labels()
    shown = [k for k, text in enumerate(labels) if not (without_marks and text in _MARKS)]
    axis.legend(
        [handles[k] for k in shown],
        [labels[k] for k in shown],
        loc="upper left",
        bbox_to_anchor=(1.0, 1.03),
        borderaxespad=0.4,
    )


UNITS = {**dict.fromkeys(("u", "v", "w"), "m/s²"), **dict.fromkeys(("P", "Q", "R"), "rad/s²"),
         **dict.fromkeys(("Phi", "Theta", "Psi"), "rad/s")}  # fmt: skip
"""Units of the time derivatives."""
GREEK = {"Phi": "Φ", "Theta": "Θ", "Psi": "Ψ"}


def derivative(state: str) -> str:
    """Return how a time derivative is written."""
    return f"d{GREEK.get(state, state)}/dt"
