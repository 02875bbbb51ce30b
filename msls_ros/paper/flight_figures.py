"""What Figs 7-9 show: dPdot/dw in an exciting doublet, and b43 through the loss of a stabilator."""

from __future__ import annotations

import math

import numpy as np

from msls_ros.paper.flight_claims import exciting_errors, middle
from msls_ros.paper.flight_experiments import EXCITING_PENALTY, SCENARIO, Exciting, Flights, Loss
from msls_ros.report.paper_figures import ParameterFigure

ROLL_BY_HEAVE = r"$\partial\dot{P}/\partial w$"
B43 = r"$b_{43}=\partial\dot{P}/\partial\delta_{dt}$"


def flight_figures(flights: Flights) -> list[ParameterFigure]:
    """Say what Figs 7-9 show."""
    return [*_heave_figures(flights.exciting), _loss_figure(flights.losses["none"])]


def _heave_figures(exciting: Exciting) -> list[ParameterFigure]:
    ours, nine, rls = exciting_errors(exciting)
    low, high = (math.degrees(angle) for angle in exciting.alpha)
    seeds = len(exciting.truth)
    late = exciting.truth[:, exciting.time >= 1.0]
    reach = 1.1 * float(np.percentile(np.abs(exciting.estimates["rls_nine"]), 99.0))
    middle, half = 0.5 * float(late.max() + late.min()), 0.5 * float(late.max() - late.min())
    why = (
        f"Not the two-pound doublet: 20\u00a0deg/s, alpha moving at 1\u00a0Hz ({low:.1f} to {high:.1f}\u00a0deg), "
        f"noise-free, 100\u00a0Hz, W0\u00a0{EXCITING_PENALTY:.0e}. In a light doublet or in noise this parameter "
        "is not identifiable."
    )
    seven = ParameterFigure(
        7,
        "MSLS vs. RLS, dP/dt by w, in an exciting roll doublet",
        "MSLS vs. RLS ∂P/∂w Parameter ID during Roll Doublet",
        f"{why} MSLS knows gravity; RLS has nine states as regressors, as in the paper. rms error over range, {seeds} "
        f"seeds: MSLS {ours:.2f}, RLS {rls:.1f}; MSLS on nine states {nine:.2f}; always zero "
        f"{np.median(exciting.zero_error):.2f}.",
        exciting.truth,
        exciting.estimates["msls"],
        (-reach, reach),
        parameter=ROLL_BY_HEAVE,
        unit="rad/s² per m/s",
        time=exciting.time,
        name="MSLS",
        rival=exciting.estimates["rls_nine"],
        rival_name="RLS",
    )
    eight = ParameterFigure(
        8,
        "detail of MSLS, dP/dt by w, in an exciting roll doublet",
        "Detail of MSLS ∂P/∂w Parameter ID during Roll Doublet",
        f"{why} MSLS knows gravity. Over {seeds} seeds: correlation with the truth "
        f"{np.median(exciting.correlation('msls')):.2f}, rms error over range {ours:.2f}.",
        exciting.truth,
        exciting.estimates["msls"],
        (middle - 1.6 * half, middle + 1.6 * half),
        parameter=ROLL_BY_HEAVE,
        unit="rad/s² per m/s",
        time=exciting.time,
        name="MSLS",
    )
    return [seven, eight]


def _loss_figure(losses: list[Loss]) -> ParameterFigure:
    first = losses[0]

    def numbers(name: str) -> str:
        settle, peak, after = (middle(losses, name, key) for key in ("settle_s", "peak_error", "rms_after"))
        text = f"settled after {settle:.2f} s, peak error {100 * peak:.0f} %, rms from 1 s after {100 * after:.1f} %"
        return text.replace(" s", "\u00a0s", 1).replace("1 s ", "1\u00a0s ").replace(" %", "\u00a0%")

    before = [100.0 * middle(losses, name, "rms_before") for name in ("msls", "rls")]
    return ParameterFigure(
        9,
        "MSLS vs. RLS, dP/dt by the differential tail, in a roll doublet; fault at 4.0 s",
        "MSLS vs. RLS ∂P/∂δdt Parameter ID during Roll Doublet (Fault at 4.0 sec.)",
        f"The paper's doublet, left stabilator lost, noise-free. Medians of {len(losses)} seeds: MSLS "
        f"{numbers('msls')}; RLS {numbers('rls')}. Before the fault: rms {before[0]:.1f}\u00a0% (MSLS) and "
        f"{before[1]:.1f}\u00a0% (RLS).",
        np.array([one.truth for one in losses]),
        np.array([one.estimates["msls"] for one in losses]),
        (-0.9, 4.1),
        change=SCENARIO.faults[0].time,
        change_label="fault at 4.0 s",
        alarms=first.alarms,
        parameter=B43,
        unit="1/s²",
        time=first.time,
        name="MSLS",
        rival=np.array([one.estimates["rls"] for one in losses]),
        rival_name="RLS",
    )
