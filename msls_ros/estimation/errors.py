"""The one exception of this room."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches


class EstimationError(ValueError):
    """Bad input or configuration: one sentence that says what was found and what was expected."""


def nearest(word: str, words: Iterable[str]) -> str:
    """Return the end of a sentence that suggests the word which was probably meant; empty: none is near."""
    found = get_close_matches(word, list(words), 1, 0.6)
    return f"; did you mean '{found[0]}'?" if found else ""
