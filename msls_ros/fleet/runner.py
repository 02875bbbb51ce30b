"""Run one function on many tasks.

One job runs in this process, and Dask is not imported. More run on worker processes, of this machine or of a cluster,
through `msls_ros.fleet.cluster`. The function and the tasks are the same in all three, and so are the results.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from typing import Any

from msls_ros.fleet.work import Attempt, Done, FleetError, attempt, running_code


def run(
    function: Callable[[Any], Any],
    tasks: Sequence[Any],
    *,
    jobs: int = 1,
    scheduler: str | None = None,
    expected: tuple[type[Exception], ...] = (),
    patience: float = 30.0,
    stopped: Callable[[], bool] = lambda: False,
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
    stopped
        Asked before every task and, with worker processes, several times a second: true ends the iteration at once.
        A signal's handler that raises instead may do so in the midst of what Dask does.

    Raises
    ------
    FleetError
        If the scheduler does not answer or is lost, has no workers for too long, or workers that run other code; if
        Dask is not installed.
    """
    if (jobs == 1 and scheduler is None) or not tasks:
        for index, task in enumerate(tasks):
            if stopped():
                return
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
        yield from Fleet(client, scheduler or "this machine", patience, stopped).run(attempts)
