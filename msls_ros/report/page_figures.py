"""The page's charts as PNG files, for papers and slides: the same panels, lines and marks."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from msls_ros.report.chart import Marks, Panel
from msls_ros.report.charts import Drawn
from msls_ros.report.figure_style import BLACK, CYCLE, DPI, MUTED, PINK, house_style, write_png

_TRUTH, _LIMIT = 8, 9
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
            figure = Figure(figsize=(10.0, 0.8 + 1.9 * rows), layout="constrained", dpi=DPI)
            axes = list(figure.subplots(rows, 2, sharex=True, squeeze=False).ravel())
            figure.suptitle(drawn.title, fontsize=11)
            for axis, panel in zip(axes, drawn.panels, strict=False):
                _draw(axis, panel, marks)
            for axis in axes[len(drawn.panels) :]:
                axis.set_axis_off()
            for axis in axes[: len(drawn.panels)][-2:]:
                axis.set_xlabel("time [s]")
                axis.tick_params(labelbottom=True)
            paths.append(folder / f"{drawn.name}.png")
            write_png(figure, paths[-1])
    return paths


def _draw(axis: Axes, panel: Panel, marks: Marks) -> None:
    for at in marks.alarms:
        axis.axvline(at, color=PINK, linewidth=1.2)
    for at in marks.changes:
        axis.axvline(at, color=MUTED, linewidth=1.2, linestyle=":")
    seen = []
    for i, line in enumerate(panel.lines):
        style = i if line.style < 0 else line.style
        colour = BLACK if style in (_TRUTH, _LIMIT) else CYCLE[style % len(CYCLE)]
        dashes = {_TRUTH: "--", _LIMIT: ":"}.get(style, _DASHES[style % len(_DASHES)])
        axis.plot(line.time, line.value, color=colour, linestyle=dashes, label=line.name or None)
        seen += [float(line.value.min()), float(line.value.max())] if len(line.value) else []
        if line.half is not None:
            axis.fill_between(line.time, line.value - line.half, line.value + line.half, color=colour, alpha=0.2, lw=0)
    low, high = (panel.low, panel.high) if panel.low is not None else (min(seen, default=0), max(seen, default=1))
    if high is not None and high > low and all(abs(v) < float("inf") for v in (low, high)):
        axis.set_ylim(low - 0.05 * (high - low), high + 0.05 * (high - low))
    axis.set_title(panel.label)
    axis.set_xlim(*marks.span)
    axis.grid(visible=True)
    axis.legend(fontsize=7.5, loc="upper right", ncols=2)
