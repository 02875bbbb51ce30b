"""Compile every kernel before the first sample: later it would be a pause in flight, the longest at the first alarm.

Kernels are compiled by the types of their arguments, which no parameter changes. So a small made-up aircraft is flown
through all that can happen (samples one by one and in blocks, an alarm, isolation, recovery, gusts, a warm start), with
the estimator that is asked for, and after it nothing is left to compile for any other aircraft.

Once on a machine this takes minutes, then it is kept: who waits is told how long by `warm_up`, and beforehand by
`is_kept` that there will be something to wait for.
"""

from __future__ import annotations

import contextlib
import functools
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from msls_ros.estimation.compiled import HAVE_NUMBA, KERNELS, kept_note
from msls_ros.estimation.configuration import Configuration, from_mapping
from msls_ros.estimation.identifier import Identifier
from msls_ros.estimation.kernel import Array

SAMPLES = 260
CHANGE = 120
"""Sample at which the aircraft is damaged."""
EVERY = 30.0
"""Between two reports of how long it takes [s]."""


def warm_up(method: str, say: Callable[[float], None] | None = None) -> float:
    """Compile what is not compiled yet, once per process and estimator.

    Parameters
    ----------
    method
        Of the estimator: bank, msls or rls.
    say
        Called with the time so far [s] every `EVERY` s, from another thread.

    Returns
    -------
    float
        How long it took, then [s].
    """
    start, done = time.perf_counter(), threading.Event()

    def report() -> None:
        while say is not None and not done.wait(EVERY):
            say(time.perf_counter() - start)

    thread = threading.Thread(target=report, daemon=True)
    thread.start()
    try:
        return compile_all(method)
    finally:
        done.set()
        thread.join()


@functools.cache
def compile_all(method: str) -> float:
    """Fly through all that can happen with an estimator; see `warm_up`."""
    start = time.perf_counter()
    for coloured in (True, False) if method == "msls" else (True,):
        _fly(_configuration(method, coloured))
    if (note := kept_note(_note(method))) is not None:
        with contextlib.suppress(OSError):
            note.touch()
    return time.perf_counter() - start


def is_kept(method: str) -> bool:
    """Whether a warm-up of this estimator was completed on this machine: then kernels are loaded, not compiled."""
    return not HAVE_NUMBA or ((note := kept_note(_note(method))) is not None and note.exists())


def _note(method: str) -> str:
    return f"complete-{method}-{sys.implementation.cache_tag}"


def count_compiled() -> int:
    """Return how many versions of kernels have been compiled or loaded so far."""
    return sum(kernel.versions for kernel in KERNELS)


def _configuration(method: str, coloured: bool) -> Configuration:
    return from_mapping(
        {
            "states": ("u", "w", "Q", "Phi", "Theta"),
            "effectors": ("de", "dr"),
            "estimator": {"method": method, "forgetting_factor": 0.9},
            "reliability": {"coloured": coloured},
            "isolation": {"significance": 1.0, "explained": 0.1, "largest_error": 10.0},
        }
    )


def _fly(configuration: Configuration) -> None:
    """Fly straight with random deflections, lose an effector, and meet gusts at the end."""
    random = np.random.Generator(np.random.PCG64(0))
    n, m, step = len(configuration.states), len(configuration.effectors), 1.0 / configuration.sample_rate
    delta: Array = random.standard_normal((SAMPLES, m)) * 0.1
    x: Array = random.standard_normal((SAMPLES, n)) * 0.1 + np.array([100.0, 1.0, 0.0, 0.0, 0.1])
    x[-60:, 1] += np.cumsum(random.standard_normal(60))
    b = np.zeros((n, m))
    b[:3] = [[1.0, 0.2], [-5.0, 0.5], [-3.0, 1.0]]
    clean: Any = -0.5 * x + delta @ b.T
    xdot = clean + random.standard_normal((SAMPLES, n)) * 1e-3
    xdot[CHANGE:] = (-0.5 * x + delta @ (b * [0.1, 1.0]).T)[CHANGE:]
    t: Any = np.arange(SAMPLES) * step
    identifier = Identifier(configuration)
    for k in range(SAMPLES):
        identifier.update(float(t[k]), x[k], xdot[k], delta[k])
    identifier.configure({"dither.seed": configuration.dither.seed})
    identifier.reset()
    identifier.follow(configuration.rows[0], configuration.effectors[0])
    identifier.run(t, x, xdot, delta, 7)
    identifier.enabled = False
    identifier.learn(float(t[-1]) + step, x[-1], xdot[-1], delta[-1])
    identifier.enabled = True
    identifier.warm_start(np.zeros((n, n)), b, np.zeros(n), identifier.covariance, x[0], delta[0])
    identifier.update(float(t[0]), x[0], xdot[0], delta[0])
