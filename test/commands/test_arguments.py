"""Command lines: options are written out, and what is misspelt gets the nearest that exists."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from msls_ros.commands import campaign, demo, inspect, replay, report


@pytest.mark.parametrize(
    ("arguments", "said"),
    [(["bag", "--para", "x"], "--para x; did you mean '--params'?"), (["bag", "--outt", "x"], "did you mean '--out'?"),
     (["bag", "--zzz"], "unrecognized arguments: --zzz; see --help")],
)  # fmt: skip
def test_an_option_is_never_abbreviated_and_a_misspelt_one_is_suggested(
    arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit, match="2"):
        replay.parser().parse_args(arguments)
    assert said in capsys.readouterr().err


@pytest.mark.parametrize(
    ("main", "arguments", "said"),
    [
        (demo.main, "--noise lowe", "did you mean 'low'?"),
        (demo.main, "--scenario roll_doublett", "expected 'roll_doublet'"),
        (campaign.main, "roll_doublet --seeds 1 --compare lamda=0.9", "did you mean 'lambda'?"),
        (campaign.main, "roll_doublet --seeds 1 --compare treshold=9", "did you mean 'threshold'?"),
        (replay.main, "bags/tail_falt", "did you mean 'bags/tail_fault'?"),
        (inspect.main, "bags/tail_falt", "did you mean 'bags/tail_fault'?"),
        (report.main, "bags/tail_fault --parameter P/ddtt --out OUT", "did you mean 'P/ddt'?"),
    ],
)
def test_an_unknown_name_gets_the_nearest_that_exists(
    main: Callable[[list[str]], int], arguments: str, said: str, tmp_path: Path,
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.chdir(Path(__file__).parents[2])
    try:
        code = main(arguments.replace("OUT", str(tmp_path)).split())
    except SystemExit as exit:
        code = exit.code  # type: ignore[assignment]
    found = capsys.readouterr()
    assert code == 2 and found.out == "" and found.err.count("\n") == 1 and said in found.err, found.err
