"""Decodes the two messages of every sample, five times as fast as a general deserialiser.

`StateSample`, `EffectorSample` and `EffectorCommand` of one source differ only in stamp and numbers: same frame,
same names, same lengths. So the layout is parsed once, and of every further message all other bytes
are compared with it::

    00 01 .. .. | stamp (8) | frame_id, names, count | x: n doubles | count, pad | xdot: n doubles        (CDR)
      the same      read          the same                 read        the same          read

A message that differs is parsed in full, and is the new layout. Padding is garbage in CDR: it is masked
wherever a plain comparison fails.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from msls_ros.bags.errors import BagError
from msls_ros.bags.serde import ALIGNED, GAP

_SEQUENCES = {
    "msls_msgs/msg/StateSample": 2,
    "msls_msgs/msg/EffectorSample": 1,
    "msls_msgs/msg/EffectorCommand": 1,
}
_ENCAPSULATION = 4
_CONSTANT_FROM = 12
_NANOSECONDS = 1_000_000_000


class Sample(NamedTuple):
    """A decoded sample.

    Attributes
    ----------
    stamp_ns : int
        Instant of validity, from the header [ns].
    names : tuple of str
        Of states or effectors, in the order of `values`; the same object as long as the layout is the same.
    values : ndarray, shape (n,)
        States [m/s, rad/s, rad] or deflections [rad].
    rates : ndarray, shape (n,), or None
        Time derivatives of the states [per second]; None: not measured.
    """

    stamp_ns: int
    names: tuple[str, ...]
    values: NDArray[np.float64]
    rates: NDArray[np.float64] | None


class SampleBlock(NamedTuple):
    """Decoded samples of one layout; k samples, n values.

    Attributes
    ----------
    stamps_ns : ndarray of int64, shape (k,)
        Instants of validity [ns].
    names : tuple of str
        As in `Sample`.
    values : ndarray, shape (k, n)
        As in `Sample`.
    rates : ndarray, shape (k, n), or None
        As in `Sample`.
    """

    stamps_ns: NDArray[np.int64]
    names: tuple[str, ...]
    values: NDArray[np.float64]
    rates: NDArray[np.float64] | None

    def samples(self) -> list[Sample]:
        """Return the samples one by one; their arrays are rows of the block's."""
        rates = list(self.rates) if self.rates is not None else [None] * len(self.values)
        return [
            Sample(stamp, self.names, values, own)
            for stamp, values, own in zip(self.stamps_ns.tolist(), self.values, rates, strict=True)
        ]


@dataclass(frozen=True)
class _Layout:
    """Where things stand in the messages of one source, and the bytes that do not change [all in bytes].

    `numbers` doubles begin at `start`: `count` values, the bytes `stop` to `rates_start`, then `rates` rates.
    """

    size: int
    little: int
    stamp: struct.Struct
    dtype: np.dtype[np.float64]
    names: tuple[str, ...]
    start: int
    numbers: int
    count: int
    rates: int
    stop: int
    rates_start: int
    head: bytes
    middle: bytes
    mask: int
    constant: NDArray[np.intp]
    """The bytes that are equal in all messages."""

    def fits(self, cdr: bytes) -> bool:
        """Whether a message has this layout: equal in all bytes but stamp, numbers and padding."""
        if len(cdr) != self.size or cdr[1] != self.little or cdr[0] != 0:
            return False
        head, middle = cdr[_CONSTANT_FROM : self.start], cdr[self.stop : self.rates_start]
        if head == self.head and middle == self.middle:
            return True
        difference = int.from_bytes(head + middle, "big") ^ int.from_bytes(self.head + self.middle, "big")
        return difference & self.mask == 0


class SampleDecoder:
    """Decoder of the messages of one topic.

    Parameters
    ----------
    msgtype : str
        `msls_msgs/msg/StateSample`, `.../EffectorSample` or `.../EffectorCommand`.

    Raises
    ------
    BagError
        Another type.
    """

    def __init__(self, msgtype: str) -> None:
        if msgtype not in _SEQUENCES:
            msg = f"{msgtype}: not a sample; expected one of {', '.join(_SEQUENCES)}"
            raise BagError(msg)
        self.msgtype = msgtype
        self._sequences = _SEQUENCES[msgtype]
        self._layout: _Layout | None = None

    def decode(self, cdr: bytes) -> Sample:
        """Decode a message.

        Parameters
        ----------
        cdr : bytes
            With 4 bytes of encapsulation.

        Returns
        -------
        Sample
            With arrays of its own: aligned and writable.

        Raises
        ------
        BagError
            The bytes are not a message of this type.
        """
        layout = self._layout
        if layout is None or not layout.fits(cdr):
            layout = self._layout = self._parse(cdr)
        seconds, nanoseconds = layout.stamp.unpack_from(cdr, _ENCAPSULATION)
        numbers = np.frombuffer(cdr, layout.dtype, layout.numbers, layout.start).astype(np.float64)
        rates = numbers[layout.numbers - layout.rates :] if layout.rates else None
        return _new(Sample, (seconds * _NANOSECONDS + nanoseconds, layout.names, numbers[: layout.count], rates))

    def decode_block(self, cdrs: Sequence[bytes]) -> SampleBlock | None:
        """Decode many messages at once: a tenth of the price.

        Parameters
        ----------
        cdrs : sequence of bytes
            Not empty.

        Returns
        -------
        SampleBlock or None
            None where the messages differ in layout, or one is none of this type; `decode` them one by one then.
        """
        layout = self._layout
        if layout is None or not layout.fits(cdrs[0]):
            try:
                layout = self._layout = self._parse(cdrs[0])
            except BagError:
                return None
        joined = b"".join(cdrs)
        if len(joined) != layout.size * len(cdrs) or any(len(cdr) != layout.size for cdr in cdrs):
            return None
        rows = np.frombuffer(joined, np.uint8).reshape(len(cdrs), layout.size)
        if (rows[:, layout.constant] != rows[0, layout.constant]).any():
            return None
        stamps = _columns(rows, _ENCAPSULATION, 8, "i4" if layout.little else ">i4")
        nanoseconds = _columns(rows, _ENCAPSULATION + 4, 4, "u4" if layout.little else ">u4")
        numbers = _columns(rows, layout.start, 8 * layout.numbers, layout.dtype).astype(np.float64, copy=False)
        return SampleBlock(
            stamps[:, 0].astype(np.int64) * _NANOSECONDS + nanoseconds[:, 0],
            layout.names,
            numbers[:, : layout.count],
            numbers[:, layout.numbers - layout.rates :] if layout.rates else None,
        )

    def _parse(self, cdr: bytes) -> _Layout:
        try:
            return _parse(bytes(cdr), self._sequences)
        except (struct.error, ValueError) as error:
            msg = f"{self.msgtype}: {len(cdr)} bytes that are not a message of this type: {error}"
            raise BagError(msg) from error


_new = tuple.__new__


def _columns(rows: NDArray[np.uint8], start: int, size: int, dtype: Any) -> NDArray[Any]:
    """Return a range of the bytes of every row as numbers."""
    return np.ascontiguousarray(rows[:, start : start + size]).view(dtype)


class _Cursor:
    """Reads CDR from the front to the back and notes which bytes are padding."""

    def __init__(self, cdr: bytes) -> None:
        if len(cdr) < _CONSTANT_FROM or cdr[0] != 0 or cdr[1] > 1:
            what = "no plain CDR"
            raise ValueError(what)
        self.order = "<" if cdr[1] else ">"
        self.cdr = cdr
        self.position = _CONSTANT_FROM
        self.padding: list[int] = []

    def align(self, size: int) -> None:
        """Move to a multiple of `size` behind the encapsulation."""
        gap = -(self.position - _ENCAPSULATION) % size
        self.padding += range(self.position, self.position + gap)
        self.position += gap

    def length(self, element: int) -> int:
        """Read the number of elements of at least that many bytes each."""
        self.align(4)
        (count,) = struct.unpack_from(f"{self.order}I", self.cdr, self.position)
        self.position += 4
        if count * element > len(self.cdr) - self.position:
            what = f"a length of {count} at byte {self.position - 4}"
            raise ValueError(what)
        return int(count)

    def text(self) -> str:
        """Read a string."""
        size = self.length(1)
        start = self.position
        self.position += size
        if size and self.cdr[self.position - 1] != 0:
            what = f"a text at byte {start} that does not end"
            raise ValueError(what)
        return self.cdr[start : start + max(0, size - 1)].decode()

    def doubles(self) -> tuple[int, int]:
        """Pass over a sequence of numbers; give where it starts and how many they are."""
        count = self.length(8)
        if count:
            self.align(8)
        start = self.position
        self.position += 8 * count
        if self.position > len(self.cdr):
            what = f"{count} numbers at byte {start}"
            raise ValueError(what)
        return start, count


def _parse(cdr: bytes, sequences: int) -> _Layout:
    cursor = _Cursor(cdr)
    cursor.text()
    names = tuple(cursor.text() for _ in range(cursor.length(5)))
    start, count = cursor.doubles()
    stop = cursor.position
    rates_start, rates = cursor.doubles() if sequences == 2 else (stop, 0)
    if count == 0:
        start = stop = rates_start
    empty = (count == 0) + (sequences == 2 and rates == 0)
    if not 0 <= len(cdr) - cursor.position <= ALIGNED + GAP * empty:
        what = f"{len(cdr) - cursor.position} bytes left over"
        raise ValueError(what)
    constant = [*range(_CONSTANT_FROM, start), *range(stop, rates_start)]
    padding = frozenset(cursor.padding)
    mask = bytes(0 if place in padding else 0xFF for place in constant)
    between = (rates_start - stop) // 8 if rates and count else 0
    return _Layout(
        size=len(cdr),
        little=cdr[1],
        stamp=struct.Struct(f"{cursor.order}iI"),
        dtype=np.dtype(f"{cursor.order}f8"),
        names=names,
        start=start,
        numbers=count + between + rates,
        count=count,
        rates=rates,
        stop=stop,
        rates_start=rates_start,
        head=cdr[_CONSTANT_FROM:start],
        middle=cdr[stop:rates_start],
        mask=int.from_bytes(mask, "big"),
        constant=np.array([0, 1, *(place for place in constant if place not in padding)], dtype=np.intp),
    )
