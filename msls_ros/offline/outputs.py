"""From samples to a bag: the node's identifier, and the messages it would have published, serialised by the block."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msls_ros import records
from msls_ros.bags import BagWriter, MessageTemplate
from msls_ros.estimation import Configuration, DitherBlock, Estimate, FaultEvent, Identifier
from msls_ros.inputs.answers import Answered
from msls_ros.inputs.block_pairing import Held, PairedBlock
from msls_ros.inputs.model_file import start_if_there
from msls_ros.offline.best import BestModel

DITHER, FAULT, MODEL = "msls_msgs/msg/DitherCommand", "msls_msgs/msg/FaultEvent", "msls_msgs/msg/LinearModel"
OUTPUTS = {"dither": DITHER, "fault": FAULT, "model": MODEL}
Stamps = NDArray[np.int64]
Block = tuple[str, Stamps, NDArray[np.uint8]]


class IdentifierOutput:
    """Identifies from samples and writes what comes of it.

    Parameters
    ----------
    writer
        The bag.
    prefix
        What stands before the names of the topics, as before those of the inputs.
    configuration
        Of the identifier.
    every
        Samples per model.
    straddle, servos
        Samples over which the inputs were smoothed, and whether they have passed declared servos; as `Identifier`.
    warm_start
        The saved model to start from; None: from nothing.

    Raises
    ------
    EstimationError
        For a saved model that is wrong or of other names.
    """

    def __init__(
        self,
        writer: BagWriter,
        prefix: str,
        configuration: Configuration,
        every: int,
        *,
        straddle: int = 0,
        servos: bool = False,
        warm_start: Path | None = None,
    ) -> None:
        """Announce the topics; see the class."""
        self._writer, self._every = writer, every
        self._identifier = Identifier(configuration, straddle, servos=servos, gated=True)
        n, m = len(configuration.states), len(configuration.effectors)
        flying = np.array([configuration.reference_speed if s == "u" else 0.0 for s in configuration.states])
        self._identifier.update(0.0, flying, np.zeros(n), np.zeros(m))  # compiles
        self._identifier.reset()
        self.warnings = start_if_there(self._identifier, warm_start)
        """What is not as in flight."""
        self._before = 0, 0, 0
        self._effectors = list(configuration.effectors)
        self._topic = {leaf: prefix + leaf for leaf in OUTPUTS}
        for leaf, msgtype in OUTPUTS.items():
            writer.add_topic(self._topic[leaf], msgtype)
        self._dither_templates: dict[str, MessageTemplate] = {}
        self._model_template: MessageTemplate | None = None
        self.samples = self.models = 0
        self.negative = 0
        """Messages that no bag can hold: their stamps are before 0."""
        self.best = BestModel()
        """Of the models that were written."""
        self.events: list[tuple[int, FaultEvent]] = []
        """Stamps [ns] and events."""
        self._last: list[DitherBlock] = []
        self._answered = Answered()
        self.span: tuple[int, int] | None = None
        """Stamps of the first and the last sample [ns]."""

    @property
    def grounded(self) -> int:
        """Samples that were not of flight."""
        return self._before[0] + self._identifier.grounded

    @property
    def spikes(self) -> int:
        """Samples that were not learnt from because something jumped away and back."""
        return self._before[1] + self._identifier.spikes

    @property
    def repeated(self) -> int:
        """Samples that were not learnt from because a number in them had not been measured anew."""
        return self._before[2] + self._identifier.repeated

    @property
    def repeating(self) -> str:
        """Which that was last, since the last jump of time; empty: none."""
        return self._identifier.repeating

    def take(self, segment: PairedBlock) -> None:
        """Identify from a segment; write its dithers, events and models in the order of their stamps.

        Raises
        ------
        BagError
            If the bag cannot be written.
        """
        if segment.restarted:
            self._before = self.grounded, self.spikes, self.repeated
            self._identifier.reset()
            self._answered.clear()
        stamps = segment.stamps
        if not len(stamps):
            self._write(list(self._answers(segment, [])))
            return
        time = np.multiply(stamps, 1e-9, dtype=np.float64)
        run = self._identifier.run(time, segment.x, segment.xdot, segment.delta, self._every)
        blocks = list(self._answers(segment, run.dithers))
        events = [event for estimate in run.estimates for event in estimate.events]
        blocks += [self._fault(_stamp_at(stamps, time, event.time), event) for event in events]
        models = [estimate for estimate in run.estimates if estimate.samples % self._every == 0]
        if models:
            blocks.append(self._models(np.array([_stamp_at(stamps, time, m.time) for m in models]), models))
        self.best.take(models, events)
        self._write(blocks)
        self.samples += len(stamps)
        self.models += len(models)
        self.span = (self.span[0] if self.span else int(stamps[0]), int(stamps[-1]))

    def _answers(self, segment: PairedBlock, made: list[DitherBlock]) -> Iterator[Block]:
        """Serialise the dithers that answer a segment, stamped as in flight; ``made`` are those of its samples."""
        if not self._last and not made:
            return
        found = _joined([*self._last, *made])
        first, stamps = len(self._last), segment.stamps.tolist()
        which, answered, begin = list[int](), list[int](), 0
        for held_for, end in (*segment.held, Held(0, len(stamps))):
            for k in range(begin, end):
                if self._answered.is_open(stamps[k]):
                    which.append(first + k)
                    answered.append(stamps[k])
            begin = end
            newest = stamps[end - 1] if end else self.span and self.span[1]
            if held_for and newest is not None:
                which.append(first + end - 1)
                answered.append(self._answered.hold(newest, held_for))
        self._last = [DitherBlock._make(column[-1:].copy() for column in found)]
        if which:
            yield from self._dithers(np.array(answered, np.int64), DitherBlock._make(column[which] for column in found))

    def _dithers(self, stamps: Stamps, block: DitherBlock) -> Iterator[Block]:
        """Serialise dithers; those of one reason are one block."""
        for code in np.unique(block.reason):
            which = np.flatnonzero(block.reason == code)
            first = block.at(int(which[0]))
            template = self._dither_templates.get(first.reason)
            if template is None:
                template = _template(DITHER, records.dither_fields(self._effectors, first))
                self._dither_templates[first.reason] = template
            rows = _stamped(template, stamps[which])
            for name in records.DITHER_NUMBERS:
                rows[name] = getattr(block, name)[which]
            yield self._topic["dither"], stamps[which], template.cdr(rows)

    def _fault(self, stamp: int, event: FaultEvent) -> Block:
        self.events.append((stamp, event))
        stamps = np.array([stamp], dtype=np.int64)
        template = _template(FAULT, records.fault_fields(event))
        return self._topic["fault"], stamps, template.cdr(_stamped(template, stamps))

    def _models(self, stamps: Stamps, models: list[Estimate]) -> Block:
        template = self._model_template
        if template is None:
            template = self._model_template = _template(MODEL, records.model_fields(models[0]))
        rows = _stamped(template, stamps)
        for name in records.MODEL_NUMBERS:
            rows[name] = np.array([getattr(m, name) for m in models]).reshape(rows[name].shape)
        return self._topic["model"], stamps, template.cdr(rows)

    def _write(self, blocks: list[Block]) -> None:
        kept = []
        for topic, stamps, rows in blocks:
            good = stamps >= 0
            self.negative += len(stamps) - int(np.count_nonzero(good))
            kept.append((topic, stamps, rows) if good.all() else (topic, stamps[good], rows[good]))
        self._writer.write_blocks(kept)


def _template(msgtype: str, fields: records.Fields) -> MessageTemplate:
    flat = {name: value.ravel() if isinstance(value, np.ndarray) else value for name, value in fields.items()}
    return MessageTemplate(msgtype, {"header": records.header_fields(0), **flat})


def _stamped(template: MessageTemplate, stamps: Stamps) -> NDArray[Any]:
    rows = template.rows(len(stamps))
    rows["header.stamp.sec"], rows["header.stamp.nanosec"] = np.divmod(stamps, 1_000_000_000)
    return rows


def _joined(blocks: list[DitherBlock]) -> DitherBlock:
    if len(blocks) == 1:
        return blocks[0]
    return DitherBlock(*(np.concatenate(column) for column in zip(*blocks, strict=True)))


def _stamp_at(stamps: Stamps, time: NDArray[np.float64], instant: float) -> int:
    """Return the stamp of the sample with that time."""
    return int(stamps[np.searchsorted(time, instant)])
