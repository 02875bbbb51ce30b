"""What a topic that delivers nothing lacks: a publisher, one of its type, or one whose quality of service matches."""

from __future__ import annotations

from rclpy.node import Node
from rclpy.qos import QoSCompatibility, qos_check_compatible
from rclpy.subscription import Subscription

from msls_ros.nodes.message_types import type_of


def awaited(node: Node, topic: str, subscription: Subscription, count: int) -> str:
    """Say how many messages a topic has delivered or, where none, why: publishers, their types, quality of service.

    Parameters
    ----------
    node
        Who listens.
    topic
        As it was subscribed to.
    subscription, count
        Of the topic, and its messages so far.
    """
    name = subscription.topic_name
    if count:
        return f"{name}: {count} messages"
    expected = type_of(subscription.msg_type)
    publishers = node.get_publishers_info_by_topic(topic)
    wrong = []
    for found in publishers:
        who = f"{found.node_namespace.rstrip('/')}/{found.node_name}"
        match, why = qos_check_compatible(found.qos_profile, subscription.qos_profile)
        if found.topic_type != expected:
            wrong.append(f"{who} publishes {found.topic_type}, expected {expected}")
        elif match == QoSCompatibility.ERROR:
            why = why.replace("ERROR: ", "").rstrip(";").replace(";", ", ").lower()
            wrong.append(f"quality of service of {who} does not match: {why}")
    if len(wrong) < len(publishers):
        count = len(publishers) - len(wrong)
        return f"{name}: {count} publisher{'' if count == 1 else 's'}, no message yet"
    return f"{name}: {', '.join(wrong) or 'no publisher'}"


def elsewhere(node: Node, name: str, expected: str) -> str:
    """Name the namespaces in which a topic of the same last word and type has publishers; empty: none has.

    Parameters
    ----------
    node
        Who listens.
    name
        Of the topic that has no publisher, in full.
    expected
        Its type.
    """
    leaf = name.rpartition("/")[2]
    found = [
        topic.rpartition("/")[0]
        for topic, kinds in node.get_topic_names_and_types()
        if topic != name and topic.rpartition("/")[2] == leaf and expected in kinds and node.count_publishers(topic)
    ]
    meant = [namespace or "/" for namespace in sorted(found) if not namespace.endswith("/truth")]
    return f" (did you mean --namespace {' or '.join(meant)}?)" if meant else ""
