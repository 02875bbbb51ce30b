"""Run one function on many tasks.

One job runs in this process, and Dask is not imported. More run on worker processes, of this machine or of a cluster,
through `msls_ros.fleet.cluster`. The function and the tasks are the same in all three, and so are the results.
"""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Callable, Generator, Sequence
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


def run(
    function: Callable[[Any], Any],
    tasks: Sequence[Any],
    *,
    jobs: int = 1,
    scheduler: str | None = None,
    expected: tuple[type[Exception], ...] = (),
    patience: float = 30.0,
) -> Generator[Done, None, None]:
    """Run a function on tasks and give each one's end when it comes, in any order, each exactly once.

    A worker process that is killed costs time only: its tasks run again. A task that kills its workers again and again,
    alone at last, ends with an error. Close the iterator, or let it end, to stop what runs.

    Parameters
    ----------
    function
        Takes a task. For worker processes: a function of a module that they can import, or a partial one.
    tasks
        Picklable, as the results are, for worker processes.
    jobs
        Tasks at a time on this machine: 1 in this process, more in as many worker processes.
    scheduler
        Address of a Dask scheduler (tcp://host:port), to run on its workers instead; None: on this machine.
    expected
        Exceptions by which the function says that a task cannot be done; others end the run.
    patience
        Longest time [s] to wait for the scheduler to answer, and that it may have no worker.

    Raises
    ------
    FleetError
        If the scheduler does not answer or is lost, has no workers for too long, or workers that run other code; if
        Dask is not installed.
    """
    if (jobs == 1 and scheduler is None) or not tasks:
        for index, task in enumerate(tasks):
            yield attempt(function, task, index, expected)
        return
    try:
        from msls_ros.fleet.cluster import Fleet, local_client, remote_client
    except ModuleNotFoundError as error:
        message = f"several jobs or a scheduler need Dask ({error}); expected what `pip install distributed` installs"
        raise FleetError(message) from error
    code = running_code()
    attempts = (Attempt(function, task, index, expected, code) for index, task in enumerate(tasks))
    start = local_client(min(jobs, len(tasks))) if scheduler is None else remote_client(scheduler, patience)
    with start as client:
        yield from Fleet(client, scheduler or "this machine", patience).run(attempts)
