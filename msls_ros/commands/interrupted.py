"""Ctrl-C and SIGTERM of a command that flies many flights: known of even where compiled code swallows the exception."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager


class Interrupted:
    """Whether Ctrl-C or a SIGTERM came; compiled code may swallow the exception, and fail in ways of its own."""

    def __init__(self) -> None:
        self.came = self._held = False

    def __bool__(self) -> bool:
        """Whether it was."""
        return self.came

    @contextmanager
    def watched(self) -> Iterator[None]:
        """Watch."""

        def note(number: int, frame: object) -> None:
            self.came = True
            if not self._held:
                raise KeyboardInterrupt

        def swallow(what: sys.UnraisableHookArgs) -> None:
            if not (self.came and isinstance(what.exc_value, KeyboardInterrupt)):
                sys.__unraisablehook__(what)

        before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
        sys.unraisablehook = swallow  # where it comes in a destructor or callback, it cannot be raised
        try:
            yield
        finally:
            sys.unraisablehook = sys.__unraisablehook__
            for number, handler in before.items():
                signal.signal(number, handler)

    @contextmanager
    def held(self) -> Iterator[None]:
        """Do something whole before the exception comes, such as what other processes or threads have part in."""
        before, self._held = self._held, True
        try:
            yield
        finally:
            self._held = before
        if self.came and not self._held:
            raise KeyboardInterrupt
