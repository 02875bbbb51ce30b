"""The paper's claims about its linear experiments, each held against what was measured, and what Figs 1-6 show."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from msls_ros.paper.linear_experiments import (
    AMPLITUDE,
    DETECTING,
    JUMP,
    RLS_FAST,
    Runs,
    detected_share,
    false_alarms,
    history_two,
    jump_errors,
    make_problem,
    median_rms,
    rms_constant,
    rms_varying,
    settling_samples,
    track,
    unexcited_samples,
)
from msls_ros.paper.linear_questions import Finding
from msls_ros.report.paper_figures import ParameterFigure


@dataclass(frozen=True)
class Claim:
    """What the paper says, and whether it is so here."""

    where: str
    claim: str
    verdict: str
    """``reproduced``, ``partly`` or ``not``."""
    number: str
    """What was measured."""


def judge(full: bool, part: bool = False) -> str:
    """Verdict from whether all, or part, of a claim holds."""
    return "reproduced" if full else "partly" if part else "not"


def find(findings: list[Finding], *words: str) -> float:
    """Value of the first finding whose quantity holds all words."""
    return next(one.value for one in findings if all(word in one.quantity for word in words))


def claims_on_tracking(runs: dict[str, Runs], findings: list[Finding]) -> list[Claim]:
    """Judge what the paper says of Figs 1-3."""
    msls, rls, slow = runs["one_msls"], runs["one_rls"], runs["one_rls_slow"]
    still, still_rls, still_slow = rms_constant(msls), rms_constant(rls), rms_constant(slow)
    moving, moving_rls, moving_slow = rms_varying(msls), rms_varying(rls), rms_varying(slow)
    lag, lag_rls = find(findings, "lag of MSLS, theta1", "600"), find(findings, "lag of RLS 0.1, theta1", "600")
    filtered = find(findings, "low-pass", "lag", "600")
    slower = find(findings, "lag", "lambda tuned", "600")
    error_slower = find(findings, "error", "lambda tuned")
    old = [find(findings, "textbook form, float32, noise in phi2", noise) for noise in ("0.1:", "0.05:")]
    halved, halved_rls = rms_varying(runs["one_msls_halved"]) / moving, rms_varying(runs["one_rls_halved"]) / moving_rls
    finite = bool(np.isfinite(runs["one_rls_halved"].estimate).all())
    return [
        Claim(
            "eq 13, Fig. 1",
            "The penalty greatly attenuates parameter noise.",
            judge(still <= 0.5 * still_rls, still < still_rls),
            f"rms error while theta1 is constant {still:.2f}; RLS 0.1 {still_rls:.2f}",
        ),
        Claim(
            "eq 13, Fig. 1",
            "It keeps a high degree of tracking ability; truth and estimate are hard to distinguish.",
            judge(moving <= 0.05 * AMPLITUDE and 3.0 * moving <= moving_rls, moving < moving_rls),
            f"rms error while theta1 varies {moving:.2f}, {100.0 * moving / AMPLITUDE:.1f} % of its amplitude; "
            f"RLS 0.1 {moving_rls:.1f}, RLS 0.9 {moving_slow:.1f}",
        ),
        Claim(
            "eq 13",
            "The penalty is not a low-pass of the estimates: it introduces no lag.",
            judge(lag - lag_rls < 0.1, lag < 0.5 * filtered),
            f"MSLS lags {lag:.1f} samples, RLS 0.1 itself {lag_rls:.1f}. Tuned to the noise of MSLS, RLS 0.1 behind a "
            f"low-pass lags {filtered:.1f}, RLS with a larger lambda {slower:.1f} (but errs by {error_slower:.1f} rms)",
        ),
        Claim(
            "Fig. 3",
            "RLS 0.9 smooths the estimate while the parameter does not vary.",
            judge(still_slow <= 0.5 * still_rls, still_slow < still_rls),
            f"rms error {still_slow:.2f}; RLS 0.1 {still_rls:.2f}",
        ),
        Claim(
            "Fig. 3",
            "RLS 0.9 yields no improvement while the parameter varies.",
            judge(moving_slow >= moving_rls),
            f"rms error {moving_slow:.1f}; RLS 0.1 {moving_rls:.1f}",
        ),
        Claim(
            "after Fig. 3",
            "Halving the noise in phi2 degrades MSLS only a little.",
            judge(halved <= 1.4, halved < halved_rls),
            f"its rms error grows {halved:.2f} times",
        ),
        Claim(
            "after Fig. 3",
            "Halving the noise in phi2 breaks RLS down completely.",
            judge(not finite or halved_rls >= 10.0, halved_rls >= 4.0),
            f"its rms error grows {halved_rls:.2f} times, {'every' if finite else 'not every'} estimate is finite "
            f"(symmetric form, float64); textbook form in float32: {old[1] / old[0]:.2f} times",
        ),
    ]


def claims_on_change(runs: dict[str, Runs]) -> list[Claim]:
    """Judge what the paper says of Figs 4-6."""
    msls, rls, detecting = runs["two_msls"], runs["two_rls"], runs["two_msls_detecting"]
    error, error_rls, error_detecting = (jump_errors(one) for one in (msls, rls, detecting))
    middle, middle_rls, middle_detecting = (float(np.median(one)) for one in (error, error_rls, error_detecting))
    settle, settle_detecting = settling_samples(msls), settling_samples(detecting)
    before, after = false_alarms(detecting)
    easy, hard = rms_varying(runs["one_rls"]), median_rms(rls, 50, JUMP)
    close = 0.7 <= middle / 225.0 <= 1.3 and 0.7 <= middle_rls / 1200.0 <= 1.3
    return [
        Claim(
            "Figs 4-5",
            "A detector speeds up convergence after an abrupt change.",
            judge(bool(settle_detecting.mean() < settle.mean())),
            f"samples to settle: {np.median(settle_detecting):.0f} with it (mean {settle_detecting.mean():.2f}), "
            f"{np.median(settle):.0f} without (mean {settle.mean():.2f}); detected within 3 samples in "
            f"{100.0 * detected_share(detecting):.0f} % of the seeds, {before + after:.2f} false alarms per seed",
        ),
        Claim(
            "Figs 5-6",
            "Without it, MSLS and RLS jump at the change; with it, MSLS jumps less (Fig. 4).",
            judge(middle > middle_detecting and middle_rls > middle_detecting),
            f"median absolute error at sample 300: {middle_detecting:.0f} with detection, {middle:.0f} without, "
            f"RLS {middle_rls:.0f}",
        ),
        Claim(
            "Figs 5-6",
            "The error at sample 300 is about 225 with MSLS and almost 1,200 with RLS.",
            judge(close, 2.0 * middle <= middle_rls),
            f"medians {middle:.0f} and {middle_rls:.0f}, ratio {middle_rls / middle:.1f} (the paper: 5.3, one run); "
            f"{100.0 * np.mean(error >= 225.0):.0f} % of the seeds reach 225 with MSLS, "
            f"{100.0 * np.mean(error_rls >= 1200.0):.0f} % reach 1,200 with RLS",
        ),
        Claim(
            "Fig. 6",
            "The second experiment is the harder one to track.",
            judge(hard > easy),
            f"rms error of RLS 0.1 before the jump {hard:.1f}; in the first experiment {easy:.1f}",
        ),
    ]


def claim_on_threshold(seeds: int) -> Claim:
    """Judge that one threshold serves many conditions: experiment II, one thing changed at a time.

    Parameters
    ----------
    seeds
        Per condition.
    """
    conditions: list[tuple[str, dict[str, float], float, dict[str, float]]] = [
        ("as in the paper", {}, 150.0, {}),
        *((f"jump {jump:g}", {}, jump, {}) for jump in (20.0, 50.0, 500.0)),
        *((f"noise in phi2 {d:g}", {"difference": d}, 150.0, {}) for d in (0.05, 0.2)),
        *((f"noise variance {v:g}", {"noise_variance": v}, 150.0, {}) for v in (0.001, 0.01, 1.0)),
        *((f"lambda {f:g}", {}, 150.0, {"forgetting": f}) for f in (0.3, 0.5, 0.9)),
    ]
    shares, alarms = {}, 0.0
    for name, kind, jump, changes in conditions:
        theta = history_two(jump=jump)
        found = [track(make_problem(seed, theta, **kind), **DETECTING, **changes).alarms for seed in range(seeds)]
        runs = Runs(theta[:, 0], np.zeros((seeds, len(theta))), np.array(found))
        shares[name] = detected_share(runs)
        alarms += sum(false_alarms(runs)) / len(conditions)
    weak = {name: share for name, share in shares.items() if share < 0.9}
    exceptions = ", ".join(f"{name}: {100.0 * share:.0f} %" for name, share in weak.items())
    good = len(shares) - len(weak)
    return Claim(
        "eq 19",
        "One threshold gives good detection over a variety of equations and conditions (linear part).",
        judge(good == len(shares) and alarms <= 0.06, 2 * good >= len(shares)),
        f"T = 20 detects within 3 samples in 90 % or more of the seeds under {good} of {len(shares)} conditions"
        + (f" (not: {exceptions})" if weak else "")
        + f"; {alarms:.3f} false alarms per seed",
    )


def claims_on_numerics(findings: list[Finding]) -> list[Claim]:
    """Judge what the abstract and the conclusion say of numerics."""
    near = "deviation 1e-07"
    with_w0, without = (find(findings, f"W0 = {w},", near, "normal") for w in ("0.03", "0"))
    ours = find(findings, "W0 = 0,", near, "square-root")
    failed = [find(findings, kind, "no dither", "with W0") for kind in ("float64", "float32")]
    still32 = failed[1]
    dither_only = find(findings, "float32", "dither 1 deg", "without W0", "Cholesky")
    dithered = find(findings, "w = 0.003, dither 1 deg", "excitation")
    ganged = find(findings, "w = 0.003, dither 0 deg", "excitation")
    small = find(findings, "w = 3e-05, dither 0 deg", "excitation")
    held = unexcited_samples(100_000)
    lost = unexcited_samples(1000, **RLS_FAST)
    good = with_w0 < 1e-10 and held == 100_000
    loss = "no finite gain" if not np.isfinite(without) else f"{without:.0e}"
    return [
        Claim(
            "abstract (1)",
            "MSLS is less subject to ill-conditioning as its forgetting factor is reduced.",
            judge(good, with_w0 < without),
            f"error of the gain at lambda 0.1, phi2 - phi1 of deviation 1e-7: normal equations {with_w0:.0e} with W0, "
            f"{loss} without; square-root form {ours:.0e} even without W0. Unexcited, MSLS stays finite for {held} "
            f"samples of 100000, RLS 0.1 for about {lost}",
        ),
        Claim(
            "conclusions",
            "The penalty and the dither alone may be enough for conventional (normal-equation) numerics.",
            judge(with_w0 < 1e-10 and max(failed) == 0.0, with_w0 < 1e-6),
            f"penalty alone: gain accurate to {with_w0:.0e} in float64, {still32:.0f} of 1000 float32 samples without "
            f"a finite gain; dither alone: {dither_only:.0f} of 1000. What the penalty cannot buy: two ganged "
            f"effectors have excitation {ganged:.2f} ({small:.2f} with W0 100 times smaller; 0.5 is the limit), "
            f"with dither {dithered:.2f}",
        ),
    ]


def judge_claims(runs: dict[str, Runs], findings: list[Finding], seeds: int) -> list[Claim]:
    """Judge all claims about the linear experiments, in the paper's order."""
    tracking = claims_on_tracking(runs, findings)
    return [*tracking, claim_on_threshold(min(seeds, 20)), *claims_on_change(runs), *claims_on_numerics(findings)]


def figures_of(runs: dict[str, Runs]) -> list[ParameterFigure]:
    """Say what Figs 1-6 show."""
    estimate = "Estimate of Time-Varying Parameter"
    settings = "(λ\u00a0=\u00a00.1, W0\u00a0=\u00a00.03\u00a0I)"
    plan = [
        (1, "one_msls", f"MSLS {estimate} {settings}"),
        (2, "one_rls", f"RLS {estimate} (λ\u00a0=\u00a00.1)"),
        (3, "one_rls_slow", f"RLS {estimate} (λ\u00a0=\u00a00.9)"),
        (4, "two_msls_detecting", f"MSLS with Abrupt Change Detection {settings}"),
        (5, "two_msls", f"MSLS without Abrupt Change Detection {settings}"),
        (6, "two_rls", "RLS without Abrupt Change Detection (λ\u00a0=\u00a00.1)"),
    ]
    figures = []
    for number, name, caption in plan:
        one = runs[name]
        if number <= 3:
            own = (
                f"Experiment I. Median rms error over {len(one.estimate)} seeds: {rms_constant(one):.2f} while "
                f"constant (samples 50 to 199), {rms_varying(one):.2f} while varying (250 to 799). Peaks are cut off."
            )
        else:
            own = (
                f"Experiment II. Median absolute error at sample {JUMP} over {len(one.estimate)} seeds: "
                f"{np.median(jump_errors(one)):.0f}; rms error before it (samples 50 to 299): "
                f"{median_rms(one, 50, JUMP):.1f}. Peaks are cut off, as in the paper."
            )
        figures.append(
            ParameterFigure(
                number,
                caption.replace("Estimate of Time-Varying Parameter", "estimate of time-varying parameter"),
                caption,
                own,
                one.truth,
                one.estimate,
                (-300.0, 300.0),
                JUMP if number > 3 else None,
                tuple(int(k) for k in np.flatnonzero(one.alarms[0])),
            )
        )
    return figures
