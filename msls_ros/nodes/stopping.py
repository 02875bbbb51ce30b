"""SIGINT and SIGTERM to a node: never lost, no traceback, and time to say goodbye.

The signals are noted at once by a thread, whatever the main thread is busy with (an import, a compiler, a wait for
messages). While the node starts, nothing has been said that would need taking back: the process ends there and then
with exit code 0. Once it runs, whoever waits is woken and ends in order. Who does not within `PATIENCE`, in a
middleware that waits for itself, say, ends with exit code 1, and stderr has the stacks of all threads.
"""

from __future__ import annotations

import faulthandler
import os
import signal
import sys
import threading
from collections.abc import Callable
from types import TracebackType

SIGNALS = (signal.SIGINT, signal.SIGTERM)
PATIENCE = 30.0
"""Wall clock that a node has to end after the first signal [s]; a goodbye and the end of a bag take far less."""


class Stopping:
    """A context manager in which both signals mean `asked`; to be entered by the main thread, before slow imports."""

    def __init__(self) -> None:
        """Change nothing yet; see the class."""
        self.asked = False
        """Whether a signal has come."""
        self._wake: Callable[[], object] | None = None

    def __enter__(self) -> Stopping:
        """Take the signals."""
        self._read, self._write = os.pipe()
        os.set_blocking(self._write, False)
        self._handlers = {s: signal.signal(s, lambda *_: None) for s in SIGNALS}
        self._fd = signal.set_wakeup_fd(self._write, warn_on_full_buffer=False)
        threading.Thread(target=self._listen, name="signals", daemon=True).start()
        signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)  # who starts us may hold them back until here
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Give them back; after one has come further ones are ignored, the process is ending."""
        if self.asked:
            faulthandler.cancel_dump_traceback_later()
        signal.set_wakeup_fd(self._fd)
        for number, handler in self._handlers.items():
            signal.signal(number, signal.SIG_IGN if self.asked else handler)
        os.close(self._write)

    def end(self, code: int) -> int:
        """End the process with an exit code, now, where a signal has come; else return it.

        Everything is given back by then, and to take the interpreter and its compiler apart would cost 0.2 s of a core.
        """
        if self.asked:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code)
        return code

    def wake_with(self, wake: Callable[[], object]) -> None:
        """From now on a signal calls ``wake``, from another thread, instead of ending the process."""
        self._wake = wake

    def _listen(self) -> None:
        while number := os.read(self._read, 1):
            if number[0] in SIGNALS:
                if self._wake is None:
                    os._exit(0)
                if not self.asked and sys.__stderr__ is not None:
                    # From a thread that needs no lock of the interpreter.
                    faulthandler.dump_traceback_later(PATIENCE, exit=True, file=sys.__stderr__)
                self.asked = True
                self._wake()
        os.close(self._read)
