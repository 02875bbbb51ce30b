"""What /diagnostics tells of the traffic: rate and age of each input, time that the samples take, backlog."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Mapping

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus

from msls_ros.estimation import Identifier
from msls_ros.estimation.compiled import HAVE_NUMBA
from msls_ros.inputs import Synchronizer
from msls_ros.inputs.freshness import RateWatch

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
        self.age = 0.0
        """Of the newest sample, by its stamp [s]."""
        self.backlog = 0
        """Samples that have come after the one in work."""
        self.old = 0
        """Samples too old for a dither."""

    def took(self, nanoseconds: int) -> None:
        """Take note of how long a sample took."""
        self._took.append(nanoseconds)

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
        values["age of the newest sample [s]"] = f"{self.age:.3f}"
        values["backlog [samples]"] = self.backlog
        values["too old for a dither [samples]"] = self.old
        values["last event"] = self.last_event
        return values


def told(identifier: Identifier, gate: Synchronizer, stale: bool) -> dict[str, object]:
    """Return what an identifier has to tell in /diagnostics.

    Parameters
    ----------
    identifier, gate
        With their counts.
    stale
        Whether the samples have stopped.
    """
    dither = identifier.last_dither
    why = "inhibited: no fresh samples" if stale else f"{dither.level.name.lower()}: {dither.reason}"
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
        "kernels": "compiled" if HAVE_NUMBA else "interpreted",
    }


def judged(identifier: Identifier, rate: RateWatch, active: bool, stale: bool) -> tuple[bytes, str]:
    """Return level and message of an identifier's health; arguments as for `told`."""
    if not active:
        return DiagnosticStatus.OK, "inactive"
    if stale:
        return DiagnosticStatus.STALE, "no samples: the dither is zero"
    if rate.deviates:
        return DiagnosticStatus.WARN, rate.sentence
    if not identifier.enabled:
        return DiagnosticStatus.WARN, "frozen: samples are not learnt from"
    if not identifier.flying:
        c = identifier.configuration
        slow = f"slower than {c.flying_speed * c.reference_speed:.3g} m/s, or not climbing yet"
        return DiagnosticStatus.OK, f"not flying ({slow}): nothing is learnt, the dither is zero"
    air = round(100.0 * identifier.air)
    gusts = f", error bars widened: gusts make {air} % of the motion" if identifier.moving_air else ""
    return DiagnosticStatus.OK, f"identifying{gusts}"
