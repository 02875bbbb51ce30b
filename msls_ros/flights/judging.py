"""What a flight shows of one parameter and of the alarms: errors relative to the truth, delays, what is false."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Alarms = Sequence[tuple[float, tuple[str, ...]]]
"""Time [s] and equations."""
Span = tuple[float, float]
"""When a fault strikes, and when its ramp ends [s]."""
SETTLED = 0.1
"""An estimate has settled when its error stays below this share of the true value before the fault."""
START = 1.0
"""Errors before the fault count from here [s]."""
ALARM_WINDOW = 1.0
"""An alarm after a fault, at most this after the end of its ramp, is its detection; any other is false [s]."""
AFTER = 1.0
"""Errors after the fault count from here, after the end of its ramp [s]."""
LATE = 2.0
"""Late errors count from here, after the end of its ramp [s]."""
TICK = 1e-6
"""Stamps of one sample may differ by less [s]."""
PEERS: Mapping[str, Mapping[str, Mapping[str, Any]]] = {
    "bank": {"msls": {"estimator.method": "msls"}, "rls": {"estimator.method": "rls"}},
    "msls": {"msls_no_detection": {"detector.mode": "off"}, "rls": {"estimator.method": "rls"}},
    "rls": {"msls": {"estimator.method": "msls"}},
}
"""Estimators that see the samples of the one that flew, by its method, and what is other in their configuration."""
LABELS = {"bank": "bank", "msls": "MSLS", "msls_no_detection": "MSLS without detection", "rls": "RLS"}
"""What people call them."""


def belongs(time: float, span: Span) -> bool:
    """Whether an alarm may be the detection of a fault."""
    return span[0] + TICK < time <= span[1] + ALARM_WINDOW + TICK


def detection(span: Span | None, alarms: Alarms) -> dict[str, Any]:
    """Return when and in which equations a fault was seen first."""
    first = next((a for a in alarms if span is not None and belongs(a[0], span)), None)
    return {
        "time_s": round(first[0], 9) if first else None,
        "delay_s": round(first[0] - span[0], 9) if first and span is not None else None,
        "equations": list(first[1]) if first else [],
    }


def false_alarms(spans: Sequence[Span], alarms: Alarms) -> int:
    """Return how many alarms belong to no fault."""
    return sum(not any(belongs(time, span) for span in spans) for time, _ in alarms)


def exposed(spans: Sequence[Span], duration: float) -> float:
    """Return the time of a flight in which an alarm would be false [s]."""
    total, reached = 0.0, 0.0
    for start, end in sorted(spans):
        total += max(min(start, duration) - reached, 0.0)
        reached = max(reached, min(end + ALARM_WINDOW, duration))
    return total + duration - reached


def errors(
    time: Array, estimate: Array, truth: Array, faults: Span | None, truth_before: float
) -> dict[str, float | None]:
    """Errors of an estimate relative to the true value before the first fault; settled counts from the last ramp's end.

    Parameters
    ----------
    time, estimate, truth
        (n,) [s], and the parameter.
    faults
        When the first strikes, and when the last ramp ends; None: nothing breaks.
    truth_before
        True value before the first.
    """
    if truth_before == 0.0:
        return dict.fromkeys(("settle_s", "rms_before", "rms_after", "peak_error"))
    error = np.abs(estimate - truth) / abs(truth_before)
    early = time > START
    if faults is None:
        return {"settle_s": None, "rms_before": rms(error[early]), "rms_after": None, "peak_error": None}
    start, end = faults
    struck, over = time > start + TICK, time > end + TICK
    unsettled = time[over & ~(error <= SETTLED)]  # nor is what is no number
    return {
        "settle_s": (round(float(unsettled[-1] - end), 9) if len(unsettled) else 0.0) if over.any() else None,
        "rms_before": rms(error[early & ~struck]),
        "rms_after": rms(error[time > end + AFTER]),
        "peak_error": float(error[struck].max()) if struck.any() else None,
    }


def errors_now(
    time: Array, estimate: Array, truth: Array, faults: Span | None, truth_before: float
) -> dict[str, float | None]:
    """Errors relative to the true value of the moment, and the largest of the late ones; as `errors`."""
    if faults is None:
        return {"rms_after_now": None, "late_error": None, "late_error_now": None}
    error = np.abs(estimate - truth)
    with np.errstate(divide="ignore", invalid="ignore"):
        now, before = error / np.abs(truth), error / np.abs(truth_before)
    late = time > faults[1] + LATE + TICK
    return {
        "rms_after_now": rms(now[time > faults[1] + AFTER]),
        "late_error": float(before[late].max()) if late.any() else None,
        "late_error_now": float(now[late].max()) if late.any() else None,
    }


def rms(values: Array) -> float:
    """Return the root of the mean square; NaN of nothing."""
    return math.sqrt(mean(np.square(values)))


def mean(values: NDArray[Any]) -> float:
    """Return the mean; NaN of nothing."""
    return float(np.mean(values)) if len(values) else math.nan
