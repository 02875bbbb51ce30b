"""The terminal view shows what an identifier says, and refuses what is no parameter."""

from __future__ import annotations

import io
import os
import re
import subprocess
import sys
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from msls_msgs.msg import LinearModel
from rich.console import Console

from msls_ros import messages
from msls_ros.commands import watch
from msls_ros.estimation import Configuration, EventKind, FaultEvent, Identifier
from msls_ros.nodes.quality import INPUT
from msls_ros.nodes.watching import WatchNode
from msls_ros.testing import Bench


def shown(seen: Any, *parameters: str) -> str:
    text = io.StringIO()
    Console(file=text, width=110).print(watch.render(seen, parameters, {"model": 50.0, "dither": 50.0}))
    return text.getvalue()


def test_nothing_heard_yet_is_said() -> None:
    text = shown(SimpleNamespace(model=None, dither=None, status=None, events=[], waiting=lambda: "as it is"), "P/ddt")
    assert "as it is" in text and "no diagnostics yet" in text and "no model yet" in text and "dither: none yet" in text


def test_parameters_dither_events_and_rates_are_shown(bench: Bench) -> None:
    node = WatchNode(context=bench.context)
    bench.adopt(node)
    identifier = Identifier(Configuration())
    estimate = identifier.estimate(1.0, np.zeros(9))
    estimate.b[3, 2], estimate.b_std[3, 2] = 1.25, 0.1
    event = FaultEvent(1.0, EventKind.DETECTED, ("P",), (9.0,), (7.0,), description="abrupt change in dP/dt")
    bench.publish("model", messages.model_message(1_000_000_000, estimate))
    bench.publish("dither", messages.dither_message(1_000_000_000, identifier.configuration.effectors, estimate.dither))
    bench.publish("fault", messages.fault_message(1_500_000_000, event))
    bench.spin_until(lambda: node.model is not None and node.dither is not None and node.events, "what was said")
    text = shown(node, "P/ddt", "P/nonsense", "x/y")
    assert "1.25" in text and "± 0.196" in text
    assert text.count("no such parameter") == 2
    assert "dither: off (no sample yet)" in text and "1.500 s  abrupt change in dP/dt" in text
    assert "model 50.0 Hz" in text
    assert set(node.rates()) == {"model", "dither"}


@pytest.mark.parametrize(("value", "std"), [(1.0, 0.1), (-3.0, 0.0), (0.0, 2.0), (1e9, 1e9)])
def test_a_bar_holds_value_and_band(value: float, std: float) -> None:
    bar = watch.bar(value, std)
    assert len(bar) == watch.BAR and bar.count("o") == 1
    if value:
        assert (bar.index("o") > watch.BAR // 2) == (value > 0)
    assert watch.bar(float("nan"), 1.0) == ""


@pytest.mark.parametrize("arguments", [["P"], ["P/"], ["--rate", "0"]])
def test_wrong_usage_is_one_line_and_exit_code_2(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert watch.main(arguments) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_once_says_what_it_waits_for_and_ends_with_the_first_model(bench: Bench) -> None:
    """First nobody publishes; then somebody does, who has said nothing; then a model comes."""
    code = "import sys; from msls_ros.commands.watch import main; sys.exit(main(['--once', 'P/ddt']))"
    given: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    environment = {**os.environ, "ROS_DOMAIN_ID": str(bench.domain)}
    process = subprocess.Popen([sys.executable, "-c", code], env=environment, **given)
    try:
        assert process.stderr is not None
        text = process.stderr.readline()
        assert text == "watch: waiting for a model: /model: no publisher; no diagnostics of /identifier\n"
        publisher = bench.probe.create_publisher(LinearModel, "model", INPUT)
        assert "/model: 1 publisher, no message yet" in process.stderr.readline()
        bench.spin_until(publisher.get_subscription_count, "the view")
        estimate = Identifier(Configuration()).estimate(1.0, np.zeros(9))
        model = messages.model_message(10**9, estimate)
        dither = messages.dither_message(10**9, Configuration().effectors, estimate.dither)
        said = DiagnosticArray(status=[DiagnosticStatus(name="/identifier: messages", message="identifying")])
        for topic, message, period in (("dither", dither, 0.02), ("/diagnostics", said, 1.0)):
            other = bench.probe.create_publisher(type(message), topic, INPUT)
            bench.probe.create_timer(period, partial(other.publish, message))
        publisher.publish(model)
        bench.probe.create_timer(0.02, partial(publisher.publish, model))
        bench.spin_until(lambda: process.poll() is not None, "the view's end")
        out, rest = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 0 and "P/ddt" in out and rest == ""
    assert out.startswith("identifying   model ") and "dither: off" in out
    rates = [float(rate) for rate in re.findall(r"(?:model|dither) ([0-9.]+) Hz", out)]
    assert len(rates) == 2 and all(20.0 < rate < 80.0 for rate in rates), "50 Hz flowed, on a machine of any load"
