"""Serialises many messages that differ in numbers only: one array, whose rows are messages.

Texts and lengths of sequences fix where everything stands in CDR. So a first message is serialised in full, and in its
bytes the place of every number is looked up; further messages are copies of it with other numbers::

    template = MessageTemplate("msls_msgs/msg/EffectorSample", first, definitions)
    rows = template.rows(1000)
    rows["header.stamp.sec"] = ...      # (1000,)
    rows["delta"] = ...                 # (1000, 7)
    writer.write_blocks([(topic, stamps, template.cdr(rows))])
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Nodetype
from rosbags.typesys.store import Typestore

from msls_ros.bags.definitions import Definitions, default_definitions
from msls_ros.bags.errors import BagError
from msls_ros.bags.serde import serialize

_ENCAPSULATION = 4


class MessageTemplate:
    """The layout of one message.

    Parameters
    ----------
    msgtype : str
        `PKG/msg/NAME`.
    message : mapping
        Its fields; texts and lengths are those of all messages to come.
    definitions : Definitions, optional
        Where the type is found.

    Attributes
    ----------
    dtype : numpy.dtype
        A field per number or sequence of numbers, named by its path (`header.stamp.sec`), at its place in the bytes.

    Raises
    ------
    BagError
        No definition, a field is unknown or does not fit its type, or the message holds no number.
    """

    def __init__(self, msgtype: str, message: Mapping[str, Any], definitions: Definitions | None = None) -> None:
        definitions = definitions or default_definitions()
        self._cdr = serialize(definitions, msgtype, message)
        walk = _Walk(definitions.store, self._cdr)
        walk.message(msgtype, "")
        if not 0 <= len(self._cdr) - walk.position < 4:
            msg = f"{msgtype}: {len(self._cdr) - walk.position} bytes of its CDR are in no field"
            raise BagError(msg)
        if not walk.found:
            msg = f"{msgtype}: no number in this message that could differ"
            raise BagError(msg)
        names, formats, offsets = zip(*walk.found, strict=True)
        spec: Any = {"names": names, "formats": formats, "offsets": offsets, "itemsize": len(self._cdr)}
        self.dtype: np.dtype[np.void] = np.dtype(spec)

    def rows(self, count: int) -> NDArray[np.void]:
        """Return as many copies of the message, their numbers to be filled in by name."""
        return np.frombuffer(bytearray(self._cdr) * count, self.dtype)

    @staticmethod
    def cdr(rows: NDArray[np.void]) -> NDArray[np.uint8]:
        """Return rows as bytes, shape (n, size), for `BagWriter.write_blocks`."""
        return rows.view(np.uint8).reshape(len(rows), -1)


class _Walk:
    """Passes over a message in CDR (little endian) and notes where its numbers stand."""

    def __init__(self, store: Typestore, cdr: bytes) -> None:
        self._store, self._cdr = store, cdr
        self.position = _ENCAPSULATION
        self.found: list[tuple[str, Any, int]] = []

    def message(self, msgtype: str, prefix: str) -> None:
        for name, kind in self._store.fielddefs[msgtype][1]:
            self._field(kind, f"{prefix}{name}")

    def _field(self, kind: Any, name: str) -> None:
        if kind[0] == Nodetype.NAME:
            self.message(kind[1], f"{name}.")
        elif kind[0] == Nodetype.BASE:
            self._values(kind, name, None)
        else:
            element, length = kind[1]
            self._values(element, name, self._length() if kind[0] == Nodetype.SEQUENCE else length)

    def _values(self, kind: Any, name: str, count: int | None) -> None:
        """Pass over a value, or over `count` of them in a row."""
        if kind[0] == Nodetype.NAME or kind[1][0] == "string":
            for i in range(1 if count is None else count):
                if kind[0] == Nodetype.NAME:
                    self.message(kind[1], f"{name}[{i}].")
                else:
                    size = self._length()
                    self.position += size
            return
        if count == 0:
            return
        dtype = np.dtype({"byte": "uint8", "octet": "uint8", "char": "uint8"}.get(kind[1][0], kind[1][0]))
        self._align(dtype.itemsize)
        self.found.append((name, dtype.newbyteorder("<") if count is None else (dtype, (count,)), self.position))
        self.position += dtype.itemsize * (1 if count is None else count)

    def _align(self, size: int) -> None:
        self.position += -(self.position - _ENCAPSULATION) % size

    def _length(self) -> int:
        self._align(4)
        self.position += 4
        return int.from_bytes(self._cdr[self.position - 4 : self.position], "little")
