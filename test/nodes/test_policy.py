"""The access policy for SROS 2 is that of the real graph: only the identifier dithers, only the stack commands."""

from __future__ import annotations

from pathlib import Path

from msls_ros.inputs.profiles import config_folder
from msls_ros.nodes import policy
from msls_ros.testing import Bench

FILE = config_folder() / "sros2_policy.xml"


def test_the_policy_is_that_of_the_real_graph(bench: Bench, tmp_path: Path) -> None:
    nodes = {name: bench.adopt(policy.make(name, tmp_path, context=bench.context)) for name in policy.KINDS}
    found = policy.settled(nodes)
    assert FILE.read_text() == policy.to_xml(found), "write it anew: python -m msls_ros.nodes.policy FILE"
    assert policy.read(FILE) == {n: {k: v for k, v in rights.items() if v} for n, rights in found.items()}


def test_only_the_identifier_may_dither_and_only_the_stack_command() -> None:
    allowed = policy.read(FILE)
    stacks = {"/dither": ["identifier"], "/command": ["controller", "pilot"], "/command_out": ["mixer"]}
    for topic, who in stacks.items():
        assert [name for name, rights in allowed.items() if topic in rights["topics", "publish"]] == who
    assert not any(("services", "request") in rights for rights in allowed.values())
