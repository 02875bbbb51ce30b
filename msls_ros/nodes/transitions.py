"""Lifecycle transitions that the present state does not have."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from lifecycle_msgs.srv import ChangeState
from rclpy._rclpy_pybind11 import RCLError
from rclpy.lifecycle import LifecycleNode


def guard_transitions(node: LifecycleNode) -> None:
    """Answer a transition that the present state does not have with no; rclpy would end the process over it."""

    def guarded(answer: Callable[[Any, Any], Any], request: Any, response: Any) -> Any:
        try:
            return answer(request, response)
        except RCLError as error:
            node.get_logger().warning(f"refused (transition): {str(error).splitlines()[0]}")
            response.success = False
            return response

    for service in node.services:
        if service.srv_type is ChangeState:
            service.callback = partial(guarded, service.callback)
