"""The last line of an inspection agrees with what was found."""

from __future__ import annotations

from pathlib import Path

import pytest

from msls_ros.commands import inspect

BAG = Path(__file__).parents[2] / "bags" / "tail_fault"


def closing(folder: Path, capsys: pytest.CaptureFixture[str], old: str = "", new: str = "") -> tuple[int, str, str]:
    """Inspect the bag with its parameters, changed; return the exit code, all that is said, and the last line."""
    text = (BAG / "identifier.yaml").read_text()
    assert old in text
    path = folder / "changed.yaml"
    path.write_text(text.replace(old, new))
    code = inspect.main([str(BAG), "--params", str(path)])
    said = capsys.readouterr().out
    return code, said, said.splitlines()[-1]


def test_a_sound_log_is_to_be_replayed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, _, last = closing(tmp_path, capsys)
    assert code == 0 and last == "nothing is wrong: replay it"


@pytest.mark.parametrize(("name", "new"), [("sample_rate", 100.0), ("reference_speed", 700.0)])
def test_a_doubtful_change_comes_before_the_replay(
    name: str, new: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    old = next(line for line in (BAG / "identifier.yaml").read_text().splitlines() if f"{name}:" in line)
    code, said, last = closing(tmp_path, capsys, old, f"{old.split(':')[0]}: {new}")
    assert code == 0 and f"change: {name}: " in said
    assert last.startswith(f"doubtful: first make the changes of {name}") and "replay" not in last
    assert "nothing is wrong" not in said
