"""Beside a flight-control stack: old samples, stopped clocks, odd rates, parameter files, quality of service."""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import yaml
from msls_msgs.msg import DitherCommand, LinearModel
from msls_msgs.srv import InjectFault
from nodes.made_up import Clockwork, linear_samples
from nodes.tower import STEP, Tower
from rcl_interfaces.srv import GetParameters, ListParameters, SetParameters
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_dict_from_yaml_file, parameter_value_to_python
from rclpy.qos import QoSHistoryPolicy
from rosgraph_msgs.msg import Clock
from std_srvs.srv import SetBool, Trigger

from msls_ros import messages
from msls_ros.inputs.model_file import read_model
from msls_ros.inputs.profiles import config_folder, matches_node
from msls_ros.nodes.controller import ControllerNode
from msls_ros.nodes.identifier import IdentifierNode
from msls_ros.nodes.mixer import MixerNode
from msls_ros.nodes.parameters import LOOK, check_files
from msls_ros.nodes.pilot import PilotNode
from msls_ros.nodes.plant import PlantNode
from msls_ros.nodes.recorder import RecorderNode
from msls_ros.plant import EFFECTORS, STATES
from msls_ros.testing import Bench

X, XDOT, DELTA = linear_samples(400)
SECOND = 1_000_000_000


class Source:
    """Feeds an identifier with samples of any stamps."""

    def __init__(self, bench: Bench, **parameters: Any) -> None:
        self.bench = bench
        self.node = bench.add(IdentifierNode, **parameters)
        self.dither: list[DitherCommand] = bench.listen(DitherCommand, "dither")
        self.model: list[LinearModel] = bench.listen(LinearModel, "model")

    def used(self, count: int) -> bool:
        return self.node.synchronizer.paired == count

    def send(self, *stamps: int) -> None:
        """Publish samples of these stamps [ns] and wait until they have been used."""
        for stamp in stamps:
            wanted = self.node.synchronizer.paired + 1
            k = wanted % 400
            self.bench.publish("state", messages.state_message(stamp, STATES, X[k], XDOT[k]))
            self.bench.publish("effectors", messages.effector_message(stamp, EFFECTORS, DELTA[k]))
            self.bench.spin_until(partial(self.used, wanted), "the sample")


def levels(dithers: list[DitherCommand]) -> list[int]:
    return [d.level for d in dithers]


def test_with_a_clock_that_has_stopped_the_dither_is_zeroed_all_the_same(bench: Bench) -> None:
    source = Source(bench, use_sim_time=True)
    bench.publish("/clock", Clock(clock=messages.time_message(SECOND)))
    source.send(SECOND, SECOND + 20_000_000)
    bench.spin_until(lambda: levels(source.dither)[-1:] == [DitherCommand.LEVEL_INHIBITED], "the zero dither")
    newest = bench.diagnostics("identifier")
    bench.spin_until(lambda: newest().get("status", "").startswith("no samples"), "the diagnostics")
    assert newest()["dither"].startswith("inhibited")


def test_samples_older_than_stale_after_are_learnt_from_but_get_no_dither(
    bench: Bench, capfd: pytest.CaptureFixture[str]
) -> None:
    source, clock = Source(bench, dither__stale_after=5.0), Clockwork()
    source.node._steady = clock
    source.send(time.time_ns() - 500_000_000)
    bench.expect(source.dither, 1)
    now = time.time_ns()
    source.send(now - 400_000_000)
    bench.expect(source.dither, 2)
    assert source.node.set_parameters([Parameter("dither.stale_after", value=0.1)])[0].successful
    clock.nanoseconds += 150_000_000
    source.send(*(now - 300_000_000 + k for k in range(3)))
    bench.expect(source.model, 5, "models of all samples")
    assert sum(level != DitherCommand.LEVEL_INHIBITED for level in levels(source.dither)) == 2
    assert source.node._answers.old == 3
    source.node._watch_inputs()
    assert source.node._health().message.startswith("samples come 0.")
    assert "late, more than 0.1 s: learnt from, but the dither is zero" in source.node._health().message
    told = capfd.readouterr().err
    assert told.count("learnt from, but no dither") == 1, "throttled"


def test_stamps_of_another_epoch_are_not_taken_for_old(bench: Bench) -> None:
    source = Source(bench)
    source.send(*(7 * SECOND + k * 20_000_000 for k in range(3)))
    bench.expect(source.dither, 3)
    assert source.node._answers.old == 0


def test_a_rate_that_is_not_the_promised_one_is_told_of_once(bench: Bench, capfd: pytest.CaptureFixture[str]) -> None:
    source = Source(bench, sample_rate=50.0, dither__stale_after=60.0)
    source.send(*(SECOND + k * 25_000_000 for k in range(120)))
    assert capfd.readouterr().err.count("samples come at 40 Hz, sample_rate is 50 Hz") == 1
    newest = bench.diagnostics("identifier")
    bench.spin_until(lambda: "samples come at 40 Hz" in newest().get("status", ""), "the diagnostics")
    source.send(*(4 * SECOND + k * 20_000_000 for k in range(200)))
    assert "samples come" not in capfd.readouterr().err
    bench.spin_until(lambda: newest().get("status", "").startswith("identifying"), "the diagnostics")


def test_samples_lost_at_ten_times_real_time_name_the_queue(bench: Bench, capfd: pytest.CaptureFixture[str]) -> None:
    """A bag is played tenfold, and the identifier finds forty samples at a time where its queue holds ten."""
    node = bench.add(IdentifierNode, dither__stale_after=60.0)
    newest = bench.diagnostics("identifier")
    clock = node._steady = Clockwork()
    for burst in range(20):
        for k in range(40 * burst + 1, 40 * burst + 41):
            bench.publish("state", messages.state_message(k * 20_000_000, STATES, X[k % 80], XDOT[k % 80]))
            bench.publish("effectors", messages.effector_message(k * 20_000_000, EFFECTORS, DELTA[k % 80]))
        clock.nanoseconds += 80_000_000
        bench.spin_until(lambda: node._sample is not None and node._sample.stamp == k * 20_000_000, "the newest")  # noqa: B023
    assert node.synchronizer.paired < 400
    said = "samples come 10 times as fast as real time, and 7"
    assert capfd.readouterr().err.count(said) == 1
    bench.spin_until(lambda: newest().get("status", "").startswith(said), "the diagnostics")
    assert "'queue', 1 or more; it is 0.1 s of samples" in newest()["status"]
    assert int(newest()["lost, faster than real time [samples]"]) > 300


def test_unpaired_samples_are_told_of_with_the_difference(bench: Bench, capfd: pytest.CaptureFixture[str]) -> None:
    node = bench.add(IdentifierNode, queue=10.0)
    for k in range(1, 80):
        bench.publish("state", messages.state_message(k * 20_000_000, STATES, X[k], XDOT[k]))
        bench.publish("effectors", messages.effector_message(k * 20_000_000 + 3_000_000, EFFECTORS, DELTA[k]))
        bench.executor.spin_once(timeout_sec=0.0)
    bench.spin_until(lambda: node.synchronizer.refused["state_unpaired"] > 0, "an unpaired sample")
    assert "is stamped +3.000000 ms from it; expected within pairing_tolerance, 0 ms" in capfd.readouterr().err


def test_with_a_tolerance_they_are_paired(bench: Bench) -> None:
    source = Source(bench, pairing_tolerance=0.005)
    for k in range(1, 6):
        bench.publish("state", messages.state_message(k * 20_000_000, STATES, X[k], XDOT[k]))
        bench.publish("effectors", messages.effector_message(k * 20_000_000 + 3_000_000, EFFECTORS, DELTA[k]))
        bench.spin_until(partial(source.used, k), "the sample")


# --- parameters ---

PROFILES = [p for found in ("*.yaml", "inputs/*.yaml", "control/*.yaml") for p in sorted(config_folder().glob(found))]


@pytest.mark.parametrize("name", ["/identifier", "/left/identifier", "/a/b/other_name"])
@pytest.mark.parametrize("path", PROFILES, ids=lambda p: p.stem)
def test_shipped_profiles_match_the_node_in_any_namespace_and_under_any_name(path: Path, name: str) -> None:
    assert matches_node(path, name)


SECTIONS = {
    "identifier": ({"/identifier"}, {"/left/identifier", "/other"}),
    "/left/identifier": ({"/left/identifier"}, {"/identifier"}),
    "/*/identifier": ({"/left/identifier"}, {"/identifier", "/a/b/identifier"}),
    "/**/identifier": ({"/identifier", "/a/b/identifier"}, {"/other"}),
    "/**": ({"/identifier", "/a/b"}, set[str]()),
}


@pytest.mark.parametrize("section", SECTIONS)
def test_sections_of_a_parameter_file_match_as_in_ros(tmp_path: Path, section: str) -> None:
    path = tmp_path / "p.yaml"
    path.write_text(yaml.safe_dump({section: {"ros__parameters": {"sample_rate": 40.0}}}))
    yes, no = SECTIONS[section]
    assert all(matches_node(path, name) for name in yes) and not any(matches_node(path, name) for name in no)
    if section.startswith("/left"):
        path.write_text(yaml.safe_dump({"left": {"identifier": {"ros__parameters": {}}}}))
        assert matches_node(path, "/left/identifier")


def test_a_parameter_file_with_nothing_for_the_node_is_told_of(
    bench: Bench, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    node = bench.add(IdentifierNode)
    (tmp_path / "other.yaml").write_text("other:\n  ros__parameters: {a: 1}\n")
    check_files(node, ["x", "--ros-args", "--params-file", str(config_folder() / "f16.yaml")])
    assert "has nothing for this node" not in capfd.readouterr().err
    check_files(node, ["x", "--ros-args", "--params-file", str(tmp_path / "other.yaml")])
    assert "other.yaml' has nothing for this node, /identifier, and is ignored" in capfd.readouterr().err


@pytest.mark.parametrize("path", PROFILES, ids=lambda p: p.stem)
def test_shipped_profiles_are_read_by_param_load_too(path: Path) -> None:
    """It reads each word as YAML of its own: `left: de` would be a mapping, `left:de` is a word."""
    loaded = parameter_dict_from_yaml_file(str(path), use_wildcard=True)
    assert {Parameter.from_parameter_msg(one).name for one in loaded.values()} == loaded.keys() != set()


def dumped(bench: Bench, node: str) -> dict[str, Any]:
    """Return all parameters of a node as `ros2 param dump` gets them."""
    names = bench.call(ListParameters, f"{node}/list_parameters").result.names
    values = bench.call(GetParameters, f"{node}/get_parameters", names=names).values
    return {n: parameter_value_to_python(v) for n, v in zip(names, values, strict=True)}


@pytest.mark.parametrize("kind", [IdentifierNode, PlantNode])
def test_dumped_parameters_start_the_node_again(bench: Bench, tmp_path: Path, kind: type[Node]) -> None:
    name = kind.__name__.removesuffix("Node").lower()
    node = bench.add(kind, autostart=False)
    first = dumped(bench, name)
    assert all(v is not None for v in first.values()), [n for n, v in first.items() if v is None]
    bench.remove(node)
    path = tmp_path / "dump.yaml"
    plain = {n: list(v) if isinstance(v, (list, tuple)) or hasattr(v, "typecode") else v for n, v in first.items()}
    path.write_text(yaml.safe_dump({f"/{name}": {"ros__parameters": plain}}))
    assert parameter_dict_from_yaml_file(str(path)).keys() == plain.keys()
    arguments = ["--ros-args", "--params-file", str(path)]
    make: Any = kind
    bench.adopt(make(context=bench.context, cli_args=arguments))
    assert dumped(bench, name) == first


def test_a_whole_number_keeps_a_double_a_double(bench: Bench) -> None:
    bench.add(IdentifierNode)
    request = [Parameter("estimator.penalty", value=1).to_parameter_msg()]
    assert bench.call(SetParameters, "identifier/set_parameters", parameters=request).results[0].successful
    value = bench.call(GetParameters, "identifier/get_parameters", names=["estimator.penalty"]).values[0]
    assert (value.type, value.double_value) == (Parameter.Type.DOUBLE.value, 1.0)


def test_quality_of_service_is_overridden_by_parameters_and_queues_hold_seconds(bench: Bench) -> None:
    name = "qos_overrides./state.subscription"
    node = bench.add(
        IdentifierNode, **{f"{name}.depth": 7, f"{name}.reliability": "best_effort", "sample_rate": 500.0, "queue": 0.2}
    )
    depths = {s.topic_name: s.qos_profile.depth for s in node.subscriptions if s.topic_name in ("/state", "/effectors")}
    assert depths == {"/state": 7, "/effectors": 100}
    assert all(
        s.qos_profile.history == QoSHistoryPolicy.KEEP_LAST for s in node.subscriptions if s.topic_name in depths
    )
    assert not [n for n in node._parameter_overrides if not node.has_parameter(n)]


@pytest.mark.parametrize("autostart", [True, False])
def test_a_quality_of_service_that_no_topic_takes_is_warned_of_once_the_topics_are_there(
    bench: Bench, capfd: pytest.CaptureFixture[str], autostart: bool
) -> None:
    given = {f"qos_overrides./{topic}.subscription.depth": 7 for topic in ("state", "left/efectors", "left/state")}
    parameters = [Parameter(name, value=value) for name, value in {**given, "autostart": autostart}.items()]
    make: Any = IdentifierNode
    node = bench.adopt(make(context=bench.context, namespace="left", parameter_overrides=parameters))
    said: list[str] = []

    def hear() -> list[str]:
        said.extend(line for line in capfd.readouterr().err.splitlines() if "is ignored" in line)
        return said

    def wait() -> None:
        done: list[bool] = []
        timer = bench.probe.create_timer(5.0 * LOOK, lambda: done.append(timer.cancel() is None))
        bench.spin_until(lambda: done, "the time for a warning")

    if not autostart:
        wait()
        assert not hear()
        assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    bench.spin_until(lambda: len(hear()) >= 2, "the warnings")
    for transition in (node.trigger_deactivate,) * autostart + (node.trigger_cleanup, node.trigger_configure):
        assert transition() == TransitionCallbackReturn.SUCCESS
    wait()
    assert len(hear()) == 2
    for topic, line in zip(("state", "effectors"), said, strict=True):
        assert f"did you mean 'qos_overrides./left/{topic}.subscription.depth'? There are depth, history, " in line
        assert all(end in line for end in ("/left/dither.publisher", "/left/state.subscription", "/diagnostics.pub"))


def test_the_frame_is_a_parameter(bench: Bench) -> None:
    source = Source(bench, frame_id="left/base_link_frd")
    source.send(SECOND)
    bench.expect(source.model, 1)
    assert {source.model[0].header.frame_id, source.dither[0].header.frame_id} == {"left/base_link_frd"}


def test_damage_by_service_leaves_the_effect_where_it_is_not_given() -> None:
    assert InjectFault.Request().effectiveness == 1.0


@pytest.mark.parametrize("publish", [True, False])
def test_the_plant_s_clock_is_published_where_it_is_wanted(bench: Bench, publish: bool) -> None:
    node = bench.add(PlantNode, publish_clock=publish, autostart=False)
    assert ("/clock" in {p.topic_name for p in node.publishers}) == publish


def test_in_real_time_the_plant_drops_old_dither_and_holds_none_for_long(bench: Bench) -> None:
    tower = Tower(bench, mode="real_time", time_out=3600.0, stale_after=0.1)
    bench.spin_until(lambda: tower.stamp > 10 * STEP, "flight")
    before = tower.plant.refused["stale"]
    bench.publish("dither", tower.dither(stamp=STEP))
    bench.spin_until(lambda: tower.plant.refused["stale"] > before, "the refusal")
    bench.publish("command", tower.command())

    def answered() -> bool:
        bench.publish("dither", tower.dither())
        return tower.plant._answers["dither"] is not None

    bench.spin_until(answered, "a fresh dither")
    bench.spin_until(lambda: tower.plant._answers["dither"] is None, "the end of the dither")
    assert tower.plant._answers["command"] is not None


# --- services ---


def test_frozen_it_publishes_zero_dither_and_learns_nothing(bench: Bench) -> None:
    source = Source(bench, dynamic_pressure=False)  # B would go with the speed of each sample
    source.send(*(SECOND + k * 20_000_000 for k in range(30)))
    bench.expect(source.model, 30)
    assert bench.call(SetBool, "identifier/freeze", data=True).success
    source.send(SECOND + 40 * 20_000_000)
    bench.expect(source.model, 31)
    assert list(source.model[30].b) == list(source.model[29].b) and source.model[30].samples == 30
    assert not any(source.dither[-1].delta)
    assert bench.call(SetBool, "identifier/freeze", data=False).success
    source.send(SECOND + 41 * 20_000_000)
    bench.expect(source.model, 32)
    assert source.model[31].samples == 31


def test_a_saved_model_is_read_back_and_started_from(bench: Bench, tmp_path: Path) -> None:
    path = tmp_path / "deep" / "model.yaml"
    source = Source(bench, model_file=str(path))
    assert not bench.call(Trigger, "identifier/save_model").success, "nothing yet"
    for k in range(200):
        source.send(SECOND + k * 20_000_000)
        bench.expect(source.model, k + 1)
    answer = bench.call(Trigger, "identifier/save_model")
    assert answer.success and str(path) in answer.message
    saved = read_model(path)
    assert saved.b.ravel().tolist() == list(source.model[-1].b)
    content = yaml.safe_load(path.read_text())
    assert content["configuration"]["sample_rate"] == 50.0 and content["stamp"] == SECOND + 199 * 20_000_000
    bench.remove(source.node)
    again = bench.add(IdentifierNode, warm_start=str(path))
    assert again._identifier is not None
    estimate = again._identifier.estimate(0.0, saved.x)
    kept = [i for i, s in enumerate(STATES) if s not in ("Phi", "Theta", "Psi")]
    assert estimate.b[kept].tolist() == saved.b[kept].tolist()


def test_after_a_reset_a_saved_model_stays_until_samples_have_come(bench: Bench, tmp_path: Path) -> None:
    path = tmp_path / "model.yaml"
    source = Source(bench, model_file=str(path))
    source.send(SECOND, SECOND + 20_000_000)
    assert bench.call(Trigger, "identifier/save_model").success
    before = path.read_bytes()
    assert bench.call(Trigger, "identifier/reset").success
    answer = bench.call(Trigger, "identifier/save_model")
    assert (answer.success, answer.message) == (False, "nothing to save: no sample has come since the reset")
    assert path.read_bytes() == before
    source.send(SECOND + 40_000_000)
    assert bench.call(Trigger, "identifier/save_model").success
    assert path.read_bytes() != before


def test_a_model_that_does_not_fit_is_refused(bench: Bench, tmp_path: Path) -> None:
    node = bench.add(IdentifierNode, warm_start=str(tmp_path / "none.yaml"), autostart=False)
    assert node.trigger_configure().name == "FAILURE"


def test_the_example_of_a_warm_start_names_parameters_that_there_are(bench: Bench) -> None:
    file = config_folder() / "examples" / "warm_start.yaml"
    given = yaml.safe_load(file.read_text())["/**"]["ros__parameters"]
    node = bench.add(IdentifierNode, autostart=False, **given)
    assert given.keys() == {"model_file", "warm_start"} and given["model_file"] == given["warm_start"]
    assert all(node.has_parameter(name) and node.get_parameter(name).value == value for name, value in given.items())


def test_diagnostics_tell_rates_ages_times_backlog_dither_and_kernels(bench: Bench) -> None:
    source = Source(bench, dither__stale_after=60.0)
    source.send(*(SECOND + k * 20_000_000 for k in range(10)))
    newest = bench.diagnostics("identifier")
    bench.spin_until(lambda: newest().get("state: messages") == "10", "the diagnostics")
    found = newest()
    wanted = [
        "state: rate [Hz]",
        "effectors: age [s]",
        "processing p50 [ms]",
        "processing p99 [ms]",
        "processing max [ms]",
    ]
    wanted += ["backlog [samples]", "last event", "kernels", "dither", "sample rate by stamps [Hz]"]
    assert not [key for key in wanted if key not in found]
    assert found["dither"].startswith("nominal") and found["kernels"] in ("compiled", "interpreted")


def test_nothing_is_built_for_a_model_that_nobody_listens_to(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    node = bench.add(IdentifierNode, lockstep=True)  # no time passes
    dither: list[DitherCommand] = bench.listen(DitherCommand, "dither")
    assert node._identifier is not None
    monkeypatch.setattr(node._identifier, "estimate", None)
    bench.publish("state", messages.state_message(SECOND, STATES, X[0], XDOT[0]))
    bench.publish("effectors", messages.effector_message(SECOND, EFFECTORS, DELTA[0]))
    bench.expect(dither, 1)


def test_the_aggregator_s_file_groups_what_the_nodes_tell() -> None:
    content = yaml.safe_load((config_folder() / "diagnostics" / "aggregator.yaml").read_text())
    groups = content["/**"]["ros__parameters"]
    analyzers = [v for v in groups.values() if isinstance(v, dict)]
    assert {a["type"] for a in analyzers} == {"diagnostic_aggregator/GenericAnalyzer"}
    said = {f"{name}: messages" for name in ("identifier", "plant", "pilot", "mixer")}
    assert {text for a in analyzers for text in a["contains"]} == said


def test_every_topic_of_every_node_has_its_quality_of_service_overridden_by_parameters(
    bench: Bench, tmp_path: Path
) -> None:
    given: dict[Any, tuple[str, dict[str, Any]]] = {
        PlantNode: ("/dither.subscription", {"autostart": False}),
        PilotNode: ("/command.publisher", {}),
        RecorderNode: ("/model.subscription", {"out": str(tmp_path / "bag")}),
        MixerNode: ("/command_out.publisher", {}),
        ControllerNode: ("/pilot_command.subscription", {"condition": "high_alpha"}),
        IdentifierNode: ("/diagnostics.publisher", {}),
    }
    for kind, (where, parameters) in given.items():
        node = bench.add(kind, **{f"qos_overrides.{where}.depth": 7, **parameters})
        topic, side = where.split(".")
        ends = node.publishers if side == "publisher" else node.subscriptions
        assert {e.topic_name: e.qos_profile.depth for e in ends}[topic] == 7
        own = {e.topic_name for e in (*node.publishers, *node.subscriptions)} - {"/rosout"}
        own -= {name for name in own if name.startswith("/parameter") or name.endswith("/transition_event")}
        assert all(any(n.startswith(f"qos_overrides.{topic}.") for n in node._parameters) for topic in own), own
