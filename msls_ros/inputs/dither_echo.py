"""Whether the dither that is commanded comes back in the deflections: where nobody adds it, B is not learnt from it.

Dither is drawn at random, so nothing else in an aircraft moves with it. Each deflection d is held against its own
dither u, both whitened by the deflection's autoregression (a pilot's inputs are larger than any dither, but smooth)::

    e(k) = d(k) - sum_i a_i d(k-i),    s(k) = u(k) - sum_i a_i u(k-i),    e = g (h * s) + noise

for each pulse response h of a set: delays, with and without the first-order lag of an actuator. A least-squares gain g
has a standard error. A dither is missing where every gain is below `NOTHING`, or within `ABSENT` of its errors of zero,
and a gain of `LEAST` would be `CERTAIN` of them. Latency that jitters spreads the answer over
many delays, so that no gain shows much of it: what e has of s over all delays together, each with a weight of its own,
is to be no more than `CHANCE` allows, either.

Where derivatives are made in a window, deflections have passed it, and the dither is passed through the same: held
against it as it was sent, it would be looked for above all where the window leaves none of it.

A feedback that counteracts part of the dither, a rate limit and lost samples leave more of it than that. Where noise or
a coarse record hides it, nothing is said. Residuals beyond the usual, as at steps of a pilot, are left out, for they
would hide it; with them the gains must be zero, too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import Enum

import numpy as np

from msls_ros.estimation.kernel import Array
from msls_ros.inputs.derivatives import sample_weights

WINDOW = 30.0
"""Over which the two are compared [s]."""
SHORTEST = 5.0
"""Least time with dither from which anything is concluded [s]."""
STEP = 0.02
"""Samples that come faster are averaged over this time [s]."""
LONGEST_GAP = 0.5
"""Samples further apart are not compared with each other [s]."""
LATEST = 0.35
"""Longest delay from the sample that a dither answers to the deflection [s]."""
CORNERS = (math.inf, 20.0, 8.0)
"""Of actuators [rad/s]."""
TAIL = 0.3
"""How long a response lasts after its delay [s]."""
ORDER = 8
"""Of the autoregression."""
OUTLIER, RARE = 5.0, 0.08
"""Residuals larger than this multiple of their median size, as at steps of a pilot, are left out where few are."""
LEAST, CERTAIN, ABSENT, PRESENT = 0.3, 8.0, 3.5, 6.0
"""Gain that would be seen; by how many standard errors; at most so many are none, at least so many end a verdict."""
NOTHING = 0.02
"""Gain that is none, however small its error."""
TWICE = 2
"""Comparisons in a row that must agree before an effector is found."""
CHANCE = 2.0
"""Most standard deviations by which the answers over all delays together are more than none would be, where there are
none. Of 80 echoes through latency of .06 to .16 s that jitters and drops a fifth, in part through actuators of 8 rad/s
or a window of derivatives, 3 were called missing (with 2.5: 3, 1.5: 2, without: 12), of 10 through .04 to .3 s 4 (7, 4,
9), of 180 others none. The median time until an absent one is found: 10.5 s (9.5, 10.5, 9.5)."""
OFTEN = 60
"""Comparisons over a record."""
FINE = 0.5
"""Largest step of a record from which anything is concluded, over the rms that a slow actuator makes of the dither."""


class Verdict(Enum):
    """Of one effector."""

    PRESENT = "its dither comes back"
    MISSING = "it does not"
    OVER = "there is too little dither to be missed"
    UNKNOWN = "none of these is certain"


class DitherEcho:
    """Compare deflections with the dither that was commanded.

    `take` stores a sample (1 us); `judge` compares, one effector at a call (3 ms).

    Parameters
    ----------
    effectors
        Names, m of them.
    rate
        Of the samples [Hz].
    straddle
        Intervals of the derivatives' window that the deflections have passed; 0: none, see `InputAdapter.straddle`.
    """

    def __init__(self, effectors: Sequence[str], rate: float, straddle: int = 0) -> None:
        """Allocate; see the class."""
        self._names = tuple(effectors)
        self._group = max(round(rate * STEP), 1)
        self._window = window(round(straddle / self._group))
        size = max(math.ceil(WINDOW * rate / self._group), 8 * ORDER)
        self._rows = np.zeros((size, 1 + 2 * len(self._names)))
        self._sum = np.zeros(self._rows.shape[1])
        self._found: set[str] = set()
        self._agreed = dict.fromkeys(self._names, 0)
        self._turn = -1
        self.times = 0
        """How often an effector has been found whose dither does not come back."""
        self.clear()

    @property
    def missing(self) -> tuple[str, ...]:
        """Effectors whose dither does not come back."""
        return tuple(name for name in self._names if name in self._found)

    @property
    def sentence(self) -> str:
        """What is wrong; empty: nothing is known to be."""
        return sentence_of(self.missing)

    def clear(self) -> None:
        """Forget all samples; verdicts stay until there are enough others."""
        self._count = self._summed = 0
        self._last = -math.inf
        self._sum[:] = 0.0

    def take(self, time: float, delta: Array, command: Array | None) -> None:
        """Take a sample.

        Parameters
        ----------
        time
            [s]; where it is not later than the last, or by more than `LONGEST_GAP`, the comparison begins anew.
        delta
            (m,) measured deflections [rad].
        command
            (m,) dither that was published in answer to this sample [rad]; None: none was.
        """
        if not 0.0 < time - self._last <= LONGEST_GAP:
            self.clear()
        self._last = time
        row, m = self._rows[self._count % len(self._rows)], len(self._names)
        row[0] = time
        row[1 : m + 1] = delta
        row[m + 1 :] = 0.0 if command is None else command
        if self._group > 1:
            self._sum += row
            self._summed += 1
            if self._summed < self._group:
                return
            np.divide(self._sum, self._group, out=row)
            self._sum[:] = 0.0
            self._summed = 0
        self._count += 1

    def judge(self) -> str:
        """Compare the next effector in turn; return its name if it has been found missing now, else nothing."""
        if not self._names:
            return ""
        self._turn = (self._turn + 1) % len(self._names)
        name, verdict = self._names[self._turn], self._compare(self._turn)
        if verdict in (Verdict.PRESENT, Verdict.OVER):
            self._found.discard(name)
        self._agreed[name] = self._agreed[name] + 1 if verdict is Verdict.MISSING else 0
        if self._agreed[name] < TWICE or name in self._found:
            return ""
        self._found.add(name)
        self.times += 1
        return name

    def _compare(self, j: int) -> Verdict:
        """Return what the samples say of effector j."""
        count, size, m = min(self._count, len(self._rows)), len(self._rows), len(self._names)
        if count < 8 * ORDER:
            return Verdict.UNKNOWN
        order = np.arange(self._count - count, self._count) % size
        time, delta, command = (self._rows[order, column] for column in (0, 1 + j, 1 + m + j))
        step = float(np.median(np.diff(time)))
        if np.count_nonzero(command) * step < SHORTEST:
            return Verdict.OVER
        grid = np.arange(time[0], time[-1] + 0.5 * step, step)
        held = command[np.searchsorted(time, grid + 1e-3 * step, "right") - 1]
        shapes = responses(step)
        if len(grid) < 2 * shapes.shape[1]:
            return Verdict.UNKNOWN
        smooth = np.convolve(held, self._window, "same")
        return compare(np.interp(grid, time, delta), smooth, shapes, quantum(delta))


def sentence_of(missing: Sequence[str]) -> str:
    """Say of effectors that their dither does not come back; empty where there are none."""
    if not missing:
        return ""
    return (
        f"the dither commanded for {', '.join(missing)} does not come back in "
        f"{'its deflection' if len(missing) == 1 else 'their deflections'}: nothing adds it to the commands (a mixer "
        "does), or an effector is stuck or at its limits, or the record is too coarse, or the way from dither to "
        "deflection takes a time that varies by more than .1 s"
    )


def find_missing(names: Sequence[str], time: Array, delta: Array, command: Array, straddle: int = 0) -> tuple[str, ...]:
    """Return the effectors whose dither does not come back for a while in a record.

    Parameters
    ----------
    names
        m of them.
    time
        (n,) of the samples [s].
    delta, command
        (n, m) measured deflections, and the dither that answered each sample [rad].
    straddle
        As for `DitherEcho`.
    """
    if len(time) < 2:
        return ()
    echo, found = DitherEcho(names, 1.0 / max(float(np.median(np.diff(time))), 1e-4), straddle), set()
    due, every = float(time[0]) + SHORTEST, max(float(time[-1] - time[0]) / OFTEN, 1.0)
    for k, now in enumerate(time.tolist()):
        echo.take(now, delta[k], command[k])
        if now >= due or k == len(time) - 1:
            due = now + every
            found |= {echo.judge() for _ in names}
    return tuple(name for name in names if name in found)


def quantum(values: Array) -> float:
    """Return the smallest step between consecutive values (n,); 0: they are all the same."""
    steps = np.abs(np.diff(values))
    steps = steps[steps > 0.0]
    return float(steps.min()) if len(steps) else 0.0


def responses(step: float) -> Array:
    """Return (c, l) pulse responses of samples every ``step`` s; the last is of the slowest and latest actuator."""
    lags = np.arange(math.ceil((LATEST + TAIL) / step) + 1)
    delays = np.arange(math.ceil(LATEST / step) + 1)
    poles = np.exp(-np.array(CORNERS) * step)[:, None, None]
    after = lags - delays[:, None]
    found = np.where(after >= 0, (1.0 - poles) * poles ** np.maximum(after, 0), 0.0)
    return found.reshape(-1, len(lags))


def window(intervals: int) -> Array:
    """Return the (k,) weights of samples in a window of so many intervals, see `derivatives`; 0: one weight."""
    return sample_weights(intervals) if intervals > 0 else np.ones(1)


def compare(deflection: Array, dither: Array, shapes: Array, step: float) -> Verdict:
    """Return whether a dither is in a deflection.

    Parameters
    ----------
    deflection, dither
        (n,) samples at even times [rad].
    shapes
        (c, l) see `responses`.
    step
        In which the deflection is recorded [rad].
    """
    moved = np.convolve(dither - dither.mean(), shapes[-1])[: len(dither)]
    if step > FINE * float(np.std(moved)):
        return Verdict.UNKNOWN
    past = np.stack([deflection[ORDER - 1 - i : -1 - i] for i in range(ORDER)] + [np.ones(len(deflection) - ORDER)])
    usual = np.ones(past.shape[1], np.bool_)
    for _ in range(2):
        fitted = np.linalg.lstsq(past[:, usual].T, deflection[ORDER:][usual], rcond=None)[0]
        rest = deflection[ORDER:] - fitted @ past
        usual = np.abs(rest) <= max(OUTLIER * float(np.median(np.abs(rest))), 1e-12)
    white = dither[ORDER:] - sum(fitted[i] * dither[ORDER - 1 - i : -1 - i] for i in range(ORDER))
    lagged = np.stack([np.concatenate([np.zeros(lag), white[: len(white) - lag]]) for lag in range(shapes.shape[1])])
    answers = shapes @ lagged
    coarse = step * step / 12.0 * (1.0 + float(fitted[:ORDER] @ fitted[:ORDER]))
    shown, _ = gains(rest, answers, coarse)
    shown_usual, certain_usual = gains(rest[usual], answers[:, usual], coarse)
    shown, nothing = np.maximum(shown, shown_usual), np.maximum(ABSENT, NOTHING * certain_usual)
    joint = max(together(rest, lagged, coarse), together(rest[usual], lagged[:, usual], coarse))
    few = np.count_nonzero(~usual) <= RARE * len(usual)
    seen = (LEAST * certain_usual > CERTAIN).all()
    if few and seen and (shown <= nothing).all() and joint <= CHANCE:
        return Verdict.MISSING
    return Verdict.PRESENT if max(float(shown.max()), joint) >= PRESENT else Verdict.UNKNOWN


def together(rest: Array, lagged: Array, coarse: float) -> float:
    """Return by how many standard deviations all delays together explain more than they would of noise.

    A sum of as many squares as there are delays, brought to a normal distribution by its cube root (Wilson and
    Hilferty, 1931).

    Parameters
    ----------
    rest, lagged
        (n,) and (l, n): the dither of each delay.
    coarse
        As for `gains`.
    """
    count, noise = len(lagged), float(rest @ rest) / max(len(rest), 1) + coarse + 1e-24
    cross = lagged @ rest
    weights = np.asarray(np.linalg.lstsq(lagged @ lagged.T, cross, rcond=1e-10)[0], dtype=np.float64)
    explained, spread = max(float(cross @ weights), 0.0) / noise, 2.0 / (9.0 * count)
    return (math.cbrt(explained / count) - 1.0 + spread) / math.sqrt(spread)


def gains(rest: Array, answers: Array, coarse: float) -> tuple[Array, Array]:
    """Return of each answer how many standard errors its gain is large, and a gain of 1, (c,) each.

    Parameters
    ----------
    rest, answers
        (n,) and (c, n).
    coarse
        Variance that the steps of the record add [rad^2].
    """
    noise = math.sqrt(float(rest @ rest) / max(len(rest), 1) + coarse) + 1e-12
    size = np.sqrt(np.einsum("cn,cn->c", answers, answers)) + 1e-15
    return np.abs(answers @ rest) / (noise * size), size / noise
