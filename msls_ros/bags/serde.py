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
        msg = f"{msgtype}: {len(cdr)} bytes that are not a message of this type: {error}"
        raise BagError(msg) from error


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
