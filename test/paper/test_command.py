"""The executable `paper`: its JSON, its exit codes, its figures, its refusals."""

from __future__ import annotations

import json
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest

from msls_ros.commands import paper
from msls_ros.paper import linear_experiments
from msls_ros.paper.linear_experiments import Statistic
from msls_ros.report.paper_figures import ParameterFigure, draw_figure


def test_json_is_one_object_with_the_table_the_claims_and_the_figures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(linear_experiments, "UNEXCITED", 10_000)
    code = paper.main(["--seeds", "1", "--out", str(tmp_path / "deep" / "out"), "--json"])
    result = json.loads(capsys.readouterr().out)
    assert code == 0
    for row in result["table"]:
        assert set(row) == {"statistic", "measured", "low", "high", "ok"}
        low, high = row["low"], row["high"]
        assert row["ok"] == ((low is None or low <= row["measured"]) and (high is None or row["measured"] <= high))
    assert {claim["verdict"] for claim in result["claims"]} <= {"reproduced", "partly", "not"}
    assert all(claim["number"] for claim in result["claims"])
    assert [Path(path).name for path in result["figures"]] == [f"figure_{n}.png" for n in range(1, 10)]
    for path in result["figures"]:
        image = matplotlib.image.imread(path)
        assert image.shape[0] > 600 and image.shape[1] > 1000
        assert image.std() > 0.05
    assert len(list((tmp_path / "deep" / "out").iterdir())) == 9


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--seeds", "0"], "1 to 1000"),
        (["--seeds", "1001"], "1 to 1000"),
        (["--seeds", "x"], "'x'"),
        (["--seeds", "-3"], "-3"),
        (["--nonsense"], "--nonsense"),
        (["stray"], "stray"),
        (["--out", "/dev/null/out"], "/dev/null/out"),
    ],
)
def test_wrong_usage_is_refused_in_one_line(
    arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as stop:
        paper.main(arguments)
    captured = capsys.readouterr()
    assert stop.value.code == 2
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    assert words in captured.err


def test_a_row_out_of_bounds_is_shown(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    def outcome(measured: float) -> int:
        table = [Statistic("some error", measured, high=1.0)]
        monkeypatch.setattr(paper, "run", lambda _: paper.Outcome(table))
        return paper.main(["--no-figures"])

    assert outcome(1.0) == 0
    assert "OUT OF BOUNDS" not in capsys.readouterr().out
    assert outcome(1.1) == 0
    assert "OUT OF BOUNDS" in capsys.readouterr().out
    assert outcome(float("nan")) == 0
    assert "OUT OF BOUNDS" in capsys.readouterr().out


def test_numbers_that_are_not_finite_are_null_in_json() -> None:
    assert paper.row_of(Statistic("x", float("nan"), low=1.0)) == {
        "statistic": "x",
        "measured": None,
        "low": 1.0,
        "high": None,
        "ok": False,
    }


def test_no_figures_writes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(paper, "run", lambda _: paper.Outcome())
    assert paper.main(["--no-figures", "--out", str(tmp_path / "out")]) == 0
    assert not list(tmp_path.iterdir())


def test_a_figure_of_one_seed_without_error_is_drawn(tmp_path: Path) -> None:
    truth = np.zeros(50)
    draw_figure(ParameterFigure(1, "t", "p", "o", truth, truth[None, :], (-1.0, 1.0)), tmp_path / "a.png")
    assert (tmp_path / "a.png").stat().st_size > 1000


def test_the_same_numbers_give_the_same_figure_bytes(tmp_path: Path) -> None:
    truth = np.linspace(0.0, 1.0, 50)
    estimate = truth + np.random.default_rng(0).normal(size=(3, 50))
    content = ParameterFigure(4, "t", "p", "o", truth, estimate, (-3.0, 3.0), change=20, alarms=(20,))
    for name in ("a.png", "b.png"):
        draw_figure(content, tmp_path / name)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
