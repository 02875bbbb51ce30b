"""`recorder`: the recorder node as a process."""

from __future__ import annotations

import sys

from msls_ros.commands.node_help import run_or_help
from msls_ros.nodes.recorder import PARAMETERS, RecorderNode


def main() -> int:
    """Run the node; return the exit code."""
    return run_or_help("recorder", RecorderNode, PARAMETERS, sys.argv[1:])
