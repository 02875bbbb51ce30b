"""Which surfaces make which effectors: what the profile says, and the effect that each surface has by itself.

``isolation.surfaces`` reads ``left_stabilator: de + ddt; right_stabilator: de - ddt; rudder: dr``: the position of each
surface as a sum of effectors, M (surfaces, effectors). A row b of B is then the sum of what its surfaces do,
``b = c M`` with ``c = b M^+`` where M tells the surfaces apart, and a surface that keeps a share s of it changes b by
``(s - 1) c_k M_k``: all its effectors together, in one direction that is known before anything breaks.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from operator import mul

from msls_ros.estimation.errors import EstimationError

SINGULAR = 1e-9
_TERM = re.compile(r"([+-]?)\s*(?:(\d+(?:\.\d+)?)\s*\*\s*)?([^\s+*;:-]+)\s*")


@dataclass(frozen=True)
class Surface:
    """What can be lost: a surface, or an effector where the profile names no surfaces; m effectors."""

    name: str
    gains: tuple[float, ...]
    """(m,) its position by each effector [1]."""
    shares: tuple[float, ...]
    """(m,) its effect by those of the effectors [1]."""


def read_surfaces(text: str, effectors: tuple[str, ...]) -> tuple[Surface, ...]:
    """Read what the profile says of the surfaces.

    Parameters
    ----------
    text
        See the module; empty: each effector is a surface of its own.
    effectors
        Their names.

    Raises
    ------
    EstimationError
        For what cannot be read, or surfaces that the effectors do not tell apart.
    """
    if not text.strip():
        unit = [tuple(float(name == other) for other in effectors) for name in effectors]
        return tuple(Surface(name, row, row) for name, row in zip(effectors, unit, strict=True))
    names, rows = [], []
    for part in text.split(";"):
        name, colon, terms = (piece.strip() for piece in part.partition(":"))
        if not name or not colon or not terms:
            message = f"isolation.surfaces: '{part.strip()}'; expected a surface and its effectors, as 'left: de + ddt'"
            raise EstimationError(message)
        names.append(name)
        rows.append(_read_terms(terms, effectors))
    inverse = _inverse([[math.fsum(map(mul, one, other)) for other in rows] for one in rows])
    if len(set(names)) < len(names) or inverse is None:
        message = (
            f"isolation.surfaces: {', '.join(names)}; expected surfaces that differ, each moved in a way of its own"
        )
        raise EstimationError(message)
    shares = [[math.fsum(map(mul, column, line)) for column in zip(*rows, strict=True)] for line in inverse]
    return tuple(Surface(name, tuple(row), tuple(of)) for name, row, of in zip(names, rows, shares, strict=True))


def _inverse(matrix: list[list[float]]) -> list[list[float]] | None:
    """Invert by elimination, in one fixed order of operations; None where a pivot is nothing."""
    k = len(matrix)
    work = [[*row, *(float(i == j) for j in range(k))] for i, row in enumerate(matrix)]
    for i in range(k):
        if abs(work[i][i]) < SINGULAR:
            return None
        work[i] = [value / work[i][i] for value in work[i]]
        for j in range(k):
            if j != i:
                work[j] = [value - work[j][i] * own for value, own in zip(work[j], work[i], strict=True)]
    return [row[k:] for row in work]


def _read_terms(terms: str, effectors: tuple[str, ...]) -> list[float]:
    row, at = [0.0] * len(effectors), 0
    while at < len(terms):
        found = _TERM.match(terms, at)
        if found is None or found[3] not in effectors or (at > 0 and not found[1]):
            message = f"isolation.surfaces: '{terms}'; expected a sum of {', '.join(effectors)}"
            raise EstimationError(message)
        row[effectors.index(found[3])] += float(found[2] or 1.0) * (-1.0 if found[1] == "-" else 1.0)
        at = found.end()
    return row
