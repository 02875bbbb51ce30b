"""The launch files: described arguments, executables and parameters that exist; for real where launch is installed."""

from __future__ import annotations

import ast
import importlib.util
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import yaml
from launch_standins import LAUNCH, description, started
from msls_msgs.msg import LinearModel, StateSample
from rosgraph_msgs.msg import Clock

from msls_ros import messages
from msls_ros.nodes import control_parameters, identifier, pilot, plant, recorder
from msls_ros.testing import Bench

FILES = sorted(LAUNCH.glob("*.launch.py"))
WANTED = {"namespace", "params_file", "inputs", "autostart", "respawn", "log_level", "use_sim_time", "record"}
TABLES: dict[str, Any] = {
    "identifier": identifier.PARAMETERS,
    "pilot": pilot.PARAMETERS,
    "plant": plant.PARAMETERS,
    "recorder": recorder.PARAMETERS,
    "controller": control_parameters.PARAMETERS,
}
HAVE_LAUNCH = importlib.util.find_spec("launch") is not None and importlib.util.find_spec("launch_ros") is not None
SINGLE = [path for path in FILES if path.name != "two_aircraft.launch.py"]


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.stem)
def test_every_argument_is_described(path: Path) -> None:
    _, entities = description(path)
    declared = {e.given[0]: e.named for e in entities if type(e).__name__ == "DeclareLaunchArgument"}
    assert path not in SINGLE or declared.keys() >= WANTED
    assert all(len(named["description"]) > 10 and "default_value" in named for named in declared.values())


@pytest.mark.parametrize("path", SINGLE, ids=lambda p: p.stem)
@pytest.mark.parametrize("namespace", ["", "left"])
def test_nodes_parameters_and_files_exist(path: Path, namespace: str) -> None:
    nodes = started(path, namespace=namespace, record="flight", respawn="true", use_sim_time="true")
    setup = ast.parse((LAUNCH.parent / "setup.py").read_text())
    values = [n.value for n in setup.body if isinstance(n, ast.Assign) and ast.unparse(n.targets[0]) == "EXECUTABLES"]
    executables = ast.literal_eval(values[0])
    for node in nodes:
        assert node["package"] == "msls_ros" and node["executable"] in executables
        assert node["namespace"] == namespace and node["respawn"] is True
        assert node["remappings"] == ([("/clock", "clock")] if namespace else [])
        for given in node["parameters"]:
            if isinstance(given, str):
                assert yaml.safe_load(Path(given).read_text())["/**"]["ros__parameters"]
            else:
                assert not given.keys() - {*TABLES[node["executable"]], "use_sim_time"}
    assert {n["executable"] for n in nodes} >= {"identifier", "recorder"}
    assert len({n["name"] for n in nodes}) == len(nodes)


@pytest.mark.parametrize("inputs", ["", "odometry_jointstate"])
def test_the_shipped_parameter_files_of_a_start_fit_together(bench: Bench, inputs: str) -> None:
    (node,) = started(LAUNCH / "identifier.launch.py", inputs=inputs)
    files = [given for given in node["parameters"] if isinstance(given, str)]
    arguments = ["--ros-args", *(word for path in files for word in ("--params-file", path))]
    bench.adopt(identifier.IdentifierNode(context=bench.context, cli_args=arguments))


@pytest.mark.parametrize("inputs", ["", "odometry_jointstate"])
def test_a_recorder_is_given_what_the_identifier_is_given_for_its_bag_to_replay(inputs: str) -> None:
    nodes = {one["name"]: one for one in started(LAUNCH / "identifier.launch.py", inputs=inputs, record="flight")}
    files = [given for given in nodes["identifier"]["parameters"] if isinstance(given, str)]
    assert files and nodes["recorder"]["parameters"] == [*files, {"out": "flight"}]


def test_the_noise_that_is_offered_is_what_the_plant_takes() -> None:
    module, _ = description(LAUNCH / "closed_loop.launch.py")
    _, _, offered = module.ARGUMENTS["noise"][1].partition(": ")
    assert tuple(offered.replace(" or ", ", ").split(", ")) == plant.PARAMETERS["noise"][1].choices


@pytest.mark.parametrize("said", [True, False])
def test_what_a_parameter_file_says_holds_unless_an_argument_is_given(bench: Bench, tmp_path: Path, said: bool) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump({"/**": {"ros__parameters": {"use_sim_time": said, "autostart": not said}}}))
    (node,) = started(LAUNCH / "identifier.launch.py", params_file=str(path))
    assert node["parameters"] == [str(path)]
    arguments = ["--ros-args", "--params-file", str(path)]
    made = bench.adopt(identifier.IdentifierNode(context=bench.context, cli_args=arguments))
    assert [made.get_parameter(name).value for name in ("use_sim_time", "autostart")] == [said, not said]
    given = {"use_sim_time": str(not said).lower(), "autostart": str(said).lower()}
    (node,) = started(LAUNCH / "identifier.launch.py", params_file=str(path), **given)
    assert node["parameters"] == [str(path), {"use_sim_time": not said, "autostart": said}]


def test_in_closed_loop_the_start_is_as_the_file_says_and_time_the_plant_s() -> None:
    nodes = {one["name"]: one for one in started(LAUNCH / "closed_loop.launch.py", law="lq")}
    own = {"use_sim_time": True, "lockstep": False}
    assert nodes["identifier"]["parameters"][1:] == [own]
    assert nodes["controller"]["parameters"] == [{"law": "lq", "condition": "high_alpha", **own}]
    (first, *_) = started(LAUNCH / "closed_loop.launch.py", autostart="false", use_sim_time="")
    assert first["parameters"][1:] == [{"autostart": False, "lockstep": False}]


def test_a_law_puts_a_controller_between_pilot_and_plant() -> None:
    nodes = {one["name"]: one for one in started(LAUNCH / "closed_loop.launch.py", law="auto", record="flight")}
    assert nodes["controller"]["parameters"][0]["law"] == "auto"
    assert nodes["pilot"]["parameters"][0]["ask"] is True
    assert {"pilot_command", "control_status"} < set(nodes["recorder"]["parameters"][-1]["topics"])
    assert "controller" not in {one["name"] for one in started(LAUNCH / "closed_loop.launch.py")}


def test_two_aircraft_are_two_namespaces_with_shipped_profiles() -> None:
    module, entities = description(LAUNCH / "two_aircraft.launch.py")
    assert len([e for e in entities if type(e).__name__ == "GroupAction"]) == len(module.AIRCRAFT) == 2
    for name, given in module.AIRCRAFT.items():
        assert started(LAUNCH / "closed_loop.launch.py", namespace=name, **given)


RUN = """
import sys
from launch import LaunchDescription, LaunchService
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
given = dict(a.split(":=", 1) for a in sys.argv[2:]).items()
service = LaunchService()
source = PythonLaunchDescriptionSource(sys.argv[1])
service.include_launch_description(LaunchDescription([IncludeLaunchDescription(source, launch_arguments=given)]))
sys.exit(service.run())
"""


@contextmanager
def launched(bench: Bench, name: str, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    """Run a launch file with the real launch; its end is by SIGINT, as from a terminal."""
    process = subprocess.Popen(
        [sys.executable, "-c", RUN, str(LAUNCH / f"{name}.launch.py"), *arguments],
        env={**os.environ, "ROS_DOMAIN_ID": str(bench.domain)},
        text=True,
        stderr=subprocess.STDOUT,
        stdout=subprocess.PIPE,
        start_new_session=True,
    )
    try:
        yield process
    finally:
        os.killpg(process.pid, signal.SIGINT)
        out, _ = process.communicate(timeout=60)
        assert "Traceback" not in out, out


@pytest.mark.skipif(not HAVE_LAUNCH, reason="launch is not installed: it is not on the package index")
def test_two_aircraft_fly_at_once_without_crosstalk_each_with_its_own_clock(bench: Bench) -> None:
    models: dict[str, list[LinearModel]] = {name: [] for name in ("left", "right")}
    states: dict[str, list[StateSample]] = {name: [] for name in models}
    clocks: dict[str, list[Clock]] = {name: [] for name in models}
    for name in models:
        bench.probe.create_subscription(LinearModel, f"/{name}/model", models[name].append, 10)
        bench.probe.create_subscription(StateSample, f"/{name}/state", states[name].append, 10)
        bench.probe.create_subscription(Clock, f"/{name}/clock", clocks[name].append, 10)
    with launched(bench, "two_aircraft"):
        bench.spin_until(lambda: all(len(m) > 100 for m in models.values()), "models of both")
        assert bench.probe.count_publishers("/clock") == 0
    for name in models:
        assert clocks[name] and messages.stamp_of(models[name][-1]) <= messages.stamp_of(states[name][-1])
    speeds = {name: [s.x[0] for s in found] for name, found in states.items()}
    assert max(speeds["left"]) < 100.0 < min(speeds["right"])
    assert max(m.samples for m in models["left"]) >= 100
