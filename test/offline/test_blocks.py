"""Replay in blocks: the same as one by one whatever their size; memory and speed."""

from __future__ import annotations

import math
import tracemalloc
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from offline.replayed import (
    BAGS,
    Maker,
    shifted,
)

from benchmarks.replay import measure
from msls_ros.bags import BagMessage, BagWriter
from msls_ros.bags import writer as writer_module
from msls_ros.commands import benchmark
from msls_ros.estimation import Configuration
from msls_ros.inputs import Synchronizer
from msls_ros.inputs.block_pairing import PairedBlock
from msls_ros.inputs.profiles import read_profile
from msls_ros.offline.replay import ReplayOptions, kept_parameters, replay
from msls_ros.offline.sources import InputTopics, SampleSource

STATES = ("u", "v", "w", "P", "Q", "R", "Phi", "Theta", "Psi")
SURFACES = ("de", "dr", "ddt", "ddf", "dsf", "dte", "dtr")


@pytest.fixture(scope="module")
def configuration() -> Configuration:
    return read_profile(kept_parameters(BAGS / "tail_fault"))


def collect(messages: list[BagMessage], sizes: list[int], blocks: bool) -> tuple[Any, ...]:
    """Put messages through the gate in batches; give the samples and the gate's counts."""
    gate = Synchronizer(STATES, SURFACES)
    source = SampleSource(InputTopics("/"), gate)
    found: list[Any] = []
    batches: list[list[BagMessage]] = []
    place = 0
    while place < len(messages):
        size = sizes[len(batches) % len(sizes)]
        batches.append(messages[place : place + size])
        place += size
    parts = [part for batch in batches for part in (source.segments(batch) if blocks else source._one_by_one(batch))]
    for part in [*parts, *source.rest()]:
        for k in range(len(part.stamps)):
            values = (part.x[k].tobytes(), part.xdot[k].tobytes(), part.delta[k].tobytes())
            found.append((int(part.stamps[k]), part.restarted and k == 0, *values))
    return found, dict(gate.refused), gate.paired, gate.restarts


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    seed=st.integers(0, 2**31),
    count=st.integers(1, 500),
    damage=st.floats(0.0, 0.2).map(lambda share: share if share > 0.02 else 0.0),
    jitter=st.integers(0, 100),
    sizes=st.lists(st.integers(1, 700), min_size=1, max_size=4),
)
def test_the_gate_lets_the_same_pass_in_blocks_of_any_size_as_one_by_one(
    seed: int, count: int, damage: float, jitter: int, sizes: list[int]
) -> None:
    messages = disturbed(np.random.default_rng(seed), count, damage, jitter)
    assert collect(messages, sizes, blocks=True) == collect(messages, [10**9], blocks=False)


def disturbed(rng: np.random.Generator, count: int, damage: float, jitter: int) -> list[BagMessage]:
    """Make two streams; some messages are lost, repeated, late, not finite, cut, of another layout, or back in time."""
    make, other = Maker(STATES, SURFACES), Maker(STATES[::-1], SURFACES[::-1])
    streams: list[tuple[float, BagMessage]] = []
    stamp = 10**10
    for k in range(count):
        stamp += 20_000_000
        if rng.random() < damage / 10:
            stamp -= int(rng.integers(0, 5 * 10**9))
        maker = other if rng.random() < damage else make
        x, xdot, delta = rng.normal(size=9), rng.normal(size=9), rng.normal(size=7)
        pair = [maker.state(stamp, x, xdot), maker.effectors(stamp, delta)]
        for message in pair:
            what = rng.random() / damage if damage else 9.0
            if what < 0.2:
                continue
            if what < 0.3:
                message = maker.state(stamp, x * rng.choice([np.nan, 1e30]), xdot) if message is pair[0] else message
            elif what < 0.4:
                message = message._replace(data=message.data[: int(rng.integers(0, len(message.data)))])
            streams += [(k + jitter * rng.random(), message)] * (2 if 0.4 < what < 0.5 else 1)
    return [message for _, message in sorted(streams, key=lambda item: item[0])] if jitter else [m for _, m in streams]


def test_regular_streams_pass_in_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    messages = disturbed(np.random.default_rng(0), 3000, 0.0, 0)
    one_by_one: list[int] = []
    original = SampleSource._one_by_one

    def counted(self: SampleSource, some: Sequence[BagMessage]) -> Iterator[PairedBlock]:
        one_by_one.append(len(some))
        return original(self, some)

    monkeypatch.setattr(SampleSource, "_one_by_one", counted)
    found, *_ = collect(messages, [701], blocks=True)
    assert len(found) == 3000 and sum(one_by_one) < 64


def test_the_disturbed_streams_of_these_tests_hold_every_kind_of_damage() -> None:
    messages = disturbed(np.random.default_rng(3), 2000, 0.1, 3)
    _, refused, paired, restarts = collect(messages, [100_000], blocks=True)
    assert {"not_finite", "too_large", "malformed", "stamp_repeated", "stamp_back", "state_unpaired"} <= refused.keys()
    assert paired > 1000 and restarts > 0


def test_memory_does_not_grow_with_the_bag(
    tmp_path: Path, configuration: Configuration, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        writer_module, "FLUSH_INTERVAL_S", math.inf
    )  # chunks end by size, not by the load of the machine
    peaks = []
    for copies in (1, 10, 40):
        with BagWriter(tmp_path / f"bag{copies}") as writer:
            for k in range(copies):
                for message in disturbed(np.random.default_rng(k), 500, 0.0, 0):
                    writer.write(*shifted(message, k * 10**10))
        tracemalloc.start()
        try:
            replay(tmp_path / f"bag{copies}", tmp_path / f"out{copies}", configuration, ReplayOptions(every=100))
            peaks.append(tracemalloc.get_traced_memory()[1])
        finally:
            tracemalloc.stop()
    assert peaks[2] < 1.2 * peaks[1], peaks


def test_the_benchmark_gives_both_rates_and_their_ratio(capsys: pytest.CaptureFixture[str]) -> None:
    result = measure(3000, 10, lambda _: None, rounds=1)
    assert result["samples"] == 3000
    assert 0.0 < result["replay_to_raw"] == round(result["replay_samples_per_s"] / result["raw_samples_per_s"], 3)
    text = benchmark.format_replay(result)
    assert f"{result['raw_samples_per_s']:,}" in text and f"{result['replay_samples_per_s']:,}" in text
