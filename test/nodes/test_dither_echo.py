"""Identifier and mixer beside a stack: the identifier says so where its dither does not come back, and only there."""

from __future__ import annotations

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from msls_msgs.msg import DitherCommand, EffectorCommand
from rich.console import Console
from std_srvs.srv import SetBool

from msls_ros import messages
from msls_ros.commands.watch import render
from msls_ros.inputs.dither_echo import TWICE
from msls_ros.nodes.identifier import IdentifierNode
from msls_ros.nodes.mixer import MixerNode
from msls_ros.nodes.watching import WatchNode
from msls_ros.testing import Bench

STATES, EFFECTORS = ("u", "w", "Q", "Theta"), ("de", "ds")
STEP = 20_000_000
A = np.array([[-0.03, 0.1, 0.0, -9.8], [-0.1, -1.0, 60.0, 0.0], [0.0, -0.1, -1.0, 0.0], [0.0, 0.0, 1.0, 0.0]])
B = np.array([[0.0, 0.5], [-5.0, -20.0], [-8.0, 1.0], [0.0, 0.0]])
TRIM = np.array([60.0, 2.0, 0.0, 0.03])
MISSING = "dither not in the deflections"
SAID = "the dither commanded for de, ds does not come back in their deflections"


class Stack:
    """A linear aircraft; what its commands become in the mixer are its deflections."""

    def __init__(self, bench: Bench) -> None:
        self.bench, self.k = bench, 0
        effectors = list(EFFECTORS)
        given = {"reference_speed": 60.0, "known_gravity": False, "lockstep": True}
        bench.add(IdentifierNode, states=list(STATES), effectors=effectors, **given)
        bench.add(MixerNode, effectors=effectors, stale_after=60.0)
        self.watch = bench.add(WatchNode)
        self.out: list[EffectorCommand] = bench.listen(EffectorCommand, "command_out")
        self.dither: list[DitherCommand] = bench.listen(DitherCommand, "dither")
        self.diagnostics: list[DiagnosticArray] = bench.listen(DiagnosticArray, "/diagnostics")
        self.x, self.random = TRIM.copy(), np.random.default_rng(0)

    def fly(self, count: int) -> None:
        for _ in range(count):
            self.k += 1
            stamp = self.k * STEP
            stick = 0.01 * np.sin(0.02 * self.k * np.array([1.0, 0.3]))
            mixed, answered = len(self.out) + 1, len(self.dither) + 1
            self.bench.publish("command_in", messages.command_message(stamp, EFFECTORS, stick))
            self.bench.expect(self.out, mixed, "the mixed command")
            delta = np.array(self.out[-1].delta)
            xdot = A @ (self.x - TRIM) + B @ delta
            noise, seen = 1e-3 * self.random.standard_normal((2, 4)), 1e-4 * self.random.standard_normal(2)
            self.bench.publish("state", messages.state_message(stamp, STATES, self.x + noise[0], xdot + noise[1]))
            self.bench.publish("effectors", messages.effector_message(stamp, EFFECTORS, delta + seen))
            self.bench.expect(self.dither, answered, "the dither")
            self.x = self.x + 1e-9 * STEP * xdot

    def own(self) -> list[DiagnosticStatus]:
        """Return all that the identifier has said of itself."""
        return [s for array in self.diagnostics for s in array.status if s.name == "/identifier: messages"]

    def status(self) -> tuple[DiagnosticStatus, dict[str, str]]:
        """Return what it says once all effectors have been compared as often as it takes."""
        count = len(self.own()) + TWICE * len(EFFECTORS) + 1
        self.bench.spin_until(lambda: len(self.own()) >= count, "diagnostics")
        newest = self.own()[-1]
        return newest, {v.key: v.value for v in newest.values}

    def shown(self) -> str:
        """Return what the terminal view shows."""
        console = Console(width=400)
        with console.capture() as captured:
            console.print(render(self.watch, ["Q/de"], {}))
        return captured.get()


def test_dither_that_no_mixer_adds_is_a_warning_until_one_does(bench: Bench, capfd: pytest.CaptureFixture[str]) -> None:
    stack = Stack(bench)
    bench.call(SetBool, "/mixer/enable", data=False)
    stack.fly(600)
    status, values = stack.status()
    assert (values[MISSING], values[f"{MISSING} [times found]"]) == ("de, ds", "2")
    assert status.level == DiagnosticStatus.WARN and status.message.startswith(f"identifying; {SAID}")
    assert "does not come back" in capfd.readouterr().err
    bench.spin_until(lambda: SAID in stack.shown(), "the warning in the terminal view")
    bench.call(SetBool, "/mixer/enable", data=True)
    stack.fly(400)
    status, values = stack.status()
    assert (values[MISSING], status.message, status.level) == ("none", "identifying", DiagnosticStatus.OK)
    bench.spin_until(lambda: SAID not in stack.shown(), "its end in the terminal view")


def test_no_dither_is_missed_where_none_is_commanded(bench: Bench) -> None:
    stack = Stack(bench)
    bench.call(SetBool, "/identifier/enable_dither", data=False)
    bench.call(SetBool, "/mixer/enable", data=False)
    stack.fly(600)
    status, values = stack.status()
    assert (values[MISSING], status.message) == ("none", "identifying")
