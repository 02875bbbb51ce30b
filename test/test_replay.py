"""Replay: offline equals live to the last bit, from any format, whatever the size of its blocks; its command line."""

from __future__ import annotations

import json
import sqlite3
import tracemalloc
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from replayed import (
    BAGS,
    EFFECTORS,
    FLIGHTS,
    OUTPUTS,
    STATE,
    Maker,
    assert_same,
    inputs,
    outputs,
    write,
    write_ros1,
    write_ros2,
)
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from msls_ros.bags import BagMessage, BagWriter, read
from msls_ros.commands import replay as command
from msls_ros.commands.inputs import InputTopics, SampleSource
from msls_ros.commands.offline import ReplayOptions, keep_parameters, kept_parameters, replay
from msls_ros.commands.profiles import read_profile
from msls_ros.commands.record_flights import results
from msls_ros.estimation import Configuration, Synchronizer
from msls_ros.estimation.block_pairing import PairedBlock

STATES = ("u", "v", "w", "P", "Q", "R", "Phi", "Theta", "Psi")
SURFACES = ("de", "dr", "ddt", "ddf", "dsf", "dte", "dtr")


@pytest.fixture(scope="module")
def configuration() -> Configuration:
    return read_profile(kept_parameters(BAGS / "tail_fault"))


@pytest.mark.parametrize("name", FLIGHTS)
def test_a_recorded_flight_replays_to_what_the_node_said_in_flight(name: str, tmp_path: Path) -> None:
    bag = BAGS / name
    result = replay(bag, tmp_path / "out", read_profile(kept_parameters(bag)))
    live = outputs(bag)
    assert len(live["/dither"]) == result.samples > 500
    assert_same(outputs(tmp_path / "out"), live)
    assert results(tmp_path / "out") == json.loads((BAGS / f"{name}.json").read_text())
    assert (result.refused, result.restarts, result.warnings) == ({}, 0, [])
    assert any("fault" in name and event.kind.name == "DETECTED" for _, event in result.events) == ("fault" in name)


def test_the_recorded_flights_are_small_and_whole() -> None:
    for name in FLIGHTS:
        assert sum(file.stat().st_size for file in (BAGS / name).iterdir()) < 2_000_000
        bag = read(BAGS / name)
        assert sum(1 for _ in bag) == sum((bag.summary.counts if bag.summary else {}).values())
        assert bag.warnings == []


def test_fewer_models_are_the_same_models_and_nothing_else_changes(
    tmp_path: Path, configuration: Configuration
) -> None:
    bag = BAGS / "tail_fault"
    live = outputs(bag)
    for every in (7, 10_000):
        replay(bag, tmp_path / str(every), configuration, ReplayOptions(every=every))
        given = outputs(tmp_path / str(every))
        assert given["/model"] == live["/model"][every - 1 :: every]
        assert given["/dither"] == live["/dither"] and given["/fault"] == live["/fault"]


@pytest.mark.parametrize(
    ("storage", "mode"),
    [
        (StoragePlugin.MCAP, CompressionMode.FILE),
        (StoragePlugin.MCAP, CompressionMode.MESSAGE),
        (StoragePlugin.SQLITE3, CompressionMode.NONE),
        (StoragePlugin.SQLITE3, CompressionMode.FILE),
        (None, None),
    ],
)
def test_every_format_of_bag_gives_the_same(
    tmp_path: Path, configuration: Configuration, storage: StoragePlugin | None, mode: CompressionMode | None
) -> None:
    messages = inputs(BAGS / "tail_fault")
    if storage is None or mode is None:
        bag = write_ros1(tmp_path / "flight.bag", messages)
    else:
        folder = write_ros2(tmp_path / "flight", messages, storage, mode)
        (bag,) = [file for file in folder.iterdir() if file.suffix != ".yaml"]
    replay(bag, tmp_path / "out", configuration)
    assert_same(outputs(tmp_path / "out"), outputs(BAGS / "tail_fault"))


def test_streams_written_one_after_the_other_are_merged_by_time(tmp_path: Path, configuration: Configuration) -> None:
    messages = inputs(BAGS / "tail_fault")
    bag = write(tmp_path / "bag", sorted(messages, key=lambda message: message.topic))
    for merge in (False, True):
        result = replay(bag, tmp_path / f"out{merge}", configuration, ReplayOptions(merge=merge))
        assert result.refused == {}
        assert_same(outputs(tmp_path / f"out{merge}"), outputs(BAGS / "tail_fault"))


def test_the_new_bag_is_one_for_rosbags_and_its_messages_are_in_order(
    tmp_path: Path, configuration: Configuration
) -> None:
    replay(BAGS / "tail_fault", tmp_path / "out", configuration, ReplayOptions(every=10))
    messages = list(read(tmp_path / "out"))
    assert [message.stamp_ns for message in messages] == sorted(message.stamp_ns for message in messages)
    with AnyReader([tmp_path / "out"]) as reader:
        same = [(connection.topic, stamp, data) for connection, stamp, data in reader.messages()]
        assert reader.topics.keys() == set(OUTPUTS)
    assert sorted(same) == sorted((message.topic, message.stamp_ns, message.data) for message in messages)


def test_merge_writes_the_input_beside_and_replaces_the_old_answers(
    tmp_path: Path, configuration: Configuration
) -> None:
    bag = BAGS / "tail_fault"
    replay(bag, tmp_path / "out", configuration, ReplayOptions(merge=True, every=10))
    merged = read(tmp_path / "out")
    copied = [message for message in merged if message.topic not in OUTPUTS]
    assert copied == [message for message in read(bag) if message.topic not in OUTPUTS]
    assert len(outputs(tmp_path / "out")["/model"]) == 60
    result = replay(tmp_path / "out", tmp_path / "again", configuration)
    assert_same(outputs(tmp_path / "again"), outputs(bag))
    assert result.warnings == []


def collect(messages: list[BagMessage], sizes: list[int], blocks: bool) -> tuple[Any, ...]:
    """Put messages through the gate in batches; give the samples and the gate's counts."""
    gate = Synchronizer(STATES, SURFACES)
    source = SampleSource(InputTopics("/"), gate)
    found: list[Any] = []
    batches: list[list[BagMessage]] = []
    place = 0
    while place < len(messages):
        size = sizes[len(batches) % len(sizes)]
        batches.append(messages[place : place + size])
        place += size
    parts = [part for batch in batches for part in (source.segments(batch) if blocks else source._one_by_one(batch))]
    for part in [*parts, *source.rest()]:
        for k in range(len(part.stamps)):
            values = (part.x[k].tobytes(), part.xdot[k].tobytes(), part.delta[k].tobytes())
            found.append((int(part.stamps[k]), part.restarted and k == 0, *values))
    return found, dict(gate.refused), gate.paired, gate.restarts


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    seed=st.integers(0, 2**31),
    count=st.integers(1, 500),
    damage=st.floats(0.0, 0.2).map(lambda share: share if share > 0.02 else 0.0),
    jitter=st.integers(0, 100),
    sizes=st.lists(st.integers(1, 700), min_size=1, max_size=4),
)
def test_the_gate_lets_the_same_pass_in_blocks_of_any_size_as_one_by_one(
    seed: int, count: int, damage: float, jitter: int, sizes: list[int]
) -> None:
    messages = disturbed(np.random.default_rng(seed), count, damage, jitter)
    assert collect(messages, sizes, blocks=True) == collect(messages, [10**9], blocks=False)


def disturbed(rng: np.random.Generator, count: int, damage: float, jitter: int) -> list[BagMessage]:
    """Make two streams; some messages are lost, repeated, late, not finite, cut, of another layout, or back in time."""
    make, other = Maker(STATES, SURFACES), Maker(STATES[::-1], SURFACES[::-1])
    streams: list[tuple[float, BagMessage]] = []
    stamp = 10**10
    for k in range(count):
        stamp += 20_000_000
        if rng.random() < damage / 10:
            stamp -= int(rng.integers(0, 5 * 10**9))
        maker = other if rng.random() < damage else make
        x, xdot, delta = rng.normal(size=9), rng.normal(size=9), rng.normal(size=7)
        pair = [maker.state(stamp, x, xdot), maker.effectors(stamp, delta)]
        for message in pair:
            what = rng.random() / damage if damage else 9.0
            if what < 0.2:
                continue
            if what < 0.3:
                message = maker.state(stamp, x * rng.choice([np.nan, 1e30]), xdot) if message is pair[0] else message
            elif what < 0.4:
                message = message._replace(data=message.data[: int(rng.integers(0, len(message.data)))])
            streams += [(k + jitter * rng.random(), message)] * (2 if 0.4 < what < 0.5 else 1)
    return [message for _, message in sorted(streams, key=lambda item: item[0])] if jitter else [m for _, m in streams]


def test_regular_streams_pass_in_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    messages = disturbed(np.random.default_rng(0), 3000, 0.0, 0)
    one_by_one: list[int] = []
    original = SampleSource._one_by_one

    def counted(self: SampleSource, some: Sequence[BagMessage]) -> Iterator[PairedBlock]:
        one_by_one.append(len(some))
        return original(self, some)

    monkeypatch.setattr(SampleSource, "_one_by_one", counted)
    found, *_ = collect(messages, [701], blocks=True)
    assert len(found) == 3000 and sum(one_by_one) < 64


def test_the_disturbed_streams_of_these_tests_hold_every_kind_of_damage() -> None:
    messages = disturbed(np.random.default_rng(3), 2000, 0.1, 3)
    _, refused, paired, restarts = collect(messages, [100_000], blocks=True)
    assert {"not_finite", "too_large", "malformed", "stamp_repeated", "stamp_back", "state_unpaired"} <= refused.keys()
    assert paired > 1000 and restarts > 0


def test_memory_does_not_grow_with_the_bag(tmp_path: Path, configuration: Configuration) -> None:
    peaks = []
    for copies in (1, 10, 40):
        with BagWriter(tmp_path / f"bag{copies}") as writer:
            for k in range(copies):
                for message in disturbed(np.random.default_rng(k), 500, 0.0, 0):
                    writer.write(*shifted(message, k * 10**10))
        tracemalloc.start()
        try:
            replay(tmp_path / f"bag{copies}", tmp_path / f"out{copies}", configuration, ReplayOptions(every=100))
            peaks.append(tracemalloc.get_traced_memory()[1])
        finally:
            tracemalloc.stop()
    assert peaks[2] < 1.2 * peaks[1], peaks


def shifted(message: BagMessage, by: int) -> BagMessage:
    stamp = message.stamp_ns + by
    seconds, nanoseconds = divmod(stamp, 1_000_000_000)
    data = bytearray(message.data)
    data[4:12] = seconds.to_bytes(4, "little") + nanoseconds.to_bytes(4, "little")
    return message._replace(stamp_ns=stamp, data=bytes(data))


def run(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, list[str]]:
    code = command.main([str(a) for a in arguments])
    out, err = capsys.readouterr()
    return code, out, [line for line in err.splitlines() if not line.startswith("replaying ")]


def test_the_command_prints_one_json_value_and_nothing_else(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, err = run(capsys, BAGS / "tail_fault", "--out", tmp_path, "--every", 10, "--json")
    assert (code, err) == (0, [])
    (summary,) = json.loads(out)
    assert (summary["samples"], summary["models"], summary["alarms"]) == (601, 60, 1)
    assert summary["events"][0]["kind"] == "detected" and summary["samples_per_s"] > 0
    assert yaml.safe_load((tmp_path / "tail_fault" / "identifier.yaml").read_text()).keys() == {"identifier"}


def test_several_bags_or_a_glob_end_with_a_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "no_fault").mkdir()
    code, out, err = run(capsys, BAGS / "*_fault", tmp_path / "no_fault", "--out", tmp_path / "out")
    assert code == 2
    assert len(err) == 1 and "no bag in this directory" in err[0]
    table = out.split("\n\n")[-1].splitlines()
    assert table[0].split() == ["bag", "samples", "alarms", "refused", "samples/s", "warnings"]
    assert [Path(line.split()[0]).name for line in table[1:]] == ["cruise_fault", "tail_fault", "no_fault"]
    assert table[1].split()[1:4] == ["601", "1", "0"] and table[3].endswith("not read")
    assert sorted(folder.name for folder in (tmp_path / "out").iterdir()) == ["cruise_fault", "tail_fault"]


def test_bags_of_one_name_do_not_overwrite_each_other(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for flight in ("one", "two"):
        write(tmp_path / flight / "bag", inputs(BAGS / "tail_fault")[:40])
    code, _, _ = run(capsys, tmp_path / "*" / "bag", "--out", tmp_path / "out", "--params", "f16_high_alpha")
    assert code == 0
    assert sorted(folder.name for folder in (tmp_path / "out").iterdir()) == ["one_bag", "two_bag"]


def test_an_output_that_exists_is_replaced_only_when_asked_and_never_the_input(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = write(tmp_path / "bag", inputs(BAGS / "tail_fault")[:40])
    keep_parameters(bag, read_profile("f16_high_alpha"))
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
    original = SampleSource.segments

    def interrupted(self: SampleSource, batch: Sequence[BagMessage]) -> Iterator[PairedBlock]:
        yield from original(self, batch[:400])
        raise KeyboardInterrupt

    monkeypatch.setattr(SampleSource, "segments", interrupted)
    code, _, err = run(capsys, BAGS / "tail_fault", "--out", tmp_path / "out")
    assert code == 130 and len(err) == 1 and "interrupted" in err[0]
    left = read(tmp_path / "out" / "tail_fault")
    assert len(list(left)) > 50 and left.warnings == []


def renamed(messages: list[BagMessage], **topics: str) -> list[BagMessage]:
    return [message._replace(topic=topics.get(message.topic[1:], message.topic)) for message in messages]


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
    code, _, err = run(capsys, bag, "--params", "f16_high_alpha", "--out", tmp_path / "out")
    assert code == 2 and len(err) == 1
    assert all(words in err[0] for words in [str(bag), *expected]), err


def test_a_namespace_is_found_and_can_be_chosen(tmp_path: Path, configuration: Configuration) -> None:
    messages = inputs(BAGS / "tail_fault")
    one = renamed(messages, state="/f16/state", effectors="/f16/effectors")
    two = renamed(messages, state="/truth/state", effectors="/truth/effectors")
    three = renamed(messages, state="/lead/state", effectors="/lead/effectors")
    write(tmp_path / "bag", [message for pair in zip(one, two, strict=True) for message in pair])
    assert replay(tmp_path / "bag", tmp_path / "out", configuration).samples == 601
    assert read(tmp_path / "out").topics.keys() == {"/f16/model", "/f16/fault", "/f16/dither"}
    write(tmp_path / "both", [message for pair in zip(one, three, strict=True) for message in pair])
    for name in ("lead", "/f16"):
        out = tmp_path / name.strip("/")
        assert replay(tmp_path / "both", out, configuration, ReplayOptions(namespace=name)).samples == 601
        assert f"/{name.strip('/')}/model" in read(out).topics


def test_without_parameters_the_command_says_how_to_give_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = write(tmp_path / "bag", inputs(BAGS / "tail_fault")[:40])
    code, _, err = run(capsys, bag, "--out", tmp_path / "out")
    assert code == 2 and len(err) == 1 and "--params" in err[0]
    for wrong, words in (("no_such", "shipped are"), (str(tmp_path / "no.yaml"), "cannot be read")):
        code, _, err = run(capsys, bag, "--params", wrong)
        assert code == 2 and len(err) == 1 and words in err[0]


def test_parameters_kept_with_a_flight_are_the_same_when_read_again(tmp_path: Path) -> None:
    for name in ("f16_high_alpha", "f16_cruise", "paper_literal"):
        first = read_profile(name).replace({"dither.seed": 12345, "estimator.penalty": 1.0 / 3.0})
        keep_parameters(tmp_path, first)
        assert read_profile(kept_parameters(tmp_path)) == first


def test_a_topic_without_a_definition_is_left_out_of_the_merge_and_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    messages = inputs(BAGS / "tail_fault")[:40]
    strange = BagMessage("/odd", "stranger_msgs/msg/Odd", messages[0].stamp_ns, b"\0\1\0\0\5\0\0\0")
    bag = tmp_path / "old.db3"
    write_old_database(bag, [strange, *messages])
    arguments = (bag, "--params", "f16_high_alpha", "--merge", "--overwrite", "--out", tmp_path / "out")
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
