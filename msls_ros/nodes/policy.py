"""The access policy of our nodes for SROS 2, written from the real graph: who may publish, hear, offer and call what.

Run as a program it writes ``config/sros2_policy.xml`` anew. Where the identifier is the only one that may publish
`dither`, and the stack (here: controller or pilot) the only one that may command, nobody else can move a surface.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from xml.etree import ElementTree

import rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter

from msls_ros.nodes.controller import ControllerNode
from msls_ros.nodes.identifier import IdentifierNode
from msls_ros.nodes.mixer import MixerNode
from msls_ros.nodes.pilot import PilotNode
from msls_ros.nodes.plant import PlantNode
from msls_ros.nodes.recorder import RecorderNode

KINDS: dict[str, tuple[type[Node], dict[str, Any]]] = {
    "controller": (ControllerNode, {}),
    "identifier": (IdentifierNode, {}),
    "mixer": (MixerNode, {}),
    "pilot": (PilotNode, {}),
    "plant": (PlantNode, {"autostart": False}),
    "recorder": (RecorderNode, {}),
}
"""The nodes, each in an enclave of its name, and what they are started with."""
PATIENCE = 60.0
VERSION = "0.2.0"


def graph(nodes: Mapping[str, Node]) -> dict[str, dict[tuple[str, str], tuple[str, ...]]]:
    """Return the names that each node uses, by kind and right, as ``("topics", "publish")``; as a policy has them.

    Parameters
    ----------
    nodes
        By name, in the root namespace.
    """
    found = {}
    for name, node in nodes.items():
        asked = {
            ("topics", "publish"): node.get_publisher_names_and_types_by_node,
            ("topics", "subscribe"): node.get_subscriber_names_and_types_by_node,
            ("services", "reply"): node.get_service_names_and_types_by_node,
            ("services", "request"): node.get_client_names_and_types_by_node,
        }
        found[name] = {right: tuple(sorted(n for n, _ in ask(name, "/"))) for right, ask in asked.items()}
    return found


def settled(nodes: Mapping[str, Node]) -> dict[str, dict[tuple[str, str], tuple[str, ...]]]:
    """Return the graph once it holds all that the nodes have made themselves.

    Raises
    ------
    TimeoutError
        If it does not within a minute.
    """
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        found = graph(nodes)
        if all(
            {p.topic_name for p in node.publishers} <= set(found[name]["topics", "publish"])
            and {s.topic_name for s in node.subscriptions} <= set(found[name]["topics", "subscribe"])
            and {s.service_name for s in node.services} <= set(found[name]["services", "reply"])
            for name, node in nodes.items()
        ):
            return found
        time.sleep(0.02)
    message = "the graph does not show what the nodes have made"
    raise TimeoutError(message)


def to_xml(found: Mapping[str, Mapping[tuple[str, str], tuple[str, ...]]]) -> str:
    """Return a graph as a policy."""
    policy = ElementTree.Element("policy", version=VERSION)
    enclaves = ElementTree.SubElement(policy, "enclaves")
    for name, rights in found.items():
        enclave = ElementTree.SubElement(enclaves, "enclave", path=f"/{name}")
        profile = ElementTree.SubElement(ElementTree.SubElement(enclave, "profiles"), "profile", ns="/", node=name)
        for (kind, right), names in rights.items():
            listed = ElementTree.SubElement(profile, kind, {right: "ALLOW"}) if names else None
            for one in names:
                if listed is not None:
                    ElementTree.SubElement(listed, kind[:-1]).text = one
    ElementTree.indent(policy)
    head = '<?xml version="1.0" encoding="UTF-8"?>\n<!-- Written by `python -m msls_ros.nodes.policy`; '
    return f"{head}docs/reliability.md says how to use it. -->\n{ElementTree.tostring(policy, encoding='unicode')}\n"


def read(path: Path) -> dict[str, dict[tuple[str, str], tuple[str, ...]]]:
    """Return what a policy of ours allows; as `graph`."""
    found: dict[str, dict[tuple[str, str], tuple[str, ...]]] = {}
    for enclave in ElementTree.parse(path).getroot().iter("enclave"):
        rights = found.setdefault(enclave.attrib["path"].lstrip("/"), {})
        for profile in enclave.iter("profile"):
            for listed in profile:
                ((right, allowed),) = listed.attrib.items()
                if allowed == "ALLOW":
                    rights[listed.tag, right] = tuple(one.text or "" for one in listed)
    return found


def main(path: str) -> int:
    """Start all nodes, and write the policy of what they use."""
    with TemporaryDirectory() as folder:
        rclpy.init()
        nodes = {name: make(name, Path(folder)) for name in KINDS}
        try:
            Path(path).write_text(to_xml(settled(nodes)), encoding="utf-8")
        finally:
            for node in nodes.values():
                node.destroy_node()
            rclpy.shutdown()
    return 0


def make(name: str, folder: Path, **options: Any) -> Node:
    """Return a node of `KINDS`; the recorder writes into the folder."""
    kind, given = KINDS[name]
    if name == "recorder":
        given = {**given, "out": str(folder / "bag")}
    build: Any = kind
    node: Node = build(parameter_overrides=[Parameter(n, value=v) for n, v in given.items()], **options)
    return node


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
