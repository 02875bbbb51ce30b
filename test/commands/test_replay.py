"""The command line of replay: JSON, tables, and what wrong usage gets."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest
import yaml
from bags.test_hostile import YAML
from offline.replayed import (
    BAGS,
    EFFECTORS,
    STATE,
    inputs,
    renamed,
    run,
    shifted,
    write,
)

from msls_ros.bags import BagMessage, read
from msls_ros.commands.compiling import compile_once
from msls_ros.inputs.block_pairing import PairedBlock
from msls_ros.inputs.profiles import read_profile
from msls_ros.offline.replay import keep_parameters
from msls_ros.offline.sources import SampleSource


def test_the_command_prints_one_json_value_and_nothing_else(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    compile_once("bank")
    capsys.readouterr()
    code, out, err = run(capsys, BAGS / "tail_fault", "--out", tmp_path, "--every", 10, "--json")
    assert (code, err) == (0, [])
    (summary,) = json.loads(out)
    assert (summary["samples"], summary["models"], summary["alarms"]) == (601, 60, 1)
    assert summary["events"][0]["kind"] == "detected" and summary["samples_per_s"] > 0
    assert yaml.safe_load((tmp_path / "tail_fault" / "identifier.yaml").read_text()).keys() == {"/**"}


def test_several_bags_or_a_glob_end_with_a_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "no_fault").mkdir()
    code, out, err = run(capsys, BAGS / "*_fault", tmp_path / "no_fault", "--out", tmp_path / "out")
    assert code == 2
    assert len(err) == 1 and "no bag in this directory" in err[0]
    table = out.split("\n\n")[-1].splitlines()
    assert table[0].split() == ["bag", "samples", "alarms", "refused", "samples/s", "warnings"]
    assert [Path(line.split()[0]).name for line in table[1:]] == ["cruise_fault", "tail_fault", "no_fault"]
    assert table[1].split()[1:4] == ["601", "2", "0"]  # pitch and roll, and the axial equation a moment later
    assert table[3].endswith("not read")
    assert sorted(folder.name for folder in (tmp_path / "out").iterdir()) == ["cruise_fault", "tail_fault"]


def test_bags_of_one_name_do_not_overwrite_each_other(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for flight in ("one", "two"):
        write(tmp_path / flight / "bag", inputs(BAGS / "tail_fault")[:40])
    code, _, _ = run(capsys, tmp_path / "*" / "bag", "--out", tmp_path / "out", "--params", "f16")
    assert code == 0
    assert sorted(folder.name for folder in (tmp_path / "out").iterdir()) == ["one_bag", "two_bag"]


def test_an_output_that_exists_is_replaced_only_when_asked_and_never_the_input(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = write(tmp_path / "bag", inputs(BAGS / "tail_fault")[:40])
    keep_parameters(bag, read_profile("f16"))
    assert run(capsys, bag, "--out", tmp_path / "out")[0] == 0
    code, _, err = run(capsys, bag, "--out", tmp_path / "out")
    assert code == 2 and len(err) == 1 and "exists already" in err[0]
    assert run(capsys, bag, "--out", tmp_path / "out", "--overwrite")[0] == 0
    before = [file.read_bytes() for file in sorted(bag.iterdir())]
    for folder in (tmp_path, bag):
        code, _, err = run(capsys, bag, "--out", folder, "--overwrite")
        assert code == 2 and len(err) == 1 and "give another folder" in err[0]
    assert [file.read_bytes() for file in sorted(bag.iterdir())] == before


def test_interrupted_the_command_says_so_and_leaves_a_whole_bag(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    original, seen = SampleSource.segments, 0

    def interrupted(self: SampleSource, batch: Sequence[BagMessage]) -> Iterator[PairedBlock]:
        nonlocal seen
        yield from original(self, batch)
        seen += len(batch)
        if seen >= 400:
            raise KeyboardInterrupt

    monkeypatch.setattr(SampleSource, "segments", interrupted)
    code, _, err = run(capsys, BAGS / "tail_fault", "--out", tmp_path / "out")
    assert code == 130 and len(err) == 1 and "interrupted" in err[0]
    left = read(tmp_path / "out" / "tail_fault")
    assert len(list(left)) > 50 and left.warnings == []


@pytest.mark.parametrize("ending", [KeyboardInterrupt, OSError, "no samples"])
def test_a_replay_that_fails_leaves_the_earlier_one(
    ending: type[BaseException] | str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    out = tmp_path / "out"
    assert run(capsys, BAGS / "tail_fault", "--out", out)[0] == 0
    before = {file.name: file.read_bytes() for file in (out / "tail_fault").iterdir()}
    original = SampleSource.segments

    def failing(self: SampleSource, batch: Sequence[BagMessage]) -> Iterator[PairedBlock]:
        if isinstance(ending, str):
            return
        yield from original(self, batch[:400])
        raise ending("full")

    monkeypatch.setattr(SampleSource, "segments", failing)
    code, _, err = run(capsys, BAGS / "tail_fault", "--out", out, "--overwrite")
    assert code == (130 if ending is KeyboardInterrupt else 2)
    assert err and ("as it was" in err[-1] or "full" in err[-1]), err
    assert {file.name: file.read_bytes() for file in (out / "tail_fault").iterdir()} == before
    assert [folder.name for folder in out.iterdir()] == ["tail_fault"]


@pytest.mark.parametrize("what", ["aliases", "merge keys", "depth", "block depth", "length", "bytes"])
def test_parameters_that_come_with_a_bag_and_are_no_parameters_are_one_line(
    what: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = write(tmp_path / "bag", inputs(BAGS / "tail_fault")[:4])
    (bag / "identifier.yaml").write_text(YAML[what])
    code, _, err = run(capsys, bag, "--out", tmp_path / "out")
    assert code == 2 and len(err) == 1 and "identifier.yaml: not the parameters of a flight" in err[0]


WRONG = {
    "a topic is missing": (lambda m: [x for x in m if x.topic == "/state"], ["no topic effectors", EFFECTORS]),
    "a topic has another type": (
        lambda m: [x._replace(msgtype="msls_msgs/msg/EffectorCommand") if x.topic == "/effectors" else x for x in m],
        ["/effectors has type msls_msgs/msg/EffectorCommand", EFFECTORS],
    ),
    "both are somebody else's": (lambda m: renamed(m, state="/a", effectors="/b"), ["no topic state", STATE]),
    "the two are of two aircraft": (lambda m: renamed(m, state="/a/state", effectors="/b/effectors"), ["beside"]),
    "there are two aircraft": (
        lambda m: m + renamed(m, state="/a/state", effectors="/a/effectors"),
        ["several aircraft", "--namespace"],
    ),
    "no stamp is in both": (
        lambda m: [shifted(x, 7) if x.topic == "/state" else x for x in m],
        ["not one sample", "no stamp in common"],
    ),
}


@pytest.mark.parametrize("what", WRONG)
def test_a_bag_without_the_inputs_is_one_clear_line_and_exit_code_2(
    what: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    change, expected = WRONG[what]
    bag = write(tmp_path / "bag", change(inputs(BAGS / "tail_fault")[:80]))
    code, _, err = run(capsys, bag, "--params", "f16", "--out", tmp_path / "out")
    assert code == 2 and len(err) == 1
    assert all(words in err[0] for words in [str(bag), *expected]), err


def test_without_parameters_the_command_says_how_to_give_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = write(tmp_path / "bag", inputs(BAGS / "tail_fault")[:40])
    code, _, err = run(capsys, bag, "--out", tmp_path / "out")
    assert code == 2 and len(err) == 1 and "--params" in err[0]
    for wrong, words in (("no_such", "shipped are"), (str(tmp_path / "no.yaml"), "cannot be read")):
        code, _, err = run(capsys, bag, "--params", wrong)
        assert code == 2 and len(err) == 1 and words in err[0]


def test_a_topic_without_a_definition_is_left_out_of_the_merge_and_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    messages = inputs(BAGS / "tail_fault")[:40]
    strange = BagMessage("/odd", "stranger_msgs/msg/Odd", messages[0].stamp_ns, b"\0\1\0\0\5\0\0\0")
    bag = tmp_path / "old.db3"
    write_old_database(bag, [strange, *messages])
    arguments = (bag, "--params", "f16", "--merge", "--overwrite", "--out", tmp_path / "out")
    code, _, err = run(capsys, *arguments)
    assert code == 0 and len(err) == 1
    assert "stranger_msgs/msg/Odd: no message definition found" in err[0] and "--definitions" in err[0]
    (tmp_path / "stranger_msgs" / "msg").mkdir(parents=True)
    (tmp_path / "stranger_msgs" / "msg" / "Odd.msg").write_text("uint32 a\n")
    assert run(capsys, *arguments, "--definitions", tmp_path)[::2] == (0, [])
    assert "/odd" in read(tmp_path / "out" / "old").topics


def write_old_database(path: Path, messages: list[BagMessage]) -> None:
    """Write what rosbag2 of ROS 2 Foxy wrote: no definitions, no QoS."""
    topics = {message.topic: message.msgtype for message in messages}
    numbers = {topic: k + 1 for k, topic in enumerate(topics)}
    with sqlite3.connect(path) as database:
        database.executescript(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT);"
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB);"
        )
        rows = [(numbers[topic], topic, kind) for topic, kind in topics.items()]
        database.executemany("INSERT INTO topics VALUES(?, ?, ?, 'cdr')", rows)
        rows2 = [(numbers[message.topic], message.stamp_ns, message.data) for message in messages]
        database.executemany("INSERT INTO messages VALUES(NULL, ?, ?, ?)", rows2)
    database.close()
