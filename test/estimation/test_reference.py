"""What moves with the regressors: no residual shows it, so the reference model must, and the error bars must say so."""

from __future__ import annotations

import math

import numpy as np
import pytest

from msls_ros.estimation import Regression, make_settings
from msls_ros.estimation.state import COLOURS

P, LAMBDA = 3, 0.9
HORIZON = (1.0 + LAMBDA) / (1.0 - LAMBDA)
THETA = np.array([1.0, -2.0, 0.5])


def engine(*, confounded: bool, detect: bool = False, air: float = 1.0) -> Regression:
    """Two states and an effector, as an `Identifier` sets them up; ``air`` of the motion is the air's."""
    settings = make_settings(
        P,
        1,
        forgetting=LAMBDA,
        penalty=np.full(P, 0.01),
        colours=np.array(COLOURS),
        deviation_forgetting=1.0 - P / 500.0,
        detect=detect,
        normalised=True,
        window=20,
        threshold=8.0,
        floor_relative=0.4,
        merge_after=20,
        effectors_from=2,
        effectors_to=3,
        confounded=confounded,
        reference_forgetting=1.0 - (1.0 - LAMBDA) / 6.0,
        confounding=np.array([1.0, 1.0, 0.36]) if confounded else np.zeros(P),
        horizon=HORIZON,
    )
    regression = Regression(settings, 1)
    regression.state.air[0] = air
    return regression


def slow(rng: np.random.Generator, n: int, coefficient: float = 0.95) -> np.ndarray:
    fresh, series = rng.standard_normal(n), np.zeros(n)
    for k in range(1, n):
        series[k] = coefficient * series[k - 1] + math.sqrt(1.0 - coefficient**2) * fresh[k]
    return series


def flight(seed: int, gust: float, colour: float = 0.0, n: int = 1500) -> tuple[np.ndarray, np.ndarray]:
    """Regressors and output; the gust moves the first state, and the turning of the air the output."""
    rng = np.random.default_rng(seed)
    phi = np.stack([(0.2 if gust else 1.0) * slow(rng, n), slow(rng, n), rng.standard_normal(n)], axis=1)
    wind = slow(np.random.default_rng(seed + 1000), n, 0.95)
    turning, lagged = np.zeros(n), 0.0
    for k in range(n):
        lagged += 0.1 * (wind[k] - lagged)
        turning[k] = wind[k] - lagged
    phi[:, 0] += gust * wind
    noise = 0.2 * slow(rng, n, colour)
    return phi, (phi @ THETA + noise + gust * turning)[:, None]


def coverage(gust: float, colour: float, *, confounded: bool, air: float = 1.0) -> float:
    shares = []
    for seed in range(12):
        phi, y = flight(seed, gust, colour)
        theta, errors, _ = engine(confounded=confounded, air=air).run(phi, y)
        shares.append((np.abs(theta[300::20, 0, :2] - THETA[:2]) <= 1.96 * errors[300::20, 0, :2]).mean())
    return float(np.mean(shares))


def test_what_moves_with_a_state_is_covered_only_with_the_reference() -> None:
    assert coverage(1.0, 0.0, confounded=False) < 0.7
    assert coverage(1.0, 0.0, confounded=True) >= 0.9


@pytest.mark.parametrize("colour", [0.0, 0.9])
@pytest.mark.parametrize("air", [0.0, 0.04])
def test_in_still_air_noise_is_left_to_its_own_error_bars(colour: float, air: float) -> None:
    assert 0.9 <= coverage(0.0, colour, confounded=True, air=air) <= 0.985
    phi, y = flight(0, 0.0, colour)
    bars = [engine(confounded=c, air=air).run(phi, y)[1] for c in (False, True)]
    np.testing.assert_allclose(bars[0][300:], bars[1][300:], rtol=0.1)


def test_the_estimates_themselves_do_not_depend_on_it() -> None:
    phi, y = flight(0, 1.0)
    alone, beside = (engine(confounded=c, detect=True).run(phi, y)[0] for c in (False, True))
    np.testing.assert_array_equal(alone, beside)


def test_an_alarm_lends_the_new_estimates_to_the_reference() -> None:
    phi, y = flight(3, 0.0)
    y[700:, 0] += 3.0 * phi[700:, 1]
    regression = engine(confounded=True, detect=True)
    taken, out = regression.advance(phi, y)
    assert 700 <= taken - 1 <= 702 and out.alarm[taken - 1, 0] == 1
    before = regression.state.lag_one.copy()
    until = taken - 1 + 4 * P - 1
    regression.advance_into(out, phi, y, taken, until)
    np.testing.assert_array_equal(regression.state.reference_theta, regression.theta)
    np.testing.assert_array_equal(regression.state.lag_one, before)
    regression.advance_into(out, phi, y, until, len(phi))
    assert regression.state.lag_one[0, 1] > before[0, 1]
    np.testing.assert_allclose(regression.state.reference_theta[0], np.array([1.0, 1.0, 0.5]), atol=0.2)


def test_a_reference_without_excitation_stays_finite_and_forgets_nothing() -> None:
    phi, y = flight(5, 0.0)
    quiet = np.zeros((100_000, P))
    regression = engine(confounded=True)
    regression.advance(phi, y)
    held = regression.state.reference_theta.copy()
    regression.advance(quiet, np.zeros((len(quiet), 1)))
    assert np.isfinite(regression.state.reference).all()
    np.testing.assert_array_equal(regression.state.reference_theta, held)


def test_scaling_a_regressor_by_a_power_of_two_scales_its_error_bar_by_the_inverse() -> None:
    phi, y = flight(7, 1.0)
    scale = np.array([2.0**16, 1.0, 2.0**-20])  # beyond 1e6 a regressor is of no aircraft, see `soundness`
    plain, other = engine(confounded=True), engine(confounded=True)
    other.settings = other.settings._replace(scale=scale)
    other.reset()
    other.state.air[0] = 1.0
    errors = plain.run(phi, y)[1]
    np.testing.assert_array_equal(errors[1:], other.run(phi * scale, y)[1][1:] * scale)


def test_a_model_that_bends_makes_the_estimates_stray_and_the_bars_wider_noise_does_not() -> None:
    rng, n = np.random.default_rng(11), 3000
    phi = np.stack([slow(rng, n, 0.99), slow(rng, n, 0.99), rng.standard_normal(n)], axis=1)
    noise = 0.05 * rng.standard_normal(n)
    straight = (phi @ THETA + noise)[:, None]
    bent = straight + phi[:, :1] ** 2
    strayed = []
    for y in (straight, bent):
        regression = engine(confounded=True, air=0.0)
        errors = regression.run(phi, y)[1]
        alone = engine(confounded=False).run(phi, y)[1]
        total, weight = regression.state.deviation
        strayed.append((total / weight, float(np.median(errors[500:, 0, :2] / alone[500:, 0, :2]))))
    (noisy, same), (curved, wider) = strayed
    assert noisy < 1.3 and same < 1.01
    assert curved > 1.5 and wider > 1.05
