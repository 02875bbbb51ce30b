"""The identifier node: states and deflections in; model, fault events and dither out. Managed (lifecycle)."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.subscription import Subscription
from std_srvs.srv import SetBool, Trigger

from msls_ros.estimation import Configuration, Estimate, EstimationError, FaultEvent, Identifier
from msls_ros.estimation.compiled import HAVE_NUMBA
from msls_ros.estimation.warm_up import is_kept, warm_up
from msls_ros.inputs import InputAdapter, PairedSample, Refused, Synchronizer
from msls_ros.inputs.answers import Answers, Pause
from msls_ros.inputs.model_file import start_from, write_model
from msls_ros.nodes.awaiting import awaited
from msls_ros.nodes.bonding import Bond
from msls_ros.nodes.inputs import EFFECTORS, PREFIX, STATE, OwnInputs, declare_inputs, subscribe, subscribe_own
from msls_ros.nodes.monitoring import Course, Monitor, Pace, judged, told
from msls_ros.nodes.outputs import Outputs, asked_to_reset
from msls_ros.nodes.parameters import (
    NodeError,
    configuration_table,
    declare_configuration,
    declare_table,
    fixed,
    plain,
    read_configuration,
    warn_of_unknown,
)
from msls_ros.nodes.quality import best_effort, depth_of, reliable
from msls_ros.nodes.refusals import Diagnostics, Health, Refusals
from msls_ros.nodes.transitions import explained, guard_transitions
from msls_ros.records import FRAME

SUCCESS = TransitionCallbackReturn.SUCCESS
NODE_PARAMETERS = {
    "autostart": fixed(True, "configure and activate at the start"),
    "publish_every": fixed(1, "samples per published model", unit="samples", low=1, high=1_000_000),
    "frame_id": fixed(FRAME, "frame of all that is published"),
    "queue": fixed(0.1, "what the queues hold; then the newest are kept", unit="s of samples", low=0.001, high=60.0),
    "lockstep": fixed(False, "the plant waits for every answer: samples are never old, however long that takes"),
    "model_file": fixed("model.yaml", "where ~/save_model writes what has been learnt"),
    "warm_start": fixed("", "such a file to start from; empty: from nothing"),
}
PARAMETERS = {**NODE_PARAMETERS, **configuration_table()}
WAITING = 5.0
"""How often it is said what is waited for [s]."""
FOREIGN_RATE = 4.0
"""Messages of other stacks come this much faster than the samples that are made of them."""
KEPT = 2.0
"""What is kept for those who listen, a recorder that writes to disk among them [s]."""
GOODBYE = 0.2
"""How long the last dither may take to reach those who listen [s]; DDS may ask them only every 3 s whether it has."""


class IdentifierNode(LifecycleNode):
    """Identify the aircraft's linear model from `state` and `effectors`; publish `model`, `fault`, `dither`.

    With parameters `inputs.*` it takes topics of any type instead: config/inputs/odometry_jointstate.yaml tells how.

    Parameters
    ----------
    **options
        As for `rclpy.node.Node` (``parameter_overrides``, ``namespace``, ...).

    Raises
    ------
    EstimationError, NodeError
        For a parameter that is refused.
    """

    def __init__(self, name: str = "identifier", **options: Any) -> None:
        """Declare the parameters; with ``autostart`` configure and activate."""
        super().__init__(name, **options)
        warn_of_unknown(self, PARAMETERS, groups=(PREFIX,))
        declare_configuration(self)
        self._p = declare_table(self, NODE_PARAMETERS)
        self._inputs = declare_inputs(self)
        guard_transitions(self)
        self._bond = Bond(self, wanted=not self._p["autostart"])
        self._steady: Callable[[], int] = time.monotonic_ns
        self._identifier: Identifier | None = None
        self._sample: PairedSample | None = None
        self._active = False
        self._model_due = False
        self.events = 0
        """Fault events published."""
        self.add_on_set_parameters_callback(self._check_parameters)
        self.add_post_set_parameters_callback(self._take_parameters)
        self._simulated = bool(self.get_parameter("use_sim_time").value)
        self.get_logger().info("started" if HAVE_NUMBA else "started; numba is not there: kernels are interpreted")
        if self._p["autostart"]:
            self._start()
        else:
            self.get_logger().info("waiting to be configured")

    def _start(self) -> None:
        for transition in (self.trigger_configure, self.trigger_activate):
            if transition() != SUCCESS:
                message = "the identifier could not be configured and activated at the start; its log says why"
                raise NodeError(message)

    @property
    def synchronizer(self) -> Synchronizer:
        """The gate, with its counts; once configured."""
        return self._synchronizer

    @property
    def taken(self) -> int:
        """Messages of its topics that it has taken, whatever came of them; once configured."""
        return sum(one.count for one in self._monitor.traffic.values())

    @property
    def estimate(self) -> Estimate | None:
        """The estimate after the last sample; None: there was none."""
        if self._identifier is None or self._sample is None:
            return None
        return self._identifier.estimate(self._sample.time, self._sample.x)

    @explained
    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Build the identifier from the parameters, and the topics."""
        try:
            self._configure()
        except Exception:
            self._identifier = None  # so that parameters may change before it is tried again
            raise
        return SUCCESS

    def _configure(self) -> None:
        c = read_configuration(self)
        built = self._build(c)
        self._subscriptions_made = self._subscribe(c)
        first = built.estimate(0.0, np.zeros(len(c.states)))
        self._outputs = Outputs(self, c, self._p["frame_id"], depth_of(KEPT, c.sample_rate), first)
        self._answers = Answers(
            built,
            self._synchronizer,
            self._monitor.silent,
            self._outputs.dither,
            partial(self.get_logger().warning, throttle_duration_sec=1.0),
            lockstep=self._p["lockstep"],
        )
        self._services_offered = [
            self.create_service(Trigger, "~/reset", self._on_reset),
            self.create_service(SetBool, "~/enable_dither", self._on_enable_dither),
            self.create_service(SetBool, "~/freeze", self._on_freeze),
            self.create_service(Trigger, "~/save_model", self._on_save_model),
        ]
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._watch = self.create_timer(self._stale_after(), self._watch_inputs, clock=steady)
        self._reminder = self.create_timer(WAITING, self._say_what_is_missing, clock=steady)
        self._diagnostics = Diagnostics(self, self._health, self._synchronizer.refused)
        what = f"{len(c.states)} states, {len(c.effectors)} effectors, {c.sample_rate:g} Hz; inputs "
        self.get_logger().info(f"configured: {what}{', '.join(self._topics)}")

    def _subscribe(self, configuration: Configuration) -> list[Subscription]:
        depth = depth_of(self._p["queue"], configuration.sample_rate)
        if self._adapter is not None:
            foreign = best_effort(depth_of(FOREIGN_RATE * self._p["queue"], configuration.sample_rate))
            return subscribe(self, self._adapter.topics, foreign, self._on_foreign, self._refuse)
        return subscribe_own(self, reliable(depth), self._on_own)

    @explained
    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Start to use what comes in."""
        answer = super().on_activate(state)
        self._bond.form()
        self._reminder.reset()
        self._active = True
        self.get_logger().info(f"active: waiting for the first sample on {' and '.join(self._topics)}")
        return answer

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop the dither, then ignore what comes in."""
        if not self._answers.stale:
            self._stop("the identifier is deactivated")
        self._active = False
        self._bond.end()
        self.get_logger().info("inactive: samples are ignored")
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Give the topics back and forget everything."""
        self.destroy_timer(self._watch)
        self.destroy_timer(self._reminder)
        self._diagnostics.destroy()
        for service in self._services_offered:
            self.destroy_service(service)
        for subscription in self._subscriptions_made:
            self.destroy_subscription(subscription)
        self._outputs.destroy()
        self._identifier = self._sample = None
        self.get_logger().info("unconfigured: everything is forgotten")
        return SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop the dither; the process ends."""
        self.say_goodbye()
        return SUCCESS

    def say_goodbye(self) -> None:
        """Stop the dither, and wait until those who listen know."""
        if self._active:
            self._stop("the identifier shuts down")
            self._outputs.wait_sent(GOODBYE)
        self._active = False
        self._bond.end()
        self.get_logger().info("shutting down")

    def _build(self, configuration: Configuration) -> Identifier:
        """Make identifier and gate, return the first, and compile every kernel before the first sample comes."""
        kept = is_kept(configuration.estimator.method)
        if not kept:
            self.get_logger().info("compiling the estimator, once on this machine: one to three minutes")
        took = warm_up(
            configuration.estimator.method, lambda seconds: self.get_logger().info(f"compiling: {seconds:.0f} s")
        )
        if not kept:
            self.get_logger().info(f"compiled in {took:.0f} s, kept for the next time")
        self._synchronizer = Synchronizer.of(configuration, lambda refused: self._refusals.take(refused))
        self._refusals = Refusals(self, self._synchronizer.refused)
        self._adapter = None
        if self._inputs is not None:
            self._adapter = InputAdapter.of(
                self._inputs, configuration, self._synchronizer.refused, self._refusals.take
            )
        straddle, servos = (0, False) if self._adapter is None else (self._adapter.straddle, self._adapter.servos)
        self._identifier = Identifier(configuration, straddle, servos=servos, gated=True)
        if self._p["warm_start"]:
            start_from(self._identifier, Path(self._p["warm_start"]))
            self.get_logger().info(f"starting from the model in '{self._p['warm_start']}'")
        self._own = OwnInputs(self._synchronizer)
        self._topics = [STATE, EFFECTORS] if self._adapter is None else list(self._adapter.topics)
        self._monitor = Monitor(dict.fromkeys(self._topics, ""), self._steady)
        self._pace = Pace(configuration.sample_rate, self._p["queue"], self.get_logger())
        return self._identifier

    def _stale_after(self) -> float:
        assert self._identifier is not None
        return max(self._identifier.configuration.dither.stale_after, 1e-3)

    def _now(self) -> int:
        """Return the ROS clock [ns]."""
        return self.get_clock().now().nanoseconds if self._simulated else time.time_ns()

    def _on_own(self, topic: str, data: bytes) -> None:
        """Take a serialised message of our own."""
        if self._active:
            self._monitor.traffic[topic].tick(self._steady())
            self._offer(partial(self._own.offer, topic, data))

    def _on_foreign(self, topic: str, message: Any) -> None:
        """Take a message of another type: the rows that it completes go the way of our own messages."""
        if not self._active or self._adapter is None:
            return
        self._monitor.traffic[topic].tick(self._steady())
        try:
            rows = self._adapter.push(topic, self._now(), message)
        except EstimationError as error:
            self._refuse(Refused("field", str(error)))
            return
        if self._answers.hold(self._adapter.newly_held(), self._steady()):
            self._watch.reset()
        self._pace.follow(self._adapter)
        for number, row in enumerate(rows, 1):
            self._offer(partial(row.offer, self._synchronizer), number == len(rows))

    def _refuse(self, refused: Refused) -> None:
        self._refusals.take(self._synchronizer.refuse(refused.reason, str(refused)))

    def _offer(self, add: Callable[[], PairedSample | None], newest: bool = True) -> None:
        """Put a message through the gate; use the sample that it completes, the newest of those that there are."""
        start = time.monotonic_ns()
        try:
            sample = add()
        except Refused as refused:
            self._refusals.take(refused)
            return
        if sample is not None:
            self._use(sample, newest)
            self._monitor.took(time.monotonic_ns() - start)

    def _use(self, sample: PairedSample, newest: bool = True) -> None:
        """Update with a sample and publish what comes of it."""
        assert self._identifier is not None
        if sample.restarted:
            text = f"time jumped back to {sample.time:.3f} s: starting anew"
            self.get_logger().warning(text, throttle_duration_sec=1.0)
            self._identifier.reset()
            self._pace.clear()
        elif self._sample is None:
            self.get_logger().info(f"first sample, stamped {sample.time:.3f} s")
        before = Course.of(self._identifier)
        dither = self._identifier.learn(sample.time, sample.x, sample.xdot, sample.delta)
        before.tell_changes(self._identifier, sample.time, self.get_logger())
        self._sample = sample
        if self._answers.take(sample, dither, self._steady(), self._now(), newest):
            self._watch.reset()
        for event in self._identifier.take_events():
            self._publish_event(sample, event)
        self._model_due = self._model_due or self._identifier.samples % self._p["publish_every"] == 0
        if self._model_due and self._outputs.model_wanted:
            self._publish_model()
        self._pace.take(sample.stamp, self._steady())

    def _publish_event(self, sample: PairedSample, event: FaultEvent) -> None:
        self.get_logger().warning(event.description)
        self._outputs.fault(sample.stamp, event)
        self._monitor.last_event = event.description
        self.events += 1

    def _publish_model(self) -> None:
        assert self._identifier is not None and self._sample is not None
        self._model_due = False
        self._outputs.model(self._sample.stamp, self._identifier.estimate(self._sample.time, self._sample.x))

    def _watch_inputs(self) -> None:
        """Set the dither to zero when the samples have stopped, or rows are held while others still come."""
        reason = self._answers.overdue(self._steady()) if self._identifier is not None else ""
        if reason:
            self._stop(reason)

    def _say_what_is_missing(self) -> None:
        """Say what is waited for while no sample has come."""
        if self._active and self._sample is None:
            self.get_logger().warning(self._waiting())

    def _waiting(self) -> str:
        """Say what each input has delivered, or why it has not."""
        inputs = zip(self._monitor.traffic.items(), self._subscriptions_made, strict=True)
        found = [awaited(self, topic, heard, t.count) + self._apart(topic) for (topic, t), heard in inputs]
        return f"waiting for a sample: {'; '.join(found)}"

    def _apart(self, topic: str) -> str:
        text = "" if self._adapter is None else self._adapter.apart(topic)
        return f", {text}" if text else ""

    def _stop(self, reason: str) -> None:
        """Publish a zero dither."""
        if self._identifier is None:
            return
        self._watch.cancel()
        self._answers.stop(self._now() if self._sample is None else self._sample.stamp, reason)
        if self._model_due and self._identifier.samples:  # nobody has listened; who joins from now on gets this one
            self._publish_model()

    def _on_reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        assert self._identifier is not None
        if self._sample is not None and self._identifier.samples:
            self._publish_event(self._sample, asked_to_reset(self._identifier.configuration, self._sample.time))
        self._identifier.reset()
        self._synchronizer.clear()
        self._pace.clear()
        self._answers.clear()
        if self._adapter is not None:
            self._adapter.clear()
        response.success, response.message = True, "the estimate starts anew"
        return response

    def _on_enable_dither(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        result = self.set_parameters([Parameter("dither.enabled", Parameter.Type.BOOL, request.data)])[0]
        response.success = result.successful
        response.message = result.reason or f"dither is {'enabled' if request.data else 'disabled'}"
        return response

    def _on_freeze(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        assert self._identifier is not None
        self._identifier.enabled = not request.data
        response.success = True
        response.message = "the model is frozen, the dither zero" if request.data else "samples are learnt from"
        self.get_logger().info(response.message)
        return response

    def _on_save_model(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        assert self._identifier is not None
        path = Path(self._p["model_file"]).absolute()
        try:
            if self.estimate is None or self._sample is None:
                message = "nothing to save: no sample has come"
                raise EstimationError(message)
            if self._identifier.samples == 0:
                message = "nothing to save: no sample has come since the reset"
                raise EstimationError(message)
            write_model(path, self._identifier, self.estimate, self._sample.x, self._sample.delta, self._sample.stamp)
            response.success, response.message = True, f"saved to {path}"
        except EstimationError as error:
            response.success, response.message = False, str(error)
        self.get_logger().info(response.message)
        return response

    def _check_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        """Refuse, with a reason, what is wrong or cannot change while the identifier runs."""
        try:
            configuration = read_configuration(self, parameters)
            if self._identifier is not None:
                self._identifier.check_change(configuration)
        except EstimationError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _take_parameters(self, parameters: list[Parameter]) -> None:
        self._simulated = bool(self.get_parameter("use_sim_time").value)
        if self._identifier is not None:
            self._identifier.configure({p.name: plain(p) for p in parameters if p.name in self._identifier.parameters})
            if hasattr(self, "_watch"):
                self._watch.timer_period_ns = round(self._stale_after() * 1e9)

    def _health(self) -> Health:
        assert self._identifier is not None
        pause: Pause | None = self._answers.pause(self._steady()) if self._answers.stale else None
        level, message = judged(self._identifier, self._pace, self._active, pause)
        if self._active and self._sample is None:
            message = self._waiting()
        if self._active and self._answers.echo.judge():
            self.get_logger().warning(self._answers.echo.sentence)
        values = {
            **told(self._identifier, self._synchronizer, pause, self._answers.echo),
            **self._pace.report(),
            **self._monitor.report(),
            **self._answers.report(),
        }
        found = [self._answers.echo.sentence] if self._active and self._answers.echo.missing else []
        if self._adapter is not None:
            slow = self._adapter.too_slow
            values |= {f"{topic}: too slow [samples]": n for topic, n in self._adapter.slow.samples.items()}
            found += slow.values()
        level = DiagnosticStatus.WARN if found and level == DiagnosticStatus.OK else level
        return Health(level, "; ".join([message, *found]), values)
