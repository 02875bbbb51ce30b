from __future__ import annotations

import math
import random
from collections import Counter
from copy import deepcopy
from types import SimpleNamespace as Message
from typing import Any

import numpy as np
import pytest
from inputs.mapped_messages import FRD_OF_FLU, NED_OF_ENU, quaternion, rotation

from msls_ros.estimation import EstimationError
from msls_ros.inputs import EffectorRow, InputAdapter, InputMap, Refused, StateRow, Synchronizer
from msls_ros.inputs import adapt as adapt_messages
from msls_ros.inputs.derivatives import DerivativeFilter, interval_weights, usual_intervals, weigh
from msls_ros.inputs.field_paths import FieldPath, VectorPath
from msls_ros.inputs.frames import arctangent, continued, euler_angles, to_body, to_ned

STEP = 10_000_000
JOINTS = Message(name=["flap", "elevator"], position=[0.1, 0.2], header=Message(stamp=Message(sec=1, nanosec=5)))
PLAIN: dict[str, Any] = {
    "clock": "a",
    "maximum_age": 0.05,
    "topics": {"a": "/a p/msg/A stamp=t unit=ns", "b": "/b p/msg/B stamp=t unit=ns"},
    "states": {"s": "a s"},
    "derivatives": {"s": "a rate"},
    "effectors": {"e": "b e"},
}


def adapter(changes: dict[str, Any] | None = None, states: tuple[str, ...] = ("s",), **options: Any) -> InputAdapter:
    return InputAdapter(InputMap.from_parameters({**PLAIN, **(changes or {})}), states, ("e",), **options)


def sample(k: float) -> list[tuple[str, int, Any]]:
    """Messages of /a and /b at step k: s = 2t, its rate 2, e = 3t."""
    t = round(k * STEP)
    return [("/a", 0, Message(t=t, s=2e-9 * t, rate=2.0)), ("/b", 0, Message(t=t, e=3e-9 * t))]


def numbers(rows: list[Any]) -> list[tuple[int, list[float]]]:
    return [(r.stamp, [*r.x.tolist(), *r.xdot.tolist()] if isinstance(r, StateRow) else r.delta.tolist()) for r in rows]


# Paths


def test_a_path_leads_to_attributes_elements_and_named_elements() -> None:
    nested = Message(twist=Message(linear=Message(x=4.0)), channels=[1500, 1600])
    assert FieldPath("twist.linear.x").read(nested) == 4.0
    assert FieldPath("channels[1]").read(nested) == 1600
    assert FieldPath("position[name=elevator]").read(JOINTS) == 0.2


def test_a_named_element_is_found_wherever_it_stands() -> None:
    path = FieldPath("position[name=left.elevator]")
    for names in (["left.elevator", "x"], ["x", "left.elevator"], ["y", "x", "left.elevator"], ["left.elevator"]):
        values = [1.0 if n == "left.elevator" else 0.0 for n in names]
        assert path.read(Message(name=names, position=values)) == 1.0


@pytest.mark.parametrize(
    ("path", "says"),
    [
        ("pose.x", "SimpleNamespace has no field 'pose'; its fields are name, position, header"),
        (
            "header.stamp.nanoseconds",
            "'header.stamp' of SimpleNamespace has no field 'nanoseconds'; its fields are sec, ",
        ),
        ("position[names=elevator]", "has no field 'names'"),
        (
            "header.stamp.sec.x",
            "'header.stamp.sec' of SimpleNamespace has no field 'x'; its fields are none, it is a int",
        ),
    ],
)
def test_a_path_that_does_not_exist_says_which_part_and_what_there_is(path: str, says: str) -> None:
    with pytest.raises(EstimationError) as caught:
        FieldPath(path).read(JOINTS)
    assert says in str(caught.value) and f"'{path}'" in str(caught.value)


@pytest.mark.parametrize("path", ["position[2]", "position[name=rudder]"])
def test_an_element_that_this_message_lacks_is_refused_and_not_an_error_of_the_profile(path: str) -> None:
    with pytest.raises(Refused) as caught:
        FieldPath(path).read(JOINTS)
    assert caught.value.reason == "field_missing"


@pytest.mark.parametrize("text", ["", "a..b", "a[", "a[-1]", "a[b=]", "a b", "1a"])
def test_what_is_no_path_is_refused_at_once(text: str) -> None:
    with pytest.raises(EstimationError, match="is not NAME"):
        FieldPath(text)


def test_vectors_are_fields_arrays_or_a_path_each() -> None:
    message = Message(v=Message(x=1, y=2, z=3), a=np.array([1, 2, 3], np.float32), vx=1, vy=2, vz=3)
    for text in ("v", "a", "vx,vy,vz", "v.x,a[1],vz"):
        assert VectorPath(text, 3).read(message) == (1.0, 2.0, 3.0)
    turned = Message(q=Message(x=2, y=3, z=4, w=1), a=[1, 2, 3, 4])
    assert VectorPath("q", 4).read(turned) == VectorPath("a", 4).read(turned) == (1.0, 2.0, 3.0, 4.0)
    for text, size, given in (("q", 3, turned), ("a", 3, turned), ("v", 4, message), ("v", 1, message)):
        with pytest.raises(EstimationError, match="expected"):
            VectorPath(text, size).read(given)


# Frames


def test_the_inverse_tangent_is_that_of_the_library_to_three_units_in_the_last_place() -> None:
    source = random.Random(1)
    for _ in range(20000):
        y, x = source.gauss(0, 1) * 10 ** source.uniform(-12, 12), source.gauss(0, 1)
        assert abs(arctangent(y, x) - math.atan2(y, x)) <= 3 * math.ulp(math.atan2(y, x))
    for y, x in ((0.0, 1.0), (0.0, -1.0), (1.0, 0.0), (-1.0, 0.0), (1.0, 1.0), (-1.0, -1.0)):
        assert arctangent(y, x) == pytest.approx(math.atan2(y, x), abs=1e-15)
    assert arctangent(0.0, 0.0) == 0.0


@pytest.mark.parametrize("body", ["frd", "flu"])
@pytest.mark.parametrize("earth", ["ned", "enu", "nwu"])
def test_attitude_and_velocity_of_any_frame_come_out_as_ours(body: str, earth: str) -> None:
    to_north = {"ned": np.eye(3), "enu": NED_OF_ENU, "nwu": np.diag([1.0, -1.0, -1.0])}[earth]
    to_frd = FRD_OF_FLU if body == "flu" else np.eye(3)
    rng = np.random.default_rng(3)
    for _ in range(200):
        euler = rng.uniform([-3.1, -1.5, -3.1], [3.1, 1.5, 3.1])
        matrix, velocity = rotation(euler), rng.normal(size=3) * 20
        q = quaternion(to_north.T @ matrix @ to_frd) * rng.choice([-1.0, 1.0])
        assert euler_angles(q.tolist(), body, earth) == pytest.approx(euler, abs=1e-9)
        given = to_north.T @ matrix @ velocity
        assert to_body(to_ned(given.tolist(), earth), tuple(euler)) == pytest.approx(velocity, abs=1e-9)


def test_angles_go_on_over_the_turn() -> None:
    psi = [continued(a, 3.1) for a in (3.1, -3.1, -3.0)]
    assert psi == pytest.approx([3.1, -3.1 + 2 * math.pi, -3.0 + 2 * math.pi])


# Derivatives


@pytest.mark.parametrize("intervals", [2, 4, 10])
def test_on_an_even_clock_the_slope_is_the_least_squares_quadratic_one(intervals: int) -> None:
    values = np.random.default_rng(0).normal(size=intervals + 1)
    window = DerivativeFilter(intervals, 1, STEP)
    filtered = [window.push(k * STEP, np.array([v])) for k, v in enumerate(values)][-1]
    assert filtered is not None and filtered.stamp == intervals * STEP // 2
    times = (np.arange(intervals + 1) - intervals / 2) * 0.01
    assert filtered.slope[0] == pytest.approx(np.polyfit(times, values, 2)[1])


def test_a_linear_system_stays_the_same_system_under_the_window_however_uneven_the_stamps() -> None:
    rng = np.random.default_rng(2)
    stamps = np.cumsum(rng.integers(STEP // 2, 3 * STEP // 2, 400))
    t = stamps * 1e-9
    state = np.sin(8.0 * t) + 0.5 * np.cos(21.0 * t)
    effector = (8.0 * np.cos(8.0 * t) - 10.5 * np.sin(21.0 * t) + 3.0 * state) / 5.0
    window = DerivativeFilter(8, 2, 2 * STEP)
    found = [window.push(int(s), np.array([x, d])) for s, x, d in zip(stamps, state, effector, strict=True)]
    assert found[7] is None and found[8] is not None and window.gaps == 0
    rows = [f for f in found if f is not None]
    regressors, slopes = np.array([f.smooth for f in rows]), np.array([f.slope[0] for f in rows])
    ours = np.linalg.lstsq(regressors, slopes, rcond=None)[0]
    assert ours == pytest.approx([-3.0, 5.0], rel=0.001)
    raw = np.column_stack([state, effector])[4:-4]
    others = np.linalg.lstsq(raw, slopes, rcond=None)[0]
    assert np.max(np.abs(others / [-3.0, 5.0] - 1.0)) > 0.05


@pytest.mark.parametrize(("rate", "near"), [(25, 0.06), (50, 0.01), (100, 0.01)])
def test_the_rule_of_integration_makes_no_force_of_a_pitch_rate(rate: int, near: float) -> None:
    """Trapezoids miss ``h^2/12`` of the second derivative of 17 m/s times it: w by the elevator is -21 at 25 Hz."""
    a, b = np.array([[-3.0, 16.0], [-2.5, -10.0]]), np.array([-13.0, -150.0])
    rng, step = np.random.default_rng(4), 0.001
    command = np.repeat(rng.uniform(-0.05, 0.05, 150), 200)
    x, acts, now, servo = np.zeros((len(command), 2)), np.zeros(len(command)), np.zeros(2), 0.0
    for k, wanted in enumerate(command):
        x[k], acts[k] = now, servo
        middle = servo + 0.5 * step * 20.0 * (wanted - servo)
        now = now + step * (a @ (now + 0.5 * step * (a @ now + b * servo)) + b * middle)
        servo += step * 20.0 * (wanted - servo - 0.5 * step * 20.0 * (wanted - servo))
    window = DerivativeFilter(usual_intervals(rate), 3, 10**9)
    apart = round(1.0 / (rate * step))
    samples = np.column_stack([x, acts])[::apart]
    found = [window.push(round(k * 1e9 / rate), sample) for k, sample in enumerate(samples)]
    rows = [f for f in found if f is not None]
    smooth, slope = np.array([f.smooth for f in rows]), np.array([f.slope[:2] for f in rows])
    fitted = np.linalg.lstsq(smooth, slope, rcond=None)[0].T
    np.testing.assert_allclose(fitted, np.column_stack([a, b]), rtol=near)


@pytest.mark.parametrize(
    ("rate", "intervals"), [(10.0, 4), (25.0, 4), (50.0, 5), (100.0, 10), (400.0, 40), (1e5, 1000)]
)
def test_a_window_is_a_tenth_of_a_second_unless_it_is_said(rate: float, intervals: int) -> None:
    assert adapter({"derivatives": {}}, sample_rate=rate).straddle == intervals
    assert adapter({"derivatives": {}, "intervals": 3}, sample_rate=rate).straddle == 3
    assert adapter(sample_rate=rate).straddle == 0


def test_a_gap_empties_the_window_and_is_counted() -> None:
    made = adapter({"derivatives": {}, "intervals": 2})
    assert made.methods == {"s": "differentiated"}
    stamps = [row.stamp // STEP for k in (0, 1, 2, 3, 20, 21, 22) for m in sample(k) for row in made.push(*m)]
    assert stamps == [1, 1, 2, 2, 21, 21]
    assert made.refused == Counter(gap=1)


@pytest.mark.parametrize("seed", range(3))
def test_compiled_and_interpreted_kernels_give_the_same_bits(seed: int) -> None:
    rng = np.random.default_rng(seed)
    times, values, weights = np.cumsum(rng.uniform(0.005, 0.015, 9)), rng.normal(size=(9, 25)), interval_weights(8)
    jumps = rng.normal(size=(9, 25))
    results = []
    for kernel in (weigh, getattr(weigh, "py_func", weigh)):
        smooth, slope = np.empty(25), np.empty(25)
        results.append((kernel(times, values, jumps, weights, smooth, slope), smooth.tobytes(), slope.tobytes()))
    assert results[0] == results[1]
    interpreted = getattr(arctangent, "py_func", arctangent)
    assert all(arctangent(y, x) == interpreted(y, x) for y, x in rng.normal(size=(2000, 2)).tolist())


# One clock


def test_streams_of_other_rates_and_delays_are_interpolated_to_the_clock() -> None:
    made = adapter({"topics": {"a": "/a p/msg/A stamp=t unit=ns", "b": "/b p/msg/B stamp=t unit=ns delay=0.013"}})
    sent = [m for k in range(20) for m in (sample(k)[0], sample(1.7 * k)[1])]
    rows = [row for m in sent for row in made.push(*m)]
    assert len(rows) > 30
    for state, effector in zip(rows[::2], rows[1::2], strict=True):
        assert isinstance(state, StateRow) and isinstance(effector, EffectorRow)
        assert state.stamp == effector.stamp
        assert state.x[0] == pytest.approx(2e-9 * state.stamp)
        assert effector.delta[0] == pytest.approx(3.0 * (state.stamp * 1e-9 + 0.013))


def test_what_comes_out_does_not_depend_on_the_order_in_which_streams_arrive() -> None:
    first = [sample(k)[0] for k in range(30)]
    second = [sample(0.7 * k - 0.3)[1] for k in range(60)]
    reference: list[Any] = []
    for seed in range(5):
        source, a, b, sent = random.Random(seed), list(first), list(second), []
        while a or b:
            ahead = a and (not b or (a[0][2].t - b[0][2].t) < source.uniform(-2, 2) * STEP)
            sent.append((a if ahead else b).pop(0))
        rows = numbers(list(adapt_messages(sent, adapter())))
        reference = reference or rows
        assert len(rows) >= 58 and rows == reference


def test_a_sample_too_old_is_not_used_and_counted() -> None:
    reports: list[Refused] = []
    made = adapter(report=reports.append)
    sent = [sample(k)[i] for k in range(60) for i in (0, 1) if i == 0 or not 20 < k < 40]
    stamps = {row.stamp // STEP for m in sent for row in made.push(*m)}
    assert stamps == {*range(21), *range(40, 60)}
    assert made.refused == Counter(stale=19)
    assert "effectors.e (/b e)" in str(reports[0]) and "0.05 s" in str(reports[0])


@pytest.mark.parametrize("apart", [-2.0, 2.0, 1.5e9])
@pytest.mark.parametrize("held", ["", " hold=true"])
def test_stamps_of_another_clock_are_named_with_how_far_they_are_apart(apart: float, held: str) -> None:
    """Those of /b are of another clock than those of /a, the clock of the samples."""
    reports: list[Refused] = []
    made = adapter({"effectors": {"e": "b e" + held}}, report=reports.append)
    for k in range(1000, 1060):
        made.push(*sample(k)[0])
        made.push(*sample(k + apart * 1e9 / STEP)[1])
    said = f"its stamps are {abs(apart):.1f} s {'after' if apart > 0 else 'before'} those of /a: two clocks"
    assert said in str(reports[-1]) and made.apart("/b").startswith(said) and not made.apart("/a")


@pytest.mark.parametrize("late", [0, 45])
def test_a_stream_that_has_stopped_or_is_late_is_of_the_same_clock(late: int) -> None:
    """At 50 Hz: nothing for 2 s, or all of it .9 s late."""
    reports: list[Refused] = []
    made = adapter(report=reports.append)
    for k in range(200):
        made.push(*sample(k)[0])
        if k < 100 or late:
            made.push(*sample(k - late)[1])
    assert len(reports) > 80 and not any("two clocks" in str(one) for one in reports) and not made.apart("/b")


@pytest.mark.parametrize("stall", [120, 300])
def test_after_a_stall_no_stream_is_called_of_another_clock(stall: int) -> None:
    """What has waited of /b comes before what has waited of /a, the clock; then both in turn."""
    made, found = adapter(states=("s",)), set()
    sent = [one for k in range(100) for one in sample(k)]
    sent += [sample(k)[1] for k in range(100 + stall, 100 + 2 * stall)]
    sent += [sample(k)[0] for k in range(100 + stall, 100 + 2 * stall)]
    for one in [*sent, *(m for k in range(100 + 2 * stall, 800) for m in sample(k))]:
        made.push(*one)
        found |= {made.apart("/a"), made.apart("/b")}
    assert found == {""}


def test_a_stream_of_the_clocks_own_messages_is_never_of_another_clock() -> None:
    made = adapter({"states": {"s": "a s delay=1.5"}, "maximum_age": 2.0})
    for k in range(400):
        for one in sample(k):
            made.push(*one)
    assert made.apart("/a") == ""


def test_a_stream_that_is_held_is_not_waited_for() -> None:
    made = adapter({"effectors": {"e": "b e hold=true age=0.3"}})
    assert made.push(*sample(0)[1]) == []
    rows = [row for k in range(1, 40) for row in made.push(*sample(k)[0])]
    assert [r.delta[0] for r in rows if isinstance(r, EffectorRow)] == [0.0] * 30
    assert made.refused == Counter(stale=9)


def test_scale_zero_and_offset_turn_pulses_into_radians() -> None:
    made = adapter({"effectors": {"e": "b e zero=1500 scale=-0.001 offset=0.02"}})
    rows = [*made.push(*sample(0)[0]), *made.push("/b", 0, Message(t=0, e=1600))]
    assert rows[1].delta[0] == pytest.approx(-0.08)  # type: ignore[union-attr]


def test_an_effector_of_several_channels_is_the_sum_of_their_values() -> None:
    """Elevons: half of the sum is an elevator, half of the difference an aileron."""
    for line, expected in (
        ("b left,right scale=0.5", 0.5 * (0.3 - 0.1)),
        ("b left,right scale=0.5,-0.5", 0.5 * (0.3 + 0.1)),
        ("b left,right zero=0.1,0.2 scale=2,1 offset=0.01,0", 2.0 * 0.2 + 0.01 - 0.3),
        ("b joints[0],joints[1],joints[2]", 6.0),
    ):
        made = adapter({"effectors": {"e": line}}, slowest=0.1, sample_rate=100.0)
        message = Message(t=0, left=0.3, right=-0.1, joints=[1.0, 2.0, 3.0])
        rows = [*made.push(*sample(0)[0]), *made.push("/b", 0, message)]
        assert rows[1].delta.tolist() == pytest.approx([expected]), line  # type: ignore[union-attr]


# What cannot be used


def test_a_repeated_arrival_says_that_the_clock_of_a_simulation_moves_in_ticks() -> None:
    said: list[str] = []
    flat = {"clock": "a", "topics.a": "/a p/A stamp=arrival", "states.s": "a s", "effectors.e": "a e"}
    flat["derivatives.s"] = "a rate"
    made = InputAdapter(
        InputMap.from_parameters(flat), ("s",), ("e",), report=lambda refused: said.append(str(refused))
    )
    for _ in range(2):
        made.push("/a", STEP, Message(s=1.0, rate=0.0, e=2.0))
    (text,) = said
    assert text.startswith("topic /a: stamp ") and "expected a later one. stamp=arrival is read from the node" in text
    assert "publish /clock faster than this topic, or give stamp=PATH" in text


def test_numbers_that_are_none_and_stamps_that_do_not_rise_are_refused_and_counted() -> None:
    made = adapter()
    list(adapt_messages([m for k in range(5) for m in sample(k)], made))
    for bad in (math.nan, math.inf):
        made.push("/b", 0, Message(t=5 * STEP + int(bad == math.inf), e=bad))
    made.push(*sample(4)[0])
    made.push(*sample(3)[0])
    assert made.refused == Counter(not_finite=2, stamp_repeated=1, stamp_back=1)
    assert [r.stamp // STEP for k in (6, 7) for m in sample(k) for r in made.push(*m)] == [6, 6, 7, 7]


def test_stamps_may_be_whole_or_broken_numbers_or_seconds_and_nanoseconds_but_nothing_else() -> None:
    made = adapter({"topics": {"a": "/a p/msg/A stamp=t unit=us", "b": "/b p/msg/B stamp=t unit=ns"}, "clock": "b"})
    topic = made.inputs.topics["a"]
    for stamp in (2, 2.0, np.uint64(2), np.float32(2.0), Message(sec=0, nanosec=2000)):
        assert topic.instant(0, Message(t=stamp)) == 2000
    for stamp in (math.nan, math.inf):
        with pytest.raises(Refused, match="expected a stamp"):
            topic.instant(0, Message(t=stamp))
    for nothing in ("now", None, Message(x=1)):
        with pytest.raises(EstimationError, match=r"'t' leads to .* in p/msg/A; expected a stamp"):
            topic.instant(0, Message(t=nothing))


def test_one_stamp_out_of_the_future_costs_the_window_and_no_more() -> None:
    made = adapter({"derivatives": {}})
    sent = [m for k in range(50) for m in ([sample(1e6)[0]] if k == 20 else sample(k))]
    stamps = {row.stamp // STEP for m in sent for row in made.push(*m)}
    assert stamps >= {*range(2, 17), *range(23, 47)} and made.restarts == 0
    assert made.refused["stamp_rogue"] == 1


def test_a_quaternion_that_is_no_rotation_is_refused() -> None:
    changes = {"states": {}, "derivatives": {"Theta": "a rate"}, "attitude": "a q"}
    made = adapter(changes, states=("Theta",))
    for k, q in enumerate([(1, 0, 0, 0), (0, 0, 0, 0), (1, 0, 0, 0)]):
        made.push("/a", 0, Message(t=k * STEP, q=q, rate=0.0))
    assert made.refused == Counter(quaternion=1)


def test_messages_played_twice_give_the_same_twice() -> None:
    sent = [m for k in range(200, 400) for m in sample(k + 0.1 * math.sin(k))]
    made = adapter({"derivatives": {}})
    first, second = (numbers(list(adapt_messages(sent, made))) for _ in range(2))
    assert len(first) == 2 * 196 and first == second
    assert made.restarts == 1 and not made.refused


def test_a_field_that_does_not_exist_names_topic_type_path_and_fields() -> None:
    made = adapter({"states": {"s": "a speed"}})
    with pytest.raises(EstimationError) as caught:
        made.push(*sample(0)[0])
    text = str(caught.value)
    assert all(part in text for part in ("topic /a (p/msg/A)", "'speed'", "its fields are t, s, rate"))


def test_topics_that_are_missing_or_of_another_type_are_named() -> None:
    made = adapter()
    made.check({"/a": "p/msg/A", "/b": "p/msg/B", "/c": "x"})
    with pytest.raises(EstimationError, match=r"no topic /b \(p/msg/B\); there are '/a'"):
        made.check({"/a": "p/msg/A"})
    with pytest.raises(EstimationError, match="topic /b has type q/msg/B; the inputs expect p/msg/B"):
        made.check({"/a": "p/msg/A", "/b": "q/msg/B"})


def test_rows_pass_the_gate_and_refusals_share_its_counter() -> None:
    gate = Synchronizer(["s"], ["e"])
    made = adapter(refused=gate.refused)
    pairs = [row.offer(gate) for row in adapt_messages([m for k in range(10) for m in sample(k)], made)]
    assert sum(p is not None for p in pairs) == gate.paired == 10
    made.push(*sample(9)[0])
    assert gate.refused == Counter(stamp_repeated=1)


# The section


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"clock": "c"}, "inputs.clock is 'c'; it must be one of the topics, 'a', 'b'"),
        ({"maximum_age": -1}, "maximum_age is -1; it must be a number from 1e-06 to 10"),
        ({"intervals": -1}, "inputs.intervals is -1; it must be a whole number from 1 to 1000, or 0"),
        ({"imu_position": [1.0]}, "inputs.imu_position is [1.0]; it must be 3 numbers"),
        ({"states": {"s": "c s"}}, "parameter 'inputs.states.s': 'c' is not a topic; inputs.topics has 'a', 'b'"),
        ({"states": {"s": "a"}}, "parameter 'inputs.states.s': it is 'a'; it must begin with two words"),
        ({"states": {"s": "a s gain=2"}}, "'gain' does not exist here; there are "),
        ({"states": {"s": "a s scale=x"}}, "scale is 'x'; it must be a number"),
        ({"states": {"s": "a s,rate"}}, "'s,rate' has 2 paths; expected 1"),
        ({"effectors": {"e": "b l,r scale=1,2,3"}}, "scale has 3 numbers; expected 1 or 2"),
        ({"states": {"s": 3}}, "parameter 'inputs.states.s': it is 3; it must be a line of words in quotes"),
        ({"speed": "a s"}, "parameter 'inputs.speed' does not exist; there are clock, maximum_age"),
        ({"imu_postion": [0.5, 0.0, -0.1]}, "derivatives.NAME, effectors.NAME; did you mean 'imu_position'?"),
        ({"efectors.de": "a s"}, "derivatives.NAME, effectors.NAME; did you mean 'effectors.de'?"),
        ({"velocity": "a v frame=north"}, "frame is 'north'; it must be one of frd, flu, ned, enu, nwu"),
        ({"topics": {"a": "/a A"}}, "parameter 'inputs.topics.a': 'A' is not a type; expected PACKAGE/msg/NAME"),
    ],
)
def test_a_wrong_entry_is_named_with_what_would_be_right(changes: dict[str, Any], says: str) -> None:
    with pytest.raises(EstimationError) as caught:
        adapter(changes)
    assert says in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "states", "says"),
    [
        ({"effectors": {}}, ("s",), "'effectors.e' comes from nowhere: give inputs.effectors.e"),
        ({}, ("s", "u"), "'u' comes from nowhere: give inputs.states.u or inputs.velocity"),
        ({"velocity": "a v", "states": {"u": "a s"}}, ("u",), "comes from both inputs."),
        ({"effectors": {"e": "b e", "f": "b f"}}, ("s",), "inputs.effectors.f: the identifier has no such name"),
        ({"velocity": "a v frame=ned"}, ("s",), "inputs.velocity cannot be used without 'Phi', 'Psi', 'Theta'"),
        ({"specific_force": "a f"}, ("s",), "inputs.specific_force cannot be used without 'P'"),
        ({"imu_position": [1.0, 0.0, 0.0]}, ("s",), "inputs.imu_position is given, but"),
    ],
)
def test_a_mapping_that_does_not_fit_is_refused_at_the_start(
    changes: dict[str, Any], states: tuple[str, ...], says: str
) -> None:
    with pytest.raises(EstimationError) as caught:
        adapter(changes, states=states)
    assert says in str(caught.value)


def test_entries_may_be_nested_or_dotted() -> None:
    flat = {"clock": "a", "topics.a": "/a p/A stamp=arrival", "states.s": "a s", "effectors.e": "a e"}
    made = InputAdapter(InputMap.from_parameters(flat), ("s",), ("e",))
    assert made.topics == {"/a": "p/msg/A"} and made.methods == {"s": "differentiated"}


@pytest.mark.parametrize("text", ["a\nb", "name[key=a\x1cb]", "\x00"])
def test_a_path_with_what_cannot_be_printed_is_refused_in_one_line(text: str) -> None:
    """Found by coverage-guided fuzzing: it made two lines of one."""
    with pytest.raises(EstimationError, match="cannot be printed") as caught:
        FieldPath(text)
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize("text", ["a" * 501, "channels[" + "9" * 5000 + "]"])
def test_a_path_without_end_is_refused_in_a_short_line(text: str) -> None:
    with pytest.raises(EstimationError, match="expected at most 500") as refused:
        FieldPath(text)
    assert len(str(refused.value)) < 200


@pytest.mark.parametrize(
    "path", ["name[1]", "name", "get_fields_and_field_types", "header.stamp", "header.stamp.sec", "__class__"]
)
def test_a_number_is_written_only_where_one_stands(path: str) -> None:
    from sensor_msgs.msg import JointState

    joints = JointState(name=["a", "b"], position=[0.1, 0.2])
    before = deepcopy(joints)
    with pytest.raises(EstimationError, match="expected a real number"):
        FieldPath(path).write(joints, 0.25)
    assert joints == before


@pytest.mark.parametrize("field", ["s", "e"])
def test_what_jumps_away_and_back_never_enters_the_window_and_is_counted(field: str) -> None:
    """The rows are those of a log without these instants; what stays away is a step, and is used."""
    spoilt, away = (80, 81), 120
    made, clean = adapter({"derivatives": {}}), adapter({"derivatives": {}})
    said: list[str] = []
    made._report = lambda refused: said.append(str(refused))
    rows: list[list[Any]] = [[], []]
    for k in range(160):
        for topic, arrived, message in sample(k):
            message = deepcopy(message)
            if hasattr(message, field):
                setattr(message, field, getattr(message, field) + 5.0 * (k in spoilt) + 4.0 * (k >= away))
            rows[0] += made.push(topic, arrived, message)
            rows[1] += clean.push(topic, arrived, message) if k not in spoilt else []
    assert numbers(rows[0]) == numbers(rows[1])
    assert made.refused["spike"] == 2 and clean.refused["spike"] == 0
    assert said[0] == f"{field} at 0.800 s jumps, and is back at 0.820 s"
    made._begin_anew()
    assert made.push(*sample(200)[0]) == []


def test_rows_that_wait_for_a_number_to_come_back_are_counted() -> None:
    made, held = adapter({"derivatives": {}}), []
    for k in range(100):
        for topic, arrived, message in sample(k):
            if hasattr(message, "e"):
                message.e += 5.0 * (k in (80, 81)) + 4.0 * (k == 99)
            made.push(topic, arrived, message)
        held.append(made.held)
    assert held == [*[0] * 80, 1, 2, *[0] * 17, 1]
    made.clear()
    assert made.held == 0
