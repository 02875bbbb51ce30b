"""One decorator for the numerical kernels: compiled where numba is installed, interpreted where it is not.

The kernels are explicit loops over float64 with `math.sqrt` only: no BLAS, no fastmath, no reassociated sums. Compiled
and interpreted they give the same bits. Compiled code is cached on disk. An entry of numba's cache knows its own source
file only and would survive an edit of a function that it calls, so the cache folder carries a hash of all sources of
the room; and nothing else, so that other clones of the same sources compile nothing.

Kernels write into arrays that they are given and allocate none, so they are compiled without numba's run time for
memory: it would count the references to every array of a state at every call of a helper, with atomic operations, which
takes four times as long as the arithmetic. A kernel that allocates does not compile.

Numba is imported when the first kernel runs: programs that run none start two seconds earlier.
"""

from __future__ import annotations

import contextlib
import fcntl
import functools
import gc
import hashlib
import inspect
import os
import shutil
import tempfile
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from importlib import import_module, metadata
from importlib.util import find_spec
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

P = ParamSpec("P")
T = TypeVar("T")

HAVE_NUMBA = find_spec("numba") is not None and not os.environ.get("NUMBA_DISABLE_JIT", "0").strip("0")

OPTIONS: dict[str, Any] = {"cache": True, "fastmath": False, "error_model": "numpy", "forceinline": True, "_nrt": False}

INTERPRETED_SAMPLE, INTERPRETED_STEP = 1.6e-4, 3.1e-7
"""What a sample costs interpreted, beside and per multiply-add [s]; CPython 3.11 on a server of 2025."""

KERNELS: list[Kernel] = []
"""Every compiled kernel of the room; empty where the kernels are interpreted."""

RECORDS: list[type] = []
"""Classes of named tuples that kernels take by reference, of which numba does not know yet."""

VERSIONS = 6
"""Of a room's kernels on disk, some 10 MB each: clones of different versions live side by side."""

_warned = False


class Locator:
    """Tells numba where a kernel is kept: by what its room's sources are, not where, so that clones of a version share.

    What numba asks of the classes named in its setting ``CACHE_LOCATOR_CLASSES``. Files appear there whole, by
    renaming, so several processes may compile at once.

    Parameters
    ----------
    function, file
        The kernel, and the file that it is in.
    """

    def __init__(self, function: Any, file: str) -> None:
        """Note where; see the class."""
        self._line, self._py_file = function.__code__.co_firstlineno, file
        self._folder = _cache_folder(_room_of(file))

    @classmethod
    def from_function(cls, function: Any, file: str) -> Locator | None:
        """Return the place of a kernel; None where no folder can be written, then it is compiled in each process."""
        if not os.path.exists(file):
            return None
        found = cls(function, file)
        try:
            found.ensure_cache_path()
        except OSError:
            return None
        return found

    def ensure_cache_path(self) -> None:
        """Make the folder and see that it can be written; of older versions only the last few are kept beside it.

        Raises
        ------
        OSError
            If not.
        """
        if not self._folder.exists():
            prune(self._folder)
            self._folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=self._folder).close()

    def get_cache_path(self) -> str:
        """Return the folder."""
        return str(self._folder)

    def get_source_stamp(self) -> str:
        """Return what a change of the sources changes: the folder's name."""
        return self._folder.name

    def get_disambiguator(self) -> str:
        """Return what tells kernels of one name, in files of one name, apart: the file's folder and the first line."""
        return f"{Path(self._py_file).parent.name}{self._line}"


class Kernel:
    """A function that is compiled when it is first called, for Python and for other kernels apart.

    A kernel that takes a state of fifty arrays needs more code to unpack them from Python's objects than for the
    arithmetic. The kernels that Python never calls, most of them, are not compiled with it: half of the time.

    Parameters
    ----------
    function
        As it is interpreted.
    options
        For ``numba.njit``.
    """

    def __init__(self, function: Callable[..., Any], options: Mapping[str, Any]) -> None:
        """Take it; see the class."""
        functools.update_wrapper(self, function)
        self._function = function
        self._options = {**options, "no_cfunc_wrapper": True}

    def __call__(self, *arguments: Any) -> Any:
        """Run it, compiled for these types of arguments."""
        return self.dispatcher(*arguments)

    @functools.cached_property
    def dispatcher(self) -> Any:
        """What Python calls: of numba; it is kept on disk, with all that it calls."""
        changes = {"CACHE_LOCATOR_CLASSES": f"{__name__}.{Locator.__name__}"}
        if not hasattr(_numba().config, "CACHE_LOCATOR_CLASSES"):  # numba before 0.62: clones do not share
            changes = {"CACHE_DIR": str(_cache_folder(_room_of(inspect.getfile(self._function))))}
        options = {**self._options, "forceinline": False}  # into its wrapper: it would be compiled twice
        with _settings(changes):
            try:
                made: Any = _numba().njit(**options)(self._function)
            except RuntimeError:  # numba: "no locator available"
                made = _numba().njit(**{**options, "cache": False})(self._function)
        made.compile = functools.partial(_compile, self._function, made.compile)
        return made

    @functools.cached_property
    def inlined(self) -> Any:
        """What other kernels call: of numba, part of them."""
        return _numba().njit(**{**self._options, "cache": False, "no_cpython_wrapper": True})(self._function)

    @property
    def _numba_type_(self) -> Any:
        """What numba takes a kernel for that it meets in another one."""
        return _numba().types.Dispatcher(self.inlined)

    def version(self, arguments: Iterable[Any]) -> Callable[..., Any]:
        """Return what takes arguments of these types, and no others."""
        found: Callable[..., Any] = self.dispatcher.compile(tuple(map(_numba().typeof, arguments)))
        return found

    @property
    def versions(self) -> int:
        """How many have been compiled or loaded."""
        made = [vars(self)[name] for name in ("dispatcher", "inlined") if name in vars(self)]
        return sum(len(one.signatures) for one in made)


def compiled(function: Callable[P, T]) -> Callable[P, T]:
    """Compile a kernel with numba: no fastmath, no allocation; without numba return it as it is."""
    if not HAVE_NUMBA:
        return function
    kernel = Kernel(function, OPTIONS)
    KERNELS.append(kernel)
    return cast(Callable[P, T], kernel)


def passed_by_reference(record: type[T]) -> type[T]:
    """Have kernels take the named tuples of a class as one address: see `by_reference`."""
    RECORDS.append(record)
    return record


def _compile(function: Callable[..., Any], whole: Callable[[Any], Any], signature: Any) -> Any:
    """Compile one version of a kernel, with all that it calls, or load it: numba does, here in two thirds of the time.

    LLVM's third level of optimisation takes longer than its first and code that is no faster comes of it; and of the
    objects that make millions of references to each other until the end, Python's collector frees none.
    """
    config: Any = _numba().config
    collects = gc.isenabled()
    gc.disable()
    try:
        with _turn(function), _settings({} if "NUMBA_OPT" in os.environ else {"OPT": type(config.OPT)(1)}):
            return whole(signature)
    finally:
        if collects:
            gc.enable()


@contextlib.contextmanager
def _turn(function: Callable[..., Any]) -> Iterator[None]:
    """Wait while another process compiles this kernel: it will be loaded then."""
    try:
        folder = _cache_folder(_room_of(inspect.getfile(function)))
        turn = os.open(folder / f"{function.__name__}.turn", os.O_RDWR | os.O_CREAT, 0o666)
    except (OSError, RuntimeError):  # nothing is kept: there is nothing to wait for
        yield
        return
    try:
        with contextlib.suppress(OSError):  # a file system without locks
            fcntl.flock(turn, fcntl.LOCK_EX)
        yield
    finally:
        os.close(turn)


@contextlib.contextmanager
def _settings(changes: Mapping[str, Any]) -> Iterator[None]:
    """Have numba's configuration changed for a while."""
    config = vars(_numba().config)
    before = {name: config[name] for name in changes}
    config.update(changes)
    try:
        yield
    finally:
        config.update(before)


def _numba() -> Any:
    numba = import_module("numba")
    while RECORDS:
        import_module("msls_ros.estimation.by_reference").register(RECORDS.pop())
    return numba


class Bound:
    """A kernel that is called with arguments of the same types again and again.

    Numba looks into all arrays of all named tuples at every call to find the version of the kernel, which takes longer
    than a sample; here it does so at the first call. Who calls sees to it that arrays are contiguous and of one type.

    Parameters
    ----------
    kernel
        From `compiled`.
    """

    def __init__(self, kernel: Callable[..., Any]) -> None:
        """Take it; see the class."""
        self._kernel: Any = kernel
        self._version: Any = None

    def __call__(self, *arguments: Any) -> Any:
        """Call it; after the first call without a look at the types."""
        if self._version is None:
            self._version = self._kernel.version(arguments) if isinstance(self._kernel, Kernel) else self._kernel
        return self._version(*arguments)


def prune(folder: Path) -> None:
    """Remove the kernels of versions of this room that are to make room for a new one: all but the `VERSIONS` newest.

    Whoever still runs one of them has it in memory.
    """
    room = folder.name.rpartition("-")[0]
    others = [one for one in folder.parent.glob(f"{room}-*") if one != folder and one.is_dir()]
    dated = []
    for one in others:
        try:
            dated.append((one.stat().st_mtime, one))
        except OSError:  # another process removes it
            continue
    for _, one in sorted(dated, reverse=True)[VERSIONS - 1 :]:
        shutil.rmtree(one, ignore_errors=True)


def _room_of(file: str) -> Path:
    """Return the folder of the room that a file is in; of this one also where it is in a folder of it."""
    here, folder = Path(__file__).parent, Path(file).parent
    return here if here in folder.parents else folder


@functools.cache
def _cache_folder(room: Path) -> Path:
    """Return the folder of a room's kernels: in numba's own setting, else the user's cache, by hash of the sources.

    A kernel may call those of its own room and of this one.
    """
    digest = hashlib.sha256(f"{metadata.version('numba')} {metadata.version('llvmlite')}".encode())
    for folder in (Path(__file__).parent, room):
        for source in sorted(folder.rglob("*.py")):
            name = source.relative_to(folder).as_posix()
            digest.update(name.encode() + b"\0" + source.read_bytes() + b"\0")
    base = _numba().config.CACHE_DIR or os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "msls_ros" / f"{room.name}-{digest.hexdigest()[:16]}"


def kept_note(name: str) -> Path | None:
    """Return the place of a note beside the kernels of this room; None where there is no folder for them."""
    try:
        return _cache_folder(Path(__file__).parent) / name
    except RuntimeError:  # no home
        return None


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
