"""What a node does with messages that it cannot use: count them by reason, log them seldom, tell /diagnostics."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from msls_ros.inputs import Refused
from msls_ros.nodes.quality import LEAST, publish, reliable

TIME_JUMP = 1_000_000_000
"""A step back in time larger than this is a new beginning [ns]; a smaller one is refused."""

RECENT = 10_000_000_000
"""For so long after a refusal /diagnostics warns of it [ns of the node's clock]."""


class StampGate:
    """Refuse stamps of one stream that repeat or go back a little.

    Parameters
    ----------
    kind
        What the stream is called in sentences.
    """

    def __init__(self, kind: str) -> None:
        """Know no stamp yet; see the class."""
        self._kind = kind
        self._last: int | None = None

    def check(self, stamp: int) -> None:
        """Take a stamp [ns].

        Raises
        ------
        Refused
            If it repeats, or goes back by no more than `TIME_JUMP`.
        """
        last = self._last
        if last is not None and stamp <= last <= stamp + TIME_JUMP:
            reason, what = ("stamp_repeated", "repeats") if stamp == last else ("stamp_back", "goes back")
            text = f"{self._kind}: stamp {stamp * 1e-9:.9f} s {what} (last {last * 1e-9:.9f} s); expected a later one"
            raise Refused(reason, text)
        self._last = stamp


class Refusals:
    """Count and log refused messages.

    Parameters
    ----------
    node
        Whose logger speaks.
    counts
        Where somebody else counts; None: here.
    """

    def __init__(self, node: Node, counts: Counter[str] | None = None) -> None:
        """Begin with nothing refused; see the class."""
        self._logger = node.get_logger()
        self._clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._logged: dict[str, int] = {}
        self._count_here = counts is None
        self.counts: Counter[str] = Counter() if counts is None else counts
        """Messages refused, by reason."""

    def take(self, refused: Refused) -> None:
        """Count a refusal, and log each reason at most once a second."""
        if self._count_here:
            self.counts[refused.reason] += 1
        now = self._clock.now().nanoseconds
        if refused.reason not in self._logged or now - self._logged[refused.reason] >= 1_000_000_000:
            self._logged[refused.reason] = now
            self._logger.warning(f"refused ({refused.reason}, {self.counts[refused.reason]} so far): {refused}")


class Health(NamedTuple):
    """How a node is, for /diagnostics."""

    level: bytes
    """One of ``DiagnosticStatus.OK``, ``WARN``, ``ERROR``, ``STALE``."""
    message: str
    values: Mapping[str, object]


class Recent:
    """Whether a count has grown not long ago."""

    def __init__(self) -> None:
        """Begin at nothing."""
        self._count = 0
        self._until: int | None = None

    def grew(self, count: int, now: int) -> bool:
        """Take a count; return whether it has grown within `RECENT` before ``now`` [ns], which may jump back."""
        if count > self._count:
            self._until = now + RECENT
        self._count = count
        if self._until is not None and not self._until - RECENT <= now < self._until:
            self._until = None
        return self._until is not None


class Diagnostics:
    """Publish a node's health on /diagnostics once a second of the wall clock.

    Parameters
    ----------
    node
        Whose health it is.
    health
        Asked at each publication; the refusals are added to what it says, as a warning while the last is recent.
    refused
        Counts by reason.
    """

    def __init__(self, node: Node, health: Callable[[], Health], refused: Mapping[str, int]) -> None:
        """Make publisher and timer; see the class."""
        self._node, self._health, self._refused, self._recent = node, health, refused, Recent()
        self._publisher = publish(node, DiagnosticArray, "/diagnostics", reliable(LEAST))
        self._timer = node.create_timer(1.0, self._publish, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def destroy(self) -> None:
        """Give topic and timer back."""
        self._node.destroy_timer(self._timer)
        self._node.destroy_publisher(self._publisher)

    def _publish(self) -> None:
        level, message, values = self._health()
        total = sum(self._refused.values())
        now = self._node.get_clock().now()
        if self._recent.grew(total, now.nanoseconds) and level == DiagnosticStatus.OK:
            what = f"{total} messages refused, the last of them less than {RECENT * 1e-9:g} s ago"
            level, message = DiagnosticStatus.WARN, f"{message}; {what}"
        counts = {
            **values,
            "messages refused": total,
            **{f"refused: {reason}": count for reason, count in sorted(self._refused.items())},
        }
        name = self._node.get_fully_qualified_name()
        status = DiagnosticStatus(level=level, name=f"{name}: messages", message=message, hardware_id="msls_ros")
        status.values = [KeyValue(key=key, value=str(value)) for key, value in counts.items()]
        array = DiagnosticArray(status=[status])
        array.header.stamp = now.to_msg()
        self._publisher.publish(array)
