"""Classes of messages, found by the name of their type."""

from __future__ import annotations

import importlib
import os
from typing import Any

from msls_ros.nodes.parameters import NodeError


def message_class(msgtype: str) -> type[Any]:
    """Return the class of a type, ``PACKAGE/msg/NAME``.

    Raises
    ------
    NodeError
        If it is not installed here.
    """
    try:
        package, _, name = msgtype.split("/")
        found: type[Any] = getattr(importlib.import_module(f"{package}.msg"), name)
    except ValueError:
        message = f"'{msgtype}' is not a type; expected PACKAGE/msg/NAME"
        raise NodeError(message) from None
    except (ImportError, AttributeError):
        do = f"source the workspace that builds the package {package}"
        if "MSLS_OVERLAY" in os.environ:  # run through ./msls, which takes nothing from the shell's workspaces
            do = f"build the package {package} and name its install folder in MSLS_OVERLAY, see docs/own_stack.md"
        message = f"the type {msgtype} is not installed: {do}"
        raise NodeError(message) from None
    return found


def type_of(kind: Any) -> str:
    """Return the name of a message class's type, ``PACKAGE/msg/NAME``."""
    return f"{kind.__module__.partition('.')[0]}/msg/{kind.__name__}"
