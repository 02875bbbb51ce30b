"""Disks that are full or read-only: everything that writes says so in one line, and what was there is still there."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from msls_msgs.msg import StateSample

from benchmarks.programs import program
from msls_ros import messages
from msls_ros.bags import BagWriter
from msls_ros.plant import EFFECTORS, STATES
from msls_ros.testing import Bench

LIMIT = 300.0
SAMPLES = 1500
LARGE = ["x" * 10_000]
"""Names that fill a disk soon."""
WRITERS = {
    "replay": ["--params", "f16", "--out", "out/replayed", "source"],
    "report": ["--out", "out/report", "source"],
    "campaign": ["roll_doublet_tail_fault", "--seeds", "1", "--jobs", "1", "--out", "out/campaign"],
    "demo": ["--out", "out/demo"],
    "recorder": ["--ros-args", "-p", "out:=out/bag"],
}
"""What writes, and where it is told to; the recorder while states are published."""
FULL = "cp keep out/keep; dd if=/dev/zero of=out/fill bs=1k 2>/dev/null; truncate -s -16k out/fill"
DISKS = {
    "a disk with 16 KiB left": f"mount -t tmpfs -o size=256k none out && {{ {FULL}; }} &&",
    "files that end at 16 KiB": "cp keep out/keep && ulimit -f 16 &&",
    "a read-only disk": "mount -t tmpfs none out && cp keep out/keep && mount -o remount,ro out &&",
}
CHECK = 'cmp keep out/keep && exit $code; echo "what was there has changed" >&2; exit 99'


def measure(
    say: Callable[[str], None], writers: tuple[str, ...] = tuple(WRITERS), kinds: tuple[str, ...] = tuple(DISKS)
) -> list[dict[str, Any]]:
    """Have each writer meet each disk; give a row for each disk, with ``skipped`` where it cannot be made here."""
    rows = []
    with TemporaryDirectory(prefix="msls_disks_") as name:
        folder = Path(name)
        _write_source(folder / "source")
        (folder / "keep").write_bytes(os.urandom(20_000))
        (folder / "out").mkdir()
        for kind in kinds:
            prepare = DISKS[kind]
            say(f"{kind}: {', '.join(writers)}")
            row: dict[str, Any] = {"kind": kind, "tried": 0, "refused": 0, "lost": 0, "crashed": 0, "examples": []}
            if "mount" in prepare and not mounts_allowed():
                row["skipped"] = "nothing may be mounted here"
            else:
                for writer in writers:
                    _meet(row, folder, prepare, writer)
            rows.append(row)
    return rows


def mounts_allowed() -> bool:
    """Whether a disk can be made here."""
    try:
        return not subprocess.run([*_apart(), "mount", "-t", "tmpfs", "none", "/mnt"], capture_output=True).returncode
    except OSError:
        return False


def _apart() -> list[str]:
    return ["unshare", "--mount"] if os.geteuid() == 0 else ["unshare", "--user", "--map-root-user", "--mount"]


def _write_source(bag: Path) -> None:
    """Write a flight to replay and report, of an aircraft that is none."""
    rng = np.random.default_rng(0)
    with BagWriter(bag) as writer:
        for k in range(SAMPLES):
            stamp, x, delta = 10**9 + k * 20_000_000, rng.normal(size=9), rng.normal(size=7)
            header = {"stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}, "frame_id": ""}
            state = {"header": header, "states": list(STATES), "x": x, "xdot": x[::-1].copy()}
            writer.write_message("/state", "msls_msgs/msg/StateSample", stamp, state)
            effectors = {"header": header, "effectors": list(EFFECTORS), "delta": delta}
            writer.write_message("/effectors", "msls_msgs/msg/EffectorSample", stamp, effectors)


def _meet(row: dict[str, Any], folder: Path, prepare: str, writer: str) -> None:
    """Run one writer on one disk and judge how it ends."""
    row["tried"] += 1
    script = f'{prepare} {{ "$@"; code=$?; {CHECK}; }}'
    command = [*(_apart() if "mount" in prepare else []), "bash", "-c", script, "writer", *program(writer)]
    given = {"cwd": folder, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    if writer == "recorder":
        code, said = _record(command + WRITERS[writer], given)
    else:
        done: Any = subprocess.run(command + WRITERS[writer], check=False, timeout=LIMIT, **given)  # type: ignore[call-overload]
        code, said = done.returncode, done.stderr
    last = said.strip().splitlines()[-1] if said.strip() else ""
    if code == 99:
        row["lost"] += 1
    elif code == 2 and "Traceback" not in said and last:
        row["refused"] += 1
        row.setdefault("said", {})[writer] = last
        return
    else:
        row["crashed"] += 1
    row["examples"].append(f"{writer}: exit code {code}: {last}")


def _record(command: list[str], given: dict[str, Any]) -> tuple[int, str]:
    """Run the recorder while large states are published, until it ends."""
    with Bench() as bench:
        given["env"] = {**os.environ, "ROS_DOMAIN_ID": str(bench.domain)}
        process: Any = subprocess.Popen(command, **given)
        publisher = bench.probe.create_publisher(StateSample, "state", 10)
        stamp = 0

        def ended() -> bool:
            nonlocal stamp
            if publisher.get_subscription_count():
                stamp += 20_000_000
                publisher.publish(messages.state_message(stamp, LARGE, np.zeros(1), np.zeros(1)))
            return process.poll() is not None

        try:
            bench.spin_until(ended, "the end of the recorder")
        finally:
            process.kill()
        _, said = process.communicate()
        return process.returncode, said
