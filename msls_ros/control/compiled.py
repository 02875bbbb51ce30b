"""The decorator of this room's kernels: as that of `estimation`, with a cache that knows this room's sources."""

from __future__ import annotations

import functools
import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from msls_ros.estimation.compiled import HAVE_NUMBA

P = ParamSpec("P")
T = TypeVar("T")

OPTIONS: dict[str, Any] = {"cache": True, "fastmath": False, "error_model": "numpy", "_nrt": False}


def compiled(function: Callable[P, T]) -> Callable[P, T]:
    """Compile a kernel with numba: no fastmath, no allocation; without numba return it as it is."""
    if not HAVE_NUMBA:
        return function
    import numba

    settings: Any = numba.config
    before = settings.CACHE_DIR
    settings.CACHE_DIR = _cache_folder()
    try:
        with_cache: Callable[P, T] = numba.njit(**OPTIONS)(function)
    except RuntimeError:  # numba: "no locator available"
        without: Callable[P, T] = numba.njit(**{**OPTIONS, "cache": False})(function)
        return without
    finally:
        settings.CACHE_DIR = before
    return with_cache


@functools.cache
def _cache_folder() -> str:
    import numba

    digest = hashlib.sha256()
    for source in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(source.read_bytes())
    settings: Any = numba.config
    base = settings.CACHE_DIR or os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return str(Path(base) / "msls_ros" / f"control-{digest.hexdigest()[:16]}")
