"""A task on its way to whoever runs it: what it carries, what comes back, and whether the code there is the same."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any


class FleetError(Exception):
    """Tasks cannot be run as asked for; one sentence that says what was found and what was expected."""


@dataclass(frozen=True)
class Done:
    """The end of a task."""

    index: int
    """Of the task, in the order given."""
    result: Any | None
    """What the function returned; None if there is an error."""
    error: str | None
    """One sentence; None if there is a result."""


@dataclass(frozen=True)
class Attempt:
    """A task on its way to a worker process.

    Called there; it holds whatever a worker needs to know, and refuses a worker whose results might be others.
    """

    function: Callable[[Any], Any]
    task: Any
    index: int
    expected: tuple[type[Exception], ...]
    code: str
    """What `running_code` gives where the tasks come from."""

    def __call__(self) -> Done:
        """Run the task.

        Raises
        ------
        FleetError
            If this process runs other code.
        """
        check_code(running_code(), "a worker", self.code)
        return attempt(self.function, self.task, self.index, self.expected)


def attempt(function: Callable[[Any], Any], task: Any, index: int, expected: tuple[type[Exception], ...]) -> Done:
    """Run a task in this process."""
    try:
        return Done(index, function(task), None)
    except expected as error:
        return Done(index, None, str(error))


def running_code() -> str:
    """Return the code of this process, for people: the package with a digest of its sources, and the Python."""
    return _CODE


def _running_code() -> str:
    package = Path(__file__).parent.parent
    total = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        total.update(f"{path.relative_to(package)}\n".encode() + path.read_bytes())
    return f"{package.name} with sources {total.hexdigest()[:12]} on Python {platform.python_version()}"


_CODE = _running_code()  # now: a process goes on with what it has imported, whatever becomes of the files


def check_code(theirs: str, who: str, ours: str | None = None) -> None:
    """Refuse a process of other code than ours (None: that of this process), whose results might be others."""
    if theirs != (ours or running_code()):
        message = f"{who} runs {theirs}, expected what runs here: {ours or running_code()}"
        raise FleetError(message)
