"""What /diagnostics tells of the traffic: rate and age of each input, time that the samples take, backlog."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.impl.rcutils_logger import RcutilsLogger

from msls_ros.estimation import Identifier
from msls_ros.estimation.compiled import HAVE_NUMBA
from msls_ros.inputs import InputAdapter, Synchronizer
from msls_ros.inputs.answers import Pause
from msls_ros.inputs.dither_echo import DitherEcho
from msls_ros.inputs.freshness import LossWatch, RateWatch

REMEMBERED = 1000
"""Samples whose processing time is remembered."""


class Traffic:
    """Counts of one topic.

    Parameters
    ----------
    now
        A steady clock [ns].
    """

    def __init__(self, now: Callable[[], int]) -> None:
        """Begin with nothing heard; see the class."""
        self._now = now
        self.count = 0
        """Messages so far."""
        self.last = 0
        """When the newest arrived [ns]."""
        self._asked: tuple[int, int] = (now(), 0)

    def tick(self, now: int) -> None:
        """Take note of a message."""
        self.count += 1
        self.last = now

    def rate(self) -> float:
        """Return the rate since the last call [Hz]."""
        (since, before), now = self._asked, self._now()
        self._asked = now, self.count
        return (self.count - before) * 1e9 / max(now - since, 1)


class Monitor:
    """What an identifier measures of its own work.

    Parameters
    ----------
    topics
        Of the inputs.
    now
        A steady clock [ns].
    """

    def __init__(self, topics: Mapping[str, str], now: Callable[[], int] = time.monotonic_ns) -> None:
        """Begin; see the class."""
        self.now = now
        self.traffic = {topic: Traffic(now) for topic in topics}
        self._took: deque[int] = deque(maxlen=REMEMBERED)
        self.last_event = "none"
        """Description of the last event."""

    def took(self, nanoseconds: int) -> None:
        """Take note of how long a sample took."""
        self._took.append(nanoseconds)

    def silent(self, now: int, since: int) -> str:
        """Say on which inputs nothing has come for most of the time between two instants of the steady clock [ns]."""
        quiet = {topic: now - t.last for topic, t in self.traffic.items() if 2 * (now - t.last) > now - since}
        if not quiet:
            return "messages come on all inputs, but make no sample: see what is refused"
        return f"nothing on {' and '.join(f'{topic} for {age * 1e-9:.2f} s' for topic, age in quiet.items())}"

    def report(self) -> dict[str, object]:
        """Return all of it for /diagnostics."""
        values: dict[str, object] = {}
        for topic, traffic in self.traffic.items():
            age = (self.now() - traffic.last) * 1e-9 if traffic.count else float("inf")
            values[f"{topic}: messages"] = traffic.count
            values[f"{topic}: rate [Hz]"] = f"{traffic.rate():.1f}"
            values[f"{topic}: age [s]"] = f"{age:.3f}"
        if self._took:
            p50, p99, most = np.percentile(np.array(self._took), [50.0, 99.0, 100.0]) * 1e-6
            for name, value in (("p50", p50), ("p99", p99), ("max", most)):
                values[f"processing {name} [ms]"] = f"{value:.3f}"
        values["last event"] = self.last_event
        return values


class Pace:
    """Whether samples come as fast as was promised, or as the stream that sets their pace; it says so in the log.

    Parameters
    ----------
    nominal
        Rate of the samples [Hz].
    queue
        What the queues hold [s of samples].
    logger
        Of the node.
    """

    def __init__(self, nominal: float, queue: float, logger: RcutilsLogger) -> None:
        """Begin; see the class."""
        self._nominal, self._logger, self._slowest = nominal, logger, ""
        self.rate, self.losses = RateWatch(nominal), LossWatch(nominal, queue)

    def clear(self) -> None:
        """Begin anew, after a jump of time."""
        self.rate.clear()

    def follow(self, adapter: InputAdapter) -> None:
        """Expect samples at the pace of an adapter; name its topics that are too slow."""
        for text in adapter.newly_slow():
            self._logger.warning(text)
        slowest, rate = adapter.pace
        if slowest != self._slowest:
            self._slowest = slowest
            text = f"{slowest} comes at {rate:.4g} Hz: so do samples" if slowest else ""
            self._logger.info(text or "samples come with the clock again")
        self.rate.expect(rate or self._nominal, slowest)
        self.losses.expect(rate or self._nominal)

    def take(self, stamp: int, steady: int) -> None:
        """Take a sample's stamp and the steady clock [ns]."""
        if self.losses.take(stamp, steady):
            self._logger.warning(self.losses.sentence)
        if self.rate.take(stamp) and not self.losses.sentence:
            self._logger.warning(self.rate.sentence)

    def report(self) -> dict[str, object]:
        """Return it for /diagnostics."""
        return {
            "sample rate by stamps [Hz]": f"{self.rate.measured:.2f}",
            "lost, faster than real time [samples]": self.losses.lost,
        }


class Course(NamedTuple):
    """What of an identifier's course is worth a line in the log when it changes."""

    flying: bool
    spikes: int
    rate: float
    """At which it learns [samples/s]."""

    @classmethod
    def of(cls, identifier: Identifier) -> Course:
        """Return that of now."""
        return cls(identifier.flying, identifier.spikes, identifier.learning_rate)

    def tell_changes(self, identifier: Identifier, time: float, logger: RcutilsLogger) -> None:
        """Say what has changed with the sample of a time [s]."""
        flying, spikes, rate = self.of(identifier)
        if flying != self.flying:
            logger.info("flying: samples are learnt from" if flying else "not flying: nothing is learnt")
        if spikes != self.spikes:
            text = f"{identifier.spike} jumped away and back before {time:.3f} s: not learnt from"
            logger.warning(text, throttle_duration_sec=1.0)
        if rate != self.rate:
            why = f": {identifier.repeating} is not measured oftener" if identifier.repeated else ""
            logger.info(f"learning from {rate:.4g} samples a second{why}")


def told(identifier: Identifier, gate: Synchronizer, pause: Pause | None, echo: DitherEcho) -> dict[str, object]:
    """Return what an identifier has to tell in /diagnostics.

    Parameters
    ----------
    identifier, gate
        With their counts.
    pause
        Why there is no fresh sample; None: there is.
    echo
        What is known of the dither in the deflections.
    """
    dither = identifier.last_dither
    why = f"inhibited: {pause.reason}" if pause else f"{dither.level.name.lower()}: {dither.reason}"
    return {
        "samples": gate.paired,
        "alarms": identifier.alarms,
        "restarts": gate.restarts,
        "not of flight [samples]": identifier.grounded,
        "spikes [samples]": identifier.spikes,
        "last spike": identifier.spike or "none",
        "repeated [samples]": identifier.repeated,
        "last repeated": identifier.repeating or "none",
        "not measured in every sample": ", ".join(identifier.held) or "none",
        "learnt from [Hz]": f"{identifier.learning_rate:.4g}",
        "motion made by gusts [%]": round(100.0 * identifier.air),
        "dither": why,
        "dither not in the deflections": ", ".join(echo.missing) or "none",
        "dither not in the deflections [times found]": echo.times,
        "kernels": "compiled" if HAVE_NUMBA else "interpreted",
    }


def judged(identifier: Identifier, pace: Pace, active: bool, pause: Pause | None) -> tuple[bytes, str]:
    """Return level and message of an identifier's health; arguments as for `told`."""
    if not active:
        return DiagnosticStatus.OK, "inactive"
    if pause:
        return DiagnosticStatus.WARN if pause.coming else DiagnosticStatus.STALE, pause.message
    if pace.losses.sentence:
        return DiagnosticStatus.WARN, pace.losses.sentence
    if pace.rate.deviates:
        return DiagnosticStatus.WARN, pace.rate.sentence
    if not identifier.enabled:
        return DiagnosticStatus.WARN, "frozen: samples are not learnt from"
    if not identifier.flying:
        c = identifier.configuration
        slow = f"slower than {c.flying_speed * c.reference_speed:.3g} m/s, or not climbing yet"
        return DiagnosticStatus.OK, f"not flying ({slow}): nothing is learnt, the dither is zero"
    air = round(100.0 * identifier.air)
    gusts = f", error bars widened: gusts make {air} % of the motion" if identifier.moving_air else ""
    return DiagnosticStatus.OK, f"identifying{gusts}"
