"""What this room raises for bad input."""

from __future__ import annotations


class ControlError(ValueError):
    """The control law was given what it cannot use: one sentence, what was found and what was expected."""
