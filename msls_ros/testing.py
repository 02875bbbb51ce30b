"""For your own pytest: nodes on a bench, in one process and one executor, over real DDS in a domain of their own.

Start the identifier node, feed it samples, wait for what it says::

    from msls_ros.testing import Bench

    def test_my_aircraft() -> None:
        with Bench() as bench:
            identifier = bench.identifier("f16")
            identifier.feed(time, x, xdot, delta)
            model = identifier.await_models(len(time))[-1]
            assert not identifier.events

Nothing sleeps: what is waited for is awaited with a time-out (``Bench(patience=)``, `PATIENCE`), and the executor spins
meanwhile. Any other node of yours goes on the same bench with `Bench.add`. See ``docs/pytest.md``.
"""

from __future__ import annotations

import inspect
import itertools
import os
import socket
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from types import TracebackType
from typing import Any, TypeVar

import numpy as np
import rclpy

from msls_ros import messages  # first of what needs msls_msgs: says what to do where that is not built

# isort: split
from diagnostic_msgs.msg import DiagnosticArray
from msls_msgs.msg import DitherCommand, FaultEvent, LinearModel
from numpy.typing import ArrayLike
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.subscription import Subscription

from msls_ros.estimation import Configuration, EstimationError
from msls_ros.estimation.configuration import as_mapping
from msls_ros.inputs.profiles import profile_path, read_inputs, read_profile
from msls_ros.nodes.identifier import IdentifierNode
from msls_ros.nodes.loopback import BY_PROFILE, RANGE, loopback
from msls_ros.nodes.parameters import read_configuration
from msls_ros.nodes.quality import INPUT, depth_of

__all__ = ["PATIENCE", "WITHOUT_SHARED_MEMORY", "Bench", "IdentifierBench"]

PATIENCE = 300.0
"""Wall clock after which what was waited for will not come, where a `Bench` has no other [s].

A wait ends with the event, so that only a test that fails takes so long; a first start may compile for minutes.
"""
WITHOUT_SHARED_MEMORY = loopback()
"""Environment of tests that kill node processes, of these and of pytest itself, before its first participant.

What a killed process leaves in shared memory can hang the next one, or take it down: `msls_ros.nodes.loopback`. Where
it is in ``os.environ`` a `Bench` goes by it, as do the processes that a test starts.
"""
QUEUE = 2.0
"""What an identifier's queues hold where its profile does not say [s of samples]: tests feed faster than in flight."""
IN_FLIGHT = 50
"""Samples that are fed before the answer of the first is awaited: fewer than the queue of a subscription holds."""
SomeNode = TypeVar("SomeNode", bound=Node)
DOMAINS = range(1, 101)
"""The DDS domains that benches use; the ports of those beyond are also given to other programs."""
_FIRST_PORT, _PORTS = 7400, 250
"""The UDP ports of domain 0 begin here, and each domain has so many."""
_SOCKETS = ("/proc/net/udp", "/proc/net/udp6")
_attempts = itertools.count()


def claim_domain() -> tuple[int, socket.socket]:
    """Return a DDS domain that nobody on this machine has, and the lock that holds it until it is closed.

    Another bench has the domains that it has locked; a stack that runs here those of its UDP ports, and one that is yet
    to be started from this environment has ``ROS_DOMAIN_ID``.

    Raises
    ------
    RuntimeError
        If all of `DOMAINS` are taken.
    """
    start = 37 * os.getpid() + next(_attempts)
    for number in range(len(DOMAINS)):
        domain = DOMAINS[(start + number) % len(DOMAINS)]
        lock = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            lock.bind(f"\0msls_ros_domain_{domain}")
        except OSError:
            lock.close()
            continue
        if domain not in _live_domains():
            return domain, lock
        lock.close()
    raise RuntimeError(f"all DDS domains from {DOMAINS[0]} to {DOMAINS[-1]} are in use on this machine")


def _live_domains() -> set[int]:
    """Return the domains of the UDP ports that are bound on this machine, where it says so, and ``ROS_DOMAIN_ID``."""
    own = os.environ.get("ROS_DOMAIN_ID", "")
    found = {int(own)} if own.isdecimal() else set()
    for path in map(Path, _SOCKETS):
        lines = path.read_text(encoding="ascii").splitlines()[1:] if path.exists() else []
        ports = (int(line.split()[1].rpartition(":")[2], 16) for line in lines)
        found |= {(port - _FIRST_PORT) // _PORTS for port in ports}
    return found


class Bench:
    """Nodes in one executor and one context, with a probe that publishes, listens and calls.

    A context manager; everything is destroyed at its end. DDS stays on this machine, in a domain that neither another
    bench nor a stack that runs here has.

    Parameters
    ----------
    patience
        Wall clock after which what was waited for will not come [s]; None: `PATIENCE`.

    Attributes
    ----------
    domain
        The DDS domain; a process of yours joins the bench by ``ROS_DOMAIN_ID``.
    context, executor
        Of all nodes; spin the executor through `spin_until`.
    nodes
        What is on the bench, the probe first.
    heard
        What `listen` returned, by topic as it was given.
    """

    def __init__(self, patience: float | None = None) -> None:
        """Make the context and the probe; see the class."""
        if os.environ.get(RANGE) != BY_PROFILE:
            os.environ[RANGE] = "LOCALHOST"
        self.patience = PATIENCE if patience is None else patience
        self.domain, self._lock = claim_domain()
        self.context = Context()
        rclpy.init(context=self.context, domain_id=self.domain)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.nodes: list[Node] = []
        self.heard: dict[str, list[Any]] = {}
        self._listening: dict[tuple[str, type[Any]], tuple[Subscription, list[Any]]] = {}
        self._publishers: dict[str, Publisher] = {}
        self.probe = self.adopt(Node("probe", context=self.context))

    def __enter__(self) -> Bench:
        """Return itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Destroy all nodes."""
        self.close()

    def adopt(self, node: SomeNode) -> SomeNode:
        """Put a node on the bench; it must have been made in the bench's context."""
        self.nodes.append(node)
        self.executor.add_node(node)
        return node

    def add(self, kind: type[SomeNode], **parameters: Any) -> SomeNode:
        """Make a node and put it on the bench.

        What it has made when this returns, and the other nodes of the bench have, know each other: the first message
        of either arrives. What it makes later, and other processes, are awaited by `spin_until`.

        Parameters
        ----------
        kind
            Its class; called with ``context`` and ``parameter_overrides``.
        **parameters
            By name; dots are written as two underscores.

        Raises
        ------
        TypeError
            If the class does not take what it is called with: it must accept ``**kwargs`` and pass them on to `Node`.
        """
        given = [Parameter(name.replace("__", "."), value=value) for name, value in parameters.items()]
        how: dict[str, Any] = {"context": self.context, "parameter_overrides": given}
        make: Any = kind
        try:
            inspect.signature(make).bind(**how)
        except TypeError as error:
            name = getattr(kind, "__name__", repr(kind))
            message = (
                f"{name} does not take context and parameter_overrides, which a bench gives to its nodes ({error}): "
            )
            message += "write 'def __init__(self, **kwargs)' and 'super().__init__(\"name\", **kwargs)'"
            raise TypeError(message) from error
        node: SomeNode = make(**how)
        return self.adopt(node)

    def identifier(self, profile: str | os.PathLike[str] | Configuration = "f16", **parameters: Any) -> IdentifierBench:
        """Start an identifier node and listen to all that it publishes.

        Parameters
        ----------
        profile
            A shipped profile's name or the path of a parameter file, of which all reaches the node as by
            ``--params-file``, ``inputs`` among it; or a configuration, which has no ``inputs``.
        **parameters
            Other than the profile has them; dots are written as two underscores.

        Raises
        ------
        EstimationError
            For a profile that is missing or wrong.
        NodeError
            For a parameter of the node that is refused.
        """
        return IdentifierBench(self, profile, parameters)

    def remove(self, node: Node) -> None:
        """Take a node off the bench and destroy it."""
        self.nodes.remove(node)
        self.executor.remove_node(node)
        node.destroy_node()

    def spin_until(self, condition: Callable[[], object], what: str = "the condition") -> None:
        """Spin until a condition holds.

        Raises
        ------
        AssertionError
            If it does not within `patience`; it names ``what``.
        """
        deadline = time.monotonic() + self.patience
        while not condition():
            if time.monotonic() >= deadline:
                message = f"{what} did not come within {self.patience:g} s"
                raise AssertionError(message)
            self.executor.spin_once(timeout_sec=0.05)

    def expect(self, heard: list[Any], count: int, what: str = "messages") -> None:
        """Spin until as many messages have been heard."""
        self.spin_until(lambda: len(heard) >= count, what)

    def listen(self, kind: type[Any], topic: str) -> list[Any]:
        """Return the list that the topic's messages will be in, once somebody publishes it.

        Of a topic that is listened to already, as those of an identifier are, the same list.
        """
        own = self.probe.resolve_topic_name(topic), kind
        subscription, heard = self._listening.get(own, (None, []))
        if subscription is None or subscription not in self.probe.subscriptions:  # none yet, or one that was destroyed
            self._listening[own] = self.probe.create_subscription(kind, topic, heard.append, INPUT), heard
        self.heard[topic] = heard
        self.spin_until(lambda: self.probe.count_publishers(topic) > 0, f"a publisher of {topic}")
        return heard

    def publish(self, topic: str, message: Any) -> None:
        """Publish from the probe, once somebody listens."""
        publisher = self._publishers.get(topic)
        if publisher is None:
            publisher = self._publishers[topic] = self.probe.create_publisher(type(message), topic, INPUT)
            made = publisher
            self.spin_until(lambda: made.get_subscription_count() > 0, f"a subscription of {topic}")
        publisher.publish(message)

    def call(self, kind: type[Any], service: str, **request: Any) -> Any:
        """Call a service and return its answer.

        An answer is lost where the service has not found the client yet, which nobody is told of: the call is repeated
        once, after a third of `patience`.
        """
        client = self.probe.create_client(kind, service)
        self.spin_until(client.service_is_ready, service)
        futures = [client.call_async(kind.Request(**request))]
        again = time.monotonic() + self.patience / 3.0

        def answered() -> bool:
            if len(futures) == 1 and time.monotonic() > again:
                futures.append(client.call_async(kind.Request(**request)))
            return any(future.done() for future in futures)

        self.spin_until(answered, f"the answer of {service}")
        self.probe.destroy_client(client)
        return next(future for future in futures if future.done()).result()

    def diagnostics(self, node: str) -> Callable[[], dict[str, str]]:
        """Listen to /diagnostics; what is returned gives the newest values of a node."""
        heard: list[DiagnosticArray] = []
        self.probe.create_subscription(DiagnosticArray, "/diagnostics", heard.append, 10)

        def newest() -> dict[str, str]:
            found = [s for array in heard for s in array.status if s.name.startswith(f"/{node}:")]
            return {v.key: v.value for v in found[-1].values} | {"status": found[-1].message} if found else {}

        return newest

    def close(self) -> None:
        """Destroy all nodes and the context."""
        self.executor.shutdown()  # first: no callback may run while its node goes
        for node in self.nodes:
            node.destroy_node()
        self.context.shutdown()
        self._lock.close()


def _of_profile(profile: str | os.PathLike[str] | Configuration) -> tuple[list[str], dict[str, Any]]:
    """Return the arguments and parameters that an identifier node has of a profile.

    A file is read by ROS itself, so that no parameter of it is lost; what is before it on the line it may change.
    """
    if isinstance(profile, Configuration):
        given = {name: list(v) if isinstance(v, tuple) else v for name, v in as_mapping(profile).items()}
        return [], given | {"queue": QUEUE}
    read_profile(profile)  # refuses in a sentence that names the file
    read_inputs(profile)
    return ["--ros-args", "-p", f"queue:={QUEUE}", "--params-file", str(profile_path(profile))], {}


class IdentifierBench:
    """An identifier node on a bench: feed it samples or play it messages, await its models, events and dithers.

    Attributes
    ----------
    configuration
        As the node has it.
    node
        The identifier.
    models, events, dithers
        What it has published, oldest first; they grow while the bench spins.
    """

    def __init__(
        self, bench: Bench, profile: str | os.PathLike[str] | Configuration, parameters: dict[str, Any]
    ) -> None:
        """Start the node; see `Bench.identifier`."""
        arguments, given = _of_profile(profile)
        given |= {name.replace("__", "."): value for name, value in parameters.items()}
        overrides = [Parameter(name, value=value) for name, value in given.items() if value != []]
        self.bench = bench
        self.node = bench.adopt(
            IdentifierNode(context=bench.context, cli_args=arguments, parameter_overrides=overrides)
        )
        if not self.node.get_parameter("autostart").value:  # a stack with a lifecycle manager: the bench has its part
            self.node.trigger_configure()
            self.node.trigger_activate()
        self.configuration = read_configuration(self.node)
        topics: dict[str, Any] = self.node.get_parameters_by_prefix("inputs.topics")
        self._mapped = [str(one.value).split()[0] for one in topics.values()]
        self.models: list[LinearModel] = bench.listen(LinearModel, "model")
        self.events: list[FaultEvent] = bench.listen(FaultEvent, "fault")
        self.dithers: list[DitherCommand] = bench.listen(DitherCommand, "dither")

    def feed(self, time: ArrayLike, x: ArrayLike, xdot: ArrayLike, delta: ArrayLike, first: float = 1.0) -> None:
        """Publish samples and wait until each has been answered by a dither.

        Parameters
        ----------
        time
            (n,) [s].
        x, xdot
            (n, states) in the profile's order; SI units and radians.
        delta
            (n, effectors) measured deflections [rad].
        first
            Stamp that time 0 has [s]; stamps of 0 are refused.

        Raises
        ------
        EstimationError
            Where the node's parameters have ``inputs``: it listens to other topics than those of samples.
        """
        configuration = self.configuration
        if self._mapped:
            message = f"feed publishes state and effectors, this identifier's inputs are {', '.join(self._mapped)}: "
            message += "give their messages to play, or start it from read_profile(file), which has no inputs"
            raise EstimationError(message)
        depth = depth_of(self.node.get_parameter("queue").value, configuration.sample_rate)
        waiting = min(IN_FLIGHT, depth // 2)
        answered = len(self.dithers)
        rows = zip(*(np.asarray(v, np.float64) for v in (time, x, xdot, delta)), strict=True)
        for number, (t, *row) in enumerate(rows, 1):
            stamp = round((first + t) * 1e9)
            self.bench.publish("state", messages.state_message(stamp, configuration.states, row[0], row[1]))
            self.bench.publish("effectors", messages.effector_message(stamp, configuration.effectors, row[2]))
            self.bench.expect(self.dithers, answered + number - waiting, "the dithers that answer the samples")
        self.bench.expect(self.dithers, answered + len(np.asarray(time)), "the dithers that answer the samples")

    def play(self, messages: Iterable[tuple[str, Any]]) -> None:
        """Publish messages of the topics that ``inputs`` maps, and wait until each has been taken.

        So they arrive in this order, whatever their topics. What comes of them is awaited as ever; rows lag by the
        delays and the window of the map, so that the last messages make no sample.

        Parameters
        ----------
        messages
            Topic and message, in the order in which a stack would send them.

        Raises
        ------
        EstimationError
            For a topic that is not mapped.
        """
        before = self.node.taken
        for number, (topic, message) in enumerate(messages, 1):
            if topic not in self._mapped:
                has = ", ".join(self._mapped) or "state and effectors, which feed publishes"
                text = f"topic {topic} is not an input of this identifier; its inputs are {has}"
                raise EstimationError(text)
            self.bench.publish(topic, message)
            count = before + number
            self.bench.spin_until(lambda count=count: self.node.taken >= count, f"message {number} on {topic}")  # type: ignore[misc]

    def await_models(self, count: int) -> list[LinearModel]:
        """Wait until ``count`` models have come in all, and return them."""
        self.bench.expect(self.models, count, f"{count} models")
        return self.models

    def await_events(self, count: int) -> list[FaultEvent]:
        """Wait until ``count`` fault events have come in all, and return them."""
        self.bench.expect(self.events, count, f"{count} fault events")
        return self.events
