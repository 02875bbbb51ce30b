"""The numbers are the same to the last bit on every machine and Python: their hash is pinned here.

A change of the arithmetic changes the hash, and with it what a bag replays to: say so in the commit that pins another.
"""

from __future__ import annotations

import hashlib

import numpy as np
import pytest

from msls_ros.estimation import Identifier, from_mapping

PINNED = {
    "normalised": "37579ae36e373d4ebc27815a2ef59502",
    "ratio": "44955ed6c6be99f037bb9a4338798b6b",
    "bent": "e99b34695fe602e1b3e878bb8c21d877",
    "gusts": "2aeb2fcd4c069728eb8f37db8a5c03e5",
    "rls": "dc33c965ce21ed0c6f674c7c511176d8",
    "solve_only": "eab6565bc661e2b174ba324fbd17fc88",
}
CHANGES: dict[str, dict[str, object]] = {
    "normalised": {},
    "ratio": {"detector.mode": "ratio", "detector.window": 50, "detector.threshold": 3.5},
    "gusts": {"reliability.confounding_effectors": 0.75},
    "bent": {"states": ["P", "Q", "R"], "known_gravity": False, "estimator.penalty": 0.01},
    "rls": {"estimator.method": "rls"},
    "solve_only": {"estimator.penalty_retained": False, "estimator.scale": "auto", "known_gravity": False},
}


def uniform(n: int, width: int, seed: int) -> np.ndarray:
    """Numbers in [-1, 1) from the raw stream of a generator: exact, so equal on every machine."""
    raw = np.random.PCG64(seed).random_raw(n * width) >> np.uint64(11)
    return (raw.astype(np.float64) * 2.0**-52 - 1.0).reshape(n, width)


@pytest.mark.parametrize("name", list(PINNED))
def test_the_bits_are_the_pinned_ones(name: str) -> None:
    n = 300
    x, xdot, delta = uniform(n, 9, 1), uniform(n, 9, 2), 0.125 * uniform(n, 7, 3)
    if name in ("gusts", "bent"):
        x, xdot = np.cumsum(x, axis=0) / 4.0, np.cumsum(xdot, axis=0)
    xdot[150:] += 0.5 * x[150:, ::-1]
    digest = hashlib.sha256()
    identifier = Identifier(from_mapping(CHANGES[name]))
    m = len(identifier.configuration.states)
    for estimate in identifier.run(np.arange(n) / 64.0, x[:, :m], xdot[:, :m], delta).estimates:
        fields = (estimate.a, estimate.b, estimate.bias, estimate.a_std, estimate.b_std, estimate.excitation)
        for array in (*fields, estimate.statistic, estimate.dither.delta):
            digest.update(np.ascontiguousarray(array + 0.0).tobytes())
    assert digest.hexdigest()[:32] == PINNED[name]
