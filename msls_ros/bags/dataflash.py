"""Logs of ArduPilot (DataFlash, .bin) as tables.

A record is ``A3 95 | type | fields``; records of the type FMT say of every type how long it is, how its fields are
called and of what kind each is. So a log describes itself, and a reader is a pass over the heads and one gather per
type. It is ours because pymavlink's reader is under the GPL and reads message by message; the tests hold it against
that reader.

References
----------
ArduPilot, `libraries/AP_Logger/LogStructure.h`: kinds of fields, FMT, FMTU.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from msls_ros.bags.errors import BagError
from msls_ros.bags.tables import FlightLog, Table

MAGIC = b"\xa3\x95\x80"
_HEAD = MAGIC[:2]
_FMT = 0x80
_FMT_RECORD = struct.Struct("<BB4s16s64s")
_FMT_LENGTH = 89
_KINDS: dict[str, tuple[str, float]] = {
    "b": ("i1", 1.0), "B": ("u1", 1.0), "h": ("<i2", 1.0), "H": ("<u2", 1.0), "i": ("<i4", 1.0), "I": ("<u4", 1.0),
    "f": ("<f4", 1.0), "d": ("<f8", 1.0), "g": ("<f2", 1.0), "q": ("<i8", 1.0), "Q": ("<u8", 1.0), "M": ("u1", 1.0),
    "c": ("<i2", 0.01), "C": ("<u2", 0.01), "e": ("<i4", 0.01), "E": ("<u4", 0.01), "L": ("<i4", 1e-7),
    "n": ("S4", 0.0), "N": ("S16", 0.0), "Z": ("S64", 0.0), "a": ("V64", 0.0),
}  # fmt: skip
"""Of each kind of field the numpy type and what a number is multiplied by; 0: a text."""
_INSTANCE = "#"
"""The unit of the field that counts instances."""


class _Format(NamedTuple):
    """How the records of a type look."""

    name: str
    length: int
    kinds: str
    columns: tuple[str, ...]

    @property
    def dtype(self) -> np.dtype[Any]:
        return np.dtype([(f"f{i}", _KINDS[kind][0]) for i, kind in enumerate(self.kinds)])


def read(path: Path) -> FlightLog:
    """Read a log; what lies between readable records is skipped and named.

    Parameters
    ----------
    path : Path
        The file.

    Raises
    ------
    BagError
        It cannot be read, or holds no record.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        msg = f"{path}: cannot be read: {error.strerror or error}"
        raise BagError(msg) from error
    formats, places, skipped = _scan(data)
    raw = np.frombuffer(data, np.uint8)
    found: dict[str, dict[str, NDArray[Any]]] = {}
    for kind, offsets in places.items():
        layout = formats[kind]
        if layout.dtype.itemsize != layout.length - 3:
            skipped += layout.length * len(offsets)
            continue
        starts = np.array(offsets, dtype=np.int64)[:, None] + np.arange(3, layout.length)
        rows = np.ascontiguousarray(raw[starts]).view(layout.dtype)[:, 0]
        found[layout.name] = {
            name: rows[f"f{i}"] * _KINDS[k][1] if _KINDS[k][1] not in (0.0, 1.0) else rows[f"f{i}"]
            for i, (name, k) in enumerate(zip(layout.columns, layout.kinds, strict=False))
        }
    if not found:
        msg = f"{path}: not a log of ArduPilot that can be read: no whole record"
        raise BagError(msg)
    instances = _instances(found.get("FMTU", {}), formats)
    warnings = [f"{path}: {skipped} bytes that are no record were skipped"] if skipped else []
    return FlightLog(path, _tables(found, instances), _parameters(found.get("PARM", {})), warnings)


def _scan(data: bytes) -> tuple[dict[int, _Format], dict[int, list[int]], int]:
    """Return the formats, where the records of each type begin, and how many bytes are no record."""
    formats = {_FMT: _Format("FMT", _FMT_LENGTH, "BBnNZ", ("Type", "Length", "Name", "Format", "Columns"))}
    places: dict[int, list[int]] = {}
    at = skipped = 0
    size = len(data)
    while at + 3 <= size:
        layout = formats.get(data[at + 2]) if data[at : at + 2] == _HEAD else None
        if layout is None:
            following = data.find(_HEAD, at + 1)
            following = size if following < 0 else following
            skipped += following - at
            at = following
            continue
        if at + layout.length > size:
            break
        if data[at + 2] == _FMT:
            _learn(formats, data[at + 3 : at + _FMT_LENGTH])
        places.setdefault(data[at + 2], []).append(at)
        at += layout.length
    return formats, {kind: starts for kind, starts in places.items() if kind != _FMT}, skipped


def _learn(formats: dict[int, _Format], record: bytes) -> None:
    """Take a record of the type FMT; a second one for a type changes nothing."""
    kind, length, name, kinds, columns = _FMT_RECORD.unpack(record)
    text = [part.split(b"\0")[0].decode("ascii", "replace") for part in (name, kinds, columns)]
    if kind not in formats and length > 3 and all(k in _KINDS for k in text[1]):
        formats[kind] = _Format(text[0], length, text[1], tuple(text[2].split(",")))


def _instances(units: dict[str, NDArray[Any]], formats: dict[int, _Format]) -> dict[str, str]:
    """Return the field that counts instances, by the name of the type."""
    found = {}
    for kind, ids in zip(units.get("FmtType", ()), units.get("UnitIds", ()), strict=True):
        place = bytes(ids).decode("ascii", "replace").find(_INSTANCE)
        layout = formats.get(int(kind))
        if layout is not None and 0 <= place < len(layout.columns):
            found[layout.name] = layout.columns[place]
    return found


def _tables(found: dict[str, dict[str, NDArray[Any]]], instances: dict[str, str]) -> dict[str, Table]:
    tables = {}
    for name, columns in found.items():
        clock = next((c for c in ("TimeUS", "TimeMS") if c in columns), None)
        if clock is None or not name.isalnum():
            continue
        stamps = columns[clock].astype(np.int64) * (1000 if clock == "TimeUS" else 1_000_000)
        numbers = {c: v for c, v in columns.items() if c.isidentifier() and v.dtype.kind not in "SV"}
        counter = columns.get(instances.get(name, ""))
        every = np.zeros(len(stamps), np.int64) if counter is None else counter.astype(np.int64)
        for instance in np.unique(every):
            which = every == instance
            topic = f"/{name}" if instance == every.min() else f"/{name}/{instance}"
            tables[topic] = Table(f"ardupilot/msg/{name}", stamps[which], {c: v[which] for c, v in numbers.items()})
    return tables


def _parameters(columns: dict[str, NDArray[Any]]) -> dict[str, float]:
    """Return the parameters; of one that changes the first value."""
    found: dict[str, float] = {}
    for name, value in zip(columns.get("Name", ()), columns.get("Value", ()), strict=True):
        found.setdefault(bytes(name).split(b"\0")[0].decode("ascii", "replace"), float(value))
    return found
