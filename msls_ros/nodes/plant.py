"""The plant node: the simulated F-16/MATV, in lockstep with those who answer its samples, or in real time."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
from msls_msgs.msg import DitherCommand, EffectorCommand, EffectorSample, LinearModel, StateSample
from msls_msgs.srv import InjectFault
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.task import Future
from rosgraph_msgs.msg import Clock as ClockMessage
from std_srvs.srv import Trigger

from msls_ros import messages
from msls_ros.estimation import NamedVector, Refused
from msls_ros.nodes.parameters import declare_table
from msls_ros.nodes.quality import INPUT, OUTPUT
from msls_ros.plant import CONDITIONS, EFFECTORS, NOISE_LEVELS, STATES, Aircraft, PlantError, Sensors

PARAMETERS = {
    "condition": ("high_alpha", f"flight condition: one of {', '.join(CONDITIONS)}"),
    "noise": ("low", f"sensor noise: one of {', '.join(NOISE_LEVELS)}"),
    "seed": (0, "seed of the sensor noise, 0 or more"),
    "mode": ("lockstep", "lockstep (wait for the answers to each sample) or real_time (wall clock)"),
    "fdm_rate": (100, "rate of the flight dynamics model [Hz], 20 to 2000"),
    "steps_per_sample": (2, "flight dynamics steps per published sample, 1 or more"),
    "truth_every": (5, "samples per published truth model, 1 or more"),
    "wait_for_dither": (True, "lockstep: wait for the identifier too, not only for the pilot"),
    "time_out": (1.0, "lockstep: wall-clock wait for the answers before trim and zero dither are used [s], above 0"),
    "duration": (0.0, "flight time after which the plant stops [s]; 0: never"),
    "autostart": (True, "start when a pilot (and, where waited for, an identifier) is there"),
    "fault.time": (-1.0, "when the damage happens [s]; negative: never"),
    "fault.surface": ("left_stabilator", "what is damaged: a surface or an effector"),
    "fault.effectiveness": (0.0, "what is left of its effect [1], 0 to 1"),
    "fault.bias": (0.0, "constant deflection-equivalent that the damage adds [rad]"),
}


class PlantNode(Node):
    """Fly the aircraft: publish samples and truth, take commands and dither, be damaged on request.

    Parameters
    ----------
    **options
        As for `rclpy.node.Node`.

    Raises
    ------
    PlantError, EstimationError
        For a parameter that is refused.
    """

    def __init__(self, name: str = "plant", **options: Any) -> None:
        """Declare the parameters and build the aircraft at trim."""
        super().__init__(name, **options)
        self._p = declare_table(self, PARAMETERS)
        _check(self._p)
        self._vectors = {"command": NamedVector("command", EFFECTORS), "dither": NamedVector("dither", EFFECTORS)}
        self.refused: Counter[str] = Counter()
        """Messages refused, by reason."""
        self.time_outs = 0
        """Samples that were not answered in time."""
        self.samples = 0
        """Samples published since the start."""
        self.finished: Future = Future()
        """Done when the flight has lasted for ``duration``."""
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._build()
        self._make_topics()
        self._running = False
        if self._p["mode"] == "real_time":
            self.create_timer(self.sample_period, self._tick, clock=self._steady)
        else:
            self.create_timer(0.25 * self._p["time_out"], self._watch, clock=self._steady)
        if self._p["autostart"]:
            self._starter = self.create_timer(0.02, self._start_when_ready, clock=self._steady)

    @property
    def sample_period(self) -> float:
        """Flight time between samples [s]."""
        return float(self._p["steps_per_sample"] / self._p["fdm_rate"])

    def _make_topics(self) -> None:
        self.state_publisher = self.create_publisher(StateSample, "state", OUTPUT)
        self.effector_publisher = self.create_publisher(EffectorSample, "effectors", OUTPUT)
        self.truth_state_publisher = self.create_publisher(StateSample, "truth/state", OUTPUT)
        self.truth_model_publisher = self.create_publisher(LinearModel, "truth/model", OUTPUT)
        self._clock_publisher = self.create_publisher(ClockMessage, "/clock", OUTPUT)
        self.create_subscription(EffectorCommand, "command", lambda m: self._on_answer("command", m), INPUT)
        self.create_subscription(DitherCommand, "dither", lambda m: self._on_answer("dither", m), INPUT)
        self.create_service(InjectFault, "~/inject_fault", self._on_inject_fault)
        self.create_service(Trigger, "~/reset", self._on_reset)

    def _build(self) -> None:
        self._aircraft = Aircraft(CONDITIONS[self._p["condition"]], rate=self._p["fdm_rate"])
        self._sensors = Sensors(self._p["noise"], self._p["seed"])
        self._answers: dict[str, Any] = {"command": None, "dither": None}
        self._stamp = 0
        self._fault_due = self._p["fault.time"] >= 0.0
        self._truth_due = True
        self.samples = 0

    def start(self) -> None:
        """Publish the first sample; the answers drive the rest."""
        self._running = True
        self._publish()

    def _start_when_ready(self) -> None:
        """Start as soon as those who must answer are connected."""
        dither = self.count_publishers(self.resolve_topic_name("dither")) > 0 or not self._p["wait_for_dither"]
        heard = self.state_publisher.get_subscription_count() > 0
        if heard and dither and self.count_publishers(self.resolve_topic_name("command")) > 0:
            self.destroy_timer(self._starter)
            self.start()

    def _publish(self) -> None:
        """Publish the present sample; truth where it is due."""
        sample = self._aircraft.sample()
        measured = self._sensors.measure(sample)
        self._stamp = stamp = round(sample.time * 1e9)
        self._published_at = self._steady.now().nanoseconds
        self._answers = {"command": None, "dither": None} if self._p["mode"] == "lockstep" else self._answers
        self._clock_publisher.publish(ClockMessage(clock=messages.time_message(stamp)))
        self.truth_state_publisher.publish(messages.state_message(stamp, STATES, sample.x, sample.xdot))
        if self._truth_due or self.samples % self._p["truth_every"] == 0:
            truth = self._aircraft.truth()
            message = messages.truth_message(stamp, STATES, EFFECTORS, truth.a, truth.b, truth.bias)
            self.truth_model_publisher.publish(message)
            self._truth_due = False
        self.samples += 1
        self.state_publisher.publish(messages.state_message(stamp, STATES, measured.x, measured.xdot))
        self.effector_publisher.publish(messages.effector_message(stamp, EFFECTORS, measured.delta))
        duration = self._p["duration"]
        if duration > 0.0 and sample.time >= duration - 1e-9:
            self._running = False
            if not self.finished.done():
                self.finished.set_result(True)

    def _on_answer(self, kind: str, message: EffectorCommand | DitherCommand) -> None:
        """Take a command or a dither; in lockstep only the one that answers the present sample."""
        try:
            (delta,) = self._vectors[kind].arrange(message.effectors, delta=message.delta)
            stamp = messages.stamp_of(message)
            if self._p["mode"] == "lockstep" and stamp != self._stamp:
                text = f"{kind}: answers the sample at {stamp * 1e-9:.3f} s; expected {self._stamp * 1e-9:.3f} s"
                raise Refused("late", text)
        except Refused as refused:
            self.refused[refused.reason] += 1
            self.get_logger().warning(f"refused ({refused.reason}): {refused}", throttle_duration_sec=1.0)
            return
        self._answers[kind] = delta
        if self._p["mode"] == "lockstep" and self._complete():
            self._step()

    def _complete(self) -> bool:
        dither = self._answers["dither"] is not None or not self._p["wait_for_dither"]
        return self._running and dither and self._answers["command"] is not None

    def _step(self) -> None:
        """Fly to the next sample with what was answered; without a command at trim, without a dither with none."""
        if self._fault_due and self._aircraft.time >= self._p["fault.time"] - 1e-9:
            self._damage(self._p["fault.surface"], self._p["fault.effectiveness"], self._p["fault.bias"])
            self._fault_due = False
        command = self._answers["command"]
        dither = self._answers["dither"]
        total = self._aircraft.trim.delta if command is None else command + (0.0 if dither is None else dither)
        for _ in range(self._p["steps_per_sample"]):
            self._aircraft.step(total)
        self._publish()

    def _watch(self) -> None:
        """Lockstep: go on at trim when the answers stay out, and say so."""
        waited = (self._steady.now().nanoseconds - self._published_at) * 1e-9 if self._running else 0.0
        if waited < self._p["time_out"]:
            return
        self.time_outs += 1
        missing = [k for k, v in self._answers.items() if v is None and (k != "dither" or self._p["wait_for_dither"])]
        text = f"no {' and no '.join(missing)} for the sample at {self._stamp * 1e-9:.3f} s within {waited:.2f} s"
        self.get_logger().warning(f"{text}: flying on at trim with zero dither")
        self._answers = {"command": None, "dither": None}
        self._step()

    def _tick(self) -> None:
        """Real time: fly on with the newest answers."""
        if self._running:
            self._step()

    def _damage(self, surface: str, effectiveness: float, bias: float) -> str:
        text = self._aircraft.damage(surface, effectiveness, bias)
        self._truth_due = True
        self.get_logger().info(f"at {self._aircraft.time:.3f} s: {text}")
        return text

    def _on_inject_fault(self, request: InjectFault.Request, response: InjectFault.Response) -> InjectFault.Response:
        try:
            response.message = self._damage(request.effector, request.effectiveness, request.bias)
            response.success = True
        except PlantError as error:
            response.success, response.message = False, str(error)
        return response

    def _on_reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._build()
        if self._running:
            self._publish()
        response.success, response.message = True, "a new aircraft at trim, time 0"
        return response


def _check(p: dict[str, Any]) -> None:
    """Refuse parameters that make no flight, with a sentence."""
    rules = [
        ("condition", p["condition"] in CONDITIONS, f"one of {', '.join(CONDITIONS)}"),
        ("noise", p["noise"] in NOISE_LEVELS, f"one of {', '.join(NOISE_LEVELS)}"),
        ("seed", p["seed"] >= 0, "0 or more"),
        ("mode", p["mode"] in ("lockstep", "real_time"), "lockstep or real_time"),
        ("fdm_rate", 20 <= p["fdm_rate"] <= 2000, "20 to 2000 Hz"),
        ("steps_per_sample", p["steps_per_sample"] >= 1, "1 or more"),
        ("truth_every", p["truth_every"] >= 1, "1 or more"),
        ("time_out", np.isfinite(p["time_out"]) and p["time_out"] > 0.0, "above 0 s"),
        ("fault.effectiveness", 0.0 <= p["fault.effectiveness"] <= 1.0, "0 to 1"),
    ]
    for name, good, expected in rules:
        if not good:
            message = f"parameter '{name}' is {p[name]!r}; it must be {expected}"
            raise PlantError(message)
