"""What physics knows of A stands at the states: what is not known of these is in its errors."""

from __future__ import annotations

import numpy as np
import pytest

from msls_ros.estimation import Identifier, from_mapping
from msls_ros.estimation.bank.regression import BankRegression
from msls_ros.estimation.kernel import Array
from msls_ros.inputs.derivatives import DerivativeFilter

STATES = ("u", "v", "w", "P", "Q", "R", "Phi", "Theta")
V, W, P = (STATES.index(name) for name in "vwP")
RATE = 50.0
SPREAD = np.array([1.0, 1.0, 1.0, 0.05, 0.05, 0.05, 0.05, 0.05])


def test_a_state_that_is_not_believed_yet_is_an_error_of_what_stands_at_it() -> None:
    """A roll that begins within a sample may be a spike: dv/dw, which is P, stays at the last one, and says so."""
    random = np.random.default_rng(1)
    identifier = Identifier(from_mapping({"states": STATES, "effectors": ("da",), "sample_rate": RATE}))
    for k in range(200):
        x = np.array([60.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.03]) + SPREAD * random.normal(size=8)
        u, v, w, p, q, r, phi, theta = x
        slopes = np.array([r * v - q * w, p * w - r * u, q * u - p * v, 0.0, 0.0, 0.0, 0.0, 0.0])
        slopes[:3] += 9.80665 * np.array([-np.sin(theta), np.sin(phi) * np.cos(theta), np.cos(phi) * np.cos(theta)])
        before = identifier.update(k / RATE, x, slopes + 0.01 * random.normal(size=8), 0.01 * random.normal(size=1))
    x[P] += 1.5
    held = identifier.update(200 / RATE, x, slopes, np.zeros(1))
    assert held.a[V, W] == pytest.approx(before.a[V, W], abs=0.02)
    assert before.a_std[V, W] < 0.4 < 1.4 < held.a_std[V, W] and not held.a_reliable[V, W]


def test_what_a_window_leaves_of_a_state_is_an_error_of_what_stands_at_it() -> None:
    """A roll acceleration of 20 rad/s^2 that comes and goes: the mean over the window is off by up to .12 rad/s."""
    time: Array = np.arange(0.0, 4.0, 1.0 / RATE)
    roll: Array = 20.0 * (np.clip(time - 1.0, 0.0, 0.15) - np.clip(time - 2.0, 0.0, 0.15))
    window, interval = DerivativeFilter(5, 1, 10**9), 5
    found = [window.push(round(t * 1e9), np.array([p])) for t, p in zip(time, roll, strict=True)]
    kept = [one for one in found if one is not None]
    names = {"states": ("P",), "effectors": ("da",), "known_gravity": False, "sample_rate": RATE}
    identifier, off, said = Identifier(from_mapping(names), interval), [], []
    for one in kept:
        identifier.learn(one.stamp * 1e-9, one.smooth, one.slope, np.zeros(1))
        engine = identifier._regression
        assert isinstance(engine, BankRegression)
        off.append(abs(one.smooth[0] - np.interp(one.stamp * 1e-9, time, roll)))
        said.append(float(np.sqrt(engine.smoothed[0])))
    assert max(off) > 0.1
    parts = [error / sigma for error, sigma in zip(off, said, strict=True) if error > 1e-6]
    assert max(parts) < 3.2 and np.mean(np.array(parts) < 2.01) > 0.8, "but where one begins while another ends"
    assert max(said) < 3.2 * max(off) and said[-1] < 1e-9


def test_measured_states_are_as_they_are() -> None:
    engine = Identifier(from_mapping({"states": STATES, "effectors": ("da",), "sample_rate": RATE}))._regression
    assert isinstance(engine, BankRegression)
    assert not engine.smoothed.any()
