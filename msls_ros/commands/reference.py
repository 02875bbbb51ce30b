"""Write the reference page from the code: executables, options, topics, services, parameters, messages, files.

``python -m msls_ros.commands.reference docs/reference.md`` writes the page again; without a path it is printed. To be
done after a change of any of these; a test holds the page equal to what the code gives.
"""

from __future__ import annotations

import argparse
import importlib
import os
import re
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.logging import LoggingSeverity, set_logger_level
from rclpy.node import Node
from rclpy.parameter import Parameter

from msls_ros.commands import benchmark, campaign, demo, inspect, paper, replay, report, watch
from msls_ros.flights.scenarios import shipped
from msls_ros.nodes import control_parameters, controller, identifier, mixer, pilot, plant, recorder
from msls_ros.nodes.loopback import stay_on_this_machine
from msls_ros.nodes.parameters import Table, constraint

ROOT = Path(__file__).resolve().parents[2]
TOOLS = {
    "demo": demo.parser,
    "inspect": inspect.parser,
    "replay": replay.parser,
    "report": report.parser,
    "campaign": campaign.parser,
    "paper": paper.parser,
    "benchmark": benchmark.parser,
    "watch": watch.parser,
}
NODES: Mapping[str, tuple[type[Node], Table]] = {
    "identifier": (identifier.IdentifierNode, identifier.PARAMETERS),
    "plant": (plant.PlantNode, plant.PARAMETERS),
    "pilot": (pilot.PilotNode, pilot.PARAMETERS),
    "recorder": (recorder.RecorderNode, recorder.PARAMETERS),
    "mixer": (mixer.MixerNode, mixer.PARAMETERS),
    "controller": (controller.ControllerNode, control_parameters.PARAMETERS),
}
OF_EVERY_NODE = ("/rosout", "/parameter_events")
STANDARD = ("rcl_interfaces", "lifecycle_msgs", "type_description_interfaces")
"""Packages whose services every (managed) node offers."""
HEAD = """\
<!-- Written by `python -m msls_ros.commands.reference docs/reference.md`: change the code, not this page. -->
# Reference

Generated from the code; a test holds the two equal. SI units and radians, body axes forward-right-down
(`base_link_frd`), g only where a name or unit says so. How to choose the parameters: [choosing](choosing.md).

[Executables](#executables) · [Nodes](#nodes) · [Messages](#messages) · [Services](#services) · [Files](#files)
"""
EXIT_CODES = """\
`./msls NAME ARGUMENTS`, or with ROS 2 installed `ros2 run msls_ros NAME ARGUMENTS`. Exit code 0; 2 for wrong usage or
bad input, with one line on stderr; 130 after Ctrl-C. With `--json`, stdout holds one JSON value and nothing else."""

NODE_ARGUMENTS = """\
Node executables take ROS arguments (`--ros-args -p NAME:=VALUE --params-file FILE -r FROM:=TO`); `--help` lists the
parameters. Identifier, controller, mixer, plant and pilot also publish `/diagnostics`. Set at *start*: the parameter is
fixed when the node starts; *flight*: it may change while the node runs.
"""
MAPPED = """
A managed (lifecycle) node. With parameters `inputs.*` it subscribes to topics of any type instead of `state` and
`effectors`: [own stack](own_stack.md). `model` and `fault` are latched (reliable, transient local): whoever joins late
and asks for it (transient local too) is given the last models, and the last hundred events."""


def main(argv: Sequence[str] | None = None) -> int:
    """Write or print the page; return the exit code."""
    parser = argparse.ArgumentParser(prog="reference", description="Write the reference page from the code.")
    parser.add_argument("page", nargs="?", type=Path, help="where to write it (default: stdout)")
    page = parser.parse_args(argv).page
    text = reference()
    if page is None:
        sys.stdout.write(text)
    else:
        page.write_text(text, encoding="utf-8")
    return 0


def reference() -> str:
    """Return the page."""
    sections = [
        HEAD,
        "## Executables\n",
        f"{EXIT_CODES}\n",
        *(_tool(name, make()) for name, make in TOOLS.items()),
        "## Nodes\n",
        NODE_ARGUMENTS,
        *_nodes(),
        "## Messages\n",
        *_interfaces("msg"),
        "## Services\n",
        *_interfaces("srv"),
        "## Files\n",
        *_files(),
    ]
    return "\n".join(sections).rstrip() + "\n"


def _tool(name: str, parser: argparse.ArgumentParser) -> str:
    """Return the section of an executable that takes options."""
    lines = [f"### {name}\n", f"{_sentence(f'msls_ros.commands.{name}', name)}\n"]
    nested = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    if not nested:
        return "\n".join([*lines, *_options(parser), ""])
    for command, one in nested[0].choices.items():
        about = next(choice.help for choice in nested[0]._choices_actions if choice.dest == command)
        lines += [f"`{name} {command}`: {about}\n", *_options(one), ""]
    return "\n".join(lines)


def _options(parser: argparse.ArgumentParser) -> list[str]:
    rows = []
    for action in parser._actions:
        if isinstance(action, argparse._HelpAction):
            continue
        name = ", ".join(action.option_strings) or str(action.metavar or action.dest)
        value = "" if not action.option_strings or action.nargs == 0 else f" {_metavar(action)}"
        rows.append([f"`{name}{value}`", "required" if action.required else "", action.help or ""])
    return _table(["argument", "", "meaning"], rows)


def _metavar(action: argparse.Action) -> str:
    if action.choices is not None:
        return "{" + ",".join(map(str, action.choices)) + "}"
    return str(action.metavar or action.dest.upper())


def _sentence(module: str, name: str) -> str:
    """Return what the first paragraph of a module's docstring says, without the executable's own name."""
    text = " ".join((importlib.import_module(module).__doc__ or "").split("\n\n")[0].split())
    text = text.removeprefix(f"`{name}`: ")
    return text[:1].upper() + text[1:]


def _nodes() -> Iterator[str]:
    """Yield the section of each node: its topics and services as the running node has them, and its parameters."""
    with tempfile.TemporaryDirectory() as folder, _quiet_context() as context:
        for name, (kind, table) in NODES.items():
            given = [Parameter("out", value=os.path.join(folder, "bag"))] if name == "recorder" else []
            make: Any = kind
            node: Node = make(context=context, parameter_overrides=given)
            try:
                topics, services = _topics(node), _services(node)
            finally:
                node.destroy_node()
            about = " ".join((kind.__doc__ or "").split("\n\n")[0].split())
            lines = [f"### {name}\n", f"{about}\n"]
            lines += _table(["topic", "direction", "type"], topics)
            if services:
                lines += ["", *_table(["service", "type"], services)]
            if name == "identifier":
                lines.append(MAPPED)
            yield "\n".join([*lines, "", *_parameters(table), ""])


@contextmanager
def _quiet_context() -> Iterator[Context]:
    """Give a context on this machine only, whose nodes log errors and nothing else."""
    stay_on_this_machine()
    context = Context()
    rclpy.init(context=context, domain_id=1 + os.getpid() % 100)
    for name in (*NODES, "rcl"):
        set_logger_level(name, LoggingSeverity.ERROR)
    try:
        yield context
    finally:
        for name in NODES:
            set_logger_level(name, LoggingSeverity.UNSET)
        context.try_shutdown()


def _topics(node: Node) -> list[list[str]]:
    ends: list[tuple[str, str, Any]] = [("in", s.topic_name, s.msg_type) for s in node.subscriptions]
    ends += [("out", p.topic_name, p.msg_type) for p in node.publishers]
    own = [(way, topic, kind) for way, topic, kind in ends if not topic.startswith(OF_EVERY_NODE)]
    return [
        [f"`{_relative(topic)}`", way, _link(kind, "msg")]
        for way, topic, kind in own
        if topic not in ("/diagnostics",) and "transition_event" not in topic
    ]


def _services(node: Node) -> list[list[str]]:
    own = [s for s in node.services if s.srv_type.__module__.split(".")[0] not in STANDARD]
    return [[f"`{s.srv_name}`", _link(s.srv_type, "srv")] for s in own]


def _relative(topic: str) -> str:
    """Return a topic as the node asks for it: relative to its namespace, but for those that are not."""
    return topic if topic == "/clock" else topic.removeprefix("/")


def _link(kind: Any, folder: str) -> str:
    package, name = kind.__module__.split(".")[0], kind.__name__
    return f"[{package}/{name}](#{name.lower()})" if package == "msls_msgs" else f"`{package}/{folder}/{name}`"


def _parameters(table: Table) -> list[str]:
    rows = []
    for name, (default, bounds) in table.items():
        value = list(default) if isinstance(default, tuple) else default
        shown = str(value).lower() if isinstance(value, bool) else ", ".join(value) if _words(value) else str(value)
        unit = "" if bounds.unit == "1" or isinstance(value, (bool, str)) or _words(value) else bounds.unit
        limits = constraint(bounds, default)
        rows.append([f"`{name}`", shown, unit, limits, "flight" if bounds.in_flight else "start", bounds.description])
    return _table(["parameter", "default", "unit", "range", "set at", "meaning"], rows)


def _words(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and isinstance(value[0], str)


def _interfaces(kind: str) -> Iterator[str]:
    """Yield the section of each message or service of msls_msgs, as its file has it."""
    for path in sorted((ROOT / "msg_defs" / kind).glob(f"*.{kind}")):
        comment, _, fields = path.read_text(encoding="utf-8").partition("\n\n")
        about = re.sub(r"(?m)^# ?", "", comment)
        yield f"### {path.stem}\n\n{about}\n\n```text\n{fields.rstrip()}\n```\n"


def _files() -> Iterator[str]:
    """Yield the lists of shipped scenarios and parameter files."""
    rows = [[f"[{name}](../config/scenarios/{name}.yaml)", one.description] for name, one in shipped().items()]
    yield "\n".join(["Scenarios, for `demo --scenario` and `campaign`:\n", *_table(["name", "flight"], rows), ""])
    rows = []
    for path in [*sorted((ROOT / "config").glob("*.yaml")), *sorted((ROOT / "config" / "inputs").glob("*.yaml"))]:
        lines = path.read_text(encoding="utf-8").splitlines()
        comment = " ".join(line.removeprefix("# ") for line in lines[: lines.index("")] if line.startswith("# "))
        rows.append([f"[{path.stem}](../{path.relative_to(ROOT)})", re.split(r"(?<=[a-z)]{2}[.:]) ", comment)[0]])
    yield "\n".join(
        ["Parameter files, for the identifier and `replay --params`:\n", *_table(["name", "content"], rows)]
    )


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    lines = [list(heads), ["---"] * len(heads), *(map(_cell, row) for row in rows)]
    return ["| " + " | ".join(line) + " |" for line in lines]


def _cell(text: str) -> str:
    return " ".join(text.replace("|", "\\|").split())


if __name__ == "__main__":
    sys.exit(main())
