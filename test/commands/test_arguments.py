"""Command lines: options are written out, and what is misspelt gets the nearest that exists."""

from __future__ import annotations

import pytest

from msls_ros.commands import replay


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
