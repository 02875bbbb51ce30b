"""Nodes killed at random moments: what is lost, and who notices.

Plant (in real time), pilot, identifier, mixer and recorder fly as processes of their own. One is killed with
SIGKILL at a random moment; the others must live on, the actuators' command must be the stack's own once the last dither
is stale, what the recorder had been sent a second before must be on disk, and the one that is started again must take
part again.
"""

from __future__ import annotations

import os
import random
import shutil
import signal
import subprocess
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from msls_msgs.msg import DitherCommand, EffectorCommand, LinearModel, StateSample

from benchmarks.programs import program
from msls_ros import messages
from msls_ros.bags import BagReader
from msls_ros.testing import Bench

VICTIMS = ("identifier", "plant", "recorder", "mixer")
STALE_AFTER = 0.1
SEVERAL = 20
"""Commands that are looked at once the last dither of a dead identifier is stale, by the stamps of both."""
ON_DISK = 1.0
"""What was sent so long before a kill is on disk [s]."""
LIMIT = 600.0
"""Wall clock after which what was waited for will not come: an identifier may have to compile its kernels first [s]."""


def launch(name: str, folder: Path, domain: int, *given: str) -> subprocess.Popen[bytes]:
    """Start a node as a process."""
    environment = {**os.environ, "ROS_DOMAIN_ID": str(domain)}
    with (folder / f"{name}.log").open("ab") as log:
        command = [*program(name), "--ros-args", *given]
        return subprocess.Popen(command, cwd=folder, env=environment, stdout=log, stderr=log)


class Fleet:
    """Five processes in flight, and a probe that sees their topics."""

    def __init__(self, folder: Path, stack: ExitStack) -> None:
        self.bench = stack.enter_context(Bench())
        self.folder, self._bags = folder, 0
        self.seen: dict[str, list[tuple[float, Any]]] = {}
        kinds = {"model": LinearModel, "dither": DitherCommand, "state": StateSample}
        for topic, kind in {**kinds, "command": EffectorCommand, "command_out": EffectorCommand}.items():
            heard: list[tuple[float, Any]] = []
            self.seen[topic] = heard
            note: Any = lambda m, heard=heard: heard.append((time.monotonic(), m))  # noqa: E731
            self.bench.probe.create_subscription(kind, topic, note, 100)
        self.processes: dict[str, subprocess.Popen[bytes]] = {}
        stack.callback(self._end)
        for name in (*VICTIMS, "pilot"):
            self.start(name)
        self.await_new("model", "command_out", "state")

    def start(self, name: str) -> None:
        """Start one."""
        given = {
            "identifier": ["-p", f"dither.stale_after:={STALE_AFTER}", "-p", "dither.cap_unreliable:=0.01"],
            "plant": ["-p", "mode:=real_time", "-p", "wait_for_dither:=false"],
            "mixer": ["-r", "command_in:=command"],
        }.get(name, [])
        if name == "recorder":
            self._bags += 1
            given = ["-p", f"out:=bag{self._bags}"]
        self.processes[name] = launch(name, self.folder, self.bench.domain, *given)

    @property
    def bag(self) -> Path:
        """The newest one."""
        return self.folder / f"bag{self._bags}"

    def kill(self, name: str) -> float:
        """End one at once; return when."""
        self.processes[name].send_signal(signal.SIGKILL)
        self.processes[name].wait()
        return time.monotonic()

    def await_new(self, *topics: str) -> None:
        """Wait for several new messages of each topic."""
        before = {topic: len(self.seen[topic]) for topic in topics}
        self.wait(lambda: all(len(self.seen[t]) >= before[t] + 5 for t in topics), f"new {', '.join(topics)}")

    def wait(self, condition: Callable[[], object], what: str) -> None:
        """Spin until a condition holds; an error where a process that should live has ended."""
        deadline = time.monotonic() + LIMIT
        while not condition():
            ended = [name for name, process in self.processes.items() if process.poll() not in (None, -signal.SIGKILL)]
            if ended or time.monotonic() > deadline:
                message = f"{', '.join(ended)} ended" if ended else f"no {what} within {LIMIT:g} s"
                raise RuntimeError(message)
            self.bench.executor.spin_once(timeout_sec=0.02)

    def pass_time(self, seconds: float) -> None:
        """Spin for a while."""
        end = time.monotonic() + seconds
        self.wait(lambda: time.monotonic() > end, "end of a pause")

    def _end(self) -> None:
        for process in self.processes.values():
            process.kill()
            process.wait()


def kills(count: int, say: Callable[[str], None], victims: tuple[str, ...] = VICTIMS) -> list[dict[str, Any]]:
    """Kill each node so many times; give a row for each."""
    rng = random.Random(0)
    none = {"tried": 0, "lost": 0, "wrong": 0, "crashed": 0}
    rows: dict[str, dict[str, Any]] = {n: {"kind": f"kill -9 of the {n}", **none} for n in victims}
    examples: list[str] = []
    with TemporaryDirectory(prefix="msls_kills_") as name, ExitStack() as stack:
        fleet = Fleet(Path(name), stack)
        for number in range(count):
            bad = ", ".join(f"{sum(row[k] for row in rows.values())} {k}" for k in ("lost", "wrong", "crashed"))
            say(f"kill {number + 1} of {count} of each of {', '.join(victims)}; so far {bad}")
            for victim in victims:
                row = rows[victim]
                row["tried"] += 1
                fleet.pass_time(rng.uniform(0.1, 1.5))
                try:
                    row["lost" if victim == "recorder" else "wrong"] += AFTER[victim](fleet)
                except RuntimeError as error:
                    row["crashed"] += 1
                    examples.append(f"{victim}: {error}")
                    fleet._end()
                    fleet = Fleet(Path(name), stack)
    return [{**row, "examples": [e for e in examples if e.startswith(n)][:5]} for n, row in rows.items()]


def after_identifier(fleet: Fleet) -> int:
    """Kill it while dither is mixed in; count the commands that are not the stack's own once that is stale."""
    begun = {topic: len(fleet.seen[topic]) for topic in ("command", "command_out")}  # a restarted plant's stamps too
    asked: dict[int, Any] = {}

    def mixed() -> bool:
        asked.update((messages.stamp_of(m), m.delta) for _, m in fleet.seen["command"][-10:])
        out = fleet.seen["command_out"][begun["command_out"] :]
        return any(asked.get(messages.stamp_of(m), m.delta) != m.delta for _, m in out)

    fleet.wait(mixed, "dither in the commands")
    fleet.kill("identifier")
    fleet.await_new("command", "command_out", "state")
    # the mixer may have heard a last dither that the probe has not: who is dead sends nothing again; none is younger
    # than the states of now
    stale = messages.stamp_of(fleet.seen["state"][-1][1]) + round(1e9 * STALE_AFTER)

    def late(topic: str) -> list[Any]:
        return [m for _, m in fleet.seen[topic][begun[topic] :] if messages.stamp_of(m) > stale]

    fleet.wait(lambda: min(len(late("command")), len(late("command_out"))) > SEVERAL, "commands without dither")
    asked = {messages.stamp_of(m): m.delta for m in late("command")}
    wrong: int = sum(asked.get(messages.stamp_of(m), m.delta) != m.delta for m in late("command_out"))
    fleet.start("identifier")
    fleet.await_new("model")
    return wrong


def after_plant(fleet: Fleet) -> int:
    """Kill it; whether the dither is zeroed."""
    fleet.kill("plant")
    inhibited = DitherCommand.LEVEL_INHIBITED
    fleet.wait(lambda: fleet.seen["dither"][-1][1].level == inhibited, "inhibited dither")
    wrong = any(fleet.seen["dither"][-1][1].delta)
    fleet.start("plant")
    fleet.await_new("model", "command_out")
    return int(wrong)


def after_recorder(fleet: Fleet) -> int:
    """Kill it; count the states that it was sent more than a second before and that are not in the bag."""
    begun = time.monotonic()
    fleet.wait(lambda: time.monotonic() > begun + 2.0, "end of a pause")
    killed = fleet.kill("recorder")
    kept = [m.stamp_ns for m in BagReader(fleet.bag) if m.topic == "/state"]
    first = min(kept, default=0)
    due = {messages.stamp_of(m) for t, m in fleet.seen["state"] if begun < t < killed - ON_DISK}
    lost = len({stamp for stamp in due if stamp >= first} - set(kept)) if kept else max(len(due), 1)
    shutil.rmtree(fleet.bag)
    fleet.start("recorder")
    fleet.wait(lambda: (fleet.bag / "metadata.yaml").exists() or any(fleet.bag.glob("*.mcap")), "new bag")
    return lost


def after_mixer(fleet: Fleet) -> int:
    """Kill it; whether it takes part again."""
    fleet.kill("mixer")
    fleet.start("mixer")
    fleet.await_new("command_out")
    return 0


AFTER: dict[str, Callable[[Fleet], int]] = {
    "identifier": after_identifier,
    "plant": after_plant,
    "recorder": after_recorder,
    "mixer": after_mixer,
}
