"""The one exception of this room, and how names that come from a bag are shown."""

from __future__ import annotations


class BagError(Exception):
    """A bag, or a message definition, cannot be used as asked.

    The sentence names the file, and where it applies the topic and the field, what was found
    and what was expected. Damage inside a readable bag is not an error: it is a line in
    `BagReader.warnings`.
    """

    def __init__(self, sentence: str) -> None:
        super().__init__(one_line(sentence))


def one_line(text: str) -> str:
    """Escape what would break a line or steer a terminal: names come from the bag.

    Parameters
    ----------
    text : str
        Any.

    Returns
    -------
    str
        Printable.
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)
