"""How figures in files look: one style, colours for all eyes, whatever the user's own style is."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import matplotlib.style
from matplotlib.figure import Figure
from matplotlib.rcsetup import cycler

BLACK, BLUE, ORANGE, GREEN, PINK, SKY, AMBER = (
    "#000000", "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00",
)  # fmt: skip
"""Colour-blind safe (Okabe and Ito)."""
CYCLE = (BLUE, ORANGE, GREEN, PINK, AMBER, SKY, BLACK)
INK, MUTED, RULE = "#1d2733", "#6b7785", "#dfe4ea"
DPI = 130
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
}


@contextmanager
def house_style() -> Iterator[None]:
    """Draw in our style, whatever the user's own is."""
    with matplotlib.style.context(["default", _STYLE]):
        yield


def write_png(figure: Figure, path: Path) -> None:
    """Write a figure at its own resolution: laid out once, where ``savefig`` lays it out at every one of its passes.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.execute(figure)
        figure.set_layout_engine("none")
    figure.savefig(path, format="png", metadata={"Software": None})
