"""The plain C MSLS, compiled with the machine's compiler and called on whole arrays."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
SOURCE = Path(__file__).with_name("msls.c")
FLAGS = ["-O3", "-shared", "-fPIC"]


class CompileError(Exception):
    """There is no C compiler, or it refuses the source."""


def build() -> ctypes.CDLL:
    """Compile `msls.c` and load it.

    Raises
    ------
    CompileError
        With the compiler's name and what it said.
    """
    compiler = os.environ.get("CC") or "cc"
    if shutil.which(compiler.split()[0]) is None:
        message = f"no C compiler '{compiler}'"
        raise CompileError(message)
    with tempfile.TemporaryDirectory() as folder:
        library = Path(folder) / "libmsls.so"
        command = [*compiler.split(), *FLAGS, str(SOURCE), "-o", str(library), "-lm"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            message = f"'{' '.join(command)}' failed: {done.stderr.strip()}"
            raise CompileError(message)
        return ctypes.CDLL(str(library))


class PlainC:
    """State of one MSLS in C: p regressors, r rows.

    Parameters
    ----------
    library
        From `build`.
    p, rows
        Sizes.
    forgetting
        Forgetting factor lambda [1].
    w0
        Penalty W0, the same for all regressors.
    """

    def __init__(self, library: ctypes.CDLL, p: int, rows: int, forgetting: float, w0: float) -> None:
        """Start with no data and zero estimates; see the class."""
        self._run = library.msls_run
        self._run.restype = None
        self._forgetting = ctypes.c_double(forgetting)
        self._w0, self._factor = np.full(p, w0), np.zeros((p + 1, p))
        self._work = np.zeros((p + 1, p + 1))
        self.theta, self.K = np.zeros((rows, p)), np.zeros(p)

    def run(self, phi: Array, y: Array) -> None:
        """Take all samples: phi (n, p) and y (n, r), C-contiguous."""
        arrays = (self._factor, self.theta, phi, y, self._w0)
        pointers = [ctypes.c_void_p(array.ctypes.data) for array in arrays]
        sizes = [ctypes.c_int(size) for size in (len(phi), *reversed(self.theta.shape))]
        last = [ctypes.c_void_p(array.ctypes.data) for array in (self.K, self._work)]
        self._run(*sizes, *pointers, self._forgetting, *last)
