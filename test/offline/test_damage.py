"""Replay of damaged bags: all that is readable and a clear line, exit code 0 with warnings or 2, never a traceback."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from offline.replayed import BAGS, assert_same, inputs, outputs, write, write_ros1, write_ros2
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from msls_ros.bags import BagError, BagMessage, BagReader, BagWriter
from msls_ros.commands import recorder
from msls_ros.commands import replay as command
from msls_ros.inputs.profiles import read_profile
from msls_ros.offline.replay import ReplayOptions, replay
from msls_ros.offline.sources import counted_topics

CUTS, FLIPS = 20, 50


@pytest.fixture(scope="module")
def flight() -> list[BagMessage]:
    return inputs(BAGS / "tail_fault")


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory, flight: list[BagMessage]) -> Path:
    """The flight in many chunks, as a recorder in real time writes it."""
    path = tmp_path_factory.mktemp("flight") / "bag"
    with BagWriter(path) as writer:
        for k, message in enumerate(flight):
            writer.write(*message)
            if k % 50 == 49:
                writer.flush()
    return path


def run(capsys: pytest.CaptureFixture[str], bag: Path, out: Path) -> tuple[int, list[Any], list[str]]:
    """Replay a bag; every line on stderr is of replay."""
    arguments = [str(bag), "--params", "f16", "--out", str(out), "--overwrite", "--every", "50", "--json"]
    code = command.main(arguments)
    text, err = capsys.readouterr()
    lines = [line for line in err.splitlines() if not line.startswith("replaying ")]
    assert all(line.startswith("replay: ") for line in lines), err
    return code, json.loads(text), lines


def readable(bag: Path) -> int:
    """Samples of which both messages can be read from a bag."""
    stamps: dict[str, set[int]] = {"/state": set(), "/effectors": set()}
    for message in BagReader(bag):
        if message.topic in stamps:
            stamps[message.topic].add(message.stamp_ns)
    return len(stamps["/state"] & stamps["/effectors"])


def test_a_bag_cut_anywhere_gives_the_samples_before_the_cut_and_says_where_it_ends(
    tmp_path: Path, bag: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (file,) = bag.glob("*.mcap")
    blob = file.read_bytes()
    given = []
    for place in np.sort(np.random.default_rng(1).integers(0, len(blob), CUTS)):
        cut = tmp_path / "cut.mcap"
        cut.write_bytes(blob[:place])
        code, results, lines = run(capsys, cut, tmp_path / "out")
        assert len(lines) == 1 and str(cut) in lines[0], lines
        given.append(results[0].get("samples", 0))
        assert code == (0 if given[-1] else 2)
        if given[-1]:
            assert "warning" in lines[0] and " at byte " in lines[0]
            assert given[-1] == readable(cut)
    assert given == sorted(given) and given[0] < 100 < 500 < given[-1]


def test_flipped_bytes_anywhere_cost_their_part_and_a_line(
    tmp_path: Path, bag: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (file,) = bag.glob("*.mcap")
    blob, rng = file.read_bytes(), np.random.default_rng(2)
    silent = 0
    for place in rng.integers(0, len(blob), FLIPS):
        changed = bytearray(blob)
        changed[place] ^= int(rng.integers(1, 256))
        damaged = tmp_path / "flipped.mcap"
        damaged.write_bytes(changed)
        code, results, lines = run(capsys, damaged, tmp_path / "out")
        samples = results[0].get("samples", 0)
        assert code == (0 if samples else 2)
        assert len(lines) <= 1 and (samples == 601 or lines), (place, lines)
        if samples:
            assert samples > 520 and samples == readable(damaged), place
        silent += not lines
    assert silent < FLIPS // 2, "most flips are noticed; those in the index need not be"


@pytest.mark.parametrize("storage", ["sqlite3", "ros1", "zstd"])
def test_other_formats_flipped_or_cut_are_a_line_too(
    tmp_path: Path, flight: list[BagMessage], capsys: pytest.CaptureFixture[str], storage: str
) -> None:
    if storage == "ros1":
        file = write_ros1(tmp_path / "flight.bag", flight)
    else:
        kind = StoragePlugin.SQLITE3 if storage == "sqlite3" else StoragePlugin.MCAP
        mode = CompressionMode.NONE if storage == "sqlite3" else CompressionMode.FILE
        folder = write_ros2(tmp_path / "flight", flight, kind, mode)
        (file,) = [found for found in folder.iterdir() if found.suffix != ".yaml"]
    blob, rng = file.read_bytes(), np.random.default_rng(3)
    for k, place in enumerate(rng.integers(0, len(blob), 20)):
        changed = bytearray(blob)
        changed[place] ^= int(rng.integers(1, 256))
        damaged = tmp_path / f"damaged{file.suffix}"
        damaged.write_bytes(blob[:place] if k % 2 else changed)
        code, results, lines = run(capsys, damaged, tmp_path / "out")
        assert code == (0 if results[0].get("samples") else 2)
        assert len(lines) <= 2 and (code == 0 or lines), lines


def test_what_a_log_without_an_index_does_not_count_is_not_said_to_be_none(
    tmp_path: Path, flight: list[BagMessage]
) -> None:
    folder = write_ros2(tmp_path / "flight", flight, StoragePlugin.SQLITE3, CompressionMode.NONE)
    topics = sorted({(message.topic, message.msgtype) for message in flight})
    first = topics[0][0]
    assert counted_topics(BagReader(folder), {first: 3}) == [(n, k, 3 if n == first else None) for n, k in topics]
    assert counted_topics(BagReader(BAGS / "tail_fault"), {})[0][2] not in (None, 0)


def with_stamp(message: BagMessage, stamp: int) -> BagMessage:
    seconds, nanoseconds = divmod(stamp, 1_000_000_000)
    head = seconds.to_bytes(4, "little", signed=True) + nanoseconds.to_bytes(4, "little")
    return message._replace(data=message.data[:4] + head + message.data[12:])


def swapped(messages: list[BagMessage]) -> list[BagMessage]:
    """Every fifth pair of samples out of order."""
    found = list(messages)
    for k in range(0, len(found) - 4, 20):
        found[k : k + 4] = found[k + 2 : k + 4] + found[k : k + 2]
    return found


STAMPS = {
    "out of order": (swapped, {"stamp_back"}, 0),
    "repeated": (lambda m: [x for y in m for x in (y, y)], {"stamp_repeated"}, 0),
    "all equal": (lambda m: [with_stamp(x, 10**9) for x in m], {"stamp_repeated"}, 0),
    "jumping forward": (
        lambda m: [with_stamp(x, x.stamp_ns + (k // 400) * 10**12) for k, x in enumerate(m)],
        set(),
        0,
    ),
    "jumping back": (lambda m: [with_stamp(x, x.stamp_ns % (5 * 10**9)) for x in m], set(), 2),
    "before zero": (lambda m: [with_stamp(x, x.stamp_ns - 5 * 10**9) for x in m], set(), 0),
    "at the end of time": (lambda m: [with_stamp(x, x.stamp_ns + (2**31 - 60) * 10**9) for x in m], set(), 0),
}


@pytest.mark.parametrize("what", STAMPS)
def test_strange_stamps_are_refused_and_counted_or_start_anew(
    what: str, tmp_path: Path, flight: list[BagMessage], capsys: pytest.CaptureFixture[str]
) -> None:
    change, refused, restarts = STAMPS[what]
    bag = write(tmp_path / "bag", change(flight))
    code, (result,), lines = run(capsys, bag, tmp_path / "out")
    assert code == 0 and result["samples"] > 0
    assert refused <= result["refused"].keys()
    assert bool(result["refused"]) == bool(refused)
    assert result["restarts"] == restarts
    assert bool(lines) == (what == "before zero"), lines


def test_numbers_that_are_not_finite_are_counted_and_the_rest_is_as_without_them(
    tmp_path: Path, flight: list[BagMessage]
) -> None:
    configuration = read_profile("f16")
    bad = {60, 61, 300}
    changed = [
        m._replace(data=m.data[:-8] + np.array([np.nan, np.inf, -np.inf])[k % 3 : k % 3 + 1].tobytes())
        if k in bad
        else m
        for k, m in enumerate(flight)
    ]
    stamps = {flight[k].stamp_ns for k in bad}
    result = replay(write(tmp_path / "bad", changed), tmp_path / "out", configuration)
    replay(
        write(tmp_path / "without", [m for m in flight if m.stamp_ns not in stamps]), tmp_path / "same", configuration
    )
    assert result.refused["not_finite"] == len(bad)
    assert_same(outputs(tmp_path / "out"), outputs(tmp_path / "same"))


def test_messages_that_are_no_samples_are_counted(tmp_path: Path, flight: list[BagMessage]) -> None:
    rng = np.random.default_rng(4)
    changed = [m._replace(data=rng.bytes(len(m.data))) if k % 40 == 7 else m for k, m in enumerate(flight)]
    result = replay(write(tmp_path / "bad", changed), tmp_path / "out", read_profile("f16"), ReplayOptions(every=100))
    count = len(flight) // 40
    assert count - 1 <= result.refused["malformed"] <= count + 1
    assert result.samples > len(flight) // 2 - count - 2


def test_an_unfinished_bag_is_finished_by_repair_and_then_replays_without_a_warning(
    tmp_path: Path, bag: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    broken = tmp_path / "broken"
    shutil.copytree(bag, broken)
    (file,) = broken.glob("*.mcap")
    file.write_bytes(file.read_bytes()[:100_000])
    code, (first,), lines = run(capsys, broken, tmp_path / "out")
    assert code == 0 and len(lines) == 1
    assert "not finished" in lines[0] and f"log time {first['end_s']:.9g} s" in lines[0]

    assert recorder.main(["--repair", str(broken)]) == 0
    assert "repaired" in capsys.readouterr().out
    code, (second,), lines = run(capsys, broken, tmp_path / "out")
    assert (code, lines, second["samples"]) == (0, [], first["samples"])
    assert recorder.main(["--repair", str(broken)]) == 0
    assert "nothing changed" in capsys.readouterr().out


def test_repair_ends_with_2_and_keeps_the_original_where_something_was_lost(
    tmp_path: Path, bag: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    broken = tmp_path / "broken"
    shutil.copytree(bag, broken)
    (file,) = broken.glob("*.mcap")
    blob = bytearray(file.read_bytes())
    blob[blob.index(b"zstd") + 100] ^= 1
    file.write_bytes(blob)
    assert recorder.main(["--repair", str(broken)]) == 2
    out, err = capsys.readouterr()
    assert f"the original is kept as {file.name}.original" in out
    assert "one damaged part skipped" in err and "is in the original only" in err
    assert (broken / f"{file.name}.original").read_bytes() == blob


@pytest.mark.parametrize(
    ("arguments", "words"),
    [(["--repair"], "expected one bag"), (["--repair", "a", "b"], "expected one bag"), (["--repair", "no"], "no such")],
)
def test_repair_refuses_what_it_cannot_do_in_one_line(
    arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert recorder.main(arguments) == 2
    out, err = capsys.readouterr()
    assert out == "" and len(err.splitlines()) == 1 and words in err


def test_a_bag_that_cannot_be_written_is_one_line(
    tmp_path: Path, bag: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "out").write_text("a file\n")
    code, _, lines = run(capsys, bag, tmp_path / "out")
    assert code == 2 and len(lines) == 1 and "cannot be written" in lines[0]

    def full(*_: object) -> None:
        message = "out: cannot be written: No space left on device"
        raise BagError(message)

    monkeypatch.setattr(BagWriter, "write_blocks", full)
    code, _, lines = run(capsys, bag, tmp_path / "elsewhere")
    assert code == 2 and len(lines) == 1 and "No space left" in lines[0]
