"""What /diagnostics tells of the traffic: rate and age of each input, time that the samples take, backlog."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus

from msls_ros.estimation import Identifier
from msls_ros.estimation.compiled import HAVE_NUMBA
from msls_ros.estimation.spikes import LONGEST
from msls_ros.inputs import Synchronizer
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
        self.age = 0.0
        """Of the newest sample, by its stamp [s]."""
        self.backlog = 0
        """Samples that have come after the one in work."""
        self.old = 0
        """Samples too old for a dither."""

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
        values["age of the newest sample [s]"] = f"{self.age:.3f}"
        values["backlog [samples]"] = self.backlog
        values["too old for a dither [samples]"] = self.old
        values["last event"] = self.last_event
        return values


class Pause(NamedTuple):
    """Why there is no fresh sample."""

    reason: str
    """As the zero dither says it."""
    message: str
    """The same for /diagnostics and the log, with what follows of it."""
    coming: bool
    """Samples come, but are held or late."""


class Arrivals:
    """When samples came that could be answered by a dither, and when those that could not."""

    def __init__(self) -> None:
        """Know of no sample yet; see the class."""
        self.fresh: int | None = None
        """The last fresh one [ns]."""
        self.held = self.late = 0
        """When the last one came that is held as it may be a spike, and the last that was too old [ns].

        Data that arrive are not stale while they are held: that is no pause, for as long as a spike may last.
        """
        self.answered = -1
        """Stamp up to which the last dither has been held for those [ns]; less than any: none has."""

    def pause(self, now: int, limit: float, monitor: Monitor) -> Pause | None:
        """Return why no fresh sample has come for longer than a limit [s]; None: one has.

        Parameters
        ----------
        now
            The steady clock [ns].
        limit
            `dither.stale_after`.
        monitor
            Of the inputs.
        """
        since = self.fresh or 0
        age = (now - since) * 1e-9 if self.fresh is not None else 0.0
        waits = (now - self.held) * 1e-9 <= limit and age <= limit + LONGEST
        if self.fresh is not None and (age <= limit or waits):
            return None
        more = f"more than {limit:g} s"
        if 2 * (self.held - since) > now - since:
            reason = f"samples held for {age:.2f} s, {more}, as a number may be a spike"
            return Pause(reason, f"{reason}: the dither pauses", True)
        if 2 * (self.late - since) > now - since:
            reason = f"samples come {monitor.age:.2f} s late, {more}"
            return Pause(reason, f"{reason}: learnt from, but the dither is zero", True)
        message = f"no samples for {age:.2f} s ({monitor.silent(now, since)}): the dither is zero"
        return Pause(f"no sample for {age:.2f} s, {more}", message, False)


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


def judged(
    identifier: Identifier, rate: RateWatch, losses: LossWatch, active: bool, pause: Pause | None
) -> tuple[bytes, str]:
    """Return level and message of an identifier's health; arguments as for `told`."""
    if not active:
        return DiagnosticStatus.OK, "inactive"
    if pause:
        return DiagnosticStatus.WARN if pause.coming else DiagnosticStatus.STALE, pause.message
    if losses.sentence:
        return DiagnosticStatus.WARN, losses.sentence
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
