"""What ./msls and the locks promise."""

from __future__ import annotations

import ast
import importlib.util
import re
import subprocess
import sys
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parent.parent
LOCKS = ["requirements.lock", "requirements-benchmark.lock"]


def msls(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, str(ROOT / "msls"), *arguments], capture_output=True, text=True, check=False)


@pytest.fixture
def script() -> ModuleType:
    loader = SourceFileLoader("msls_script", str(ROOT / "msls"))
    spec = importlib.util.spec_from_loader("msls_script", loader)
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    loader.exec_module(module)
    return module


def pins(lock: str) -> dict[str, list[str]]:
    """Names and their requirement blocks, one per environment marker."""
    blocks: dict[str, list[str]] = {}
    for block in re.split(r"\n(?=[^\s#])", "\n" + (ROOT / lock).read_text()):
        if "==" in block.splitlines()[0]:
            blocks.setdefault(block.split("==")[0], []).append(block)
    return blocks


def test_without_arguments_msls_prints_help() -> None:
    done = msls()
    assert done.returncode == 0
    assert done.stdout.startswith("usage: ./msls")
    assert done.stderr == ""


def test_an_unknown_executable_is_refused_in_one_line() -> None:
    done = msls("no_such_thing")
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1
    assert "no_such_thing" in done.stderr


def test_every_executable_has_a_module_with_a_main(script: ModuleType) -> None:
    for name in script.executables():
        tree = ast.parse((ROOT / "msls_ros" / "commands" / f"{name}.py").read_text())
        assert any(isinstance(node, ast.FunctionDef) and node.name == "main" for node in tree.body), name
        assert ast.get_docstring(tree), name


def test_another_ros_does_not_leak_in(script: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    other = "/opt/ros/humble"
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"/some/where/ws/install:{other}")
    monkeypatch.setenv("CMAKE_PREFIX_PATH", other)
    monkeypatch.setenv("PYTHONPATH", f"{other}/lib/python3.10/site-packages")
    monkeypatch.setenv("LD_LIBRARY_PATH", f"{other}/lib:/some/where/ws/install/lib:/usr/lib/kept")
    monkeypatch.setenv("PATH", f"{other}/bin:/usr/bin:/bin")
    monkeypatch.setenv("RMW_IMPLEMENTATION", "rmw_cyclonedds_cpp")
    monkeypatch.setenv("ROS_DISTRO", "humble")
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    env = script.clean_environment()
    assert "humble" not in str({name: value for name, value in env.items() if name not in ("PWD", "OLDPWD")})
    assert env["PATH"] == "/usr/bin:/bin"
    assert env["LD_LIBRARY_PATH"] == "/usr/lib/kept"
    assert {"AMENT_PREFIX_PATH", "PYTHONPATH", "RMW_IMPLEMENTATION"}.isdisjoint(env)
    assert env["ROS_DOMAIN_ID"] == "7"


@pytest.mark.parametrize(
    ("edited", "rebuilt"),
    [
        ("msls_ros/estimation/kernel.py", set()),
        ("config/any.yaml", set()),
        ("config/new.yaml", {"msls_ros"}),
        ("setup.py", {"msls_ros"}),
        ("msg_defs/msg/FaultEvent.msg", {"msls_msgs"}),
        ("msg_defs/srv/New.srv", {"msls_msgs"}),
    ],
)
def test_an_edit_rebuilds_what_it_must(
    script: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, edited: str, rebuilt: set[str]
) -> None:
    for name in ["setup.py", "setup.cfg", "package.xml", "msg_defs/msg/FaultEvent.msg", "config/any.yaml"]:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("before")
    monkeypatch.setattr(script, "ROOT", tmp_path)
    before = script.wanted_builds({})
    (tmp_path / edited).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / edited).write_text("after")
    after = script.wanted_builds({})
    assert {name for name in before if before[name] != after[name]} == rebuilt


@pytest.mark.parametrize("lock", LOCKS)
def test_every_pin_has_hashes(lock: str) -> None:
    blocks = pins(lock)
    assert len(blocks) > 15
    for name, found in blocks.items():
        for block in found:
            assert re.search(r"--hash=sha256:[0-9a-f]{64}\b", block), name


@pytest.mark.parametrize("lock", LOCKS)
def test_the_lock_holds_what_the_input_asks_for(lock: str) -> None:
    locked = pins(lock)
    for line in (ROOT / lock).with_suffix(".in").read_text().splitlines():
        wanted = re.match(r"([a-z][\w-]*)(?:\[\w+\])?(?:==([\w.]+))?", line)
        if wanted:
            name, version = wanted.groups()
            assert name in locked, line
            assert version is None or locked[name][0].split()[0].split("==")[1] == version, line


def test_the_benchmarks_change_no_version_of_the_main_lock() -> None:
    main, more = (pins(lock) for lock in LOCKS)
    versions = [
        {name: [block.splitlines()[0] for block in lock[name]] for name in more if name in main}
        for lock in (main, more)
    ]
    assert "numpy" in versions[0]
    assert versions[0] == versions[1]


def test_no_file_names_this_machine_or_a_registry() -> None:
    hosts = ["pypi" + ".org", "python" + "hosted.org", "crates" + ".io", "proxy.golang" + ".org", "anaconda" + ".org"]
    paths = ["/root" + "/", "/home" + "/", "/Users" + "/"]
    if len(ROOT.parts) > 2:
        paths.append(str(ROOT))
    made = {"build", "install", "log", "out"}
    tops = [ROOT / ".ci", *(top for top in ROOT.iterdir() if top.name not in made and top.name[0] != ".")]
    for path in [path for top in tops for path in [top, *top.rglob("*")]]:
        if path.is_file() and "__pycache__" not in path.parts:
            text = path.read_bytes().decode("utf-8", errors="ignore")
            assert not [word for word in [*hosts, *paths] if word in text], path
