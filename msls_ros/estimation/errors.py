"""The one exception of this room."""

from __future__ import annotations


class EstimationError(ValueError):
    """Bad input or configuration: one sentence that says what was found and what was expected."""
