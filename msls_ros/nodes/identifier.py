"""The identifier node: states and deflections in; model, fault events and dither out. Managed (lifecycle)."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from lifecycle_msgs.srv import ChangeState
from msls_msgs.msg import DitherCommand, EffectorSample, FaultEvent, LinearModel, StateSample
from rcl_interfaces.msg import SetParametersResult
from rclpy._rclpy_pybind11 import RCLError
from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.subscription import Subscription
from std_srvs.srv import SetBool, Trigger

from msls_ros import messages
from msls_ros.estimation import Configuration, Dither, Estimate, EstimationError, Identifier, Level
from msls_ros.inputs import InputAdapter, PairedSample, Refused, Synchronizer
from msls_ros.nodes.inputs import declare_inputs, subscribe
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
from msls_ros.nodes.quality import INPUT, OUTPUT
from msls_ros.nodes.refusals import Diagnostics, Health, Refusals

SUCCESS, FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE
NODE_PARAMETERS = {
    "autostart": fixed(True, "configure and activate at the start"),
    "publish_every": fixed(1, "samples per published model", unit="samples", low=1, high=1_000_000),
}
PARAMETERS = {**NODE_PARAMETERS, **configuration_table()}
WATCH_PERIOD = 0.02
"""How often the age of the newest sample is looked at [s]."""


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
        declare_configuration(self)
        p = declare_table(self, NODE_PARAMETERS)
        self._inputs = declare_inputs(self)
        warn_of_unknown(self)
        self._guard_transitions()
        self._every = p["publish_every"]
        self._identifier: Identifier | None = None
        self._active = False
        self._stale = True
        self.events = 0
        """Fault events published."""
        self.estimate: Estimate | None = None
        """The last estimate."""
        self.add_on_set_parameters_callback(self._check_parameters)
        self.add_post_set_parameters_callback(self._take_parameters)
        if p["autostart"]:
            self._start()

    def _guard_transitions(self) -> None:
        """Answer a transition that the present state does not have with no; rclpy would end the process over it."""

        def guarded(answer: Callable[[Any, Any], Any], request: Any, response: Any) -> Any:
            try:
                return answer(request, response)
            except RCLError as error:
                self.get_logger().warning(f"refused (transition): {str(error).splitlines()[0]}")
                response.success = False
                return response

        for service in self.services:
            if service.srv_type is ChangeState:
                service.callback = partial(guarded, service.callback)

    def _start(self) -> None:
        for transition in (self.trigger_configure, self.trigger_activate):
            if transition() != SUCCESS:
                message = "the identifier could not be configured and activated at the start; its log says why"
                raise NodeError(message)

    @property
    def synchronizer(self) -> Synchronizer:
        """The gate, with its counts; once configured."""
        return self._synchronizer

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Build the identifier from the parameters, and the topics."""
        try:
            configuration = read_configuration(self)
            self._build(configuration)
            self._subscriptions_made = self._subscribe()
        except (EstimationError, NodeError) as error:
            self.get_logger().error(str(error))
            return FAILURE
        self._model_publisher = self.create_lifecycle_publisher(LinearModel, "model", OUTPUT)
        self._fault_publisher = self.create_lifecycle_publisher(FaultEvent, "fault", OUTPUT)
        self._dither_publisher = self.create_lifecycle_publisher(DitherCommand, "dither", OUTPUT)
        self._services_offered = [
            self.create_service(Trigger, "~/reset", self._on_reset),
            self.create_service(SetBool, "~/enable_dither", self._on_enable_dither),
        ]
        self._watch = self.create_timer(WATCH_PERIOD, self._watch_inputs, clock=self._age_clock)
        self._diagnostics = Diagnostics(self, self._health, self._synchronizer.refused)
        return SUCCESS

    def _subscribe(self) -> list[Subscription]:
        if self._adapter is not None:
            return subscribe(self, self._adapter.topics, self._on_foreign)
        return [
            self.create_subscription(StateSample, "state", self._on_state, INPUT),
            self.create_subscription(EffectorSample, "effectors", self._on_effectors, INPUT),
        ]

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Start to use what comes in."""
        self._active = True
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop the dither, then ignore what comes in."""
        self._inhibit("the identifier is deactivated")
        self._active = False
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Give the topics back and forget everything."""
        self.destroy_timer(self._watch)
        self._diagnostics.destroy()
        for service in self._services_offered:
            self.destroy_service(service)
        for subscription in self._subscriptions_made:
            self.destroy_subscription(subscription)
        for publisher in (self._model_publisher, self._fault_publisher, self._dither_publisher):
            self.destroy_lifecycle_publisher(publisher)
        self._identifier = None
        self._stale = True
        return SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop the dither; the process ends."""
        if self._active:
            self._inhibit("the identifier shuts down")
        self._active = False
        return SUCCESS

    def _build(self, configuration: Configuration) -> None:
        """Make identifier and gate, and compile the kernels before the first sample comes."""
        self._identifier = Identifier(configuration)
        n, m = len(configuration.states), len(configuration.effectors)
        self._identifier.update(0.0, np.zeros(n), np.zeros(n), np.zeros(m))
        self._identifier.reset()
        self._synchronizer = Synchronizer.of(configuration)
        self._refusals = Refusals(self, self._synchronizer.refused)
        self._adapter = self._make_adapter(configuration)
        simulated = self.get_parameter("use_sim_time").value
        self._age_clock: Clock = self.get_clock() if simulated else Clock(clock_type=ClockType.STEADY_TIME)

    def _make_adapter(self, configuration: Configuration) -> InputAdapter | None:
        if self._inputs is None:
            return None
        return InputAdapter(
            self._inputs,
            configuration.states,
            configuration.effectors,
            time_jump=configuration.time_jump,
            refused=self._synchronizer.refused,
            report=self._refusals.take,
        )

    def _on_state(self, message: StateSample) -> None:
        stamp = messages.stamp_of(message)
        self._offer(lambda: self._synchronizer.add_state(stamp, message.states, message.x, message.xdot))

    def _on_effectors(self, message: EffectorSample) -> None:
        stamp = messages.stamp_of(message)
        self._offer(lambda: self._synchronizer.add_effectors(stamp, message.effectors, message.delta))

    def _on_foreign(self, topic: str, message: Any) -> None:
        """Take a message of another type: the rows that it completes go the way of our own messages."""
        if not self._active or self._adapter is None:
            return
        try:
            rows = self._adapter.push(topic, self.get_clock().now().nanoseconds, message)
        except EstimationError as error:
            self._refusals.take(self._synchronizer.refuse("field", str(error)))
            return
        for row in rows:
            self._offer(partial(row.offer, self._synchronizer))

    def _offer(self, add: Callable[[], PairedSample | None]) -> None:
        """Put a message through the gate; use the sample that it completes."""
        if not self._active:
            return
        try:
            sample = add()
        except Refused as refused:
            self._refusals.take(refused)
            return
        if sample is not None:
            self._use(sample)

    def _use(self, sample: PairedSample) -> None:
        """Update with a sample and publish what comes of it."""
        assert self._identifier is not None
        if sample.restarted:
            self.get_logger().warning(f"time jumped back to {sample.time:.3f} s: starting anew")
            self._identifier.reset()
        names = self._identifier.configuration.effectors
        self.estimate = estimate = self._identifier.update(sample.time, sample.x, sample.xdot, sample.delta)
        self._stale = False
        self._last_stamp, self._arrived = sample.stamp, self._age_clock.now().nanoseconds
        self._dither_publisher.publish(messages.dither_message(sample.stamp, names, estimate.dither))
        for event in estimate.events:
            self.get_logger().warning(event.description)
            self._fault_publisher.publish(messages.fault_message(sample.stamp, event))
            self.events += 1
        if estimate.samples % self._every == 0:
            self._model_publisher.publish(messages.model_message(sample.stamp, estimate))

    def _watch_inputs(self) -> None:
        """Set the dither to zero when the samples have stopped."""
        if self._stale or self._identifier is None:
            return
        age = (self._age_clock.now().nanoseconds - self._arrived) * 1e-9
        limit = self._identifier.configuration.dither.stale_after
        if age > limit:
            reason = f"no sample for {age:.2f} s, more than {limit:g} s"
            self.get_logger().warning(f"{reason}: the dither is zero")
            self._inhibit(reason)

    def _inhibit(self, reason: str) -> None:
        """Publish a zero dither, once until samples come again."""
        if self._stale or self._identifier is None:
            return
        self._stale = True
        names = self._identifier.configuration.effectors
        dither = Dither(np.zeros(len(names)), 0.0, 0.0, 0.0, Level.INHIBITED, reason)
        self._dither_publisher.publish(messages.dither_message(self._last_stamp, names, dither))

    def _on_reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        assert self._identifier is not None
        self._identifier.reset()
        self._synchronizer.clear()
        if self._adapter is not None:
            self._adapter.clear()
        response.success, response.message = True, "the estimate starts anew"
        return response

    def _on_enable_dither(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        result = self.set_parameters([Parameter("dither.enabled", Parameter.Type.BOOL, request.data)])[0]
        response.success = result.successful
        response.message = result.reason or f"dither is {'enabled' if request.data else 'disabled'}"
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
        if self._identifier is not None:
            self._identifier.configure({p.name: plain(p) for p in parameters if p.name in self._identifier.parameters})

    def _health(self) -> Health:
        """Say how many samples were used, and whether they still come."""
        assert self._identifier is not None
        gate = self._synchronizer
        air = round(100.0 * self._identifier.air)
        counts = {
            "samples": gate.paired,
            "alarms": self._identifier.alarms,
            "restarts": gate.restarts,
            "motion made by gusts [%]": air,
        }
        if not self._active:
            return Health(DiagnosticStatus.OK, "inactive", counts)
        if self._stale:
            return Health(DiagnosticStatus.STALE, "no samples: the dither is zero", counts)
        gusts = f", error bars widened: gusts make {air} % of the motion" if self._identifier.moving_air else ""
        return Health(DiagnosticStatus.OK, f"identifying{gusts}", counts)
