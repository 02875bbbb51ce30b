"""One flight as five kinds of log: one command each, no map given, the same estimates; and the page in one step."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from inputs import mapped_messages as made
from inputs.mapped_logs import write_dataflash, write_ulog
from inputs.mapped_messages import RATE, TRIM, Flight, Sent, rigid_flight, write_bag
from offline.replayed import run
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore

from msls_ros.bags import LogReader, open_any
from msls_ros.commands import inspect, report
from msls_ros.inputs.derivatives import DerivativeFilter, usual_intervals
from msls_ros.offline.replay import load
from msls_ros.offline.suggestion import suggest

EPOCH = 1_790_000_000 * 10**9
TRUTH = {"P/P": -8.0, "P/da": 40.0, "Q/Q": -5.0, "Q/de": -30.0, "R/dr": -12.0, "R/da": -2.0}
"""Of the flight, by the names of the states and surfaces."""
WHOLE = {**TRUTH, "P/v": -0.5, "P/R": 1.5, "P/dr": 2.0, "Q/w": -1.0, "R/v": 0.6, "R/P": -0.3, "R/R": -1.5}
"""All of the moments; what is not here is 0."""
SIGNS = {"flight.ulg": {}, "flight.bin": {}, "rosbag2": {}, "ros1.bag": {}, "mavros": {"de": -1.0}}
"""The way that a servo turns is not known to a map of pulses."""
EVERY = 10
"""Samples of 50 Hz per model."""
NAMES = {"elevator": "de", "aileron": "da", "rudder": "dr", "servo1": "da", "servo2": "de", "servo4": "dr"}


@pytest.fixture(scope="module")
def flight() -> Flight:
    return rigid_flight(12.0)


def write_ros1(path: Path, sent: list[Sent]) -> Path:
    """Write messages of ROS 1, at stamps of today."""
    store = get_typestore(Stores.ROS1_NOETIC)
    with Writer(path) as writer:
        connections = {}
        for log, topic, msgtype, fields in sent:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, msgtype, typestore=store)
            message = _ros1(store, msgtype, fields)
            writer.write(connections[topic], log + EPOCH, store.serialize_ros1(message, msgtype))
    return path


def _ros1(store: Any, msgtype: str, given: Any) -> Any:
    """Make a message; what is not given is zero."""
    kind = store.types[msgtype]
    values = {}
    for name, (form, detail) in store.fielddefs[msgtype][1]:
        value = given.get(name) if isinstance(given, dict) else None
        if msgtype == "std_msgs/msg/Header" and name == "stamp":
            nanoseconds = (given or {}).get("stamp", {}).get("sec", 0) * 10**9 + given["stamp"]["nanosec"] + EPOCH
            stamp = store.types["builtin_interfaces/msg/Time"]
            values[name] = stamp(nanoseconds // 10**9, nanoseconds % 10**9)
        elif form.name == "NAME":
            values[name] = _ros1(store, detail, value or {})
        elif form.name == "BASE":
            values[name] = value if value is not None else "" if detail[0] == "string" else 0
        elif detail[0][1][0] == "string":
            values[name] = list(value or [])
        else:
            values[name] = np.asarray(value if value is not None else np.zeros(detail[1] or 0), dtype=np.float64)
    return kind(**values)


def log_of(kind: str, flight: Flight, folder: Path) -> Path:
    named = replace(flight, effectors=("elevator", "aileron", "rudder"))
    if kind == "flight.ulg":
        return write_ulog(folder / kind, flight)
    if kind == "flight.bin":
        return write_dataflash(folder / kind, flight)
    if kind == "ros1.bag":
        return write_ros1(folder / kind, list(made.standard(named)))
    sent = made.mavros(flight) if kind == "mavros" else made.standard(named)
    return write_bag(folder / kind, sent, folder / "definitions")


@pytest.mark.parametrize("kind", SIGNS)
def test_a_log_of_any_kind_gives_the_flight_s_numbers_by_one_command(
    kind: str, flight: Flight, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = log_of(kind, flight, tmp_path)
    assert ("\n      airspeed: " in suggest(open_any(log))) == kind.startswith("flight."), "where it is logged"
    code, out, err = run(capsys, log, "--out", tmp_path / "out", "--json", "--every", EVERY)
    assert (code, err) == (0, [])
    (summary,) = json.loads(out)
    assert "a map made from the log's own topics" in summary["parameters"]
    assert not [f for f in summary["findings"] if f["level"] == "wrong"]
    assert 0.0 <= summary["start_s"] < 2.0 and summary["end_s"] < 14.0, "flight time, not epoch seconds"
    found = {f"{k['row']}/{NAMES.get(k['column'], k['column'])}": k for k in summary["reliable"]}
    for name, known in found.items():
        if name[0] in "PQR":
            sign = SIGNS[kind].get(name.split("/")[1], 1.0)
            at = round((known["time"] - summary["start_s"]) * RATE)
            around = [truth_of(flight, name, k) for k in range(max(at - 8, 0), min(at + 9, len(flight.x)))]
            off = min(abs(known["value"] * sign - one) for one in around)
            assert off < 3.0 * known["std"], (name, known, around)
    assert len(found.keys() & TRUTH.keys()) >= 4, found.keys()
    models = [m for _, m in load(tmp_path / "out" / Path(kind).stem).topic("model")]
    first, model = models[0], models[-1]
    passed = model.header.stamp.sec - first.header.stamp.sec
    passed += (model.header.stamp.nanosec - first.header.stamp.nanosec) * 1e-9
    last = np.concatenate([np.reshape(model.a, (9, 9)), np.reshape(model.b, (9, 3))], axis=1)
    columns = [NAMES.get(name, name) for name in (*model.states, *model.effectors)]
    at = round(passed * RATE) + 2 * EVERY - 1
    sampled = by_samples(flight, at, measured=kind == "flight.ulg")
    for name, reference in sampled.items():
        row, column = name.split("/")
        value = last[model.states.index(row), columns.index(column)] * SIGNS[kind].get(column, 1.0)
        truth = truth_of(flight, name, at)
        off = min(abs(value / reference - 1.0), abs(value / truth - 1.0))
        assert off < 0.015, (name, value, reference, truth)


def truth_of(flight: Flight, name: str, k: int) -> float:
    """Return a derivative at sample k, of moments that go with airspeed: their size goes with u, v and w."""
    row, column = name.split("/")
    x, delta = flight.x[k], dict(zip(flight.effectors, flight.delta[k], strict=True))
    square = float(x[:3] @ x[:3])
    fast = np.sqrt(square / float(TRIM[:3] @ TRIM[:3]))
    moved = {n: fast * (x[i] - TRIM[i]) for i, n in enumerate("uvwPQR")}
    moved |= {n: 2.0 * fast**2 * d for n, d in delta.items()}
    whole = float(WHOLE.get(name, 0.0) * (fast**2 if column in delta else fast))
    if column not in "uvw":
        return whole
    size = sum(WHOLE.get(f"{row}/{n}", 0.0) * float(m) for n, m in moved.items())
    return whole + float(x["uvw".index(column)]) / square * size


def by_samples(flight: Flight, at: int, *, measured: bool) -> dict[str, float]:
    """Return what least squares makes of the flight's own samples at 50 Hz: off the truth by the error of sampling.

    At the speed of a sample: effects go with airspeed.
    """
    fast = np.linalg.norm(flight.x[::2, :3], axis=1)[:, None] / float(np.linalg.norm(flight.x[at, :3]))
    signals = np.concatenate([fast * flight.x[::2, :6], fast * fast * flight.delta[::2]], axis=1)
    window, smooth, slope = DerivativeFilter(usual_intervals(0.5 * RATE), 12, 10**9), signals, flight.xdot[::2, 3:6]
    if not measured:
        rows = np.concatenate([signals, flight.x[::2, 3:6]], axis=1)
        passed = [window.push(flight.stamp(2 * k), row) for k, row in enumerate(rows)]
        smooth = np.array([one.smooth[:9] for one in passed if one])
        slope = np.array([one.slope[9:] for one in passed if one])
    weights, *_ = np.linalg.lstsq(np.column_stack([smooth, np.ones(len(smooth))]), slope, rcond=None)
    names = [*"uvwPQR", *flight.effectors]
    found = {n: float(weights[names.index(n.split("/")[1]), "PQR".index(n[0])]) for n in TRUTH}
    assert all(found[n] == pytest.approx(truth_of(flight, n, at), rel=0.02) for n in TRUTH), found
    return found


def test_the_page_of_a_foreign_log_in_one_step(
    flight: Flight, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    log = log_of("flight.ulg", flight, tmp_path)
    decoded, decode = [0], LogReader.decode

    def counted(self: LogReader, message: Any) -> Any:
        decoded[0] += 1
        return decode(self, message)

    monkeypatch.setattr(LogReader, "decode", counted)
    assert report.main([str(log), "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert decoded[0] < 2.1 * 4332, "messages are decoded for the map, then once for check and estimate together"
    assert Path(summary["report"]) == tmp_path / "flight_report" / "report.html"
    assert {"trust", "model", "parameters", "flight"} <= set(summary["sections"])
    page = Path(summary["report"]).read_text()
    assert "Read with a map made from the log&#x27;s own topics" in page
    assert "frames, signs and units agree with the motion" in page


def test_inspect_says_what_is_wrong_and_suggests_a_map_that_works(
    flight: Flight, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = log_of("rosbag2", flight, tmp_path)
    good, bad = tmp_path / "good.yaml", tmp_path / "bad.yaml"
    assert inspect.main([str(log), "--suggest"]) == 0
    text = capsys.readouterr().out
    assert inspect.main([str(log), "--suggest", str(good)]) == 0 and good.read_text() == text
    assert inspect.main([str(log), "--suggest", str(good)]) == 2, "never overwritten"
    capsys.readouterr()
    bad.write_text(text.replace("imu angular_velocity frame=flu", "imu angular_velocity"))
    assert inspect.main([str(log), "--params", str(good), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["wrong"] == 0
    assert inspect.main([str(log), "--params", str(bad)]) == 1
    assert "inputs.angular_velocity: frame=flu" in capsys.readouterr().out
    arguments = (log, "--params", bad, "--out", tmp_path / "out", "--overwrite")
    code, _, err = run(capsys, *arguments)
    assert code == 2 and len(err) == 1 and "frame=flu" in err[0] and "--anyway" in err[0]
    assert run(capsys, *arguments, "--anyway", "--every", 100)[0] == 0


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [("a.ulg", b"ULog\x01\x12\x35\x01", "not a log of PX4"), ("b.bin", b"\xa3\x95\x80\x00", "not a log of ArduPilot"),
     ("c.bag", b"text", "not a bag")],
)  # fmt: skip
def test_what_is_no_log_gets_one_line(
    name: str, content: bytes, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / name).write_bytes(content)
    assert inspect.main([str(tmp_path / name)]) == 2
    captured = capsys.readouterr()
    assert captured.out == "" and captured.err.count("\n") == 1 and said in captured.err
