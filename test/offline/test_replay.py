"""Replay: offline equals live to the last bit, from any format of bag."""

from __future__ import annotations

import io
import json
from contextlib import redirect_stderr
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from offline.replayed import (
    BAGS,
    FLIGHTS,
    OUTPUTS,
    assert_same,
    inputs,
    outputs,
    renamed,
    write,
    write_ros1,
    write_ros2,
)
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from msls_ros.bags import read
from msls_ros.commands import replay as command
from msls_ros.commands.record_flights import results
from msls_ros.estimation import Configuration, EstimationError, Identifier
from msls_ros.inputs.model_file import write_model
from msls_ros.inputs.profiles import BESIDE_A_BAG, MODEL_BESIDE, read_profile, read_warm_start, render_parameters
from msls_ros.offline.identification import identify_log
from msls_ros.offline.replay import ReplayOptions, keep_parameters, kept_parameters, replay
from msls_ros.offline.report_data import gather


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


def test_a_reference_speed_that_makes_a_flight_a_roll_is_told(tmp_path: Path, configuration: Configuration) -> None:
    bag = BAGS / "tail_fault"
    slow = configuration.replace({"reference_speed": 2000.0})
    result = replay(bag, tmp_path / "out", slow)
    assert result.grounded == result.samples
    assert "slower than 500 m/s" in result.warnings[0] and "check reference_speed" in result.warnings[0]
    always = replay(bag, tmp_path / "all", slow.replace({"flying_speed": 0.0}))
    assert (always.grounded, always.spikes, always.warnings) == (0, 0, [])


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


def test_a_flight_that_began_with_a_saved_model_is_replayed_from_it_and_from_its_copy_beside_the_bag(
    tmp_path: Path, configuration: Configuration
) -> None:
    model, kept = saved_model(tmp_path, configuration), tmp_path / "first" / "bag" / BESIDE_A_BAG
    bag = write(kept.parent, inputs(BAGS / "tail_fault")[:200])
    kept.write_text(render_parameters(configuration, {}, "Of a flight.", model))
    assert read_warm_start(kept) == model
    cold, warm = identify_log(BAGS / "tail_fault", every=100), identify_log(bag, every=100)
    assert warm.b[0].tobytes() != cold.b[0].tobytes() and not warm.warnings
    options: dict[str, Any] = {"every": 100, "parameters": kept}
    assert not replay(bag, tmp_path / "again", configuration, ReplayOptions(**options, warm_start=model)).warnings
    (_, fields), *_ = outputs(tmp_path / "again")["/model"]
    assert fields["b"] == ("float64", warm.b[0].tobytes())
    model.write_text("another flight")
    assert read_warm_start(tmp_path / "again" / BESIDE_A_BAG) == tmp_path / "again" / MODEL_BESIDE
    with pytest.raises(EstimationError, match="is not a model that ~/save_model has written"):
        identify_log(bag)


def test_a_saved_model_that_is_not_there_any_more_is_told(tmp_path: Path, configuration: Configuration) -> None:
    bag = write(tmp_path / "bag", inputs(BAGS / "tail_fault")[:200])
    (bag / BESIDE_A_BAG).write_text(render_parameters(configuration, {}, "Of a flight.", tmp_path / "gone.yaml"))
    (said,) = identify_log(bag).warnings
    assert said == (
        f"warm_start: the model '{tmp_path / 'gone.yaml'}' is not there: the identifier begins with nothing learnt, "
        "not with the model of the flight"
    )
    assert said in command_run(bag, tmp_path) and said in gather(bag, None).warnings


def saved_model(folder: Path, configuration: Configuration) -> Path:
    """Write a model with more elevator than the aircraft has."""
    identifier, n, m = Identifier(configuration), len(configuration.states), len(configuration.effectors)
    zeros = np.zeros(n), np.zeros(m)
    identifier.warm_start(-np.eye(n), np.ones((n, m)), zeros[0], 1e-6 * np.eye(len(configuration.regressors)))
    write_model(folder / "model.yaml", identifier, identifier.estimate(0.0, zeros[0]), *zeros, 0)
    return folder / "model.yaml"


def command_run(bag: Path, folder: Path) -> str:
    """Return what the command says of a bag."""
    capture = io.StringIO()
    with redirect_stderr(capture):
        assert command.main([str(bag), "--out", str(folder / "out")]) == 0
    return capture.getvalue()


def test_parameters_kept_with_a_flight_are_the_same_when_read_again(tmp_path: Path) -> None:
    for name in ("f16", "A4", "paper_literal"):
        first = read_profile(name).replace({"dither.seed": 12345, "estimator.penalty": 1.0 / 3.0})
        keep_parameters(tmp_path, first)
        assert read_profile(kept_parameters(tmp_path)) == first
