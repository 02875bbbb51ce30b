"""From messages to CDR and back, by the types of a `rosbags` store."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.serde import SerdeError
from rosbags.typesys.store import Typestore

from msls_ros.bags.definitions import Definitions
from msls_ros.bags.errors import BagError

MISFITS = (SerdeError, struct.error, AttributeError, TypeError, ValueError, OverflowError, AssertionError)

ALIGNED, GAP = 3, 8
"""Bytes by which messages may be too long: the first, and the second for each empty sequence of wide numbers."""


def serialize(definitions: Definitions, msgtype: str, message: Any) -> bytes:
    """Turn a message into CDR (little endian).

    Parameters
    ----------
    definitions : Definitions
        Where the type is found.
    msgtype : str
        `PKG/msg/NAME`.
    message : object or mapping
        A `rosbags` message, or a mapping of field names to values; a nested message is a mapping, too,
        and fields that are left out are zero or empty.

    Returns
    -------
    bytes
        With 4 bytes of encapsulation.

    Raises
    ------
    BagError
        No definition, or a field is unknown or does not fit its type.
    """
    definitions.require(msgtype)
    store = definitions.store
    value = _build(store, msgtype, message) if isinstance(message, Mapping) else message
    try:
        return bytes(store.serialize_cdr(value, msgtype, little_endian=True))
    except MISFITS as error:
        msg = f"{msgtype}: a field does not fit its type: {error}"
        raise BagError(msg) from error


def deserialize(store: Typestore, msgtype: str, cdr: bytes | memoryview) -> Any:
    """Turn CDR into a message.

    What `rclpy.serialization.serialize_message` gives may be longer than the message: its size is reckoned with a gap
    after the length of each empty sequence of numbers of 8 bytes, and the rest of the bytes is garbage. On the wire,
    and in what a recorder writes, it is not there.

    Parameters
    ----------
    store : rosbags.typesys.store.Typestore
        Holds the type.
    msgtype : str
        `PKG/msg/NAME`.
    cdr : bytes
        With 4 bytes of encapsulation.

    Returns
    -------
    object
        A `rosbags` message: a dataclass with numpy arrays.

    Raises
    ------
    BagError
        The bytes are not a message of this type.
    """
    try:
        return store.deserialize_cdr(cdr, msgtype)
    except (*MISFITS, IndexError, MemoryError) as error:
        padded = _padded(store, msgtype, cdr)
        if padded is not None:
            return padded
        msg = f"{msgtype}: {len(cdr)} bytes that are not a message of this type: {error}"
        raise BagError(msg) from error


def _padded(store: Typestore, msgtype: str, cdr: bytes | memoryview) -> Any:
    """Return the message in bytes that go on after it no further than `serialize_message` makes them; None: no such."""
    definition = store.get_msgdef(msgtype)
    if len(cdr) < 4 or bytes(cdr[:2]) not in (b"\x00\x00", b"\x00\x01"):
        return None
    read: Any = definition.deserialize_cdr_le if cdr[1] else definition.deserialize_cdr_be
    try:
        message, end = read(cdr[4:], 0, definition.cls, store)
        over = len(cdr) - 4 - end
        return message if 0 <= over <= ALIGNED + GAP * _empty(store, ("", (Nodetype.NAME, msgtype)), message) else None
    except (*MISFITS, IndexError, MemoryError):
        return None


def _empty(store: Typestore, field: tuple[str, Any], value: Any) -> int:
    """Return how many sequences of numbers of 8 bytes are empty in a field."""
    kind = field[1]
    if kind[0] == Nodetype.NAME:
        return sum(_empty(store, one, getattr(value, one[0])) for one in store.fielddefs[kind[1]][1])
    if kind[0] == Nodetype.BASE:
        return 0
    element = kind[1][0]
    if element[0] != Nodetype.BASE:
        return sum(_empty(store, ("", element), one) for one in value)
    wide = element[1][0] in ("float64", "int64", "uint64")
    return int(wide and kind[0] == Nodetype.SEQUENCE and len(value) == 0)


def _build(store: Typestore, msgtype: str, values: Mapping[str, Any]) -> Any:
    fields = store.fielddefs[msgtype][1]
    unknown = values.keys() - {name for name, _ in fields}
    if unknown:
        msg = f"{msgtype}: no field {min(unknown)!r}; expected {', '.join(name for name, _ in fields)}"
        raise BagError(msg)
    try:
        arguments = [_field(store, kind, values.get(name)) for name, kind in fields]
    except (TypeError, ValueError, OverflowError) as error:
        msg = f"{msgtype}: a field does not fit its type: {error}"
        raise BagError(msg) from error
    return store.types[msgtype](*arguments)


def _field(store: Typestore, kind: Any, value: Any) -> Any:
    """Give one field in the form that `rosbags` serialises; None stands for zero or empty."""
    if kind[0] == Nodetype.NAME:
        return _build(store, kind[1], value or {}) if value is None or isinstance(value, Mapping) else value
    if kind[0] == Nodetype.BASE:
        name = kind[1][0]
        if value is None:
            return "" if name == "string" else np.zeros((), _dtype(name)).item()
        return value
    element, length = kind[1]
    fixed = length if kind[0] == Nodetype.ARRAY else 0
    if element[0] == Nodetype.BASE and element[1][0] != "string":
        return np.ascontiguousarray(np.zeros(fixed) if value is None else value, dtype=_dtype(element[1][0]))
    items = [None] * fixed if value is None else list(value)
    return [_field(store, element, item) for item in items]


def _dtype(name: str) -> str:
    return {"byte": "uint8", "octet": "uint8", "char": "uint8"}.get(name, name)
