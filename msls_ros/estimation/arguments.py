"""What a caller gives, checked before anything is learnt from it: numbers, whole numbers, and stamps.

A stamp that is not a number, or not later than the last, or in another unit than seconds, makes B a wrong number or
none, and nothing downstream shows it. So stamps are refused here, with what would be right. Those that the gate of
`inputs` has passed were compared there in nanoseconds, which seconds since 1970 do not resolve; they are not checked
again.
"""

from __future__ import annotations

import math
import operator
from typing import Any

import numpy as np

from msls_ros.estimation.errors import EstimationError
from msls_ros.estimation.kernel import Array

ODD = 10.0
"""Steps of time longer than the period of `sample_rate` by this factor, or shorter, are of another unit or rate."""
SLOWEST = 0.5
"""Steps [s] up to this are never too long: the estimator follows a slower pace up to `screening.LONGEST_STEP`."""
STEPS = 20
"""Fewer steps than these say nothing of a unit: there are gaps."""
UNITS = {"ns": 1e9, "us": 1e6, "ms": 1e3, "minutes": 1.0 / 60.0, "hours": 1.0 / 3600.0}
"""How many of each are a second."""


DIFFERENTIATED = "derivatives that are not measured are made of the states by msls_ros.inputs.differentiated"
"""What to do where there are none."""


def as_numbers(name: str, values: Any) -> Array:
    """Return values as float64.

    Parameters
    ----------
    name
        What they are, for the message.
    values
        Any shape of numbers; lists will do.

    Raises
    ------
    EstimationError
        For dates, text, and what else is no number.
    """
    if isinstance(values, np.ndarray) and values.dtype == np.float64:
        return np.ascontiguousarray(values)
    if values is None:
        message = f"{name} is None; give numbers" + (f": {DIFFERENTIATED}" if name == "xdot" else "")
        raise EstimationError(message)
    try:
        found = np.asarray(values)
        if found.dtype.kind in "fiubO":
            return np.ascontiguousarray(found, np.float64)
        kind = f"of dtype {found.dtype}"
    except (TypeError, ValueError) as error:
        kind = f"no array of numbers ({error})"
        found = np.empty(0)
    advice = {
        "M": f"float64 seconds, ({name} - {name}[0]) / np.timedelta64(1, 's')",
        "m": f"float64 seconds, {name} / np.timedelta64(1, 's')",
    }.get(found.dtype.kind, "float64")
    message = f"{name} is {kind}; give numbers: {advice}"
    raise EstimationError(message) from None


def as_whole(name: str, value: Any, least: int) -> int:
    """Return a whole number.

    Raises
    ------
    EstimationError
        For what is none, or less than the least.
    """
    try:
        number = operator.index(value)
    except TypeError:
        number = least - 1
    if number < least or isinstance(value, bool):
        message = f"{name} is {value!r}; it must be a whole number, {least} or more"
        raise EstimationError(message)
    return number


def as_stamp(time: Any) -> float:
    """Return one stamp [s].

    Raises
    ------
    EstimationError
        For what is no number, or several.
    """
    if isinstance(time, float):
        return float(time)
    found = as_numbers("time", time)
    if found.size != 1:
        message = f"time has shape {found.shape}; expected one number, in seconds"
        raise EstimationError(message)
    return float(found.reshape(-1)[0])


class Stamps:
    """Stamps one after the other: finite, increasing, and about as far apart as the sample rate says.

    Parameters
    ----------
    sample_rate
        As configured [Hz].
    gated
        Whether they have been checked in nanoseconds: anything is taken then.
    """

    def __init__(self, sample_rate: float, gated: bool) -> None:
        """Begin; see the class."""
        self._period, self._gated = 1.0 / sample_rate, gated
        self.clear()

    def clear(self) -> None:
        """Forget the stamps before."""
        self._last, self._odd = -math.inf, 0

    def check_one(self, time: float) -> None:
        """Raise EstimationError for a stamp that cannot follow the last; nothing changes.

        Steps far from the period of the sample rate are refused from the twentieth in a row on.
        """
        if self._gated:
            return
        if not (math.isfinite(time) and time > self._last):
            self.check(np.array([time]))
        step = time - self._last
        if abs(self._odd) >= STEPS and self._oddness(step):
            raise EstimationError(self._say_pace(step))

    def check(self, time: Array, dtype: Any = np.float64) -> None:
        """Raise EstimationError for stamps (k,) [s] that cannot follow the last; nothing changes.

        Parameters
        ----------
        time
            Stamps.
        dtype
            In which they were given.
        """
        if time.ndim != 1:
            message = f"time has shape {time.shape}; expected one dimension, a stamp for each sample"
            raise EstimationError(message)
        if self._gated:
            return
        finite = np.isfinite(time)
        if not finite.all():
            k = int(np.argmin(finite))
            message = f"time is {time[k]} at sample {k}; expected finite seconds: leave such samples out"
            raise EstimationError(message)
        before = np.concatenate([[self._last], time[:-1]]) if len(time) else time
        increases = time > before
        if not increases.all():
            k = int(np.argmin(increases))
            how = "the same as" if time[k] == before[k] else "earlier than"
            message = f"time is {time[k]:.9f} s at sample {k}, {how} the {before[k]:.9f} s before it; expected seconds "
            message += "that increase strictly: sort the samples, leave repeated ones out, call reset() before another "
            message += "flight"
            if dtype == np.float32 and time[k] == before[k]:
                message += "; float32 is too coarse for such stamps: give float64"
            raise EstimationError(message)
        if len(time) > STEPS:
            step = float(np.median(np.diff(time)))
            if self._oddness(step):
                raise EstimationError(self._say_pace(step))

    def take_one(self, time: float) -> None:
        """Take a stamp that `check_one` has passed."""
        odd = self._oddness(time - self._last)
        self._odd = self._odd + odd if odd * self._odd > 0 else odd
        self._last = time

    def take(self, time: Array) -> None:
        """Take stamps (k,) that `check` has passed."""
        if len(time):
            self._last, self._odd = float(time[-1]), 0

    def _oddness(self, step: float) -> int:
        """Whether a step is far too long (1), far too short (-1), or neither (0)."""
        return int(step > max(ODD * self._period, SLOWEST)) - int(step * ODD < self._period)

    def _say_pace(self, step: float) -> str:
        """Say what is wrong with a usual step, and what it probably is."""
        ratio = step / self._period
        unit = min(UNITS, key=lambda name: abs(math.log(ratio / UNITS[name])))
        text = f"time goes on by {step:g} s in the median, {ratio:.3g} times the {self._period:g} s of sample_rate; "
        text += "expected seconds"
        if 1.0 / ODD < ratio / UNITS[unit] < ODD:
            factor = UNITS[unit]
            text += f": it is probably in {unit}, give time {f'/ {factor:g}' if factor > 1 else f'* {1 / factor:g}'}"
        return f"{text}; where they are seconds, set sample_rate to {1.0 / step:.3g} Hz"
