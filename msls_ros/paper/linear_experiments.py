"""The paper's linear experiments (eqs 15-17, Figs 1-6) on many seeds, and what is measured on them.

The output is ``y(k) = theta1(k) phi1(k) + theta2(k) phi2(k) + v(k)`` with ``v ~ N(0, variance 0.1)``,
``phi1 ~ N(0, 1)`` and ``phi2 = phi1 + N(0, variance 0.01)``, so that the two regressors are nearly collinear.
Two parameter histories:

* I (Figs 1-3), 800 samples: theta1 is 0, from sample 200 on ``200 sin(2 pi (k - 200)/600)``; theta2 is 100.
* II (Figs 4-6), 600 samples: theta1 is ``200 sin(2 pi k/400)``; theta2 jumps from 100 to 250 at sample 300.

The paper states the noise levels, the settings and that ``theta1`` varies; the histories are read off its figures.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msls_ros.estimation import Regression, make_settings
from msls_ros.estimation.soundness import SOUND

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

NOISE_VARIANCE = 0.1
DIFFERENCE_DEVIATION = 0.1
"""Standard deviation of ``phi2 - phi1`` (eq 17)."""
AMPLITUDE = 200.0
ONSET = 200
"""Sample of experiment I from which theta1 varies."""
JUMP = 300
"""Sample of experiment II at which theta2 jumps."""
LONG_ENOUGH = 10
"""Samples in a row below `SETTLED` that count as settled."""
SETTLED = 20.0
UNEXCITED = 1_000_000
"""Samples without excitation that MSLS must survive."""
PRIOR = 1e6
"""Initial covariance of RLS."""

RLS_FAST: dict[str, Any] = {"rls": True, "prior": PRIOR}
RLS_SLOW: dict[str, Any] = {"rls": True, "prior": PRIOR, "forgetting": 0.9}
DETECTING: dict[str, Any] = {"detect": True}


@dataclass(frozen=True)
class Problem:
    """A regression over n samples with p parameters whose truth is known."""

    phi: Array
    """(n, p) regressors."""
    y: Array
    """(n, 1) output."""
    theta: Array
    """(n, p) true parameters."""


@dataclass(frozen=True)
class Track:
    """What an estimator made of a `Problem`."""

    theta: Array
    """(n, p) estimates after each sample."""
    alarms: Integers
    """(n,) 1 where an abrupt change was declared."""


@dataclass(frozen=True)
class Runs:
    """Estimates of theta1 by one estimator on one problem, over s seeds and n samples."""

    truth: Array
    """(n,) theta1."""
    estimate: Array
    """(s, n) its estimates."""
    alarms: Integers
    """(s, n) 1 where an abrupt change was declared."""

    @property
    def error(self) -> Array:
        """(s, n) estimate minus truth."""
        return self.estimate - self.truth


@dataclass(frozen=True)
class Statistic:
    """One measured number and the bounds that it must keep."""

    statistic: str
    measured: float
    low: float = -math.inf
    high: float = math.inf

    @property
    def ok(self) -> bool:
        """Whether the bounds are kept."""
        return self.low <= self.measured <= self.high


def make_problem(
    seed: int,
    theta: Array,
    *,
    difference: float = DIFFERENCE_DEVIATION,
    noise_variance: float = NOISE_VARIANCE,
) -> Problem:
    """Draw regressors and noise of eqs 15-17 for a parameter history.

    Parameters
    ----------
    seed
        Of the random numbers; the same draws whatever the deviations.
    theta
        (n, 2) true parameters.
    difference
        Standard deviation of ``phi2 - phi1``.
    noise_variance
        Variance of v.
    """
    generator = np.random.default_rng(seed)
    n = len(theta)
    phi1, between, v = generator.normal(size=(3, n))
    phi = np.column_stack([phi1, phi1 + difference * between])
    y = (phi * theta).sum(axis=1) + math.sqrt(noise_variance) * v
    return Problem(phi, y[:, None], theta)


def history_one(samples: int = 800) -> Array:
    """Parameters of experiment I: (samples, 2)."""
    k = np.arange(samples)
    theta1 = np.where(k < ONSET, 0.0, AMPLITUDE * np.sin(2.0 * np.pi * (k - ONSET) / 600.0))
    return np.column_stack([theta1, np.full(samples, 100.0)])


def history_two(samples: int = 600, jump: float = 150.0) -> Array:
    """Parameters of experiment II: (samples, 2), with a jump of theta2 by ``jump``."""
    k = np.arange(samples)
    theta1 = AMPLITUDE * np.sin(2.0 * np.pi * k / 400.0)
    return np.column_stack([theta1, np.where(k < JUMP, 100.0, 100.0 + jump)])


def track(problem: Problem, **changes: Any) -> Track:
    """Run an estimator over a problem.

    Parameters
    ----------
    problem
        What to estimate.
    **changes
        To the paper's settings (`make_settings`).
    """
    n, p = problem.phi.shape
    engine = Regression(make_settings(p, 1, **changes), 1)
    theta, alarms = np.empty((n, p)), np.zeros(n, np.int64)
    for k in range(n):
        _, out = engine.advance(problem.phi[k : k + 1], problem.y[k : k + 1])
        theta[k] = engine.theta[0]
        alarms[k] = out.alarm[0, 0]
    return Track(theta, alarms)


def run_seeds(theta: Array, seeds: int, difference: float, **changes: Any) -> Runs:
    """Run an estimator over the problems of seeds 0, 1, ...; see `make_problem` and `track`."""
    tracks = [track(make_problem(seed, theta, difference=difference), **changes) for seed in range(seeds)]
    return Runs(
        theta[:, 0].copy(),
        np.array([one.theta[:, 0] for one in tracks]),
        np.array([one.alarms for one in tracks]),
    )


def run_experiments(seeds: int, done: Callable[[], None] = lambda: None) -> dict[str, Runs]:
    """Run every estimator of Figs 1-6 over the seeds.

    Parameters
    ----------
    seeds
        How many, from 0 on.
    done
        Called after each estimator.

    Returns
    -------
    dict
        By name: ``one_`` or ``two_`` (the experiment), then the estimator; ``_halved``: with half the noise in phi2.
    """
    one, two, full = history_one(), history_two(), DIFFERENCE_DEVIATION
    plan: dict[str, tuple[Array, float, dict[str, Any]]] = {
        "one_msls": (one, full, {}),
        "one_msls_halved": (one, 0.5 * full, {}),
        "one_rls": (one, full, RLS_FAST),
        "one_rls_halved": (one, 0.5 * full, RLS_FAST),
        "one_rls_slow": (one, full, RLS_SLOW),
        "two_msls": (two, full, {}),
        "two_msls_detecting": (two, full, DETECTING),
        "two_rls": (two, full, RLS_FAST),
    }
    runs = {}
    for name, (theta, difference, changes) in plan.items():
        runs[name] = run_seeds(theta, seeds, difference, **changes)
        done()
    return runs


def median_rms(runs: Runs, start: int, stop: int) -> float:
    """Median over the seeds of the rms error of theta1 over samples ``start`` to ``stop - 1``."""
    return float(np.median(np.sqrt(np.mean(runs.error[:, start:stop] ** 2, axis=1))))


def rms_constant(runs: Runs) -> float:
    """Median rms error of theta1 in experiment I while it is constant (samples 50-199)."""
    return median_rms(runs, 50, ONSET)


def rms_varying(runs: Runs) -> float:
    """Median rms error of theta1 in experiment I while it varies (samples 250-799)."""
    return median_rms(runs, 250, 800)


def jump_errors(runs: Runs) -> Array:
    """(s,) absolute error of theta1 in experiment II at the sample of the jump."""
    errors: Array = np.abs(runs.error[:, JUMP])
    return errors


def settling_samples(runs: Runs) -> Integers:
    """(s,) samples after the jump until the absolute error is below 20 for 10 in a row; all of them if never."""
    settled = np.abs(runs.error[:, JUMP:]) < SETTLED
    stay = np.array([settled[:, k : k + LONG_ENOUGH].all(axis=1) for k in range(settled.shape[1] - LONG_ENOUGH + 1)])
    found: Integers = np.where(stay.any(axis=0), stay.argmax(axis=0), settled.shape[1])
    return found


def detected_share(runs: Runs) -> float:
    """Share of the seeds with an alarm within three samples of the jump."""
    return float(runs.alarms[:, JUMP : JUMP + 3].any(axis=1).mean())


def false_alarms(runs: Runs) -> tuple[float, float]:
    """Alarms per seed before the jump, and from the third sample after it."""
    return float(runs.alarms[:, :JUMP].sum(axis=1).mean()), float(runs.alarms[:, JUMP + 3 :].sum(axis=1).mean())


def coverage(seeds: int, samples: int = 400) -> float:
    """Share of the 95 % error bars of MSLS that hold the truth, for constant parameters (samples 100, 103, ...)."""
    inside = []
    theta = np.full((samples, 2), 100.0)
    for seed in range(seeds):
        problem = make_problem(seed, theta)
        engine = Regression(make_settings(2, 1), 1)
        for k in range(samples):
            engine.advance(problem.phi[k : k + 1], problem.y[k : k + 1])
            if k >= 100 and k % 3 == 1:
                inside.append(np.abs(engine.theta[0] - 100.0) <= 1.959964 * engine.standard_errors(0))
    return float(np.mean(inside))


def unexcited_samples(samples: int, **changes: Any) -> int:
    """Run experiment I, then hold the regressors still; return after how many samples the estimate is lost.

    Parameters
    ----------
    samples
        To hold them: half the time at (1, 1), then at 0.
    **changes
        To the paper's settings.

    Returns
    -------
    int
        The first sample, to 1 in 100, at which the numbers leave the range of what can be computed and the engine
        begins anew; ``samples`` if there is none.
    """
    engine = Regression(make_settings(2, 1, **changes), 1)
    problem = make_problem(0, history_one())
    engine.advance(problem.phi, problem.y)
    generator = np.random.default_rng(1)
    chunk = max(samples // 100, 1)
    for start in range(0, samples, chunk):
        phi = np.full((chunk, 2), 1.0 if start < samples // 2 else 0.0)
        y = 100.0 * phi.sum(axis=1, keepdims=True) + math.sqrt(0.1) * generator.normal(size=(chunk, 1))
        done = 0
        while done < chunk:
            taken, out = engine.advance(phi[done:], y[done:])
            done += taken
            if out.restart[taken - 1] != SOUND:
                return start
    return samples


def acceptance(runs: dict[str, Runs], seeds: int) -> list[Statistic]:
    """Measure what is accepted or not; the bounds hold for the medians over 100 seeds.

    Parameters
    ----------
    runs
        Of `run_experiments`.
    seeds
        For the coverage of the error bars.
    """
    msls, rls = runs["one_msls"], runs["one_rls"]
    detecting = runs["two_msls_detecting"]
    before, after = false_alarms(detecting)
    msls_ratio = rms_varying(runs["one_msls_halved"]) / rms_varying(msls)
    rls_ratio = rms_varying(runs["one_rls_halved"]) / rms_varying(rls)
    slow = runs["one_rls_slow"]
    return [
        Statistic("I: MSLS rms error, constant", rms_constant(msls), 2.1, 2.45),
        Statistic("I: MSLS rms error, varying", rms_varying(msls), 4.7, 5.2),
        Statistic("I: MSLS rms error with half the noise in phi2, over that with all", msls_ratio, high=1.4),
        Statistic("I: RLS 0.1 rms error over that of MSLS, varying", rms_varying(rls) / rms_varying(msls), low=3.0),
        Statistic("I: RLS 0.1 rms error with half the noise in phi2, over that with all", rls_ratio, low=1.8),
        Statistic("I: RLS 0.9 rms error, constant", rms_constant(slow), high=0.85),
        Statistic("I: RLS 0.9 rms error, varying", rms_varying(slow), low=24.0),
        Statistic("II: MSLS absolute error at 300", float(np.median(jump_errors(runs["two_msls"]))), 120.0, 310.0),
        Statistic("II: RLS 0.1 absolute error at 300", float(np.median(jump_errors(runs["two_rls"]))), 400.0, 820.0),
        Statistic(
            "II: MSLS with detection, absolute error at 300", float(np.median(jump_errors(detecting))), 71.0, 77.0
        ),
        Statistic("II: MSLS samples to settle", float(np.median(settling_samples(runs["two_msls"]))), high=6.0),
        Statistic(
            "II: MSLS with detection, samples to settle", float(np.median(settling_samples(detecting))), high=1.0
        ),
        Statistic("II: detected in 300-302, share of seeds", detected_share(detecting), low=0.97),
        Statistic("II: false alarms per seed before 300", before, high=0.05),
        Statistic("II: false alarms per seed from 303", after, high=0.06),
        Statistic("MSLS: coverage of the 95 % error bars, constant parameters", coverage(seeds), 0.93, 0.97),
        Statistic(
            f"MSLS: finite samples of {UNEXCITED:,} unexcited", float(unexcited_samples(UNEXCITED)), low=UNEXCITED
        ),
    ]
