"""Time per update, one thread: ours in a compiled loop and per call, plain C as the limit, and the peers of Python.

Repeats are interleaved (every contender once per round), so that what else runs on the machine hits all alike; the
fastest round counts, the median is given beside it.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers import OURS, PEERS
from benchmarks.plain_c import CompileError, PlainC, build
from msls_ros.estimation import MSLS
from msls_ros.estimation.compiled import compiled
from msls_ros.estimation.kernel import Work, msls_gain
from msls_ros.estimation.msls import allocate, msls_update, unpack

Array = NDArray[np.float64]
SIZES = ((17, 9), (8, 3))
FORGETTING = 0.98
W0 = 0.01
LOOP, CALLS = 4000, 400
PLAIN_C = "plain C, cc -O3"
COMPILED = "msls_ros MSLS, compiled loop"
GAIN = "msls_ros MSLS, compiled loop, no error bars"
AGREEMENT = 1e-10


class MismatchError(Exception):
    """Plain C and ours do not compute the same gain, so their times cannot be compared."""


@compiled
def run_updates(memory: Array, squares: Array, phi: Array, y: Array, e: Array, forgetting: float) -> None:
    """Take all samples with the complete update."""
    for n in range(phi.shape[0]):
        msls_update(memory, squares, phi[n], y[n], e, forgetting, True)


@compiled
def run_gains(
    R: Array, omega: Array, w0: Array, theta: Array, phi: Array, y: Array, forgetting: float, work: Work
) -> None:
    """Take all samples with what plain C does: factor, gain, rows."""
    for n in range(phi.shape[0]):
        msls_gain(R, omega, phi[n], w0, 1.0, forgetting, True, work)
        for q in range(theta.shape[0]):
            error = y[n, q]
            for i in range(theta.shape[1]):
                error -= theta[q, i] * phi[n, i]
            for i in range(theta.shape[1]):
                theta[q, i] += work.K[i] * error


@dataclass
class Contender:
    """One row of the table."""

    name: str
    does: str
    samples: int
    run: Callable[[], Any] | None
    """Take that many samples; None: not available."""
    note: str = ""
    times: list[float] = field(default_factory=list)


def measure(p: int, rows: int, rounds: int) -> list[dict[str, Any]]:
    """Time all contenders at one size.

    Parameters
    ----------
    p, rows
        Regressors and rows.
    rounds
        How often each is timed.

    Returns
    -------
    list of dict
        Per contender: name, does, us (fastest), us_median, to_plain_c, to_ours, note.

    Raises
    ------
    MismatchError
        If plain C and ours disagree.
    """
    rng = np.random.default_rng(0)
    phi = rng.normal(size=(LOOP, p))
    y = phi @ rng.normal(size=(p, rows)) + 0.1 * rng.normal(size=(LOOP, rows))
    contenders = [*_loops(phi, y), *_calls(phi, y)]
    with np.errstate(all="ignore"):
        for number in range(rounds + 1):
            for contender in contenders:
                if contender.run is not None:
                    start = time.perf_counter()
                    contender.run()
                    elapsed = (time.perf_counter() - start) / contender.samples * 1e6
                    if number > 0:
                        contender.times.append(elapsed)
    return _table(contenders)


def _loops(phi: Array, y: Array) -> list[Contender]:
    """Return what runs over the whole array: plain C and ours, after checking that they agree."""
    (n, p), rows = phi.shape, y.shape[1]
    e, squares, memory = np.zeros(rows), np.zeros(rows + 1), allocate(p, rows)
    parts = unpack(memory)
    parts.w0[:] = W0
    bare = unpack(allocate(p, rows))
    bare.w0[:] = W0
    does = f"factor, gain, {rows} rows"
    found = [
        Contender(COMPILED, f"{does}, error bars", n, lambda: run_updates(memory, squares, phi, y, e, FORGETTING)),
        Contender(
            GAIN,
            does,
            n,
            lambda: run_gains(bare.R, bare.omega, bare.w0, bare.theta, phi, y, FORGETTING, bare.work),
        ),
    ]
    try:
        plain = PlainC(build(), p, rows, FORGETTING, W0)
    except CompileError as error:
        return [Contender(PLAIN_C, does, n, None, str(error)), *found]
    ours = MSLS(p, rows, FORGETTING, W0)
    check_agreement(plain, ours, phi[:300], y[:300])
    return [Contender(PLAIN_C, does, n, lambda: plain.run(phi, y)), *found]


def check_agreement(plain: PlainC, ours: MSLS, phi: Array, y: Array) -> None:
    """Refuse to compare times where gains or estimates differ by more than 1e-10 of the largest.

    Raises
    ------
    MismatchError
        With the difference.
    """
    plain.run(phi, y)
    for x, out in zip(phi, y, strict=True):
        ours.update(x, out)
    for what, a, b in (("gain", plain.K, ours.gain), ("estimates", plain.theta, ours.theta)):
        difference = float(np.abs(a - b).max() / np.abs(b).max())
        if not difference <= AGREEMENT:
            message = f"the {what} of plain C and ours differ by {difference:.1e}; expected at most {AGREEMENT:.0e}"
            raise MismatchError(message)


def _calls(phi: Array, y: Array) -> list[Contender]:
    """Return what is called once per sample from Python."""
    p, rows = phi.shape[1], y.shape[1]
    samples = list(zip(phi[:CALLS], y[:CALLS], strict=True))
    found = []
    for name, peer in PEERS.items():
        try:
            update = peer.make(p, rows, FORGETTING, W0).update
        except ImportError as error:
            found.append(Contender(name, peer.does, CALLS, None, f"cannot be imported: {error}"))
            continue

        def run(update: Callable[[Array, Array], Any] = update) -> None:
            for x, out in samples:
                update(x, out)

        found.append(Contender(f"{name}, per call", peer.does, CALLS, run))
    return found


def _table(contenders: list[Contender]) -> list[dict[str, Any]]:
    fastest = {one.name: min(one.times) for one in contenders if one.times}
    limit, ours = fastest.get(PLAIN_C), fastest[f"{OURS}, per call"]
    rows = []
    for one in contenders:
        us = fastest.get(one.name)
        rows.append(
            {
                "name": one.name,
                "does": one.does,
                "us": us,
                "us_median": statistics.median(one.times) if one.times else None,
                "to_plain_c": us / limit if us and limit else None,
                "to_ours_per_call": us / ours if us else None,
                "note": one.note,
            }
        )
    return rows
