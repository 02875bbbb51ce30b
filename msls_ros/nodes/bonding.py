"""A bond with a lifecycle manager, as nav2's keeps one with its nodes, where the package bondpy is installed.

While a node is active both ends send a heartbeat; where it stays away, the manager takes the node for dead and brings
its others down. A node that starts by itself (``autostart``) has no manager, and no bond.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

from rclpy.node import Node

TOPIC = "bond"
PERIOD, TIMEOUT = 0.1, 4.0
"""Heartbeats, and how long one may stay away [s]: as nav2's own nodes have them."""


class Bond:
    """A node's end of the bond.

    Parameters
    ----------
    node
        Whose; the bond has its name.
    wanted
        Whether there is a manager.
    """

    def __init__(self, node: Node, wanted: bool) -> None:
        """Form nothing yet; see the class."""
        self._node, self._wanted = node, wanted
        self._formed: Any = None

    def form(self) -> None:
        """Begin to send heartbeats."""
        if not self._wanted:
            return
        try:
            module = import_module("bondpy.bondpy")
        except ImportError:
            self._node.get_logger().info(
                "no bond with a manager: bondpy is not installed; nav2's needs bond_timeout: 0.0"
            )
            return
        bond = module.Bond(self._node, TOPIC, self._node.get_name())
        bond.heartbeat_period, bond.heartbeat_timeout = PERIOD, TIMEOUT
        bond.start()
        self._formed = bond

    def end(self) -> None:
        """Say that the node ends, so that its silence is no death.

        Not by bondpy's own ``shutdown``, which destroys its subscription behind the node's back: the executor's next
        wait fails on what is left of it (bondpy 4.1, rclpy 7.1).
        """
        bond, self._formed = self._formed, None
        if bond is None:
            return
        bond.break_bond()
        with bond.lock:
            bond.is_shutdown = True
            bond.condition.notify_all()
        bond.connect_timer.cancel()
        self._node.destroy_subscription(bond.sub)
        self._node.destroy_publisher(bond.pub)
