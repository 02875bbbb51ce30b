"""The layouts for Foxglove and PlotJuggler name topics, fields and elements that exist, of the effector they say."""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as Xml
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from msls_msgs.msg import DitherCommand, FaultEvent, LinearModel

from msls_ros import messages
from msls_ros.estimation import Configuration, Identifier
from msls_ros.inputs.profiles import config_folder
from msls_ros.nodes.recorder import TOPICS

VIEWS = config_folder() / "views"
TYPES: dict[str, Any] = {
    "model": LinearModel,
    "dither": DitherCommand,
    "fault": FaultEvent,
    "diagnostics": DiagnosticArray,
}
CONFIGURATION = Configuration()
COLUMNS = {"a": CONFIGURATION.states, "a_std": CONFIGURATION.states, "b": CONFIGURATION.effectors}
COLUMNS |= {"b_std": CONFIGURATION.effectors}


def foxglove() -> dict[str, str]:
    """Return the message paths of the layout and their labels."""
    panels = json.loads((VIEWS / "foxglove.json").read_text())["configById"].values()
    found = {p["value"]: p["label"] for panel in panels for p in panel.get("paths", [])}
    found |= {panel["topicPath"]: "" for panel in panels if "topicPath" in panel}
    return found | {panel["topicToRender"]: "" for panel in panels if "topicToRender" in panel}


def plotjuggler() -> list[str]:
    return [c.attrib["name"] for c in Xml.parse(VIEWS / "plotjuggler.xml").iter("curve")]


def filled(topic: str) -> Any:
    """Return a message of a topic as an identifier sends it."""
    identifier = Identifier(CONFIGURATION)
    estimate = identifier.estimate(0.0, messages.values([0.0] * len(CONFIGURATION.states)))
    if topic == "model":
        return messages.model_message(0, estimate)
    if topic == "dither":
        return messages.dither_message(0, CONFIGURATION.effectors, estimate.dither)
    return TYPES[topic]()


def check(path: str, label: str = "") -> None:
    match = re.fullmatch(r"/(\w+)(?:[./](\w+)(?:\[(\d+)\])?)?", path)
    assert match, path
    topic, field, index = match.groups()
    message = filled(topic)
    assert topic in TOPICS or topic == "diagnostics"
    if field is None:
        return
    assert field in message.get_fields_and_field_types(), path
    if index is None:
        return
    k = int(index)
    assert k < len(getattr(message, field)), path
    if label and field in COLUMNS:
        row, column = divmod(k, len(COLUMNS[field]))
        assert f"{CONFIGURATION.states[row]}/{COLUMNS[field][column]}" == label
    if label and field == "excitation":
        assert CONFIGURATION.regressors[k] == label
    if label and field == "delta":
        assert CONFIGURATION.effectors[k] == label


@pytest.mark.parametrize("path", foxglove())
def test_foxglove_shows_what_exists(path: str) -> None:
    check(path, foxglove()[path])


@pytest.mark.parametrize("curve", plotjuggler())
def test_plotjuggler_shows_what_exists(curve: str) -> None:
    check(curve)


def test_both_show_the_same_and_every_panel_has_its_place() -> None:
    assert {p.replace(".", "/", 1) for p in foxglove() if "[" in p} == {c for c in plotjuggler() if "[" in c}
    content = json.loads((VIEWS / "foxglove.json").read_text())
    placed = re.findall(r'"(\w+!\w+)"', json.dumps(content["layout"]))
    assert sorted(placed) == sorted(content["configById"])
    topics = {t.attrib["name"].strip("/") for t in Xml.parse(VIEWS / "plotjuggler.xml").iter("topic")}
    assert topics <= TOPICS.keys()
