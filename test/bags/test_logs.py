"""Logs of PX4 and ArduPilot: read as they were written, damaged ones as far as they go, strange ones refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from inputs.mapped_logs import ARDUPILOT, PX4, write_dataflash, write_ulog
from inputs.mapped_messages import Flight, rigid_flight
from pymavlink.DFReader import DFReader_binary

from msls_ros.bags import BagError, LogReader, open_any


@pytest.fixture(scope="module")
def flight() -> Flight:
    return rigid_flight(2.0)


def opened(path: Path) -> LogReader:
    reader = open_any(path)
    assert isinstance(reader, LogReader)
    return reader


def test_a_log_of_px4_is_read_as_it_was_written(flight: Flight, tmp_path: Path) -> None:
    reader = opened(write_ulog(tmp_path / "a.ulg", flight))
    assert reader.topics["/vehicle_angular_velocity"] == "px4_msgs/msg/VehicleAngularVelocity"
    assert reader.summary.counts["/vehicle_angular_velocity"] == 200 and reader.warnings == []
    own = reader.only(["/vehicle_angular_velocity"])
    rows = [decoded for _, decoded in own.decoded()]
    assert np.allclose([r.xyz for r in rows], flight.x[:, 3:6], atol=1e-6)
    assert np.allclose([r.xyz_derivative for r in rows], flight.xdot[:, 3:6], rtol=1e-5, atol=1e-5)
    assert {n: reader.log.parameters[n] for n in PX4} == pytest.approx(PX4)
    stamps = [m.stamp_ns for m in reader]
    assert stamps == sorted(stamps) and len(stamps) == sum(reader.summary.counts.values())


def test_a_log_of_ardupilot_is_read_as_pymavlink_reads_it(flight: Flight, tmp_path: Path) -> None:
    path = write_dataflash(tmp_path / "a.bin", flight)
    reader = opened(path)
    ours = {topic: [d for _, d in reader.only([topic]).decoded()] for topic in reader.topics}
    peer = DFReader_binary(str(path))
    count = 0
    seen = dict.fromkeys(ours, 0)
    while (message := peer.recv_msg()) is not None:
        name = message.get_type().partition("[")[0]
        topic = f"/{name}/1" if name == "IMU" and message.I == 1 else f"/{name}"
        if topic not in ours or name in ("PARM", "FMTU"):
            continue
        row = ours[topic][seen[topic]]
        for field in message.get_fieldnames():
            assert getattr(row, field) == pytest.approx(getattr(message, field), rel=1e-12), (topic, field)
        seen[topic] += 1
        count += 1
    assert count == 2 * 200 + 3 * 100 + 4
    assert {n: reader.log.parameters[n] for n in ARDUPILOT} == ARDUPILOT


@pytest.mark.parametrize("name", ["a.ulg", "a.bin"])
def test_a_damaged_log_is_read_as_far_as_it_goes_and_says_so_or_is_refused(
    name: str, flight: Flight, tmp_path: Path
) -> None:
    whole = (write_ulog if name.endswith("ulg") else write_dataflash)(tmp_path / name, flight).read_bytes()
    random = np.random.default_rng(1)
    read = 0
    for k in range(40):
        data = bytearray(whole[: int(random.integers(20, len(whole)))])
        for place in random.integers(0, len(data), 5 * (k % 3)):
            data[place] = int(random.integers(256))
        path = tmp_path / f"{k}_{name}"
        path.write_bytes(data)
        try:
            reader = open_any(path)
        except BagError as error:
            assert str(path) in str(error) and "\n" not in str(error)
            continue
        read += sum(1 for _ in reader.decoded()) > 0
    assert read > 20


def test_what_is_no_log_is_refused(tmp_path: Path) -> None:
    for name, content in (("a.bin", b"\xa3\x95\x80" + bytes(200)), ("a.ulg", b"ULog\x01\x12\x35\x01" + bytes(3))):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(BagError, match="not a log of"):
            list(open_any(tmp_path / name))
