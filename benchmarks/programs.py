"""The executables as processes of their own."""

from __future__ import annotations

import sys


def program(name: str) -> list[str]:
    """Return the command that starts one of the executables of `msls_ros.commands`; its arguments go behind it."""
    return [sys.executable, "-c", f"import sys; from msls_ros.commands.{name} import main; sys.exit(main())"]
