"""Tasks for worker processes, which import this module: it imports nothing but the standard library."""

from __future__ import annotations

import os
import signal
import threading
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Task:
    index: int
    folder: Path
    """Every beginning of a task leaves a file there."""
    victim: int = -1
    """This one, at its first beginning, writes its process to the pipe in the folder and waits for its end."""


class Refusal(Exception):
    """What a task may raise."""


def begun(folder: Path, index: int) -> list[int]:
    """Return the processes in which a task has begun, sorted."""
    return sorted(int(path.suffix[1:]) for path in folder.glob(f"{index}.*"))


def square(task: Task) -> int:
    first = not begun(task.folder, task.index)
    (task.folder / f"{task.index}.{os.getpid()}").touch()
    if first and task.index == task.victim:
        with (task.folder / "pipe").open("w") as pipe:
            pipe.write(str(os.getpid()))
        threading.Event().wait()
    threading.Event().wait(0.03)
    return task.index**2


def deadly_three(task: Task) -> int:
    if task.index == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return square(task)


def refusing(task: Task) -> int:
    if task.index % 2:
        message = f"{task.index} is odd"
        raise Refusal(message)
    if task.index == 4:
        raise KeyError(task.index)
    return task.index


def endless_after_zero(task: Task) -> int:
    if task.index:
        threading.Event().wait()
    return os.getpid()
