"""A clock that is set by hand, and samples of an aircraft that is none."""

from __future__ import annotations

from typing import Any

import numpy as np


class Clockwork:
    """A clock that is set by hand."""

    def __init__(self) -> None:
        self.nanoseconds = 0

    def now(self) -> Clockwork:
        return self

    def __call__(self) -> int:
        return self.nanoseconds


def linear_samples(count: int, seed: int = 0) -> tuple[Any, Any, Any]:
    """Return x (count, 9), xdot (count, 9), delta (count, 7) of a made-up linear aircraft about high alpha."""
    random = np.random.default_rng(seed)
    trim = np.array([57.0, 0.0, 45.0, 0.0, 0.0, 0.0, 0.0, 0.3, 0.0])
    x = trim + random.normal(size=(count, 9)) * ([1.0] * 3 + [0.05] * 6)
    delta = random.normal(size=(count, 7)) * 0.05
    a, b = random.normal(size=(9, 9)), random.normal(size=(9, 7))
    xdot = (x - trim) @ a.T * 0.1 + delta @ b.T + random.normal(size=(count, 9)) * 1e-3
    return x, xdot, delta
