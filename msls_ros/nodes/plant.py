"""The plant node: a simulated aircraft, in lockstep with those who answer its samples, or in real time."""

from __future__ import annotations

import math
from collections import Counter, deque
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from msls_msgs.msg import DitherCommand, EffectorCommand, EffectorSample, LinearModel, StateSample
from msls_msgs.srv import InjectFault
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.task import Future
from rosgraph_msgs.msg import Clock as ClockMessage
from std_srvs.srv import Trigger

from msls_ros import messages
from msls_ros.estimation.mixer import Mixer, MixerLimits
from msls_ros.flights.aircraft_files import DEFAULT, find_aircraft
from msls_ros.flights.scenario_yaml import ScenarioError
from msls_ros.inputs import NamedVector, Refused
from msls_ros.nodes.parameters import NodeError, declare_table, fixed, warn_of_unknown
from msls_ros.nodes.quality import INPUT, OUTPUT, listen, publish
from msls_ros.nodes.refusals import Diagnostics, Health, Refusals, StampGate
from msls_ros.plant import (
    NOISE_LEVELS,
    STATES,
    TURBULENCE,
    Aircraft,
    Airframe,
    Fault,
    FaultSchedule,
    FlightCondition,
    PlantError,
    check_faults,
    make_sensors,
    parse_instruments,
)

PARAMETERS = {
    "aircraft": fixed(DEFAULT, "what flies: a name of config/aircraft, or the path of your own .yaml"),
    "condition": fixed("", "flight condition of the aircraft; empty: its first (high_alpha of the F-16/MATV)"),
    "noise": fixed("low", "sensor noise", choices=NOISE_LEVELS),
    "turbulence": fixed("none", "turbulence of the air (MIL-F-8785C)", choices=TURBULENCE),
    "gusts": fixed(0.0, "rms of first-order gusts besides the turbulence", unit="m/s", low=0.0, high=30.0),
    "sensors": fixed(
        [],
        "sensors as on real aircraft, one line each: 'suite=flight_test', 'delay=0.02', 'white.P=0.001'",
        unit="",
    ),
    "seed": fixed(0, "seed of sensor noise and turbulence", low=0, high=2**31 - 1),
    "mode": fixed(
        "lockstep",
        "lockstep: wait for the answers to each sample; real_time: wall clock",
        choices=("lockstep", "real_time"),
    ),
    "fdm_rate": fixed(100, "rate of the flight dynamics model", unit="Hz", low=50, high=1000),
    "steps_per_sample": fixed(2, "flight dynamics steps per published sample", unit="steps", low=1, high=1000),
    "truth_every": fixed(5, "samples per published truth model", unit="samples", low=1, high=100_000),
    "stale_after": fixed(
        0.1, "real time: a dither older than this is not added, nor held for longer", unit="s", low=0.001, high=3600.0
    ),
    "latency": fixed(0, "samples by which commands reach the actuators late", unit="samples", low=0, high=20),
    "publish_clock": fixed(True, "publish /clock; false where another clock is the time of the system"),
    "wait_for_dither": fixed(True, "lockstep: wait for the identifier too, not only for the pilot"),
    "time_out": fixed(
        1.0, "wall-clock wait for answers before trim and zero dither take over", unit="s", low=0.01, high=3600.0
    ),
    "duration": fixed(0.0, "flight time after which the plant stops; 0: never", unit="s", low=0.0, high=1e6),
    "autostart": fixed(True, "start when a pilot (and, where waited for, an identifier) is there"),
    "faults": fixed(
        [],
        "what breaks, in order of time, one line each: a surface or an effector, then time=[s] effectiveness=[1] and "
        "where wanted ramp=[s] stuck=true bias=[rad], as in "
        "'left_stabilator time=4.0 effectiveness=0.5 ramp=5.0'",
        unit="",
    ),
}
READY_CHECKS = 10
"""Checks in a row, 20 ms apart, that must find pilot and identifier connected before the flight begins."""
SETTLING_TIME = 1.0
"""A reset before this much flight [s] would look like messages out of order to those who listen."""


class PlantNode(Node):
    """Fly the aircraft: publish samples and truth, take commands and dither, be damaged on request.

    Parameters
    ----------
    **options
        As for `rclpy.node.Node`.

    Raises
    ------
    NodeError, PlantError
        For a parameter that is refused.
    """

    def __init__(self, name: str = "plant", **options: Any) -> None:
        """Declare the parameters and build the aircraft at trim."""
        super().__init__(name, **options)
        warn_of_unknown(self, PARAMETERS)
        self._p = declare_table(self, PARAMETERS)
        self._lockstep = self._p["mode"] == "lockstep"
        self._condition = chosen_condition(self._p)
        self._effectors = self._condition.airframe.effectors
        self._vectors = {kind: NamedVector(kind, self._effectors) for kind in ("command", "dither")}
        self._refusals = Refusals(self)
        self.time_outs = 0
        """Samples that were not answered in time."""
        self.samples = 0
        """Samples published since the start."""
        self.truths = 0
        """Truth models published since the start."""
        self.finished: Future = Future()
        """Done when the flight has lasted for ``duration``."""
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._running = False
        self._faults = _read_faults(self._p["faults"], self._condition.airframe)
        self._build()
        self._make_topics()
        self._make_timers()

    @property
    def refused(self) -> Counter[str]:
        """Messages refused, by reason."""
        return self._refusals.counts

    @property
    def sample_period(self) -> float:
        """Flight time between samples [s]."""
        return float(self._p["steps_per_sample"] / self._p["fdm_rate"])

    def _make_topics(self) -> None:
        p = self._p
        self.state_publisher = publish(self, StateSample, "state", OUTPUT)
        self.effector_publisher = publish(self, EffectorSample, "effectors", OUTPUT)
        self.truth_state_publisher = publish(self, StateSample, "truth/state", OUTPUT)
        self.truth_model_publisher = publish(self, LinearModel, "truth/model", OUTPUT)
        self._clock_publisher = publish(self, ClockMessage, "/clock", OUTPUT) if p["publish_clock"] else None
        for kind, topic in ((EffectorCommand, "command"), (DitherCommand, "dither")):
            listen(self, kind, topic, INPUT, partial(self._on_answer, topic), self._refusals.take)
        self.create_service(InjectFault, "~/inject_fault", self._on_inject_fault)
        self.create_service(Trigger, "~/reset", self._on_reset)

    def _make_timers(self) -> None:
        if self._lockstep:
            self.create_timer(0.25 * self._p["time_out"], self._watch, clock=self._steady)
        else:
            self.create_timer(self.sample_period, self._tick, clock=self._steady)
        if self._p["autostart"]:
            self._ready = 0
            self._starter = self.create_timer(0.02, self._start_when_ready, clock=self._steady)
        self._diagnostics = Diagnostics(self, self._health, self.refused)

    def _build(self) -> None:
        """Put a new aircraft at trim, time 0, with the sensors' noise from its beginning."""
        p = self._p
        self._aircraft = Aircraft(
            self._condition, rate=p["fdm_rate"], turbulence=p["turbulence"], seed=p["seed"], gusts=p["gusts"]
        )
        instruments = parse_instruments(p["sensors"]) if p["sensors"] else None
        self._sensors = make_sensors(instruments, p["noise"], p["seed"])
        self._held = self._aircraft.trim.delta
        self._late = deque([self._held] * p["latency"])
        self._index = -1
        self._answers: dict[str, Any] = {"command": None, "dither": None}
        self._arrived = {"command": 0, "dither": 0}
        self._stamps = {kind: StampGate(kind) for kind in self._answers}
        self._stamp = 0
        stale_after = math.inf if self._lockstep else p["stale_after"]
        self._mixer = Mixer(len(self._effectors), MixerLimits(stale_after=stale_after))
        self._schedule = FaultSchedule(self._faults, self.sample_period)
        self.samples = self.truths = 0

    def start(self) -> None:
        """Publish the first sample; the answers drive the rest."""
        self._running = True
        self._publish()

    def _start_when_ready(self) -> None:
        """Start when those who must answer have been connected for a while: discovery goes both ways."""
        asked = ["command", "dither"] if self._p["wait_for_dither"] else ["command"]
        answered = all(self.count_publishers(self.resolve_topic_name(topic)) > 0 for topic in asked)
        heard = self.state_publisher.get_subscription_count() >= len(asked)
        seen = "dither" not in asked or self.effector_publisher.get_subscription_count() > 0
        self._ready = self._ready + 1 if answered and heard and seen else 0
        if self._ready == READY_CHECKS:
            self.destroy_timer(self._starter)
            if not self._running:
                self.start()

    def _publish(self) -> None:
        """Publish the present sample; truth where it is due. A sample that is lost passes, and the next one with it."""
        self._index += 1
        while self._sensors.lost():
            self._fly(self._held)
            self._index += 1
        sample = self._aircraft.sample()
        measured = self._sensors.measure(sample)
        self._stamp = stamp = round(sample.time * 1e9)
        self._published_at = self._steady.now().nanoseconds
        if self._lockstep:
            self._answers = {"command": None, "dither": None}
        if self._clock_publisher is not None:
            self._clock_publisher.publish(ClockMessage(clock=messages.time_message(stamp)))
        self.truth_state_publisher.publish(messages.state_message(stamp, STATES, sample.x, sample.xdot))
        if self.samples % self._p["truth_every"] == 0 or self._schedule.turns(self._index):
            truth = self._aircraft.truth()
            message = messages.truth_message(stamp, STATES, self._effectors, truth.a, truth.b, truth.bias)
            self.truth_model_publisher.publish(message)
            self.truths += 1
        self.samples += 1
        self.state_publisher.publish(messages.state_message(stamp, STATES, measured.x, measured.xdot))
        self.effector_publisher.publish(messages.effector_message(stamp, self._effectors, measured.delta))
        duration = self._p["duration"]
        if duration > 0.0 and sample.time >= duration - 1e-9:
            self._running = False
            if not self.finished.done():
                self.finished.set_result(True)

    def _on_answer(self, kind: str, message: EffectorCommand | DitherCommand) -> None:
        """Take a command or a dither; in lockstep fly on when both have come."""
        try:
            (delta,) = self._vectors[kind].arrange(message.effectors, delta=message.delta)
            self._check_stamp(kind, message)
        except Refused as refused:
            self._refusals.take(refused)
            return
        self._answers[kind] = delta
        self._arrived[kind] = self._steady.now().nanoseconds
        if isinstance(message, DitherCommand):
            self._mixer.take(self._arrived[kind] * 1e-9, delta, message.level)
        if self._lockstep and self._complete():
            self._step()

    def _check_stamp(self, kind: str, message: EffectorCommand | DitherCommand) -> None:
        """Refuse what answers another sample (lockstep) or is out of order (real time); a stop is never refused."""
        stamp = messages.stamp_of(message)
        if not self._lockstep:
            if kind == "command" or message.level != DitherCommand.LEVEL_INHIBITED:
                self._check_age(kind, stamp)
                self._stamps[kind].check(stamp)
            return
        if stamp != self._stamp:
            reason = "late" if stamp < self._stamp else "early"
            text = f"{kind}: answers the sample at {stamp * 1e-9:.3f} s; expected {self._stamp * 1e-9:.3f} s"
            raise Refused(reason, text)
        if self._answers[kind] is not None:
            raise Refused("stamp_repeated", f"{kind}: a second answer to the sample at {stamp * 1e-9:.3f} s")

    def _check_age(self, kind: str, stamp: int) -> None:
        """Refuse a dither for a sample of long ago."""
        age = (self._stamp - stamp) * 1e-9
        if kind == "dither" and age > self._p["stale_after"]:
            text = f"dither: answers a sample {age:.3f} s ago; expected one within {self._p['stale_after']:g} s"
            raise Refused("stale", text)

    def _complete(self) -> bool:
        dither = self._answers["dither"] is not None or not self._p["wait_for_dither"]
        return self._running and dither and self._answers["command"] is not None

    def _step(self) -> None:
        """Fly to the next sample with what was answered; without a command at trim, without a dither with none."""
        command, now = self._answers["command"], self._steady.now().nanoseconds * 1e-9
        if self._answers["dither"] is None:
            self._mixer.drop("no dither")
        total = self._aircraft.trim.delta if command is None else self._mixer.mix(now, command).command
        self._late.append(total)
        self._held = self._late.popleft()
        self._fly(self._held)
        self._publish()

    def _fly(self, command: Any) -> None:
        """Fly from this sample to the next with a command; what is due to break breaks now."""
        for text in self._schedule.strike(self._index, self._aircraft):
            self.get_logger().info(f"at {self._aircraft.time:.3f} s: {text}")
        for _ in range(self._p["steps_per_sample"]):
            if self._sensors.follows:
                self._sensors.follow(self._aircraft.sample())
            self._aircraft.step(command)

    def _watch(self) -> None:
        """Lockstep: go on at trim when the answers stay out, and say so."""
        waited = (self._steady.now().nanoseconds - self._published_at) * 1e-9 if self._running else 0.0
        if waited < self._p["time_out"]:
            return
        self.time_outs += 1
        missing = [k for k, v in self._answers.items() if v is None and (k != "dither" or self._p["wait_for_dither"])]
        text = f"no {' and no '.join(missing)} for the sample at {self._stamp * 1e-9:.3f} s within {waited:.2f} s"
        self.get_logger().warning(f"{text}: flying on at trim with zero dither", throttle_duration_sec=1.0)
        self._answers = {"command": None, "dither": None}
        self._step()

    def _tick(self) -> None:
        """Real time: fly on with the newest answers; those that are too old count no more."""
        if not self._running:
            return
        now = self._steady.now().nanoseconds
        for kind, answer in self._answers.items():
            age = (now - self._arrived[kind]) * 1e-9
            if answer is not None and age >= self._p["time_out" if kind == "command" else "stale_after"]:
                self._answers[kind] = None
                self.time_outs += 1
                text, log = f"no {kind} for {age:.2f} s: flying on", self.get_logger()
                if kind == "command":  # each line is throttled by itself
                    log.warning(f"{text} at trim with zero dither", throttle_duration_sec=1.0)
                else:
                    log.warning(f"{text} with zero dither", throttle_duration_sec=1.0)
        self._step()

    def _health(self) -> Health:
        counts = {"samples": self.samples, "time-outs": self.time_outs}
        if not self._running:
            return Health(DiagnosticStatus.OK, "finished" if self.finished.done() else "waiting", counts)
        if self._answers["command"] is None and not self._lockstep:
            return Health(DiagnosticStatus.WARN, "no command: flying at trim", counts)
        level = DiagnosticStatus.WARN if self.time_outs else DiagnosticStatus.OK
        return Health(level, f"flying; {self.time_outs} samples not answered in time", counts)

    def _on_inject_fault(self, request: InjectFault.Request, response: InjectFault.Response) -> InjectFault.Response:
        try:
            now = self._aircraft.time
            numbers = (request.effectiveness, request.ramp, request.stuck, request.bias)
            hard_over = request.position if request.driven else None
            fault = Fault(request.effector, now, *numbers, hard_over, self._condition.airframe)
            response.message = self._schedule.inject(fault, self._index, self._aircraft)
            response.success = True
            self.get_logger().info(f"at {now:.3f} s: {response.message}")
        except PlantError as error:
            response.success, response.message = False, str(error)
        return response

    def _on_reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._running and self._aircraft.time <= SETTLING_TIME:
            response.success = False
            response.message = f"only {self._aircraft.time:.2f} s flown; a reset needs more than {SETTLING_TIME:g} s"
            return response
        self._build()
        if self._running:
            self._publish()
        response.success, response.message = True, "a new aircraft at trim, time 0"
        return response


def chosen_condition(parameters: dict[str, Any]) -> FlightCondition:
    """Return what flies and where, of the parameters ``aircraft`` and ``condition``.

    Raises
    ------
    NodeError
        For an aircraft or a condition that does not exist, or a file that is wrong.
    """
    name = parameters["condition"]
    try:
        aircraft = find_aircraft(parameters["aircraft"])
        if name and name not in aircraft.condition_names:
            message = f"parameter 'condition' is {name!r}; it must be one of {', '.join(aircraft.condition_names)}"
            raise NodeError(message)
        return aircraft.condition(name)
    except ScenarioError as error:
        message = f"parameter 'aircraft' is {parameters['aircraft']!r}: {error}"
        raise NodeError(message) from error


def _read_faults(lines: list[str], airframe: Airframe) -> tuple[Fault, ...]:
    """Return the faults of the parameter ``faults``.

    Raises
    ------
    NodeError
        For a line that is none, or faults that do not go together.
    """
    try:
        faults = tuple(Fault.parse(line, airframe) for line in lines)
        check_faults(faults)
    except PlantError as error:
        message = f"parameter 'faults' is {lines!r}: {error}"
        raise NodeError(message) from error
    return faults
