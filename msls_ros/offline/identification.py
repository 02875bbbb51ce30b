"""Identify in one call, for pytest and notebooks: the map, the checks and the identifier of the flight, no bag written.

::

    result = identify_log("flight.mcap", "my_stack.yaml")
    result = identify_messages(messages, "my_stack.yaml")  # each (topic, stamp [ns], message)
    result = identify_messages(rows("/log", time, gyro=gyro, elevator=elevator), parameters)  # arrays
    result.a[-1], result.b[-1], result.b_std[-1], result.events

From the same messages and parameters a model has the same bits as live and in `replay`.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from msls_ros.bags import open_any
from msls_ros.estimation import Configuration, Estimate, EstimationError, FaultEvent, Identifier
from msls_ros.estimation.arguments import as_numbers
from msls_ros.inputs import InputAdapter, InputMap, Refused, Synchronizer, adapt
from msls_ros.inputs.block_pairing import PairedBlock
from msls_ros.inputs.findings import Finding
from msls_ros.inputs.inspection import findings_of
from msls_ros.inputs.model_file import start_if_there
from msls_ros.inputs.profiles import (
    parameters_of,
    profile_path,
    read_inputs,
    read_profile,
    read_warm_start,
    warm_start_of,
)
from msls_ros.inputs.series import Collector
from msls_ros.offline.inspection import inspect, refuse_wrong
from msls_ros.offline.opening import chosen_parameters
from msls_ros.offline.replay import ReplayOptions, open_source, why_none
from msls_ros.offline.sources import Offer, collected, ordered_batches

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Message = tuple[str, int, Any]
"""Topic, stamp of the log or of the arrival [ns], message: of ROS, or any object with its attributes."""
Parameters = str | os.PathLike[str] | Mapping[str, Any]
"""A parameter file, the name of a shipped one, or what stands in one below ``ros__parameters``."""
OWN = ("state", "effectors")
"""Topics of `msls_msgs`, where the parameters have no ``inputs``."""


@dataclass(frozen=True)
class Identified:
    """Models of a flight as arrays: k models, n states, m effectors; ``xdot = A x + B delta + bias``."""

    states: tuple[str, ...]
    effectors: tuple[str, ...]
    time: Array
    """(k,) of each model, as stamped [s]."""
    a: Array
    """(k, n, n) [state per second per state]."""
    a_std: Array
    a_reliable: Flags
    b: Array
    """(k, n, m) [state per second per rad]."""
    b_std: Array
    b_reliable: Flags
    bias: Array
    """(k, n) [state per second]."""
    events: list[FaultEvent]
    """Alarms, names and recoveries, the earliest first; ``.time`` as stamped [s]."""
    estimates: list[Estimate]
    """Each model with all that is known of it."""
    samples: int
    """Samples that passed the checks."""
    refused: dict[str, int]
    """Messages refused, by reason."""
    reasons: dict[str, str]
    """The first refusal of each reason, in words."""
    findings: list[Finding]
    """What an inspection of the log through its map finds, the worst first."""
    warnings: list[str]
    """What of the log could not be read, and what is not as in flight."""


def identify_log(
    log: str | os.PathLike[str],
    params: str | os.PathLike[str] | None = None,
    *,
    every: int = 10,
    namespace: str | None = None,
    anyway: bool = False,
) -> Identified:
    """Identify from a bag or a log of an autopilot, as ``./msls replay`` does.

    Parameters
    ----------
    log
        What to read.
    params
        A parameter file, with its map of other message types, or the name of a shipped one; None: what is kept beside
        the log, otherwise a map of its topics.
    every
        Samples per model; there is one at the end as well.
    namespace
        The aircraft, where the log has several.
    anyway
        Use a map that an inspection finds wrong.

    Raises
    ------
    BagError
        If the log cannot be used at all.
    EstimationError
        If the parameters are wrong, the map makes numbers wrong, or nothing comes of the log.
    """
    reader = open_any(Path(log))
    chosen = chosen_parameters(reader, None if params is None else os.fspath(params), namespace)
    inputs = chosen.inputs if isinstance(chosen.inputs, InputMap) else None
    inspection = inspect(reader, chosen.configuration, chosen.inputs)
    if inputs is not None and not anyway:
        refuse_wrong(str(log), inspection.findings, "anyway=True")
    flow = _Flow(chosen.configuration, every, chosen.warm_start)
    options = ReplayOptions(namespace=namespace, inputs=inputs)
    own, source, _ = open_source(Path(log), chosen.configuration, options, flow.gate, flow.note)
    blocks = chain.from_iterable(map(source.segments, ordered_batches(own, source.topics, source.longest_run)))
    flow.take(chain(blocks, source.rest()), source.straddle, servos=source.servos)
    return flow.result(str(log), source.topics, inspection.findings, [*own.warnings, *flow.warnings])


def identify_messages(
    messages: Iterable[Message], params: Parameters, *, every: int = 10, anyway: bool = False
) -> Identified:
    """Identify from messages in memory, in the order in which they arrive.

    Parameters
    ----------
    messages
        Those on topics that the map does not have are left out. Without ``inputs`` among the parameters they are
        `msls_msgs` on ``state`` and ``effectors``.
    params
        See `Parameters`.
    every, anyway
        As `identify_log`.

    Raises
    ------
    EstimationError
        If the parameters are wrong, a message has no such field, the map makes numbers wrong, or nothing comes of them.
    """
    configuration, inputs, warm_start = _read(params)
    taken = list(messages)
    flow = _Flow(configuration, every, warm_start)
    if inputs is None:
        flow.take(collected(_own_offers(taken, flow.gate)), 0)
        return flow.result("messages", OWN, [], flow.warnings)
    adapter = InputAdapter.of(inputs, configuration, flow.gate.refused, flow.note)
    missing = sorted(set(adapter.topics) - {topic for topic, _, _ in taken})
    if missing:
        there = ", ".join(sorted({topic for topic, _, _ in taken})) or "none"
        message = f"no message on {', '.join(missing)}; there are those on {there}"
        raise EstimationError(message)
    findings = _looked_at(taken, configuration, inputs)
    if not anyway:
        refuse_wrong("messages", findings, "anyway=True")
    wanted = (message for message in taken if message[0] in adapter.topics)
    blocks = collected(partial(row.offer, flow.gate) for row in adapt(wanted, adapter))
    flow.take(blocks, adapter.straddle, servos=adapter.servos)
    return flow.result("messages", tuple(adapter.topics), findings, flow.warnings)


def rows(topic: str, time: ArrayLike, **fields: ArrayLike) -> Iterator[Message]:
    """Return arrays as the messages of a topic; several topics go together by ``heapq.merge(..., key=itemgetter(1))``.

    Parameters
    ----------
    topic
        As the map has it; of its type any name will do.
    time
        (k,) stamps [s].
    **fields
        (k,) or (k, 3) and (k, 4), by the names in the paths of the map, of an attitude w first. One with dots goes in
        by ``**{"twist.twist.linear": v}``. NaN where nothing was measured: such a number is refused and counted, the
        rest is not.

    Raises
    ------
    EstimationError
        For lengths that differ, stamps that are not finite, dates and text; for names of which one is within another.
    """
    for name in fields:
        if inner := next((other for other in fields if other.startswith(name + ".")), ""):
            message = f"{inner} of {topic} is a part of {name}, that is given whole: give either"
            raise EstimationError(message)
    stamps = as_numbers(f"time of {topic}", time)
    columns = {name: as_numbers(f"{name} of {topic}", values) for name, values in fields.items()}
    if not np.isfinite(stamps).all():
        k = int(np.argmin(np.isfinite(stamps)))
        message = f"time of {topic} is {stamps[k]} at row {k}; expected finite seconds: leave such rows out"
        raise EstimationError(message)
    for name, column in columns.items():
        if len(column) != len(stamps):
            message = f"{name} of {topic} has {len(column)} values; expected one for each of the {len(stamps)} stamps"
            raise EstimationError(message)
    return _rows(topic, np.rint(1e9 * stamps).astype(np.int64).tolist(), columns)


def _rows(topic: str, stamps: list[int], columns: dict[str, Array]) -> Iterator[Message]:
    lists = [column.tolist() for column in columns.values()]
    paths = [name.split(".") for name in columns]
    for stamp, *values in zip(stamps, *lists, strict=True):
        header = SimpleNamespace(stamp=SimpleNamespace(sec=stamp // 10**9, nanosec=stamp % 10**9))
        message = SimpleNamespace(header=header)
        for path, value in zip(paths, values, strict=True):
            place = message
            for name in path[:-1]:
                place = place.__dict__.setdefault(name, SimpleNamespace())
            place.__dict__[path[-1]] = value
        yield topic, stamp, message


class _Flow:
    """The gate and the identifier of one flight, and what comes of it."""

    def __init__(self, configuration: Configuration, every: int, warm_start: Path | None) -> None:
        self._configuration, self._every, self._warm_start = configuration, every, warm_start
        self.warnings: list[str] = []
        self.gate = Synchronizer.of(configuration, self.note)
        self._reasons: dict[str, str] = {}
        self._estimates: list[Estimate] = []
        self._samples = 0
        self._last: tuple[float, Array] | None = None

    def note(self, refused: Refused) -> None:
        """Keep the first refusal of each reason."""
        self._reasons.setdefault(refused.reason, str(refused))

    def take(self, blocks: Iterable[PairedBlock], straddle: int, *, servos: bool = False) -> None:
        """Identify from all samples: the same estimates, however they are read."""
        identifier = Identifier(self._configuration, straddle, servos=servos, gated=True)
        self.warnings += start_if_there(identifier, self._warm_start)
        waiting: list[PairedBlock] = []
        for block in blocks:
            if not len(block.stamps):
                continue
            if block.restarted:
                self._run(identifier, waiting)
                identifier.reset()
                waiting = []
            waiting.append(block)
            if sum(len(one.stamps) for one in waiting) >= self._every - identifier.samples % self._every:
                waiting = self._run(identifier, waiting, self._every)
        self._run(identifier, waiting)
        if self._last is not None and not (self._estimates and self._estimates[-1].time == self._last[0]):
            self._estimates.append(identifier.estimate(*self._last))

    def _run(self, identifier: Identifier, blocks: list[PairedBlock], whole: int = 1) -> list[PairedBlock]:
        """Take blocks up to a sample whose number is a multiple of ``whole``; return what is left of them."""
        if not blocks:
            return []
        stamps = np.concatenate([block.stamps for block in blocks])
        x, xdot, delta = (np.concatenate([getattr(one, name) for one in blocks]) for name in ("x", "xdot", "delta"))
        end = len(stamps) - (identifier.samples + len(stamps)) % whole
        time = np.multiply(stamps[:end], 1e-9, dtype=np.float64)
        self._estimates += identifier.run(time, x[:end], xdot[:end], delta[:end], self._every).estimates
        self._samples += end
        self._last = float(time[-1]), x[end - 1]
        left = slice(end, len(stamps))
        rest = blocks[-1]._replace(restarted=False, stamps=stamps[left], x=x[left], xdot=xdot[left], delta=delta[left])
        return [rest] if end < len(stamps) else []

    def result(self, name: str, topics: Sequence[str], findings: list[Finding], warnings: list[str]) -> Identified:
        """Return what came of it.

        Raises
        ------
        EstimationError
            If there was not one sample.
        """
        if not self._samples:
            message = f"{name}: not one sample; {why_none(topics, self.gate, self._reasons)}"
            raise EstimationError(message)
        c, found = self._configuration, self._estimates
        a, a_std, b, b_std, bias = (
            np.array([getattr(e, part) for e in found]) for part in ("a", "a_std", "b", "b_std", "bias")
        )
        reliable = [np.array([getattr(e, part) for e in found]) for part in ("a_reliable", "b_reliable")]
        return Identified(
            states=c.states,
            effectors=c.effectors,
            time=np.array([e.time for e in found]),
            a=a,
            a_std=a_std,
            a_reliable=reliable[0],
            b=b,
            b_std=b_std,
            b_reliable=reliable[1],
            bias=bias,
            events=[event for e in found for event in e.events],
            estimates=found,
            samples=self._samples,
            refused=dict(self.gate.refused),
            reasons=self._reasons,
            findings=findings,
            warnings=warnings,
        )


def _read(params: Parameters) -> tuple[Configuration, InputMap | None, Path | None]:
    if isinstance(params, Mapping):
        return *parameters_of(params, "parameters"), warm_start_of(params, "parameters")
    path = profile_path(params)
    return read_profile(path), read_inputs(path), read_warm_start(path)


def _own_offers(messages: Iterable[Message], gate: Synchronizer) -> Iterator[Offer]:
    for topic, _, message in messages:
        leaf = topic.rpartition("/")[2]
        if leaf in OWN:
            stamp = int(message.header.stamp.sec) * 10**9 + int(message.header.stamp.nanosec)
            if leaf == "state":
                yield partial(gate.add_state, stamp, message.states, message.x, message.xdot)
            else:
                yield partial(gate.add_effectors, stamp, message.effectors, message.delta)


def _looked_at(messages: Iterable[Message], configuration: Configuration, inputs: InputMap) -> list[Finding]:
    """Return what an inspection finds."""
    collector = Collector(inputs)
    for message in messages:
        collector.take(*message)
    return findings_of(collector.record(), configuration)
