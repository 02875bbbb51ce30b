"""ROS nodes, each thin: a message in, a room called, a message out.

This room imports rclpy and every room below. Begin with `identifier.IdentifierNode`; `parameters` declares what a node
takes, `refusals` counts what it does not, `flight.fly` runs all nodes in one process in lockstep.
"""

try:
    import msls_msgs  # noqa: F401
except ImportError:
    import msls_ros.messages  # noqa: F401  says what to do where the messages are not built
