"""Many runs side by side: each task ends exactly once, whatever becomes of the processes that run it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import psutil  # type: ignore[import-untyped]
import pytest
from fleet import fleet_tasks
from fleet.fleet_tasks import Refusal, Task, begun
from offline.replayed import BAGS, assert_same, outputs
from offline.replayed import run as run_replay

from msls_ros.commands import campaign, replay
from msls_ros.fleet import Done, FleetError, run
from msls_ros.fleet.work import Attempt, running_code

FLIGHTS = ["cruise_fault", "intact_doublet", "tail_fault"]


def tasks(folder: Path, count: int, victim: int = -1) -> list[Task]:
    return [Task(index, folder, victim) for index in range(count)]


def run_and_kill(todo: Sequence[Task], **how: Any) -> tuple[list[Done], int]:
    """Run tasks; kill the process of the victim as soon as that has begun and another task is done."""
    some_done = threading.Event()
    killed: list[int] = []
    os.mkfifo(todo[0].folder / "pipe")

    def kill() -> None:
        pid = int((todo[0].folder / "pipe").read_text())
        some_done.wait()
        os.kill(pid, signal.SIGKILL)
        killed.append(pid)

    killer = threading.Thread(target=kill, daemon=True)
    killer.start()
    ends = []
    for end in run(fleet_tasks.square, todo, **how):
        ends.append(end)
        some_done.set()
    killer.join()
    return ends, killed[0]


def assert_each_once(ends: Sequence[Done], count: int) -> None:
    ordered = sorted(ends, key=lambda end: end.index)
    assert ordered == [Done(index, index**2, None) for index in range(count)]


def test_processes_on_this_machine_listen_to_this_machine_alone(tmp_path: Path) -> None:
    ends = run(fleet_tasks.square, tasks(tmp_path, 4), jobs=2)
    next(ends)
    us = psutil.Process()
    found = [
        c for one in [us, *us.children(recursive=True)] for c in one.net_connections("tcp") if c.status == "LISTEN"
    ]
    assert {c.laddr.ip for c in found} <= {"127.0.0.1", "::1"}, found
    assert len(found) >= 3, "a scheduler and two workers"
    assert len(list(ends)) == 3


def test_the_help_says_that_a_scheduler_is_trusted_and_names_tls() -> None:
    for command in (campaign, replay):
        text = " ".join(command.parser().format_help().split())
        assert "Trust it" in text and "pickle" in text and "tls://" in text


def test_a_killed_worker_of_a_cluster_costs_nothing_but_time(
    scheduler: str, worker: Callable[..., int], tmp_path: Path
) -> None:
    workers = sorted(worker() for _ in range(2))
    ends, killed = run_and_kill(tasks(tmp_path, 30, victim=7), scheduler=scheduler)
    assert_each_once(ends, 30)
    assert killed in workers
    assert begun(tmp_path, 7) == workers
    assert all(set(begun(tmp_path, index)) <= set(workers) for index in range(30))


def test_a_killed_worker_of_this_machine_costs_nothing_but_time(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    ends, killed = run_and_kill(tasks(tmp_path, 30, victim=7), jobs=2)
    assert_each_once(ends, 30)
    processes = {pid for index in range(30) for pid in begun(tmp_path, index)}
    assert killed in begun(tmp_path, 7) and len(begun(tmp_path, 7)) == 2
    assert os.getpid() not in processes
    assert capfd.readouterr() == ("", "")


def test_a_task_that_kills_its_workers_ends_with_an_error_and_the_others_do_not(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    ends = list(run(fleet_tasks.deadly_three, tasks(tmp_path, 8), jobs=2))
    (error,) = [end for end in ends if end.error]
    assert error.index == 3 and error.result is None
    assert "the worker process died 2 times with this task alone" in str(error.error)
    assert sorted(end.index for end in ends) == list(range(8))
    assert all(end.result == end.index**2 for end in ends if end is not error)
    assert capfd.readouterr() == ("", "")


def test_what_is_closed_early_leaves_no_process(tmp_path: Path) -> None:
    ends = run(fleet_tasks.endless_after_zero, tasks(tmp_path, 100), jobs=2)
    pid = next(ends).result
    assert isinstance(pid, int) and pid != os.getpid()
    os.kill(pid, 0)
    ends.close()
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


@pytest.mark.parametrize("jobs", [1, 2])
def test_expected_exceptions_are_errors_and_others_end_the_run(tmp_path: Path, jobs: int) -> None:
    ends: list[Done] = []
    with pytest.raises(KeyError):
        for end in run(fleet_tasks.refusing, tasks(tmp_path, 5), jobs=jobs, expected=(Refusal,)):
            ends.append(end)
    wanted = [Done(0, 0, None), Done(1, None, "1 is odd"), Done(2, 2, None), Done(3, None, "3 is odd")]
    assert {end.index for end in ends} >= ({0, 1, 2, 3} if jobs == 1 else {0, 1})
    assert all(end == wanted[end.index] for end in ends)


def test_one_job_runs_in_this_process_without_dask() -> None:
    code = (
        "import sys; from msls_ros.fleet import run\n"
        "assert [end.result for end in run(len, ['a', 'bb'])] == [1, 2]\n"
        "assert not {'dask', 'distributed'} & sys.modules.keys()"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize(
    ("address", "sentence"),
    [
        ("nonsense", "'nonsense' is no address; expected tcp://HOST:PORT"),
        ("tcp://127.0.0.1:1", "tcp://127.0.0.1:1: no answer within 0.5 s; expected a Dask scheduler there"),
    ],
)
def test_a_wrong_address_is_refused(address: str, sentence: str) -> None:
    with pytest.raises(FleetError, match=sentence):
        list(run(len, ["a"], scheduler=address, patience=0.5))


def test_a_scheduler_without_workers_is_given_up(scheduler: str) -> None:
    with pytest.raises(FleetError, match=r"no worker for 0.5 s; expected some, as `dask worker` starts them"):
        list(run(len, ["a"], scheduler=scheduler, patience=0.5))


def test_a_worker_that_lacks_this_package_is_refused(
    scheduler: str, worker: Callable[..., int], tmp_path: Path
) -> None:
    (tmp_path / "msls_ros").mkdir()
    (tmp_path / "msls_ros" / "__init__.py").touch()
    worker(path=str(tmp_path))
    with pytest.raises(FleetError, match=r"cannot run this .*No module named 'msls_ros.fleet'.*; expected msls_ros"):
        list(run(len, ["a"], scheduler=scheduler))


def test_a_process_of_other_code_is_refused() -> None:
    task = Attempt(len, "abc", 0, (), running_code())
    assert task() == Done(0, 3, None)
    with pytest.raises(FleetError, match=r"a worker runs msls_ros with sources \w+ on Python .*, expected .*other"):
        replace(task, code="other")()


def test_replay_of_many_bags_gives_the_same_with_two_jobs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    told = []
    (tmp_path / "none").mkdir()
    bags = [BAGS / FLIGHTS[0], tmp_path / "none", *(BAGS / name for name in FLIGHTS[1:])]
    for jobs in (1, 2):
        place = tmp_path / str(jobs)
        code, out, err = run_replay(capsys, *bags, "--out", place, "--json", "--jobs", jobs)
        assert code == 2
        told.append((json.loads(out), err))
        for result in told[-1][0]:
            assert result.pop("out", f"{place}/").startswith(f"{place}/")
            result.pop("wall_time_s", None), result.pop("samples_per_s", None)
    assert told[0] == told[1]
    assert [Path(result["bag"]).name for result in told[0][0]] == [path.name for path in bags]
    assert [result.get("samples") for result in told[0][0]] == [601, None, 601, 601]
    for name in FLIGHTS:
        one, two = (outputs(tmp_path / str(jobs) / name) for jobs in (1, 2))
        assert_same(one, two)
        assert len(one["/model"]) == 601
