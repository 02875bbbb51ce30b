"""Blocks of equal messages: the same bag as message by message, for any reader."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from msls_ros.bags import BagError, BagWriter, MessageTemplate, read, typestore

STORE = typestore()
MODEL, EFFECTOR = "msls_msgs/msg/LinearModel", "msls_msgs/msg/EffectorSample"
MESSAGES: dict[str, dict[str, Any]] = {
    EFFECTOR: {"effectors": ["de", "ddt"], "delta": np.zeros(2)},
    MODEL: {
        "states": ["u"],
        "effectors": ["a", "bc", "def"],
        "a": np.zeros(1),
        "b": np.zeros(3),
        "a_known": np.zeros(1, bool),
        "b_reliable": np.zeros(3, bool),
        "samples": 0,
    },
    "sensor_msgs/msg/Imu": {"header": {"frame_id": "x"}, "orientation": {"w": 1.0}},
    "diagnostic_msgs/msg/DiagnosticArray": {"status": [{"name": "abc", "values": [{"key": "k", "value": "value"}]}]},
    "std_msgs/msg/String": {"data": "only text"},
}


def filled(template: MessageTemplate, count: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    rows = template.rows(count)
    for name in template.dtype.names or ():
        field = rows[name]
        field[...] = rng.integers(0, 2 if field.dtype == bool else 100, field.shape)
    return rows


def read_field(message: Any, path: str) -> Any:
    for part in path.replace("]", "").replace("[", ".").split("."):
        message = message[int(part)] if part.isdigit() else getattr(message, part)
    return message


@pytest.mark.parametrize("msgtype", [name for name in MESSAGES if "String" not in name])
def test_every_number_stands_where_a_full_decoder_finds_it(msgtype: str) -> None:
    template = MessageTemplate(msgtype, MESSAGES[msgtype])
    rows = filled(template, 5, seed=1)
    assert template.dtype.names
    for row, cdr in zip(rows, template.cdr(rows), strict=True):
        decoded = STORE.deserialize_cdr(cdr.tobytes(), msgtype)
        for name in template.dtype.names:
            assert np.array_equal(read_field(decoded, name), row[name]), name


def test_a_message_without_numbers_is_no_template_but_a_sentence() -> None:
    with pytest.raises(BagError, match="no number"):
        MessageTemplate("std_msgs/msg/String", MESSAGES["std_msgs/msg/String"])


def test_blocks_are_merged_by_stamp_and_every_reader_finds_them(tmp_path: Path) -> None:
    templates = {f"/{k}": MessageTemplate(msgtype, MESSAGES[msgtype]) for k, msgtype in enumerate((EFFECTOR, MODEL))}
    rng = np.random.default_rng(2)
    expected: list[tuple[str, int, bytes]] = []
    with BagWriter(tmp_path / "bag") as writer:
        for topic, msgtype in zip(templates, (EFFECTOR, MODEL), strict=True):
            writer.add_topic(topic, msgtype)
        for part in range(30):
            blocks = []
            for topic, template in templates.items():
                stamps = np.sort(rng.integers(part * 1000, part * 1000 + 1000, 300)).astype(np.int64)
                rows = template.cdr(filled(template, 300, seed=part))
                blocks.append((topic, stamps, rows))
            writer.write_blocks([*blocks, ("/0", np.zeros(0, np.int64), np.zeros((0, 8), np.uint8))])
            ordered = [
                (s, k, t, r.tobytes()) for k, (t, ss, rs) in enumerate(blocks) for s, r in zip(ss, rs, strict=True)
            ]
            expected += [(t, int(s), r) for s, _, t, r in sorted(ordered, key=lambda item: item[:2])]
            writer.write("/0", EFFECTOR, part * 1000 + 999, rows[0].tobytes())
            expected.append(("/0", part * 1000 + 999, rows[0].tobytes()))
    bag = read(tmp_path / "bag")
    assert [(m.topic, m.stamp_ns, m.data) for m in bag] == expected
    assert bag.warnings == [] and bag.summary is not None
    assert bag.summary.counts == {"/0": 30 * 301, "/1": 30 * 300}
    with AnyReader([tmp_path / "bag"]) as other:
        assert sorted((c.topic, s, d) for c, s, d in other.messages()) == sorted(expected)
    (file,) = (tmp_path / "bag").glob("*.mcap")
    with file.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        found = [(channel.topic, m.log_time, m.data) for _, channel, m in reader.iter_messages()]
        summary = reader.get_summary()
    assert sorted(found) == sorted(expected) and [s for _, s, _ in found] == sorted(s for _, s, _ in found)
    assert summary is not None and summary.statistics is not None
    assert summary.statistics.message_count == len(expected)
    assert summary.statistics.chunk_count == len(summary.chunk_indexes) > 2


@pytest.mark.parametrize("what", ["unknown topic", "negative stamp", "other count", "closed"])
def test_a_block_that_does_not_fit_is_refused_whole(what: str, tmp_path: Path) -> None:
    template = MessageTemplate(EFFECTOR, MESSAGES[EFFECTOR])
    rows, stamps = template.cdr(template.rows(3)), np.arange(3, dtype=np.int64)
    with BagWriter(tmp_path / "bag") as writer:
        writer.add_topic("/a", EFFECTOR)
        if what == "closed":
            writer.close()
        bad = {"unknown topic": ("/b", stamps, rows), "negative stamp": ("/a", stamps - 1, rows)}
        block = bad.get(what, ("/a", stamps[:2] if what == "other count" else stamps, rows))
        with pytest.raises(BagError):
            writer.write_blocks([("/a", stamps, rows), block])
    assert list(read(tmp_path / "bag")) == []
