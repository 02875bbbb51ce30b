"""Compiling takes minutes once on a machine, and whoever waits hears of it."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest

from msls_ros.commands import compiling
from msls_ros.estimation import compiled as room
from msls_ros.estimation import warm_up as module
from msls_ros.testing import PATIENCE


def test_who_waits_for_the_compiler_hears_how_long(monkeypatch: pytest.MonkeyPatch) -> None:
    heard: list[float] = []
    spoken = threading.Event()

    def hear(seconds: float) -> None:
        heard.append(seconds)
        spoken.set()

    def compiling_until_heard(method: str) -> float:
        assert method == "bank" and spoken.wait(PATIENCE)
        return 2.0

    monkeypatch.setattr(module, "EVERY", 0.001)
    monkeypatch.setattr(module, "compile_all", compiling_until_heard)
    assert module.warm_up("bank", hear) == 2.0
    assert heard and heard[0] > 0.0


@pytest.mark.skipif(not room.HAVE_NUMBA, reason="nothing is compiled without numba")
def test_it_is_said_once_on_a_machine(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(room, "_cache_folder", lambda folder: tmp_path)
    assert not module.is_kept("rls")
    module.compile_all.cache_clear()
    compiling.compile_once("rls", "rls")
    first = capsys.readouterr().err.splitlines()
    assert first[0].startswith("compiling the estimator (rls), once on this machine")
    assert first[-1].startswith("compiled in ")
    assert module.is_kept("rls") and not module.is_kept("bank")
    compiling.compile_once("rls")
    assert capsys.readouterr() == ("", "")


def test_where_no_note_can_be_kept_it_is_compiled_all_the_same(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(room, "_cache_folder", lambda folder: tmp_path / "missing")
    module.compile_all.cache_clear()
    module.warm_up("rls")
    assert not (tmp_path / "missing").exists()
