"""What the paper says of its F-16 flights (Figs 7-9), held against what was measured: rows, bounds, claims."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from msls_ros.flights.spread import Spread, spread
from msls_ros.paper.claims import Claim, judge
from msls_ros.paper.flight_experiments import NOISES, SCENARIO, Exciting, Flights, Loss
from msls_ros.paper.linear_experiments import Statistic

IN_TIME = 0.04
"""A detection within this time of the loss is in time [s]: two samples."""
NOISE_WORDS = {"none": "noise-free", "low": "low noise"}
QUANTITIES = (
    ("settle_s", "settled within 10 % after", "s", 1.0),
    ("peak_error", "largest error after the loss", "% of b43", 100.0),
    ("rms_after", "rms error later than 1 s after the loss", "% of b43", 100.0),
    ("rms_before", "rms error before the loss", "% of b43", 100.0),
)


@dataclass(frozen=True)
class Row:
    """One quantity of the estimators on the same flights."""

    condition: str
    quantity: str
    unit: str
    flights: int
    msls: Spread
    msls_no_detection: Spread | None = None
    rls: Spread | None = None
    bank: Spread | None = None
    """Beside the paper's estimators: what flies unless another is asked for."""
    better: str | None = None
    """``msls`` or ``rls``, by the medians."""


def _row(
    condition: str,
    quantity: str,
    unit: str,
    msls: Iterable[float],
    rls: Iterable[float],
    without: Iterable[float] | None = None,
    bank: Iterable[float] | None = None,
    *,
    larger: bool = False,
) -> Row:
    """Return a row of values per flight, and which of MSLS and RLS is the better one."""
    values = list(msls)
    ours, theirs = spread(values), spread(rls)
    ahead = ours.median > theirs.median if larger else ours.median < theirs.median
    better = None if ours.median == theirs.median else "msls" if ahead else "rls"
    plain = None if without is None else spread(without)
    beside = None if bank is None else spread(bank)
    return Row(condition, quantity, unit, len(values), ours, plain, theirs, beside, better)


def rows_of(flights: Flights) -> list[Row]:
    """Return what was measured, as a table: Figs 7-8, then Fig 9 by noise, then without dither."""
    exciting = flights.exciting
    named = "dPdot/dw, exciting manoeuvre, noise-free"
    relative = "rms error over range of the truth"
    rows = []
    for words, tail in (("gravity known", ""), ("nine states", "_nine")):
        ours, theirs = f"msls{tail}", f"rls{tail}"
        where = f"{named}, {words}"
        rows.append(_row(where, relative, "1", exciting.relative_error(ours), exciting.relative_error(theirs)))
        pair = exciting.correlation(ours), exciting.correlation(theirs)
        rows.append(_row(where, "correlation with the truth", "1", *pair, larger=True))
    for words, one in flights.variations.items():
        pair = one.relative_error("msls"), one.relative_error("rls_nine")
        rows.append(_row(f"dPdot/dw, {words}; RLS on nine states", relative, "1", *pair))
    for noise, losses in flights.losses.items():
        rows += _loss_rows(f"b43, {NOISE_WORDS[noise]}", losses)
    for noise, losses in flights.undithered.items():
        rows += _loss_rows(f"b43, {NOISE_WORDS[noise]}, no dither", losses)
    return rows


def _loss_rows(condition: str, losses: list[Loss]) -> list[Row]:
    count = len(losses)
    false = spread(one.summary["false_alarms"] for one in losses)
    reliable = spread(100.0 * one.summary["b43"]["reliable_share_before"] for one in losses)
    rows = [
        Row(condition, "detected after", "s", count, spread(one.delay for one in losses)),
        Row(condition, "false alarms", "per flight", count, false),
        Row(condition, "called reliable before the loss", "% of time", count, reliable),
    ]
    for key, words, unit, factor in QUANTITIES:
        msls, without, rls, bank = (
            [factor * one.error(name, key) for one in losses] for name in ("msls", "msls_no_detection", "rls", "bank")
        )
        rows.append(_row(condition, words, unit, msls, rls, without, bank))
    return rows


def _median(values: Iterable[float]) -> float:
    return float(np.median(list(values)))


def middle(losses: Sequence[Loss], name: str, quantity: str) -> float:
    """Return the median over flights of a number of an estimator of b43."""
    return _median(one.error(name, quantity) for one in losses)


def exciting_errors(exciting: Exciting) -> tuple[float, float, float]:
    """Return the median rms error over range of dPdot/dw: MSLS, MSLS on nine states, RLS on nine states."""
    ours, nine, rls = (float(np.median(exciting.relative_error(name))) for name in ("msls", "msls_nine", "rls_nine"))
    return ours, nine, rls


def in_time(losses: Sequence[Loss]) -> float:
    """Share of the flights in which the loss is detected in time."""
    return float(np.mean([one.delay <= IN_TIME + 1e-9 for one in losses]))


def false_alarms(losses: Sequence[Loss]) -> float:
    """Mean number of false alarms per flight."""
    return float(np.mean([one.summary["false_alarms"] for one in losses]))


def worst_dither(flights: Flights, key: str) -> float:
    """Return the largest over all flights of a number of the dither [g]."""
    return max(float(one.summary["dither"][key]) for losses in flights.losses.values() for one in losses)


def flight_acceptance(flights: Flights) -> list[Statistic]:
    """Measure what is accepted or not of the flights; the bounds hold for the medians over 50 of them."""
    exciting = flights.exciting
    error, error_nine, rls_nine = exciting_errors(exciting)
    table = [
        Statistic("Fig 7: MSLS rms error of dPdot/dw over its range", error, high=0.30),
        Statistic("Fig 7: MSLS correlation with the truth", float(np.median(exciting.correlation("msls"))), low=0.7),
        Statistic("Fig 7: RLS rms error over that of MSLS, both on nine states", rls_nine / error_nine, low=10.0),
    ]
    bounds = {"none": (0.2, 1.0 / 3.0, 0.03, 2.0), "low": (math.inf, 1.0, 0.12, 2.0)}
    for noise, losses in flights.losses.items():
        settle, share, after, peak = bounds[noise]
        label = f"Fig 9, {NOISE_WORDS[noise]}:"
        ours, theirs = middle(losses, "msls", "settle_s"), middle(losses, "rls", "settle_s")
        table.append(Statistic(f"{label} detected within {IN_TIME} s, share of flights", in_time(losses), low=1.0))
        table.append(Statistic(f"{label} false alarms per flight", false_alarms(losses), high=0.05))
        if math.isfinite(settle):
            table.append(Statistic(f"{label} MSLS settled within 10 % after [s]", ours, high=settle))
        peaks = middle(losses, "rls", "peak_error") / middle(losses, "msls", "peak_error")
        table += [
            Statistic(f"{label} MSLS time to settle over that of RLS", ours / theirs, high=share),
            Statistic(f"{label} RLS largest error over that of MSLS", peaks, low=peak),
            Statistic(f"{label} MSLS rms error later than 1 s", middle(losses, "msls", "rms_after"), high=after),
        ]
    for words, key, limit in (
        ("predicted [g], nominal level", "predicted_g_max_nominal", 0.012),
        ("predicted [g], after an alarm", "predicted_g_max", 0.04),
        ("realised [g rms], nominal level", "realised_g_rms", 0.012),
        ("realised [g rms], after an alarm", "realised_g_rms_boosted", 0.04),
    ):
        label = f"ANI: largest acceleration of the pilot, {words}"
        table.append(Statistic(label, worst_dither(flights, key), high=limit))
    return table


def claims_on_flights(flights: Flights) -> list[Claim]:
    """Judge what the paper says of its F-16 flights."""
    quiet, noisy = (flights.losses[noise] for noise in NOISES)
    return [
        _claim_on_heave(flights),
        *_claims_on_loss(quiet, noisy),
        _claim_on_detection(quiet, noisy),
        *_claims_on_dither(flights),
    ]


def _identified(one: Exciting) -> bool:
    """Whether MSLS identifies the parameter, by medians."""
    return bool(np.median(one.relative_error("msls")) <= 0.30 and np.median(one.correlation("msls")) >= 0.7)


def _claim_on_heave(flights: Flights) -> Claim:
    exciting = flights.exciting
    ours, nine, rls = exciting_errors(exciting)
    elsewhere = ", ".join(
        f"{words} {np.median(one.relative_error('msls')):.2f} (correlation {np.median(one.correlation('msls')):.2f})"
        for words, one in flights.variations.items()
    )
    light = flights.variations["the paper's light doublet"]
    return Claim(
        "Figs 7-8",
        "MSLS follows dP/dw (a41 in the text, a43 by eq 25) through the doublet, RLS is far off.",
        judge(_identified(light), _identified(exciting) and rls >= 10.0 * nine),
        f"in an exciting manoeuvre without noise: rms error over range {ours:.2f} (correlation "
        f"{np.median(exciting.correlation('msls')):.2f}) with gravity known; on nine states MSLS {nine:.2f} "
        f"(correlation {np.median(exciting.correlation('msls_nine')):.2f}), RLS {rls:.1f}. Zero always would score "
        f"{np.median(exciting.zero_error):.2f}. Elsewhere, gravity known: {elsewhere}. MSLS itself calls it reliable "
        f"in {100.0 * exciting.reliable:.0f} % of the samples",
    )


def _claims_on_loss(quiet: list[Loss], noisy: list[Loss]) -> list[Claim]:
    def pair(quantity: str, losses: list[Loss]) -> tuple[float, float]:
        return middle(losses, "msls", quantity), middle(losses, "rls", quantity)

    settle, settle_noisy = pair("settle_s", quiet), pair("settle_s", noisy)
    after, after_noisy = pair("rms_after", quiet), pair("rms_after", noisy)
    before, before_noisy = pair("rms_before", quiet), pair("rms_before", noisy)
    without = [middle(losses, "msls_no_detection", "settle_s") for losses in (quiet, noisy)]
    ahead = after[0] < after[1] and after_noisy[0] < after_noisy[1]
    early = [before[0] <= before[1], before_noisy[0] <= before_noisy[1]]
    return [
        Claim(
            "Fig. 9, conclusions",
            "After the impairment MSLS tracks b43 (dP/d ddt) significantly better than RLS.",
            judge(ahead and 3.0 * settle[0] <= settle[1], ahead),
            f"settled within 10 % after {settle[0]:.2f} s (RLS {settle[1]:.2f}) noise-free, {settle_noisy[0]:.2f} "
            f"({settle_noisy[1]:.2f}) in low noise; rms error from 1 s after {100 * after[0]:.1f} % "
            f"({100 * after[1]:.1f}) and {100 * after_noisy[0]:.1f} % ({100 * after_noisy[1]:.1f})",
        ),
        Claim(
            "abstract, Fig. 9",
            "MSLS offers significant improvement over RLS (here: b43 before the impairment).",
            judge(all(early), any(early)),
            f"rms error before the loss {100 * before[0]:.1f} % (RLS {100 * before[1]:.1f}) noise-free, "
            f"{100 * before_noisy[0]:.1f} % ({100 * before_noisy[1]:.1f}) in low noise: while nothing changes, the "
            "penalty costs accuracy",
        ),
        Claim(
            "after eq 19",
            "Forgetting the history and lowering the penalty at an alarm speeds up reconvergence on the F-16.",
            judge(settle[0] < without[0] and settle_noisy[0] < without[1], settle[0] < without[0]),
            f"settled after {settle[0]:.2f} s, without detection {without[0]:.2f}; in low noise {settle_noisy[0]:.2f} "
            f"and {without[1]:.2f}. Only the penalty is lowered: lowering lambda as well made recovery worse",
        ),
    ]


def _claim_on_detection(quiet: list[Loss], noisy: list[Loss]) -> Claim:
    fault = SCENARIO.faults[0].time
    seen, literal, false = [], [], 0.0
    for losses in (quiet, noisy):
        seen.append(in_time(losses))
        found = [one.literal_alarms for one in losses]
        hits = [[t for t in alarms if fault < t <= fault + IN_TIME + 1e-9] for alarms in found]
        literal.append(float(np.mean([bool(one) for one in hits])))
        false += float(np.mean([len(alarms) - min(len(hit), 1) for alarms, hit in zip(found, hits, strict=True)])) / 2.0
    mistakes = 0.5 * (false_alarms(quiet) + false_alarms(noisy))
    return Claim(
        "abstract (2), eq 19",
        "Impairments are detected; N = 10 and T = 20 serve the F-16.",
        judge(min(literal) >= 0.95 and false <= 0.05, min(seen) >= 0.95 and mistakes <= 0.05),
        f"N = 10, T = 20 as printed: within {IN_TIME} s in {100 * literal[0]:.0f} % of the flights noise-free and "
        f"{100 * literal[1]:.0f} % in low noise, {false:.2f} false alarms per flight (above the profile's floor); "
        f"the shipped profile (errors normalised, T = 7) {100 * seen[0]:.0f} % and {100 * seen[1]:.0f} %, "
        f"{mistakes:.2f}",
    )


def _claims_on_dither(flights: Flights) -> list[Claim]:
    def reliable(losses: Iterable[Loss]) -> float:
        return 100.0 * _median(one.summary["b43"]["reliable_share_before"] for one in losses)

    dithered = [reliable(flights.losses[noise]) for noise in NOISES]
    plain = [reliable(flights.undithered[noise]) for noise in NOISES]
    errors = [100.0 * middle(flights.losses[noise], "msls", "rms_before") for noise in NOISES]
    plain_errors = [100.0 * middle(flights.undithered[noise], "msls", "rms_before") for noise in NOISES]
    wild = max(one.error("rls", "peak_error") for one in flights.undithered["none"])
    often = [one >= 50.0 for one in dithered]
    day, alarm = worst_dither(flights, "predicted_g_max_nominal"), worst_dither(flights, "predicted_g_max")
    felt, felt_alarm = worst_dither(flights, "realised_g_rms"), worst_dither(flights, "realised_g_rms_boosted")
    within = day <= 0.012 and alarm <= 0.04 and felt <= 0.012 and felt_alarm <= 0.04
    return [
        Claim(
            "abstract (3), ANI",
            "Noise injection insures identifiability of the effector partials.",
            judge(all(often) and max(plain) <= 5.0, dithered[0] > plain[0]),
            f"b43 is reliable before the loss in {dithered[0]:.0f} % of the time with dither ({dithered[1]:.0f} % in "
            f"low noise), {plain[0]:.0f} % ({plain[1]:.0f}) without; rms error {errors[0]:.1f} % ({errors[1]:.0f}) "
            f"against {plain_errors[0]:.0f} % ({plain_errors[1]:.0f}). Without it RLS errs by up to {wild:.0e} times "
            "b43",
        ),
        Claim(
            "eq 23",
            "The pilot never feels more than 0.04 g rms of it, 0.012 g but for a short time after an alarm.",
            judge(within, felt <= 0.012 and felt_alarm <= 0.04),
            f"largest of all flights: predicted {day:.4f} g and {alarm:.4f} g after an alarm; by the true B and the "
            f"actuators {felt:.4f} and {felt_alarm:.4f} g rms (eq 23 adds magnitudes: a worst case)",
        ),
    ]


def render_rows(rows: list[Row]) -> str:
    """Write the rows as text: medians, ranges in brackets, and which is better."""
    lines: list[str] = []
    for condition, group in groupby(rows, key=lambda one: one.condition):
        found = list(group)
        lines.append(f"{condition} ({found[0].flights} flight{'s' if found[0].flights > 1 else ''})")
        for one in found:
            line = f"  {one.quantity} [{one.unit}]"
            for i, value in enumerate((one.msls, one.msls_no_detection, one.rls, one.bank)):
                line += f" {value or ''!s}".rjust(44 + 21 * (i + 1) - len(line))
            lines.append(f"{line}  {(one.better or '').upper()}".rstrip())
    head = "".join(f" {name:>20}" for name in ("MSLS", "without detection", "RLS", "bank"))
    return "\n".join([f"{'median (range)':44}{head}  better", *lines])
