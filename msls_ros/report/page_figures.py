"""The page's charts as PNG files, for papers and slides: the same panels, lines and marks."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from msls_ros.report.chart import Marks, Panel
from msls_ros.report.charts import Drawn
from msls_ros.report.figure_style import BLACK, CYCLE, DPI, MUTED, PINK, house_style, write_png

_BEHIND, _TRUTH, _LIMIT = 7, 8, 9
"""Styles of what others are drawn over, of the truth and of limits."""
_DASHES = ("-", "--", ":", "-.")


def save_figures(figures: Sequence[Drawn], marks: Marks, folder: Path) -> list[Path]:
    """Write each chart of a page into a file of its name.

    Parameters
    ----------
    figures
        The charts.
    marks
        Span, alarms and changes of the truth.
    folder
        That exists.

    Returns
    -------
    list
        The files.

    Raises
    ------
    OSError
        If one cannot be written.
    """
    paths = []
    with house_style():
        for drawn in figures:
            rows = -(-len(drawn.panels) // 2)
            figure = Figure(figsize=(10.0, 0.9 + 2.1 * rows), layout="constrained", dpi=DPI)
            axes = list(figure.subplots(rows, 2, sharex=True, squeeze=False).ravel())
            figure.suptitle(drawn.title, fontsize=11)
            for axis, panel in zip(axes, drawn.panels, strict=False):
                _draw(axis, panel, marks)
            _key_of_marks(figure, marks)
            for axis in axes[len(drawn.panels) :]:
                axis.set_axis_off()
            for axis in axes[: len(drawn.panels)][-2:]:
                axis.set_xlabel("time [s]")
                axis.tick_params(labelbottom=True)
            paths.append(folder / f"{drawn.name}.png")
            write_png(figure, paths[-1])
    return paths


def _key_of_marks(figure: Figure, marks: Marks) -> None:
    lines = []
    if len(marks.alarms):
        lines.append(Line2D([], [], color=PINK, linestyle="-", label="alarm"))
    if len(marks.changes):
        lines.append(Line2D([], [], color=MUTED, linestyle=":", label="true change"))
    if lines:
        figure.legend(handles=lines, loc="outside upper right", ncols=2, fontsize=8)


def _draw(axis: Axes, panel: Panel, marks: Marks) -> None:
    for at in marks.alarms:
        axis.axvline(at, color=PINK, linewidth=1.2)
    for at in marks.changes:
        axis.axvline(at, color=MUTED, linewidth=1.2, linestyle=":")
    seen = []
    for i, line in enumerate(panel.lines):
        style = i if line.style < 0 else line.style
        colour = BLACK if style in (_TRUTH, _LIMIT) else CYCLE[style % len(CYCLE)]
        dashes = {_TRUTH: "--", _LIMIT: ":", _BEHIND: "-"}.get(style, _DASHES[style % len(_DASHES)])
        width = 1.2
        if style == _BEHIND:
            colour, width = MUTED, 2.8
        axis.plot(line.time, line.value, color=colour, linestyle=dashes, linewidth=width, label=line.name or None)
        seen += [float(line.value.min()), float(line.value.max())] if len(line.value) else []
        if line.half is not None:
            axis.fill_between(line.time, line.value - line.half, line.value + line.half, color=colour, alpha=0.2, lw=0)
    low, high = (panel.low, panel.high) if panel.low is not None else (min(seen, default=0), max(seen, default=1))
    if high is not None and high > low and all(abs(v) < float("inf") for v in (low, high)):
        axis.set_ylim(low - 0.05 * (high - low), high + 0.05 * (high - low))
    axis.set_xlim(*marks.span)
    axis.grid(visible=True)
    axis.legend(  # above the axes, where it hides no line
        title=panel.label, alignment="left", loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.1,
        borderpad=0.0, ncols=4, fontsize=7.5, title_fontsize=10,
    )  # fmt: skip
