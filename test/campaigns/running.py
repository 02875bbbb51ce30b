"""What the tests of campaigns share: a short scenario, running the command here or in a process, and its files."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from msls_ros.commands import campaign as command

SHORT = """\
description: a short flight
condition: high_alpha
manoeuvre: roll_doublet
duration: 3.0
noise: none
faults:
  - {effector: left_stabilator, time: 1.5, effectiveness: 0.0}
identifier:
  profile: f16
  parameters: {estimator.method: msls, none: {estimator.penalty: 3.0e-4}}
"""


def write(folder: Path, name: str = "short", **changes: str) -> Path:
    """Write the short scenario, flown with MSLS, some of its keys changed."""
    lines = [line for line in SHORT.splitlines() if line.split(":")[0] not in changes]
    path = folder / f"{name}.yaml"
    path.write_text("\n".join([*lines, *(f"{key}: {value}" for key, value in changes.items())]) + "\n")
    return path


def run(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, list[str]]:
    """Run campaign in this process; return its exit code, stdout, and the lines on stderr but those of progress."""
    code = command.main([str(one) for one in arguments])
    out, err = capsys.readouterr()
    return code, out, [line for line in err.splitlines() if not line.startswith("flying ")]


def start(*arguments: object) -> subprocess.Popen[str]:
    """Run campaign in a process of its own."""
    line = [sys.executable, "-m", "msls_ros.commands.campaign", *map(str, arguments)]
    return subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def kept(folder: Path) -> list[str]:
    """Return the lines of the flights that are kept, but for a torn one."""
    path = folder / "flights.jsonl"
    return [line for line in path.read_text().splitlines(True) if line.endswith("\n")] if path.exists() else []


def wait_for(folder: Path, count: int, going: Callable[[], bool]) -> None:
    """Wait until so many flights are kept, while the campaign is going."""
    while len(kept(folder)) < count:
        assert going(), "the campaign ended"
        threading.Event().wait(0.01)


def table(folder: Path) -> bytes:
    return (folder / "flights.csv").read_bytes()


def refuse(word: str) -> None:
    raise AssertionError(f"{word} in JSON")


def strict(text: str) -> Any:
    """Read JSON that may not have NaN or Infinity."""
    return json.loads(text, parse_constant=refuse)
