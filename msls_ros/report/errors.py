"""The one exception of this room."""

from __future__ import annotations


class ReportError(ValueError):
    """Nothing can be drawn of this; the sentence says what was found and what was expected."""
