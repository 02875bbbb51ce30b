"""What an inspection says of a log and its map: what was found, how bad it is, what to change."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

WRONG, DOUBTFUL, NOTE = "wrong", "doubtful", "note"
LEVELS = (WRONG, DOUBTFUL, NOTE)
"""How bad, the worst first: numbers would be wrong; numbers may be worse than need be; good to know."""
OF_THE_FLIGHT = frozenset({"gaps", "excitation", "saturation", "repeats", "servo_rate", "servo_lag", "dependent"})
"""Kinds whose change is one of the next flight or its recorder: no map mends this log."""


@dataclass(frozen=True)
class Finding:
    """One thing that an inspection found."""

    level: str
    """One of `LEVELS`."""
    kind: str
    """One word for programs: rate, gaps, units, sign, frame, delay, ..."""
    where: str
    """Entry of the map, topic or effector."""
    what: str
    """A sentence: what was found."""
    change: str = ""
    """A sentence: what to change; empty: nothing."""

    def sentence(self) -> str:
        """Return it as one line."""
        return f"{self.where}: {self.what}" + (f" -> {self.change}" if self.change else "")


def delay_words(change: float, now: float | None, line: str) -> str:
    """Return by how much to change a delay, and what to write.

    Parameters
    ----------
    change
        Of the delay [s].
    now
        What the map says [s]; None: its lines say different things.
    line
        Where it stands.
    """
    words = f"delay {'larger' if change > 0.0 else 'smaller'} by {abs(change):.3f} s in {line}"
    return words if now is None else f"{words}: delay={round(now + change, 3) + 0.0:.3f}"


def ordered(findings: Iterable[Finding]) -> list[Finding]:
    """Return findings, the worst first, each once."""
    return sorted(dict.fromkeys(findings), key=lambda f: LEVELS.index(f.level))
