"""Noise of the sensors of surfaces and of vanes: it looks like no delay, like no lag and like no loss."""

from __future__ import annotations

import math

import numpy as np
import pytest

from msls_ros.estimation import Estimate, EventKind, Identifier, from_mapping
from msls_ros.estimation.bank.regression import BankRegression
from msls_ros.estimation.bank.responses import averaged_share, find_hidden, likelier, weight_of
from msls_ros.inputs import differentiated

RATE, SUBSTEPS = 50, 8
STEP = 1.0 / (RATE * SUBSTEPS)
SERVO, DAMPING = 28.0, 0.7
DEGREE = math.pi / 180.0
A, B = np.array([[-8.0, 2.0], [-0.2, -0.9]]), np.array([[27.0, 2.0], [-0.7, -6.0]])
MOMENT, DAMPER = 3.0, 0.04
"""[rad/s^2], [s]"""
CONFIGURATION = from_mapping(
    {"states": ("P", "R"), "effectors": ("da", "dr"), "sample_rate": float(RATE), "known_gravity": False}
)


def events(estimates: list[Estimate], kind: EventKind) -> list[str]:
    return [event.description for one in estimates for event in one.events if event.kind == kind]


def roll(seed: int, noise: float, seconds: float = 40.0) -> list[Estimate]:
    """Identify aileron and rudder of an aircraft that a law flies through turns, with noisy surfaces.

    ``noise`` is that of the surfaces' sensors [rad]; nothing else has any.
    """
    random = np.random.default_rng(seed)
    n = round(seconds * RATE)
    x, act, rate, bank = np.zeros(2), np.zeros(2), np.zeros(2), 0.0
    read, derivative, surface = np.zeros((n, 2)), np.zeros((n, 2)), np.zeros((n, 2))
    for k in range(n):
        wanted = 30.0 * DEGREE * (-1.0) ** (k // (10 * RATE)) if k > 2 * RATE else 0.0
        read[k], derivative[k], surface[k] = x, A @ x + B @ act, act
        law = np.array([0.1 * (1.5 * (wanted - bank) - x[0]), 0.3 * (x[1] - 0.1 * bank)])
        for _ in range(SUBSTEPS):
            rate += STEP * (SERVO * SERVO * (law - act) - 2.0 * DAMPING * SERVO * rate)
            act = act + STEP * rate
            x = x + STEP * (A @ x + B @ act)
            bank += STEP * x[0]
    delta = surface + noise * random.normal(size=surface.shape)
    return list(Identifier(CONFIGURATION).run(np.arange(n) / RATE, read, derivative, delta).estimates)


def moment(seed: int, noise: float, left: float = 1.0) -> tuple[BankRegression, list[Estimate]]:
    """Identify doublets, then a rolling moment that nothing explains while the aileron rests; rates differentiated.

    ``noise`` is that of the surfaces' sensors [rad], the gyros have as much [rad/s]; at 15 s ``left`` is left of the
    aileron, and where it is not all, a doublet shows it and there is no moment.
    """
    random = np.random.default_rng(seed)
    n = 18 * RATE
    time = np.arange(n) / RATE
    x, read, surface = np.zeros(2), np.zeros((n, 2)), np.zeros((n, 2))
    for k in range(n):
        t = time[k]
        aileron = 3.0 * DEGREE * (float(3.0 <= t < 4.0) - float(4.0 <= t < 5.0))
        if left < 1.0:
            aileron += 3.0 * DEGREE * (float(15.5 <= t < 16.5) - float(16.5 <= t < 17.5))
        read[k] = x + noise * random.normal(size=2)
        aileron -= DAMPER * read[k, 0]
        surface[k] = aileron, 3.0 * DEGREE * (float(7.0 <= t < 8.0) - float(8.0 <= t < 9.0))
        acts = surface[k] * np.array([left if t >= 15.0 else 1.0, 1.0])
        push = np.array([MOMENT if t >= 15.0 and left == 1.0 else 0.0, 0.0])
        for _ in range(SUBSTEPS):
            x = x + STEP * (A @ x + B @ acts + push)
    delta = surface + noise * random.normal(size=(n, 2))
    made = differentiated(CONFIGURATION, time, read, None, delta)
    identifier = Identifier(CONFIGURATION, made.straddle)
    estimates = identifier.run(made.time, made.x, made.xdot, made.delta).estimates
    engine = identifier._regression
    assert isinstance(engine, BankRegression)
    return engine, list(estimates)


@pytest.mark.parametrize("seed", [1, 5, 14, 29])
def test_noise_of_surfaces_is_no_record_that_comes_late(seed: int) -> None:
    """Two samples averaged hold half of the noise: "deflections act after -20 ms" (four of thirty such flights)."""
    estimates = roll(seed, 0.05 * DEGREE)
    assert events(estimates, EventKind.RESET) == []
    assert estimates[-1].delay >= 0.0
    assert abs(estimates[-1].b[0, 0] - B[0, 0]) <= 1.96 * estimates[-1].b_std[0, 0]


def test_a_sample_by_itself_averages_nothing() -> None:
    assert [averaged_share(d) for d in (0.0, 0.5, 1.0, 1.2, -0.2)] == [0.0, 0.5, 0.0, 0.0, 0.0]


@pytest.mark.parametrize("seed", range(3))
def test_a_surface_that_rests_after_an_alarm_has_lost_nothing_by_that(seed: int) -> None:
    """All that it moves may be noise of its sensor, which nothing answers: "da -.07 +- .24" of an intact aileron."""
    engine, estimates = moment(seed, 0.05 * DEGREE)
    assert events(estimates, EventKind.DETECTED)
    assert engine.losses([0]).error[0] == math.inf
    engine, estimates = moment(seed, 0.05 * DEGREE, left=0.4)
    assert "da has" in events(estimates, EventKind.ISOLATED)[0]


def test_what_stands_in_for_a_noisy_state_explains_no_more_than_its_noise_hides() -> None:
    """Of a state with a share rho of noise ``1 - rho`` of its effect is found; the rest is what may be stood in for."""
    engine, _ = moment(0, 0.0)
    s, x = engine.settings, engine.state
    number, square, noise, left = 500.0, np.array([40.0, 3.0]), np.array([0.02, 0.001]), 30.0
    x.response_samples[0] = number
    x.response_states[:] = [[-4.0, 1.5], [0.3, -0.7]]
    x.response_row[:, 0] = left
    x.measured[:] = 0.5
    x.white_noise[:] = noise
    x.state_median[:] = 0.0
    factor = np.diag(np.concatenate([[0.0], 1.0 / np.sqrt(square), [1.0, 1.0]]))
    find_hidden(s, x, factor, np.zeros(5))
    expected = (x.response_states**2 * number * noise / (1.0 - number * noise / square)).sum(axis=1) / left
    np.testing.assert_allclose(x.response_hidden, expected, rtol=1e-12)
    x.response_fit[:, :, 1:] = 1.0, 0.0
    x.response_fit[0, :, 0], x.response_fit[3, :, 0] = 0.0, [400.0, 3.0]
    hidden = [-weight_of(s, x, q, 100.0) * math.log(max(1.0 - x.response_hidden[q], 1e-9)) for q in range(2)]
    beyond = sum(max(gained - most, 0.0) for gained, most in zip((400.0, 3.0), hidden, strict=True))
    assert likelier(s, x, 3, 0, 100.0, 0.0, True) == pytest.approx(beyond, rel=1e-9)
    assert likelier(s, x, 3, 0, 100.0, 0.0, False) == 403.0
