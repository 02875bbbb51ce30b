"""Progress on stderr: on a terminal a bar, with all that is logged meanwhile above it; elsewhere lines."""

from __future__ import annotations

import os
import sys
import threading
import time
from types import TracebackType
from typing import TextIO

from tqdm import tqdm

SECONDS_PER_LINE = 5.0


class _Above:
    """Puts what anything in the process writes to stderr, libraries in C too, above a bar, line by line.

    Descriptor 2 is a pipe until the end; what runs on and still writes there then is passed on.
    """

    def __init__(self) -> None:
        """Take the descriptor over; the bar is to write to `terminal`."""
        sys.stderr.flush()
        self._place = sys.stderr.fileno()
        self.terminal: TextIO = os.fdopen(os.dup(self._place), "w", encoding=sys.stderr.encoding, errors="replace")
        reading, writing = os.pipe()
        os.dup2(writing, self._place)
        os.close(writing)
        self._reader = threading.Thread(target=self._pass_on, args=(reading,), daemon=True)
        self._reader.start()

    def _pass_on(self, reading: int) -> None:
        with os.fdopen(reading, encoding="utf-8", errors="replace") as lines:
            for line in lines:
                tqdm.write(line.rstrip("\n"), file=self.terminal)
                self.terminal.flush()

    def end(self) -> None:
        """Give the descriptor back, after all that was written to it has been shown."""
        sys.stderr.flush()
        os.dup2(self.terminal.fileno(), self._place)
        self._reader.join(timeout=1.0)


class Progress:
    """Show how far a task is, from 0 to ``total`` units.

    Parameters
    ----------
    label, unit
        As shown.
    total
        Units in all.
    """

    def __init__(self, label: str, total: float, unit: str) -> None:
        """Show the beginning; see the class."""
        self._label, self._total, self._unit = label, total, unit
        self._bar = None
        self._above: _Above | None = None
        self._said = time.monotonic()
        if sys.stderr.isatty():
            self._above = _Above()
            form = "{desc}: {percentage:3.0f} %|{bar}| {n:.1f}/{total:.1f} {unit} [{elapsed}<{remaining}{postfix}]"
            terminal = self._above.terminal
            columns = os.get_terminal_size(terminal.fileno()).columns or None
            self._bar = tqdm(desc=label, total=total, unit=unit, bar_format=form, file=terminal, ncols=columns)

    def show(self, done: float, note: str = "") -> None:
        """Show that ``done`` units are done, and a note beside them."""
        now = time.monotonic()
        if self._bar is not None:
            self._bar.n = min(done, self._total)
            if now - self._said > 0.1:
                self._said = now
                self._bar.set_postfix_str(note)
        elif now - self._said > SECONDS_PER_LINE:
            self._said = now
            about = f", {note}" if note else ""
            print(f"{self._label}: {done:.1f} of {self._total:.1f} {self._unit}{about}", file=sys.stderr, flush=True)

    def __enter__(self) -> Progress:
        """Return itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the bar."""
        if self._bar is not None:
            self._bar.refresh()
            if self._above is not None:
                self._above.end()
            self._bar.close()
