"""What a campaign leaves in its folder: each flight as it ends, and at the end the tables, written in one piece."""

from __future__ import annotations

import csv
import fcntl
import hashlib
import io
import json
import os
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

from msls_ros.campaigns.flight import Row

FLIGHTS, TABLE, SUMMARY = "flights.jsonl", "flights.csv", "campaign.json"
COLUMNS = {
    "rms_before": "rms_before_of_truth_before",
    "rms_after": "rms_after_of_truth_before",
    "rms_after_now": "rms_after_of_truth_now",
    "peak_error": "peak_error_of_truth_before",
    "late_error": "late_error_of_truth_before",
    "late_error_now": "late_error_of_truth_now",
}
"""Names of errors that say of what they are shares."""
UNTOLD = ("key", "wall_time_s")
PROOF = "digest"
"""Of a kept flight: a line that does not match it is none."""
"""What is not in the table: the same campaign gives the same table."""


class StoreError(Exception):
    """The folder cannot be used: one sentence."""


class Store:
    """A campaign's folder, which is this process's alone while it is open; the lock ends with the process.

    Parameters
    ----------
    folder
        Made if it is not there.
    fresh
        Forget the flights that are there.

    Raises
    ------
    StoreError
        If another campaign has the folder, or it cannot be written.
    """

    def __init__(self, folder: Path, fresh: bool) -> None:
        """Take the folder and read what is there; see the class."""
        self.folder = folder
        self.notes: list[str] = []
        """What is to be said of what was found."""
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._lock = os.open(folder / "lock", os.O_RDWR | os.O_CREAT, 0o666)
        except OSError as error:
            message = f"the folder '{folder}' cannot be written: {error.strerror}"
            raise StoreError(message) from error
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            path = folder / FLIGHTS
            self.rows = {} if fresh else self._read(path)
            self._file = path.open("wb" if fresh else "ab")
        except BlockingIOError:
            os.close(self._lock)
            message = f"another campaign is flying into '{folder}'; expected one at a time, or another --out"
            raise StoreError(message) from None
        except OSError as error:
            os.close(self._lock)
            message = f"'{folder / FLIGHTS}' cannot be used: {error.strerror}"
            raise StoreError(message) from error

    def _read(self, path: Path) -> dict[str, Row]:
        """Return the flights by key; cut off a last line that was not finished."""
        if not path.exists():
            return {}
        content = path.read_bytes()
        whole = content.rfind(b"\n") + 1
        if whole < len(content):
            os.truncate(path, whole)
            self.notes.append(f"'{path}': its last line was torn and is dropped; that flight is flown again")
        rows: dict[str, Row] = {}
        bad = 0
        for line in content[:whole].splitlines():
            try:
                row = json.loads(line)
                if row.pop(PROOF) != _proof(row):
                    raise ValueError
                rows[row["key"]] = row
            except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
                bad += 1
        if bad:
            self.notes.append(f"'{path}': {bad} lines are no flights and are passed over")
        return rows

    def add(self, row: Row) -> None:
        """Keep a flight."""
        self._file.write(json.dumps({**row, PROOF: _proof(row)}, allow_nan=False).encode() + b"\n")
        self._file.flush()
        self.rows[row["key"]] = row

    def write(self, name: str, text: str) -> None:
        """Write a file in one piece: it is there whole, or as it was."""
        draft = self.folder / f".{name}.draft"
        draft.write_text(text, encoding="utf-8")
        os.replace(draft, self.folder / name)

    def __enter__(self) -> Store:
        """Return itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Give the folder free."""
        self._file.close()
        os.close(self._lock)


def _proof(row: Row) -> str:
    return hashlib.sha256(json.dumps(row, sort_keys=True, allow_nan=False).encode()).hexdigest()[:16]


def csv_of(rows: Sequence[Row]) -> str:
    """Return flights as a table, a line for each; columns that a flight lacks are empty."""
    flat = [flatten(row) for row in rows]
    columns = list(dict.fromkeys(name for row in sorted(flat, key=len, reverse=True) for name in row))
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows([[_cell(row.get(name)) for name in columns] for row in flat])
    return out.getvalue()


def flatten(row: Row) -> dict[str, Any]:
    """Return a flight with one word or number for each name."""
    flat: dict[str, Any] = {}
    for name, value in row.items():
        if name in UNTOLD:
            continue
        if name == "setting":
            flat[name] = " ".join(f"{key}={one}" for key, one in value.items())
        elif name == "alarms":
            flat["alarm_times_s"] = " ".join(f"{when}" for when, _ in value)
        elif name == "faults":
            for number, fault in enumerate(value, 1):
                flat |= {f"fault{number}_{key}": one for key, one in fault.items()}
        elif name == "coverage":
            for matrix, one in value.items():
                flat |= {f"coverage_{matrix}_{key}": number for key, number in one.items()}
        elif isinstance(value, dict):
            flat |= {f"{name}_{COLUMNS.get(key, key)}": one for key, one in value.items()}
        else:
            flat[name] = value
    return flat


def _cell(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    return " ".join(map(str, value)) if isinstance(value, list) else str(value)
