"""`plant`: the plant node as a process."""

from __future__ import annotations

import sys

from msls_ros.nodes.stopping import Stopping


def main() -> int:
    """Run the node; return the exit code. The slow imports come after the signals are taken."""
    with Stopping() as stopping:
        from msls_ros.commands.node_help import run_or_help
        from msls_ros.nodes.plant import PARAMETERS, PlantNode

        return stopping.end(run_or_help("plant", PlantNode, PARAMETERS, sys.argv[1:], stopping))
