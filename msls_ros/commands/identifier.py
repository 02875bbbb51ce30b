"""`identifier`: the identifier node as a process."""

from __future__ import annotations

import sys

from msls_ros.commands.node_help import run_or_help
from msls_ros.nodes.identifier import PARAMETERS, IdentifierNode


def main() -> int:
    """Run the node; return the exit code."""
    return run_or_help("identifier", IdentifierNode, PARAMETERS, sys.argv[1:])
