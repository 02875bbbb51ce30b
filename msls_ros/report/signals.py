"""Figures of what runs beside the model: prediction errors, detector, dither, excitation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from msls_ros.report.recorded import Array, Detection, Dither, Models, Recorded, TruthChange
from msls_ros.report.style import (
    BLUE,
    GREEN,
    INK,
    MUTED,
    ORANGE,
    PINK,
    SKY,
    UNITS,
    WIDTH,
    Drawn,
    beside,
    derivative,
    every,
    line,
    mark,
    time_axes,
    write,
)

_EXCITATION_COLUMNS = 900


def draw_detection(flight: Recorded, detection: Detection, changes: Sequence[TruthChange]) -> Drawn:
    """Draw each equation's prediction error beside the detector's statistic and threshold."""
    rows = len(detection.rows)
    figure, axes = time_axes(rows, 1.3, 2)
    for q, name in enumerate(detection.rows):
        left, right = axes[2 * q], axes[2 * q + 1]
        mark([left, right], [e.time for e in flight.alarms], [c.time for c in changes])
        _residual_band(left, flight.models, name)
        line(left, detection.time, detection.error[:, q], color=INK, linewidth=0.8, label="prediction error")
        limit = float(np.quantile(np.abs(detection.error[:, q]), 0.995)) if len(detection.time) else 1.0
        left.set_ylim(-1.4 * limit or -1.0, 1.4 * limit or 1.0)
        left.set_ylabel(f"{derivative(name)} [{UNITS.get(name, 'x/s')}]")
        _statistic(right, detection, q)
    axes[0].set_title("prediction error and ± residual standard deviation")
    axes[1].set_title("change statistic (eq 19) and threshold")
    _shared_legend(figure, [axes[0], axes[1]])
    caption = (
        "Prediction error of each equation before its update (eq 11), the published residual standard deviation, and "
        "the statistic that is compared with the threshold. No line: the detector is not armed, at the start and while "
        "its window fills after an alarm."
    )
    return write(figure, "detection", "Prediction errors and detector", caption)


def _shared_legend(figure: Figure, axes: Sequence[Axes]) -> None:
    found: dict[str, Artist] = {}
    for axis in axes:
        handles, labels = axis.get_legend_handles_labels()
        found.update({label: handle for handle, label in zip(handles, labels, strict=True) if label not in found})
    figure.legend(list(found.values()), list(found), loc="outside lower center", ncols=len(found))


def _residual_band(axis: Axes, models: Models | None, name: str) -> None:
    if models is None or name not in models.states:
        return
    few = every(len(models.time))
    std = models.residual_std[few, models.states.index(name)]
    for sign, label in ((1.0, "± residual std"), (-1.0, None)):
        axis.plot(models.time[few], sign * std, color=SKY, linewidth=1.8, zorder=3, label=label)


def _statistic(axis: Axes, detection: Detection, q: int) -> None:
    values = np.where(detection.statistic[:, q] != 0.0, detection.statistic[:, q], np.nan)
    line(axis, detection.time, values, color=BLUE, linewidth=1.0, label="statistic")
    axis.axhline(detection.threshold, color=ORANGE, linestyle="--", linewidth=1.3, label="threshold")
    over = detection.statistic[:, q] > detection.threshold
    axis.plot(detection.time[over], detection.statistic[over, q], "o", color=ORANGE, markersize=5, label="over it")
    top = max(1.3 * detection.threshold, 1.1 * float(detection.statistic[:, q].max(initial=0.0)))
    axis.set_ylim(min(0.0, 1.2 * float(detection.statistic[:, q].min(initial=0.0))) - 0.02 * top, top)


def draw_residuals(flight: Recorded, models: Models, changes: Sequence[TruthChange]) -> Drawn:
    """Draw the published residual standard deviations, and the statistic as the events give it."""
    rows = models.identified
    figure, axes = time_axes(len(rows), 1.2)
    for axis, i in zip(axes, rows, strict=True):
        name = models.states[i]
        mark([axis], [e.time for e in flight.alarms], [c.time for c in changes])
        line(axis, models.time, models.residual_std[:, i], color=BLUE, label="residual std")
        axis.set_ylim(bottom=0.0)
        axis.set_ylabel(f"{derivative(name)}\n[{UNITS.get(name, 'x/s')}]")
        for event in flight.alarms:
            if name in event.equations:
                q = event.equations.index(name)
                text = f" {event.statistic[q]:.1f} > {event.threshold[q]:g}"
                axis.annotate(text, (event.time, 0.95), xycoords=("data", "axes fraction"), va="top", color=INK)
    beside(axes[0])
    caption = (
        "Residual standard deviation as published; at an alarm, statistic and threshold as the event gives them. The "
        "statistic between the alarms is not in the messages, and cannot be recomputed without the configuration."
    )
    return write(figure, "residuals", "Residuals and alarms", caption)


def draw_dither(flight: Recorded, dither: Dither, changes: Sequence[TruthChange]) -> Drawn:
    """Draw the dither commands, and the pilot's predicted acceleration against its limit."""
    figure, axes = time_axes(2, 2.3)
    for j, name in enumerate(dither.effectors):
        line(axes[0], dither.time, np.degrees(dither.delta[:, j]), linewidth=0.8, label=name)
    axes[0].set_ylabel("dither commands [deg]")
    line(axes[1], dither.time, dither.limit, color=INK, linestyle="--", linewidth=1.4, label="limit (rms)")
    line(axes[1], dither.time, dither.predicted, color=BLUE, label="predicted (rms)")
    if dither.realised is not None:
        line(axes[1], dither.time, dither.realised, color=GREEN, label="realised (rms of 1 s)\nthrough the true B")
    axes[1].set_ylabel("acceleration\nat the pilot [g]")
    axes[1].set_ylim(0.0, 1.15 * max(float(np.nanmax(dither.limit)), 1e-3))
    mark(axes, [e.time for e in flight.alarms], [c.time for c in changes])
    for axis in axes:
        beside(axis, without_marks=axis is not axes[0])
    caption = (
        "Above: the dither added to the commands. Below: the rms acceleration at the pilot predicted for "
        "it, and its limit."
    )
    return write(figure, "dither", "Dither against its limit", caption)


def draw_excitation(flight: Recorded, models: Models, changes: Sequence[TruthChange]) -> Drawn:
    """Draw how much of each parameter the data decide: over time, and at the end."""
    names = list(models.regressors)
    p = len(names)
    figure = Figure(figsize=(WIDTH, 0.9 + 0.24 * p), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True, width_ratios=[5, 1.3])
    step = max(1, -(-len(models.time) // _EXCITATION_COLUMNS))
    shown: Array = models.excitation[::step].T
    extent = (float(models.time[0]), float(models.time[-1]), p - 0.5, -0.5)
    image = left.imshow(
        shown, aspect="auto", cmap="cividis", vmin=0.0, vmax=1.0, extent=extent, interpolation="nearest"
    )
    left.set_yticks(range(p), ["1 (constant)" if name == "1" else name for name in names])
    left.set_xlabel("time [s]")
    left.tick_params(length=0)
    for event in flight.alarms:
        left.axvline(event.time, color=PINK, linewidth=1.4)
    for change in changes:
        left.axvline(change.time, color="white", linestyle=":", linewidth=1.4)
    figure.colorbar(image, ax=left, pad=0.01, fraction=0.03, label="excitation")
    right.barh(range(p), models.excitation[-1], color=BLUE, height=0.65)
    right.barh(range(p), np.median(models.excitation, axis=0), color="none", edgecolor=MUTED, height=0.65)
    right.set_xlim(0.0, 1.0)
    right.set_title("at the end (bar), median (outline)", fontsize=8.5)
    right.grid(True, axis="x")
    right.tick_params(axis="y", length=0)
    caption = (
        "Share of each parameter that the data determine, not the penalty: 1 (bright) is data alone, 0 (dark) the past "
        "estimate alone. Minimum over the equations."
    )
    return write(figure, "excitation", "Excitation", caption)
