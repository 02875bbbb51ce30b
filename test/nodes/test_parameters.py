"""Every parameter of every node: bad values are refused with a reason, live ones count from the next sample on."""

from __future__ import annotations

import gc
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msls_msgs.msg import DitherCommand, LinearModel
from nodes.made_up import Clockwork, linear_samples
from rcl_interfaces.srv import GetParameters, SetParameters, SetParametersAtomically
from rclpy.node import Node
from rclpy.parameter import Parameter

from msls_ros import messages
from msls_ros.estimation import Configuration, EstimationError, Identifier
from msls_ros.nodes import control_parameters, controller, identifier, mixer, pilot, plant, recorder
from msls_ros.nodes.running import bad_input
from msls_ros.plant import EFFECTORS, STATES
from msls_ros.testing import Bench

NODES: dict[str, tuple[type[Node], Any, dict[str, Any]]] = {
    "controller": (controller.ControllerNode, control_parameters.PARAMETERS, {}),
    "identifier": (identifier.IdentifierNode, identifier.PARAMETERS, {}),
    "mixer": (mixer.MixerNode, mixer.PARAMETERS, {}),
    "pilot": (pilot.PilotNode, pilot.PARAMETERS, {}),
    "plant": (plant.PlantNode, plant.PARAMETERS, {"autostart": False}),
    "recorder": (recorder.RecorderNode, recorder.PARAMETERS, {"out": "bag"}),
}
"""Class, parameters and what it is started with on the bench."""
LIVE = [name for name, (_, bounds) in identifier.PARAMETERS.items() if bounds.in_flight]
WORDS = {
    "aircraft": "no_such_aircraft",
    "condition": "moon",
    "manoeuvre": "loop",
    "command_type": "no_such_package/msg/Thing",
    "warm_start": "missing.yaml",
    "sensors": ["delay=fast"],
    "faults": ["left_wing time=soon"],
    "fields": ["delta["],
}
"""Free words that mean nothing, of parameters without choices."""
TOGETHER = {"dither.position_low": [-0.5] * len(EFFECTORS), "dither.position_high": [0.5] * len(EFFECTORS)}
"""Given both or none."""
STEP = 20_000_000


def bad_values(node: str, name: str) -> list[Any]:
    """Return values that a parameter must not take."""
    default, bounds = NODES[node][1][name]
    words = [WORDS[name]] if name in WORDS else []
    if isinstance(default, bool):
        return [3, "yes"]
    if isinstance(default, str):
        return [7, *(["nonsense"] if bounds.choices else words)]
    if isinstance(default, (int, float)):
        beyond = [limit for limit in (bounds.low - 1.0, bounds.high * 2.0 + 1.0) if abs(limit) < 1e300]
        kind = [1.5] if isinstance(default, int) else []
        return ["word", float("nan"), float("inf"), *kind, *(type(default)(b) for b in beyond)]
    if isinstance(default, list):
        return [5.0, [1.0, 2.0], *(["nonsense"] * bool(bounds.choices)), *words]
    beyond = [[limit] for limit in (bounds.low - 1.0, bounds.high * 2.0 + 1.0) if abs(limit) < 1e300]
    return ["word", 5.0, [float("nan")] * 7, *beyond]


@pytest.mark.parametrize("node", NODES)
def test_at_the_start_a_bad_value_of_every_parameter_is_refused_with_a_reason(
    node: str, shared_bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    kind: Any = NODES[node][0]
    accepted, wordless = [], []
    for name in NODES[node][1]:
        for bad in bad_values(node, name)[-1:]:  # in flight all are tried
            given = [Parameter(n, value=v) for n, v in {**NODES[node][2], name: bad}.items()]
            try:
                made = kind(context=shared_bench.context, parameter_overrides=given)
            except bad_input() as error:
                if len(str(error)) < 20:
                    wordless.append((name, bad, str(error)))
            else:
                made.destroy_node()
                accepted.append((name, bad))
        gc.collect(0)
    assert not accepted
    assert not wordless


@pytest.fixture(scope="module")
def running(shared_bench: Bench, tmp_path_factory: pytest.TempPathFactory) -> Bench:
    for name, (kind, _, given) in NODES.items():
        out = {"out": str(tmp_path_factory.mktemp("bag") / "bag")} if name == "recorder" else {}
        shared_bench.add(kind, **given | out)
    return shared_bench


def set_to(bench: Bench, node: str, name: str, value: Any) -> Any:
    request = [Parameter(name, value=value).to_parameter_msg()]
    return bench.call(SetParameters, f"{node}/set_parameters", parameters=request).results[0]


@pytest.mark.parametrize("node", NODES)
def test_in_flight_every_bad_value_is_refused_with_a_reason_and_nothing_changes(running: Bench, node: str) -> None:
    names = list(NODES[node][1])

    def values() -> Any:
        return running.call(GetParameters, f"{node}/get_parameters", names=names).values

    before = values()
    for name in names:
        for bad in bad_values(node, name):
            result = set_to(running, node, name, bad)
            assert not result.successful, (name, bad)
            assert len(result.reason) > 20, (name, bad, result.reason)
    assert values() == before


def other_value(name: str) -> Any:
    """Return a value that a live parameter may take, and that is not its default."""
    default, bounds = identifier.PARAMETERS[name]
    if isinstance(default, bool):
        return not default
    if isinstance(default, str):
        return next(choice for choice in bounds.choices if choice != default)
    if isinstance(default, (int, float)):
        tried = [type(default)(v) for v in (default * 0.5, default * 2.0, default + 1)]
        return next(v for v in tried if v != default and bounds.low <= v <= bounds.high)
    for length in range(1, 20):  # one per effector, regressor or equation
        with suppress(EstimationError):
            Configuration().replace({name: [0.5] * length})
            return [0.5] * length
    raise AssertionError(f"no list of halves is right for {name}")


def changes(name: str) -> dict[str, Any]:
    """Return what a live parameter is changed to, with what must change along with it."""
    if name in TOGETHER:
        return TOGETHER
    return {name: other_value(name)}


def test_a_live_parameter_counts_from_the_next_sample_on(bench: Bench) -> None:
    x, xdot, delta = linear_samples(len(LIVE) + 30)
    node = bench.add(identifier.IdentifierNode)
    node._steady = Clockwork()
    models, dithers = bench.listen(LinearModel, "model"), bench.listen(DitherCommand, "dither")
    twin = Identifier(Configuration())

    def fly(k: int) -> None:
        """Give node and twin the same sample; they must answer the same."""
        stamp = (k + 1) * STEP
        bench.publish("state", messages.state_message(stamp, STATES, x[k], xdot[k]))
        bench.publish("effectors", messages.effector_message(stamp, EFFECTORS, delta[k]))
        wanted = twin.learn(stamp * 1e-9, x[k], xdot[k], delta[k])
        bench.expect(models, k + 1)
        bench.expect(dithers, k + 1)
        model = twin.estimate(stamp * 1e-9, x[k])
        assert np.array_equal(np.array(models[k].a), model.a.ravel(), equal_nan=True)
        assert np.array_equal(np.array(models[k].b_std), model.b_std.ravel(), equal_nan=True)
        assert np.array_equal(np.array(dithers[k].delta), wanted.delta)
        assert dithers[k].reason == wanted.reason

    for k in range(30):
        fly(k)
    for k, name in enumerate(LIVE, start=30):
        given = changes(name)
        request = [Parameter(n, value=v).to_parameter_msg() for n, v in given.items()]
        result = bench.call(SetParametersAtomically, "identifier/set_parameters_atomically", parameters=request).result
        assert result.successful, (given, result.reason)
        twin.configure(given)
        fly(k)
    assert node._identifier is not None
    assert node._identifier.parameters == twin.parameters
