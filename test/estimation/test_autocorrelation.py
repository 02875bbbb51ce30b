"""Error bars where residuals are coloured: white-noise bars fail there, the corrected ones hold."""

from __future__ import annotations

import math

import numpy as np
import pytest

from msls_ros.estimation import Regression, make_settings
from msls_ros.estimation.state import COLOURS


def autoregressive(rng: np.random.Generator, n: int, coefficient: float) -> np.ndarray:
    fresh = rng.standard_normal(n)
    series = np.empty(n)
    series[0] = fresh[0]
    for k in range(1, n):
        series[k] = coefficient * series[k - 1] + math.sqrt(1.0 - coefficient**2) * fresh[k]
    return series


def coverage(regressors: float, residual: float, *, corrected: bool, forgetting: float, penalty: float) -> float:
    """Share of a constant theta inside the 95 % band, for AR(1) regressors and residuals, over 40 seeds."""
    shares = []
    for seed in range(40):
        rng, n = np.random.default_rng(seed), 1200
        phi = np.stack([autoregressive(rng, n, regressors) for _ in range(2)], axis=1)
        theta = np.array([1.0, -2.0])
        y = (phi @ theta + 0.3 * autoregressive(rng, n, residual))[:, None]
        colours = np.array(COLOURS if corrected else COLOURS[:1])
        settings = make_settings(2, 1, forgetting=forgetting, penalty=np.full(2, penalty), colours=colours)
        estimates, errors, _ = Regression(settings, 1).run(phi, y)
        shares.append(float((np.abs(estimates[400::25, 0] - theta) <= 1.96 * errors[400::25, 0]).mean()))
    return float(np.mean(shares))


@pytest.mark.parametrize("residual", [0.9, 0.95])
def test_where_regressors_are_slow_only_the_corrected_bars_hold(residual: float) -> None:
    assert coverage(0.95, residual, corrected=False, forgetting=0.98, penalty=0.003) < 0.7
    assert 0.88 <= coverage(0.95, residual, corrected=True, forgetting=0.98, penalty=0.003) <= 0.99


@pytest.mark.parametrize(("forgetting", "penalty"), [(0.98, 0.003), (0.9, 0.03), (0.1, 0.03)])
def test_white_residuals_keep_their_coverage_with_the_correction(forgetting: float, penalty: float) -> None:
    for corrected in (False, True):
        assert 0.92 <= coverage(0.0, 0.0, corrected=corrected, forgetting=forgetting, penalty=penalty) <= 0.98
