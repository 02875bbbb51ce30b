"""The bar on a terminal is one line, and what is logged meanwhile stands above it."""

from __future__ import annotations

import os
import pty
import sys

PROGRAM = """
import os, sys
from msls_ros.commands.progress import Progress
with Progress("flying", 10.0, "s") as bar:
    bar.show(4.0)
    os.write(2, b"one, of a library in C\\n")
    print("two, of Python", file=sys.stderr)
    bar.show(10.0)
print("after it", file=sys.stderr)
"""


def shown_on_a_terminal(*command: str) -> list[str]:
    """Run a program on a terminal; return the lines that are left standing there."""
    pid, terminal = pty.fork()
    if pid == 0:  # pragma: no cover
        os.execv(command[0], command)
    written = b""
    while True:
        try:
            part = os.read(terminal, 65536)
        except OSError:  # the program has ended
            break
        if not part:
            break
        written += part
    assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 0, written
    lines = []
    for raw in written.decode().split("\n"):
        line = ""
        for piece in raw.split("\r"):
            line = piece + line[len(piece) :]
        lines.append(line.rstrip())
    return [line for line in lines if line]


def test_the_bar_is_unbroken() -> None:
    lines = shown_on_a_terminal(sys.executable, "-c", PROGRAM)
    assert [lines[0], lines[1], lines[-1]] == ["one, of a library in C", "two, of Python", "after it"]
    assert len(lines) == 4 and lines[2].startswith("flying: 100 %|") and "10.0/10.0 s" in lines[2]
