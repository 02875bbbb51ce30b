"""From messages of any type to the samples that the identifier takes: one path for live data and bags.

::

    message -> fields (input_map) -> one clock (alignment) -> our frames, derivatives that
               are known (frames) -> derivatives that are not (derivatives) -> StateRow, EffectorRow -> Synchronizer

Where the derivative of a state comes from, the first that the mapping allows:

================  ==================  =============================================================================
measured          any                 ``derivatives.NAME``, or ``angular_acceleration`` for P, Q, R
accelerometer     u, v, w             ``specific_force``, gravity and rates; moved from the IMU to the centre of mass
kinematics        Phi, Theta, Psi     the rates and the Euler angles
differentiated    any                 a window of samples; then all else passes the same window, see `derivatives`
================  ==================  =============================================================================

What cannot be used is counted by reason: `not_finite`, `stamp_repeated`, `stamp_back`, `field_missing`, `stale`, `gap`,
`spike`, `repeated` (see `pacing`), `stamp_rogue` and `time_returned` (see `timeline`). Counted with it, though all else
of the sample is used: `velocity_jump` (see `velocity_jumps`).
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from msls_ros.estimation.configuration import Configuration
from msls_ros.estimation.errors import EstimationError, nearest
from msls_ros.estimation.kernel import Array
from msls_ros.estimation.screening import GAP
from msls_ros.estimation.spikes import SpikeFilter, spike_settings
from msls_ros.inputs import frames
from msls_ros.inputs.alignment import Aligner, Values
from msls_ros.inputs.derivatives import DerivativeFilter, usual_intervals
from msls_ros.inputs.field_paths import listed
from msls_ros.inputs.input_map import VECTORS, WIND, InputMap, StreamInput, TopicInput, unlagged
from msls_ros.inputs.input_plan import arm, plan
from msls_ros.inputs.pacing import Pacer, slowest_pace
from msls_ros.inputs.servo_lag import ServoLag
from msls_ros.inputs.slow_topics import SlowTopics
from msls_ros.inputs.synchronizer import PairedSample, Synchronizer
from msls_ros.inputs.timeline import Refused, Timeline
from msls_ros.inputs.velocity_jumps import JumpFilter, Settled, velocities_made

_ANGLES = ("Phi", "Theta", "Psi")
_VELOCITY = ("u", "v", "w")
_RATES = ("P", "Q", "R")

TICKS = (
    "stamp=arrival is read from the node's clock, which under use_sim_time moves in ticks of /clock: publish /clock "
    "faster than this topic, or give stamp=PATH"
)
"""What to do about arrivals at the same time."""


class StateRow(NamedTuple):
    """Arguments of `Synchronizer.add_state`."""

    stamp: int
    """[ns]"""
    names: tuple[str, ...]
    x: Array
    xdot: Array

    def offer(self, gate: Synchronizer) -> PairedSample | None:
        """Put it through the gate; as `Synchronizer.add_state`."""
        return gate.add_state(self.stamp, self.names, self.x, self.xdot)  # type: ignore[arg-type]


class EffectorRow(NamedTuple):
    """Arguments of `Synchronizer.add_effectors`."""

    stamp: int
    """[ns]"""
    names: tuple[str, ...]
    delta: Array

    def offer(self, gate: Synchronizer) -> PairedSample | None:
        """Put it through the gate; as `Synchronizer.add_effectors`."""
        return gate.add_effectors(self.stamp, self.names, self.delta)  # type: ignore[arg-type]


Row = StateRow | EffectorRow


class InputAdapter:
    """Turn messages into rows for the `Synchronizer`.

    Parameters
    ----------
    inputs
        What is read where.
    states, effectors
        Names that the identifier wants.
    time_jump
        A step back in time larger than this [s] starts anew, once confirmed (see `timeline`); a message that goes back
        less is refused.
    reference_speed
        Of flight [m/s].
    sample_rate
        Of the clock [Hz], for the window of derivatives where the inputs say nothing of it; 0: not known.
    slowest
        Longest step of a stream slower than the clock that sets the pace of the rows [s], see `pacing`; 0: none does.
    refused
        Where refusals are counted by reason; None: in a counter of its own.
    report
        Told about each refusal, after it has been counted.

    Raises
    ------
    EstimationError
        If a state or effector comes from nowhere, or from two places.
    """

    def __init__(
        self,
        inputs: InputMap,
        states: Sequence[str],
        effectors: Sequence[str],
        *,
        time_jump: float = 1.0,
        reference_speed: float = 100.0,
        sample_rate: float = 0.0,
        slowest: float = 0.0,
        refused: Counter[str] | None = None,
        report: Callable[[Refused], None] = lambda _: None,
    ) -> None:
        """Plan the way of every number; see the class."""
        self.inputs = inputs
        self.refused: Counter[str] = Counter() if refused is None else refused
        """Messages and instants that could not be used, by reason."""
        self.restarts = 0
        """Jumps back in time."""
        self._report = report
        self._timeline: Timeline[tuple[str, Any]] = Timeline(round(time_jump * 1e9), self._refuse)
        self._states, self._effectors = tuple(states), tuple(effectors)
        self.methods: Mapping[str, str] = plan(inputs, self._states, self._effectors)
        """How the derivative of each state comes about: see the module."""
        streams = [s for s in inputs.streams.values() if s.name not in inputs.compared]
        self._streams = streams
        self._of_topic = {
            topic.topic: [(i, s) for i, s in enumerate(streams) if s.source == alias]
            for alias, topic in inputs.topics.items()
        }
        self._topic_inputs = {topic.topic: topic for topic in inputs.topics.values()}
        self._used = {t for t, read in self._of_topic.items() if read} | {inputs.topics[inputs.clock].topic}
        delays = [s.delay for s in streams] + [inputs.topics[inputs.clock].delay]
        patience = inputs.maximum_age + max(delays) - min(delays)
        clock = inputs.topics[inputs.clock].topic
        own = [i for i, _ in self._of_topic[clock]]
        self._aligner = Aligner([s.track for s in streams], patience, self._refuse, clock, own)
        self._pacer = Pacer(streams, sample_rate, slowest)
        self.slow = SlowTopics(streams, [inputs.topics[s.source].topic for s in streams], sample_rate, slowest)
        self._arm, self._vane = arm(inputs, self.methods), inputs.vane_position
        lever = any(self._arm) and "angular_acceleration" not in inputs.streams
        differentiated = lever or "differentiated" in self.methods.values()
        n, m = len(self._states), len(self._effectors)
        intervals = inputs.intervals or usual_intervals(sample_rate)
        self.straddle = intervals if differentiated else 0
        """Samples over which a row reaches at most: intervals of the derivatives' window; 0: nothing is
        differentiated."""
        self.servos = any(stream.servo > 0.0 for stream in streams)
        """Whether deflections are commands behind servos that are declared; as `Identifier` takes it."""
        self._columns = 2 * n + m + 3
        self._filter = DerivativeFilter(intervals, self._columns, inputs.maximum_age) if differentiated else None
        made = velocities_made((name, self.methods[name] == "differentiated") for name in self._states)
        self._jumps = JumpFilter(made, reference_speed, inputs.maximum_age)
        velocity = [name in _VELOCITY for name in self._states]
        self._spikes = SpikeFilter(
            spike_settings(
                [*velocity, *[False] * m, *velocity, *[False] * 3],
                [*[False] * (n + m), *[True] * n, *[False] * 3],
                reference_speed,
                inputs.maximum_age * 1e-9,
                effector=[*[False] * n, *[True] * m, *[False] * (n + 3)],
            )
        )
        self._names = (*self._states, *self._effectors, *(f"d{name}/dt" for name in self._states), *_RATES)
        frames.to_body((0.0, 0.0, 0.0), frames.euler_angles((1.0, 0.0, 0.0, 0.0), "frd", "ned"))  # compiles now
        self._told_held = 0
        self._restart()

    @classmethod
    def of(
        cls,
        inputs: InputMap,
        configuration: Configuration,
        refused: Counter[str],
        report: Callable[[Refused], None] = lambda _: None,
    ) -> InputAdapter:
        """Return the adapter of an identifier; its gate's ``refused`` counts what is refused here, too."""
        return cls(
            inputs,
            configuration.states,
            configuration.effectors,
            time_jump=configuration.time_jump,
            reference_speed=configuration.reference_speed,
            sample_rate=configuration.sample_rate,
            slowest=slowest_pace(configuration),
            refused=refused,
            report=report,
        )

    @property
    def topics(self) -> dict[str, str]:
        """Types by topic, as the mapping names them."""
        return {topic.topic: topic.msgtype for topic in self.inputs.topics.values()}

    @property
    def pace(self) -> tuple[str, float]:
        """Which stream that is slower than the clock sets the pace of the rows, and at what rate [Hz]; empty: none."""
        pacer = self._pacer
        return (self._streams[pacer.pacer].track.name, 1.0 / pacer.period) if pacer.pacer >= 0 else ("", 0.0)

    @property
    def too_slow(self) -> dict[str, str]:
        """A sentence for each topic that comes too seldom for the rate of the samples."""
        return self.slow.found(self._pacer.pacer)

    def apart(self, topic: str) -> str:
        """Say that the stamps of a topic are of another clock or unit than those of the clock; empty: they are not."""
        return next((text for i, _ in self._of_topic.get(topic, ()) if (text := self._aligner.apart(i))), "")

    def newly_slow(self) -> list[str]:
        """Return the sentences of topics that have become too slow since the last call."""
        return self.slow.news(self._pacer.pacer)

    @property
    def waiting(self) -> bool:
        """Whether a message waits for others to confirm its stamp."""
        return self._timeline.waiting

    @property
    def held(self) -> int:
        """Rows held until it is seen whether a number that has jumped comes back: a spike, see `SpikeFilter`."""
        return self._held

    def newly_held(self) -> int | None:
        """Return the time from the last row that was used to the newest that is held [ns], 0 where none is any more.

        None: as many are held as at the last call.
        """
        if self._held == self._told_held:
            return None
        self._told_held = self._held
        return self._newest - self._last_used if self._held else 0

    def push(self, topic: str, stamp_ns: int, message: Any) -> list[Row]:
        """Take a message.

        Parameters
        ----------
        topic
            A key of `topics`; messages of others are ignored, and those of topics that no sample needs: they would
            have a say in what time it is, and whoever sends the next sample after this one is answered waits for them.
        stamp_ns
            When it arrived or was logged [ns]; used where the mapping says ``stamp=arrival``.
        message
            Any object with the fields that the mapping names.

        Returns
        -------
        list of StateRow and EffectorRow
            What became complete, in order of time: a state row and the effector row of the same stamp, and so on.

        Raises
        ------
        EstimationError
            If messages of this type do not have a field, or it is no number: names topic, type, path and fields.
        """
        source = self._topic_inputs.get(topic)
        if source is None or topic not in self._used:
            return []
        try:
            passed = self._timeline.take(f"topic {topic}", source.instant(stamp_ns, message), (topic, message))
        except Refused as refused:
            told = source.stamp is None and refused.reason == "stamp_repeated"
            self._refuse(Refused(refused.reason, f"{refused}. {TICKS}") if told else refused)
            return []
        except EstimationError as error:
            text = f"topic {topic} ({source.msgtype}): {error}"
            raise EstimationError(text) from None
        if passed.returned is not None:
            self._give_up(passed.items[-1], passed.returned)
        if passed.restarted:
            self._begin_anew()
            self.restarts += 1
        rows = (self._use(self._topic_inputs[name], stamp, each) for _, stamp, (name, each) in passed.items)
        return [row for found in rows for row in found]

    def _use(self, source: TopicInput, stamp: int, message: Any) -> list[Row]:
        """Read a message whose stamp has passed; return what became complete."""
        try:
            read = [self._take(index, stream, stamp, message) for index, stream in self._of_topic[source.topic]]
        except EstimationError as error:
            text = f"topic {source.topic} ({source.msgtype}): {error}"
            raise EstimationError(text) from None
        if source is self.inputs.topics[self.inputs.clock] and (any(read) or not read):
            instant = stamp - source.delay
            if self._pacer.tick(instant):
                self._aligner.tick(instant)
        ready = self._aligner.ready()
        self.slow.made(len(ready), self._pacer.pacer)
        return [row for t, values in ready for row in self._rows(t, values)]

    def check(self, topics: Mapping[str, str]) -> None:
        """Compare with the topics that there are.

        Parameters
        ----------
        topics
            Types by topic, as of a bag.

        Raises
        ------
        EstimationError
            If a topic is missing or of another type.
        """
        for topic, msgtype in self.topics.items():
            if topic not in topics:
                message = f"no topic {topic} ({msgtype}); there are {listed(sorted(topics))}{nearest(topic, topics)}"
                raise EstimationError(message)
            if topics[topic] != msgtype:
                message = f"topic {topic} has type {topics[topic]}; the inputs expect {msgtype}"
                raise EstimationError(message)

    def clear(self) -> None:
        """Forget all messages; the counts stay."""
        self._restart()

    def _restart(self) -> None:
        self._timeline.clear()
        self._begin_anew()

    def _begin_anew(self) -> None:
        self._continued: dict[str, float] = {}
        self._repeated: set[str] = set()
        paced = self._pacer.pacer >= 0
        self._pacer.clear()
        self.slow.clear()
        self._lagging: dict[int, tuple[int, Values]] = {}
        self._servos = {i: ServoLag(s.servo, s.track.age) for i, s in enumerate(self._streams) if s.servo > 0.0}
        self._aligner.clear()
        self._spikes.clear()
        self._jumps.clear()
        self._held = self._last_used = self._newest = 0
        if self._filter is not None:
            self._filter.clear()
        if paced:
            self._fit_window()

    def _give_up(self, back: tuple[str, int, object], left: int) -> None:
        """Count the return of a stream from another time, and each instant that waits; begin anew."""
        name, stamp, _ = back
        text = f"{name}: stamp {stamp * 1e-9:.9f} s returns to the others from {left * 1e-9:.9f} s"
        self._refuse(Refused("time_returned", f"{text}; expected all streams on one clock"))
        for instant in self._aligner.waiting:
            self._refuse(Refused("time_returned", f"{text}: the instant {instant * 1e-9:.9f} s that waited is dropped"))
        self._begin_anew()

    def _refuse(self, refused: Refused) -> None:
        self.refused[refused.reason] += 1
        self._report(refused)

    def _take(self, index: int, stream: StreamInput, stamp: int, message: Any) -> bool:
        """Read a stream from a message; what cannot be used is refused (False), the other streams are not."""
        try:
            values = stream.read(message)
            size = sum([v * v for v in values])
            if not math.isfinite(size):
                text = f"{stream.track.name} is {listed(map(str, values))}; expected finite numbers"
                raise Refused("not_finite", text)
            if stream.track.quaternion and not 0.25 < size < 4.0:
                text = f"{stream.track.name} has a length of {math.sqrt(size):.3g}; expected 1, a rotation"
                raise Refused("quaternion", text)
        except Refused as refused:
            self._refuse(refused)
            return False
        if not self._pacer.measured(index, values):
            self.refused["repeated"] += 1
            if stream.name not in self._repeated:
                self._repeated.add(stream.name)
                text = f"{stream.track.name} is {listed(map(str, values))} again, and has not been measured since"
                self._report(Refused("repeated", text))
            return False
        name = stream.name.removeprefix("states.")
        if name in _ANGLES:
            values = (self._unwrapped(stream.name, values[0]),)
        if stream.lag > 0.0:
            before = self._lagging.get(index)
            self._lagging[index] = stamp, values
            if before is None or stamp - before[0] > stream.track.age:
                return True
            values = unlagged(stream.lag, before[1], values, (stamp - before[0]) * 1e-9)
            stamp = (before[0] + stamp) // 2
        if index in self._servos:
            values = (self._servos[index].take(stamp, values[0]),)
        instant = stamp - stream.delay
        self._aligner.add(index, instant, values)
        self.slow.sample(index, instant)
        pacer = self._pacer.pacer
        if self._pacer.sample(index, instant):
            self._aligner.tick(instant)
        if self._pacer.pacer != pacer:
            self._fit_window()
        return True

    def _fit_window(self) -> None:
        """Have the window of derivatives reach over as long at the pace of now as at that of the clock."""
        if self._filter is None or self.inputs.intervals:
            return
        intervals, longest = self.straddle, self.inputs.maximum_age
        if self._pacer.pacer >= 0:
            intervals = min(usual_intervals(1.0 / self._pacer.period), intervals)
            longest = max(longest, round(GAP * 1e9 * self._pacer.period))
        self._filter = DerivativeFilter(intervals, self._columns, longest)
        self._jumps.begin(longest)

    def _unwrapped(self, key: str, angle: float) -> float:
        self._continued[key] = angle = frames.continued(angle, self._continued.get(key, angle))
        return angle

    def _rows(self, t: int, values: Sequence[Values]) -> Iterator[Row]:
        """Make the rows of an instant, or of the window that it completes."""
        at = self._quantities(values)
        row = [at[name] for name in self._states] + [at[f"effectors.{name}"] for name in self._effectors]
        row += self._known_derivatives(at) + [at.get(name, 0.0) for name in _RATES]
        if self._filter is None:  # the identifier looks for spikes itself
            yield from self._made(t, np.array(row), None, [at.get(f"d{name}", 0.0) for name in _RATES])
            return
        settled = self._spikes.push(t, np.array(row))
        for stamp in self._spikes.dropped:
            name = self._names[self._spikes.furthest]
            self._refuse(Refused("spike", f"{name} at {stamp * 1e-9:.3f} s jumps, and is back at {t * 1e-9:.3f} s"))
        rows = [one for stamp, used in settled for one in self._jumped(stamp, used)]
        self._held, self._newest = 0 if rows else self._held + 1, t
        self._last_used = rows[-1].stamp if rows else self._last_used
        for one in rows:
            yield from self._filtered(self._filter, *one)

    def _jumped(self, t: int, row: Array) -> list[Settled]:
        """Return the rows to use now that it is known whether a velocity has jumped, see `JumpFilter`."""
        rows = self._jumps.push(t, row)
        if self._jumps.found is not None:
            stamp, which, size = self._jumps.found
            text = f"{self._names[which]} at {stamp * 1e-9:.3f} s jumps by {size:.3g} m/s without a force"
            text += f", the largest {self._jumps.largest:.3g} m/s: left out of the derivatives of velocities"
            self._refuse(Refused("velocity_jump", text))
        return rows

    def _filtered(self, window: DerivativeFilter, t: int, row: Array, jump: Array | None) -> Iterator[Row]:
        """Make the rows of the window that an instant completes."""
        gaps = window.gaps
        filtered = window.push(t, row, jump)
        if window.gaps > gaps:
            text = f"more than {self.inputs.maximum_age * 1e-9:g} s between samples before {t * 1e-9:.3f} s"
            self._refuse(Refused("gap", f"{text}: the window of the derivatives starts anew"))
        if filtered is not None:
            turning = filtered.slope[-len(_RATES) :].tolist()
            yield from self._made(filtered.stamp, filtered.smooth, filtered.slope, turning)

    def _made(self, t: int, smooth: Array, slope: Array | None, turning: Sequence[float]) -> Iterator[Row]:
        """Make the rows of an instant from its numbers, what they do where that is known, and angular accelerations."""
        n, m = len(self._states), len(self._effectors)
        xdot = smooth[n + m : n + m + n].copy()
        lever = frames.cross(turning, self._arm)
        for i, name in enumerate(self._states):
            method = self.methods[name]
            if method == "differentiated" and slope is not None:
                xdot[i] = slope[i]
            elif method == "accelerometer":
                xdot[i] -= lever[_VELOCITY.index(name)]
        yield StateRow(t, self._states, smooth[:n], xdot)
        yield EffectorRow(t, self._effectors, smooth[n : n + m])

    def _quantities(self, values: Sequence[Values]) -> dict[str, float]:
        """Return every number of an instant by name, vectors in our frames."""
        at: dict[str, float] = {}
        earth: tuple[Values, str] | None = None
        wind: tuple[Values, str] | None = None
        for stream, found in zip(self._streams, values, strict=True):
            if stream.name == "attitude":
                phi, theta, psi = frames.euler_angles(found, stream.body, stream.earth)
                at["Phi"], at["Theta"] = self._unwrapped("Phi", phi), theta
                at["Psi"] = self._unwrapped("Psi", psi)
            elif stream.name == WIND:
                wind = (*found, 0.0)[:3], stream.earth
            elif stream.earth:
                earth = found, stream.earth
            elif stream.name in VECTORS:
                signs = frames.BODY[stream.body]
                at.update((n, s * v) for n, s, v in zip(VECTORS[stream.name], signs, found, strict=True))
            else:
                at[stream.name.removeprefix("states.")] = found[0]
        if earth is not None:
            body = frames.to_body(frames.to_ned(*earth), (at["Phi"], at["Theta"], at["Psi"]))
            at.update(zip(_VELOCITY, body, strict=True))
        if "airspeed" in at:
            turning = frames.cross((at["P"], at["Q"], at["R"]), self._vane) if any(self._vane) else (0.0, 0.0, 0.0)
            moved = frames.air_velocity(at["airspeed"], at["alpha"], at["beta"])
            at.update((n, v - c) for n, v, c in zip(_VELOCITY, moved, turning, strict=True))
        if wind is not None:
            blown = frames.to_body(frames.to_ned(*wind), (at["Phi"], at["Theta"], at["Psi"]))
            at.update((n, at[n] - v) for n, v in zip(_VELOCITY, blown, strict=True))
        return at

    def _known_derivatives(self, at: Mapping[str, float]) -> list[float]:
        """Return the derivatives that need no differentiation, 0 for the others, in the order of the states."""
        made: dict[str, float] = {}
        kinds = self.methods.values()
        if "accelerometer" in kinds or "kinematics" in kinds:
            rates = (at["P"], at["Q"], at["R"])
            attitude = (at["Phi"], at["Theta"])
            made.update(zip(_ANGLES, frames.euler_rates(rates, attitude), strict=True))
        if "accelerometer" in kinds:
            turning = frames.centripetal(rates, self._arm)
            fx, fy, fz = (at[name] - c for name, c in zip(VECTORS["specific_force"], turning, strict=True))
            derivative = frames.velocity_derivative((fx, fy, fz), (at["u"], at["v"], at["w"]), rates, attitude)
            made.update(zip(_VELOCITY, derivative, strict=True))
        for name, method in self.methods.items():
            if method == "measured":
                made[name] = at[f"derivatives.{name}"] if f"derivatives.{name}" in at else at[f"d{name}"]
        return [made[name] if self.methods[name] != "differentiated" else 0.0 for name in self._states]


def adapt(messages: Iterable[tuple[str, int, Any]], adapter: InputAdapter) -> Iterator[Row]:
    """Yield the rows of messages, each (topic, stamp_ns, message)."""
    for topic, stamp_ns, message in messages:
        yield from adapter.push(topic, stamp_ns, message)
