"""Stand-ins for `launch` and `launch_ros`, which are not on the package index: enough to read our launch files."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

LAUNCH = Path(__file__).parents[1] / "launch"


class Recorded:
    """Anything that keeps what it was made with."""

    def __init__(self, *given: Any, **named: Any) -> None:
        self.given, self.named = given, named


class LaunchDescription(Recorded):
    @property
    def entities(self) -> list[Any]:
        return list(self.given[0])


class Source(Recorded):
    @property
    def path(self) -> Path:
        return Path(self.given[0])


def made(name: str) -> type[Recorded]:
    return type(name, (Recorded,), {})


NAMES: dict[str, dict[str, Any]] = {
    "launch": {"LaunchDescription": LaunchDescription},
    "launch.actions": {
        n: made(n)
        for n in ("DeclareLaunchArgument", "OpaqueFunction", "Shutdown", "GroupAction", "IncludeLaunchDescription")
    },
    "launch.launch_description_sources": {"PythonLaunchDescriptionSource": Source},
    "launch.substitutions": {"LaunchConfiguration": made("LaunchConfiguration")},
    "launch_ros": {},
    "launch_ros.actions": {"Node": made("Node")},
}


@contextmanager
def standing_in() -> Iterator[None]:
    """Put the stand-ins where the launch files import from."""
    before = {name: sys.modules.get(name) for name in NAMES}
    for name, content in NAMES.items():
        module = ModuleType(name)
        module.__dict__.update(content)
        sys.modules[name] = module
    try:
        yield
    finally:
        for name, old in before.items():
            sys.modules.pop(name)
            if old is not None:
                sys.modules[name] = old


def description(path: Path) -> tuple[Any, list[Any]]:
    """Return the module of a launch file and the entities that it describes."""
    with standing_in():
        spec = importlib.util.spec_from_file_location(path.stem.replace(".", "_"), path)
        assert spec is not None and spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module, module.generate_launch_description().entities


class Context:
    """The launch context of one start."""

    def __init__(self, configurations: dict[str, str]) -> None:
        self.launch_configurations = configurations


def started(path: Path, **arguments: str) -> list[dict[str, Any]]:
    """Return what each node of a launch file is started with."""
    module, entities = description(path)
    declared = {e.given[0]: e.named["default_value"] for e in entities if type(e).__name__ == "DeclareLaunchArgument"}
    assert not arguments.keys() - declared.keys()
    context = Context({**declared, **arguments})
    with standing_in():
        functions = [e.named["function"] for e in entities if type(e).__name__ == "OpaqueFunction"]
        del module
        return [node.named for function in functions for node in function(context)]
