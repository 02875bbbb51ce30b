"""Median and range over flights."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Spread:
    """Median and range over the flights."""

    median: float
    low: float
    high: float

    def __str__(self) -> str:
        """Write it for people: median (range)."""
        if self.low == self.high:
            return f"{self.median:.3g}"
        return f"{self.median:.3g} ({self.low:.3g}-{self.high:.3g})"


def spread(values: Iterable[float]) -> Spread:
    """Return median and range."""
    found = np.array(list(values))
    return Spread(float(np.median(found)), float(found.min()), float(found.max()))
