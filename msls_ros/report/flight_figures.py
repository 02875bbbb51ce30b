"""Figures of one flight: a parameter against truth, the states, the dither and what the pilot feels of it."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from msls_ros.report.figure_style import write_png
from msls_ros.report.style import causal_rms

Array = NDArray[np.float64]

TRUTH, OURS, PEER, OTHER = "#000000", "#0072B2", "#D55E00", "#009E73"
"""Colour-blind safe (Okabe and Ito)."""
STYLES = {
    "rls": ("RLS", PEER, 1.0),
    "msls_no_detection": ("MSLS without detection", OTHER, 1.0),
    "msls": ("MSLS", OTHER, 1.0),
    "bank": ("bank", OURS, 1.8),
}


@dataclass(frozen=True)
class Flown:
    """What stands in every picture of a flight."""

    title: str
    faults: Sequence[tuple[float, float]]
    """Starts and ends [s]."""
    alarms: Sequence[float]
    """[s]"""

    def titled(self, what: str) -> str:
        """Return the title of one picture."""
        return f"{what}\n{self.title}"


def wrapped(title: str, width: int) -> str:
    """Return a title whose lines are no longer than so many characters."""
    return "\n".join(textwrap.fill(line, width) for line in title.splitlines())


def new_figure(rows: int, title: str, height: float = 2.4, *, same_time: bool = True) -> tuple[Figure, list[Axes]]:
    """Return a figure of stacked axes over time, with one range of time or with a range each."""
    figure = Figure(figsize=(9.0, 0.9 + height * rows), layout="constrained", dpi=120)
    axes = figure.subplots(rows, 1, sharex=same_time, squeeze=False)[:, 0]
    figure.suptitle(wrapped(title, 90), fontsize=11)
    axes[-1].set_xlabel("time [s]")
    for axis in axes:
        axis.grid(alpha=0.3)
    return figure, list(axes)


def new_multiples(number: int, title: str) -> tuple[Figure, list[Axes]]:
    """Return a figure of small axes, three in a row, over one time."""
    rows = -(-number // 3)
    figure = Figure(figsize=(10.0, 0.7 + 1.45 * rows), layout="constrained", dpi=120)
    axes = list(figure.subplots(rows, 3, sharex=True, squeeze=False).ravel())
    figure.suptitle(wrapped(title, 110), fontsize=10)
    for axis in axes[number - 3 : number]:  # the lowest of each column
        axis.set_xlabel("time [s]")
        axis.tick_params(labelbottom=True)
    for axis in axes:
        axis.grid(alpha=0.3)
        axis.tick_params(labelsize=8)
    for axis in axes[number:]:
        axis.set_axis_off()
    return figure, axes


def mark_events(axes: Sequence[Axes], flown: Flown) -> None:
    """Mark the faults, each with the time over which it grows, and the alarms in every axis."""
    for axis in axes:
        for i, (start, end) in enumerate(flown.faults):
            axis.axvline(start, color="0.4", linestyle=":", linewidth=1.2, label="fault" if i == 0 else None)
            if end > start:
                axis.axvspan(start, end, color="0.4", alpha=0.08, linewidth=0)
        for i, alarm in enumerate(flown.alarms):
            axis.axvline(alarm, color="#CC79A7", linewidth=1.0, label="alarm" if i == 0 else None)


def _mark_all(figure: Figure, axes: Sequence[Axes], flown: Flown) -> None:
    """Mark the events in small axes; beneath them one key, of what the last of the axes shows."""
    mark_events(axes, flown)
    handles, labels = axes[-1].get_legend_handles_labels()
    if labels:
        figure.legend(handles, labels, loc="outside lower right", ncols=len(labels), fontsize=8)


def _about(name: str, values: Array) -> tuple[str, Array]:
    """Return a panel of an angle about its first value [rad]."""
    return f"{name} [deg] about {round(float(np.degrees(values[0])), 1) + 0.0:.1f}", values - values[0]


def plot_parameter(
    path: Path,
    time: Array,
    truth: Array,
    estimates: Mapping[str, Array],
    std: Array,
    flown: Flown,
    what: str,
    label: str,
) -> None:
    """Write the figure of a parameter: estimates, 95 % band, truth; below it the time around the faults.

    Parameters
    ----------
    path
        PNG to write.
    time, truth, std
        (n,) [s]; the parameter and its standard error, not zero all the time.
    estimates
        (n,) by name, among `STYLES`; the band is that of the first.
    flown
        Title and marks.
    what, label
        Before the title, and of the axis.
    """
    figure, axes = new_figure(2 if flown.faults else 1, flown.titled(what), 3.1, same_time=False)
    first = next(iter(estimates))
    level = float(np.abs(truth).max()) or 1.0
    limits = (-0.6 * level, 2.2 * level)
    for axis in axes:
        mark_events([axis], flown)
        for name in sorted(estimates, key=lambda one: (one == first, list(STYLES).index(one))):
            who, colour, width = STYLES[name]
            colour, width = (OURS, 1.8) if name == first else (colour, width)
            axis.plot(time, estimates[name], color=colour, linewidth=width, label=who)
        band = np.where(np.isfinite(std), 1.96 * std, 10.0 * level)
        low, high = estimates[first] - band, estimates[first] + band
        axis.fill_between(time, low, high, color=OURS, alpha=0.15, linewidth=0, label=f"{STYLES[first][0]}, 95 %")
        axis.plot(time, truth, color=TRUTH, linestyle="--", linewidth=1.4, label="truth")
        axis.set_ylim(limits if truth[0] >= 0.0 else (-limits[1], -limits[0]))
        axis.set_ylabel(label)
    axes[0].legend(loc="upper right" if truth[0] >= 0.0 else "lower right", ncols=3, fontsize=8)
    if flown.faults:
        axes[1].set_title("around the fault", fontsize=9, loc="left")
        axes[1].set_xlim(flown.faults[0][0] - 0.5, max(end for _, end in flown.faults) + 2.0)
    write_png(figure, path)


def plot_states(
    path: Path,
    time: Array,
    x: Array,
    alpha: Array,
    beta: Array,
    delta: Array,
    names: Sequence[str],
    flown: Flown,
) -> None:
    """Write the figure of the flight: incidence, rates, attitude, deflections.

    Parameters
    ----------
    path
        PNG to write.
    time, x, alpha, beta, delta
        (n,), (n, 9), (n,), (n,), (n, m); SI and radians.
    names
        Of the effectors.
    flown
        Title and marks.
    """
    panels = [_about("angle of attack", alpha), ("sideslip [deg]", beta)]
    panels += [(f"{name} [deg/s]", x[:, 3 + i]) for i, name in enumerate("PQR")]
    panels += [("bank Φ [deg]", x[:, 6]), _about("pitch Θ", x[:, 7])]
    panels += [_about(name, delta[:, j]) for j, name in enumerate(names)]
    figure, axes = new_multiples(len(panels), flown.titled("States and deflections"))
    for axis, (name, values) in zip(axes, panels, strict=False):
        axis.plot(time, np.degrees(values), linewidth=0.9, color=OURS)
        axis.set_title(name, fontsize=9, loc="left")
    _mark_all(figure, axes[: len(panels)], flown)
    write_png(figure, path)


def plot_dither(
    path: Path,
    time: Array,
    dither: Array,
    names: Sequence[str],
    predicted: Array,
    limit: Array,
    realised: Array,
    flown: Flown,
) -> None:
    """Write the figure of the dither and the acceleration that the pilot feels of it.

    Parameters
    ----------
    path
        PNG to write.
    time, dither
        (n,) [s], (n, m) commands [rad].
    names
        Of the effectors.
    predicted, limit
        (n,) rms, and its limit [g].
    realised
        (n, 3) acceleration by the dither alone [g].
    flown
        Title and marks.
    """
    m = len(names)
    figure, axes = new_multiples(m + 1, flown.titled("Dither"))
    largest = 1.05 * max(float(np.abs(np.degrees(dither)).max()), 1e-3)
    for j, name in enumerate(names):
        axes[j].plot(time, np.degrees(dither[:, j]), linewidth=0.7, color=OURS)
        axes[j].set_ylim(-largest, largest)
        axes[j].set_title(f"{name} [deg]", fontsize=9, loc="left")
    width = max(1, round(1.0 / float(np.median(np.diff(time)))))
    axes[m].plot(time, limit, color=TRUTH, linestyle="--", label="limit of acceleration")
    axes[m].plot(time, predicted, color=OURS, label="predicted acceleration")
    axes[m].plot(
        time, causal_rms(realised, width), color=PEER, linestyle="-.", label="realised acceleration, the last 1 s"
    )
    axes[m].set_title("acceleration at the pilot, rms [g]", fontsize=9, loc="left")
    axes[m].set_ylim(0.0, 1.15 * max(float(limit.max()), 1e-3))
    _mark_all(figure, axes[: m + 1], flown)
    write_png(figure, path)
