"""The controller node: samples, the pilot's command and the model in; the command and its status out. Managed."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from msls_msgs.msg import (
    ControlStatus,
    DitherCommand,
    EffectorCommand,
    EffectorSample,
    FaultEvent,
    LinearModel,
    PilotCommand,
    StateSample,
)
from numpy.typing import NDArray
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter

from msls_ros import messages
from msls_ros.control import ControlError, Controller, ModelEstimate, Status
from msls_ros.control.warm_up import warm_up
from msls_ros.inputs import Refused
from msls_ros.nodes.bonding import Bond
from msls_ros.nodes.control_inputs import KEPT, NO_COMMAND, PARTS, Collected, ControlInputs
from msls_ros.nodes.control_parameters import IN_FLIGHT, PARAMETERS, aircraft_of, settings_of
from msls_ros.nodes.parameters import NodeError, checked, declare_table, plain, warn_of_unknown
from msls_ros.nodes.quality import depth_of, listen, publish, reliable
from msls_ros.nodes.refusals import Diagnostics, Health, Refusals
from msls_ros.nodes.transitions import explained, guard_transitions

SUCCESS = TransitionCallbackReturn.SUCCESS
QUEUE = 2.0
"""What the queues hold [s]."""
INPUTS: dict[str, Any] = {
    "fault": FaultEvent,
    "dither": DitherCommand,
    "model": LinearModel,
    "pilot_command": PilotCommand,
    "effectors": EffectorSample,
    "state": StateSample,
}


class ControllerNode(LifecycleNode):
    """Fly an aircraft by a law that is designed anew from `model`: publish `command` and `control_status`.

    Parameters
    ----------
    **options
        As for `rclpy.node.Node`.

    Raises
    ------
    NodeError
        For a parameter that is refused.
    """

    def __init__(self, name: str = "controller", **options: Any) -> None:
        """Declare the parameters; with ``autostart`` configure and activate."""
        super().__init__(name, **options)
        warn_of_unknown(self, PARAMETERS)
        self._p = declare_table(self, PARAMETERS)
        self._settings = settings_of(self._p)
        guard_transitions(self)
        self._bond = Bond(self, wanted=not self._p["autostart"])
        self.add_on_set_parameters_callback(self._check_parameters)
        self.add_post_set_parameters_callback(self._take_parameters)
        self._steady: Callable[[], int] = time.monotonic_ns
        self._controller: Controller | None = None
        self._active = False
        self.answered = 0
        """Samples answered."""
        self.durations: list[int] = []
        """What each answer took [ns], the last thousand."""
        if self._p["autostart"] and not (self.trigger_configure() == SUCCESS and self.trigger_activate() == SUCCESS):
            message = "the controller could not be configured and activated at the start; its log says why"
            raise NodeError(message)

    @explained
    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Build the law, and the topics."""
        self._aircraft = aircraft_of(self._p)
        warm_up(len(self._aircraft.surfaces))
        self._controller = Controller(self._aircraft, self._settings)
        wait_for = PARTS if self._p["lockstep"] else PARTS[:2]
        self._inputs = ControlInputs(self._aircraft.effectors, wait_for)
        self._alarm, self._model, self._command = False, None, NO_COMMAND
        self._dithers: dict[int, NDArray[np.float64]] = {}
        self._answered_stamp = -1
        self._command_at = self._arrived = 0
        self._status: Status | None = None
        self._held = True
        self._refusals = Refusals(self)
        depth = reliable(depth_of(QUEUE, self._p["sample_rate"]))
        self.command_publisher = publish(self, EffectorCommand, "command", depth)
        self.status_publisher = publish(self, ControlStatus, "control_status", depth)
        self._subscriptions_made = {
            topic: listen(self, kind, topic, depth, partial(self._on_message, topic), self._refusals.take)
            for topic, kind in INPUTS.items()
        }
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._watch = self.create_timer(0.5 * self._settings.sample_timeout, self._watch_samples, clock=steady)
        self._diagnostics = Diagnostics(self, self._health, self._refusals.counts)
        self.get_logger().info(f"configured: law {self._settings.law}, surfaces {' '.join(self._aircraft.surfaces)}")
        return SUCCESS

    @explained
    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Start to answer samples."""
        answer = super().on_activate(state)
        self._bond.form()
        self._active = True
        return answer

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop to answer: the stack, or the plant's own trim, takes over."""
        self._active = False
        self._bond.end()
        return super().on_deactivate(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop to answer; the process ends."""
        self._active = False
        self._bond.end()
        return SUCCESS

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Give the topics back and forget everything."""
        self.destroy_timer(self._watch)
        self._diagnostics.destroy()
        for subscription in self._subscriptions_made.values():
            self.destroy_subscription(subscription)
        for publisher in (self.command_publisher, self.status_publisher):
            self.destroy_publisher(publisher)
        self._controller = None
        return SUCCESS

    @property
    def refused(self) -> Any:
        """Messages refused, by reason."""
        return self._refusals.counts

    def _on_message(self, topic: str, message: Any) -> None:
        """Take a message; answer the sample that it completes."""
        if not self._active:
            return
        if topic == "fault":
            self._alarm = self._alarm or message.kind == FaultEvent.DETECTED
            return
        try:
            found = self._inputs.add(topic, message)
            if topic == "pilot_command":
                self._command, self._command_at = self._inputs._read_pilot_command(message), self._steady()
            elif topic == "model":
                self._model = message
            elif topic == "dither":
                self._dithers[messages.stamp_of(message)] = self._inputs._read_dither(message)
                if len(self._dithers) > KEPT:  # the first that came: time may have jumped back since
                    del self._dithers[next(iter(self._dithers))]
        except Refused as refused:
            self._refusals.take(refused)
            return
        if found is not None:
            self._answer(found)

    def _answer(self, found: Collected) -> None:
        """Publish what the law says to a sample."""
        assert self._controller is not None
        start = time.monotonic_ns()
        seconds = found.stamp * 1e-9
        command, dither = found.command, found.dither
        if command is None:
            fresh = self._steady() - self._command_at <= self._p["command_timeout"] * 1e9
            command = self._command if fresh else NO_COMMAND
        try:
            model = self._newest_model(seconds)
            if not self._p["lockstep"]:
                # This sample's dither may have come or not; that of the last one has.
                self._controller.added(self._dithers.get(self._answered_stamp))
                dither = None
            delta, status = self._controller.update(seconds, found.x, found.xdot, found.delta, command, model, dither)
        except (ControlError, Refused) as problem:
            self._refusals.take(problem if isinstance(problem, Refused) else Refused("field", str(problem)))
            return
        self._publish(found.stamp, delta, status)
        self._answered_stamp = found.stamp
        self._arrived, self._held = self._steady(), False
        self.answered += 1
        self.durations = [*self.durations[-999:], time.monotonic_ns() - start]

    def _newest_model(self, seconds: float) -> ModelEstimate | None:
        """Return the model, where one is wanted or an alarm came."""
        assert self._controller is not None
        self._poll_faults()
        if self._model is None or not (self._alarm or self._controller.wants_model(seconds)):
            return None
        message, self._model = self._model, None
        alarm, self._alarm = self._alarm, False
        return self._inputs.model_of(message, alarm)

    def _poll_faults(self) -> None:
        """Take the alarms that have come: they are sent before the model that goes with them."""
        subscription = self._subscriptions_made["fault"]
        while (taken := subscription.handle.take_message(subscription.msg_type, True)) is not None:
            subscription.callback(taken[0])

    def _publish(self, stamp: int, delta: Any, status: Status) -> None:
        if self._status is None or (status.law, status.reason) != (self._status.law, self._status.reason):
            self.get_logger().info(f"{status.law}: {status.reason}", throttle_duration_sec=0.5)
        self._status = status
        self.command_publisher.publish(messages.command_message(stamp, self._aircraft.effectors, delta))
        self.status_publisher.publish(messages.control_status_message(stamp, self._aircraft.surfaces, status))

    def _watch_samples(self) -> None:
        """Command the last trim when samples have stopped."""
        if not self._active or self._controller is None or self._p["lockstep"] or self._arrived == 0:
            return
        age = (self._steady() - self._arrived) * 1e-9
        if age > self._settings.sample_timeout and not self._held:
            self._held = True
            stamp = self.get_clock().now().nanoseconds
            delta, status = self._controller.hold(stamp * 1e-9, f"no sample for {age:.2f} s: the last trim")
            self.get_logger().warning(status.reason)
            self._publish(stamp, delta, status)

    def _check_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        """Refuse, with a reason, a value that is wrong; all that is fixed at the start is read-only."""
        try:
            for parameter in parameters:
                if parameter.name in IN_FLIGHT:
                    checked(parameter.name, plain(parameter), *PARAMETERS[parameter.name])
        except NodeError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _take_parameters(self, parameters: list[Parameter]) -> None:
        """Take another law, from the next sample on."""
        changes = {p.name: plain(p) for p in parameters if p.name in IN_FLIGHT}
        self._settings = self._settings.changed(changes)
        if self._controller is not None:
            self._controller.configure(self._settings)

    def _health(self) -> Health:
        p50 = np.median(self.durations) * 1e-3 if self.durations else float("nan")
        values = {"samples answered": self.answered, "sample p50 [us]": f"{p50:.0f}"}
        if self._status is None:
            return Health(DiagnosticStatus.STALE, "no sample yet", values)
        usual = self._status.law != "hold" and not self._held
        level = DiagnosticStatus.OK if usual else DiagnosticStatus.WARN
        return Health(level, f"{self._status.law}: {self._status.reason}", values)
