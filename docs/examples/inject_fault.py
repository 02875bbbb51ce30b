"""Damage the simulated aircraft after four seconds of flight; print the fault events of the next two."""

from __future__ import annotations

import sys

import rclpy
from msls_msgs.msg import FaultEvent, StateSample
from msls_msgs.srv import InjectFault

FAULT, END = 4, 6  # [s] of flight


def main() -> int:
    """Return 0 if the fault was taken and detected."""
    rclpy.init()
    node = rclpy.create_node("inject_fault")
    kinds: list[int] = []
    flown = [0]

    def show(event: FaultEvent) -> None:
        kinds.append(event.kind)
        print(f"{event.header.stamp.sec + 1e-9 * event.header.stamp.nanosec:8.3f} s  {event.description}", flush=True)

    node.create_subscription(FaultEvent, "fault", show, 10)

    def note(sample: StateSample) -> None:
        flown[0] = sample.header.stamp.sec

    node.create_subscription(StateSample, "state", note, 10)
    client = node.create_client(InjectFault, "plant/inject_fault")
    if not client.wait_for_service(timeout_sec=60.0):
        print("no service plant/inject_fault: is the plant running?", file=sys.stderr)
        return 1
    while flown[0] < FAULT:
        rclpy.spin_once(node)
    future = client.call_async(InjectFault.Request(effector="left_stabilator", effectiveness=0.0))
    rclpy.spin_until_future_complete(node, future)
    print(future.result().message, flush=True)
    while flown[0] < END:
        rclpy.spin_once(node)
    rclpy.shutdown()
    return 0 if FaultEvent.DETECTED in kinds else 1


if __name__ == "__main__":
    sys.exit(main())
