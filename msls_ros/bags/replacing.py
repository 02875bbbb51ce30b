"""A bag in the place of another: the old one goes only when the new one is whole."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import mkdtemp

from msls_ros.bags.errors import BagError
from msls_ros.bags.writer import check_replaceable, remove_bag


@contextmanager
def replacing(path: Path) -> Iterator[tuple[Path, Callable[[], None]]]:
    """Give a folder to write a bag into, and what to call when it is to take its place.

    Parameters
    ----------
    path : Path
        Where the bag is to stand.

    Yields
    ------
    tuple of Path and callable
        `path` itself where nothing is there: what is written stays, whatever happens. Else a folder beside it, which
        takes its place when the callable is called, and goes otherwise.

    Raises
    ------
    BagError
        The folder cannot be written, or what is there is more than a bag.

    Notes
    -----
    A kill in between leaves the old bag, and the new one as far as it got in a folder `.NAME.draft-...`.
    """
    if not path.is_dir() or path.is_symlink():
        yield path, lambda: None
        return
    check_replaceable(path)
    name = path.resolve().name
    try:
        draft = Path(mkdtemp(prefix=f".{name}.draft-", dir=path.resolve().parent))
    except OSError as error:
        msg = f"{path}: cannot be replaced: {error.strerror or error}"
        raise BagError(msg) from error
    old, new = draft / f"{name}.earlier", draft / name

    def take_place() -> None:
        try:
            os.rename(path, old)
            os.rename(new, path)
        except OSError as error:
            if old.exists() and not path.exists():
                os.rename(old, path)
            msg = f"{path}: cannot be replaced: {error.strerror or error}"
            raise BagError(msg) from error

    try:
        yield new, take_place
    finally:
        for bag in (old, new):
            if bag.is_dir():
                remove_bag(bag)
        draft.rmdir()
