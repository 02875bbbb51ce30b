"""Plant, pilot and recorder: lockstep, real time, time-outs, refusals, damage, reset, and a bag of it all."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from msls_msgs.msg import DitherCommand, EffectorCommand, LinearModel, StateSample
from nodes.made_up import Clockwork
from nodes.tower import STEP, TRIM, Tower
from rcl_interfaces.srv import DescribeParameters
from rclpy.node import Node
from rclpy.parameter import Parameter
from rosbags.highlevel import AnyReader
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

from msls_ros import messages
from msls_ros.estimation import EstimationError
from msls_ros.nodes import pilot, plant, recorder
from msls_ros.nodes.identifier import IdentifierNode
from msls_ros.nodes.mixer import MixerNode
from msls_ros.nodes.parameters import NodeError, declare_table
from msls_ros.nodes.pilot import PilotNode
from msls_ros.nodes.plant import PlantNode
from msls_ros.nodes.recorder import FIXED_LAW, RecorderNode
from msls_ros.nodes.running import bad_input
from msls_ros.plant import STATES, PlantError
from msls_ros.testing import Bench

NAN, INF = float("nan"), float("inf")


def test_the_plant_waits_for_command_and_dither_and_stamps_what_follows(bench: Bench) -> None:
    tower = Tower(bench)
    clock: list[Clock] = bench.listen(Clock, "/clock")
    for first, second in (("command", "dither"), ("dither", "command")):
        published = tower.plant.samples
        bench.publish(first, getattr(tower, first)())
        bench.spin_until(lambda: tower.answered == 1, "the first answer")
        assert tower.plant.samples == published
        bench.publish(second, getattr(tower, second)())
        bench.expect(tower.effectors, published + 1)
    bench.expect(clock, 2)
    assert [messages.stamp_of(m) for m in tower.effectors] == [0, STEP, 2 * STEP]
    assert [m.clock.nanosec for m in clock] == [STEP, 2 * STEP]
    assert tower.plant.time_outs == 0


Spoil = Callable[[Tower], Any]
BAD: dict[str, tuple[str, str, Spoil]] = {
    "a NaN command": ("command", "not_finite", lambda t: t.command(delta=[0.0] * 6 + [NAN])),
    "an infinite command": ("command", "not_finite", lambda t: t.command(delta=[INF] + [0.0] * 6)),
    "a short command": ("command", "length", lambda t: t.command(delta=[0.0] * 6)),
    "an empty command": ("command", "names", lambda t: EffectorCommand()),
    "a command for unknown effectors": ("command", "names", lambda t: t.command(effectors=list("abcdefg"))),
    "a command for an earlier sample": ("command", "late", lambda t: t.command(stamp=t.stamp - STEP)),
    "a command for a sample to come": ("command", "early", lambda t: t.command(stamp=t.stamp + STEP)),
    "a NaN dither": ("dither", "not_finite", lambda t: t.dither(delta=[NAN] + [0.0] * 6)),
    "an infinite dither": ("dither", "not_finite", lambda t: t.dither(delta=[-INF] + [0.0] * 6)),
    "a long dither": ("dither", "length", lambda t: t.dither(delta=[0.0] * 8)),
    "a dither for unknown effectors": ("dither", "names", lambda t: t.dither(effectors=["de"] * 7)),
    "a dither for an earlier sample": ("dither", "late", lambda t: t.dither(stamp=0)),
    "a dither for a sample to come": ("dither", "early", lambda t: t.dither(stamp=t.stamp + 1)),
}


@pytest.fixture(scope="module")
def tower(shared_bench: Bench) -> Tower:
    made = Tower(shared_bench)
    made.step()
    return made


@pytest.mark.parametrize("what", BAD)
def test_the_plant_refuses_and_counts_and_waits_on(tower: Tower, what: str) -> None:
    topic, reason, spoil = BAD[what]
    before, total, samples = tower.plant.refused[reason], sum(tower.plant.refused.values()), tower.plant.samples
    tower.bench.publish(topic, spoil(tower))
    tower.bench.spin_until(lambda: tower.plant.refused[reason] == before + 1, f"a refusal ({reason})")
    assert (tower.plant.samples, tower.answered) == (samples, 0)
    tower.step()
    assert sum(tower.plant.refused.values()) == total + 1
    assert np.isfinite(tower.state[-1].x).all()


def test_a_second_answer_to_the_same_sample_is_refused(bench: Bench) -> None:
    tower = Tower(bench)
    bench.publish("command", tower.command())
    bench.publish("command", tower.command(delta=[0.3] * 7))
    bench.spin_until(lambda: tower.plant.refused["stamp_repeated"] == 1, "a refusal")
    assert list(tower.plant._answers["command"]) == list(TRIM.delta)


def test_each_reason_is_logged_once_a_second(bench: Bench, capfd: pytest.CaptureFixture[str]) -> None:
    tower = Tower(bench)
    clock = Clockwork()
    tower.plant._refusals._clock = clock  # type: ignore[assignment]
    for _ in range(5):
        bench.publish("command", tower.command(delta=[NAN] * 7))
        bench.publish("dither", tower.dither(delta=[]))
    bench.spin_until(lambda: tower.plant.refused["not_finite"] == tower.plant.refused["length"] == 5, "refusals")
    lines = capfd.readouterr().err
    assert lines.count("refused (not_finite") == lines.count("refused (length") == 1


def test_a_pilot_of_nan_is_told_of_and_the_plant_flies_on_at_trim(
    bench: Bench, capfd: pytest.CaptureFixture[str]
) -> None:
    tower = Tower(bench, time_out=0.05)
    newest = bench.diagnostics("plant")
    shown = 0
    while tower.plant.time_outs < 8:
        if tower.plant.samples > shown:
            shown = tower.plant.samples
            bench.publish("command", tower.command(delta=[NAN] * 7))
            bench.publish("dither", tower.dither(delta=[0.01] * 7))
        bench.executor.spin_once(timeout_sec=0.05)
    bench.spin_until(lambda: newest().get("refused: not_finite", "0") != "0", "diagnostics")
    assert "flying on at trim with zero dither" in capfd.readouterr().err
    for sample in tower.effectors:
        np.testing.assert_allclose(sample.delta, TRIM.delta, atol=1e-6)
    assert np.isfinite(tower.state[-1].x).all()
    assert tower.plant.time_outs >= 8


def test_an_identifier_may_be_missing_where_nobody_waits_for_it(bench: Bench) -> None:
    flown = bench.add(PlantNode, wait_for_dither=False, duration=0.5, time_out=3600.0)
    bench.add(PilotNode)
    bench.spin_until(flown.finished.done, "the end of the flight")
    assert (flown.samples, flown.time_outs) == (26, 0)


def loop(bench: Bench, **parameters: Any) -> tuple[PlantNode, PilotNode, IdentifierNode]:
    steering = bench.add(PilotNode)
    lockstep = parameters.get("mode") != "real_time"
    identifier = bench.add(IdentifierNode, use_sim_time=lockstep, lockstep=lockstep)
    return bench.add(PlantNode, **parameters), steering, identifier


def test_lockstep_starts_by_itself_and_nothing_is_refused_or_late(bench: Bench) -> None:
    flown, steering, identifier = loop(bench, duration=1.0, time_out=60.0)
    bench.spin_until(flown.finished.done, "the end of the flight")
    bench.spin_until(lambda: identifier.synchronizer.paired == 51, "the last sample")
    assert (flown.samples, flown.time_outs) == (51, 0)
    assert not (flown.refused + steering.refused + identifier.synchronizer.refused)


def test_real_time_flies_with_the_newest_answers_and_at_trim_when_they_are_old(
    bench: Bench, capfd: pytest.CaptureFixture[str]
) -> None:
    flown, steering, identifier = loop(bench, mode="real_time", noise="none", time_out=0.2)
    bench.spin_until(lambda: identifier.synchronizer.paired > 20 and flown._answers["dither"] is not None, "samples")
    assert identifier.estimate is not None
    assert np.isfinite(identifier.estimate.b).all()
    assert not steering.refused
    bench.remove(steering)
    bench.spin_until(lambda: flown._answers["command"] is None, "the time-out")
    assert flown.time_outs >= 1
    assert "flying on at trim with zero dither" in capfd.readouterr().err
    count = flown.samples
    bench.spin_until(lambda: flown.samples > count + 3, "samples at trim")


def test_in_real_time_answers_out_of_order_are_refused_but_never_a_stop(bench: Bench) -> None:
    tower = Tower(bench, mode="real_time", time_out=3600.0)
    gate = tower.plant.refused
    for kind in ("command", "dither"):
        make = getattr(tower, kind)
        later = tower.stamp + 10 * STEP
        before = sum(gate.values())
        bench.publish(kind, make(stamp=later))
        bench.publish(kind, make(stamp=later))
        bench.publish(kind, make(stamp=later - STEP))
        bench.spin_until(lambda n=before: sum(gate.values()) == n + 2, "refusals")  # type: ignore[misc]
    assert (gate["stamp_repeated"], gate["stamp_back"]) == (2, 2)
    bench.publish("dither", tower.dither(stamp=0, delta=[0.01] * 7, level=DitherCommand.LEVEL_INHIBITED))
    bench.spin_until(lambda: tower.plant._answers["dither"][0] == 0.01, "the stop")
    assert sum(gate.values()) == 4


def test_reset_flies_the_same_again_to_the_last_bit(bench: Bench) -> None:
    state: list[StateSample] = []
    model: list[LinearModel] = []
    bench.probe.create_subscription(StateSample, "state", state.append, 100)
    bench.probe.create_subscription(LinearModel, "model", model.append, 100)
    flown, _, identifier = loop(bench, autostart=False, time_out=60.0)
    flown.start()
    early = bench.call(Trigger, "plant/reset")
    assert early.success == (flown.samples > 51)
    bench.spin_until(lambda: flown.samples >= 70, "samples")
    assert bench.call(Trigger, "plant/reset").success
    bench.spin_until(lambda: identifier.synchronizer.restarts == 1 and flown.samples >= 70, "samples again")
    bench.spin_until(lambda: len([m for m in model if messages.stamp_of(m) == 60 * STEP]) == 2, "models")
    for heard in (state, model):
        flights: list[dict[int, Any]] = [{}]
        for message in heard:
            stamp = messages.stamp_of(message)
            if stamp in flights[-1]:
                flights.append({})
            flights[-1][stamp] = message
        first, second = flights
        for stamp in range(0, 60 * STEP, STEP):
            field = "x" if heard is state else "b"
            assert getattr(first[stamp], field).tobytes() == getattr(second[stamp], field).tobytes()


SPOILT_STATES: dict[str, tuple[str, Callable[[StateSample], object]]] = {
    "a NaN state": ("not_finite", lambda m: m.x.__setitem__(0, NAN)),
    "an infinite state": ("not_finite", lambda m: m.x.__setitem__(8, -INF)),
    "a short state": ("length", lambda m: m.x.pop()),
    "no state": ("names", lambda m: setattr(m, "states", [])),
    "an unknown state": ("names", lambda m: m.states.__setitem__(0, "speed")),
    "a repeated stamp": ("stamp_repeated", lambda m: setattr(m.header, "stamp", messages.time_message(100 * STEP))),
    "a stamp that goes back": ("stamp_back", lambda m: setattr(m.header, "stamp", messages.time_message(99 * STEP))),
}


def test_the_pilot_refuses_and_counts_and_answers_the_next(bench: Bench) -> None:
    node = bench.add(PilotNode)
    commands: list[EffectorCommand] = bench.listen(EffectorCommand, "command")
    newest = bench.diagnostics("pilot")

    def sample(stamp: int) -> StateSample:
        return messages.state_message(stamp, STATES, TRIM.x, np.zeros(9))

    bench.publish("state", sample(100 * STEP))
    for number, (reason, spoil) in enumerate(SPOILT_STATES.values()):
        bench.expect(commands, 1)
        message = sample(101 * STEP)
        spoil(message)
        bench.publish("state", message)
        bench.spin_until(lambda n=number: sum(node.refused.values()) == n + 1, f"refusal ({reason})")  # type: ignore[misc]
        assert node.refused[reason] > 0
    bench.publish("state", sample(101 * STEP))
    bench.publish("state", sample(0))  # a jump back of more than a second: a new flight
    bench.expect(commands, 3)
    assert [messages.stamp_of(m) for m in commands] == [100 * STEP, 101 * STEP, 0]
    assert all(np.isfinite(m.delta).all() for m in commands)
    assert node.refused == {"not_finite": 2, "length": 1, "names": 2, "stamp_repeated": 1, "stamp_back": 1}
    bench.spin_until(lambda: newest().get("refused: stamp_back") == "1", "diagnostics")
    assert newest()["commands"] == "3"


WRONG_AT_THE_START: list[tuple[type[Node], str, Any, str]] = [
    (PlantNode, "condition", "moon", "one of high_alpha, cruise"),
    (PlantNode, "noise", "loud", "one of none, low, med"),
    (PlantNode, "mode", "warp", "one of lockstep, real_time"),
    (PlantNode, "seed", -1, "0 to 2.14748e+09"),
    (PlantNode, "seed", "x", "a whole number"),
    (PlantNode, "fdm_rate", 7, "50 to 1000 Hz"),
    (PlantNode, "steps_per_sample", 0, "1 to 1000 steps"),
    (PlantNode, "time_out", NAN, "0.01 to 3600 s"),
    (PlantNode, "faults", "rudder", "a list of words"),
    (PlantNode, "faults", ["rudder"], "the fault 'rudder' has no time; expected EFFECTOR time="),
    (PlantNode, "faults", ["rudder time=inf effectiveness=0"], "time inf s: expected a number from 0"),
    (PlantNode, "faults", ["wing time=1 effectiveness=0"], "expected one of left_stabilator"),
    (PlantNode, "faults", ["rudder time=1 effectiveness=1.5"], "expected a number from 0 (lost) to 1 (intact)"),
    (
        PlantNode,
        "faults",
        ["dr time=1 effectiveness=0", "rudder time=1 effectiveness=1"],
        "faults[1].effector 'rudder'",
    ),
    (PilotNode, "condition", "moon", "one of high_alpha, cruise"),
    (PilotNode, "manoeuvre", "loop", "one of roll_doublet, steady"),
    (PilotNode, "roll_rate", NAN, "-1 to 1 rad/s"),
    (RecorderNode, "topics", ["state", "gossip"], "one of state"),
    (RecorderNode, "overwrite", 1, "true or false"),
    (IdentifierNode, "publish_every", 0, "1 to 1e+06 samples"),
    (IdentifierNode, "estimator__forgetting_factor", 2.0, "[0.01, 1] 1"),
    (IdentifierNode, "states", ["u", "u"], "must differ"),
]


@pytest.mark.parametrize("wrong", WRONG_AT_THE_START, ids=lambda w: f"{w[0].__name__} {w[1]} {w[2]}")
def test_a_wrong_parameter_at_the_start_is_refused_in_one_sentence(
    shared_bench: Bench, wrong: tuple[type[Node], str, Any, str]
) -> None:
    kind, name, value, expected = wrong
    with pytest.raises((NodeError, EstimationError, PlantError)) as caught:
        shared_bench.add(kind, **{name: value})
    assert expected in str(caught.value)
    assert name.replace("__", ".") in str(caught.value)
    assert "\n" not in str(caught.value)


def test_every_parameter_of_plant_pilot_and_recorder_is_described_and_fixed(bench: Bench) -> None:
    for number, table in enumerate((plant.PARAMETERS, pilot.PARAMETERS, recorder.PARAMETERS)):
        node = bench.adopt(Node(f"bare{number}", context=bench.context))
        declare_table(node, table)
        found = bench.call(DescribeParameters, f"bare{number}/describe_parameters", names=list(table)).descriptors
        for d in found:
            default = table[d.name][0]
            assert d.description, d.name
            assert "fixed at the start" in d.additional_constraints, d.name
            if isinstance(default, (int, float)) and not isinstance(default, bool):
                assert d.description.endswith("]"), d.name
                assert d.floating_point_range or d.integer_range, d.name
            result = node.set_parameters([Parameter(d.name, value=default)])[0]
            assert not result.successful, d.name
            assert "read-only" in result.reason, d.name


def test_a_parameter_that_does_not_exist_is_told_of(bench: Bench, capfd: pytest.CaptureFixture[str]) -> None:
    bench.add(PilotNode, manoeuver="steady", xyz=1)
    said = capfd.readouterr().err
    assert "parameter 'manoeuver' does not exist and is ignored; did you mean 'manoeuvre'? --help lists all" in said
    assert "parameter 'xyz' does not exist and is ignored; --help lists all" in said


@pytest.mark.parametrize("kind", [IdentifierNode, MixerNode])
def test_a_misspelt_parameter_is_named_before_a_value_is_refused_for_it(
    kind: type[Any], bench: Bench, capfd: pytest.CaptureFixture[str]
) -> None:
    """Without the three effectors that are meant there are seven, which three values do not fit."""
    values = {"dither.actuator_bandwidth": [25.0] * 3} if kind is IdentifierNode else {"authority": [0.1] * 3}
    with pytest.raises(bad_input(), match="7"):
        bench.add(kind, efectors=["de", "da", "dr"], **values)
    said = capfd.readouterr().err
    assert "parameter 'efectors' does not exist and is ignored; did you mean 'effectors'? --help lists all" in said


def test_a_recorded_flight_is_read_by_others_and_stamped_by_its_messages(bench: Bench, tmp_path: Path) -> None:
    written = bench.add(RecorderNode, out=str(tmp_path / "bag"))
    flown, _, _ = loop(bench, duration=0.5, autostart=False, time_out=60.0)
    expected = {"state", "effectors", "command", "dither", "truth/state", "/clock", "model"}
    topics = [bench.probe.resolve_topic_name(t) for t in FIXED_LAW]
    bench.spin_until(lambda: all(flown.count_publishers(t) and flown.count_subscribers(t) for t in topics), "topics")
    bench.spin_until(
        lambda: all(
            p.get_subscription_count() == bench.probe.count_subscribers(p.topic_name)
            for node in bench.nodes
            for p in node.publishers
            if p.topic_name in topics
        ),
        "connections",
    )
    flown.start()
    bench.spin_until(lambda: all(written.counts[t] == 26 for t in expected), "the recorder")
    assert written.counts["truth/model"] == 6
    bench.remove(written)
    with AnyReader([tmp_path / "bag"]) as reader:
        heard = {c.topic: c.msgcount for c in reader.connections}
        for connection, stamp, raw in reader.messages():
            message: Any = reader.deserialize(raw, connection.msgtype)
            at = message.clock if connection.topic == "/clock" else message.header.stamp
            assert at.sec * 1_000_000_000 + at.nanosec == stamp
    assert heard == {bench.probe.resolve_topic_name(t): written.counts[t] for t in FIXED_LAW}
    with (tmp_path / "bag" / "bag_0.mcap").open("rb") as file:
        found = [(channel.topic, m.log_time) for _, channel, m in make_reader(file).iter_messages()]
    assert len(found) == sum(heard.values())
    assert {t for topic, t in found if topic == "/state"} == {k * STEP for k in range(26)}


def test_a_stamp_before_time_began_is_not_recorded_but_counted(bench: Bench, tmp_path: Path) -> None:
    written = bench.add(RecorderNode, out=str(tmp_path / "bag"), topics=["state"])
    for stamp in (-STEP, STEP):
        bench.publish("state", messages.state_message(stamp, STATES, TRIM.x, np.zeros(9)))
    bench.spin_until(lambda: written.counts["state"] == 1, "the good one")
    assert written._refusals.counts == {"stamp_negative": 1}
