"""Questions that the paper leaves open: whether the penalty lags, and what the penalty and the dither each buy.

* Lag: a sinusoid is fitted to the estimates of a sinusoidal theta1; its phase is the lag. The rivals are RLS 0.1 behind
  a low-pass, and RLS with a larger forgetting factor, each tuned to the noise of MSLS at constant parameters.
* Numerics: gains from normal equations and Cholesky against the square-root form and against 60 decimal digits.
* Breakdown: textbook RLS in float32, as near as one gets to the numerics of 1993, with half the noise in phi2.
* Information: two effectors that a control law moves together, with and without dither; the same in float32.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from decimal import Decimal, localcontext
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msls_ros.estimation import Regression, make_settings
from msls_ros.estimation.kernel import make_work, msls_gain
from msls_ros.paper.linear_experiments import (
    AMPLITUDE,
    DIFFERENCE_DEVIATION,
    PRIOR,
    RLS_FAST,
    Array,
    history_one,
    make_problem,
    rms_varying,
    run_seeds,
)

PERIODS = (600.0, 100.0)
"""Of theta1, where the lag is measured [samples]; the first is the paper's."""
LITERAL_PENALTY = math.sqrt(2.0 * 0.03)
"""The row that makes ``e^2/2 + dtheta' W0 dtheta`` (eq 13 as printed) with W0 = 0.03 I a least-squares problem."""

PENALTY, FORGETTING = 0.003, 0.9
SCALE = np.array([72.7, 1.0, 1.0, 1.0, 1.0])
ROLL_ROW = np.array([-0.01, -1.5, -4.0, -2.0, 0.45])
"""A roll equation: dPdot/d (w, P, ddt, ddf, 1) [rad/s^2 per m/s, rad/s, rad, rad, 1]."""
TRIM_W = 45.0
"""Trim of w at high angle of attack [m/s]."""


@dataclass(frozen=True)
class Finding:
    """One number that answers a question."""

    question: str
    quantity: str
    value: float
    unit: str


def sinusoid(samples: int, period: float) -> Array:
    """Parameters with a sinusoidal theta1: (samples, 2)."""
    k = np.arange(samples)
    return np.column_stack([AMPLITUDE * np.sin(2.0 * np.pi * k / period), np.full(samples, 100.0)])


def phase_lag(estimate: Array, period: float, start: int) -> float:
    """Median lag of the estimates of `sinusoid`'s theta1 [samples], by their phase.

    Parameters
    ----------
    estimate
        (s, n) over seeds and samples.
    period
        Of theta1 [samples].
    start
        First sample that counts.
    """
    k = np.arange(estimate.shape[1])[start:]
    angle = 2.0 * np.pi * k / period
    basis = np.column_stack([np.sin(angle), np.cos(angle), np.ones(len(k))])
    fitted = np.linalg.lstsq(basis, estimate[:, start:].T, rcond=None)[0]
    return float(np.median(np.arctan2(-fitted[1], fitted[0])) * period / (2.0 * np.pi))


def low_pass(estimate: Array, gain: float) -> Array:
    """First-order low-pass of (s, n) estimates over the samples, from 0."""
    filtered = np.empty_like(estimate)
    state = np.zeros(len(estimate))
    for k in range(estimate.shape[1]):
        state = state + gain * (estimate[:, k] - state)
        filtered[:, k] = state
    return filtered


def bisect(function: Callable[[float], float], low: float, high: float, target: float) -> float:
    """Argument in (low, high) at which a monotonic function reaches a target, to a thousandth of the interval."""
    rising = function(high) > function(low)
    for _ in range(10):
        middle = 0.5 * (low + high)
        if (function(middle) > target) == rising:
            high = middle
        else:
            low = middle
    return 0.5 * (low + high)


def _constant_noise(errors: Array) -> float:
    return float(np.median(np.sqrt(np.mean(errors[:, 100:] ** 2, axis=1))))


def answer_lag(seeds: int) -> list[Finding]:
    """Measure the lag of MSLS, of RLS, and of what smooths RLS as much as the penalty does.

    Parameters
    ----------
    seeds
        How many problems each number is the median of.
    """
    still = np.tile([0.0, 100.0], (500, 1))

    def noise(**changes: Any) -> float:
        return _constant_noise(run_seeds(still, seeds, DIFFERENCE_DEVIATION, **changes).estimate)

    target = noise()
    raw = run_seeds(still, seeds, DIFFERENCE_DEVIATION, **RLS_FAST).estimate
    gain = bisect(lambda g: _constant_noise(low_pass(raw, g)), 0.02, 1.0, target)
    forgetting = bisect(lambda f: noise(rls=True, prior=PRIOR, forgetting=f), 0.1, 0.95, target)
    smoothed = f"RLS 0.1 behind a first-order low-pass of gain {gain:.2f}"
    slower = f"RLS with lambda tuned to {forgetting:.2f}"
    question = "Does the penalty lag (eq 13)?"
    found = [
        Finding(question, "noise at constant parameters, MSLS and its two rivals", target, "rms"),
        Finding(question, "noise at constant parameters, RLS 0.1", _constant_noise(raw), "rms"),
    ]
    plan: list[tuple[str, dict[str, Any], float]] = [
        ("MSLS", {}, 1.0),
        ("RLS 0.1", RLS_FAST, 1.0),
        (smoothed, RLS_FAST, gain),
        (slower, {"rls": True, "prior": PRIOR, "forgetting": forgetting}, 1.0),
        ("MSLS, eq 13 as printed", {"penalty": np.full(2, LITERAL_PENALTY)}, 1.0),
        (
            "MSLS, eq 13 as printed, penalty not retained",
            {"penalty": np.full(2, LITERAL_PENALTY), "retained": False},
            1.0,
        ),
    ]
    for name, changes, smoothing in plan:
        for period in PERIODS:
            runs = run_seeds(sinusoid(1400, period), seeds, DIFFERENCE_DEVIATION, **changes)
            lag = phase_lag(low_pass(runs.estimate, smoothing), period, 200)
            found.append(Finding(question, f"lag of {name}, theta1 of period {period:.0f}", lag, "samples"))
    for name, changes, smoothing in plan[:4]:
        runs = run_seeds(history_one(), seeds, DIFFERENCE_DEVIATION, **changes)
        filtered = type(runs)(runs.truth, low_pass(runs.estimate, smoothing), runs.alarms)
        found.append(Finding(question, f"error of {name}, experiment I, varying", rms_varying(filtered), "rms"))
    return found


def cholesky_gain(normal: NDArray[Any], phi: NDArray[Any]) -> NDArray[Any]:
    """Solve ``normal K = phi`` by Cholesky in the precision of its arguments; NaN where a pivot is not positive.

    Parameters
    ----------
    normal
        (p, p) normal matrix ``R'R + diag(omega)``.
    phi
        (p,) regressor.
    """
    p = len(phi)
    factor = np.zeros_like(normal)
    gain = phi.copy()
    with np.errstate(all="ignore"):
        for j in range(p):
            factor[j, j] = np.sqrt(normal[j, j] - factor[j, :j] @ factor[j, :j])
            factor[j + 1 :, j] = (normal[j + 1 :, j] - factor[j + 1 :, :j] @ factor[j, :j]) / factor[j, j]
        for i in range(p):
            gain[i] = (gain[i] - factor[i, :i] @ gain[:i]) / factor[i, i]
        for i in reversed(range(p)):
            gain[i] = (gain[i] - factor[i + 1 :, i] @ gain[i + 1 :]) / factor[i, i]
    return gain


def exact_gains(phi: Array, w0: float, forgetting: float) -> Array:
    """Gains of eq 14 for two regressors with a retained penalty, in 60 decimal digits: (n, 2); NaN where singular."""
    gains = np.full(phi.shape, math.nan)
    with localcontext() as context:
        context.prec = 60
        lam, added = Decimal(forgetting), Decimal(w0) ** 2
        a = b = d = omega = Decimal(0)
        for k, row in enumerate(phi):
            x, y = Decimal(float(row[0])), Decimal(float(row[1]))
            a, b, d, omega = lam * a + x * x, lam * b + x * y, lam * d + y * y, lam * omega + added
            determinant = (a + omega) * (d + omega) - b * b
            if determinant > 0:
                gains[k] = (
                    float(((d + omega) * x - b * y) / determinant),
                    float(((a + omega) * y - b * x) / determinant),
                )
    return gains


def _worst(gains: Array, exact: Array) -> float:
    """Largest relative error of gains after the first 10; infinite where one is not finite."""
    error = np.linalg.norm(gains - exact, axis=1)[10:] / np.linalg.norm(exact, axis=1)[10:]
    return float(error.max()) if np.isfinite(error).all() else math.inf


def answer_numerics(samples: int = 400, forgetting: float = 0.1) -> list[Finding]:
    """Compare the gains of normal equations and of the square-root form with exact ones, with and without W0."""
    found = []
    question = "Does W0 alone make normal equations accurate (float64)?"
    for difference in (1e-1, 1e-4, 1e-7):
        phi = make_problem(0, history_one(samples), difference=difference).phi
        for w0 in (0.03, 0.0):
            exact = exact_gains(phi, w0, forgetting)
            normal, added = np.zeros((2, 2)), np.diag(np.full(2, w0**2))
            factor, omega, work = np.zeros((2, 2)), np.zeros(2), make_work(2)
            conventional, ours = np.empty_like(phi), np.empty_like(phi)
            for k, row in enumerate(phi):
                normal = forgetting * normal + np.outer(row, row) + added
                conventional[k] = cholesky_gain(normal, row)
                msls_gain(factor, omega, row, np.full(2, w0), 1.0, forgetting, True, work)
                ours[k] = work.K
            case = f"W0 = {w0:g}, phi2 - phi1 of deviation {difference:g}: largest error of the gain"
            found.append(Finding(question, f"{case}, normal equations", _worst(conventional, exact), "relative"))
            found.append(Finding(question, f"{case}, square-root form", _worst(ours, exact), "relative"))
    return found


def roll_stream(dither: float, samples: int = 1000, seed: int = 0) -> tuple[Array, Array]:
    """Fly a roll equation whose two effectors the control law moves together, at 50 Hz.

    Parameters
    ----------
    dither
        Independent noise on each effector [rad rms].
    samples, seed
        Length and random numbers.

    Returns
    -------
    tuple of arrays
        (n, 5) regressors w, P, ddt, ddf, 1 and (n, 1) noisy Pdot [rad/s^2].
    """
    generator = np.random.default_rng(seed)
    gusts, noise = generator.normal(size=(2, samples))
    independent = dither * generator.normal(size=(samples, 2))
    phi, y = np.ones((samples, 5)), np.empty((samples, 1))
    w, rate, command = 0.0, 0.0, 0.0
    for k in range(samples):
        wanted = (0.0, 0.05, -0.05, 0.0)[k // 100 % 4]
        command += 0.2 * (wanted - command)
        phi[k, :4] = TRIM_W + w, rate, command + independent[k, 0], command + independent[k, 1]
        acceleration = float(phi[k] @ ROLL_ROW)
        y[k] = acceleration + 0.01 * noise[k]
        w += 0.02 * (-0.1 * w + gusts[k])
        rate += 0.02 * acceleration
    return phi, y


def answer_information() -> list[Finding]:
    """Show what can be identified of two ganged effectors with ever smaller W0, and with dither."""
    found = []
    question = "Can W0 create information?"
    cases = [(PENALTY, 0.0), (0.1 * PENALTY, 0.0), (0.01 * PENALTY, 0.0), (PENALTY, 0.5), (PENALTY, 1.0)]
    for penalty, degrees in cases:
        phi, y = roll_stream(math.radians(degrees))
        settings = make_settings(5, 1, forgetting=FORGETTING, penalty=np.full(5, penalty), scale=SCALE)
        engine = Regression(settings, 1)
        excitation, error = [], []
        for k in range(len(phi)):
            engine.advance(phi[k : k + 1], y[k : k + 1])
            excitation.append(engine.excitation(0)[2:4].min())
            error.append(np.abs(engine.theta[0, 2:4] - ROLL_ROW[2:4]).max())
        case = f"w = {penalty:g}, dither {degrees:g} deg rms"
        half = len(phi) // 2
        found.append(
            Finding(question, f"{case}: mean excitation of the worse effector", float(np.mean(excitation[half:])), "1")
        )
        found.append(
            Finding(
                question, f"{case}: median error of the worse effector", float(np.median(error[half:])), "rad/s^2/rad"
            )
        )
    return found


def failed_gains(phi: NDArray[Any], penalty: float) -> int:
    """Count samples, after the first 10, at which normal equations and Cholesky give no finite gain.

    Parameters
    ----------
    phi
        (n, p) regressors; their precision is the one computed in.
    penalty
        Dimensionless w; 0: none.
    """
    kind = phi.dtype.type
    added = np.diag((penalty * SCALE) ** 2).astype(kind)
    normal = np.zeros((5, 5), kind)
    failed = 0
    for k, row in enumerate(phi):
        normal = kind(FORGETTING) * normal + np.outer(row, row) + added
        failed += k >= 10 and not np.isfinite(cholesky_gain(normal, row)).all()
    return failed


def textbook_rls(phi: NDArray[Any], y: NDArray[Any], forgetting: float) -> NDArray[Any]:
    """Run RLS as textbooks print it, ``P = (P - k phi' P)/lambda``, in the precision of its arguments.

    Parameters
    ----------
    phi, y
        (n, p) regressors and (n, 1) output.
    forgetting
        Forgetting factor lambda [1].

    Returns
    -------
    array
        (n, p) estimates; not finite from the sample on at which it breaks down.
    """
    kind = phi.dtype.type
    p = phi.shape[1]
    covariance, theta = kind(PRIOR) * np.eye(p, dtype=kind), np.zeros(p, kind)
    estimates = np.full(phi.shape, math.nan, kind)
    with np.errstate(all="ignore"):
        for k, row in enumerate(phi):
            g = covariance @ row
            gain = g / (kind(forgetting) + row @ g)
            theta = theta + gain * (y[k, 0] - row @ theta)
            covariance = (covariance - np.outer(gain, row @ covariance)) / kind(forgetting)
            if not np.isfinite(theta).all():
                break
            estimates[k] = theta
    return estimates


def answer_breakdown(seeds: int) -> list[Finding]:
    """Look for the breakdown of RLS at half the noise in phi2 where it should show: textbook form, float32."""
    question = "Does RLS 0.1 break down with half the noise in phi2 (after Fig. 3)?"
    theta = history_one()
    found, finite = [], True
    for share in (1.0, 0.5):
        errors = []
        for seed in range(seeds):
            problem = make_problem(seed, theta, difference=share * DIFFERENCE_DEVIATION)
            estimates = textbook_rls(problem.phi.astype(np.float32), problem.y.astype(np.float32), 0.1)
            finite = finite and bool(np.isfinite(estimates).all())
            errors.append(math.sqrt(np.mean((estimates[250:, 0] - theta[250:, 0]) ** 2)))
        case = f"textbook form, float32, noise in phi2 {share * DIFFERENCE_DEVIATION:g}"
        found.append(Finding(question, f"{case}: median error, experiment I, varying", float(np.median(errors)), "rms"))
    found.append(Finding(question, "textbook form, float32: every estimate finite (1: yes)", float(finite), "1"))
    return found


def answer_precision(samples: int = 20_000) -> list[Finding]:
    """Run conventional estimators in float32 and float64 with and without W0 and dither."""
    found = []
    question = "Are W0 and dither enough for conventional numerics (the paper's conclusion)?"
    for kind in (np.float64, np.float32):
        for degrees in (0.0, 1.0):
            exact_phi, exact_y = roll_stream(math.radians(degrees), samples)
            phi, y = exact_phi.astype(kind), exact_y.astype(kind)
            case = f"{np.dtype(kind).name}, {'dither 1 deg rms' if degrees else 'no dither'}"
            for penalty in (PENALTY, 0.0):
                label = f"{case}, {'with' if penalty else 'without'} W0: of 1000 samples, no finite gain by Cholesky at"
                found.append(Finding(question, label, float(failed_gains(phi[:1000], penalty)), "samples"))
            label = f"{case}, without W0: of {samples} samples, textbook RLS finite for"
            found.append(
                Finding(
                    question, label, float(np.isfinite(textbook_rls(phi, y, FORGETTING)).all(axis=1).sum()), "samples"
                )
            )
    return found
