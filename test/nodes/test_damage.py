"""Damage of the plant in flight: by its parameter and by its service, at once or growing, and stuck surfaces."""

from __future__ import annotations

import pytest
from msls_msgs.msg import LinearModel
from msls_msgs.srv import InjectFault
from nodes.tower import STEP, TRIM, Tower
from std_srvs.srv import Trigger

from msls_ros import messages
from msls_ros.testing import Bench

NAN, INF = float("nan"), float("inf")


def test_damage_by_service_changes_the_truth_and_is_refused_when_wrong(bench: Bench) -> None:
    tower = Tower(bench, truth_every=1)
    truth: list[LinearModel] = bench.listen(LinearModel, "truth/model")
    tower.step()
    answer = bench.call(InjectFault, "plant/inject_fault", effector="left_stabilator", effectiveness=0.0, bias=0.0)
    assert answer.success
    assert "left_stabilator lost" in answer.message
    for wrong in (("left_wing", 0.0, 0.0), ("rudder", 2.0, 0.0), ("rudder", NAN, 0.0), ("ddt", 0.0, INF)):
        answer = bench.call(InjectFault, "plant/inject_fault", effector=wrong[0], effectiveness=wrong[1], bias=wrong[2])
        assert not answer.success
        assert "expected" in answer.message
    tower.step()
    bench.expect(truth, 2)
    b43 = [m.b[3 * 7 + 2] for m in truth]
    assert b43[-1] < 0.6 * b43[0]


def test_damage_by_service_may_grow_and_stick(bench: Bench) -> None:
    tower = Tower(bench, truth_every=100)
    truth: list[LinearModel] = bench.listen(LinearModel, "truth/model")
    answer = bench.call(
        InjectFault, "plant/inject_fault", effector="ddt", effectiveness=0.0, bias=0.0, ramp=0.1, stuck=True
    )
    assert answer.success and "stuck" in answer.message and "over 0.1 s" in answer.message
    for wrong in (-1.0, NAN, INF):
        assert not bench.call(InjectFault, "plant/inject_fault", effector="dr", effectiveness=1.0, ramp=wrong).success
    for _ in range(6):
        bench.publish("command", tower.command(delta=[0.1, *TRIM.delta[1:]]))
        bench.publish("dither", tower.dither())
        bench.expect(tower.effectors, len(tower.effectors) + 1, "the next sample")
    bench.expect(truth, 2)
    assert [round(messages.stamp_of(m) / STEP) for m in truth] == [1, 5], "where the ramp begins and where it ends"
    assert truth[0].b[3 * 7 + 2] > 1.0 and abs(truth[1].b[3 * 7 + 2]) < 1e-6
    assert tower.effectors[-1].delta[0] == pytest.approx(TRIM.delta[0], abs=1e-4), "stuck"


def test_two_faults_strike_in_turn_and_again_after_a_reset(bench: Bench) -> None:
    lines = ["left_stabilator time=0.04 effectiveness=0.0", "dtr time=0.08 effectiveness=0.5 ramp=0.04"]
    tower = Tower(bench, truth_every=100, faults=lines)
    truth: list[LinearModel] = bench.listen(LinearModel, "truth/model")
    for _ in range(55):
        tower.step()
    assert [round(messages.stamp_of(m) / STEP) for m in truth] == [2, 3, 4, 5, 6]
    b43, b67 = ([m.b[k] / truth[0].b[k] for m in truth] for k in (3 * 7 + 2, 5 * 7 + 6))
    assert b43 == pytest.approx([1.0, 0.5, 0.5, 0.5, 0.5], abs=0.01)
    assert b67 == pytest.approx([1.0, 1.0, 1.0, 0.75, 0.5], abs=0.01)
    again = len(truth)
    samples = len(tower.effectors)
    assert bench.call(Trigger, "plant/reset").success
    bench.expect(tower.effectors, samples + 1, "the first sample")
    for _ in range(3):
        tower.step()
    bench.expect(truth, again + 3)
    assert truth[-1].b[3 * 7 + 2] == truth[1].b[3 * 7 + 2]
