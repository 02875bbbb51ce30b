"""Tasks on Dask workers: a few in flight, those of killed workers again, a killer of workers found out."""

from __future__ import annotations

import asyncio
import logging
import queue
import re
import signal
import threading
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import ExitStack, contextmanager
from multiprocessing import resource_tracker
from tempfile import TemporaryDirectory
from typing import Any

from dask import config
from distributed import CancelledError, Client, KilledWorker, LocalCluster
from distributed import TimeoutError as NotYet

from msls_ros.fleet.work import Attempt, Done, FleetError, check_code, running_code

PER_THREAD = 2
"""Tasks in flight for each thread of the workers: one runs, one waits."""
POLL = 1.0
"""Seconds between two looks at the workers."""
STOP_POLL = 0.1
"""Seconds between two questions whether to stop."""
DEATHS = 2
"""Worker processes of this machine that die with a task before it is suspected, and again before it is judged."""
GRACE = 0.5
"""Seconds that a worker process of this machine has to end before it is killed."""
_ADDRESS = re.compile(r"(tcp|tls)://(\[[0-9a-fA-F:.]+\]|[^\s/:]+):\d{1,5}")
_NEEDED = "expected msls_ros there, and all that it needs"


@contextmanager
def local_client(jobs: int) -> Iterator[Any]:
    """Start worker processes on this machine; at the end nothing of them is left, whatever they were doing."""

    async def stop() -> None:
        await asyncio.gather(*(nanny.close(timeout=GRACE) for nanny in cluster.workers.values()))

    with (
        _quiet(),
        TemporaryDirectory(prefix="msls_") as folder,
        config.set({"temporary-directory": folder}),
        ExitStack() as stack,
    ):
        with _no_interrupts():
            cluster = stack.enter_context(
                LocalCluster(
                    n_workers=jobs,
                    threads_per_worker=1,
                    processes=True,
                    host="127.0.0.1",
                    dashboard_address=None,
                    silence_logs=logging.CRITICAL,
                    memory_limit=0,
                    scheduler_kwargs={"allowed_failures": DEATHS - 1, "dashboard_address": "127.0.0.1:0"},
                )
            )
            client = stack.enter_context(Client(cluster, set_as_default=False))
            stack.callback(cluster.sync, stop)
        try:
            yield client
        finally:
            with _no_interrupts():
                stack.close()


@contextmanager
def remote_client(scheduler: str, patience: float) -> Iterator[Any]:
    """Connect to a scheduler, which must run our code, for it looks into what it passes on.

    Raises
    ------
    FleetError
        If it does not answer, or cannot be used.
    """
    if not _ADDRESS.fullmatch(scheduler):
        message = f"{scheduler!r} is no address; expected tcp://HOST:PORT, as `dask scheduler` prints it"
        raise FleetError(message)
    if scheduler.startswith("tls") and not config.get("distributed.comm.tls.client.cert", None):
        message = f"{scheduler}: Dask has no certificate for tls; expected distributed.comm.tls in its configuration"
        raise FleetError(message)
    with _quiet():
        try:
            client = Client(scheduler, timeout=patience, set_as_default=False)
        except (OSError, TypeError) as error:  # TypeError: tls without certificates
            message = f"{scheduler}: no answer within {patience:g} s; expected a Dask scheduler there"
            raise FleetError(message) from error
        with client:
            try:
                check_code(client.run_on_scheduler(running_code), f"the scheduler {scheduler}")
            except ModuleNotFoundError as error:
                raise FleetError(f"the scheduler {scheduler} lacks a module ({error}); {_NEEDED}") from error
            yield client


@contextmanager
def _no_interrupts() -> Iterator[None]:
    """Put off Ctrl-C; the worker processes of a Dask that is started meanwhile never get it, even those it restarts."""
    main = threading.current_thread() is threading.main_thread()
    came: list[int] = []
    resource_tracker.ensure_running()  # which, were it started later, would let the signal through again
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # threads and processes inherit it
    handler = signal.signal(signal.SIGINT, lambda number, _: came.append(number)) if main else None
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        if main:
            signal.signal(signal.SIGINT, handler)
            if came:
                signal.raise_signal(signal.SIGINT)


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep what Dask logs in this process from stderr: what matters of it becomes a `FleetError`."""
    handlers = [(handler, handler.level) for handler in logging.getLogger("distributed").handlers]
    for handler, _ in handlers:
        handler.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for handler, level in handlers:
            handler.setLevel(level)


class Fleet:
    """Workers at the other end of a client, and the tasks in flight.

    Parameters
    ----------
    client
        To a scheduler.
    name
        Of the scheduler, for people.
    patience, stopped
        See `run`.
    """

    def __init__(self, client: Any, name: str, patience: float, stopped: Callable[[], bool]) -> None:
        """Take the client; see the class."""
        self._client = client
        self._name = name
        self._patience = patience
        self._stopped = stopped
        self._looked, self._seen = 0.0, time.monotonic()
        self._known: dict[str, int] = {}  # workers of our code, and their threads
        self._flying: dict[str, tuple[Any, Attempt]] = {}
        self._ended: queue.SimpleQueue[Any] = queue.SimpleQueue()

    def run(self, attempts: Iterator[Attempt]) -> Generator[Done, None, None]:
        """Run tasks and give each one's end when it comes.

        Those with which too many workers have died run again one by one when all others are done: Dask suspects
        whatever waited on a worker that died, and only a task that dies alone is itself the reason.

        Raises
        ------
        FleetError
            See `msls_ros.fleet.run`.
        """
        suspects: list[Attempt] = []
        for attempt, end in self._ends(attempts, alone=False):
            if isinstance(end, Done):
                yield end
            else:
                suspects.append(attempt)
        for attempt, end in self._ends(iter(suspects), alone=True):
            if isinstance(end, KilledWorker):
                deaths = f"the worker process died {end.allowed_failures + 1} times with this task alone"
                yield Done(attempt.index, None, f"{deaths}; expected it to live: out of memory, or a crash?")
            else:
                yield end

    def _ends(self, attempts: Iterator[Attempt], *, alone: bool) -> Iterator[tuple[Attempt, Any]]:
        """Give each task with its end: a `Done`, or the `KilledWorker` of its workers."""
        more = True
        while (more or self._flying) and not self._stopped():
            window = self._window()
            while more and len(self._flying) < (min(window, 1) if alone else window):
                attempt = next(attempts, None)
                more = attempt is not None
                if attempt is not None:
                    future = self._client.submit(attempt, pure=False)
                    self._flying[future.key] = future, attempt
                    future.add_done_callback(self._ended.put)
            if (more or self._flying) and (end := self._next()) is not None:
                yield end

    def _next(self) -> tuple[Attempt, Any] | None:
        """Wait for the end of a task, or a while."""
        try:
            future = self._ended.get(timeout=STOP_POLL)
        except queue.Empty:
            return None
        try:
            end = future.result(timeout=POLL)
        except KilledWorker as killed:
            end = killed
        except CancelledError as error:
            raise self._lost() from error
        except ModuleNotFoundError as error:
            raise FleetError(f"a worker lacks a module ({error}); {_NEEDED}") from error
        except NotYet:
            if future.status == "error":
                raise
            self._ended.put(future)  # its worker has died with the result: it runs again
            return None
        return self._flying.pop(future.key)[1], end

    def _window(self) -> int:
        """Return how many tasks to have in flight."""
        if time.monotonic() - self._looked > POLL or not self._known:
            try:
                self._look()
            except OSError as error:
                raise self._lost() from error
            self._looked = time.monotonic()
            if self._known:
                self._seen = self._looked
            elif self._looked - self._seen > self._patience:
                message = (
                    f"{self._name}: no worker for {self._patience:g} s; expected some, as `dask worker` starts them"
                )
                raise FleetError(message)
        return PER_THREAD * sum(self._known.values())

    def _look(self) -> None:
        """See which workers there are, and whether the new ones run our code."""
        threads = self._client.nthreads()
        fresh = list(threads.keys() - self._known.keys())
        codes = self._client.run(running_code, workers=fresh, on_error="return") if fresh else {}
        for worker, code in codes.items():
            if isinstance(code, str):
                check_code(code, f"the worker {worker}")
            elif isinstance(code, OSError):  # it has died since
                threads.pop(worker, None)
            else:
                raise FleetError(f"the worker {worker} cannot run this ({code}); {_NEEDED}")
        self._known = threads

    def _lost(self) -> FleetError:
        return FleetError(f"{self._name}: the scheduler has gone; expected it to stay")
