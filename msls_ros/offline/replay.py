"""Identify from a bag: the same gate and the same identifier as in flight, fed from a file.

`replay` streams a bag of any length into a new one; `load`, `paired` and `identify` hold a short flight in memory.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from shutil import copyfile
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from msls_ros import bags
from msls_ros.bags import (
    HELD,
    AnyReader,
    BagError,
    BagMessage,
    BagReader,
    BagWriter,
    LogReader,
    open_any,
    replacing,
)
from msls_ros.bags.small_yaml import YamlError, check
from msls_ros.estimation import Configuration, Estimate, EstimationError, FaultEvent, Identifier
from msls_ros.inputs import InputAdapter, InputMap, Refused, Synchronizer
from msls_ros.inputs.profiles import BESIDE_A_BAG, MODEL_BESIDE, read_warm_start, render_profile
from msls_ros.offline.best import Known
from msls_ros.offline.collection import no_collection
from msls_ros.offline.outputs import OUTPUTS, IdentifierOutput
from msls_ros.offline.sources import MappedSource, SampleSource, Source, find_topics, ordered_batches

Array = NDArray[np.float64]
_MOST = 1 << 16
"""Characters of a file that is kept in a bag's folder."""


def keep_parameters(bag: Path, configuration: Configuration, file: Path | str | None = None) -> None:
    """Write the parameters of the identifier into a bag's folder, for `replay`; a file or a text as it is.

    The model that a file's identifier starts from is kept beside it.
    """
    if isinstance(file, str):
        text = file
    elif file is None:
        text = render_profile(configuration, "The identifier's parameters in this flight.")
    else:
        text = file.read_text(encoding="utf-8")
    (bag / BESIDE_A_BAG).write_text(text, encoding="utf-8")
    model = read_warm_start(file) if isinstance(file, Path) else None
    if model is not None and model.is_file():
        copyfile(model, bag / MODEL_BESIDE)


def kept_parameters(bag: Path) -> Path:
    """Return the parameter file in a bag's folder.

    Raises
    ------
    BagError
        If there is none, or no bag; or if it came with a bag and is more YAML than parameters are.
    """
    path = (bag if bag.is_dir() else bag.parent) / BESIDE_A_BAG
    if not path.is_file():
        open_any(bag)
        message = f"{bag}: the parameters of the flight are unknown, no {BESIDE_A_BAG} beside it; give --params"
        raise BagError(message)
    kept = {path: "the parameters of a flight", path.with_name(MODEL_BESIDE): "the model that a flight began with"}
    for file, what in kept.items():
        try:
            if file == path or file.is_file():
                with file.open(encoding="utf-8") as stream:
                    check(stream.read(_MOST + 1), _MOST)
        except (YamlError, OSError, ValueError) as error:
            message = f"{file}: not {what}: {error}; give --params"
            raise BagError(message) from error
    return path


@dataclass(frozen=True)
class Replay:
    """What a replayed bag gave."""

    samples: int
    models: int
    events: list[tuple[int, FaultEvent]]
    """Stamps [ns] and events."""
    refused: dict[str, int]
    """Messages refused, by reason."""
    restarts: int
    """Jumps back in time."""
    grounded: int
    """Samples that were not of flight."""
    spikes: int
    """Samples that were not learnt from because something jumped away and back."""
    repeated: int
    """Samples that were not learnt from because a number in them had not been measured anew."""
    repeating: str
    """Which that was last."""
    span: tuple[int, int] | None
    """Stamps of the first and the last sample [ns]."""
    wall_time: float
    """[s]"""
    warnings: list[str]
    known: list[Known] = field(default_factory=list)
    """What was reliable, at its best."""


@dataclass(frozen=True)
class ReplayOptions:
    """How to replay."""

    every: int = 1
    """Samples per model."""
    merge: bool = False
    """Write the input beside the output; topics of the identifier in it are replaced."""
    namespace: str | None = None
    """The aircraft, where a bag has several."""
    definitions: Sequence[Path] = ()
    """Folders of message definitions that the bag does not hold."""
    overwrite: bool = False
    """Replace a bag in the place of the output, once the new one is whole and has samples."""
    held: int = HELD
    """What reading may hold at a time [bytes]."""
    inputs: InputMap | None = None
    """Where messages of other types have states and deflections; None: `msls_msgs` on the identifier's topics."""
    parameters: Path | str | None = None
    """File or text of configuration and inputs, to be kept with the output; None: the configuration is written."""
    warm_start: Path | None = None
    """The saved model to start from; None: from nothing."""


def replay(
    bag: Path,
    out: Path,
    configuration: Configuration,
    options: ReplayOptions = ReplayOptions(),
    progress: Callable[[float, int], None] = lambda share, samples: None,
) -> Replay:
    """Identify from a bag and write what the node would have published as a new bag.

    Parameters
    ----------
    bag, out
        What to read, and the folder to write.
    configuration
        Of the identifier.
    options
        See `ReplayOptions`.
    progress
        Called with the share of the bag that is done (0 to 1), and the samples.

    Raises
    ------
    BagError
        If the bag cannot be used at all, or the new one not be written.
    EstimationError
        If the inputs do not give the states and deflections of the configuration, or the saved model does not fit.
    """
    reasons: dict[str, str] = {}

    def note(refused: Refused) -> None:
        reasons.setdefault(refused.reason, str(refused))

    gate = Synchronizer.of(configuration, note)
    opened = open_source(bag, configuration, options, gate, note)
    with replacing(out) if options.overwrite else nullcontext((out, lambda: None)) as (place, take_place):
        with no_collection():
            result = _write(opened, place, configuration, options, gate, reasons, progress)
        if result.samples:
            take_place()
        elif place != out:
            result.warnings.append(f"{out}: left as it was")
    return result


class Opened(NamedTuple):
    """A bag to replay."""

    reader: AnyReader
    source: Source
    prefix: str
    """Of the topics."""


def _write(
    opened: Opened,
    out: Path,
    configuration: Configuration,
    options: ReplayOptions,
    gate: Synchronizer,
    reasons: Mapping[str, str],
    progress: Callable[[float, int], None],
) -> Replay:
    """Identify and write."""
    reader, source, prefix = opened
    with BagWriter(out, definition_paths=options.definitions) as writer:
        keep_parameters(out, configuration, options.parameters)
        output = IdentifierOutput(
            writer,
            prefix,
            configuration,
            options.every,
            straddle=source.straddle,
            servos=source.servos,
            warm_start=options.warm_start,
        )
        start = time.perf_counter()
        beside = _Beside(reader, writer, prefix) if options.merge and isinstance(reader, BagReader) else None
        for batch in ordered_batches(reader, source.topics, source.longest_run):
            if beside is not None:
                beside.take(batch)
            for segment in source.segments(batch):
                output.take(segment)
            progress(reader.progress, output.samples)
        for segment in source.rest():
            output.take(segment)
    warnings = list(reader.warnings) + (beside.warnings if beside else []) + output.warnings
    if output.negative:
        warnings.append(f"{out}: {output.negative} messages with stamps before 0 left out; a bag cannot hold them")
    if not output.samples and not warnings:
        warnings.append(f"{reader.path}: not one sample; {why_none(source.topics, gate, reasons)}")
    warnings += source.warnings
    if 2 * output.grounded > output.samples:
        c = configuration
        slow = f"slower than {c.flying_speed * c.reference_speed:.3g} m/s, or not seen to climb after it"
        mend = f"check reference_speed, {c.reference_speed:g} m/s, or set flying_speed to 0"
        what = f"{output.grounded} of {output.samples} samples are not of flight ({slow}) and not learnt from"
        warnings.append(f"{reader.path}: {what}; {mend}")
    wall_time = time.perf_counter() - start
    return Replay(
        output.samples,
        output.models,
        output.events,
        dict(gate.refused),
        gate.restarts,
        output.grounded,
        output.spikes,
        output.repeated,
        output.repeating,
        output.span,
        wall_time,
        warnings,
        output.best.known,
    )


def why_none(topics: Sequence[str], gate: Synchronizer, reasons: Mapping[str, str]) -> str:
    """Say why no sample came about: the reason that most messages were refused for, or that no stamps are equal."""
    if not gate.refused:
        return f"{' and '.join(topics)} have no stamp in common"
    reason, count = gate.refused.most_common(1)[0]
    return f"{count} messages refused ({reason}): {reasons.get(reason, 'see ./msls inspect')}"


def open_source(
    bag: Path,
    configuration: Configuration,
    options: ReplayOptions,
    gate: Synchronizer,
    note: Callable[[Refused], None] = lambda _: None,
) -> Opened:
    """Return the bag's reader, the source of samples in it, and the prefix of the topics."""
    looked = open_any(bag, definition_paths=options.definitions, held=options.held)
    if options.inputs is None:
        topics = find_topics(bag, looked.topics, options.namespace)
        source: Source = SampleSource(topics, gate)
        prefix = topics.prefix
    else:
        adapter = InputAdapter.of(options.inputs, configuration, gate.refused, note)
        try:
            source = MappedSource(looked, adapter, gate)
        except EstimationError as error:
            message = f"{bag}: {error}"
            raise BagError(message) from error
        prefix = "/"
    if options.merge:
        if isinstance(looked, LogReader):
            message = f"{bag}: its rows are no messages of ROS: a log cannot be merged into a bag"
            raise BagError(message)
        return Opened(looked, source, prefix)
    return Opened(looked.only(source.topics), source, prefix)


class _Beside:
    """Copies the input into the output bag, but the topics that the output replaces."""

    def __init__(self, reader: BagReader, writer: BagWriter, prefix: str) -> None:
        self._reader, self._writer = reader, writer
        self._known: dict[str, bool] = {prefix + leaf: False for leaf in OUTPUTS}
        self.warnings: list[str] = []

    def take(self, batch: Sequence[BagMessage]) -> None:
        for message in batch:
            known = self._known.get(message.topic)
            if known is None:
                known = self._known[message.topic] = self._announce(message.topic)
            if known:
                self._writer.write(*message)

    def _announce(self, topic: str) -> bool:
        try:
            definition = self._reader.definition(topic)
        except BagError as error:
            self.warnings.append(f"{error} (--definitions); the topic is not merged")
            return False
        self._writer.add_topic(topic, definition.msgtype, qos=self._reader.qos(topic), definition=definition)
        return True


@dataclass
class Samples:
    """Paired samples as arrays; n samples."""

    time: Array
    x: Array
    xdot: Array
    delta: Array


@dataclass
class Flight:
    """A recorded flight, decoded: messages by topic, each with its stamp [ns]."""

    messages: dict[str, list[tuple[int, Any]]] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)

    def topic(self, name: str) -> list[tuple[int, Any]]:
        """Return the messages of a topic, also under a namespace; none: an empty list."""
        for topic, found in self.messages.items():
            if topic == f"/{name}" or (topic.endswith(f"/{name}") and f"/truth/{name}" not in topic):
                return found
        return []


def load(bag: str | Path) -> Flight:
    """Read a bag into memory.

    Raises
    ------
    BagError
        If it cannot be read.
    """
    flight = Flight()
    reader = bags.read(bag)
    for message, decoded in reader.decoded():
        flight.messages.setdefault(message.topic, []).append((message.stamp_ns, decoded))
    flight.warnings = list(reader.warnings)
    return flight


def paired(bag: str | Path, configuration: Configuration) -> tuple[Samples, Synchronizer]:
    """Put a bag's states and deflections through the gate; return the samples, and the gate with its counts.

    Raises
    ------
    BagError
        If the bag cannot be used at all, or holds not one sample.
    """
    gate = Synchronizer.of(configuration)
    reader, source, _ = open_source(Path(bag), configuration, ReplayOptions(), gate)
    blocks = [b for batch in ordered_batches(reader, source.topics, source.longest_run) for b in source.segments(batch)]
    blocks += source.rest()
    if not blocks:
        message = f"{bag}: not one sample"
        raise BagError(message)
    x, xdot, delta = (np.concatenate([getattr(block, name) for block in blocks]) for name in ("x", "xdot", "delta"))
    stamps = np.concatenate([block.stamps for block in blocks])
    return Samples(np.multiply(stamps, 1e-9, dtype=np.float64), x, xdot, delta), gate


def identify(samples: Samples, configuration: Configuration) -> list[Estimate]:
    """Return the estimate after every sample."""
    return Identifier(configuration, gated=True).run(samples.time, samples.x, samples.xdot, samples.delta).estimates
