"""How names, units and numbers are written, and the one mean that all figures share."""

from __future__ import annotations

import numpy as np

from msls_ros.report.recorded import Array

UNITS = {**dict.fromkeys(("u", "v", "w"), "m/s²"), **dict.fromkeys(("P", "Q", "R"), "rad/s²"),
         **dict.fromkeys(("Phi", "Theta", "Psi"), "rad/s")}  # fmt: skip
"""Units of the time derivatives."""
GREEK = {"Phi": "Φ", "Theta": "Θ", "Psi": "Ψ"}


def derivative(state: str) -> str:
    """Return how a time derivative is written."""
    return f"d{GREEK.get(state, state)}/dt"


def number(value: float, digits: int = 3) -> str:
    """Return a number as people write it: so many digits, a minus sign, no exponent where it can be helped."""
    if value != value:
        return "—"
    if value in (float("inf"), float("-inf")):
        return "∞"
    text = f"{value:.{digits}g}"
    if "e" in text and 1e-4 <= abs(value) < 1e5:
        whole = len(str(int(abs(value)))) if abs(value) >= 1.0 else 0
        text = f"{value:.{digits + 4 if whole == 0 else max(0, digits - whole)}f}"
    return text.replace("-", "−")


def causal_rms(values: Array, width: int) -> Array:
    """Return the rms (n,) of the length of vectors (n, c) over the last so many samples; fewer at the beginning."""
    square = np.concatenate(([0.0], np.cumsum(np.square(values).sum(axis=1))))
    ends = np.arange(1, len(square))
    starts = np.maximum(ends - width, 0)
    return np.asarray(np.sqrt((square[ends] - square[starts]) / (ends - starts)))
