from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from inputs import mapped_messages as made
from inputs.mapped_messages import RATE, START, Array, Flight, rigid_flight, write_bag

from msls_ros import bags
from msls_ros.estimation import Configuration, Estimate, EstimationError, Identifier
from msls_ros.inputs import InputAdapter, InputMap, Synchronizer, adapt
from msls_ros.inputs.derivatives import usual_intervals
from msls_ros.inputs.profiles import read_inputs, read_profile
from msls_ros.plant import CONDITIONS, EFFECTORS, MANOEUVRES, Aircraft, Pilot, Sensors

ENCODERS = {"odometry_jointstate": made.standard, "mavros_fixed_wing": made.mavros, "px4_odometry": made.px4}
NAMES = {"de": "elevator", "da": "aileron", "dr": "rudder"}
P, DDT = 3, 2
WELL_KNOWN = {
    "estimator.method": "msls",
    "estimator.forgetting_factor": 0.99,
    "reliability.relative_error": 0.05,
    "reliability.confounding_states": 0.0,
    "reliability.confounding_effectors": 0.0,
    "detector.mode": "off",
    "dither.enabled": False,
}
"""Known to 5 % as far as noise goes: two estimates are compared, and a model that bends bends both."""
"""Reliable is then what is known to 5 %: what is less known than that cannot be compared to 5 %."""


@dataclass
class Mapped:
    """Samples out of messages; n of them, each at an instant of the flight."""

    at: Array
    x: Array
    xdot: Array
    delta: Array
    refused: dict[str, int]
    restarts: int


def adapted(messages: Iterator[tuple[str, int, Any]], inputs: InputMap, configuration: Configuration) -> Mapped:
    gate = Synchronizer(configuration.states, configuration.effectors)
    adapter = InputAdapter(inputs, configuration.states, configuration.effectors, refused=gate.refused)
    samples = [s for row in adapt(messages, adapter) if (s := row.offer(gate)) is not None]
    stamps, x, xdot, delta = (np.array([getattr(s, n) for s in samples]) for n in ("stamp", "x", "xdot", "delta"))
    return Mapped((stamps - START) * 1e-9 * RATE, x, xdot, delta, dict(gate.refused), adapter.restarts)


def read_bag(path: Path, inputs: InputMap, configuration: Configuration) -> Mapped:
    """Read the samples; a window of derivatives of which the inputs say nothing has four intervals."""
    adapter = InputAdapter(inputs, configuration.states, configuration.effectors)
    reader = bags.read(path, adapter.topics)
    adapter.check(reader.topics)
    return adapted(((m.topic, m.stamp_ns, d) for m, d in reader.decoded()), inputs, configuration)


@cache
def flown() -> Flight:
    return rigid_flight(20.0)


def identify(configuration: Configuration, at: Array, x: Array, xdot: Array, delta: Array) -> Estimate:
    return Identifier(configuration).run(at / RATE, x, xdot, delta).estimates[-1]


def differences(mapped: Estimate, direct: Estimate) -> Array:
    """Relative differences of what is identified and reliable in both, A and B."""
    found = []
    for mine, theirs, ok in (
        (mapped.a, direct.a, mapped.a_reliable & direct.a_reliable),
        (mapped.b, direct.b, mapped.b_reliable & direct.b_reliable),
    ):
        identified = ok.copy()
        identified[6:] = False
        if mine.shape[1] == 9:
            identified[:, 6:] = False
        found += ((mine - theirs)[identified] / np.abs(theirs[identified])).tolist()
    return np.abs(found)


@pytest.mark.parametrize("profile", ENCODERS)
def test_a_shipped_profile_gives_the_model_of_a_bag_of_its_types(profile: str, tmp_path: Path) -> None:
    flight = flown()
    sent = replace(flight, effectors=tuple(NAMES.values())) if profile == "odometry_jointstate" else flight
    bag = write_bag(tmp_path / "bag", ENCODERS[profile](sent), tmp_path / "definitions")
    configuration, inputs = read_profile(profile).replace(WELL_KNOWN), read_inputs(profile)
    assert inputs is not None
    found = read_bag(bag, inputs, configuration)
    instants = np.rint(found.at).astype(int)
    step = 2 if profile == "mavros_fixed_wing" else 1
    assert len(instants) >= 1990 // step and not found.refused and np.abs(found.at - instants).max() < 1e-6
    for values, truth, tolerance in (
        (found.x, flight.x, 0.1),
        (found.xdot, flight.xdot, 0.15),
        (found.delta, flight.delta, 0.2),
    ):
        assert np.max(np.abs(values - truth[instants]) / truth.std(axis=0)) < tolerance
    mapped = identify(configuration, found.at, found.x, found.xdot, found.delta)
    direct = identify(configuration, found.at, flight.x[instants], flight.xdot[instants], flight.delta[instants])
    off = differences(mapped, direct)
    assert len(off) >= 14 and off.max() < 0.05


def test_an_accelerometer_off_the_centre_of_mass_is_moved_there() -> None:
    flight, arm = flown(), np.array([0.4, -0.1, 0.2])
    configuration = read_profile("odometry_jointstate")
    inputs = read_inputs("odometry_jointstate")
    assert inputs is not None
    sent = list(made.standard(replace(flight, effectors=tuple(NAMES.values())), arm=arm))[:1200]
    messages = [(topic, log, namespace(fields)) for log, topic, _, fields in sent]
    errors = []
    for position in ((0.0, 0.0, 0.0), (0.4, -0.1, 0.2)):
        found = adapted(iter(messages), replace(inputs, imu_position=position), configuration)
        instants = np.rint(found.at).astype(int)
        errors.append(np.abs(found.xdot - flight.xdot[instants])[:, :3].max())
    assert errors[1] < 0.1 < 1.0 < errors[0]


def namespace(value: Any) -> Any:
    """Turn fields into an object with attributes, as any message is."""
    if isinstance(value, dict):
        return type("Fields", (), {k: namespace(v) for k, v in value.items()})()
    return value


def test_a_message_of_rclpy_and_one_of_a_bag_give_the_same_bits(tmp_path: Path) -> None:
    from nav_msgs.msg import Odometry
    from rclpy.serialization import deserialize_message
    from sensor_msgs.msg import Imu, JointState

    types = {made.ODOMETRY: Odometry, made.IMU: Imu, made.JOINTS: JointState}
    flight = replace(flown(), effectors=tuple(NAMES.values()), x=flown().x[:200])
    bag = write_bag(tmp_path / "bag", made.standard(flight), tmp_path / "definitions")
    configuration, inputs = read_profile("odometry_jointstate"), read_inputs("odometry_jointstate")
    assert inputs is not None
    live = ((m.topic, m.stamp_ns, deserialize_message(bytes(m.data), types[m.msgtype])) for m in bags.read(bag))
    from_live, from_bag = adapted(live, inputs, configuration), read_bag(bag, inputs, configuration)
    assert len(from_bag.at) == 195
    for name in ("at", "x", "xdot", "delta"):
        assert getattr(from_live, name).tobytes() == getattr(from_bag, name).tobytes()


def test_a_bag_played_twice_gives_the_same_twice(tmp_path: Path) -> None:
    flight = replace(flown(), effectors=tuple(NAMES.values()), x=flown().x[:200])
    configuration, inputs = read_profile("odometry_jointstate"), read_inputs("odometry_jointstate")
    assert inputs is not None
    messages = [(topic, log, namespace(fields)) for log, topic, _, fields in made.standard(flight)]
    twice = adapted(iter(messages * 2), inputs, configuration)
    assert twice.restarts == 1 and not twice.refused and len(twice.at) == 2 * 195
    for name in ("x", "xdot", "delta"):
        first, second = np.split(getattr(twice, name), 2)
        assert first.tobytes() == second.tobytes()


def test_a_bag_without_one_of_the_topics_is_refused_with_its_name(tmp_path: Path) -> None:
    sent = (m for m in made.px4(replace(flown(), x=flown().x[:10])) if "servos" not in m[1])
    bag = write_bag(tmp_path / "bag", sent, tmp_path / "definitions")
    inputs = read_inputs("px4_odometry")
    assert inputs is not None
    with pytest.raises(EstimationError, match="no topic /fmu/out/actuator_servos"):
        read_bag(bag, inputs, read_profile("px4_odometry"))


@cache
def f16(condition: str) -> Flight:
    """Twenty seconds of an F-16 in a doublet, with low noise and random commands on top; 400 steps a second."""
    aircraft = Aircraft(CONDITIONS[condition], rate=4 * RATE)
    pilot = Pilot(aircraft.trim, aircraft.truth(), MANOEUVRES["roll_doublet"])
    sensors, random = Sensors("low", 1), np.random.default_rng(101)
    dither, command, samples = np.zeros(7), np.zeros(7), []
    for k in range(20 * 4 * RATE):
        if k % 8 == 0:
            dither = random.normal(size=7) * 0.02
        if k % 4 == 0:
            samples.append(sensors.measure(aircraft.sample()))
            command = pilot.command(samples[-1].time, samples[-1].x)
        aircraft.step(command + dither)
    x, xdot, delta = (np.array([getattr(s, n) for s in samples]) for n in ("x", "xdot", "delta"))
    return Flight(EFFECTORS, x, xdot, delta)


def f16_profile(folder: Path) -> Path:
    """The shipped profile of the ROS types with the effectors of the F-16 in it."""
    text = (Path(made.__file__).parents[2] / "config/inputs/odometry_jointstate.yaml").read_text()
    text = text.replace("[de, da, dr]", f"[{', '.join(EFFECTORS)}]").replace("speed: 25.0", "speed: 100.0")
    start, stop = text.index('        de: "joints'), text.index("      # States that no vector")
    lines = "".join(f'        {e}: "joints position[name={e}]"\n' for e in EFFECTORS)
    path = folder / "f16.yaml"
    path.write_text(text[:start] + lines + text[stop:])
    return path


def compare(
    flight: Flight, found: Mapped, configuration: Configuration, straddle: int = 0
) -> tuple[list[tuple[Estimate, Estimate]], Array]:
    """Return estimates by mapped samples and by the flight's own, once a second, and how far they differ."""
    mapped = Identifier(configuration, straddle).run(found.at / RATE, found.x, found.xdot, found.delta).estimates
    at = np.arange(len(flight.x)) / RATE
    direct = Identifier(configuration).run(at, flight.x, flight.xdot, flight.delta).estimates
    pairs = [(mapped[np.searchsorted(found.at, k)], direct[k]) for k in range(7 * RATE, 20 * RATE, RATE)]
    return pairs, np.concatenate([differences(mine, theirs) for mine, theirs in pairs])


@pytest.mark.parametrize("slow", [1, 2])
@pytest.mark.parametrize("condition", ["high_alpha", "cruise"])
def test_all_that_the_bank_knows_to_five_percent_it_knows_from_ros_types_in_a_usual_window(
    condition: str, slow: int, tmp_path: Path
) -> None:
    flight, profile = f16(condition), f16_profile(tmp_path)
    bag = write_bag(tmp_path / "bag", made.standard(flight, slow=slow), tmp_path / "definitions")
    changes = {"estimator.method": "bank", "detector.mode": "normalised"}
    configuration, inputs = read_profile(profile).replace({**WELL_KNOWN, **changes}), read_inputs(profile)
    assert inputs is not None and inputs.intervals == 0
    straddle = usual_intervals(configuration.sample_rate)
    found = read_bag(bag, replace(inputs, intervals=straddle), configuration)
    _, off = compare(flight, found, configuration, straddle)
    assert straddle == 10 and len(off) >= 120 and np.median(off) < 0.01 and off.max() < 0.05


@pytest.mark.parametrize("slow", [1, 2])
@pytest.mark.parametrize("condition", ["high_alpha", "cruise"])
def test_an_f16_mapped_from_ros_types_gives_a_and_b_within_five_percent_of_the_direct_ones(
    condition: str, slow: int, tmp_path: Path
) -> None:
    """Reliable parameters once a second; both are known to 5 %, so that a few may be further apart by chance."""
    flight, profile = f16(condition), f16_profile(tmp_path)
    bag = write_bag(tmp_path / "bag", made.standard(flight, slow=slow), tmp_path / "definitions")
    changes = {"estimator.forgetting_factor": 0.995, "estimator.penalty": 1e-3}
    configuration, inputs = read_profile(profile).replace({**WELL_KNOWN, **changes}), read_inputs(profile)
    assert inputs is not None
    pairs, off = compare(flight, read_bag(bag, inputs, configuration), configuration)
    assert len(off) >= 120 and np.median(off) < 0.01 and np.mean(off < 0.05) > 0.95 and off.max() < 0.1
    assert all(abs(mine.b[P, DDT] / theirs.b[P, DDT] - 1.0) < 0.03 for mine, theirs in pairs)


def test_regressors_that_do_not_pass_the_window_of_the_derivative_bias_b_by_a_tenth_and_more() -> None:
    flight, half = f16("high_alpha"), 4
    offsets = np.arange(-half, half + 1)
    weights = offsets * RATE / (offsets**2).sum()
    xdot = flight.xdot[half:-half].copy()
    for rate in (3, 4, 5):
        xdot[:, rate] = np.correlate(flight.x[:, rate], weights, "valid")
    configuration = read_profile("odometry_jointstate").replace(
        {**WELL_KNOWN, "effectors": EFFECTORS, "estimator.forgetting_factor": 0.995, "estimator.penalty": 1e-3}
    )
    at = np.arange(1500.0)
    apart = identify(configuration, at, flight.x[half:][:1500], xdot[:1500], flight.delta[half:][:1500])
    direct = identify(configuration, at, flight.x[:1500], flight.xdot[:1500], flight.delta[:1500])
    assert apart.b[P, DDT] < 0.9 * direct.b[P, DDT]
