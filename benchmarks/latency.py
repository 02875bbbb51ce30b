"""State in to dither and model out, through DDS to a process of its own, beside a bare relay of the same messages."""

from __future__ import annotations

import os
import signal
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from msls_msgs.msg import DitherCommand, EffectorSample, LinearModel, StateSample
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.serialization import serialize_message

from benchmarks.programs import program
from msls_ros import messages
from msls_ros.estimation import Configuration
from msls_ros.nodes.quality import reliable

ROOT = Path(__file__).resolve().parents[1]
WHO = ("relay", "identifier")
TICKS = os.sysconf("SC_CLK_TCK")
PERCENTILES = {"p50": 50.0, "p99": 99.0, "p99.9": 99.9}
LOSSLESS = (500, 1000, 1500, 2000, 2500, 3000, 4000)
"""Rates at which loss is looked for besides [Hz]."""
SEARCH = 10.0
"""How long at each of them, at most [s]; once."""
DRAIN = 0.5
"""Wait for the last answers [s]."""


class Probe:
    """Sends samples to one of the two, and notes when the answers come.

    Parameters
    ----------
    context
        Of its node.
    who
        Namespace of the one that is measured.
    """

    def __init__(self, context: Context, who: str) -> None:
        """Make topics and samples; see the class."""
        self.node = Node(f"probe_{who}", context=context, namespace=who)
        quality = reliable(1000)
        self._states = self.node.create_publisher(StateSample, "state", quality)
        self._effectors = self.node.create_publisher(EffectorSample, "effectors", quality)
        self.arrived: dict[str, dict[int, int]] = {"dither": {}, "model": {}}
        for topic, kind in (("dither", DitherCommand), ("model", LinearModel)):
            note = self._noting(self.arrived[topic])
            self.node.create_subscription(kind, topic, note, quality, raw=True)
        c, random = Configuration(), np.random.default_rng(0)
        x = random.normal(size=(100, len(c.states))) + ([57.0, 0.0, 45.0] + [0.0] * (len(c.states) - 3))
        xdot, delta = random.normal(size=x.shape), random.normal(size=(100, len(c.effectors))) * 0.05
        self._samples = [
            (
                bytearray(serialize_message(messages.state_message(0, c.states, x[k], xdot[k]))),
                bytearray(serialize_message(messages.effector_message(0, c.effectors, delta[k]))),
            )
            for k in range(100)
        ]

    def _noting(self, arrived: dict[int, int]) -> Callable[[bytes], None]:
        def note(data: bytes) -> None:
            now = time.perf_counter_ns()
            seconds, nanoseconds = struct.unpack_from("<iI", data, 4)
            arrived.setdefault(seconds * 1_000_000_000 + nanoseconds, now)  # a stop has the stamp of the last sample

        return note

    @property
    def connected(self) -> bool:
        """Whether all four topics are."""
        publishers = all(self.node.count_publishers(t) for t in ("dither", "model"))
        return publishers and all(p.get_subscription_count() for p in (self._states, self._effectors))

    def send(self, rate: float, seconds: float) -> dict[int, int]:
        """Send samples; return when each was sent, by its stamp [ns]."""
        sent: dict[int, int] = {}
        period, start = 1e9 / rate, time.perf_counter_ns()
        for k in range(round(rate * seconds)):
            wait = start + round(k * period) - time.perf_counter_ns()
            if wait > 0:
                time.sleep(wait * 1e-9)
            stamp = time.time_ns()
            state, effectors = self._samples[k % 100]
            for data in (state, effectors):
                struct.pack_into("<iI", data, 4, *divmod(stamp, 1_000_000_000))
            sent[stamp] = time.perf_counter_ns()
            self._states.publish(bytes(state))
            self._effectors.publish(bytes(effectors))
        return sent


def _start(who: str, rate: float, domain: int, core: int | None) -> subprocess.Popen[bytes]:
    """Start the one that is measured, on a core of its own where there are two."""
    command = program("identifier") if who == "identifier" else [sys.executable, "-m", "benchmarks.relay"]
    given = ["--ros-args", "-r", f"__ns:=/{who}", "--log-level", "error"]
    given += ["-p", f"sample_rate:={float(rate)}"] if who == "identifier" else []
    environment = {**os.environ, "ROS_DOMAIN_ID": str(domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    process = subprocess.Popen([*command, *given], cwd=ROOT, env=environment, stdout=subprocess.DEVNULL)
    if core is not None:
        os.sched_setaffinity(process.pid, {core})
    return process


def _cpu(pid: int) -> float:
    """Return the processor time of a process [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS


def _memory(pid: int) -> float:
    """Return the resident memory of a process [MB]."""
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") * 1e-6


def _round(probe: Probe, process: subprocess.Popen[bytes], rate: float, seconds: float) -> dict[str, Any]:
    """Measure one of the two at one rate."""
    cpu, wall = _cpu(process.pid), time.perf_counter()
    sent = probe.send(rate, seconds)
    share = (_cpu(process.pid) - cpu) / (time.perf_counter() - wall)
    time.sleep(DRAIN)
    found: dict[str, Any] = {"sent": len(sent), "cpu": share, "memory": _memory(process.pid)}
    for topic, arrived in probe.arrived.items():
        times = np.array([(arrived[s] - t) * 1e-6 for s, t in sent.items() if s in arrived])
        found[topic] = {name: float(np.percentile(times, p)) for name, p in PERCENTILES.items()} if len(times) else {}
        found[topic] |= {"max": float(times.max(initial=0.0)), "lost": len(sent) - len(times)}
        arrived.clear()
    return found


def measure(rates: Sequence[float], seconds: float, rounds: int, say: Callable[[str], None]) -> dict[str, Any]:
    """Measure both at all rates, in turn.

    Parameters
    ----------
    rates
        [Hz]
    seconds
        Per round.
    rounds
        Per rate; the medians over them count.
    say
        Told what is going on.

    Returns
    -------
    dict
        Per rate: latencies [ms], processor share [1] and memory [MB] of both, and the ratios; the highest rates without
        loss.
    """
    cores = sorted(os.sched_getaffinity(0))
    pinned = len(cores) > 1
    domain = 1 + os.getpid() % 100
    result: dict[str, Any] = {"pinned": pinned, "seconds": seconds, "rounds": rounds, "rates": []}
    before = os.sched_getaffinity(0)
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    with ExitStack() as stack:
        if pinned:
            os.sched_setaffinity(0, {cores[0]})
            stack.callback(os.sched_setaffinity, 0, before)
        probes = _probes(stack, domain)
        for rate in [*rates, *(r for r in LOSSLESS if r > max(rates))]:
            length, count = (seconds, rounds) if rate in rates else (min(seconds, SEARCH), 1)
            say(f"{rate:g} Hz: {count} rounds of {length:g} s each")
            row = _rate(probes, rate, length, count, domain, cores[-1] if pinned else None)
            if rate in rates:
                result["rates"].append(row)
            for who in WHO:
                if row[who]["lost"] == 0:
                    result[f"lossless_{who}"] = max(result.get(f"lossless_{who}", 0), rate)
            if rate not in rates and any(row[who]["lost"] for who in WHO):
                break
    return result


def _probes(stack: ExitStack, domain: int) -> dict[str, Probe]:
    """Return the probes, spun by a thread of their own."""
    context = Context()
    rclpy.init(context=context, domain_id=domain)
    stack.callback(context.try_shutdown)
    executor = SingleThreadedExecutor(context=context)
    probes = {who: Probe(context, who) for who in WHO}
    for probe in probes.values():
        executor.add_node(probe.node)

    def spin() -> None:
        try:
            executor.spin()
        except ExternalShutdownException:
            return

    thread = threading.Thread(target=spin)
    thread.start()
    stack.callback(thread.join)
    stack.callback(executor.shutdown)
    return probes


def _rate(
    probes: dict[str, Probe], rate: float, seconds: float, rounds: int, domain: int, core: int | None
) -> dict[str, Any]:
    """Measure both at one rate, in turn; return medians over the rounds and their ratios."""
    processes = {who: _start(who, rate, domain, core) for who in WHO}
    try:
        while not all(probe.connected for probe in probes.values()):
            time.sleep(0.1)
            if any(p.poll() is not None for p in processes.values()):
                message = "one of the processes has ended"
                raise RuntimeError(message)
        for who in WHO:
            _round(probes[who], processes[who], rate, min(seconds, 1.0))  # warm
        found = {who: [] for who in WHO}  # type: dict[str, list[dict[str, Any]]]
        for _ in range(rounds):
            for who in WHO:
                found[who].append(_round(probes[who], processes[who], rate, seconds))
    finally:
        for process in processes.values():
            process.send_signal(signal.SIGINT)
        for process in processes.values():
            process.wait(timeout=30)
    row: dict[str, Any] = {"rate": rate, **{who: _median(found[who]) for who in WHO}}
    ours, theirs = row["identifier"], row["relay"]
    row["ratios"] = {name: ours["dither"][name] / theirs["dither"][name] for name in PERCENTILES}
    row["ratios"]["cpu"] = ours["cpu"] / theirs["cpu"] if theirs["cpu"] else float("nan")
    return row


def _median(found: list[dict[str, Any]]) -> dict[str, Any]:
    result: dict[str, Any] = {name: float(np.median([f[name] for f in found])) for name in ("cpu", "memory")}
    result["lost"] = sum(f[topic]["lost"] for f in found for topic in ("dither", "model"))
    for topic in ("dither", "model"):
        names = (*PERCENTILES, "max")
        result[topic] = {n: float(np.median([f[topic].get(n, np.nan) for f in found])) for n in names}
    return result
