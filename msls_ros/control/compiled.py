"""The decorator of this room's kernels: as that of `estimation`, without inlining into the caller."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar, cast

from msls_ros.estimation.compiled import HAVE_NUMBA, Kernel

P = ParamSpec("P")
T = TypeVar("T")

OPTIONS: dict[str, Any] = {"cache": True, "fastmath": False, "error_model": "numpy", "_nrt": False}


def compiled(function: Callable[P, T]) -> Callable[P, T]:
    """Compile a kernel with numba: no fastmath, no allocation; without numba return it as it is."""
    return cast(Callable[P, T], Kernel(function, OPTIONS)) if HAVE_NUMBA else function
