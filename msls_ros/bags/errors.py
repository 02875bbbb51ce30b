"""The one exception of this room."""

from __future__ import annotations


class BagError(Exception):
    """A bag, or a message definition, cannot be used as asked.

    The sentence names the file, and where it applies the topic and the field, what was found
    and what was expected. Damage inside a readable bag is not an error: it is a line in
    `BagReader.warnings`.
    """
