"""Command lines: a wrong one is refused in one line that says what would be right."""

from __future__ import annotations

import argparse
import re
import sys
from typing import Any, NoReturn

from msls_ros.estimation.errors import nearest

_CHOICE = re.compile(r"invalid choice: '(.*)' \(choose from (.*)\)")
_QUOTED = re.compile(r"[\w.-]+")


class OneLineParser(argparse.ArgumentParser):
    """Says what is wrong with the command line in one line; an option is written out, never abbreviated."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        """As `argparse.ArgumentParser`; an epilog that is a function is called when help is asked for."""
        super().__init__(*arguments, **{"allow_abbrev": False, **options})

    def format_help(self) -> str:
        """Return the help."""
        if callable(self.epilog):
            self.epilog = self.epilog()
        return super().format_help()

    def error(self, message: str) -> NoReturn:
        """Print the message without the usage, and exit with 2."""
        _, unknown, rest = message.partition("unrecognized arguments: ")
        near = nearest(rest.split("=")[0].split()[0], self._option_string_actions) if unknown and rest else ""
        choice = _CHOICE.search(message)
        if choice is not None:
            near = nearest(choice[1], _QUOTED.findall(choice[2]))
        self.exit(2, f"{self.prog}: {message}{near}; see --help\n")


def count(text: str) -> int:
    """Return a whole number from 1."""
    return _whole(text, 1, None, "count")


def seed(text: str) -> int:
    """Return a whole number from 0 that fits a 32-bit seed."""
    return _whole(text, 0, 2**31 - 1, "seed")


def add_fleet(parser: argparse.ArgumentParser) -> None:
    """Add `--jobs` and `--scheduler`, of which one at most may be given; see `msls_ros.fleet.run`."""
    group = parser.add_mutually_exclusive_group()
    group.add_argument("--jobs", type=count, default=1, metavar="N", help="number of parallel processes (default: 1)")
    group.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="run on the workers of this Dask scheduler (tcp://HOST:PORT, or tls://HOST:PORT with Dask's own settings "
        "for TLS); files have the same paths there. Trust it: whoever reaches its port can run any code on its workers "
        "and here (pickle)",
    )


def print_text(text: str) -> None:
    """Print on stdout; what its encoding lacks (a file name of other bytes) is escaped."""
    encoding = sys.stdout.encoding or "utf-8"
    print(text.encode(encoding, "backslashreplace").decode(encoding))


def _whole(text: str, low: int, high: int | None, what: str) -> int:
    if not (text.isascii() and text.isdigit()) or int(text) < low or (high is not None and int(text) > high):
        limits = f"from {low}" if high is None else f"from {low} to {high}"
        message = f"{text!r} is not a {what}; expected a whole number {limits}"
        raise argparse.ArgumentTypeError(message)
    return int(text)
