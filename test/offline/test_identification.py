"""One call from a log, messages or arrays to models as arrays: the numbers are those of replay."""

from __future__ import annotations

from dataclasses import replace
from heapq import merge
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from inputs import mapped_messages as made
from inputs.mapped_messages import Flight, rigid_flight, write_bag
from offline.replayed import BAGS, outputs, run

from msls_ros import bags
from msls_ros.estimation import EstimationError, EventKind
from msls_ros.inputs.findings import DOUBTFUL
from msls_ros.inputs.profiles import read_parameters
from msls_ros.offline.identification import Identified, identify_log, identify_messages, rows
from msls_ros.offline.replay import kept_parameters

PROFILE = "odometry_jointstate"


@pytest.fixture(scope="module")
def flight() -> Flight:
    return replace(rigid_flight(10.0), effectors=("elevator", "aileron", "rudder"))


@pytest.fixture(scope="module")
def bag(flight: Flight, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("flown")
    return write_bag(folder / "bag", made.standard(flight), folder / "definitions")


def decoded(bag: Path) -> list[tuple[str, int, Any]]:
    return [(m.topic, m.stamp_ns, message) for m, message in bags.read(bag).decoded()]


def same(one: Identified, other: Identified) -> bool:
    names = ("time", "a", "a_std", "b", "b_std", "a_reliable", "b_reliable", "bias")
    return all(np.array_equal(getattr(one, n), getattr(other, n)) for n in names)


def test_a_mapped_bag_gives_the_bits_of_replay(bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(capsys, bag, "--params", PROFILE, "--out", tmp_path / "out", "--every", 100)[0] == 0
    result = identify_log(bag, PROFILE, every=100)
    given = outputs(tmp_path / "out" / "bag")
    models = [fields for _, fields in given["/model"]]
    assert len(given["/dither"]) == result.samples > 400
    for name in ("a", "b", "b_std"):
        found = getattr(result, name)
        assert [model[name] for model in models] == [("float64", one.tobytes()) for one in found[: len(models)]]


def test_its_messages_in_memory_give_the_same(bag: Path) -> None:
    result = identify_messages(decoded(bag), PROFILE)
    assert same(result, identify_log(bag, PROFILE))
    assert result.refused == {} and result.b.shape == (len(result.time), 9, 3)


@pytest.mark.parametrize("own", ["tail_fault", "intact_doublet"])
def test_our_own_messages_need_no_map(own: str) -> None:
    result = identify_log(BAGS / own)
    messages = [m for m in decoded(BAGS / own) if m[0] in ("/state", "/effectors")]
    assert same(result, identify_messages(messages, kept_parameters(BAGS / own)))
    names = [e.suspected_effector for e in result.events if e.kind == EventKind.ISOLATED]
    assert names == (["left_stabilator"] if own == "tail_fault" else [])


LONGITUDINAL: dict[str, Any] = {
    "states": ["u", "w", "Q", "Phi", "Theta"],
    "effectors": ["de"],
    "sample_rate": 100.0,
    "reference_speed": 18.0,
    "inputs": {
        "topics": {"log": "/log my/msg/Log", "servo": "/servo my/msg/Servo"},
        "clock": "log",
        "states": {
            **{n: f"log {n}" for n in ("u", "w", "Q", "Theta")},
            "Phi": "log Theta scale=0",
        },
        "effectors": {"de": "servo elevator"},
    },
}


@pytest.fixture(scope="module")
def level() -> Flight:
    """Only the elevator moves the aircraft."""
    flown = rigid_flight(12.0, along=True)
    assert not flown.x[:, 6].any()
    return flown


def arrays(flight: Flight) -> list[tuple[str, int, Any]]:
    time = 1.0 + np.arange(len(flight.x)) / made.RATE
    u, w, q, theta = flight.x[:, [0, 2, 4, 7]].T
    log = rows("/log", time, u=u, w=w, Q=q, Theta=theta)
    servo = rows("/servo", time, elevator=flight.delta[:, 0])
    return list(merge(log, servo, key=itemgetter(1)))


def test_arrays_without_a_bank_are_identified_with_gravity_known(level: Flight) -> None:
    result = identify_messages(arrays(level), LONGITUDINAL)
    row = result.states.index("Q")
    assert result.b_reliable[-1, row, 0]
    assert result.b[-1, row, 0] == pytest.approx(-30.0, abs=max(3.0 * result.b_std[-1, row, 0], 0.3))
    pull = result.a[-1, result.states.index("u"), result.states.index("Theta")]
    assert pull == pytest.approx(-made.GRAVITY, rel=0.01)
    assert not [f for f in result.findings if f.kind == "gravity"]


def test_names_with_dots_are_fields_of_fields() -> None:
    named: dict[str, Any] = {
        "header.frame": [1.0],
        "twist.linear": [[1.0, 2.0, 3.0]],
        "twist.angular": [[4.0, 5.0, 6.0]],
    }
    ((topic, stamp, message),) = rows("/odom", [2.5], **named)
    assert (topic, stamp, message.header.stamp.sec, message.header.frame) == ("/odom", 2_500_000_000, 2, 1.0)
    assert message.twist.linear == [1.0, 2.0, 3.0] and message.twist.angular == [4.0, 5.0, 6.0]
    with pytest.raises(EstimationError, match=r"twist\.linear of /odom is a part of twist, that is given whole"):
        rows("/odom", [2.5], twist=[1.0], **named)


def test_without_phi_it_is_said_how_to_add_it_and_not_only_how_to_switch_gravity_off(level: Flight) -> None:
    lines = {**LONGITUDINAL["inputs"], "states": {n: f"log {n}" for n in ("u", "w", "Q", "Theta")}}
    without = {**LONGITUDINAL, "states": ["u", "w", "Q", "Theta"], "inputs": lines}
    with pytest.raises(EstimationError, match=r"add what is missing of Phi and Theta.*states\.Phi: .*scale=0"):
        identify_messages(arrays(level), without)
    off = identify_messages(arrays(level), {**without, "known_gravity": False})
    (finding,) = [f for f in off.findings if f.kind == "gravity"]
    assert finding.level == DOUBTFUL and "scale=0" in finding.change
    text = "/**: {ros__parameters: {states: [P, R], effectors: [da], known_gravity: 1}}"
    with pytest.raises(EstimationError) as other:
        read_parameters(text, "another mistake")
    assert "Phi" not in str(other.value)


def test_what_cannot_be_used_is_one_sentence(bag: Path) -> None:
    messages = decoded(bag)
    with pytest.raises(EstimationError, match=r"no message on /imu/data; there are those on /joint_states, /odom$"):
        identify_messages([m for m in messages if m[0] != "/imu/data"], PROFILE)
    with pytest.raises(EstimationError, match="messages: not one sample; state and effectors have no stamp in common"):
        identify_messages([], {"known_gravity": False})
    with pytest.raises(EstimationError, match=r"'inputs\.velocty'.*did you mean 'velocity'"):
        identify_messages(messages, {"inputs": {"velocty": "odometry twist"}})


def test_a_map_that_gives_wrong_numbers_is_refused_unless_it_is_wanted(level: Flight) -> None:
    effectors = {"de": "servo elevator scale=57.29578"}
    wrong = {**LONGITUDINAL, "inputs": {**LONGITUDINAL["inputs"], "effectors": effectors}}
    with pytest.raises(EstimationError, match=r"messages: inputs\.effectors\.de: .*degrees.*anyway=True uses it"):
        identify_messages(arrays(level), wrong)
    assert identify_messages(arrays(level), wrong, anyway=True).samples > 1000


@pytest.mark.parametrize(
    ("time", "values", "sentence"),
    [
        ([1.0, np.nan, 3.0], [1.0, 2.0, 3.0], "time of /a is nan at row 1; expected finite seconds"),
        ([1.0, 2.0, 3.0], [1.0, 2.0], "p of /a has 2 values; expected one for each of the 3 stamps"),
        ([1.0, 2.0], ["x", "y"], "p of /a is of dtype <U1; give numbers"),
        (np.array([1, 2], "datetime64[s]"), [1.0, 2.0], r"time of /a is of dtype datetime64\[s\]; .*np\.timedelta64"),
    ],
)
def test_arrays_that_are_no_messages_are_refused(time: Any, values: Any, sentence: str) -> None:
    with pytest.raises(EstimationError, match=sentence):
        rows("/a", time, p=values)


def test_where_nothing_can_be_used_the_reason_is_in_the_error_and_what_is_not_used_is_counted(level: Flight) -> None:
    nothing = [(topic, stamp, message) for topic, stamp, message in arrays(level) if topic == "/log"]
    time = 1.0 + np.arange(len(level.x)) / made.RATE
    empty = rows("/servo", time, elevator=np.full(len(time), np.nan))
    with pytest.raises(EstimationError, match=r"not one sample; .*de \(/servo elevator\) is 'nan'"):
        identify_messages(list(merge(nothing, empty, key=itemgetter(1))), LONGITUDINAL, anyway=True)
