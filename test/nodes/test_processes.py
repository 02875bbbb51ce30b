"""The executables: wrong usage is one line and exit code 2; told to stop, they end with 0; they fly together."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from msls_msgs.msg import DitherCommand, LinearModel

from msls_ros.bags import BagError, BagWriter
from msls_ros.commands.node_help import run_or_help
from msls_ros.inputs.profiles import config_folder
from msls_ros.nodes import identifier, pilot, plant, recorder
from msls_ros.testing import Bench

Process = subprocess.Popen[str]
PROFILE = str(config_folder() / "f16.yaml")
LIMIT = 60
NODES: dict[str, tuple[Any, Any]] = {
    "identifier": (identifier.IdentifierNode, identifier.PARAMETERS),
    "plant": (plant.PlantNode, plant.PARAMETERS),
    "pilot": (pilot.PilotNode, pilot.PARAMETERS),
    "recorder": (recorder.RecorderNode, recorder.PARAMETERS),
}


def launch(name: str, *arguments: str, domain: int = 0, folder: Path | None = None) -> Process:
    code = f"import sys; from msls_ros.commands.{name} import main; sys.exit(main())"
    environment = {**os.environ, "ROS_DOMAIN_ID": str(domain), "PYTHONWARNINGS": "ignore"}
    return subprocess.Popen(
        [sys.executable, "-c", code, *arguments],
        env=environment,
        cwd=folder,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )


WRONG = {
    "a value out of range": (["identifier", "-p", "estimator.forgetting_factor:=2.0"], "[0.01, 1]"),
    "a word that is no choice": (["identifier", "-p", "estimator.method:=magic"], "one of bank, msls, rls"),
    "a condition that does not exist": (["plant", "-p", "condition:=moon"], "one of high_alpha, cruise"),
    "a manoeuvre that does not exist": (["pilot", "-p", "manoeuvre:=loop"], "one of roll_doublet, steady"),
    "a parameter file that is missing": (["identifier", "--params-file", "missing.yaml"], "missing.yaml"),
    "a parameter file that is no YAML": (["identifier", "--params-file", "broken.yaml"], "broken.yaml"),
    "an override that cannot be read": (["plant", "-p", "seed"], "seed"),
    "an option of ROS that is misspelt": (
        ["identifier", "--parms-file", "x.yaml"],
        "ROS does not know '--parms-file x.yaml'; expected",
    ),
    "a bag that exists": (["recorder", "-p", "out:=there"], "exists"),
    "a bag that cannot be written": (["recorder", "-p", "out:=broken.yaml/bag"], "broken.yaml"),
}


@pytest.mark.parametrize("what", WRONG)
def test_wrong_usage_is_one_clear_line_and_exit_code_2(
    what: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "broken.yaml").write_text("identifier:\n  ros__parameters: [1, {\n")
    (tmp_path / "there").mkdir()
    monkeypatch.chdir(tmp_path)
    (name, *rest), expected = WRONG[what]
    kind, table = NODES[name]
    interrupt = signal.getsignal(signal.SIGINT)
    try:
        code = run_or_help(name, kind, table, ["--ros-args", *rest])
    finally:
        signal.signal(signal.SIGINT, interrupt)
    out, err = capfd.readouterr()
    assert (code, out) == (2, "")
    assert len(err.splitlines()) == 1, err
    assert expected in err


def test_a_disk_that_fills_is_one_line_and_exit_code_2(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def full(*_: Any) -> None:
        message = "flight: No space left on device"
        raise BagError(message)

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(recorder.RecorderNode, "_write", full)
    monkeypatch.setattr(BagWriter, "flush", full)
    monkeypatch.setattr(BagWriter, "close", full)
    monkeypatch.setattr(BagWriter, "__init__", lambda *_, **__: None)
    monkeypatch.setattr(BagWriter, "counts", {})
    monkeypatch.setattr(BagWriter, "add_topic", lambda *_, **__: None)
    interrupt = signal.getsignal(signal.SIGINT)
    try:
        code = run_or_help("recorder", *NODES["recorder"], ["--ros-args"])
    finally:
        signal.signal(signal.SIGINT, interrupt)
    assert code == 2
    said = [line for line in capfd.readouterr().err.splitlines() if not line.startswith("[INFO]")]
    assert said == ["msls_ros: flight: No space left on device"]


def test_wrong_usage_is_so_for_a_process_too() -> None:
    process = launch("identifier", "--ros-args", "--params-file", "missing.yaml")
    out, err = process.communicate(timeout=LIMIT)
    assert (process.returncode, out) == (2, "")
    assert err.splitlines() == [
        "msls_ros: Couldn't parse params file: '--params-file missing.yaml'. Error: Error opening YAML file"
    ]


def test_unknown_arguments_are_one_line_and_exit_code_2(capfd: pytest.CaptureFixture[str]) -> None:
    assert run_or_help("plant", *NODES["plant"], ["--fast"]) == 2
    assert capfd.readouterr().err == "plant: unknown argument '--fast'; expected --ros-args ... or --help\n"


@pytest.mark.parametrize("name", ["identifier", "plant", "pilot", "recorder"])
def test_help_lists_the_parameters_and_leaves_nothing_behind(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run_or_help(name, *NODES[name], ["--help"]) == 0
    out, err = capfd.readouterr()
    assert err == ""
    assert "fixed at the start" in out
    assert all(f"\n  {parameter}: " in out for parameter in NODES[name][1])
    assert list(tmp_path.iterdir()) == []


def ended(*processes: Process) -> bool:
    return any(process.poll() is not None for process in processes)


@pytest.fixture
def fleet(bench: Bench, tmp_path: Path) -> Iterator[dict[str, Process]]:
    """Plant, pilot, identifier and recorder as processes of their own, in flight."""
    given = {
        "identifier": ["--params-file", PROFILE, "-p", "use_sim_time:=true"],
        "pilot": [],
        "recorder": ["-p", "out:=bag"],
        "plant": ["-p", "time_out:=60.0"],
    }
    with ExitStack() as stack:
        started = {n: launch(n, "--ros-args", *a, domain=bench.domain, folder=tmp_path) for n, a in given.items()}
        for process in started.values():
            stack.callback(process.wait)
            stack.callback(process.kill)
        yield started


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM], ids=["SIGINT", "SIGTERM"])
def test_told_to_stop_in_flight_they_end_with_0_and_without_a_traceback(
    bench: Bench, fleet: dict[str, Process], how: signal.Signals
) -> None:
    model: list[LinearModel] = bench.listen(LinearModel, "model")
    dither: list[DitherCommand] = bench.listen(DitherCommand, "dither")
    bench.spin_until(lambda: len(model) >= 100 or ended(*fleet.values()), "models of a flight in five processes")
    for name, process in fleet.items():
        assert process.poll() is None, (name, process.communicate())
    assert any(any(d.delta) for d in dither)
    for process in fleet.values():
        process.send_signal(how)
    for name, process in fleet.items():
        _, err = process.communicate(timeout=LIMIT)
        assert process.returncode == 0, (name, err)
        assert "Traceback" not in err, (name, err)
        assert "terminate called" not in err, (name, err)
