"""The mixer node: between a flight-control stack and its actuators, adds the dither to the command while that is safe.

Whatever goes wrong with the dither, the identifier or the command itself, the command is passed on, byte for byte as it
came.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from msls_msgs.msg import DitherCommand
from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from std_srvs.srv import SetBool

from msls_ros import messages
from msls_ros.estimation import Configuration, EstimationError
from msls_ros.estimation.mixer import Mixer, MixerLimits
from msls_ros.inputs import NamedVector, Refused
from msls_ros.inputs.field_paths import FieldPath
from msls_ros.inputs.freshness import Freshness
from msls_ros.nodes.message_types import message_class
from msls_ros.nodes.parameters import NodeError, declare_table, fixed, warn_of_unknown
from msls_ros.nodes.quality import best_effort, listen, overriding, publish, reliable
from msls_ros.nodes.refusals import Diagnostics, Health, Refusals

OWN = "msls_msgs/msg/EffectorCommand"
SAME_EPOCH = 10_000_000_000
"""Stamps of commands and dithers that are nearer than this are of one clock, and are compared [ns]."""
PARAMETERS = {
    "effectors": fixed(
        list(Configuration().effectors), "names of the dither, in the order of the fields, or of a row of mix"
    ),
    "command_type": fixed(OWN, "type of the stack's commands, and of what is published"),
    "fields": fixed(
        [],
        "field path of each effector in the command, as control[0] or position[name=elevator]; empty: "
        "delta[effectors=NAME], as in msls_msgs/EffectorCommand",
    ),
    "mix": fixed(
        (),
        "radians of each field per radian of each effector's dither, a row per field: 1, 1, 1, -1 for the elevons of "
        "de and da; empty: each field is an effector",
        low=-100.0,
        high=100.0,
    ),
    "scale": fixed((), "units of the command per radian, with the sign, per field; empty: 1", low=-1e6, high=1e6),
    "authority": fixed((), "largest dither, in units of the command, per field; empty: no limit", low=0.0, high=1e6),
    "position_low": fixed((), "lowest output per field; empty: no limit", low=-1e6, high=1e6),
    "position_high": fixed((), "highest output per field; empty: no limit", low=-1e6, high=1e6),
    "rate_limit": fixed((), "fastest output, units per second, per field; empty: no limit", low=0.0, high=1e9),
    "stale_after": fixed(0.1, "age of a dither after which it is not added", unit="s", low=0.001, high=60.0),
    "enabled": fixed(True, "the master switch at the start; ~/enable changes it"),
    "queue": fixed(5, "depth of the queues; the newest are kept", unit="messages", low=1, high=1000),
}


def _mix_of(given: Sequence[float], fields: int, effectors: int) -> NDArray[np.float64] | None:
    """Return the parameter `mix` as a matrix (fields, effectors); None: each field is an effector.

    Raises
    ------
    NodeError
        If it does not fit.
    """
    if len(given) == 0:
        if fields != effectors:
            message = f"parameter 'fields' has {fields} paths; it must have one per effector, {effectors}, or none"
            raise NodeError(message)
        return None
    if len(given) != fields * effectors:
        message = f"parameter 'mix' has {len(given)} numbers; it must have {effectors} for each of {fields} fields"
        raise NodeError(message)
    return np.array(given, np.float64).reshape(fields, effectors)


class MixerNode(Node):
    """Publish `command_out`: the commands of `command_in`, with `dither` added while it is valid.

    `command_in` is subscribed to best effort, which publishers of either kind match; `command_out` is reliable.

    Parameters
    ----------
    **options
        As for `rclpy.node.Node`.

    Raises
    ------
    EstimationError, NodeError
        For a parameter that is refused.
    """

    def __init__(self, name: str = "mixer", **options: Any) -> None:
        """Declare the parameters, and listen."""
        super().__init__(name, **options)
        warn_of_unknown(self, PARAMETERS)
        self._p = p = declare_table(self, PARAMETERS)
        names = p["effectors"]
        texts = p["fields"] or [f"delta[effectors={name}]" for name in names]
        self._mix = _mix_of(p["mix"], len(texts), len(names))
        limits = MixerLimits(p["authority"], p["position_low"], p["position_high"], p["rate_limit"], p["stale_after"])
        self._mixer = Mixer(len(texts), limits, p["scale"])
        self._mixer.enabled = p["enabled"]
        self._paths = [FieldPath(text) for text in texts]
        self._dither = NamedVector("dither", names)
        self._refusals = Refusals(self)
        self._freshness, self._newest, self._stamp = Freshness(), 0, 0
        self._stale_after = round(p["stale_after"] * 1e9)
        self._steady: Callable[[], int] = time.monotonic_ns
        self.passed = self.mixed = 0
        """Commands passed on as they came, and with dither."""
        self._reason = "no command yet"
        self._kind = message_class(p["command_type"])
        depth, options = p["queue"], {"qos_overriding_options": overriding()}
        self._publisher = publish(self, self._kind, "command_out", reliable(depth))
        self.create_subscription(self._kind, "command_in", self._on_command, best_effort(depth), raw=True, **options)
        listen(self, DitherCommand, "dither", reliable(depth), self._on_dither, self._refusals.take)
        self.create_service(SetBool, "~/enable", self._on_enable)
        self._diagnostics = Diagnostics(self, self._health, self._refusals.counts)

    def _on_dither(self, message: DitherCommand) -> None:
        """Keep a dither until the next comes, or it is too old."""
        self._stamp, now = messages.stamp_of(message), self._steady()
        stamp = self._stamp
        self._newest = max(self._newest, stamp) if stamp > self._newest - 1_000_000_000 else stamp
        try:
            (delta,) = self._dither.arrange(message.effectors, delta=message.delta)
        except Refused as refused:
            self._refusals.take(refused)
            self._mixer.drop(str(refused))
            return
        age = self._freshness.age(stamp, self._newest, self.get_clock().now().nanoseconds)
        mixed = delta if self._mix is None else self._mix @ delta
        self._mixer.take((now - max(age, 0)) * 1e-9, mixed, message.level)

    def _on_command(self, data: bytes) -> None:
        """Pass a command on, with dither where it is valid."""
        try:
            output = self._with_dither(data)
        except (Refused, EstimationError) as problem:
            refused = problem if isinstance(problem, Refused) else Refused("field", str(problem))
            self._refusals.take(refused)
            self._reason, output = str(problem), None
        except Exception as error:  # of the deserialiser: nothing may stop the stack's command
            self._refusals.take(Refused("malformed", f"command: {error}"))
            self._reason, output = str(error), None
        self._publisher.publish(data if output is None else output)
        if output is None:
            self.passed += 1
        else:
            self.mixed += 1

    def _with_dither(self, data: bytes) -> Any:
        """Return the command with dither; None: as it came."""
        message = deserialize_message(data, self._kind)
        self._drop_before(message)
        command = np.array([float(path.read(message)) for path in self._paths])
        output, mixed, self._reason = self._mixer.mix(self._steady() * 1e-9, command)
        if not mixed:
            return None
        for path, before, after in zip(self._paths, command.tolist(), output.tolist(), strict=True):
            if after != before:
                path.write(message, after)
        return message

    def _drop_before(self, command: Any) -> None:
        """Drop a dither that is stale by the command's own stamp, however late this node itself runs."""
        if not hasattr(command, "header") or not self._stamp:
            return
        age = messages.stamp_of(command) - self._stamp
        if self._stale_after < age < SAME_EPOCH:
            self._mixer.drop(f"the dither is {age * 1e-9:.2f} s older than the command, by their stamps")

    def _on_enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self._mixer.enabled = request.data
        response.success, response.message = True, f"dither is {'added' if request.data else 'not added'}"
        self.get_logger().info(response.message)
        return response

    def _health(self) -> Health:
        counts = {"mixed": self.mixed, "passed on as they came": self.passed}
        if self.mixed + self.passed == 0:
            return Health(DiagnosticStatus.STALE, "no command yet", counts)
        if self._reason:
            return Health(DiagnosticStatus.WARN, f"passing the stack's command on as it comes: {self._reason}", counts)
        return Health(DiagnosticStatus.OK, "adding dither", counts)
