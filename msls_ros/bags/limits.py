"""What a read may hold: one budget, and the sizes that a file declares are respected.

A few kilobytes may unpack to terabytes, and a length of eight bytes may ask for any memory. So a chunk, a record, a
message or a copy in the temporary folder that is larger than the budget is left out, with a sentence; and what all of
a file unpacks to is bounded by a multiple of its size.
"""

from __future__ import annotations

from typing import BinaryIO

HELD = 1 << 30
"""What a read holds at most, unless told otherwise [bytes]."""
RATIO = 1000
"""Times its size that a file larger than the budget may unpack to; recorded flights: 2 to 10."""
PIECE = 1 << 22
"""Serialised messages that are handed on at a time [bytes]."""


class TooLargeError(Exception):
    """Something is larger than a read may hold."""


def size_text(size: int) -> str:
    """Write a number of bytes for people.

    Parameters
    ----------
    size : int
        From 0 [bytes].

    Returns
    -------
    str
        In the largest unit that it fills.
    """
    for shift, unit in ((40, "TiB"), (30, "GiB"), (20, "MiB"), (10, "KiB")):
        if size >> shift:
            return f"{size / (1 << shift):.3g} {unit}"
    return f"{size} bytes"


def check_held(what: str, size: int, held: int) -> None:
    """Refuse what would not fit the budget.

    Parameters
    ----------
    what : str
        For the sentence.
    size : int
        What it would hold [bytes].
    held : int
        The budget [bytes].

    Raises
    ------
    TooLargeError
        It is larger.
    """
    if size > held:
        msg = f"{what} of {size_text(size)}; expected at most {size_text(held)}, what a read may hold"
        raise TooLargeError(msg)


class Expansion:
    """Counts what a file unpacks to.

    Parameters
    ----------
    size : int
        Of the file [bytes].
    held : int
        The budget [bytes].
    """

    def __init__(self, size: int, held: int) -> None:
        self._size = size
        self._most = max(held, RATIO * size)
        self._sum = 0

    def add(self, count: int) -> None:
        """Count bytes.

        Parameters
        ----------
        count : int
            Further ones [bytes].

        Raises
        ------
        TooLargeError
            They are more than any recorded flight unpacks to.
        """
        self._sum += count
        if self._sum > self._most:
            msg = (
                f"its {size_text(self._size)} unpack to more than {size_text(self._most)}; "
                f"expected at most {RATIO} times its size"
            )
            raise TooLargeError(msg)


class CountedStream:
    """A stream that is read, and counted, no further than a file may unpack to.

    Parameters
    ----------
    stream : BinaryIO
        What is unpacked.
    expansion : Expansion
        Counts.
    """

    def __init__(self, stream: BinaryIO, expansion: Expansion) -> None:
        self._stream, self._expansion = stream, expansion

    def read(self, count: int) -> bytes:
        """Read.

        Parameters
        ----------
        count : int
            How much at most [bytes].

        Returns
        -------
        bytes
            Fewer at the end.

        Raises
        ------
        TooLargeError
            More has been unpacked than may be.
        """
        data = self._stream.read(count)
        self._expansion.add(len(data))
        return data

    def close(self) -> None:
        """Close the stream."""
        self._stream.close()
