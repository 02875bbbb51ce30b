"""Nodes on a bench (executors in this process over real DDS, in a domain of its own), and programs of Dask."""

from __future__ import annotations

import itertools
import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher

from msls_ros.nodes.quality import INPUT

os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
PATIENCE = 120.0
"""Wall clock after which what was waited for will not come [s]."""
SomeNode = TypeVar("SomeNode", bound=Node)
_numbers = itertools.count()


def next_domain() -> int:
    """Return a DDS domain that no other bench of this process has, and hardly one of another process."""
    return 1 + (37 * os.getpid() + next(_numbers)) % 100


class Clockwork:
    """A clock that is set by hand."""

    def __init__(self) -> None:
        self.nanoseconds = 0

    def now(self) -> Clockwork:
        return self


class Bench:
    """Nodes in one executor and one context, with a probe that publishes, listens and calls."""

    def __init__(self) -> None:
        self.domain = next_domain()
        self.context = Context()
        rclpy.init(context=self.context, domain_id=self.domain)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.nodes: list[Node] = []
        self.heard: dict[str, list[Any]] = {}
        self._publishers: dict[str, Publisher] = {}
        self.probe = self.adopt(Node("probe", context=self.context))

    def adopt(self, node: SomeNode) -> SomeNode:
        self.nodes.append(node)
        self.executor.add_node(node)
        return node

    def add(self, kind: type[SomeNode], **parameters: Any) -> SomeNode:
        """Make a node; dots of parameter names are written as two underscores."""
        given = [Parameter(name.replace("__", "."), value=value) for name, value in parameters.items()]
        make: Any = kind
        node: SomeNode = make(context=self.context, parameter_overrides=given)
        return self.adopt(node)

    def remove(self, node: Node) -> None:
        self.nodes.remove(node)
        self.executor.remove_node(node)
        node.destroy_node()

    def spin_until(self, condition: Callable[[], object], what: str = "the condition") -> None:
        deadline = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < deadline, f"{what} did not come"
            self.executor.spin_once(timeout_sec=0.05)

    def expect(self, heard: list[Any], count: int, what: str = "messages") -> None:
        """Spin until as many messages have been heard."""
        self.spin_until(lambda: len(heard) >= count, what)

    def listen(self, kind: type[Any], topic: str) -> list[Any]:
        """Return the list that the topic's messages will be in."""
        heard = self.heard.setdefault(topic, [])
        self.probe.create_subscription(kind, topic, heard.append, INPUT)
        self.spin_until(lambda: self.probe.count_publishers(topic) > 0, f"a publisher of {topic}")
        return heard

    def publish(self, topic: str, message: Any) -> None:
        publisher = self._publishers.get(topic)
        if publisher is None:
            publisher = self._publishers[topic] = self.probe.create_publisher(type(message), topic, INPUT)
            made = publisher
            self.spin_until(lambda: made.get_subscription_count() > 0, f"a subscription of {topic}")
        publisher.publish(message)

    def call(self, kind: type[Any], service: str, **request: Any) -> Any:
        """Call a service and return its answer."""
        client = self.probe.create_client(kind, service)
        self.spin_until(client.service_is_ready, service)
        future = client.call_async(kind.Request(**request))
        self.spin_until(future.done, f"the answer of {service}")
        self.probe.destroy_client(client)
        return future.result()

    def diagnostics(self, node: str) -> Callable[[], dict[str, str]]:
        """Listen to /diagnostics; what is returned gives the newest values of a node."""
        heard: list[DiagnosticArray] = []
        self.probe.create_subscription(DiagnosticArray, "/diagnostics", heard.append, 10)

        def newest() -> dict[str, str]:
            found = [s for array in heard for s in array.status if s.name.startswith(f"/{node}:")]
            return {v.key: v.value for v in found[-1].values} | {"status": found[-1].message} if found else {}

        return newest

    def close(self) -> None:
        for node in self.nodes:
            node.destroy_node()
        self.executor.shutdown()
        self.context.shutdown()


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


def linear_samples(count: int, seed: int = 0) -> tuple[Any, Any, Any]:
    """Return x (count, 9), xdot (count, 9), delta (count, 7) of a made-up linear aircraft about high alpha."""
    random = np.random.default_rng(seed)
    trim = np.array([57.0, 0.0, 45.0, 0.0, 0.0, 0.0, 0.0, 0.3, 0.0])
    x = trim + random.normal(size=(count, 9)) * ([1.0] * 3 + [0.05] * 6)
    delta = random.normal(size=(count, 7)) * 0.05
    a, b = random.normal(size=(9, 9)), random.normal(size=(9, 7))
    xdot = (x - trim) @ a.T * 0.1 + delta @ b.T + random.normal(size=(count, 9)) * 1e-3
    return x, xdot, delta


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
    with Client(address, timeout=60, set_as_default=False):
        return address


@pytest.fixture
def worker(start: Start, scheduler: str) -> Iterator[Callable[..., int]]:
    """Start workers; they end with the test."""
    processes: list[subprocess.Popen[bytes]] = []

    def begin(**how: str) -> int:
        processes.append(start("worker", scheduler, "--nthreads", "1", "--no-nanny", **how))
        return processes[-1].pid

    yield begin
    for process in processes:
        process.kill()
        process.wait()
