"""SIGINT and SIGTERM to the identifier in every state, during its start too: exit code 0, no traceback, a goodbye."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from msls_msgs.msg import DitherCommand
from nodes.made_up import linear_samples

from msls_ros import messages
from msls_ros.plant import EFFECTORS, STATES
from msls_ros.testing import Bench

LIMIT = 60
CODE = """
import sys
import msls_ros.nodes.stopping as stopping
enter = stopping.Stopping.__enter__
def entered(self):
    enter(self)
    print("signals are taken", flush=True)
    return self
stopping.Stopping.__enter__ = entered
from msls_ros.commands.identifier import main
sys.exit(main())
"""
X, XDOT, DELTA = linear_samples(50)
Process = subprocess.Popen[str]


@contextmanager
def identifier(bench: Bench) -> Iterator[Process]:
    """An identifier that waits to be configured, as a process that has taken the signals."""
    process = subprocess.Popen(
        [sys.executable, "-c", CODE, "--ros-args", "-p", "autostart:=false", "-p", "dither.stale_after:=60.0"],
        env={**os.environ, "ROS_DOMAIN_ID": str(bench.domain), "PYTHONWARNINGS": "ignore"},
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    try:
        assert process.stdout is not None and process.stdout.readline() == "signals are taken\n"
        yield process
    finally:
        process.kill()
        process.wait()


def change(bench: Bench, transition: int) -> None:
    assert bench.call(ChangeState, "identifier/change_state", transition=Transition(id=transition)).success


def bring(bench: Bench, state: str) -> list[DitherCommand]:
    """Bring the identifier into a state; return the dithers that it publishes."""
    if state == "starting":
        return []
    assert bench.call(GetState, "identifier/get_state").current_state.id == State.PRIMARY_STATE_UNCONFIGURED
    if state == "unconfigured":
        return []
    change(bench, Transition.TRANSITION_CONFIGURE)
    dithers: list[DitherCommand] = bench.listen(DitherCommand, "dither")
    change(bench, Transition.TRANSITION_ACTIVATE)
    now = time.time_ns()
    for k in range(3):
        bench.publish("state", messages.state_message(now + k * 20_000_000, STATES, X[k], XDOT[k]))
        bench.publish("effectors", messages.effector_message(now + k * 20_000_000, EFFECTORS, DELTA[k]))
        bench.expect(dithers, k + 1)
    if state == "inactive":
        change(bench, Transition.TRANSITION_DEACTIVATE)
    return dithers


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM], ids=["SIGINT", "SIGTERM"])
@pytest.mark.parametrize("state", ["starting", "unconfigured", "inactive", "active"])
def test_told_to_stop_it_ends_with_0_and_its_last_dither_is_inhibited(
    bench: Bench, state: str, how: signal.Signals
) -> None:
    with identifier(bench) as process:
        dithers = bring(bench, state)
        process.send_signal(how)
        process.send_signal(how)  # as launch does
        if dithers:
            bench.spin_until(lambda: dithers[-1].level == DitherCommand.LEVEL_INHIBITED, "the goodbye")
            assert not any(dithers[-1].delta)
            assert ("shuts down" if state == "active" else "is deactivated") in dithers[-1].reason
        _, err = process.communicate(timeout=LIMIT)
    assert process.returncode == 0, err
    assert "Traceback" not in err and "terminate called" not in err, err


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM], ids=["SIGINT", "SIGTERM"])
@pytest.mark.parametrize("node", ["identifier", "mixer", "controller", "plant", "pilot", "recorder"])
def test_held_back_by_who_starts_it_a_signal_comes_when_the_node_can_take_it(node: str, how: signal.Signals) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", f"import sys; from msls_ros.commands.{node} import main; sys.exit(main())"],
        env={**os.environ, "PYTHONWARNINGS": "ignore"},
        text=True,
        stderr=subprocess.PIPE,
        preexec_fn=lambda: signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGTERM)),
    )
    process.send_signal(how)  # while Python itself begins
    _, err = process.communicate(timeout=LIMIT)
    assert (process.returncode, err) == (0, "")


STUCK = """
import sys, threading
import msls_ros.nodes.stopping as stopping
stopping.PATIENCE = 0.2
with stopping.Stopping() as one:
    woken = threading.Event()
    one.wake_with(woken.set)
    print("waiting", flush=True)
    woken.wait()
    def teardown():
        threading.Event().wait()
    teardown()
"""


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM], ids=["SIGINT", "SIGTERM"])
def test_who_does_not_end_after_the_signal_is_ended_and_says_where_it_was(how: signal.Signals) -> None:
    process = subprocess.Popen([sys.executable, "-c", STUCK], text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    try:
        assert process.stdout is not None and process.stdout.readline() == "waiting\n"
        process.send_signal(how)
        _, err = process.communicate(timeout=LIMIT)
    finally:
        process.kill()
        process.wait()
    assert process.returncode == 1
    assert "Timeout (" in err and "in teardown" in err
