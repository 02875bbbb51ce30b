"""ROS nodes, each thin: a message in, a room called, a message out.

This room imports rclpy and every room below. Begin with `identifier.IdentifierNode`; `parameters` declares what a node
takes, `refusals` counts what it does not, `flight.fly` runs all nodes in one process in lockstep.
"""
