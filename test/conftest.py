"""A DDS domain for each process of pytest, nodes on a bench (in a domain of their own), and programs of Dask."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from msls_ros.testing import PATIENCE, WITHOUT_SHARED_MEMORY, Bench, claim_domain

DOMAIN, _domain_lock = claim_domain()
"""Of what this process of pytest starts beside the benches."""
os.environ["ROS_DOMAIN_ID"] = str(DOMAIN)
os.environ.update(WITHOUT_SHARED_MEMORY)


@pytest.fixture
def bench() -> Iterator[Bench]:
    made = Bench()
    yield made
    made.close()


@pytest.fixture(scope="module")
def shared_bench() -> Iterator[Bench]:
    made = Bench()
    yield made
    made.close()


PATHS = os.pathsep.join([str(Path(__file__).parent), *filter(None, sys.path)])
Start = Callable[..., subprocess.Popen[bytes]]


@pytest.fixture(scope="module")
def start(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Start]:
    """Start programs of Dask, which end with the tests at the latest."""
    folder = tmp_path_factory.mktemp("dask")
    processes: list[subprocess.Popen[bytes]] = []

    def begin(*arguments: str, path: str = PATHS) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", "dask", *arguments, "--host", "127.0.0.1", "--no-dashboard"]
        env = {**os.environ, "PYTHONPATH": path, "DASK_TEMPORARY_DIRECTORY": str(folder)}
        with (folder / f"log{len(processes)}").open("wb") as log:
            processes.append(subprocess.Popen(command, env=env, cwd=folder, stdout=log, stderr=log))
        return processes[-1]

    yield begin
    for process in processes:
        process.kill()
        process.wait()


@pytest.fixture(scope="module")
def scheduler(start: Start) -> str:
    """Return the address of a scheduler that answers."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
    from distributed import Client

    start("scheduler", "--port", address.rpartition(":")[2])
    with Client(address, timeout=PATIENCE, set_as_default=False):
        return address


@pytest.fixture
def worker(start: Start, scheduler: str) -> Iterator[Callable[..., int]]:
    """Start workers, each known to the scheduler when its process is returned; they end with the test."""
    from distributed import Client

    processes: list[subprocess.Popen[bytes]] = []

    def begin(**how: str) -> int:
        with Client(scheduler, timeout=PATIENCE, set_as_default=False) as client:
            known = len(client.nthreads())
            processes.append(start("worker", scheduler, "--nthreads", "1", "--no-nanny", **how))
            client.wait_for_workers(known + 1, timeout=PATIENCE)
        return processes[-1].pid

    yield begin
    for process in processes:
        process.kill()
        process.wait()
