"""Messages that are there but cannot be decoded are counted, and not said to be missing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from inputs import mapped_messages as made
from inputs.mapped_messages import rigid_flight
from offline.replayed import BAGS, EFFECTORS

from msls_ros.bags import BagWriter, MessageTemplate, read
from msls_ros.commands import inspect, report

BROKEN = b"\x00\x01\x00\x00\xff"
WHY = "5 bytes that are not a message of this type"
PARAMETERS = ["--params", "odometry_jointstate"]


def joints_that(folder: Path, sent: Callable[[int], bytes | bool | None]) -> Path:
    """Write a bag whose k-th message of 100 of the joints is whole (True), left out (None), or these bytes."""
    flight = replace(rigid_flight(2.0), effectors=("elevator", "aileron", "rudder"))
    number = 0
    with BagWriter(folder) as writer:
        writer.add_topic("/joint_states", made.JOINTS)
        for logged, topic, msgtype, fields in made.standard(flight):
            one = sent(number) if topic == "/joint_states" else True
            number += topic == "/joint_states"
            if one is True:
                writer.write_message(topic, msgtype, logged, fields)
            elif one:
                writer.write(topic, msgtype, logged, one)
    return folder


@pytest.mark.parametrize(
    ("sent", "level", "found"),
    [
        (lambda k: BROKEN, "wrong (1)", "100 messages, none can be decoded: "),
        (lambda k: BROKEN if k % 7 == 0 else True, "doubtful (1)", "100 messages, 15 cannot be decoded: "),
        (lambda k: None, "wrong (1)", "has no message in this log"),
        (lambda k: True, "", ""),
    ],
    ids=["none", "some", "no message", "all"],
)
def test_an_inspection_and_a_report_count_messages_that_cannot_be_decoded(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    sent: Callable[[int], bytes | bool | None],
    level: str,
    found: str,
) -> None:
    bag = joints_that(tmp_path / "bag", sent)
    assert inspect.main([str(bag), *PARAMETERS]) == level.startswith("wrong")
    said = " ".join(capsys.readouterr().out.split())
    assert level in said and found in said
    assert ("decoded" in said) == (WHY in said) == ("decoded" in found)
    assert said.count(str(bag)) == 1, "the log is named at the top"
    assert report.main([str(bag), *PARAMETERS, "--out", str(tmp_path / "page")]) == 0
    assert found in (tmp_path / "page" / "report.html").read_text(encoding="utf-8"), "and so does the report"


def test_our_own_messages_that_cannot_be_read_are_counted_by_reason(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag, number = BAGS / "intact_doublet", 0
    header = {"stamp": {"sec": 1, "nanosec": 0}, "frame_id": ""}
    other = MessageTemplate(EFFECTORS, {"header": header, "effectors": ["flap"], "delta": np.zeros(1)})
    strange = other.cdr(other.rows(1))[0].tobytes()
    with BagWriter(tmp_path / "bag") as writer:
        for message in read(bag, ("/state", "/effectors")):
            if message.topic == "/effectors":
                number += 1
                data = {3: BROKEN, 5: BROKEN, 7: strange}.get(number, message.data)
                message = message._replace(data=data)
            writer.write(*message)
    arguments = [str(tmp_path / "bag"), "--params", str(bag / "identifier.yaml")]
    inspect.main(arguments)
    said = " ".join(capsys.readouterr().out.split())
    assert f"inputs.topics.effectors: {number:,} messages, 2 cannot be decoded: {EFFECTORS}: {WHY}" in said
    assert "inputs.topics.effectors: no 'de' among the names 'flap' (in 1 messages)" in said
