"""The rooms stand on floors: each imports only rooms below it, no circle is anywhere, each has its own dependency."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "msls_ros"
TOP = "(top)"
"""Modules beside the rooms: `messages`, `records`, `testing`."""

BELOW = {
    "estimation": set[str](),
    "plant": set[str](),
    "bags": set[str](),
    "report": set[str](),
    "fleet": set[str](),
    "inputs": {"estimation"},
    "control": {"estimation"},
    "flights": {"plant", "inputs", "estimation", "control"},
    "campaigns": {"flights", "fleet"},
    "offline": {"bags", "inputs", "estimation", "control", "flights", "report"},
    "paper": {"flights", "report"},
    "nodes": {"inputs", "control", "plant", "bags", "flights", "offline"},
    "commands": {"nodes", "paper", "offline", "campaigns", "report", "fleet"},
}
"""The rooms that each may import; what those may import, it may too."""
MODULES = {
    "records": {"estimation", "control"},
    "messages": {"estimation", "control", "records"},
    "testing": {"nodes", "inputs", "estimation", "messages"},
}
"""The modules beside the rooms, and what they may import."""
USES_MODULES = {"nodes": {"messages"}, "offline": {"records"}}
ROS = {"rclpy", "msls_msgs", "lifecycle_msgs", "diagnostic_msgs", "rcl_interfaces", "ament_index_python"}
ROS |= {"rosgraph_msgs", "std_msgs", "std_srvs", "builtin_interfaces", "rosidl_runtime_py"}
OWN = {
    "estimation": {"numba"},
    "plant": {"jsbsim"},
    "bags": {"rosbags", "mcap", "zstandard", "lz4", "ruamel", "pyulog"},
    "report": {"matplotlib"},
    "fleet": {"dask", "distributed"},
    "inputs": {"yaml"},
    "control": {"numba"},
    "flights": {"yaml"},
    "campaigns": set[str](),
    "offline": set[str](),
    "paper": set[str](),
    "nodes": ROS,
    "commands": {"tqdm", "rclpy", "rich"},
}
"""Packages that each room imports besides numpy and the standard library."""
GROUND = [room for room, below in BELOW.items() if not below]
INDIRECT = {"fleet": {"yaml"}}
"""What a dependency imports in its turn: dask reads its own configuration with yaml."""


def reach(room: str) -> set[str]:
    """Return all rooms that a room may import, directly or through others."""
    found: set[str] = set()
    todo = set(BELOW[room])
    while todo:
        one = todo.pop()
        found.add(one)
        todo |= BELOW[one] - found
    return found


def files() -> Iterator[tuple[str, Path]]:
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = path.relative_to(PACKAGE).parts
        yield (parts[0] if len(parts) > 1 else TOP), path


def imports(path: Path) -> Iterator[tuple[str, ast.stmt]]:
    """Return the modules that a file imports; names imported from a package count as its modules where they are."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name, node
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0 and node.module, f"{path}: relative import"
            for alias in node.names:
                full = f"{node.module}.{alias.name}"
                yield (full if module_file(full) else node.module), node


def module_file(name: str) -> Path | None:
    """Return the file of one of our modules."""
    if name.partition(".")[0] != "msls_ros":
        return None
    base = PACKAGE.joinpath(*name.split(".")[1:])
    for path in (base.with_suffix(".py"), base / "__init__.py"):
        if path.is_file():
            return path
    return None


def test_every_room_of_the_table_is_there_and_no_other() -> None:
    assert {room for room, _ in files()} - {TOP} == set(BELOW) == set(OWN)


@pytest.mark.parametrize("room", sorted(BELOW))
def test_a_room_imports_only_rooms_below_it(room: str) -> None:
    allowed = reach(room) | {room}
    modules = set().union(*(USES_MODULES.get(one, set()) for one in allowed))
    for own, path in files():
        if own != room:
            continue
        for name, node in imports(path):
            if name.startswith("msls_ros."):
                target = name.split(".")[1]
                found = target in (modules if target in MODULES else allowed)
                assert found, f"{path.name}:{node.lineno} imports {name}"


@pytest.mark.parametrize("name", sorted(MODULES))
def test_a_module_beside_the_rooms_imports_what_it_may(name: str) -> None:
    for found, node in imports(PACKAGE / f"{name}.py"):
        if found.startswith("msls_ros."):
            assert found.split(".")[1] in MODULES[name], f"{name}.py:{node.lineno} imports {found}"


@pytest.mark.parametrize("room", sorted(BELOW))
def test_a_room_has_its_own_dependency_and_no_other(room: str) -> None:
    allowed = {*OWN[room], "numpy", "msls_ros", "__future__", *sys.stdlib_module_names}
    if room == "commands":  # one file each, which may need what its room needs
        allowed.add("benchmarks")
    for own, path in files():
        if own == room:
            for name, node in imports(path):
                assert name.partition(".")[0] in allowed, f"{path.name}:{node.lineno} imports {name}"


def test_folders_of_a_room_know_nothing_of_each_other_nor_of_what_calls_them() -> None:
    """Each stands on files of its room that know of no folder."""
    found: dict[Path, set[Path]] = {}
    for _, path in files():
        found[path] = {one for name, _ in imports(path) if (one := module_file(name)) and one.name != "__init__.py"}
    inner = [path for path in found if len(path.relative_to(PACKAGE).parts) > 2]
    assert {path.parent.name for path in inner} == {"bank", "dither"}
    for path in inner:
        todo, known = list(found[path]), set[Path]()
        while todo:
            one = todo.pop()
            assert one.parent == path.parent or one not in inner, f"{path} knows {one}"
            if one.parent != path.parent:
                todo += found[one] - known
                known |= found[one]


def test_no_circle_is_anywhere() -> None:
    edges: dict[Path, set[Path]] = {}
    for _, path in files():
        edges[path] = {found for name, _ in imports(path) if (found := module_file(name))} - {path}
        if path.name == "__init__.py":
            continue
        edges[path] -= {path.parent / "__init__.py"}
    done: set[Path] = set()
    trail: list[Path] = []

    def visit(path: Path) -> None:
        assert path not in trail, " -> ".join(str(p.relative_to(PACKAGE)) for p in [*trail[trail.index(path) :], path])
        if path in done:
            return
        trail.append(path)
        for further in sorted(edges[path]):
            visit(further)
        trail.pop()
        done.add(path)

    for path in sorted(edges):
        visit(path)


@pytest.mark.parametrize("room", sorted(BELOW))
def test_the_face_of_a_room_says_what_it_is_for(room: str) -> None:
    text = ast.get_docstring(ast.parse((PACKAGE / room / "__init__.py").read_text(encoding="utf-8")))
    assert text, room
    if room != "commands":
        assert "This room imports" in text and "Begin with" in text, f"{room}: say what it may import, where to begin"


def import_without(forbidden: Iterable[str], modules: Iterable[str]) -> None:
    """Import modules in a process of their own where some packages are not installed."""
    code = (
        "import sys, importlib\n"
        "class Absent:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        f"        if name.split('.')[0] in {sorted(forbidden)}:\n"
        "            raise ModuleNotFoundError(name)\n"
        "sys.meta_path.insert(0, Absent())\n"
        f"for name in {list(modules)}:\n"
        "    importlib.import_module(name)\n"
    )
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=PACKAGE.parent, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("room", GROUND)
def test_a_room_of_the_ground_floor_runs_with_nothing_of_the_others_installed(room: str) -> None:
    forbidden = set().union({"scipy", "tqdm"}, *OWN.values()) - OWN[room] - INDIRECT.get(room, set())
    paths = [path.relative_to(PACKAGE.parent).with_suffix("") for own, path in files() if own == room]
    import_without(forbidden, [".".join(path.parts).removesuffix(".__init__") for path in paths])


FLIGHT = ROS | OWN["estimation"] | OWN["inputs"]
NEEDED = {"identifier": FLIGHT | OWN["bags"], "mixer": FLIGHT, "recorder": FLIGHT | OWN["bags"], "watching": FLIGHT}
"""What the nodes of a stack need that has no simulator; messages are filled and decoded by the room of the bags."""


@pytest.mark.parametrize("node", sorted(NEEDED))
def test_a_node_of_a_stack_runs_with_nothing_installed_that_it_does_not_need(node: str) -> None:
    forbidden = set().union({"scipy"}, *OWN.values()) - NEEDED[node]
    import_without(forbidden, [f"msls_ros.nodes.{node}", "msls_ros.nodes.running", "msls_ros.commands.node_help"])


def test_every_room_is_installed() -> None:
    declared = re.search(r"^ROOMS = \[(.*?)\]", (PACKAGE.parent / "setup.py").read_text(encoding="utf-8"), re.M | re.S)
    assert declared is not None
    folders = {".".join(path.relative_to(PACKAGE).parent.parts) for _, path in files() if path.parent != PACKAGE}
    assert set(re.findall(r'"([\w.]+)"', declared.group(1))) == folders
