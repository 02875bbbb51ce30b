"""After the warm-up nothing is left to compile, whatever happens in flight."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from msls_ros.estimation import Configuration, EventKind, Identifier
from msls_ros.estimation import compiled as room
from msls_ros.estimation.warm_up import compile_all, count_compiled
from msls_ros.inputs.profiles import config_folder, read_profile

PROFILES = sorted(path.stem for path in config_folder().glob("*.yaml"))
SAMPLES = 400
NAME = "made_up_kernels"


def flight(configuration: Configuration) -> tuple[Any, Any, Any, Any]:
    """Return samples of an aircraft that loses most of an effector, and then meets gusts."""
    random = np.random.default_rng(1)
    n, m = len(configuration.states), len(configuration.effectors)
    x = random.normal(size=(SAMPLES, n)) * 0.1
    x[:, 0] += configuration.reference_speed
    x[300:, 1:3] += np.cumsum(random.normal(size=(100, 2)), axis=0)
    delta, b = random.normal(size=(SAMPLES, m)) * 0.1, random.normal(size=(n, m))
    b[3] = 0.0
    b[3, 2] = 10.0
    after = b.copy()
    after[3, 2] *= 0.1
    clean = np.where(np.arange(SAMPLES)[:, None] < 200, delta @ b.T, delta @ after.T)
    clean[:, :3] -= 0.2 * (x[:, :3] - x[0, :3])
    return np.arange(SAMPLES) / configuration.sample_rate, x, clean + random.normal(size=x.shape) * 1e-4, delta


@pytest.mark.skipif(not room.HAVE_NUMBA, reason="nothing is compiled without numba")
@pytest.mark.parametrize("method", ["", "bank", "rls"])
@pytest.mark.parametrize("profile", PROFILES)
def test_no_update_after_the_warm_up_compiles_anything(
    profile: str, method: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    configuration = read_profile(profile)
    if method:
        configuration = configuration.replace({"estimator.method": method})
    called: set[str] = set()
    for entry in ("__call__", "version"):
        monkeypatch.setattr(room.Kernel, entry, _noting(called, getattr(room.Kernel, entry)))
    compile_all.__wrapped__(configuration.estimator.method)
    before, warmed = count_compiled(), frozenset(called)
    identifier = Identifier(configuration)
    t, x, xdot, delta = flight(configuration)
    events = [
        event.kind for k in range(SAMPLES) for event in identifier.update(float(t[k]), x[k], xdot[k], delta[k]).events
    ]
    assert EventKind.DETECTED in events or method == "rls"
    identifier.configure({"dither.enabled": False})
    identifier.enabled = False
    identifier.update(t[-1] + 0.02, x[0], xdot[0], delta[0])
    identifier.enabled = True
    identifier.reset()
    identifier.run(t, x, xdot, delta, 10)
    b = np.zeros((9, len(configuration.effectors)))
    identifier.warm_start(np.zeros((9, 9)), b, np.zeros(9), identifier.covariance)
    identifier.update(0.0, x[0], xdot[0], delta[0])
    assert count_compiled() == before
    assert called == warmed, "also where another test has compiled it already"


@pytest.mark.skipif(not room.HAVE_NUMBA, reason="nothing is compiled without numba")
def test_a_kernel_is_compiled_where_no_cache_can_be_written(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    monkeypatch.setattr(room, "_cache_folder", lambda folder: tmp_path / "file" / "cache")
    monkeypatch.setattr(room, "KERNELS", [])
    twice = room.compiled(_kernel(tmp_path / "clone", "2.0"))
    assert twice(2.0) == 4.0 and [twice] == room.KERNELS
    assert cast(Any, twice).dispatcher.stats.cache_path is None


def test_a_second_clone_of_the_same_sources_compiles_nothing(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    numba: Any = pytest.importorskip("numba")
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "kept"))
    before = dict(vars(numba.config))
    found = []
    for clone, factor in (("one", "2.0"), ("two", "2.0"), ("three", "3.0")):
        kernel: Any = room.Kernel(_kernel(tmp_path / clone, factor), room.OPTIONS).dispatcher
        found.append((kernel(2.0), sum(kernel.stats.cache_hits.values())))
    assert found == [(4.0, 0), (4.0, 1), (6.0, 0)]
    assert dict(vars(numba.config)) == before, "numba's settings of others are as they were"


@pytest.mark.parametrize("collects", [True, False])
def test_compiling_leaves_the_settings_of_others_as_they_were(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, collects: bool
) -> None:
    monkeypatch.delenv("NUMBA_OPT", raising=False)
    monkeypatch.setattr(room, "_cache_folder", lambda folder: tmp_path)
    config: Any = pytest.importorskip("numba").config
    before, seen = dict(vars(config)), []

    def whole(signature: str) -> str:
        seen.append((config.OPT, gc.isenabled()))
        if signature == "bad":
            raise TypeError(signature)
        return signature

    try:
        (gc.enable if collects else gc.disable)()
        assert room._compile(flight, whole, "good") == "good"
        with pytest.raises(TypeError, match="bad"):
            room._compile(flight, whole, "bad")
        assert gc.isenabled() == collects
    finally:
        gc.enable()
    assert seen == [(1, False)] * 2
    assert dict(vars(config)) == before


def test_of_processes_that_start_together_one_compiles_and_the_others_load(tmp_path: Path) -> None:
    pytest.importorskip("numba")
    (tmp_path / f"{NAME}.py").write_text(
        """
import numba
from msls_ros.estimation.compiled import OPTIONS, Kernel
def twice(x):
    return 2.0 * x
numba.njit(twice)(1.0)
kernel = Kernel(twice, OPTIONS)
print("ready", flush=True)
input()
assert kernel(2.0) == 4.0
print(sum(kernel.dispatcher.stats.cache_hits.values()))
"""
    )
    started = [
        subprocess.Popen(
            [sys.executable, str(tmp_path / f"{NAME}.py")],
            env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "kept")},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        for _ in range(3)
    ]
    for one in started:
        assert one.stdout is not None and one.stdout.readline() == "ready\n"
    for one in started:
        assert one.stdin is not None
        one.stdin.write("\n")
        one.stdin.flush()
    loaded = [one.communicate()[0] for one in started]
    assert sorted(loaded) == ["0\n", "1\n", "1\n"]


def test_kernels_of_old_versions_make_room_for_a_new_one(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    numba: Any = pytest.importorskip("numba")
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    old = [tmp_path / "msls_ros" / f"room-{age:016x}" for age in range(room.VERSIONS + 2)]
    other = tmp_path / "msls_ros" / "hall-0"
    for age, folder in enumerate([*old, other]):
        folder.mkdir(parents=True)
        (folder / "kernel.nbc").write_bytes(b"compiled")
        os.utime(folder, (1e9 - age, 1e9 - age))
    kernel: Any = room.Kernel(_kernel(tmp_path / "clone", "2.0"), room.OPTIONS)
    assert kernel(2.0) == 4.0
    (new,) = {one for one in other.parent.iterdir() if one not in (*old, other)}
    assert {one for one in old if one.exists()} == set(old[: room.VERSIONS - 1])
    assert other.exists() and any(new.iterdir())


def _noting(called: set[str], method: Callable[..., Any]) -> Callable[..., Any]:
    """Return a method of a kernel that notes the kernel's name."""

    def noted(kernel: Any, *arguments: Any) -> Any:
        called.add(kernel.__name__)
        return method(kernel, *arguments)

    return noted


def _kernel(clone: Path, factor: str) -> Callable[[float], float]:
    """Return a function of a clone; what it says is in another file of its room."""
    folder = clone / "room"
    folder.mkdir(parents=True)
    (folder / "numbers.py").write_text(f"FACTOR = {factor}\n")
    (folder / "kernels.py").write_text("FACTOR = 0.0\ndef times(x):\n    return FACTOR * x\n")
    spec = spec_from_file_location(NAME, folder / "kernels.py")
    assert spec is not None and spec.loader is not None
    sys.modules[NAME] = module = module_from_spec(spec)
    spec.loader.exec_module(module)
    vars(module)["FACTOR"] = float(factor)
    function: Callable[[float], float] = module.times
    return function


@pytest.fixture(autouse=True)
def _forget() -> Iterator[None]:
    yield
    sys.modules.pop(NAME, None)
