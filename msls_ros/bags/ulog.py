"""Logs of PX4 (ULog, .ulg) as tables, read with PX4's own pyulog."""

from __future__ import annotations

import contextlib
import io
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msls_ros.bags.errors import BagError
from msls_ros.bags.tables import FlightLog, Table

MAGIC = b"ULog\x01\x12\x35"
_ELEMENT = re.compile(r"(\w+)\[(\d+)\]")


def read(path: Path) -> FlightLog:
    """Read a log.

    Parameters
    ----------
    path : Path
        The file.

    Raises
    ------
    BagError
        pyulog is missing, or finds nothing in the file.
    """
    try:
        from pyulog import ULog
    except ImportError as error:
        msg = f"{path}: a log of PX4 needs the package pyulog: pip install pyulog"
        raise BagError(msg) from error
    said = io.StringIO()
    try:
        with contextlib.redirect_stdout(said):  # it prints what it cannot read
            log = ULog(str(path))
    except Exception as error:  # damaged logs make it fail in many ways
        msg = f"{path}: not a log of PX4 that can be read: {error}"
        raise BagError(msg) from error
    tables = {}
    for data in log.data_list:
        stamps = np.asarray(data.data.get("timestamp", ())).astype(np.int64) * 1000
        if len(stamps):
            name = f"/{data.name}" + (f"/{data.multi_id}" if data.multi_id else "")
            words = "".join(word.capitalize() for word in data.name.split("_"))
            tables[name] = Table(f"px4_msgs/msg/{words}", stamps, _columns(data.data))
    warnings = []
    if log.file_corruption:
        warnings.append(f"{path}: damaged; what could be read is used")
    if log.dropouts:
        lost = sum(dropout.duration for dropout in log.dropouts) * 1e-3
        warnings.append(f"{path}: the logger missed {lost:.2f} s in {len(log.dropouts)} dropouts")
    numbers = {name: value for name, value in log.initial_parameters.items() if isinstance(value, (int, float))}
    parameters = {name: float(value) for name, value in numbers.items()}
    return FlightLog(path, tables, parameters, warnings)


def _columns(flat: dict[str, Any]) -> dict[str, NDArray[Any]]:
    """Return the columns; ``q[0]``, ``q[1]``, ... become one of several numbers a row."""
    columns: dict[str, NDArray[Any]] = {}
    arrays: dict[str, dict[int, NDArray[Any]]] = {}
    for name, values in flat.items():
        found = _ELEMENT.fullmatch(name)
        if found is not None:
            arrays.setdefault(found[1], {})[int(found[2])] = np.asarray(values)
        elif name.isidentifier():
            columns[name] = np.asarray(values)
    for name, parts in arrays.items():
        if sorted(parts) == list(range(len(parts))):
            columns[name] = np.stack([parts[i] for i in range(len(parts))], axis=1)
    return columns
