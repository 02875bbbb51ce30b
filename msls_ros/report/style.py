"""How names, units and numbers are written, and the one mean that all figures share."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from msls_ros.report.recorded import Array

UNITS = {**dict.fromkeys(("u", "v", "w"), "m/s²"), **dict.fromkeys(("P", "Q", "R"), "rad/s²"),
         **dict.fromkeys(("Phi", "Theta", "Psi"), "rad/s")}  # fmt: skip
"""Units of the time derivatives."""
_SPEEDS = ("u", "v", "w")
_ANGLES = ("Phi", "Theta", "Psi")
GREEK = {"Phi": "Φ", "Theta": "Θ", "Psi": "Ψ"}


def derivative(state: str) -> str:
    """Return how a time derivative is written."""
    return f"d{GREEK.get(state, state)}/dt"


def derivative_unit(row: str, column: str, effectors: Sequence[str] = ()) -> str:
    """Return the unit of d(row)/dt by a state or an effector, the radian as 1; empty: not known.

    Parameters
    ----------
    row, column
        Names.
    effectors
        Those that are deflections [rad].
    """
    power = {**dict.fromkeys(_SPEEDS, (1, -2)), **dict.fromkeys(("P", "Q", "R"), (0, -2)),
             **dict.fromkeys(_ANGLES, (0, -1))}  # fmt: skip
    by = {**dict.fromkeys(_SPEEDS, (1, -1)), **dict.fromkeys(("P", "Q", "R"), (0, -1)),
          **dict.fromkeys((*_ANGLES, *effectors), (0, 0))}  # fmt: skip
    if row not in power or column not in by:
        return ""
    metres, seconds = (a - b for a, b in zip(power[row], by[column], strict=True))
    parts = [(unit + ("²" if abs(n) == 2 else ""), n) for unit, n in (("m", metres), ("s", seconds)) if n]
    above = " ".join(unit for unit, n in parts if n > 0) or "1"
    below = " ".join(unit for unit, n in parts if n < 0)
    return above + (f"/({below})" if " " in below else f"/{below}" if below else "")


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
