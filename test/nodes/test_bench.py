"""The bench for a user's own pytest: what is fed comes back as models, events and dithers."""

from __future__ import annotations

import numpy as np
import pytest
from nodes.made_up import linear_samples

from msls_ros import messages
from msls_ros.estimation import EstimationError, Identifier
from msls_ros.inputs.profiles import read_profile
from msls_ros.testing import Bench, IdentifierBench

COUNT = 130


def made_up(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    return (0.02 * np.arange(count), *linear_samples(count))


def test_the_node_on_the_bench_says_what_the_identifier_says() -> None:
    time, x, xdot, delta = made_up(COUNT)
    xdot[100:, 3] -= 40.0 * delta[100:, 2]
    with Bench() as bench:
        identifier = bench.identifier("f16", dither__seed=3)
        identifier.feed(time, x, xdot, delta)
        models = identifier.await_models(COUNT)
        events = identifier.await_events(1)
    alone = Identifier(read_profile("f16").replace({"dither.seed": 3}))
    stamped = np.round(1e9 * (1.0 + time)) * 1e-9  # the node knows times by their stamps
    expected = alone.run(stamped, x, xdot, delta).estimates
    assert np.array_equal(messages.values(models[-1].b), expected[-1].b.ravel())
    assert len(identifier.dithers) == COUNT
    assert events[0].kind == events[0].DETECTED and "P" in events[0].equations


def test_fed_twice_it_counts_on() -> None:
    time, x, xdot, delta = made_up(20)
    with Bench() as bench:
        identifier = bench.identifier()
        for first in (1.0, 2.0):
            identifier.feed(time, x, xdot, delta, first=first)
        assert len(identifier.await_models(40)) == 40


def test_what_does_not_come_is_named(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("msls_ros.testing.PATIENCE", 0.1)
    with pytest.raises(AssertionError, match=r"the moon did not come within 0\.1 s"):
        bench.spin_until(lambda: False, "the moon")


def test_a_profile_that_is_not_there_is_refused(bench: Bench) -> None:
    with pytest.raises(EstimationError, match="shipped are"):
        IdentifierBench(bench, "no_such_profile", {})
