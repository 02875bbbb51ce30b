"""What ./msls and the locks promise."""

from __future__ import annotations

import ast
import importlib.util
import os
import re
import shutil
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
    loader = SourceFileLoader("msls_script", str(ROOT / "msls_setup.py"))
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


SOURCES = ("msls", "msls_setup.py", "setup.py", "setup.cfg", "package.xml", "requirements.lock", "msg_defs", "config")


def copy_to(folder: Path) -> Path:
    """Copy what the set-up needs to begin; nothing of it is built."""
    folder.mkdir()
    for name in SOURCES:
        source = ROOT / name
        (shutil.copytree if source.is_dir() else shutil.copy2)(source, folder / name)
    return folder


def set_up(folder: Path, **environment: str) -> str:
    """Try to set up in a folder where it cannot be; return the one line it says."""
    env = {**os.environ, "PYTHON": sys.executable, **environment}
    done = subprocess.run(
        [sys.executable, str(folder / "msls"), "setup"], capture_output=True, text=True, env=env, check=False
    )
    said = [line for line in done.stderr.splitlines() if not line.startswith("msls [")]
    assert (done.returncode, done.stdout, len(said)) == (1, "", 1), done.stderr
    return said[0]


@pytest.mark.parametrize(("name", "found"), [("a b", "a space"), ("flüge", r"'\xfc'"), ("a;b", "';'"), ("a$b", "'$'")])
def test_a_path_in_which_nothing_can_be_built_is_refused_at_once(tmp_path: Path, name: str, found: str) -> None:
    folder = copy_to(tmp_path / name)
    assert set_up(folder) == (
        f"msls: {folder}: CMake and ROS cannot build in a path with {found}; move the folder elsewhere"
    )
    assert sorted(file.name for file in folder.iterdir() if file.name != "__pycache__") == sorted(SOURCES)


def test_a_folder_that_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    folder = copy_to(tmp_path / "tree")
    (folder / ".msls").symlink_to("/proc/nothing")
    assert re.fullmatch(rf"msls: {folder}/\.msls: .*; the set-up writes into {folder}", set_up(folder))


OFFLINE = {
    "pip": "WARNING: Retrying (Retry(total=0, ...)) after connection broken by 'NewConnectionError(...)': /simple/uv/",
    "quiet pip": "ERROR: Could not find a version that satisfies the requirement uv==0.9 (from versions: none)",
    "uv": "error: Failed to fetch: ...\n  Caused by: error sending request\n  Caused by: dns error: failed to lookup",
}


@pytest.mark.parametrize("tool", OFFLINE)
def test_without_a_network_one_line_says_so(
    script: ModuleType, tool: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(script, "LOG", tmp_path / "setup.log")
    code = f"import sys; print({OFFLINE[tool]!r}); sys.exit(1)"
    with (tmp_path / "lock").open("w") as lock:
        monkeypatch.setattr(script.Turn, "descriptor", lock.fileno())
        with pytest.raises(
            script.SetupError, match=r"^no network, or an index without the packages: pip failed"
        ) as caught:
            script.run_logged([sys.executable, "-c", code], dict(os.environ), "pip")
    assert caught.value.output == ""
    assert OFFLINE[tool] in (tmp_path / "setup.log").read_text()


@pytest.mark.parametrize("version", ["2.7", "3.8", "3.14"])
def test_another_python_is_refused_in_one_sentence(tmp_path: Path, version: str) -> None:
    other = tmp_path / "python"
    other.write_text(f'#!/bin/sh\necho \'["{version}", "cpython", true, true, "{other}"]\'\n')
    other.chmod(0o755)
    line = set_up(copy_to(tmp_path / "tree"), PYTHON=str(other))
    assert line.startswith(f"msls: {other} is cpython {version}, needed is CPython 3.10 to 3.13")


def test_an_old_python_that_runs_the_script_itself_says_one_sentence() -> None:
    code = "import runpy, sys; sys.version_info = (2, 7, 18); runpy.run_path(sys.argv[1], run_name='__main__')"
    done = subprocess.run([sys.executable, "-c", code, ROOT / "msls"], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr == "msls: this is Python 2.7; expected CPython 3.10 to 3.13: python3 ./msls ...\n"
    tree = ast.parse((ROOT / "msls").read_text(encoding="ascii"))
    modern = (ast.JoinedStr, ast.AnnAssign, ast.arg, ast.Starred, ast.NamedExpr, ast.AsyncFunctionDef)
    assert not [node for node in ast.walk(tree) if isinstance(node, modern)], "valid in Python 2"


@pytest.mark.parametrize("home", [None, "", "/proc/nothing"])
def test_without_a_home_what_is_kept_there_is_kept_here(
    script: ModuleType, home: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("HOME")
    if home is not None:
        monkeypatch.setenv("HOME", home)
    env = script.clean_environment()
    assert {env[name] for name in ("ROS_HOME", "UV_CACHE_DIR", "MPLCONFIGDIR")} == {
        str(ROOT / ".msls" / name) for name in ("ros", "uv", "matplotlib")
    }


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


def package(prefix: Path, name: str, python: str = "3.11", module: str = "") -> Path:
    """Install a package as colcon does; without a Python, one in C++ only."""
    (prefix / "share/ament_index/resource_index/packages").mkdir(parents=True, exist_ok=True)
    (prefix / "share/ament_index/resource_index/packages" / name).touch()
    if python:
        (prefix / f"lib/python{python}/site-packages" / (module or name)).mkdir(parents=True)
    return prefix


def test_the_workspaces_that_are_named_come_between_our_packages_and_our_ros(
    script: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    alone = [package(tmp_path / "isolated" / "px4_msgs", "px4_msgs"), package(tmp_path / "isolated" / "x", "x", "")]
    merged = package(package(tmp_path / "merged", "a_msgs"), "b_msgs")
    (tmp_path / "isolated" / "COLCON_IGNORE").touch()
    monkeypatch.setenv("MSLS_OVERLAY", f"{tmp_path}/isolated/:{merged}:")
    prefixes = script.overlay_prefixes("3.11")
    assert prefixes == [*alone, merged]
    env = script.overlay("3.11", prefixes)
    own = [script.INSTALL / "msls_ros", script.INSTALL / "msls_msgs"]
    assert env["AMENT_PREFIX_PATH"].split(":") == [*map(str, own), *map(str, prefixes), str(script.VENV)]
    libraries = [str(path / "lib") for path in (own[1], *prefixes, script.VENV)]
    assert env["LD_LIBRARY_PATH"].split(":")[: len(libraries)] == libraries
    sites = [str(path / "lib/python3.11/site-packages") for path in (*own, *prefixes)]
    assert env["PYTHONPATH"].split(":")[1:] == sites
    assert env["MSLS_OVERLAY"] == os.environ["MSLS_OVERLAY"], "a program may start ./msls again"
    monkeypatch.delenv("MSLS_OVERLAY")
    assert script.overlay_prefixes("3.11") == []
    assert script.overlay("3.11")["MSLS_OVERLAY"] == "", "a sign to programs that ./msls runs them"


@pytest.mark.parametrize(
    ("named", "said"),
    [
        ("nothing", r"{}/nothing is no folder; expected the install folder of a workspace"),
        ("empty", r"{}/empty holds no ROS package; expected the install folder of a workspace"),
        ("ws", r"{}/ws holds no ROS package; expected {}/ws/install"),
        ("ws/install", r"{}/ws/install/px4_msgs is built for Python 3\.12, expected Python 3\.11: colcon build"),
        ("cpp", r"{}/cpp holds no package for Python, expected one for Python 3\.11: colcon build"),
        ("ros", r"{}/ros holds a ROS of its own \(rclpy\)"),
        ("good:nothing", r"{}/nothing is no folder"),
    ],
)
def test_a_workspace_that_cannot_be_used_is_refused_in_one_sentence(
    script: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, named: str, said: str
) -> None:
    package(tmp_path / "ws/install/px4_msgs", "px4_msgs", "3.12")
    package(tmp_path / "cpp", "cpp", "")
    package(tmp_path / "ros", "rclpy")
    package(tmp_path / "good", "good")
    (tmp_path / "empty").mkdir()
    monkeypatch.setenv("MSLS_OVERLAY", ":".join(str(tmp_path / name) for name in named.split(":")))
    with pytest.raises(script.SetupError, match="^MSLS_OVERLAY: " + said.replace("{}", re.escape(str(tmp_path)))):
        script.overlay_prefixes("3.11")


def test_what_is_refused_is_one_line_but_not_to_the_setup_before_which_nothing_can_be_built(
    script: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("MSLS_OVERLAY", str(tmp_path / "nothing"))
    monkeypatch.setattr(script, "set_up", lambda: "3.11")
    assert script.main(["setup"]) == 0
    assert script.main(["python"]) == 1
    assert re.fullmatch(r"msls: MSLS_OVERLAY: .*\n", capsys.readouterr().err)


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


def test_what_programs_import_is_compiled_even_where_python_is_to_keep_nothing(
    script: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(script, "ROOT", tmp_path)
    monkeypatch.setattr(script, "LOG", tmp_path / "setup.log")
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")
    for name, text in {"made": "A = 1", "tests": "A = 1", "other_python": "print 1"}.items():
        folder = tmp_path / "tests" / "lib" / "site-packages" / "made" / name
        folder.mkdir(parents=True)
        (folder / "one.py").write_text(text)
    script.keep_bytecode(tmp_path / "tests" / "lib")
    assert [path.parents[1].name for path in tmp_path.rglob("*.pyc")] == ["made"]
    assert "other_python/one.py" in script.LOG.read_text()


WITHOUT_MESSAGES = """
import importlib, sys
class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == "msls_msgs":
            raise ModuleNotFoundError("No module named 'msls_msgs'", name="msls_msgs")
sys.meta_path.insert(0, Absent())
module = importlib.import_module(sys.argv.pop(1))
getattr(module, "main", bool)()
"""


NEED_MESSAGES = {
    "commands": ("controller", "demo", "identifier", "mixer", "pilot", "plant"),
    "nodes": ("controller", "identifier", "mixer", "pilot", "plant", "recorder", "watching"),
}


@pytest.mark.parametrize("name", ["testing", *(f"{room}.{n}" for room, own in NEED_MESSAGES.items() for n in own)])
def test_where_the_messages_are_not_built_it_is_said_how_to_build_them(name: str) -> None:
    command = [sys.executable, "-c", WITHOUT_MESSAGES, f"msls_ros.{name}", "--help"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert done.stderr.strip().splitlines()[-1].startswith("ImportError: the message package msls_msgs is not built")
    assert "./msls setup" in done.stderr


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
