"""Lifecycle transitions that fail: they are answered with no, the log says why, and the node lives on."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial, wraps
from typing import Any, TypeVar

from lifecycle_msgs.srv import ChangeState
from rclpy._rclpy_pybind11 import RCLError
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

from msls_ros.estimation import EstimationError
from msls_ros.nodes.parameters import NodeError

SomeNode = TypeVar("SomeNode", bound=LifecycleNode)
Callback = Callable[[SomeNode, LifecycleState], TransitionCallbackReturn]


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


def explained(callback: Callback[SomeNode]) -> Callback[SomeNode]:
    """Have ``on_configure`` or ``on_activate`` log what it raises, in one sentence; rclpy would swallow it.

    What it had made until then is destroyed, and the answer is FAILURE: the node is in the state that it was in.
    """

    @wraps(callback)
    def answered(node: SomeNode, state: LifecycleState) -> TransitionCallbackReturn:
        before = _made(node)
        try:
            return callback(node, state)
        except (EstimationError, NodeError) as error:
            node.get_logger().error(str(error))
        except Exception as error:  # of rclpy and the middleware, of many kinds
            node.get_logger().error(f"{callback.__name__} failed: {type(error).__name__}: {_in_one_line(error)}")
        for entity, destroy in _made(node).items():
            if entity not in before:
                destroy(entity)
        return TransitionCallbackReturn.FAILURE

    return answered


def _in_one_line(error: Exception) -> str:
    """Return what an exception says without line breaks, and without rclpy's mark below a wrong character."""
    return " ".join(str(error).split()).rstrip(" ^") or "no reason is given"


def _made(node: LifecycleNode) -> dict[Any, Callable[[Any], Any]]:
    """Return how each publisher, subscription, service and timer of a node is destroyed."""
    ways: tuple[tuple[Any, Callable[[Any], Any]], ...] = (
        (node.publishers, node.destroy_lifecycle_publisher),
        (node.subscriptions, node.destroy_subscription),
        (node.services, node.destroy_service),
        (node.timers, node.destroy_timer),
    )
    return {entity: destroy for entities, destroy in ways for entity in entities}
