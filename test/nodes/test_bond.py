"""The bond with a lifecycle manager: formed while active, where there is a manager and bondpy; through a stand-in."""

from __future__ import annotations

import sys
import threading
from types import ModuleType
from typing import Any

import pytest
from std_msgs.msg import String

from msls_ros.nodes import bonding
from msls_ros.nodes.controller import ControllerNode
from msls_ros.nodes.identifier import IdentifierNode
from msls_ros.testing import Bench

KINDS = (IdentifierNode, ControllerNode)
said: list[tuple[Any, ...]] = []


class StandIn:
    """As the class of bondpy, which is not on the package index: what is asked of it."""

    def __init__(self, node: Any, topic: str, name: str) -> None:
        self.heartbeat_period = self.heartbeat_timeout = 0.0
        self.who = (topic, name)
        self.lock = threading.RLock()
        self.condition = threading.Condition(self.lock)
        self.connect_timer = threading.Timer(60.0, lambda: None)
        self.is_shutdown = False
        self.pub = node.create_publisher(String, topic, 1)
        self.sub = node.create_subscription(String, topic, lambda _: None, 1)

    def start(self) -> None:
        said.append(("start", *self.who, self.heartbeat_period, self.heartbeat_timeout))

    def break_bond(self) -> None:
        said.append(("broken", *self.who))


@pytest.fixture
def bondpy(monkeypatch: pytest.MonkeyPatch) -> None:
    package, module = ModuleType("bondpy"), ModuleType("bondpy.bondpy")
    module.Bond = StandIn  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "bondpy", package)
    monkeypatch.setitem(sys.modules, "bondpy.bondpy", module)
    said.clear()


@pytest.mark.parametrize("kind", KINDS)
def test_an_active_node_keeps_a_bond_with_its_manager_and_ends_it_itself(bondpy: None, kind: Any) -> None:
    with Bench() as bench:
        node = bench.add(kind, autostart=False)
        name = node.get_name()
        node.trigger_configure()
        assert said == []
        for _ in range(2):
            node.trigger_activate()
            assert said == [("start", "bond", name, bonding.PERIOD, bonding.TIMEOUT)]
            node.trigger_deactivate()
            assert said[1:] == [("broken", "bond", name)]
            assert node.count_publishers("bond") == node.count_subscribers("bond") == 0
            said.clear()
        node.trigger_activate()
        node.trigger_shutdown()
        assert said[1:] == [("broken", "bond", name)]


@pytest.mark.parametrize("kind", KINDS)
def test_a_node_that_starts_by_itself_has_none(bondpy: None, kind: Any) -> None:
    with Bench() as bench:
        node = bench.add(kind, autostart=True)
        node.trigger_deactivate()
    assert said == []


def test_without_bondpy_it_says_what_the_manager_needs(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "bondpy", None)
    with Bench() as bench:
        node = bench.add(IdentifierNode, autostart=False)
        node.trigger_configure()
        node.trigger_activate()
        node.trigger_deactivate()
    assert "no bond with a manager: bondpy is not installed; nav2's needs bond_timeout: 0.0" in capfd.readouterr().err
