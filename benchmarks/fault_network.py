"""Plant and identifier in two network namespaces: frames lost, late and out of order, then a link that is cut.

Between the two stands a relay of ours (`Relay`), a bridge of two interfaces that loses and delays Ethernet frames: no
traffic control of the kernel is needed, only namespaces and veth pairs. Run as a program it makes all of it, inside a
namespace of its own, and prints one JSON value.
"""

from __future__ import annotations

import heapq
import json
import os
import random
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from benchmarks.programs import program
from msls_ros.nodes.loopback import PROFILE, RANGE

ROOT = Path(__file__).resolve().parents[1]
ETH_P_ALL, SOL_PACKET, PACKET_VNET_HDR = 3, 263, 15
LOSS, JITTER = 0.2, 0.05
"""Share of the frames that is lost [1]; largest delay, of each frame on its own: they overtake each other [s]."""
CUT = 3.0
"""How long the link is cut [s]."""
STALE_AFTER = 0.1
LATE = 0.1
"""What a step of the plant may be late on a machine that has more to do [s]."""
LIMIT = 120.0


def _fresh(topic: str) -> list[str]:
    """Have a subscription drop what is lost: a reliable one waits seconds for it, and everything after it, too."""
    return ["-p", f"qos_overrides./{topic}.subscription.reliability:=best_effort"]


class NotAllowedError(Exception):
    """Namespaces or interfaces cannot be made here."""


def measure(seconds: float) -> dict[str, Any]:
    """Fly for so long over a bad link; give what came of it.

    Raises
    ------
    NotAllowedError
        Where namespaces are not allowed.
    """
    enter = ["unshare", "--net", "--ipc"] if os.geteuid() == 0 else ["unshare", "--user", "--map-root-user", "--net"]
    try:
        allowed = subprocess.run([*enter, "ip", "link", "add", "veth0", "type", "veth", "peer", "name", "veth1"],
                                 capture_output=True, text=True, check=False)  # fmt: skip
    except OSError as error:
        raise NotAllowedError(str(error)) from error
    if allowed.returncode:
        raise NotAllowedError(allowed.stderr.strip().splitlines()[-1] if allowed.stderr else "no reason is given")
    command = [*enter, sys.executable, "-m", "benchmarks.fault_network", str(seconds)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode:
        message = f"the flight over a bad link failed: {done.stderr[-2000:]}"
        raise RuntimeError(message)
    result: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return result


class Relay(threading.Thread):
    """Bridges two interfaces, badly where it is told to.

    Parameters
    ----------
    interfaces
        Names of the two.
    """

    def __init__(self, *interfaces: str) -> None:
        super().__init__(daemon=True)
        self.loss = self.jitter = 0.0
        self.cut = False
        self.frames = self.lost = 0
        self.running = True
        self._rng = random.Random(0)
        self._sockets = []
        for name in interfaces:
            made = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(ETH_P_ALL))
            made.setsockopt(SOL_PACKET, PACKET_VNET_HDR, 1)  # checksums that are still to be computed stay so
            made.bind((name, 0))
            self._sockets.append(made)

    def run(self) -> None:
        """Carry frames until it is told to stop."""
        waiting: list[tuple[float, int, int, bytes]] = []
        while self.running:
            wait = min(max(waiting[0][0] - time.monotonic(), 0.0), 0.1) if waiting else 0.1
            ready, _, _ = select.select(self._sockets, [], [], wait)
            for one in ready:
                frame, address = one.recvfrom(1 << 17)
                if address[2] == socket.PACKET_OUTGOING:
                    continue
                self.frames += 1
                if self.cut or self._rng.random() < self.loss:
                    self.lost += 1
                    continue
                due = time.monotonic() + self.jitter * self._rng.random()
                heapq.heappush(waiting, (due, self.frames, 1 - self._sockets.index(one), frame))
            while waiting and waiting[0][0] <= time.monotonic():
                _, _, target, frame = heapq.heappop(waiting)
                self._sockets[target].send(frame)


def fly(seconds: float) -> dict[str, Any]:
    """Make the namespaces and fly; to be called in a namespace of its own."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(TemporaryDirectory(prefix="msls_network_")))
        sites = [_site(stack, number) for number in (1, 2)]
        relay = Relay("up1", "up2")
        relay.start()
        stack.callback(setattr, relay, "running", False)
        reports = {name: folder / f"{name}.json" for name in ("identifier", "plant")}
        processes = {
            "identifier": _start(stack, sites[0], "identifier", reports, "-p", f"dither.stale_after:={STALE_AFTER}",
                                 *_fresh("state"), *_fresh("effectors")),
            "plant": _start(stack, sites[1], "plant", reports, "-p", "mode:=real_time", "-p", "noise:=none", "-p",
                            f"stale_after:={STALE_AFTER}", *_fresh("dither")),
            "pilot": _start(stack, sites[1], "pilot", reports),
        }  # fmt: skip
        marks = _spoil(relay, seconds, processes, reports)
        for process in processes.values():
            process.send_signal(signal.SIGINT)
        codes = {name: process.wait(timeout=LIMIT) for name, process in processes.items()}
        found = {name: json.loads(path.read_text()) for name, path in reports.items()}
    return {"codes": codes, "frames": relay.frames, "lost": relay.lost, **_judge(found, *marks)}


def _site(stack: ExitStack, number: int) -> int:
    """Make a namespace with an interface that leads to ours; return the process that holds it."""
    holder = subprocess.Popen(["unshare", "--net", "sleep", "infinity"])
    stack.callback(holder.wait)
    stack.callback(holder.kill)
    while os.readlink(f"/proc/{holder.pid}/ns/net") == os.readlink("/proc/self/ns/net"):
        time.sleep(0.01)
    up, down = f"up{number}", f"down{number}"
    _ip("link", "add", up, "type", "veth", "peer", "name", down)
    _ip("link", "set", down, "netns", str(holder.pid))
    _ip("link", "set", up, "promisc", "on", "up")
    for words in (
        ("addr", "add", f"10.77.0.{number}/24", "dev", down),
        ("link", "set", down, "up"),
        ("link", "set", "lo", "up"),
        ("route", "add", "224.0.0.0/4", "dev", down),
    ):
        _ip(*words, inside=holder.pid)
    return holder.pid


def _ip(*words: str, inside: int | None = None) -> None:
    enter = [] if inside is None else ["nsenter", "-t", str(inside), "-n"]
    subprocess.run([*enter, "ip", *words], check=True, capture_output=True)


def _start(stack: ExitStack, site: int, name: str, reports: dict[str, Path], *given: str) -> subprocess.Popen[bytes]:
    environment = {**os.environ, RANGE: "SUBNET", "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"}
    environment.pop(PROFILE, None)
    watched = [sys.executable, "-m", "benchmarks.fault_watched", name, str(reports[name])] if name in reports else None
    command = ["nsenter", "-t", str(site), "-n", *(watched or program(name)), "--ros-args", *given]
    process = subprocess.Popen(command, cwd=ROOT, env=environment, stdout=sys.stderr)
    stack.callback(process.wait)
    stack.callback(process.kill)
    return process


def _spoil(
    relay: Relay, seconds: float, processes: dict[str, Any], reports: dict[str, Path]
) -> tuple[float, float, float]:
    """Wait for the flight; make the link bad, cut it in the middle, mend it; return when [s]."""
    deadline = time.monotonic() + LIMIT
    while not reports["plant"].with_suffix(".flying").exists():
        if time.monotonic() > deadline or any(p.poll() is not None for p in processes.values()):
            message = f"no flight over a good link ({relay.frames} frames)"
            raise RuntimeError(message)
        time.sleep(0.05)
    begun = time.monotonic()
    relay.loss, relay.jitter = LOSS, JITTER
    time.sleep(seconds / 2)
    relay.cut, cut = True, time.monotonic()
    time.sleep(CUT)
    relay.cut, mended = False, time.monotonic()
    time.sleep(seconds / 2)
    return begun, cut, mended


def _judge(found: dict[str, Any], begun: float, cut: float, mended: float) -> dict[str, Any]:
    """Say what the dither did, before, in and after the cut."""
    log = [(t, size, held) for t, size, held in found["plant"]["log"] if t > begun]
    still = [size for t, size, _ in log if cut + 2 * STALE_AFTER + JITTER < t < mended]
    late = [size for t, size, held in log if size > 0.0 and held > STALE_AFTER + LATE]
    return {
        "steps": len(log),
        "with_dither": sum(size > 0.0 for t, size, _ in log if t < cut),
        "with_dither_again": sum(size > 0.0 for t, size, _ in log if t > mended),
        "dither_in_the_cut": sum(size > 0.0 for size in still),
        "steps_in_the_cut": len(still),
        "too_old": len(late),
        "largest_state": found["plant"]["largest_state"],
        "samples": found["identifier"]["samples"],
        "same_bits": found["identifier"]["same_bits"],
    }


if __name__ == "__main__":
    print(json.dumps(fly(float(sys.argv[1]))))
