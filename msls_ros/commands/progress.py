"""Progress on stderr: a bar on a terminal, a line now and then elsewhere."""

from __future__ import annotations

import sys
import time
from types import TracebackType

from tqdm import tqdm

SECONDS_PER_LINE = 5.0


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
        self._said = time.monotonic()
        if sys.stderr.isatty():
            form = "{desc}: {percentage:3.0f} %|{bar}| {n:.1f}/{total:.1f} {unit} [{elapsed}<{remaining}{postfix}]"
            self._bar = tqdm(desc=label, total=total, unit=unit, bar_format=form, file=sys.stderr, leave=True)

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
            self._bar.close()
