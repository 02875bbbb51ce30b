"""The numbers are the same to the last bit on every machine and Python: their hash is pinned here.

A change of the arithmetic changes the hash, and with it what a bag replays to: say so in the commit that pins another.
"""

from __future__ import annotations

import hashlib

import numpy as np
import pytest

from msls_ros.estimation import Identifier, from_mapping

PINNED = {
    "normalised": ("14b7a263942872c7205b0738ff8401df", "dd26d55cc2b6ded8d2caa6c838d30d60"),
    "worst_case": ("14b7a263942872c7205b0738ff8401df", "d4618047d6eb4d18bf90947106fa827d"),
    "ratio": ("f5965705f1f3ec7fd055c203b1c2644d", "0ab9655c0d9969b8498cfb743d1297f3"),
    "gusts": ("3780cc97695097f23aff51bc7a184969", "1d82f227bb1409c3a53659a68c8f520a"),
    "bent": ("728f96e6ee14618dc4d27d9d3c54007c", "28cb41048918df8eeead3b170fb9669f"),
    "rls": ("9b46f58a0aa36fc4d0a994d4bb10fb77", "97b1bd193ff975f95b1fa93224d5d5d4"),
    "solve_only": ("ffd82c870bed4ed9570384a23c5a13b2", "c470c18f1034667bfe50bf64a7fc4a26"),
}
"""Of the estimates, and of the dither."""
CHANGES: dict[str, dict[str, object]] = {
    "normalised": {},
    "worst_case": {"dither.acceleration": "worst_case", "dither.allocation": "equal"},
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
    digest, dither = hashlib.sha256(), hashlib.sha256()
    identifier = Identifier(from_mapping({"estimator.method": "msls", **CHANGES[name]}))
    m = len(identifier.configuration.states)
    for estimate in identifier.run(np.arange(n) / 64.0, x[:, :m], xdot[:, :m], delta).estimates:
        fields = (estimate.a, estimate.b, estimate.bias, estimate.a_std, estimate.b_std, estimate.excitation)
        for array in (*fields, estimate.statistic):
            digest.update(np.ascontiguousarray(array + 0.0).tobytes())
        dither.update(np.ascontiguousarray(estimate.dither.delta + 0.0).tobytes())
    assert (digest.hexdigest()[:32], dither.hexdigest()[:32]) == PINNED[name]
