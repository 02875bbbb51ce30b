"""Messages that are there but cannot be decoded are not said to be missing."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from inputs import mapped_messages as made
from inputs.mapped_messages import rigid_flight

from msls_ros.bags import BagWriter
from msls_ros.commands import inspect, report


@pytest.mark.parametrize("damaged", [True, False])
def test_an_inspection_counts_messages_that_cannot_be_decoded(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], damaged: bool
) -> None:
    flight = replace(rigid_flight(2.0), effectors=("elevator", "aileron", "rudder"))
    with BagWriter(tmp_path / "bag") as writer:
        for logged, topic, msgtype, fields in made.standard(flight):
            writer.add_topic("/joint_states", made.JOINTS)
            if topic != "/joint_states":
                writer.write_message(topic, msgtype, logged, fields)
            elif damaged:
                writer.write(topic, msgtype, logged, b"\x00\x01\x00\x00\xff")
    assert inspect.main([str(tmp_path / "bag"), "--params", "odometry_jointstate"]) == 1
    said = " ".join(capsys.readouterr().out.split())
    assert ("100 messages, none can be decoded:" in said and "5 bytes that are not a message" in said) == damaged
    assert ("has no message in this log" in said) != damaged
    assert report.main([str(tmp_path / "bag"), "--params", "odometry_jointstate", "--out", str(tmp_path / "page")]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert ("100 messages, none can be decoded:" in said) == damaged, "and so does the report"
