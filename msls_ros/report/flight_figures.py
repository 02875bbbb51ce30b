"""Figures of one flight: a parameter against truth, the states, the dither and what the pilot feels of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

Array = NDArray[np.float64]

TRUTH, OURS, PEER, OTHER = "#000000", "#0072B2", "#D55E00", "#009E73"
"""Colour-blind safe (Okabe and Ito)."""
STYLES = {
    "rls": ("RLS", PEER, 1.0),
    "msls_no_detection": ("MSLS without detection", OTHER, 1.0),
    "msls": ("MSLS", OTHER, 1.0),
    "bank": ("bank", OURS, 1.8),
}


def new_figure(rows: int, title: str, height: float = 2.4, *, same_time: bool = True) -> tuple[Figure, list[Axes]]:
    """Return a figure of stacked axes over time, with one range of time or with a range each."""
    figure = Figure(figsize=(9.0, 0.9 + height * rows), layout="constrained", dpi=120)
    axes = figure.subplots(rows, 1, sharex=same_time, squeeze=False)[:, 0]
    figure.suptitle(title, fontsize=11)
    axes[-1].set_xlabel("time [s]")
    for axis in axes:
        axis.grid(alpha=0.3)
    return figure, list(axes)


def mark_events(axes: Sequence[Axes], faults: Sequence[tuple[float, float]], alarms: Sequence[float]) -> None:
    """Mark the faults, each with the time over which it grows, and the alarms in every axis."""
    for axis in axes:
        for i, (start, end) in enumerate(faults):
            axis.axvline(start, color="0.4", linestyle=":", linewidth=1.2, label="fault" if i == 0 else None)
            if end > start:
                axis.axvspan(start, end, color="0.4", alpha=0.08, linewidth=0)
        for i, alarm in enumerate(alarms):
            axis.axvline(alarm, color="#CC79A7", linewidth=1.0, label="alarm" if i == 0 else None)


def plot_parameter(
    path: Path,
    time: Array,
    truth: Array,
    estimates: Mapping[str, Array],
    std: Array,
    *,
    faults: Sequence[tuple[float, float]],
    alarms: Sequence[float],
    title: str,
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
    faults, alarms
        Starts and ends, and times [s].
    title, label
        Of the figure, and of the parameter.
    """
    figure, axes = new_figure(2 if faults else 1, title, 3.1, same_time=False)
    first = next(iter(estimates))
    level = float(np.abs(truth).max()) or 1.0
    limits = (-0.6 * level, 2.2 * level)
    for axis in axes:
        mark_events([axis], faults, alarms)
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
    if faults:
        axes[1].set_title("around the fault", fontsize=9, loc="left")
        axes[1].set_xlim(faults[0][0] - 0.5, max(end for _, end in faults) + 2.0)
    figure.savefig(path)


def plot_states(
    path: Path,
    time: Array,
    x: Array,
    alpha: Array,
    beta: Array,
    delta: Array,
    names: Sequence[str],
    *,
    faults: Sequence[tuple[float, float]],
    alarms: Sequence[float],
    title: str,
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
    faults, alarms
        Starts and ends, and times [s].
    title
        Of the figure.
    """
    figure, axes = new_figure(4, title, 1.9)
    axes[0].plot(time, np.degrees(alpha - alpha[0]), label=f"angle of attack - {np.degrees(alpha[0]):.1f}")
    axes[0].plot(time, np.degrees(beta), label="sideslip")
    axes[0].set_ylabel("incidence [deg]")
    for i, name in enumerate("PQR"):
        axes[1].plot(time, np.degrees(x[:, 3 + i]), label=name)
    axes[1].set_ylabel("rates [deg/s]")
    axes[2].plot(time, np.degrees(x[:, 6]), label="bank Φ")
    axes[2].plot(time, np.degrees(x[:, 7] - x[0, 7]), label=f"pitch Θ - {np.degrees(x[0, 7]):.1f}")
    axes[2].set_ylabel("attitude [deg]")
    for j, name in enumerate(names):
        axes[3].plot(time, np.degrees(delta[:, j] - delta[0, j]), linewidth=0.9, label=name)
    axes[3].set_ylabel("deflections\nfrom trim [deg]")
    mark_events(axes, faults, alarms)
    for axis in axes:
        axis.legend(loc="upper left", ncols=1, fontsize=8, bbox_to_anchor=(1.0, 1.0))
    figure.savefig(path)


def plot_dither(
    path: Path,
    time: Array,
    dither: Array,
    names: Sequence[str],
    predicted: Array,
    limit: Array,
    realised: Array,
    *,
    faults: Sequence[tuple[float, float]],
    alarms: Sequence[float],
    title: str,
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
    faults, alarms
        Starts and ends, and times [s].
    title
        Of the figure.
    """
    figure, axes = new_figure(2, title, 2.9)
    for j, name in enumerate(names):
        axes[0].plot(time, np.degrees(dither[:, j]), linewidth=0.7, label=name)
    axes[0].set_ylabel("dither commands [deg]")
    width = max(1, round(1.0 / float(np.median(np.diff(time)))))
    moving = np.sqrt(np.convolve(np.square(realised).sum(axis=1), np.ones(width) / width, mode="same"))
    axes[1].plot(time, limit, color=TRUTH, linestyle="--", label="limit (rms)")
    axes[1].plot(time, predicted, color=OURS, label="predicted (rms)")
    axes[1].plot(time, moving, color=PEER, label="realised (rms over 1 s)")
    axes[1].set_ylabel("acceleration\nat the pilot [g]")
    axes[1].set_ylim(0.0, 1.15 * max(float(limit.max()), 1e-3))
    mark_events(axes, faults, alarms)
    for axis in axes:
        axis.legend(loc="upper left", fontsize=8, bbox_to_anchor=(1.0, 1.0))
    figure.savefig(path)
