"""The parameter of the model that a flight is judged by: one entry of A or B."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msls_ros.plant import EFFECTORS, STATES

ROWS = STATES[:6]
"""Equations with something to identify; those of the Euler angles are kinematics."""


@dataclass(frozen=True)
class Watch:
    """One entry of A or B: the equation of a state, and a state or an effector."""

    row: str
    column: str
    effectors: tuple[str, ...] = EFFECTORS
    """Of the aircraft."""

    def __str__(self) -> str:
        """Write it as a scenario has it: ``P/ddt``."""
        return f"{self.row}/{self.column}"

    @property
    def in_b(self) -> bool:
        """Whether it is of B."""
        return self.column in self.effectors

    @property
    def place(self) -> tuple[int, int]:
        """Row and column in its matrix, from 0."""
        return STATES.index(self.row), (self.effectors if self.in_b else STATES).index(self.column)

    @property
    def symbol(self) -> str:
        """As the paper calls it, counting from 1: ``b43`` is P/ddt, ``a43`` P/w."""
        i, j = self.place
        return f"{'b' if self.in_b else 'a'}{i + 1}{j + 1}"

    @property
    def derivative(self) -> str:
        """What it is: ``dPdot/d ddt``."""
        return f"d{self.row}dot/d {self.column}"

    @property
    def unit(self) -> str:
        """Of the parameter."""
        over = "1" if self.row in "PQR" else "m"
        if self.column in ("u", "v", "w"):
            return {"1": "rad/(m s)", "m": "1/s"}[over]
        power = "s" if self.column in ("P", "Q", "R") else "s²"
        return f"{over}/{power}"

    def of(self, a: Any, b: Any) -> NDArray[np.float64]:
        """Return the entry of matrices (..., 9, 9) and (..., 9, m): (...)."""
        found: NDArray[np.float64] = np.asarray(b if self.in_b else a)[(..., *self.place)]
        return found


ROLL_POWER = Watch("P", "ddt")
"""b43, that the paper follows in Fig 9."""
