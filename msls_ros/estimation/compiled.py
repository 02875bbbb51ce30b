"""One decorator for the numerical kernels: compiled where numba is installed, interpreted where it is not.

The kernels are explicit loops over float64 with `math.sqrt` only: no BLAS, no fastmath, no reassociated sums. Compiled
and interpreted they give the same bits. Compiled code is cached on disk. An entry of numba's cache knows its own source
file only and would survive an edit of a function that it calls, so the cache folder carries a hash of all sources of
the room.

Kernels write into arrays that they are given and allocate none, so they are compiled without numba's run time for
memory: it would count the references to every array of a state at every call of a helper, with atomic operations, which
takes four times as long as the arithmetic. A kernel that allocates does not compile.
"""

from __future__ import annotations

import functools
import hashlib
import os
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")

try:
    import numba

    numba_config: Any = numba.config
    HAVE_NUMBA = not numba_config.DISABLE_JIT
except ImportError:
    HAVE_NUMBA = False

OPTIONS: dict[str, Any] = {"cache": True, "fastmath": False, "error_model": "numpy", "forceinline": True, "_nrt": False}

INTERPRETED_SAMPLE, INTERPRETED_STEP = 1.6e-4, 3.1e-7
"""What a sample costs interpreted, beside and per multiply-add [s]; CPython 3.11 on a server of 2025."""

KERNELS: list[Any] = []
"""Every compiled kernel of the room; empty where the kernels are interpreted."""

_warned = False


def compiled(function: Callable[P, T]) -> Callable[P, T]:
    """Compile a kernel with numba: no fastmath, no allocation; without numba return it as it is."""
    if not HAVE_NUMBA:
        return function
    before = numba_config.CACHE_DIR
    numba_config.CACHE_DIR = _cache_folder()
    try:
        compiled_function: Callable[P, T] = _cached(function)
    finally:
        numba_config.CACHE_DIR = before
    KERNELS.append(compiled_function)
    return compiled_function


def _cached(function: Callable[P, T]) -> Callable[P, T]:
    """Compile with a cache on disk; without one where no folder can be written."""
    try:
        with_cache: Callable[P, T] = numba.njit(**OPTIONS)(function)
    except RuntimeError:  # numba: "no locator available"
        without: Callable[P, T] = numba.njit(**{**OPTIONS, "cache": False})(function)
        return without
    return with_cache


@functools.cache
def _cache_folder() -> str:
    """Return the folder of the compiled kernels: numba's own setting, else the user's cache, by hash of the sources."""
    digest = hashlib.sha256()
    for source in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(source.read_bytes())
    base = numba_config.CACHE_DIR or os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return str(Path(base) / "msls_ros" / digest.hexdigest()[:16])


def warn_if_interpreted(regressors: int, rows: int, colours: int) -> None:
    """Say once, where numba is missing, what sample rate the interpreted kernels hold.

    Parameters
    ----------
    regressors, rows, colours
        Size of the problem; colours of the residual for which the covariance is propagated.
    """
    global _warned
    if HAVE_NUMBA or _warned:
        return
    _warned = True
    p = regressors
    steps = p**3 / 2 + (3 + 2 * colours) * p**2 + 4 * rows * p
    rate = 1.0 / (INTERPRETED_SAMPLE + INTERPRETED_STEP * steps)
    warnings.warn(
        f"numba is not active: the estimator runs interpreted (same numbers), about {rate:.0f} samples per second "
        f"for {regressors} regressors and {rows} rows; with numba it is some 40 times faster sample by sample, and "
        "some 500 times on arrays",
        RuntimeWarning,
        stacklevel=3,
    )
